"""The bias of a gyroscope that wanders: a hypothesis of the search, with a probability like any other."""

import dataclasses

import numpy as np
import pytest
from scipy.stats import norm

from harness.diagnosis.fitting import Fitting, ParameterPoint
from harness.diagnosis.model.hypotheses import coordinates, hypotheses
from harness.diagnosis.result.estimator_gain import fitted_model
from harness.diagnosis.selection.acceptance import objections
from harness.diagnosis.selection.forward_selection import first_variances, trace
from harness.diagnosis.selection.posterior import kind_of, log_odds
from harness.diagnosis.selection.validation import HeldOut
from harness.identification.candidates import Candidates
from harness.identification.innovations import Innovations
from support.driven_car import FREE, driven

NAME, PARAMETER, SIZE = "sensor_drift@yaw_rate", "sensor_drift_yaw_rate", 0.004


@pytest.fixture(scope="module")
def drift(augmented):
    return next(h for h in hypotheses(augmented, FREE) if h.name == NAME)


@pytest.fixture(scope="module")
def found(augmented):
    recordings = [driven(seed, [NAME], **{PARAMETER: SIZE}) for seed in (84, 85, 86)]
    drives = [augmented.drive(r, f"drive {i}") for i, r in enumerate(recordings)]
    return trace(augmented, drives[:2], drives[2:], FREE)


def with_drift(augmented, point: ParameterPoint, size: float) -> ParameterPoint:
    values = point.values.copy()
    values[augmented.row(PARAMETER)] = size
    return dataclasses.replace(point, values=values)


def test_only_gyroscopes_drift_in_the_search(augmented, drift):
    assert [h for h in hypotheses(augmented, FREE) if h.random and h.of_recording] == [drift]
    assert list(augmented.model.outputs)[drift.output] == "yaw_rate"
    assert kind_of(drift) == "sensor"
    assert np.isfinite(log_odds(hypotheses(augmented, FREE))["effect", NAME])


def test_its_filter_is_that_of_a_model_with_the_effect(augmented, drift):
    """The bias stands in the state of the filter: it costs a drive without drift what it costs the model with it."""
    recording = driven(87, duration=25.0)
    drives = [augmented.drive(recording, "drive")]
    fitting = Fitting(augmented, drives, first_variances(augmented, drives))
    without, point = (with_drift(augmented, fitting.first(), size) for size in (0.0, 0.02))
    own = Innovations(fitted_model(_Fitted(fitting), dataclasses.replace(augmented.spec, effects=(NAME,)), point))
    recorded = own.drive(recording, "drive", "joined")
    known = [i for i, state in enumerate(augmented.model.states[: augmented.nx]) if state in own.model.states]
    effects = drives[0].effects[:, [*known, *range(augmented.nx, drives[0].effects.shape[1])]]
    recorded = dataclasses.replace(recorded, first_variance=drives[0].first_variance[known], effects=effects)
    absent = dataclasses.replace(own.spec, values={**own.spec.values, PARAMETER: 0.0})
    values = [own.log_likelihoods([recorded], Candidates.of(spec))[0] for spec in (own.spec, absent)]
    cost = fitting.log_likelihood(without) - fitting.log_likelihood(point)
    assert cost > 1.0
    assert cost == pytest.approx(values[1] - values[0], rel=0.02)


class _Fitted:
    """What ``fitted_model`` asks of a trace."""

    def __init__(self, fitting):
        self.fitting = fitting


def test_a_gyroscope_that_drifts_is_named_with_its_size_and_nothing_else(found):
    assert [h.name for h in found.added] == [NAME]
    row = found.fitting.augmented.row(PARAMETER)
    size, (error,) = found.final.point.values[row, 0], found.fitting.standard_errors(found.final)[-1:]
    assert 0 < error < SIZE
    assert abs(size - SIZE) < 3 * error
    added = next(r.added for r in found.rounds if r.added)
    assert objections(added, found.rounds[0].before) == []
    assert found.after.log_likelihood > found.before.log_likelihood + 20


def test_it_has_a_probability_at_every_horizon(found):
    """A bias is no motion: predicted without measurements, its one error would count at each of 6,000 samples."""
    likeliest, second = found.posterior.models[:2]
    assert [h.name for a in likeliest.added for h in a.hypotheses] == [NAME]
    assert likeliest.share > 0.95
    assert (likeliest.densities > second.densities + 20).all()
    assert found.posterior.coverage == pytest.approx(0.95, abs=0.01)


def test_the_floor_of_the_simulation_error_holds_what_a_drift_adds(augmented, drift, found):
    held_out: HeldOut = found.held_out
    quiet, loud = (held_out.floors(with_drift(augmented, found.final.point, s)) for s in (0.0, 0.01))
    time = held_out.drives[0].time - held_out.drives[0].time[0]
    np.testing.assert_allclose((loud - quiet)[1:, drift.output], 1e-4 * (1 + time[1:] / 100.0))
    others = [a for a in range(quiet.shape[1]) if a != drift.output]
    np.testing.assert_allclose(loud[:, others], quiet[:, others], rtol=1e-9)


def test_a_judgement_says_which_share_of_its_floor_a_drift_has(augmented, drift, found):
    held_out: HeldOut = found.held_out
    points = [with_drift(augmented, found.final.point, s) for s in (0.0, 0.01)]
    quiet, loud = (held_out.judge((drift,), point) for point in points)
    floors, with_it = (held_out.floors(point)[:, drift.output] for point in points)
    assert not np.any(quiet.wander)
    assert loud.wander[drift.output] == pytest.approx(np.mean(1.0 - floors / with_it))


def test_an_intensity_is_sought_by_its_logarithm_and_without_slopes(augmented, drift):
    *moved, last = coordinates(augmented, FREE, (drift,), 2)
    assert (last.name, last.kind, last.logarithmic) == (PARAMETER, "intensity", True)
    assert all(c.kind == "parameter" for c in moved)


def test_the_density_of_the_free_run_is_that_of_normal_errors_within_the_floor(found):
    held_out: HeldOut = found.held_out
    judged = held_out.judge(found.added, found.final.point)
    errors = np.concatenate(
        [d.measurements - own.simulated for d, own in zip(held_out.drives, judged.drives, strict=True)]
    )
    scale = np.sqrt(held_out.floors(found.final.point))
    expected = np.nanmean(norm.logpdf(errors, scale=scale), axis=0).sum() + 0.5 * errors.shape[1] * np.log(2 * np.pi)
    assert judged.log_density == pytest.approx(expected)
