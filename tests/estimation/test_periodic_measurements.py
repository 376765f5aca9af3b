"""Measured headings: innovations and errors are differences modulo a turn, whatever the estimator."""

import numpy as np
import pytest

from harness.engine.compile import compile_model
from harness.engine.simd.lanes import LANES
from harness.estimation.compiled_estimator import CompiledEstimator
from harness.models.assembly.assemble import assemble
from harness.models.quantities import difference
from harness.models.signals import turn_of
from harness.runner.contract import Held, History, InputSeries
from harness.runner.history import EverySample
from harness.runner.scores import Scoring
from harness.simulation.simulate import in_lanes
from support.stepping import Stepper

KINDS = (
    "kf", "ekf", "ukf", "cdkf", "st_cdkf", "sr_ekf", "sr_ukf", "enkf", "particle", "h_infinity", "huber_ekf",
    "student_t_ekf", "adaptive_ekf", "innovation_ekf", "moving_horizon",
)  # fmt: skip

HEADING = assemble("vehicle_heading", sensors="gyro_heading")


def circle(samples=300):
    """Return increments, measured headings with a gap of more than half a turn, and true ones: three turns."""
    rng = np.random.default_rng(7)
    true = 1.0 + np.linspace(0.0, 6 * np.pi, samples)
    y = true + 0.01 * rng.standard_normal(samples)
    y[100:180] = np.nan
    return np.diff(true, append=true[-1:])[:, None], y[:, None], true[:, None]


def wrapped(angle):
    """Return angles from -pi to pi, as a compass states them."""
    return np.angle(np.exp(1j * angle))


@pytest.mark.parametrize("kind", KINDS)
def test_a_compass_is_followed_through_its_turns(kind):
    u, y, _ = circle()
    stepper = Stepper(kind, HEADING, [1e-6], [1e-4])
    of_turns, *_, infos = stepper.run([1.0], [1e-2], u, y)
    of_compass, *_, infos_of_compass = stepper.run([1.0], [1e-2], u, wrapped(y))
    np.testing.assert_allclose(of_compass, of_turns, atol=1e-9)
    nis, nis_of_compass = (np.array([each.nis[0, 0] for each in its]) for its in (infos, infos_of_compass))
    np.testing.assert_allclose(nis_of_compass, nis, atol=1e-6)
    assert abs(of_compass[-1, 0] - 1.0 - 6 * np.pi) < 0.1


def test_scores_of_a_heading_are_taken_modulo_a_turn():
    u, y, true = circle()
    compiled = compile_model(HEADING, 0.1, signals=("heading",))
    estimator = CompiledEstimator("ekf", compiled)
    held = Held(np.zeros((1, LANES)), *(np.full((1, LANES), v) for v in (1e-6, 1e-4, 1.0, 1e-2)))
    inputs, y = InputSeries(in_lanes(u)), in_lanes(y)

    def both(truth):
        record = Scoring(in_lanes(truth), ("heading",), np.full(LANES, 1.0 * len(truth)))
        history = estimator.run(inputs, y, held, EverySample(of_signals=True))
        alike = History(*(np.repeat(part[..., None], LANES, axis=-1) for part in vars(history).values()))
        return estimator.run(inputs, y, held, record).scores(), record.of(alike, estimator).scores()

    plain, summed = both(true)
    assert plain.max_error[0, 0] < 0.1
    for scores in (summed, *both(wrapped(true))):
        for name in ("rmse", "bias", "max_error", "nees"):
            np.testing.assert_allclose(getattr(scores, name), getattr(plain, name), atol=1e-9, err_msg=name)


def test_differences_of_a_heading():
    assert turn_of("heading") == 2 * np.pi
    assert turn_of("articulation_angle") == 0.0
    np.testing.assert_allclose(difference("heading", [6.0, 0.1, 12.0], [0.0, 6.2, 0.0]), [6.0 - 2 * np.pi,
                               0.1 - 6.2 + 2 * np.pi, 12.0 - 4 * np.pi])  # fmt: skip
    assert difference("articulation_angle", 6.0, 0.0) == 6.0
