"""KIT 2015, exercise on the Kalman filter: every number by the lecture's recursion, exact, and our filter's.

The exercise asks for the gains and prints no solution; theirs are the fractions that its equations give.
"""

from __future__ import annotations

from fractions import Fraction
from functools import cache

import numpy as np

from harness.common.arrays import Floats
from harness.engine.compile import compile_model
from harness.estimation.compiled_estimator import CompiledEstimator
from harness.models.assembly.assemble import StateSpaceModel, assemble
from harness.models.parameters import kit_2015a
from harness.models.vehicles import scalar_example
from harness.recordings.noise_at_rest import Running
from harness.simulation.simulate import in_lanes
from reproductions.campaign.evidence import Evidence
from reproductions.published.record import Record, image, point, setting, statement
from reproductions.published.results import Stored

TITLE = "KIT 2015: exercise on the Kalman filter"
NOTE = "The exercise asks for its numbers and prints no solution; theirs are what its equations give, as fractions."
SAMPLES = 40

Q, R = kit_2015a.PROCESS_NOISE["example_state"], kit_2015a.MEASUREMENT_NOISE["example_state"]
START = scalar_example.START_VARIANCE["example_state"]


def filtered(
    model: StateSpaceModel,
    noise: tuple[float, float],
    start: tuple[float, float],
    u: Floats,
    y: Floats,
    transition: float | None,
) -> tuple[Floats, Floats, Floats]:
    """Run our Kalman filter over measurements of a scalar model.

    Args:
        model: With one state, one input and one output.
        noise: Variances of process and measurement.
        start: Mean and variance at the first sample.
        u: Input ``(samples,)``.
        y: Measurement ``(samples,)``, the first of which is not used.
        transition: The model's parameter, if it has one.

    Returns:
        Means, gains and variances from the second sample on, each ``(samples - 1,)``. A gain is what a unit of
        innovation moves the mean by.
    """
    compiled = compile_model(model, kit_2015a.NOISE_STEP)
    estimator = CompiledEstimator("kf", compiled)
    constants = compiled.constants(in_lanes(np.array([] if transition is None else [transition])))
    belief = estimator.belief(constants, in_lanes(np.array([noise[0]])), in_lanes(np.array([noise[1]])))
    state = estimator.init(np.array([start[0]]), np.array([start[1]]))
    rows = []
    for k in range(1, len(y)):
        before = state.mean[0, 0]
        at = in_lanes(np.array([u[k - 1]])), in_lanes(np.array([u[k]]))
        state, info = estimator.step(state, *at, in_lanes(np.array([y[k]])), belief)
        predicted = before * (1.0 if transition is None else transition) + u[k - 1]
        rows.append(
            [state.mean[0, 0], (state.mean[0, 0] - predicted) / info.innovation[0, 0], state.covariance[0, 0, 0]]
        )
    means, gains, variances = np.array(rows).T
    return means, gains, variances


@cache
def example(q: float = Q, r: float = R) -> tuple[Floats, Floats]:
    """Return gains and variances of the filter of exercise 1 over random measurements."""
    rng = np.random.default_rng(1)
    u, y = rng.normal(size=SAMPLES), 3.0 + rng.normal(size=SAMPLES)
    model = assemble("scalar_example", sensors="example")
    _, gains, variances = filtered(model, (q, r), (0.0, START), u, y, kit_2015a.VALUES["transition"])
    return gains, variances


def by_the_lecture(samples: int) -> list[Fraction]:
    """Return the gains of exercise 1c by the lecture's recursion."""
    variance, gains = Fraction(10), []
    for _ in range(samples):
        ahead = variance / 4 + 1
        gain = ahead / (ahead + 1)
        variance = (1 - gain) ** 2 * ahead + gain**2
        gains.append(gain)
    return gains


def _gain(sample: int, exact: Fraction) -> Record:
    def test(_: Stored) -> list[Evidence]:
        value = float(exact)
        return [point("", example()[0][sample - 1], (value - 1e-12, value + 1e-12), value)]

    quantity = f"gain K({sample}), from the variance 10"
    return Record("exercise 1c", quantity, f"{exact.numerator}/{exact.denominator} = {float(exact):.4f}", test=test)


