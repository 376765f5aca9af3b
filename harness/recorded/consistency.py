"""Are the innovations of a filter what it says: of the covariance it states (NIS in its band), and white?"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from harness.common.arrays import Floats
from harness.estimation.contract import chi_square_bounds
from harness.identification.data import Drive
from harness.identification.filtered_model import FilterRun
from harness.identification.whiteness import Whiteness, whiteness


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


def consistency(drive: Drive, run: FilterRun, outputs: Iterable[str]) -> Consistency:
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
