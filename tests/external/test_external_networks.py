"""Networks in ONNX in a study: a linear observer as a recurrent network beside its twin in Python, and refusals."""

import numpy as np
import pytest

from harness.common.errors import UserError
from harness.config import build_study
from harness.study.design import units
from harness.study.evaluate import StudyEvaluator
from harness.study.score_names import OK, STATUS
from support.observers import CONTENT, OF_THE_LIBRARY, compiled, needs_compiler, source

onnx = pytest.importorskip("onnx")
pytest.importorskip("onnxruntime")

A = np.array([[0.9, -0.12], [0.02, 0.85]])
B = np.array([[0.03, 0.0, 0.05], [0.05, 1e-4, 0.12]])

TWIN = f"""
import numpy as np
A, B = np.array({A.tolist()}), np.array({B.tolist()})

class Twin:
    inputs, measurements = ("steering_wheel_angle", "speed"), ("yaw_rate",)
    estimates = ("lateral_velocity", "yaw_rate")
    def reset(self, values, step): self.x, self.y, self.window = np.zeros(2), 0.0, np.zeros((4, 3))
    def features(self, u, y):
        self.y = self.y if np.isnan(y[0]) else y[0]
        return np.array([*u, self.y])
    def step(self, u, y, dt):
        self.x = A @ self.x + B @ self.features(u, y)
        return self.x

class Forward(Twin):
    def step(self, u, y, dt): return B @ self.features(u, y)

class Window(Twin):
    def step(self, u, y, dt):
        self.window = np.vstack([self.window[1:], self.features(u, y)])
        return B @ (np.array([0.1, 0.2, 0.3, 0.4]) @ self.window)
"""


def tensor(name, *shape, kind=onnx.TensorProto.DOUBLE):
    return onnx.helper.make_tensor_value_info(name, kind, shape)


def node(kind, inputs, output, **attributes):
    return onnx.helper.make_node(kind, inputs.split(), [output], **attributes)


def written(path, nodes, inputs, outputs, **constants):
    held = [onnx.numpy_helper.from_array(np.asarray(value), name) for name, value in constants.items()]
    graph = onnx.helper.make_graph(nodes, "net", inputs, outputs, held)
    model = onnx.helper.make_model(graph, opset_imports=[onnx.helper.make_opsetid("", 17)], ir_version=8)
    onnx.checker.check_model(model)
    path.write_bytes(model.SerializeToString())


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    folder = tmp_path_factory.mktemp("networks")
    (folder / "twin.py").write_text(TWIN)
    recurrent = [
        node("MatMul", "h A", "a"),
        node("MatMul", "x B", "b"),
        node("Add", "a b", "next"),
        node("Identity", "next", "y"),
    ]
    outputs = [tensor("y", 1, 2), tensor("next", 1, 2)]
    written(folder / "recurrent.onnx", recurrent, [tensor("x", 1, 3), tensor("h", 1, 2)], outputs, A=A.T, B=B.T)
    for name, first in (("one", 1), ("free", "n")):
        written(
            folder / f"{name}.onnx",
            [node("MatMul", "x B", "y")],
            [tensor("x", first, 3)],
            [tensor("y", first, 2)],
            B=B.T,
        )
    window = [node("MatMul", "x B", "z"), node("MatMul", "w z", "v"), node("Squeeze", "v axis", "y")]
    written(
        folder / "window.onnx", window, [tensor("x", "n", 4, 3)], [tensor("y", "n", 2)],
        B=B.T, w=[[0.1, 0.2, 0.3, 0.4]], axis=np.array([1]),
    )  # fmt: skip
    single = tensor("x", 1, 3, kind=onnx.TensorProto.FLOAT), tensor("y", 1, 2, kind=onnx.TensorProto.FLOAT)
    written(folder / "single.onnx", [node("MatMul", "x B", "y")], single[:1], single[1:], B=B.T.astype(np.float32))
    (folder / "broken.onnx").write_bytes(b"no network")
    return folder


