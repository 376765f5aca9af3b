"""Ziaukas 2023, Bild 5.7: the estimated steering on two ramps, its delay and its noise, over the variance believed."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
import xarray as xr

from harness.campaign.claims import ANGLE, EKF, FORCE, NETWORK, UKF
from harness.campaign.evidence import Evidence
from harness.common.statistics import median_interval
from harness.models.parameters import ziaukas_2023
from harness.models.quantities import words
from harness.reproductions.published.record import HERE, Record, between, image, statement
from harness.reproductions.published.results import Stored

TITLE = "Ziaukas 2023, Bild 5.7: the estimated steering on two ramps"
NOTE = (
    "Bild 5.7 draws a ramp to the right and one to the left without numbers; ours turn the steering wheel by 180° at "
    "45°/s and 8 m/s. The process noise of the steering, 1e-5, is printed without a unit: both readings are tried."
)

STEERING = "steering_wheel_angle"
RAMPS = {"right": "-180 deg", "left": "180 deg"}
RUNS = 5
REACH = 1.5
"""s; longest delay that is looked for."""

DELAY = 0.7
BELIEVED = ziaukas_2023.PROCESS_NOISE[STEERING]
READINGS = {
    "of the steering wheel": 1e-5,
    "of the road wheels": 1e-5 * ziaukas_2023.VALUES["steering_ratio"] ** 2,
}
"""Variance per step in rad^2 at the steering wheel, by the angle that the printed 1e-5 is taken for."""

CLOSER = "Ours are several times closer to the truth, which leaves the network less to gain (docs/campaign.md)."


def _ramps(variance: float) -> Callable[[dict[str, Any]], None]:
    """Return what makes a study of two ramps of the ideal case, with a variance of the steering."""

    def build(table: dict[str, Any]) -> None:
        table.pop("drives", None)
        own = {"kind": "ramp", "duration": "30 s", "speed": "8 m/s", "rate": "45 deg/s", "rounding": "0.1 s"}
        table["drive"] = [{"name": name, **own, "amplitude": angle} for name, angle in RAMPS.items()]
        table["design"] = [{"name": "ramps", "repeats": RUNS}]
        table["history"] = [
            {"name": f"{name} {k}", "design": "ramps", "drive": name, "repeat": k}
            for name in RAMPS
            for k in range(RUNS)
        ]
        table["belief"].setdefault("noise", {}).setdefault("process", {})[STEERING] = variance

    return build


def ramps(stored: Stored, variance: float = BELIEVED) -> list[xr.Dataset]:
    """Return the runs on two ramps over time."""
    return stored.small(f"ramps-{variance:.2e}", _ramps(variance), "ideal").histories


def delay_of(run: xr.Dataset, estimator: str) -> float:
    """Return by how many seconds the truth must be delayed to fit the estimated steering best."""
    truth = run["truth"].sel(target=STEERING).to_numpy()
    estimate = run["estimate"].sel(target=STEERING, estimator=estimator).to_numpy()
    step = float(run["time"][1] - run["time"][0])
    lags = range(round(REACH / step) + 1)
    misfit = [np.nanmean((estimate[lag:] - truth[: len(truth) - lag]) ** 2) for lag in lags]
    return float(lags[int(np.argmin(misfit))] * step)


def roughness(run: xr.Dataset, estimator: str, signal: str) -> float:
    """Return the root mean square of an estimate's changes from sample to sample."""
    return float(np.sqrt(np.nanmean(np.diff(run["estimate"].sel(target=signal, estimator=estimator)) ** 2)))


def _rms(run: xr.Dataset, estimator: str, signal: str, other: str | None = None) -> float:
    """Return the RMS of an estimate less another, or less the truth."""
    estimate = run["estimate"].sel(target=signal)
    against = run["truth"].sel(target=signal) if other is None else estimate.sel(estimator=other)
    return float(np.sqrt(np.nanmean((estimate.sel(estimator=estimator) - against) ** 2)))


