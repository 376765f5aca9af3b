"""Parameters as states: against filters written out by hand, and where nothing can be learnt of them."""

import numpy as np
import pytest
import sympy as sp

from harness.common.errors import ModelError, UserError
from harness.engine.simd.lanes import LANES
from harness.estimation.compiled_estimator import CompiledEstimator
from harness.models.assembly.assemble import assemble
from harness.models.assembly.parameter_states import ParameterState, with_parameters
from harness.models.contracts import Parameter
from harness.models.signals import SIGNALS, Signal
from harness.simulation.simulate import in_lanes
from harness.testing.small_models import RATE, module
from support.oscillator import P0, PUSH, SAMPLES, STEP, VALUES, Q, R, compiled, drive, mass, push, run, vehicle


def textbook(u, y, prior, walk, considered):
    """Kalman filter for ``[x, d]`` with full matrices; Schmidt's if ``d`` is considered (Jazwinski 1970, ch. 8)."""
    F = np.eye(3) + STEP * np.array([[0, 1, 0], [-4, -1.5, 1], [0, 0, 0]])
    B = STEP * np.array([0, 1, 0])
    H = np.array([[1.0, 0, 0]])
    x, P = np.array([0, 0, 0.3]), np.diag([*P0, prior**2])
    noise = np.diag([*Q, walk**2 * STEP])
    means, covariances = [x], [P]
    for k in range(1, len(y)):
        x, P = F @ x + B * u[k - 1, 0], F @ P @ F.T + noise
        S = H @ P @ H.T + R
        K = P @ H.T / S
        if considered:
            K[2] = 0.0
        x = x + K[:, 0] * (y[k, 0] - x[0])
        P = (np.eye(3) - K @ H) @ P @ (np.eye(3) - K @ H).T + K @ K.T * R
        means.append(x)
        covariances.append(P)
    return np.array(means), np.array(covariances)


@pytest.mark.parametrize("kind", ["ekf", "ukf"])
@pytest.mark.parametrize(("walk", "considered"), [(0.0, False), (0.05, False), (0.0, True)])
def test_a_linear_parameter_gives_the_filter_written_by_hand(kind, walk, considered):
    u, y = drive({**VALUES, "push": 1.6})
    state = push(walk=walk, considered=considered)
    means, covariances = run(kind, compiled(state), u, y, [state.walk_variance * STEP])
    means[:, 2] += 0.3  # the state is what the push is off
    right, P = textbook(u, y, 2.0, walk, considered)
    np.testing.assert_allclose(means, right, rtol=0, atol=1e-9)
    np.testing.assert_allclose(covariances, P, rtol=0, atol=1e-9)


@pytest.mark.parametrize("kind", ["ekf", "ukf"])
def test_a_parameter_is_found_where_it_is_excited(kind):
    u, y = drive({**VALUES, "mass": 1.5}, samples=2000, excitation=4.0)
    means, covariances = run(kind, compiled(mass()), u, y, [0.0])
    found, deviation = np.exp(means[-1, 2]), covariances[-1, 2, 2] ** 0.5
    assert abs(np.log(found / 1.5)) < 3 * deviation < 0.3
    assert deviation < 0.2 * 0.4


def test_a_walking_parameter_is_followed():
    """The truth walks as the filter believes: its error stays within what is stated."""
    rng = np.random.default_rng(2)
    samples, walk = 4000, 0.04
    state = mass(walk=walk, prior=0.8)
    z = np.cumsum(rng.normal(size=samples)) * walk * STEP**0.5
    u = 20.0 * np.sin(0.7 * STEP * np.arange(samples))[:, None]
    x, y = np.zeros(2), np.empty((samples, 1))
    for k in range(samples):
        y[k] = x[0] + rng.normal() * R[0] ** 0.5
        force = -4 * x[0] - 1.5 * x[1] + 0.3 + u[k, 0]
        x = x + STEP * np.array([x[1], force / np.exp(z[k])]) + rng.normal(size=2) * np.sqrt(Q)
    means, covariances = run("ekf", compiled(state), u, y, [state.walk_variance * STEP])
    share = (means[:, 2] - z)[500:] ** 2 / covariances[500:, 2, 2]
    assert 0.4 < share.mean() < 2.5
    assert np.std(means[500:, 2] - z[500:]) < 0.6 * np.std(z[500:])


@pytest.mark.parametrize("walk", [0.0, 0.2])
def test_nothing_drifts_where_nothing_is_learnt(walk):
    """At rest what the filter holds for motion is noise, and so is the influence of the mass that it feigns."""
    u, y = drive({**VALUES, "push": 0.0, "mass": 3.0}, samples=3000, excitation=0.0, q=np.zeros(2))
    state = mass(walk=walk)
    means, covariances = run("ekf", compiled(state), u, y, [state.walk_variance * STEP], constants={"push": 0.0})
    assert np.abs(means[:, 2]).max() < 0.4
    assert covariances[-1, 2, 2] <= 0.4**2 * (1 + 1e-9)
    assert covariances[-1, 2, 2] > 0.2 * 0.4**2


