"""FMUs that somebody else's program wrote: PythonFMU, which runs Python in the FMU."""

from pathlib import Path

import numpy as np
import pytest

from harness.common.files import read_toml
from harness.external import python_plant
from harness.external.fmu.read import describe
from harness.external.processes import Lost, Workers

CAR = Path(__file__).parents[2] / "bench" / "multi_body"

SLAVE = """
import math
from pythonfmu import Fmi2Causality, Fmi2Slave, Fmi2Variability, Real

class Spring(Fmi2Slave):
    author, description = "somebody", "a mass on a spring"

    def __init__(self, **kwargs):
        super().__init__(**kwargs)
        self.delta, self.mass, self.rate, self.angle = 0.0, 2.0, 0.0, 0.0
        self.register_variable(Real("delta", causality=Fmi2Causality.input))
        self.register_variable(
            Real("mass", causality=Fmi2Causality.parameter, variability=Fmi2Variability.tunable, start=2.0)
        )
        self.register_variable(Real("rate", causality=Fmi2Causality.output))

    def do_step(self, current_time, step_size):
        if self.mass > 3.0 and current_time >= 0.5:
            raise ArithmeticError("too heavy")
        self.angle += step_size * self.rate
        self.rate += step_size * (self.delta - 5.0 * self.angle) / self.mass
        return True
"""

MAP = {
    "inputs": {"steering_wheel_angle": {"variable": "delta", "unit": "rad"}},
    "outputs": {"yaw_rate": {"variable": "rate", "unit": "rad/s"}},
    "parameters": {"mass": {"variable": "mass", "unit": "kg"}},
}


@pytest.fixture(scope="module")
def spring(tmp_path_factory):
    builder = pytest.importorskip("pythonfmu.builder").FmuBuilder
    if not builder.has_binary():
        pytest.skip("PythonFMU has no binary for this platform")
    folder = tmp_path_factory.mktemp("pythonfmu")
    (folder / "spring.py").write_text(SLAVE)
    return builder.build_FMU(folder / "spring.py", dest=folder)


def test_an_fmu_that_runs_python_is_run_in_worker_processes(spring):
    description = describe(spring, MAP)
    assert description.facts["needs_tool"] == "yes"
    assert [p.name for p in description.parameters] == ["mass"]
    workers = Workers({"kind": "fmu", "file": str(spring), "description": description.as_dict()})
    steer = np.sin(0.1 * np.arange(100))[:, None]
    jobs = [(0.01, steer, np.zeros((100, 0)), np.array([mass])) for mass in (2.0, 2.5, 3.5, 2.0)]
    first, second, failed, last = workers.calls("simulate", jobs)
    workers.close()
    for mass, result in ((2.0, first), (2.5, second), (2.0, last)):
        assert not isinstance(result, Lost), result
        angle, rate, expected = 0.0, 0.0, []
        for k in range(100):
            expected.append(rate)
            angle += 0.01 * rate
            rate += 0.01 * (steer[k, 0] - 5.0 * angle) / mass
        assert (result.reached, result.reason) == (100, "")
        np.testing.assert_allclose(result.outputs[:, 0], expected, rtol=0, atol=1e-12)
    assert failed.reached == 51
    assert "returned" in failed.reason


def test_the_multi_body_car_of_commonroad_as_fmu_moves_as_its_python_class(tmp_path):
    pytest.importorskip("vehiclemodels")
    builder = pytest.importorskip("pythonfmu.builder").FmuBuilder
    if not builder.has_binary():
        pytest.skip("PythonFMU has no binary for this platform")
    path = builder.build_FMU(CAR / "slave.py", dest=tmp_path, project_files=[CAR / "commonroad_car.py"])
    declared = python_plant.described("commonroad_car:MultiBody", (CAR,), "plant")
    described = describe(path, read_toml(CAR / "car.toml"))
    for group in ("inputs", "outputs", "disturbances"):
        assert [p.signal for p in getattr(described, group)] == [p.signal for p in getattr(declared, group)]
    assert sorted(p.name for p in described.parameters) == sorted(p.name for p in declared.parameters)
    time = 0.01 * np.arange(60)
    inputs = {"steering_wheel_angle": 0.4 * np.sin(6 * time), "speed": np.full(60, 20.0)}
    moment = 300.0 * np.cos(20 * time)[:, None]
    results = []
    for loader, of in (
        ({"kind": "fmu", "file": str(path)}, described),
        ({"kind": "python", **python_plant.located("commonroad_car:MultiBody", (CAR,))[1]}, declared),
    ):
        values = {p.name: p.value for p in of.parameters} | {"mass": 1300.0, "friction": 0.5}
        workers = Workers({**loader, "description": of.as_dict()})
        given = np.column_stack([inputs[p.signal] for p in of.inputs])
        run = workers.call("simulate", 0.01, given, moment, np.array([values[p.name] for p in of.parameters]))
        workers.close()
        assert not isinstance(run, Lost), run
        assert (run.reached, run.reason) == (60, "")
        results.append({p.signal: run.outputs[:, i] for i, p in enumerate(of.outputs)})
    fmu, own = results
    assert np.ptp(own["yaw_rate"]) > 0.01
    for signal, values in own.items():
        np.testing.assert_allclose(fmu[signal], values, rtol=1e-9, atol=1e-12, err_msg=signal)
