"""The NARX network: gradients, training, delays, files, and the estimator that runs it."""

import dataclasses
import json
from pathlib import Path

import numpy as np
import pytest

from harness.common.errors import UserError
from harness.config import load_drives
from harness.engine.compile import compile_model
from harness.engine.simd.lanes import LANES
from harness.estimation import narx_network as net
from harness.estimation.compiled_estimator import CompiledEstimator
from harness.estimation.methods import narx
from harness.estimation.methods.narx import MEMORY, WIDTH, placed
from harness.runner.contract import Held, InputSeries
from harness.runner.scores import Scoring
from harness.simulation.drives import profile_of
from harness.simulation.simulate import in_lanes, variances
from reproductions import narx_architecture, narx_training
from reproductions.narx import data as training_data
from reproductions.narx import levenberg_marquardt as lm
from reproductions.narx import lipschitz, training
from reproductions.narx.closed_loop import ClosedLoop

ROOT = Path(__file__).resolve().parents[2]
HIDDEN = [(5,), (4, 3), (2, 2, 2)]


def sizes_of(hidden):
    return (8, *hidden, 2)


def numerical(function, p, h=1e-6):
    return np.array([(function(p + h * e) - function(p - h * e)) / (2 * h) for e in np.eye(len(p))])


def random_pairs(hidden, samples=150, seed=0):
    rng = np.random.default_rng(seed)
    sizes = sizes_of(hidden)
    return lm.Pairs(rng.normal(size=(samples, 8)), rng.normal(size=(samples, 2)), sizes), net.nguyen_widrow(sizes, rng)


def small_network(seed=0, hidden=(5,), **changes):
    """A stable random network with the signals of the main job."""
    sizes = sizes_of(hidden)
    p = 0.2 * net.nguyen_widrow(sizes, np.random.default_rng(seed))
    fields = {
        "inputs": training_data.INPUTS,
        "outputs": training_data.OUTPUTS,
        "input_delays": 2,
        "output_delays": 2,
        "step": 0.01,
        "layers": net.unpack(p, sizes),
        "input_range": np.array([[-0.5, 0.4], [1.0, 22.0]]),
        "output_range": np.array([[-1.0, 1.2], [-4e4, 3.5e4]]),
    }
    return net.Network(**(fields | changes))


SIGNALS = ("articulation_angle", "lateral_force_axle_21", "yaw_rate_tractor")


def semitrailer_belief():
    spec = training_data.semitrailer()
    return spec, compile_model(spec.model(), spec.step, signals=SIGNALS)


def scores_of(estimator, spec, u, y, record):
    compiled = estimator.compiled
    q, r = variances(spec.process_noise, compiled.model.states), variances(spec.measurement_noise, ["yaw_rate_trailer"])
    parts = compiled.parameter_vector(spec.values), q, r, np.zeros(compiled.nx), np.ones(compiled.nx)
    return estimator.run(InputSeries(u), y, Held(*map(in_lanes, parts)), record).scores()


# --- gradients


@pytest.mark.parametrize("hidden", HIDDEN)
def test_jacobian_equals_finite_differences(hidden):
    pairs, p = random_pairs(hidden)
    layers = net.unpack(p, pairs.sizes)
    for output in range(2):
        expected = numerical(lambda q, o=output: net.forward(net.unpack(q, pairs.sizes), pairs.x)[-1][:, o], p).T
        np.testing.assert_allclose(lm.jacobian(layers, pairs.x, output), expected, atol=1e-8)


@pytest.mark.parametrize("hidden", HIDDEN)
def test_normal_equations_in_chunks_equal_the_whole_jacobian(hidden, monkeypatch):
    pairs, p = random_pairs(hidden)
    layers = net.unpack(p, pairs.sizes)
    J = np.concatenate([lm.jacobian(layers, pairs.x, o) for o in range(2)])
    e = (pairs.t - net.forward(layers, pairs.x)[-1]).T.ravel()
    monkeypatch.setattr(lm, "CHUNK", 64)  # 150 samples: two chunks and a rest
    found = pairs.normal(p)
    np.testing.assert_allclose(found.JJ, J.T @ J, atol=1e-11)
    np.testing.assert_allclose(found.Je, J.T @ e, atol=1e-11)
    assert found.errors == len(e)
    assert found.squares == pytest.approx(e @ e, rel=1e-12)
    assert pairs.squares(p) == pytest.approx(e @ e, rel=1e-12)