def _over_runs(what: str, values: Sequence[float], region: tuple[float, float], theirs: float = np.nan) -> Evidence:
    return Evidence(what, median_interval(values), region, theirs, len(values))


def _late(reading: str) -> Record:
    def test(stored: Stored) -> list[Evidence]:
        runs = ramps(stored, READINGS[reading])
        region = (DELAY / 1.25, 1.25 * DELAY)
        return [_over_runs(name, [delay_of(run, name) for run in runs], region, DELAY) for name in (EKF, UKF)]

    quantity = f"delay of the estimated steering, up to; 1e-5 taken for an angle {reading}"
    reason = "Theirs lies between what the two readings give on our ramps; amplitude and speed are ours."
    return Record("5.3, Bild 5.7", quantity, f"{DELAY}", "s", test=test, reason=reason)


def _own(stored: Stored) -> list[Evidence]:
    values = {name: [delay_of(run, name) for run in ramps(stored)] for name in (EKF, UKF)}
    return [_over_runs(name, found, between(DELAY), DELAY) for name, found in values.items()]


def _alike(stored: Stored) -> list[Evidence]:
    return [
        _over_runs(
            f"{words(signal)}: UKF less EKF over the error of the EKF",
            [_rms(run, UKF, signal, EKF) / _rms(run, EKF, signal) for run in ramps(stored)],
            (0.0, 0.2),
        )
        for signal in (FORCE, ANGLE, STEERING)
    ]


def _rougher(one: str, other: str, signal: str) -> Callable[[Stored], list[Evidence]]:
    def test(stored: Stored) -> list[Evidence]:
        values = [roughness(run, one, signal) / roughness(run, other, signal) for run in ramps(stored)]
        return [_over_runs(f"changes from sample to sample, {one} over {other}", values, (1.0, np.inf))]

    return test


def _closer(stored: Stored) -> list[Evidence]:
    values = [_rms(run, NETWORK, ANGLE) / _rms(run, EKF, ANGLE) for run in ramps(stored)]
    return [_over_runs("RMSE of the angle, network over EKF", values, (0.0, 1.0))]


def _another(factor: float) -> Callable[[Stored], list[Evidence]]:
    """Compare a multiple of the variance believed with that believed: a larger one is sooner and noisier."""

    def test(stored: Stored) -> list[Evidence]:
        pairs = list(zip(ramps(stored, factor * BELIEVED), ramps(stored), strict=True))
        later = [delay_of(other, EKF) - delay_of(own, EKF) for other, own in pairs]
        rougher = [roughness(other, EKF, STEERING) / roughness(own, EKF, STEERING) for other, own in pairs]
        smaller = factor < 1.0
        return [
            _over_runs("delay in s, less that at the variance believed", later, *_side(smaller, 0.0)),
            _over_runs("changes from sample to sample, over those there", rougher, *_side(not smaller, 1.0)),
        ]

    return test


def _side(above: bool, of: float) -> tuple[tuple[float, float]]:
    return ((of + 1e-3, np.inf),) if above else ((-np.inf, of - 1e-3),)


def records() -> tuple[Record, ...]:
    """Return what figure and text publish."""
    return (
        *(_late(reading) for reading in READINGS),
        Record("5.3, Bild 5.7", "the same with the variance of our set", f"{DELAY}", "s", test=_own),
        statement("Bild 5.7", "EKF and UKF can hardly be told apart", _alike),
        statement("Bild 5.7", "the network's force is noisier than the filters'", _rougher(NETWORK, EKF, FORCE)),
        statement(
            "Bild 5.7", "the filters' angle is noisier than the network's", _rougher(EKF, NETWORK, ANGLE), HERE, CLOSER
        ),
        statement("Bild 5.7", "the network's angle is more accurate than the filters'", _closer, HERE, CLOSER),
        statement("5.3", "a smaller variance of the steering makes its estimate later and smoother", _another(0.01)),
        statement("5.3", "a larger one makes it sooner and noisier", _another(100.0)),
        image("Bild 5.7", "steering, angle and force over time"),
    )
