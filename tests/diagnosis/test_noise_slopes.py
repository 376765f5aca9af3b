"""Derivatives of the likelihood to noise variances, against exact ones over dual numbers and against differences."""

import dataclasses

import numpy as np
import pytest

from harness.config import resolve_single
from harness.diagnosis.fitting import Fitting
from harness.diagnosis.model.augmented_model import AugmentedModel
from harness.diagnosis.model.hypotheses import coordinates, hypotheses
from harness.diagnosis.selection.forward_selection import first_variances
from harness.identification.candidates import Candidates
from harness.identification.innovations import Innovations
from support.driven_car import CAR, FREE, SIGNALS, driven

DRIFT = "sensor_drift_yaw_rate"


def with_gaps(recording, seed):
    """Return a recording without every fifth sample of one output, and a second without any."""
    found, rng = recording.copy(), np.random.default_rng(seed)
    yaw_rate = found["yaw_rate"].values.copy()
    yaw_rate[rng.random(len(yaw_rate)) < 0.2] = np.nan
    lateral = found["lateral_acceleration"].values.copy()
    lateral[500:600] = np.nan
    found["yaw_rate"] = ("time", yaw_rate, found["yaw_rate"].attrs)
    found["lateral_acceleration"] = ("time", lateral, found["lateral_acceleration"].attrs)
    return found


@pytest.mark.parametrize("gaps", [False, True])
def test_they_are_those_of_the_filter_over_dual_numbers(gaps):
    """With Euler steps in both, held inputs and linear tyres: the exact gradient and information of that filter."""
    spec = resolve_single(CAR, "test")
    augmented, alone = AugmentedModel(spec, SIGNALS, jobs=1), Innovations(spec, jobs=1)
    recording = driven(3, duration=25.0)
    recording = with_gaps(recording, 1) if gaps else recording
    drive = augmented.drive(recording, "drive")
    drive = dataclasses.replace(drive, between=drive.inputs)
    own = dataclasses.replace(alone.drive(recording, "drive"), first_variance=drive.first_variance[: alone.nx])
    point = Candidates.of(spec)
    point = dataclasses.replace(point, process=3.0 * point.process, measurement=0.5 * point.measurement)
    n, nx = len(point.process) + len(point.measurement), len(point.process)
    process, measurement = np.zeros((nx, n)), np.zeros((n - nx, n))
    process[range(nx), range(nx)] = point.process[:, 0]
    measurement[range(n - nx), range(nx, n)] = point.measurement[:, 0]
    along = [Candidates(np.zeros((len(m.names), n)), process, measurement) for m in (augmented, alone)]
    found = augmented.slopes([drive], dataclasses.replace(point, values=augmented.stated()[:, None]), along[0])
    exact = alone.slopes([own], point, along[1])
    assert np.linalg.norm(exact.gradient) > 1000
    np.testing.assert_allclose(found.gradient, exact.gradient, rtol=0.01, atol=0.01 * np.abs(exact.gradient).max())
    scale = np.sqrt(np.diagonal(exact.information))
    np.testing.assert_allclose(
        found.information / np.outer(scale, scale), exact.information / np.outer(scale, scale), atol=0.01
    )


def test_runs_in_lanes_are_those_of_each_candidate_alone(augmented):
    drive, values = augmented.drive(with_gaps(driven(3, duration=10.0), 1), "drive"), augmented.stated()[:, None]
    point = dataclasses.replace(Candidates.of(augmented.spec), values=values)
    lag = augmented.along(["steering_lag"])
    each = [dataclasses.replace(point, values=values + s * lag, process=p * point.process)
            for s, p in ((0.0, 1.0), (0.05, 1.0), (0.1, 30.0))]  # fmt: skip
    for candidate, in_lane in zip(each, augmented.runs_of(drive, Candidates.together(each)), strict=True):
        alone = augmented.run(drive, candidate)
        assert alone.log_likelihood == in_lane.log_likelihood
        for name in ("innovation", "deviation", "whitened", "whitening", "gain"):
            np.testing.assert_array_equal(getattr(alone, name), getattr(in_lane, name))
        corrected = range(len(augmented.nominal.states))  # states of an effect that is absent in all lanes stand still
        np.testing.assert_array_equal(alone.state[:, corrected], in_lane.state[:, corrected])


def test_an_intensity_is_a_variance_of_its_state(augmented):
    """Differences of the likelihood, with a gyroscope that drifts and a tyre's parameter that moves as well."""
    drift = next(h for h in hypotheses(augmented, FREE) if h.random and h.of_recording)
    drives = [augmented.drive(driven(88 + i, duration=25.0), f"drive {i}") for i in range(2)]
    fitting = Fitting(augmented, drives, first_variances(augmented, drives))
    start = fitting.first()
    values = start.values.copy()
    values[augmented.row(DRIFT)] = 0.05
    objective, z, _ = fitting._objective(
        coordinates(augmented, FREE, (drift,), 2), dataclasses.replace(start, values=values)
    )
    names = [c.name for c in objective.coordinates.coordinates]
    noise = [i for i, c in enumerate(objective.coordinates.coordinates) if c.kind != "parameter"]
    value, gradient, information = objective.slopes(z, np.ones(len(z), dtype=bool))
    assert value == objective.values(z[:, None])[0]
    h, many = 0.01, np.repeat(z[:, None], 2 * len(noise), axis=1)
    for j, i in enumerate(noise):
        many[i, 2 * j : 2 * j + 2] += (h, -h)
    ahead, behind = objective.values(many).reshape(-1, 2).T
    np.testing.assert_allclose(gradient[noise], (ahead - behind) / (2 * h), rtol=0.03, atol=1.0)
    assert information[names.index(DRIFT), names.index(DRIFT)] > 1.0
    parameters = np.setdiff1d(np.arange(len(z)), noise)
    assert not information[np.ix_(parameters, noise)].any()