@pytest.mark.parametrize("hidden", HIDDEN)
@pytest.mark.parametrize("window", [None, 12])
@pytest.mark.parametrize("delays", [(2, 2), (1, 3)])
def test_backpropagation_through_time_equals_finite_differences(hidden, window, delays):
    rng = np.random.default_rng(4)
    sizes = (2 * sum(delays), *hidden, 2)
    p = net.nguyen_widrow(sizes, rng)
    drives = [(rng.normal(size=(40, 2)), 0.3 * rng.normal(size=(40, 2))) for _ in range(LANES + 3)]
    problem = ClosedLoop(drives, sizes, *delays, window=window)
    value, gradient = problem.value_and_gradient(p)
    np.testing.assert_allclose(gradient, numerical(lambda q: problem.value_and_gradient(q)[0], p), atol=1e-8)
    assert value == pytest.approx(problem.errors(p).sum(), rel=1e-12)
    again = ClosedLoop(drives, sizes, *delays, window=window, threads=1)
    np.testing.assert_array_equal(again.value_and_gradient(p)[1], gradient)


def test_free_running_error_is_that_of_the_plain_network():
    network, rng = small_network(), np.random.default_rng(5)
    inputs = np.column_stack([0.1 * rng.normal(size=60), np.linspace(5, 9, 60)])
    truth = np.column_stack([0.2 * rng.normal(size=60), 1e3 * rng.normal(size=60)])
    first = net.scaled(np.zeros(2), network.output_range)
    drive = (net.scaled(inputs, network.input_range), net.scaled(truth, network.output_range))
    problem = ClosedLoop([drive], network.sizes, 2, 2, standstill=first)
    e = net.scaled(network.free_run(inputs), network.output_range)[2:] - drive[1][2:]
    np.testing.assert_allclose(problem.errors(network.parameters), np.mean(e**2, axis=0), rtol=1e-10)


# --- training


class Line:
    """A problem that is linear in its parameters."""

    def __init__(self, A, t):
        self.A, self.t = A, t

    def normal(self, p):
        e = self.t - self.A @ p
        return lm.Normal(self.A.T @ self.A, self.A.T @ e, float(e @ e), len(e))

    def squares(self, p):
        return self.normal(p).squares


def test_levenberg_marquardt_solves_linear_least_squares():
    rng = np.random.default_rng(1)
    A, t = rng.normal(size=(60, 4)), rng.normal(size=60)
    fit = lm.train(Line(A, t), np.zeros(4), regularise=False, tolerance=1e-15)
    np.testing.assert_allclose(fit.parameters, np.linalg.lstsq(A, t, rcond=None)[0], atol=1e-9)


def test_levenberg_marquardt_finds_a_network_that_exists():
    pairs, truth = random_pairs((3,), samples=300, seed=2)
    known = lm.Pairs(pairs.x, net.forward(net.unpack(truth, pairs.sizes), pairs.x)[-1], pairs.sizes)
    near = truth + 0.05 * np.random.default_rng(3).normal(size=len(truth))
    fit = lm.train(known, near, regularise=False)
    assert known.squares(near) > 1e-1
    assert fit.squares < 1e-16


def test_effective_parameters_of_a_linear_problem_are_those_of_the_closed_form():
    """At the end alpha and beta solve MacKay's equations, with p the ridge solution they imply."""
    rng = np.random.default_rng(6)
    A = rng.normal(size=(200, 8)) * np.array([3, 2, 1, 1, 0.3, 0.1, 0.01, 0.001])
    t = A @ rng.normal(size=8) + 0.5 * rng.normal(size=200)
    fit = lm.train(Line(A, t), np.zeros(8) + 0.1, tolerance=0.0, epochs=300)
    alpha, beta, p = fit.alpha, fit.beta, fit.parameters
    ridge = np.linalg.solve(beta * A.T @ A + alpha * np.eye(8), beta * A.T @ t)
    np.testing.assert_allclose(p, ridge, rtol=1e-6, atol=1e-9)
    inverse = np.linalg.inv(2 * beta * A.T @ A + 2 * alpha * np.eye(8))
    assert fit.gamma == pytest.approx(8 - 2 * alpha * np.trace(inverse), rel=1e-6)
    assert alpha == pytest.approx(fit.gamma / (2 * p @ p), rel=1e-6)
    assert beta == pytest.approx((200 - fit.gamma) / (2 * fit.squares), rel=1e-6)
    assert 4 < fit.gamma < 7.5  # the two columns of 0.01 and 0.001 say next to nothing
    assert np.sqrt(0.5 / beta) == pytest.approx(0.5, rel=0.2)  # the noise that was put in


