"""Whiteness of innovations: tests of it, and by how much coloured innovations can move estimates.

The innovations of a right model are white, and the inverse of the Fisher information is the covariance of the
estimates. Otherwise it is ``I^-1 J I^-1`` (White 1982), ``J`` the long-run variance of the scores, here from their sums
over blocks that count as independent. What a model lacks moves the estimates as well: the process noise that takes it
up passes through the same parameters. A fit without process noise is consistent whatever the colour of what is missing,
if that does not depend on the inputs (Ljung 1999, 8.4); by how much it differs says what the colour does to the values
(Hausman 1978).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy import stats
from scipy.stats import chi2

from harness.common.arrays import Floats
from harness.identification.data import DriveData
from harness.identification.filtered_model import FilterRun
from harness.identification.free_run import blocks
from harness.identification.uncertainty import NORMAL, Colour, Summit, covariance_of

LAGS = 20
"""Lags of the Ljung-Box test."""

REJECTED = 0.01
"""p-value below which a series counts as coloured; in a long one that may be little."""

FEWEST = 4 * LAGS
"""Samples below which nothing is tested."""


@dataclass(frozen=True)
class Whiteness:
    """Tests of one series of innovations.

    Attributes:
        variance: Mean square; 1 if the filter states its uncertainty rightly.
        correlation: Sum of the squared correlations with the past, over the lags.
        ljung_box: p-value against correlation over time.
        periodogram: p-value of the cumulative periodogram against that of white noise.
        frequency: Share of the sampling frequency, 0 to 0.5.
        cumulative: Share of the power below it.
        band: Half-width of the 95 % band about the straight line.
    """

    variance: float
    correlation: float
    ljung_box: float
    periodogram: float
    frequency: Floats
    cumulative: Floats
    band: float

    @property
    def p_value(self) -> float:
        """The smaller p-value of the two tests; NaN of a series that is too short."""
        return min(self.ljung_box, self.periodogram)

    @property
    def record(self) -> dict[str, float]:
        """Variance and p-values by the keys of result files."""
        return {
            "variance": self.variance,
            "ljung_box_p": self.ljung_box,
            "cumulative_periodogram_p": self.periodogram,
        }


def is_white(whiteness: Whiteness) -> bool:
    """Whether no test rejects that a series is white; one that is too short is not tested."""
    return not whiteness.p_value < REJECTED


def whiteness(series: Floats) -> Whiteness:
    """Test a series ``(samples,)``; missing samples (NaN) leave the correlation of the others as it is.

    The statistic of Ljung and Box (1978) is ``n (n + 2) sum r_k^2 / (n - k)`` over the lags, chi-square with as many
    degrees of freedom; with gaps, ``n - k`` is the number of pairs. The cumulative periodogram (Bartlett 1955) is
    compared with a straight line by the distribution of Kolmogorov; it joins the samples across gaps.
    """
    seen = np.isfinite(series)
    n = int(seen.sum())
    if n < FEWEST or np.ptp(series[seen]) == 0:
        nothing = np.empty(0)
        mean = float(np.mean(series[seen] ** 2)) if n else np.nan
        return Whiteness(mean, np.nan, np.nan, np.nan, nothing, nothing, np.nan)
    filled = np.where(seen, series - series[seen].mean(), 0.0)
    power = float(filled @ filled) / n
    total = 0.0
    for k in range(1, LAGS + 1):
        pairs = int((seen[k:] & seen[:-k]).sum())
        if pairs:
            r = float(filled[k:] @ filled[:-k]) / pairs / power
            total += pairs * (n + 2) / n * r * r
    spectrum = np.abs(np.fft.rfft(filled[seen])) ** 2
    ordinates = spectrum[1 : (n - 1) // 2 + 1]
    cumulative = np.cumsum(ordinates) / ordinates.sum()
    count = len(ordinates)
    line = np.arange(1, count + 1) / count
    distance = float(np.abs(cumulative - line).max())
    return Whiteness(
        variance=float(np.mean(series[seen] ** 2)),
        correlation=total / (n + 2),
        ljung_box=float(stats.chi2.sf(total, LAGS)),
        periodogram=float(stats.kstwobign.sf(distance * np.sqrt(count - 1))),
        frequency=np.arange(1, count + 1) / n,
        cumulative=cumulative,
        band=float(stats.kstwobign.ppf(0.95) / np.sqrt(count - 1)),
    )


_LITTLE = 1.5
"""Factor on the variance of an estimate below which the colour of the innovations does not matter."""

_SURE = 0.99
"""Share of fits with white innovations whose sums over blocks vary less than what counts as more."""


def coloured_outputs(runs: Sequence[FilterRun], outputs: Sequence[str]) -> tuple[str, ...]:
    """Return the outputs whose whitened innovations are coloured on some recording, whatever that does."""
    columns = zip(*(run.whitened[1:].T for run in runs), strict=True)
    return tuple(
        name for name, drives in zip(outputs, columns, strict=True) if not all(is_white(whiteness(c)) for c in drives)
    )


def block_sums(scores: Sequence[Floats], drives: Sequence[DriveData]) -> Floats:
    """Return the sums of the scores of each drive ``(samples, n)`` over its blocks ``(blocks, n)``."""
    parts = (part for s, d in zip(scores, drives, strict=True) for part in np.array_split(s, blocks(d)))
    return np.array([part.sum(axis=0) for part in parts])


def robust_errors(summit: Summit, sums: Floats) -> Floats:
    """Return the standard error of each coordinate whatever the colour of the innovations ``(n,)``.

    NaN where one is at its bound or the recordings say nothing of it.

    Args:
        summit: Where the likelihood is largest.
        sums: From ``block_sums``.
    """
    determined = np.isfinite(summit.knowledge.error)
    inverse = covariance_of(summit.information[np.ix_(determined, determined)]).matrix
    spread = sums[:, determined].T @ sums[:, determined] + np.diag(summit.space.weight[determined])
    errors = np.full(len(determined), np.nan)
    errors[determined] = np.sqrt(np.diagonal(inverse @ spread @ inverse))
    return errors


def factors(summit: Summit, sums: Floats) -> Floats | None:
    """Return by which factor the colour widens each standard error ``(n,)``; ``None`` if none of a parameter by enough.

    Args:
        summit: Where the likelihood is largest.
        sums: From ``block_sums``.
    """
    ratio = robust_errors(summit, sums) / summit.knowledge.error
    enough = max(_LITTLE, chi2.ppf(_SURE, len(sums)) / len(sums))
    if not (ratio[summit.space.kind("parameter")] ** 2 > enough).any():
        return None
    return np.fmax(ratio, 1.0)


def colour_of(
    outputs: tuple[str, ...], factor: Floats, summit: Summit, silent: Summit | None = None, sums: Floats | None = None
) -> Colour:
    """Return what the colour does to each coordinate of a fit.

    Args:
        outputs: Whose innovations are coloured.
        factor: From ``factors``.
        summit: The fit.
        silent: The fit without process noise, if there is one.
        sums: Of that, from ``block_sums``.
    """
    lower, upper = np.full((2, len(factor)), np.nan)
    if silent is not None and sums is not None:
        half = NORMAL * np.nan_to_num(robust_errors(silent, sums))  # at a bound it is the value
        own, others = summit.space.kind("parameter"), silent.space.kind("parameter")
        lower[own], upper[own] = (silent.z - half)[others], (silent.z + half)[others]
    return Colour(outputs, factor, lower, upper)
