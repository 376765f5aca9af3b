"""Lex 2015, page 95: what one page says of the particle filter for the friction of the road."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from harness.common.arrays import Floats
from harness.common.statistics import Interval, median_interval
from harness.engine.compile import compile_model
from harness.engine.simd.lanes import LANES
from harness.estimation.compiled_estimator import CompiledEstimator
from harness.models.assembly.assemble import assemble
from harness.models.parameters import kit_2015a
from harness.simulation.simulate import in_lanes
from reproductions.campaign.evidence import Evidence, ratio_of_medians
from reproductions.published.kit import Q, R, filtered
from reproductions.published.record import Record, foreign, image, statement
from reproductions.published.results import Stored

TITLE = "Lex 2015: maximum tyre-road friction, page 95"
NOTE = "One page of the book is at hand; it states no number. Its statements are tested on our filter and our study."

STUDY = "friction-particle"
SMALL, LARGE = "friction 0.9, friction change -0.3", "friction 0.9, friction change -0.6"
DRIVE = "lively"
SIZES = (100, 10_000)


def distances(particles: int, scheme: str = "multinomial", samples: int = 60) -> Interval:
    """Return how far the mean of a cloud is from the exact posterior mean, in its standard deviations.

    On the scalar example, where the Kalman filter is exact; redrawn at every step. The interval is over the runs that
    differ by their random numbers alone.
    """
    model = assemble("scalar_example", sensors="example")
    rng = np.random.default_rng(2)
    u, y = rng.normal(size=samples), rng.normal(size=samples)
    means, _, variances = filtered(model, (Q, R), (0.0, 10.0), u, y, kit_2015a.VALUES["transition"])
    compiled = compile_model(model, kit_2015a.NOISE_STEP)
    cloud = CompiledEstimator("particle", compiled, {"particles": particles, "resampling": scheme, "threshold": 1.0})
    constants = compiled.constants(in_lanes(np.array([kit_2015a.VALUES["transition"]])))
    belief = cloud.belief(constants, in_lanes(np.array([Q])), in_lanes(np.array([R])))
    seeds = [np.random.SeedSequence(3, spawn_key=(lane,)) for lane in range(LANES)]
    state, errors = cloud.init(np.zeros(1), np.array([10.0]), seeds), np.empty((samples - 1, LANES))
    for k in range(1, samples):
        at = in_lanes(np.array([u[k - 1]])), in_lanes(np.array([u[k]]))
        state, _ = cloud.step(state, *at, in_lanes(np.array([y[k]])), belief)
        errors[k - 1] = (state.mean[0] - means[k - 1]) / np.sqrt(variances[k - 1])
    return median_interval(np.sqrt(np.mean(errors**2, axis=0)))


def _approaches_the_posterior(_: Stored) -> list[Evidence]:
    few, many = (distances(size) for size in SIZES)
    ratio = Interval(few.value / many.value, few.lower / many.upper, few.upper / many.lower)
    expected = (SIZES[1] / SIZES[0]) ** 0.5
    what = f"distance from the exact mean, {SIZES[0]} particles over {SIZES[1]}"
    return [Evidence(what, ratio, (expected / 1.5, 1.5 * expected), expected, LANES)]


def _other_schemes(_: Stored) -> list[Evidence]:
    """Compare the distance from the exact mean: the cheaper scheme must not be worse."""
    ours, theirs = (distances(500, scheme, 2000) for scheme in ("systematic", "multinomial"))
    ratio = Interval(ours.value / theirs.value, ours.lower / theirs.upper, ours.upper / theirs.lower)
    return [Evidence("distance from the exact mean, systematic over multinomial", ratio, (0.0, 1.1), np.nan, LANES)]


def _after(stored: Stored, band: str, estimator: str) -> Floats:
    """Return the RMSE of the friction after a jump, ``(1, sample, repeat)``."""
    design = stored.stores[STUDY].designs[1]
    target = [t.name for t in design.targets].index("friction_coefficient")
    drive = design.drives.index(DRIVE)
    return design.rmse[target, design.bands.index(band), design.estimators.index(estimator), drive : drive + 1]


def _detects(estimator: str) -> Callable[[Stored], list[Evidence]]:
    """Compare with a filter that never notices the jump of 0.6 after half of the drive: half of that error at most."""

    def test(stored: Stored) -> list[Evidence]:
        errors, unnoticed = _after(stored, LARGE, estimator), 0.6 * 0.5**0.5
        value = median_interval(errors / unnoticed)
        return [Evidence("error over that of a filter that stays at 0.9", value, (0.0, 0.5), np.nan, errors.size)]

    return test


def _slower_from_afar(stored: Stored) -> list[Evidence]:
    errors = [_after(stored, band, "PF") for band in (LARGE, SMALL)]
    value, n = ratio_of_medians(errors[0] / 0.6, errors[1] / 0.3)
    return [Evidence("error over the jump, of 0.6 over of 0.3", value, (1.0, np.inf), np.nan, n)]


def records() -> tuple[Record, ...]:
    """Return what the document publishes."""
    return (
        statement(
            "5",
            "redrawn by their likelihood, N → ∞ particles are distributed as the posterior",
            _approaches_the_posterior,
        ),
        foreign(
            "(5.9)",
            "the estimate is the mean of the particles after they are redrawn",
            reason="ours is the weighted mean before, which has the same expectation and scatters less",
        ),
        statement("5", "other ways to redraw may be more efficient than the cumulated search", _other_schemes),
        statement(
            "5",
            "a few particles in unlikely regions let the filter detect a change of the state (plain filter)",
            _detects("PF"),
            STUDY,
            "The friction's random walk is slow (0.04 in a second) and the cloud has become certain of 0.9: none of "
            "its particles is near 0.3.",
        ),
        statement(
            "5",
            "the same with roughening, which keeps the cloud wide",
            _detects("PF rough"),
            STUDY,
            "Roughening widens the cloud, but not by the 0.6 of the jump.",
        ),
        statement(
            "5",
            "convergence is slower the farther the measurement's distribution is from the prior",
            _slower_from_afar,
            STUDY,
            "Few repeats.",
        ),
        image("figure 5.1", "how the particles move in one step"),
    )