def test_training_stops_when_the_validation_error_rises_and_keeps_the_least():
    rng = np.random.default_rng(7)
    x, v = rng.normal(size=(30, 8)), rng.normal(size=(200, 8))
    truth = lambda z: np.column_stack([z[:, 0], z[:, 1]])  # noqa: E731
    taught = lm.Pairs(x, truth(x) + 0.5 * rng.normal(size=(30, 2)), sizes_of((12,)))
    other = lm.Pairs(v, truth(v), sizes_of((12,)))
    seen = []

    def validate(p):
        seen.append(other.squares(p))
        return seen[-1]

    fit = lm.train(
        taught, net.nguyen_widrow(taught.sizes, rng), validate=validate, regularise=False, tolerance=0.0, epochs=100
    )
    assert fit.stopped == "validation error rises"
    assert other.squares(fit.parameters) == min(seen) < seen[-1]


def test_nguyen_widrow_spreads_the_neurons_over_the_range():
    sizes = (3, 9, 4, 2)
    layers = net.unpack(net.nguyen_widrow(sizes, np.random.default_rng(0)), sizes)
    for w, n_from in zip(layers[:-1], (3, 9), strict=True):
        length = 0.7 * len(w) ** (1 / n_from)
        np.testing.assert_allclose(np.linalg.norm(w[:, :-1], axis=1), length)
        np.testing.assert_allclose(np.abs(w[:, -1]), np.abs(length * np.linspace(-1, 1, len(w))), atol=1e-12)
        # the centre of each tanh, along its direction, lies inside the scaled range
        assert np.all(np.abs(w[:, -1]) / length <= 1 + 1e-12)
    other = net.nguyen_widrow(sizes, np.random.default_rng(1))
    assert not np.array_equal(other, np.concatenate([w.ravel() for w in layers]))


