"""A random process that a model lacks: found where it acts, with its parameters, and nowhere else."""

import copy
import dataclasses
from types import SimpleNamespace
from typing import NamedTuple

import numpy as np
import pytest

from harness.config import resolve_single
from harness.diagnosis.criteria import EXCESS, WHITE
from harness.diagnosis.fitting import Fitting
from harness.diagnosis.model.hypotheses import coordinates
from harness.diagnosis.residuals.disturbance_ranking import DisturbanceRanking
from harness.diagnosis.residuals.random_process import expected_excess, find_random_process
from harness.diagnosis.result.estimator_gain import fitted_model
from harness.diagnosis.selection.forward_selection import first_variances
from harness.diagnosis.selection.validation import HeldOut, colour_left
from harness.identification.candidates import Candidates
from harness.identification.innovations import Innovations
from harness.identification.whiteness import Whiteness, whiteness
from support.driven_car import CAR, FREE, driven

WANDER, MEMORY = 0.02, 5.0


def search(augmented, recordings):
    """Return what is found in the last of some drives, fitted to the others with nothing named.

    The rounds of a trace try the road and the gyroscope; here nothing was tried.
    """
    augmented = copy.copy(augmented)
    augmented.processes = ()
    drives = [augmented.drive(r, f"drive {i}") for i, r in enumerate(recordings)]
    variances = first_variances(augmented, drives)
    fitting = Fitting(augmented, drives[:-1], variances)
    fit = fitting.fit(coordinates(augmented, FREE, (), len(drives) - 1), fitting.first(), 10)
    held_out = HeldOut(augmented, drives[-1:], variances)
    trace = SimpleNamespace(fitting=fitting, held_out=held_out, free=FREE, after=held_out.judge((), fit.point))
    return find_random_process(
        trace, fitted_model(trace, augmented.spec, fit.point), DisturbanceRanking(fitting, fit.point)
    )


def test_a_bank_that_wanders_is_found_and_leaves_nothing(augmented):
    values = {"bank_wander": WANDER, "bank_memory": MEMORY}
    found = search(augmented, [driven(seed, ["road_bank_varying"], **values) for seed in (81, 82, 83)])
    assert found is not None
    (hypothesis,) = found.hypotheses
    assert hypothesis.name == "road_bank_varying"
    assert hypothesis.amplitudes == ("bank_wander",)
    assert found.gain > 100
    assert found.held_out_gain > 50
    # 120 s of a process that forgets in 5 s are two dozen independent stretches.
    assert found.spec.values["bank_wander"] == pytest.approx(WANDER, rel=0.3)
    assert 0 < found.errors["bank_wander"] < 0.3 * WANDER
    assert abs(np.log(found.spec.values["bank_memory"] / MEMORY)) < 1.2
    assert found.spec.process_noise["bank_walk"] > 0
    assert found.spec.effects == ("road_bank_varying",)


def test_two_sensors_that_drift_are_found_one_after_the_other(augmented):
    true = {"sensor_drift_yaw_rate": 0.004, "sensor_drift_lateral_velocity": 0.06}
    drifting = ("sensor_drift@yaw_rate", "sensor_drift@lateral_velocity")
    found = search(augmented, [driven(seed, drifting, **true) for seed in (84, 85, 86)])
    assert found is not None
    assert {h.name for h in found.hypotheses} == set(drifting)
    assert found.white
    for name, value in true.items():
        assert abs(found.spec.values[name] - value) < max(3 * found.errors[name], 0.3 * value)
    assert found.spec.process_noise["drift_yaw_rate"] == pytest.approx(0.01 * found.spec.step)


def test_next_to_white_is_a_twentieth_of_the_squared_correlations():
    """What a filter leaves of a process that it takes for another is coloured by any test that is long enough."""
    noise = np.random.default_rng(3).normal(size=12000)
    before, little, half = (np.convolve(noise, [1.0, *[share] * 12])[: len(noise)] for share in (0.5, 0.025, 0.25))
    before, little, half, noise = (_Judged((whiteness(series),)) for series in (before, little, half, noise))
    assert min(little.whiteness[0].ljung_box, little.whiteness[0].periodogram) < WHITE
    assert 0 < colour_left([before], [little]) < EXCESS
    assert colour_left([before], [half]) > EXCESS
    assert colour_left([before], [noise]) == 0
    assert colour_left([before, before], [noise, half]) == colour_left([before], [half])
    assert half.whiteness[0].correlation == pytest.approx(_squares(0.25, 12), rel=0.1)


class _Judged(NamedTuple):
    """What is asked of a judgement."""

    whiteness: tuple[Whiteness, ...]


def _squares(share, terms):
    """Return the sum of the squared correlations of white noise with as many equal echoes of it."""
    covariance = [share + (terms - k) * share**2 for k in range(1, terms + 1)]
    return sum((c / (1 + terms * share**2)) ** 2 for c in covariance)


def test_a_gust_is_no_bank(augmented):
    times = ((20.0, 31.0), (35.0, 44.0), (25.0, 40.0))
    gusts = [
        driven(i, ["crosswind"], crosswind_force=400.0, crosswind_onset=a, crosswind_end=b)
        for i, (a, b) in enumerate(times)
    ]
    assert search(augmented, gusts) is None


def test_a_process_explains_as_much_straying_as_it_makes(augmented):
    """The variance without measurements against drives in which the process is the only thing that is missing."""
    values = {"bank_wander": WANDER, "bank_memory": MEMORY}
    spec = resolve_single({**CAR, "integrator": "rk4", "effects": ["road_bank_varying"], "values": values}, "test")
    noise = spec.model().noise
    spec = dataclasses.replace(
        spec, process_noise={**spec.process_noise, **{s: v * spec.step for s, v in noise.items()}}
    )
    filters = Innovations(spec)
    drives = [filters.drive(driven(seed, ["road_bank_varying"], **values), f"drive {seed}") for seed in range(90, 96)]
    variances = np.array([1e-4, 1e-2, 1e-3])
    expected = expected_excess(filters, drives, Candidates.of(spec), variances)
    free = [filters.free_run(d, filters.stated()).outputs for d in drives]
    clean = [
        augmented.free_run(augmented.drive(driven(seed), "clean"), augmented.stated()).outputs for seed in range(90, 96)
    ]
    apart = np.concatenate([d.measurements - f for d, f in zip(drives, free, strict=True)])
    silent = np.concatenate(
        [augmented.drive(driven(seed), "clean").measurements - c for seed, c in zip(range(90, 96), clean, strict=True)]
    )
    made = np.sum((np.nanmean(apart**2, axis=0) - np.nanmean(silent**2, axis=0)) / variances)
    assert expected == pytest.approx(made, rel=0.35)  # six drives of a dozen independent stretches each