GETS = {
    "inputs": ["steering_wheel_angle", "speed"],
    "measurements": ["yaw_rate"],
    "estimates": ["lateral_velocity", "yaw_rate"],
}
STATE = {"state": {"h": "next"}}


def evaluator(folder, *estimators):
    content = {**CONTENT, "estimator": [{"kind": "external", **e} for e in estimators]}
    return StudyEvaluator(build_study(content, folder / "study.toml"))


@pytest.mark.parametrize(
    ("file", "settings", "twin", "tolerance"),
    [
        ("recurrent.onnx", STATE, "Twin", 1e-12),
        ("one.onnx", {}, "Forward", 1e-12),
        ("free.onnx", {}, "Forward", 1e-12),
        ("window.onnx", {}, "Window", 1e-12),
        ("single.onnx", {}, "Forward", 1e-5),
    ],
)
def test_a_network_scores_as_its_twin_in_python(folder, file, settings, twin, tolerance):
    network = {"name": "network", "onnx": file, "settings": settings, **GETS}
    made = evaluator(folder, network, {"name": "twin", "python": f"twin:{twin}"})
    for unit in units(made.study, made.study.designs[0]):
        result = made.evaluate(unit)
        assert made.lost() == []
        assert (result[STATUS] == OK).all()
        for name in ("rmse", "bias", "max_error"):
            own, other = np.moveaxis(result[name], 2, 0)
            np.testing.assert_allclose(own, other, rtol=tolerance, atol=1e-14)


@pytest.mark.parametrize(
    ("file", "changes", "words"),
    [
        ("recurrent.onnx", {}, "takes one input .* this has x .1, 3. tensor.double., h"),
        ("recurrent.onnx", {"settings": {"state": {"h": "nxt"}}}, "there is no input 'h' with an output 'nxt'"),
        ("one.onnx", {"settings": {"gain": 1.0}}, "has no setting 'gain'"),
        ("one.onnx", {"measurements": ["yaw_rate", "lateral_acceleration"]}, "it has 3 features, the study 4"),
        ("one.onnx", {"estimates": ["yaw_rate"]}, "it has 2 estimates, the study 1"),
        ("one.onnx", {"values": ["mass"]}, "it has 0 values, the study 1"),
        ("one.onnx", {"variances": True}, "has the outputs y, not 2 as stated"),
        ("broken.onnx", {}, "cannot be read as a network"),
        ("missing.onnx", {}, "there is no file"),
    ],
)
def test_a_network_that_does_not_fit_is_an_error_in_one_line(folder, file, changes, words):
    with pytest.raises(UserError, match=words) as raised:
        evaluator(folder, {"onnx": file, **GETS, **changes})
    assert "\n" not in str(raised.value)


@needs_compiler
def test_four_kinds_of_estimators_in_one_study_on_equal_runs(folder):
    compiled(folder, source("observer.c"))
    (folder / "observer.py").write_text(source("observer.py"))
    ekf = {"name": "EKF", "kind": "ekf"}
    foreign = [
        {"name": "C", "kind": "external", "library": "libobserver.so", **OF_THE_LIBRARY},
        {"name": "Python", "kind": "external", "python": "observer:Observer"},
        {"name": "ONNX", "kind": "external", "onnx": "recurrent.onnx", "settings": STATE, **GETS},
    ]
    path = folder / "study.toml"
    together, alone = (StudyEvaluator(build_study({**CONTENT, "estimator": e}, path)) for e in ([*foreign, ekf], [ekf]))
    for unit in units(together.study, together.study.designs[0]):
        all_four, one = together.evaluate(unit), alone.evaluate(unit)
        assert together.lost() == []
        assert (all_four[STATUS] == OK).all()
        for name in ("rmse", "nees", "nis", "log_likelihood"):
            assert all_four[name][:, :, 3].tobytes() == one[name][:, :, 0].tobytes()
            assert np.isnan(all_four[name][:, :, :3]).all() == (name != "rmse")