def tiny_data(samples=400, seed=0):
    """Drives of a known system of second order with noise on what the network reads."""
    rng = np.random.default_rng(seed)

    def series(name):
        u = np.repeat(rng.uniform(-1, 1, samples // 20), 20)
        y = np.zeros(samples)
        for k in range(2, samples):
            y[k] = 1.6 * y[k - 1] - 0.7 * y[k - 2] + 0.1 * np.tanh(u[k - 1])
        noisy = u + 0.02 * rng.normal(size=samples)
        return training_data.Series(name, np.column_stack([noisy, u**2]), np.column_stack([y, -y + 0.1 * y**3]))

    parts = [
        tuple(series(f"{part}-{i}") for i in range(n)) for part, n in (("train", 6), ("validation", 2), ("test", 2))
    ]
    return training_data.Data(*parts, step=0.01)


def test_tuning_lowers_the_free_running_error_and_depends_on_the_seed_alone():
    data, plan = tiny_data(), training.Plan(neurons=(4,), epochs=30, iterations=40)
    first = training.Trainer(data, plan).candidate(np.random.default_rng(1))
    again = training.Trainer(data, plan, threads=2).candidate(np.random.default_rng(1))
    np.testing.assert_array_equal(first.parameters, again.parameters)
    assert first.tuned.free["validation"].sum() < first.open_loop.free["validation"].sum()
    assert first.tuned.free["test"].sum() < 0.05
    other = training.Trainer(data, plan).candidate(np.random.default_rng(2))
    assert not np.array_equal(first.parameters, other.parameters)


def test_a_signal_that_never_varies_cannot_be_scaled_and_is_named():
    data = tiny_data(samples=100)
    still = [dataclasses.replace(s, inputs=s.inputs * [1.0, 0.0] + [0.0, 15.0]) for s in data.train]
    with pytest.raises(UserError, match="'speed' is 15 throughout the training drives; add drives"):
        training.Trainer(dataclasses.replace(data, train=tuple(still)), training.Plan(neurons=(2,)))


# --- choice of delays and architecture


def test_lipschitz_index_finds_the_order_of_a_known_system():
    rng = np.random.default_rng(0)
    u, y = rng.uniform(-1, 1, (1500, 1)), np.zeros(1500)
    for k in range(2, 1500):
        y[k] = 0.5 * y[k - 1] - 0.4 * y[k - 2] + np.sin(u[k - 1, 0]) + 0.7 * u[k - 2, 0]
    found = lipschitz.indices(u, y, largest=4)
    assert found.delays[:4] == ((1, 0), (1, 1), (2, 1), (2, 2))
    before, at, after = found.values[:3], found.values[3], found.values[4:]
    assert before.min() > 5 * at
    assert after.min() > 0.8 * at


def test_lipschitz_index_of_a_line_is_its_slope_times_root_n():
    x = np.random.default_rng(0).normal(size=(100, 2))
    assert lipschitz.lipschitz_index(x[:, :1], 3 * x[:, 0]) == pytest.approx(3.0)
    assert lipschitz.lipschitz_index(x, x @ [3.0, 4.0]) == pytest.approx(5 * 2**0.5, rel=0.02)


def test_lipschitz_index_refuses_too_few_samples():
    with pytest.raises(UserError, match="too few"):
        lipschitz.indices(np.zeros((12, 1)), np.zeros(12), largest=4)


def test_architectures_are_powers_of_two_up_to_the_neurons_in_all():
    shapes = narx_architecture.architectures(32)
    assert len(shapes) == 21
    assert {(1, 32), (32, 1), (2, 16), (4, 8)} <= set(shapes)
    assert max(a * b for a, b in shapes) == 32


# --- files


def test_a_network_survives_saving(tmp_path):
    network = small_network(hidden=(3, 2), made={"seed": 4})
    path = net.save(network, tmp_path / "n.npz")
    found = net.load(path)
    np.testing.assert_array_equal(found.parameters, network.parameters)
    np.testing.assert_array_equal(found.input_range, network.input_range)
    for name in ("inputs", "outputs", "input_delays", "output_delays", "step", "sizes", "made"):
        assert getattr(found, name) == getattr(network, name)
    assert path.read_bytes() == net.save(network, tmp_path / "again.npz").read_bytes()


@pytest.mark.parametrize(
    ("spoil", "message"),
    [
        (lambda a: a.pop("layer_0"), "layer_0' is missing"),
        (lambda a: a.pop("input_range"), "input_range' is missing"),
        (lambda a: a.pop("description"), "description' is missing"),
        (lambda a: a.update(description=np.array("{")), "not JSON"),
        (lambda a: a.update(description=np.array(json.dumps({"inputs": ["speed"]}))), "lacks 'outputs'"),
        (lambda a: a.update(layer_1=np.zeros((2, 5))), "6 columns are needed"),
        (lambda a: a.update(layer_1=np.zeros((1, 6))), "gives 1 outputs, not 2"),
        (lambda a: a["layer_0"].__setitem__((0, 0), np.nan), "not finite"),
        (lambda a: a.update(output_range=np.zeros((1, 2))), "output_range"),
        (lambda a: a.update(layer_0=np.array([{"a": 1}], dtype=object)), "pickled objects are refused"),
    ],
)
def test_a_spoilt_file_is_refused_with_its_name(spoil, message, tmp_path):
    path = net.save(small_network(), tmp_path / "n.npz")
    with np.load(path) as file:
        arrays = {name: file[name].copy() for name in file.files}
    spoil(arrays)
    np.savez(path, **arrays)
    with pytest.raises(UserError, match=message) as error:
        net.load(path)
    assert str(path) in str(error.value)


def test_a_file_that_is_no_archive_is_refused(tmp_path):
    path = tmp_path / "n.npz"
    path.write_bytes(b"weights")
    with pytest.raises(UserError, match=r"not an \.npz file"):
        net.load(path)


def test_an_unknown_network_is_refused_with_the_closest():
    with pytest.raises(UserError, match="semitrailer_24t"):
        net.find("semitrailer_25t")


def test_too_few_samples_for_the_delays_are_refused():
    network = small_network()
    with pytest.raises(UserError, match="too few"):
        network.free_run(np.zeros((2, 2)))
    with pytest.raises(UserError, match="too few"):
        network.regressors(np.zeros((2, 2)), np.zeros((2, 2)))
    with pytest.raises(UserError, match="too short"):
        ClosedLoop([(np.zeros((20, 2)), np.zeros((20, 2)))], network.sizes, 2, 2, window=20)


def test_drives_of_no_part_are_refused(tmp_path):
    path = tmp_path / "drives.toml"
    path.write_text('[[drive]]\nname = "other"\nkind = "sine"\n', encoding="utf-8")
    with pytest.raises(UserError, match="must begin with train-"):
        training_data.make(training_data.semitrailer(), path)


def test_training_command_refuses_bad_arguments(tmp_path, capsys):
    assert narx_training.main(["--out", str(tmp_path / "n.txt")]) == 2
    assert "ends in .npz" in capsys.readouterr().err
    assert narx_training.main(["--out", str(tmp_path / "n.npz"), "--restarts", "0"]) == 2
    assert narx_architecture.main(["--out", str(tmp_path), "--restarts", "0"]) == 2


# --- the estimator


def test_place_and_workspace_agree():
    _, compiled = semitrailer_belief()
    assert narx.memory_size(narx.Settings(network="n"), compiled) == 1 + MEMORY
    wide = small_network(hidden=(WIDTH,))
    assert len(placed(wide, compiled, Path("n.npz"))) == 5 + 4 * 2 + 3 * 2 + 3 + len(wide.parameters)
    with pytest.raises(UserError, match="too many"):
        placed(small_network(hidden=(WIDTH + 1,)), compiled, Path("n.npz"))


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"inputs": ("yaw_rate_tractor", "speed")}, "neither measures nor knows"),
        ({"outputs": ("articulation_angle", "sideslip_angle")}, "no state"),
        ({"step": 0.02}, "every 0.02 s, the study has 0.01 s"),
    ],
)
def test_a_network_of_other_signals_or_step_is_refused(changes, message, tmp_path):
    path = net.save(small_network(**changes), tmp_path / "n.npz")
    _, compiled = semitrailer_belief()
    with pytest.raises(UserError, match=message):
        CompiledEstimator("narx", compiled, {"network": path.name}, tmp_path)


