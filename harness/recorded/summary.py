"""What a run of an estimator over a recording comes to: consistency, whiteness, errors against references."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import xarray as xr

from harness.common.arrays import Floats
from harness.identification.whiteness import Whiteness, whiteness
from harness.models.signals import SIGNALS
from harness.recorded.consistency import shares_inside


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
class Summary:
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


def summary(run: xr.Dataset) -> Summary:
    """Return the numbers of a run of ``harness.recorded.run.RecordedEstimator``."""
    nis, nis_inside, _ = shares_inside(run["nis"].to_numpy(), run["nis_degrees"].to_numpy())
    nees = nees_inside = math.nan
    if "nees" in run:
        nees, nees_inside, _ = shares_inside(run["nees"].to_numpy(), run["nees_degrees"].to_numpy())
    normalised = {n: (run[f"innovation_{n}"] / run[f"innovation_std_{n}"]).to_numpy() for n in outputs_of(run)}
    return Summary(
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
    known = values.to_numpy()[np.isfinite(values)]
    return float(known[-1]) if known.size else math.nan


def _error(run: xr.Dataset, name: str) -> Error:
    error = run[f"error_{name}"].to_numpy()
    known = error[np.isfinite(error)]
    share = run[f"nees_{name}"].to_numpy()
    nees, inside, _ = shares_inside(share, np.ones(len(share)))
    if not known.size:
        return Error(math.nan, math.nan, math.nan, nees, inside)
    rmse, largest = float(np.sqrt(np.mean(known**2))), float(np.abs(known).max())
    noise = float(run[f"reference_{name}"].attrs["noise_std"])
    variance = run[f"{name}_std"].to_numpy() ** 2 + noise**2
    both = np.isfinite(error) & np.isfinite(variance)
    with_noise, inside_both, _ = shares_inside(error[both] ** 2 / variance[both], np.ones(int(both.sum())))
    bias, independent = float(known.mean()), _independent(known)
    return Error(rmse, bias, largest, nees, inside, noise, with_noise, inside_both, independent)


def _independent(errors: Floats) -> float:
    """Return of how many independent errors a mean is as certain: those of a first-order process."""
    alike = float(errors[1:] @ errors[:-1]) / max(float(errors @ errors), 1e-300)
    return max(1.0, len(errors) * (1.0 - alike) / (1.0 + alike)) if alike > 0.0 else float(len(errors))


def record(found: Summary) -> dict[str, Any]:
    """Return the numbers as ``estimate.json`` holds them, SI units."""
    return {
        "estimator": found.estimator,
        "recording": found.recording,
        "log_likelihood": found.log_likelihood,
        "samples_with_a_measurement": found.updates,
        "nis_over_degrees": found.nis,
        "nis_inside_95": found.nis_inside,
        "nees_over_degrees": found.nees,
        "nees_inside_95": found.nees_inside,
        "diverged_at": found.diverged_at,
        "repairs": found.repairs,
        "innovations": {
            n: {"variance": w.variance, "ljung_box_p": w.ljung_box, "cumulative_periodogram_p": w.periodogram}
            for n, w in found.whiteness.items()
        },
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
            for n, e in found.errors.items()
        },
        "parameters": {
            n: {"unit": SIGNALS[n].unit, "last": value, "std": std} for n, (value, std) in found.parameters.items()
        },
    }
