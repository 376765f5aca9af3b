"""Summary of an estimator's run over a recording: consistency, whiteness, errors, and in a sentence whether it fits."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import xarray as xr

from harness.common.arrays import Floats
from harness.common.statistics import average_bounds
from harness.identification.data import DriveData
from harness.identification.filtered_model import FilterRun
from harness.identification.whiteness import LAGS, Whiteness, is_white, whiteness
from harness.models.quantities import listed, quantity, words
from harness.models.signals import SIGNALS
from harness.reporting import style
from harness.runner.scores import chi_square_bounds


@dataclass(frozen=True)
class Consistency:
    """The innovations of a filter on one recording.

    Attributes:
        name: Of the recording.
        nis: Mean of NIS over the number of measurements in it; 1 if the covariance is right.
        inside: Share of samples with NIS in its two-sided 95 % chi-square band.
        samples: Samples with a measurement.
        outputs: Whiteness of each output's whitened innovations, by name.
    """

    name: str
    nis: float
    inside: float
    samples: int
    outputs: dict[str, Whiteness]


def consistency(drive: DriveData, run: FilterRun, outputs: Iterable[str]) -> Consistency:
    """Judge a run of the filter over a recording."""
    seen = np.isfinite(run.whitened)
    nis, degrees = np.nansum(run.whitened**2, axis=1), seen.sum(axis=1)
    mean, inside, samples = shares_inside(nis, degrees)
    white = {n: whiteness(column) for n, column in zip(outputs, run.whitened[1:].T, strict=True)}
    return Consistency(drive.name, mean, inside, samples, white)


def shares_inside(normalised: Floats, degrees: Floats) -> tuple[float, float, int]:
    """Return the mean of NIS or NEES over its degrees of freedom, the share inside the 95 % band, and their number.

    Args:
        normalised: ``(samples,)``; NaN or of no degree of freedom where there is none.
        degrees: Degrees of freedom ``(samples,)``.
    """
    counted = np.isfinite(normalised) & (degrees > 0)
    samples = int(counted.sum())
    if not samples:
        return np.nan, np.nan, 0
    m = degrees[counted].astype(int)
    bounds = chi_square_bounds(1 + int(m.max()))[m]
    values = normalised[counted]
    inside = (values >= bounds[:, 0]) & (values <= bounds[:, 1])
    return float(values.sum() / m.sum()), float(inside.mean()), samples


@dataclass(frozen=True)
class Error:
    """One signal against its reference.

    Attributes:
        rmse: Root mean square of estimate less reference, SI.
        bias: Mean of it.
        largest: Largest magnitude of it.
        nees: Mean of the squared error over the stated variance; 1 if the variance is right.
        inside: Share of samples inside the 95 % band.
        noise: Standard deviation of the white noise that the reference shows.
        nees_with_noise: Mean of the squared error over the stated variance and that of this noise together.
        inside_with_noise: Share of samples inside the 95 % band of both.
        independent: Number of independent errors of which the recording says as much: neighbours are alike.
    """

    rmse: float
    bias: float
    largest: float
    nees: float
    inside: float
    noise: float = 0.0
    nees_with_noise: float = math.nan
    inside_with_noise: float = math.nan
    independent: float = math.nan

    @property
    def mostly_noise(self) -> bool:
        """Whether most of the error is the noise of the reference."""
        return self.noise**2 > 0.5 * self.rmse**2


@dataclass(frozen=True)
class RunSummary:
    """One estimator on one recording.

    Attributes:
        estimator: Its name.
        recording: Name of the recording.
        nis: Mean of NIS over its degrees of freedom; 1 if the covariance of the innovations is right.
        nis_inside: Share of samples with NIS in its 95 % band.
        nees: The same of NEES; NaN without a reference.
        nees_inside: The same of NEES.
        log_likelihood: Of the recording up to a divergence.
        updates: Samples with a measurement.
        diverged_at: s; NaN if it did not.
        repairs: Samples with a covariance factor that had to be repaired.
        whiteness: Of each output's innovations over their stated standard deviation.
        errors: Of each signal with a reference.
        parameters: Last estimate of each unknown parameter and its standard deviation, SI.
    """

    estimator: str
    recording: str
    nis: float
    nis_inside: float
    nees: float
    nees_inside: float
    log_likelihood: float
    updates: int
    diverged_at: float
    repairs: int
    whiteness: dict[str, Whiteness]
    errors: dict[str, Error]
    parameters: dict[str, tuple[float, float]] = field(default_factory=dict)


def references_of(run: xr.Dataset) -> list[str]:
    """Return the signals that have a reference."""
    prefix = "reference_"
    return [str(v).removeprefix(prefix) for v in run if str(v).startswith(prefix)]


def outputs_of(run: xr.Dataset) -> list[str]:
    """Return what was measured."""
    return [str(v) for v in run["output"].values]


def signals_of(run: xr.Dataset) -> list[str]:
    """Return what was estimated."""
    return [str(v) for v in run if f"{v}_std" in run]


def summary(run: xr.Dataset) -> RunSummary:
    """Return the numbers of a run of ``harness.recorded.run.RecordedEstimator``."""
    nis, nis_inside, _ = shares_inside(run["nis"].to_numpy(), run["nis_degrees"].to_numpy())
    nees = nees_inside = math.nan
    if "nees" in run:
        nees, nees_inside, _ = shares_inside(run["nees"].to_numpy(), run["nees_degrees"].to_numpy())
    normalised = {n: (run[f"innovation_{n}"] / run[f"innovation_std_{n}"]).to_numpy() for n in outputs_of(run)}
    return RunSummary(
        run.attrs["estimator"],
        run.attrs["recording"],
        nis,
        nis_inside,
        nees,
        nees_inside,
        run.attrs["log_likelihood"],
        run.attrs["updates"],
        run.attrs["diverged_at"],
        run.attrs["repairs"],
        {n: whiteness(values[1:]) for n, values in normalised.items()},
        {n: _error(run, n) for n in references_of(run)},
        {n: (_last(run[n]), _last(run[f"{n}_std"])) for n in run.attrs["estimated_parameters"].split(", ") if n},
    )


def _last(values: xr.DataArray) -> float:
    """Return the last finite value."""
    finite = values.to_numpy()[np.isfinite(values)]
    return float(finite[-1]) if finite.size else math.nan


def _error(run: xr.Dataset, name: str) -> Error:
    error = run[f"error_{name}"].to_numpy()
    finite = error[np.isfinite(error)]
    share = run[f"nees_{name}"].to_numpy()
    nees, inside, _ = shares_inside(share, np.ones(len(share)))
    if not finite.size:
        return Error(math.nan, math.nan, math.nan, nees, inside)
    rmse, largest = float(np.sqrt(np.mean(finite**2))), float(np.abs(finite).max())
    noise = float(run[f"reference_{name}"].attrs["noise_std"])
    variance = run[f"{name}_std"].to_numpy() ** 2 + noise**2
    both = np.isfinite(error) & np.isfinite(variance)
    with_noise, inside_both, _ = shares_inside(error[both] ** 2 / variance[both], np.ones(int(both.sum())))
    bias, independent = float(finite.mean()), _independent(finite)
    return Error(rmse, bias, largest, nees, inside, noise, with_noise, inside_both, independent)


def _independent(errors: Floats) -> float:
    """Return of how many independent errors a mean is as certain: those of a first-order process."""
    alike = float(errors[1:] @ errors[:-1]) / max(float(errors @ errors), 1e-300)
    return max(1.0, len(errors) * (1.0 - alike) / (1.0 + alike)) if alike > 0.0 else float(len(errors))


def record(summary: RunSummary) -> dict[str, Any]:
    """Return the numbers as ``estimate.json`` holds them, SI units."""
    return {
        "estimator": summary.estimator,
        "recording": summary.recording,
        "log_likelihood": summary.log_likelihood,
        "samples_with_a_measurement": summary.updates,
        "nis_over_degrees": summary.nis,
        "nis_inside_95": summary.nis_inside,
        "nees_over_degrees": summary.nees,
        "nees_inside_95": summary.nees_inside,
        "diverged_at": summary.diverged_at,
        "repairs": summary.repairs,
        "innovations": {n: w.record for n, w in summary.whiteness.items()},
        "errors": {
            n: {
                "unit": SIGNALS[n].unit if n in SIGNALS else "",
                "rmse": e.rmse,
                "bias": e.bias,
                "largest": e.largest,
                "nees": e.nees,
                "inside_95": e.inside,
                "reference_noise_std": e.noise,
                "nees_with_reference_noise": e.nees_with_noise,
                "inside_95_with_reference_noise": e.inside_with_noise,
            }
            for n, e in summary.errors.items()
        },
        "parameters": {
            n: {"unit": SIGNALS[n].unit, "last": value, "std": std} for n, (value, std) in summary.parameters.items()
        },
    }


_FEWEST = 100
"""Samples with a measurement below which the share of NIS in its band says nothing: one in twenty is outside."""

_CONSISTENT = (0.90, 0.99)
"""Share of NIS in its 95 % band that counts as consistent."""

_COLOURED = 0.05
"""Sum of squared correlations of the innovations with their past, beyond that of white noise, from which they count as
coloured: of a long recording a test rejects also what changes nothing, such as the steps of a sensor."""

_TOO_LARGE = 1.5
"""Factor between NIS or NEES, over their degrees of freedom, and 1 that does not matter."""

_LEVEL = 0.99
"""Of the bounds of an average that a right estimator keeps."""


def verdicts(summaries: Sequence[RunSummary]) -> str:
    """Return the verdict on each estimator, those that come to the same together."""
    by_verdict: dict[str, list[str]] = {}
    for name in dict.fromkeys(s.estimator for s in summaries):
        by_verdict.setdefault(verdict([s for s in summaries if s.estimator == name]), []).append(name)
    return " ".join(f"With {listed(names)} {text}." for text, names in by_verdict.items())


def verdict(runs: Sequence[RunSummary]) -> str:
    """Return whether model and noise fit, and because of what, of one estimator on all recordings.

    What weighs most comes first: errors that are larger than stated, then coloured innovations, then NIS. Where NIS
    alone is not as stated, it is the noise. Else it may be either: a wrong ratio of process noise to measurement noise
    colours the innovations, too.
    """
    if lost := [s.recording for s in runs if math.isfinite(s.diverged_at)]:
        return f"the estimate diverges on {listed(lost)}"
    inside = [s.nis_inside for s in runs if math.isfinite(s.nis_inside)]
    if not inside:
        return "no covariance is stated"
    if (samples := sum(s.updates for s in runs)) < _FEWEST:
        return f"there are only {samples} samples with a measurement, too few to judge its NIS"
    share = float(np.mean(inside))
    of_nis = f"{style.percent(share)} of NIS in its 95 % band"
    errors = [(n, e) for s in runs for n, e in s.errors.items() if math.isfinite(e.rmse)]
    if reasons := [*_large(errors), *_coloured(runs)]:
        return f"model or noise does not fit: {'; '.join([*reasons, of_nis])}"
    nis = float(np.mean([s.nis for s in runs if math.isfinite(s.nis)]))
    if not _CONSISTENT[0] <= share <= _CONSISTENT[1] or not 1.0 / _TOO_LARGE <= nis <= _TOO_LARGE:
        size = "small" if nis > 1.0 else "large"
        return f"the noise does not fit: it is stated too {size}, with {of_nis}, {style.number(nis)} in the mean, not 1"
    as_stated = f", errors of {_names(errors)} no larger than stated" if errors else ", no reference"
    noisy = [(n, e) for n, e in errors if e.mostly_noise]
    own = f"; those of {_names(noisy)} are mostly noise of the reference" if noisy else ""
    return f"model and noise fit: {of_nis}, innovations almost white{as_stated}{own}"


def is_large(error: Error) -> bool:
    """Whether errors are larger than stated, with the noise of the reference, by more than chance.

    Neighbouring errors are alike, so that the mean is that of fewer independent ones.
    """
    _, most = average_bounds(1, error.independent, _LEVEL)
    return error.nees_with_noise > max(_TOO_LARGE, most)


def is_coloured(whiteness: Whiteness) -> bool:
    """Whether innovations are coloured by so much that it matters."""
    samples = 2 * len(whiteness.frequency)
    return not is_white(whiteness) and whiteness.correlation - LAGS / max(samples, 1) > _COLOURED


def _large(errors: Sequence[tuple[str, Error]]) -> list[str]:
    large = sorted((pair for pair in errors if is_large(pair[1])), key=lambda pair: -pair[1].nees_with_noise)
    if not large:
        return []
    name, worst = large[0]
    times, inside = style.number(math.sqrt(worst.nees_with_noise)), style.percent(worst.inside_with_noise)
    return [f"errors of the {words(name)} are {times} times as large as stated ({inside} in their 95 % band)"]


def _coloured(runs: Sequence[RunSummary]) -> list[str]:
    names = dict.fromkeys(n for s in runs for n, w in s.whiteness.items() if is_coloured(w))
    return [f"innovations of {listed([words(n) for n in names])} are coloured"] if names else []


def _names(errors: Sequence[tuple[str, Error]]) -> str:
    return listed([quantity(n).words for n in dict.fromkeys(n for n, _ in errors)])