@pytest.mark.parametrize("hidden", [(5,), (4, 3)])
def test_estimator_equals_the_plain_network(hidden, tmp_path):
    network, rng = small_network(3, hidden), np.random.default_rng(9)
    net.save(network, tmp_path / "n.npz")
    spec, compiled = semitrailer_belief()
    estimator = CompiledEstimator("narx", compiled, {"network": "n.npz"}, tmp_path)
    samples = 300
    y, u = 0.2 * rng.normal(size=(samples, 1, LANES)), np.zeros((samples, compiled.nu, LANES))
    at = list(compiled.model.inputs).index("speed")
    u[:, at] = 8 + np.cumsum(0.1 * rng.normal(size=(samples, LANES)), axis=0)
    y[100:120] = np.nan
    truth = np.zeros((samples, len(SIGNALS), LANES))
    scores = scores_of(estimator, spec, u, y, Scoring(truth, SIGNALS, np.full(LANES, 1e9), keep=True))
    y[100:120] = y[99]  # the last measurement is held
    for lane in (0, 3):
        inputs = np.column_stack([y[1:, 0, lane], u[1:, at, lane]])  # sample 0 is no measurement of a filter
        expected = network.free_run(inputs)
        np.testing.assert_allclose(scores.kept[1:, 0, :2, lane], expected, rtol=1e-9, atol=1e-12)
        assert np.all(scores.kept[1:4, 0, :2, lane][:2] == 0)
        np.testing.assert_allclose(scores.rmse[:2, lane], np.sqrt(np.mean(expected**2, axis=0)), rtol=1e-9)
    assert np.isnan(scores.rmse[2]).all()  # a target that the network does not give
    assert np.isnan(scores.kept[:, :, 2]).all()
    assert np.isnan([scores.nees, scores.nis, scores.log_likelihood]).all()
    np.testing.assert_array_equal(scores.diverged_at, samples)
    np.testing.assert_array_equal(scores.updates, samples - 1 - 20)


def test_a_network_that_runs_away_diverges_with_its_time(tmp_path):
    network = small_network()
    layers = (network.layers[0], 500 * np.abs(network.layers[1]) + 5)
    net.save(small_network(layers=layers), tmp_path / "n.npz")
    spec, compiled = semitrailer_belief()
    estimator = CompiledEstimator("narx", compiled, {"network": "n.npz"}, tmp_path)
    u, y = np.full((50, compiled.nu, LANES), 5.0), np.zeros((50, 1, LANES))
    scores = scores_of(estimator, spec, u, y, Scoring(np.zeros((50, 3, LANES)), SIGNALS, np.full(LANES, 50.0)))
    np.testing.assert_array_equal(scores.diverged_at, 3.0)  # the first sample with full delays


def test_the_committed_network_says_how_it_was_made_and_estimates_a_drive_it_has_not_seen():
    network = net.load(net.find("semitrailer_24t"))
    assert network.made["command"].startswith("python -m harness.")
    before, after = network.made["nrmse_open_loop"]["free"], network.made["nrmse"]["free"]
    assert sum(after["validation"]) < 0.1 * sum(before["validation"])
    drives = load_drives("robustness-broad", ROOT / "studies")
    drive = next(d for d in drives if d.name == "winding-road")
    spec = training_data.semitrailer()
    profile = profile_of(spec, drive)
    series = training_data.simulate(spec, {drive.name: profile}, 77, network.inputs, network.outputs)[0]
    error = network.free_run(series.inputs) - series.outputs
    rmse, of_zero = (np.sqrt(np.mean(e**2, axis=0)) for e in (error, series.outputs))
    assert np.all(rmse < np.array([0.2, 0.25]) * of_zero)
    assert rmse[0] < np.radians(0.6)
    assert rmse[1] < 400.0