def _in_the_end(_: Stored) -> list[Evidence]:
    root = float(max(np.roots([0.25, 1.75, -1.0]).real))  # P = f(P)
    return [point("gain", example()[0][-1], (root - 1e-12, root + 1e-12), root)]


def _least(_: Stored) -> list[Evidence]:
    """Compare the variance with that of any other gain, over the variance of the lecture's."""
    variance, quotients = START, []
    for gain, own in zip(*example(), strict=True):
        ahead = kit_2015a.VALUES["transition"] ** 2 * variance + Q
        others = gain + np.array([-0.1, -0.01, 0.01, 0.1])
        quotients.append(np.min((1 - others) ** 2 * ahead + others**2 * R) / own)
        variance = own
    return [point("variance with another gain over that of the filter, least", min(quotients), (1.0, np.inf))]


def _weights(_: Stored) -> list[Evidence]:
    noisy, lively = example(r=1e12)[0], example(q=1e12)[0]
    return [
        point("gain with a measurement 10⁶ times as noisy", float(np.abs(noisy).max()), (0.0, 1e-6)),
        point("gain with a process 10⁶ times as noisy", float(lively.min()), (1 - 1e-6, 1 + 1e-12)),
    ]


def _heading(q: float, r: float) -> tuple[Floats, Floats, Floats]:
    """Return our estimate of exercise 2, the gyro's heading and the sum of the encoders' increments."""
    rng = np.random.default_rng(4)
    true = np.cumsum(0.01 * np.sin(0.05 * np.arange(200)))
    u = np.diff(true, append=true[-1:]) + rng.normal(size=200) * 1e-3
    y = true + rng.normal(size=200) * 1e-2
    model = assemble("vehicle_heading", sensors="gyro_heading")
    means, _, _ = filtered(model, (q, r), (0.0, 1e-6), u, y, None)
    return means, y[1:], np.cumsum(u[:-1])


def _follows_the_gyro(_: Stored) -> list[Evidence]:
    means, gyro, _encoders = _heading(1e8, 1e-4)
    return [point("largest distance from the gyro's heading in rad", np.abs(means - gyro).max(), (0.0, 1e-8))]


def _follows_the_encoders(_: Stored) -> list[Evidence]:
    means, _gyro, encoders = _heading(1e-6, 1e12)
    return [
        point("largest distance from the sum of the increments in rad", np.abs(means - encoders).max(), (0.0, 1e-8))
    ]


def _noise(_: Stored) -> list[Evidence]:
    samples, running = np.random.default_rng(5).normal(3.0, 2.0, 1000), Running.start(1)
    for sample in samples:
        running = running.add([sample])
    ratio = float(running.noise().variances[0]) / float(np.var(samples, ddof=1))
    return [point("our R over the formula's, 1000 samples", ratio, (1 - 1e-12, 1 + 1e-12), 1.0)]


def records() -> tuple[Record, ...]:
    """Return what the document publishes."""
    return (
        statement("2", "the gain chosen gives the least mean squared error", _least),
        statement("2", "noisy measurements give a gain near 0, a noisy process trust in the measurement", _weights),
        statement("3", "R from N samples at rest with the denominator N − 1", _noise),
        setting(
            "exercise 1", "share of the state that is left one sample later", "0.5", kit_2015a.VALUES["transition"]
        ),
        setting("exercise 1", "variance of the process noise Q", "1", Q),
        setting("exercise 1", "variance of the measurement noise R", "1", R),
        setting("exercise 1c", "first variance P(0)", "10", START),
        *(_gain(sample, exact) for sample, exact in enumerate(by_the_lecture(4), start=1)),
        Record(
            "exercise 1d", "gain in the end, root of 0.25 P² + 1.75 P − 1 = 0", "(√65 − 7)/2 = 0.5311", test=_in_the_end
        ),
        image("exercise 1b", "block diagram of system and filter"),
        statement(
            "exercise 2c", "with encoders much noisier than the gyro the estimate is the gyro's", _follows_the_gyro
        ),
        statement(
            "exercise 2d", "with a gyro much noisier the estimate is the sum of the increments", _follows_the_encoders
        ),
        image("exercise 2b", "block diagram of heading sensors and filter"),
    )