@pytest.mark.parametrize("kind", ["ekf", "ukf", "particle"])
def test_bounds_are_kept_and_left_again(kind):
    """A push that no bounds allow holds the estimate at the bound; a possible one afterwards is found again."""
    settings = {"particles": 500, "roughening": 0.2} if kind == "particle" else None
    far = drive({**VALUES, "push": 80.0})
    near = drive({**VALUES, "push": 1.0}, seed=6, samples=1500)
    u, y = (np.concatenate(pair) for pair in zip(far, near, strict=True))
    state = push(prior=20.0, walk=5.0)
    means, _ = run(kind, compiled(state), u, y, [state.walk_variance * STEP], settings)
    assert means[:, 2].max() <= 50.0 - 0.3 + 1e-9
    assert means[:SAMPLES, 2].max() > 45.0
    assert abs(means[-200:, 2].mean() + 0.3 - 1.0) < 4.0


def test_the_jacobians_are_exact():
    model = compiled(push(), mass(walk=0.1))
    rng = np.random.default_rng(0)
    x, u = in_lanes(rng.normal(size=4) * 0.3), in_lanes(rng.normal(size=1))
    c = model.constants(in_lanes(model.parameter_vector(VALUES)))
    xn, A, w = np.empty((4, LANES)), np.empty((4, 4, LANES)), np.empty((model.nw, LANES))
    model.kernels.next_jacobian(x, u, c, xn, A, w)
    for j in range(4):
        ahead, behind = (np.empty((4, LANES)) for _ in range(2))
        for sign, result in ((1, ahead), (-1, behind)):
            moved = x.copy()
            moved[j] += sign * 1e-6
            model.kernels.next_state(moved, u, c, result, w)
        np.testing.assert_allclose(A[:, j, 0], (ahead - behind)[:, 0] / 2e-6, atol=1e-7)


def test_the_belief_of_a_lane_is_where_its_parameter_begins():
    """Designs vary what is believed: the state is relative to it, and so are the bounds."""
    model = compiled(mass())
    c = model.constants(
        np.array([VALUES[n] for n in model.model.parameter_names])[:, None] * np.linspace(0.6, 2, LANES)
    )
    s = np.empty((1, LANES))
    model.kernels.signals(np.zeros((3, LANES)), np.zeros((1, LANES)), c, s)
    np.testing.assert_allclose(s[0], np.linspace(0.6, 2, LANES), rtol=1e-12)
    bounded = np.empty((1, LANES))
    model.kernels.within_bounds(np.full((3, LANES), 9.0), np.zeros((1, LANES)), c, bounded)
    np.testing.assert_allclose(np.exp(bounded[0]) * s[0], 40.0, rtol=1e-5)


def test_kernels_are_the_same_where_no_parameter_is_a_state():
    """The loops then call a function that does nothing, and a model's kernels have nothing of it."""
    from harness.engine.codegen.derivatives import derive
    from harness.engine.compile import model_source
    from harness.estimation.contract import kernels_of, load_estimator
    from harness.testing.small_models import linear

    source = model_source(derive(linear()), STEP, "euler", 1)
    assert "within_bounds" not in source
    assert "PARAMETERS" not in source
    ekf = load_estimator("ekf")
    assert len(kernels_of(ekf, linear())) == len(kernels_of(ekf)) == len(kernels_of(ekf, compiled(push()).model)) - 1


def test_estimators_without_a_gain_consider_nothing():
    with pytest.raises(UserError, match="cannot consider"):
        CompiledEstimator("particle", compiled(push(considered=True)))


def test_a_parameter_that_is_a_signal_already_is_refused():
    made = vehicle()
    made.PARAMETERS = (RATE, PUSH, Parameter("speed", "v", "m/s", 0.0, 9.0, "another speed"))
    made.equations = lambda v: (v.derivative("alpha_test", v.p("speed")), v.derivative("beta_test", sp.Integer(0)))
    model = assemble(made, sensors=module("sensors_test", OUTPUTS={"alpha_test": "alpha_test"}))
    with pytest.raises(ModelError, match="is a signal already"):
        with_parameters(model, [ParameterState("speed", 1.0, 0.1)], made)


def test_parameters_of_one_name_may_mean_different_things_in_two_vehicles():
    for meaning in ("of the car", "of the truck"):
        SIGNALS.add(Signal("mass_test", "m", "kg", "t", "", meaning))
        assert SIGNALS["mass_test"].meaning == meaning
    with pytest.raises(ModelError, match="'yaw_rate' is a signal already: yaw rate"):
        SIGNALS.add(Signal("yaw_rate", "r", "rad/s", "deg/s", "", "something else"))
