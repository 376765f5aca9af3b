"""Ziaukas 2023, Bild 5.7: the estimated steering on two ramps, its delay and its noise, over the variance believed."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
import xarray as xr

from harness.common.statistics import median_interval
from harness.models.parameters import ziaukas_2023, ziaukas_2023_road_wheels
from harness.models.quantities import words
from harness.simulation.drives import read_drives
from reproductions.campaign.claims import ANGLE, EKF, FORCE, MEDIANS, NETWORK, UKF
from reproductions.campaign.evidence import Evidence
from reproductions.published.record import HERE, Record, between, image, statement
from reproductions.published.results import STUDIES, Stored

TITLE = "Ziaukas 2023, Bild 5.7: the estimated steering on two ramps"
NOTE = (
    "Bild 5.7 draws a ramp to the right and one to the left without numbers; ours are the drive two-ramps of "
    "studies/drives/robustness.toml. The process noise of the steering, 1e-5, is printed without a unit: both readings "
    "are tried, on the ramps and on the six drives of Bild 5.6."
)

STEERING = "steering_wheel_angle"
DRIVE = "two-ramps"
RUNS = 5
REACH = 3.0
"""s; longest delay that is looked for."""

STRAIGHT = 8.0
"""s; at the end of the drive, long after the second ramp."""

DELAY = 0.7
NOISY = 2.5
"""Degrees, a hundredth of the ramps: a steering that is estimated with more noise is strongly noisy (our reading)."""

BELIEVED = ziaukas_2023.PROCESS_NOISE[STEERING]
READINGS = {
    "of the steering wheel": BELIEVED,
    "of the road wheels": ziaukas_2023_road_wheels.PROCESS_NOISE[STEERING],
}
"""Variance per step in rad^2 at the steering wheel, by the angle that the printed 1e-5 is taken for."""

CLOSER = "Ours are closer to the truth, which leaves the network less to gain."


def _believing(variance: float, table: dict[str, Any]) -> None:
    """Make the estimators of a study believe a variance of the steering."""
    table["belief"].setdefault("noise", {}).setdefault("process", {})[STEERING] = variance


def ramps(stored: Stored, variance: float = BELIEVED) -> list[xr.Dataset]:
    """Return the runs on two ramps over time, with a variance of the steering that is believed."""

    def build(table: dict[str, Any]) -> None:
        kind, options = read_drives(STUDIES / "drives" / "robustness.toml")[DRIVE]
        table.pop("drives", None)
        table["drive"] = [{"name": DRIVE, "kind": kind, **options}]
        table["design"] = [{"name": "ramps", "repeats": RUNS}]
        table["history"] = [{"name": str(k), "design": "ramps", "drive": DRIVE, "repeat": k} for k in range(RUNS)]
        _believing(variance, table)

    return stored.small(f"ramps-{variance:.2e}", build, "ideal").histories


def _medians(stored: Stored, variance: float) -> list[Evidence]:
    """Compare the errors of the EKF on the drives of the ideal case, with a variance of the steering, with Bild 5.6."""

    def build(table: dict[str, Any]) -> None:
        table["estimator"] = [e for e in table["estimator"] if e["name"] == EKF]
        table.pop("tuning", None)  # of an estimator that is not asked here
        table["design"] = [{"name": "ideal", "repeats": RUNS}]
        table.pop("history", None)
        _believing(variance, table)

    design = stored.small(f"ideal-{variance:.2e}", build, "ideal").designs[0]
    values = {q.name: design.rmse[t, 0, 0] for t, q in enumerate(design.targets)}
    drives = {t: np.broadcast_to(np.arange(len(v)).reshape(-1, 1, 1), v.shape) for t, v in values.items()}
    return [
        Evidence(words(t), median_interval(values[t], drives[t]), between(theirs), theirs, values[t].size)
        for t, theirs in ((FORCE, MEDIANS[EKF, FORCE]), (ANGLE, MEDIANS[EKF, ANGLE]))
    ]


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


def noise_of(run: xr.Dataset, estimator: str) -> float:
    """Return the standard deviation in degrees of the estimated steering straight ahead, at the end of the drive."""
    estimate = run["estimate"].sel(target=STEERING, estimator=estimator)
    return float(np.degrees(np.nanstd(estimate.sel(time=slice(float(run["time"][-1]) - STRAIGHT, None)))))


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
    reason = "Theirs lies between what the two readings give on our ramps; amplitude, rate and speed are ours."
    return Record("5.3, Bild 5.7", quantity, f"{DELAY}", "s", test=test, reason=reason)


def _noisy(reading: str) -> Record:
    def test(stored: Stored) -> list[Evidence]:
        runs = ramps(stored, READINGS[reading])
        values = [[noise_of(run, name) for run in runs] for name in (EKF, UKF)]
        what = "standard deviation straight ahead in °"
        return [_over_runs(f"{n}: {what}", v, (NOISY, np.inf)) for n, v in zip((EKF, UKF), values, strict=True)]

    quantity = f"the filters' steering is strongly noisy; 1e-5 taken for an angle {reading}"
    return statement("5.3, Bild 5.7", quantity, test, HERE, "The text has no number for it.")


def _off(reading: str) -> Record:
    quantity = f"median errors of the EKF in kN and °; 1e-5 taken for an angle {reading}"
    reason = "Of the two readings that of the steering wheel is nearer; drives and tyres are ours."
    return Record(
        "5.3, Bild 5.6",
        quantity,
        f"{MEDIANS[EKF, FORCE]}; {MEDIANS[EKF, ANGLE]}",
        test=lambda stored: _medians(stored, READINGS[reading]),
        reason=reason,
    )


def _own(stored: Stored) -> list[Evidence]:
    values = {name: [delay_of(run, name) for run in ramps(stored)] for name in (EKF, UKF)}
    return [_over_runs(name, delays, between(DELAY), DELAY) for name, delays in values.items()]


def _alike(stored: Stored) -> list[Evidence]:
    return [
        _over_runs(
            f"{words(signal)}: UKF less EKF over the error of the EKF",
            [_rms(run, UKF, signal, EKF) / _rms(run, EKF, signal) for run in ramps(stored)],
            (0.0, 0.2),
        )
        for signal in (FORCE, ANGLE, STEERING)
    ]


def _rougher(estimator: str, other: str, signal: str) -> Callable[[Stored], list[Evidence]]:
    def test(stored: Stored) -> list[Evidence]:
        values = [roughness(run, estimator, signal) / roughness(run, other, signal) for run in ramps(stored)]
        return [_over_runs(f"changes from sample to sample, {estimator} over {other}", values, (1.0, np.inf))]

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


def _side(above: bool, value: float) -> tuple[tuple[float, float]]:
    return ((value + 1e-3, np.inf),) if above else ((-np.inf, value - 1e-3),)


def records() -> tuple[Record, ...]:
    """Return what figure and text publish."""
    return (
        *(_late(reading) for reading in READINGS),
        *(_noisy(reading) for reading in READINGS),
        *(_off(reading) for reading in READINGS),
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
