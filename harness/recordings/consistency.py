"""Do the signals of a recording agree with each other, and if not, by which sign, unit, delay or lever arm?

A measured signal is explained by what kinematics makes of the others, ``y(t) = k c(t - delay) + offset + arm e(t)``,
with the parameters of least squares (maximum likelihood for white residuals). Standard errors are robust to residuals
that are coloured, as they always are here (Newey and West 1987).
"""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass, replace

import numpy as np
from scipy.signal import correlate

from harness.common.arrays import Floats
from harness.common.errors import UserError
from harness.common.units import registry
from harness.models.signals import SIGNALS
from harness.recordings.derived_signals import Sources
from harness.recordings.redundancy import RELATIONS, Relation

WINDOW = 0.3
"""s, over which both sides are smoothed, so that their bandwidths are alike."""
_LONGEST_DELAY = 0.5
_MEMORY = 1.0
"""s over which the residual is taken to be correlated."""
_RELATED = 0.5
"""Least share of the variance that must be explained for slope and delay to be meaningful."""
_SURE = 4.0
"""Standard errors beyond which a deviation is reported."""
_SAME = 1e-9
"""Residual over signal below which both sides are one and the same channel."""
_MATTERS = 1.5
"""Factor by which a slope of 1 must make the residual's variance worse before the scale is called wrong."""
_BIASED = 0.1
"""Least offset, in standard deviations of the signal, that is reported."""
_UNITS: tuple[tuple[float, str], ...] = (
    (np.degrees(1.0), "degrees where the map says radians"),
    (np.radians(1.0), "radians where the map says degrees"),
    (3.6, "km/h where the map says m/s"),
    (1 / 3.6, "m/s where the map says km/h"),
    (9.80665, "m/s² where the map says g"),
    (1 / 9.80665, "g where the map says m/s²"),
    (1000.0, "a unit a thousand times smaller than the map says"),
    (0.001, "a unit a thousand times larger than the map says"),
)


@dataclass(frozen=True)
class Agreement:
    """How one signal agrees with what the others make of it.

    Attributes:
        relation: Which two were compared.
        samples: Samples on which both are known.
        slope, offset, arm, delay: Values; offset and signal in SI units, arm in m, delay in s (positive: the signal is
            late). ``arm`` is NaN where the relation has none.
        slope_std, offset_std, arm_std, delay_std: Standard errors.
        explained: Share of the variance explained, R squared.
        worse_at_one: By which factor the residual's variance grows if the slope has to be 1.
        residual: Standard deviation of what is left, SI.
        measured, computed: Both sides, smoothed, shape ``(samples of the recording,)``; computed with slope 1.
        step: s between samples.
        findings: What is wrong, with the evidence; empty if they agree.
    """

    relation: Relation
    samples: int
    slope: float
    offset: float
    arm: float
    delay: float
    slope_std: float
    offset_std: float
    arm_std: float
    delay_std: float
    explained: float
    worse_at_one: float
    residual: float
    measured: Floats
    computed: Floats
    step: float
    findings: tuple[str, ...] = ()


def check(signals: dict[str, Floats], step: float, derived: Collection[str] = ()) -> list[Agreement]:
    """Compare every signal with what kinematics makes of the others.

    Args:
        signals: Arrays of shape ``(samples,)`` in SI units by name.
        step: s between samples.
        derived: Signals that were computed from others and so need no check.

    Returns:
        One fit per relation that the signals allow, the exact ones first; a signal with an exact relation is not
        compared by an approximate one of the same kind, and one channel under two names is compared once.
    """
    fits: list[Agreement] = []
    done: set[tuple[str, bool]] = set()
    for relation in sorted(RELATIONS, key=lambda r: not r.exact):
        known = (
            relation.signal in signals and relation.signal not in derived and all(n in signals for n in relation.needs)
        )
        if not known or (relation.signal, relation.sign_only) in done:
            continue
        twin = any(
            f.relation.formula == relation.formula
            and np.array_equal(signals[f.relation.signal], signals[relation.signal], equal_nan=True)
            for f in fits
        )
        fit = None if twin else compare(relation, signals, step)
        if fit is not None:
            fits.append(fit)
            done.add((relation.signal, relation.sign_only))
    return fits


def find_delay(signal: str, signals: dict[str, Floats], step: float, where: str) -> tuple[float, float]:
    """Return how late a signal is and the standard error, both in s, by the first exact relation that it has.

    Raises:
        UserError: If nothing recorded tells when the signal should have come, or the two do not agree well enough.
    """
    for relation in RELATIONS:
        if relation.signal == signal and relation.exact and all(n in signals for n in relation.needs):
            fit = compare(relation, signals, step)
            if fit is not None and fit.explained >= _RELATED:
                return fit.delay, fit.delay_std
            share = "there are too few samples" if fit is None else f"only {fit.explained:.0%} of it is explained"
            raise UserError(
                f"{where}: cannot be estimated against the {relation.formula}: {share}; state it in s, or choose a "
                "part with more manoeuvres by start and stop"
            )
    choices = [" and ".join(r.needs) for r in RELATIONS if r.signal == signal and r.exact]
    hint = f"it takes {' or '.join(choices)}" if choices else "no relation with other signals is known"
    raise UserError(f"{where}: '{signal}' has nothing to be compared with ({hint}); state the delay in s")


def compare(relation: Relation, signals: dict[str, Floats], step: float) -> Agreement | None:
    """Fit one relation; None if too little of both sides is known.

    The delay starts from the peak of the cross-correlation and is refined together with the other parameters.
    """
    sources = Sources(signals, step, WINDOW)
    measured = sources.rate(relation.signal, relation.order)
    computed = relation.compute(sources)
    arm = relation.arm(sources) if relation.arm is not None else None
    usable = np.isfinite(measured) & np.isfinite(computed)
    if usable.sum() * step < 4 * _LONGEST_DELAY or np.nanstd(computed[usable]) == 0 or np.std(measured[usable]) == 0:
        return None
    delay = 0.0 if relation.sign_only else _correlation_peak(measured, computed, step)
    for _ in range(8):
        late, slope_in_time = _delayed(computed, delay, step)
        columns = [late, np.ones_like(late)]
        if arm is not None:
            columns.append(arm)
        rows = np.isfinite(measured) & np.isfinite(slope_in_time)
        rows &= np.isfinite(np.stack(columns)).all(axis=0)
        if rows.sum() < 10 * len(columns):
            return None
        first = np.linalg.lstsq(np.stack(columns, 1)[rows], measured[rows], rcond=None)[0]
        if relation.sign_only:
            design = np.stack(columns, 1)[rows]
            break
        design = np.stack([*columns, -first[0] * slope_in_time], 1)[rows]
        change = np.linalg.lstsq(design, measured[rows] - np.stack(columns, 1)[rows] @ first, rcond=None)[0][-1]
        delay = float(np.clip(delay + np.clip(change, -0.1, 0.1), -2 * _LONGEST_DELAY, 2 * _LONGEST_DELAY))
        if abs(change) < 1e-5:
            break
    regressors = np.stack(columns, 1)[rows]
    left = measured[rows] - regressors @ first
    rest = measured[rows] - regressors[:, 0]
    rest -= regressors[:, 1:] @ np.linalg.lstsq(regressors[:, 1:], rest, rcond=None)[0]
    if left.std() < _SAME * measured[rows].std():
        return None  # one channel under two names says nothing
    spread = _robust_errors(design, left, int(_MEMORY / step))
    fit = Agreement(
        relation=relation,
        samples=int(rows.sum()),
        slope=float(first[0]),
        offset=float(first[1]),
        arm=float(first[2]) if arm is not None else np.nan,
        delay=delay,
        slope_std=spread[0],
        offset_std=spread[1],
        arm_std=spread[2] if arm is not None else np.nan,
        delay_std=0.0 if relation.sign_only else spread[-1],
        explained=float(1 - left.var() / measured[rows].var()),
        worse_at_one=float(rest.var() / left.var()),
        residual=float(left.std()),
        measured=measured,
        computed=computed,
        step=step,
    )
    return _with_findings(fit)


def _correlation_peak(measured: Floats, computed: Floats, step: float) -> float:
    """Return the delay in s at which both are most alike, turned round or not, on the grid of samples."""
    reach = int(_LONGEST_DELAY / step)
    m, c = (np.where(np.isfinite(x), x - np.nanmean(x), 0.0) for x in (measured, computed))
    likeness = np.abs(correlate(m, c, mode="full", method="fft")[len(c) - 1 - reach : len(c) + reach])
    return (int(np.argmax(likeness)) - reach) * step


def _delayed(values: Floats, delay: float, step: float) -> tuple[Floats, Floats]:
    """Return a signal as it would be with a delay, and its slope there."""
    place = np.arange(len(values)) - delay / step
    late = np.interp(place, np.arange(len(values)), values, left=np.nan, right=np.nan)
    return late, np.gradient(late, step)


def _robust_errors(design: Floats, left: Floats, lags: int) -> Floats:
    """Return standard errors of least squares whose residuals are correlated over ``lags`` samples."""
    scores = design * left[:, None]
    meat = scores.T @ scores
    for lag in range(1, min(lags, len(left) - 1) + 1):
        cross = scores[lag:].T @ scores[:-lag]
        meat += (1 - lag / (lags + 1)) * (cross + cross.T)
    bread = np.linalg.pinv(design.T @ design)
    return np.sqrt(np.maximum(np.diag(bread @ meat @ bread), 0.0))


def _with_findings(fit: Agreement) -> Agreement:
    """Say what the fit shows to be wrong."""
    relation = fit.relation
    name = (
        f"{relation.signal} against {'' if relation.formula.startswith('its ') else 'the '}{relation.formula}"
        if relation.exact
        else f"{relation.signal}, {relation.formula}"
    )
    evidence = f"slope {fit.slope:.4g} ± {fit.slope_std:.2g}, R² {fit.explained:.3f}"
    found = []
    if fit.explained < _RELATED:
        if relation.exact:
            found.append(
                f"{name}: hardly related ({evidence}); a wrong channel, strong vibration, or too calm a drive to judge"
            )
    elif fit.slope < 0:
        what = relation.needs[-1] if relation.sign_only else relation.signal
        found.append(f"{name}: wrong sign ({evidence}); set sign = -1 for {what}, or for what it is compared with")
    elif not relation.sign_only:
        found += _scale_findings(fit, name, evidence)
    if fit.explained >= _RELATED and relation.exact and abs(fit.delay) > max(fit.step, _SURE * fit.delay_std):
        late = "late" if fit.delay > 0 else "early"
        found.append(
            f"{name}: {abs(fit.delay) * 1e3:.0f} ± {fit.delay_std * 1e3:.1f} ms {late} ({evidence}); see delay"
        )
    least = max(_SURE * fit.offset_std, _BIASED * float(np.nanstd(fit.measured)))
    if relation.exact and fit.slope > 0 and fit.explained >= _RELATED and abs(fit.offset) > least:
        value, unit = in_report_unit(fit, fit.offset)
        spread, _ = in_report_unit(fit, fit.offset_std)
        found.append(
            f"{name}: offset of {value:.3g} ± {spread:.2g} {unit}; a bias, the mounting, or the bank of the road"
        )
    return replace(fit, findings=tuple(found))


def _scale_findings(fit: Agreement, name: str, evidence: str) -> list[str]:
    """Say whether the slope is that of a wrong unit or of a calibration that is off."""
    tolerance = 0.07 if fit.relation.exact else 0.3
    unit = next((words for ratio, words in _UNITS if abs(np.log(fit.slope / ratio)) < tolerance), None)
    if unit is not None:
        return [f"{name}: wrong unit, probably {unit} ({evidence}); correct the unit in the map"]
    off = abs(fit.slope - 1) > max(0.05, _SURE * fit.slope_std) and fit.worse_at_one > _MATTERS
    if fit.relation.exact and fit.relation.scale and off:
        return [
            f"{name}: wrong scale ({evidence}); set factor = {1 / fit.slope:.4g}, or look at what it is compared with"
        ]
    if not fit.relation.exact and not 0.5 < fit.slope < 2:
        return [f"{name}: wrong scale ({evidence}); look at the units of both"]
    return []


def in_report_unit(fit: Agreement, value: float) -> tuple[float, str]:
    """Return a value that is in the unit of the compared signal as reports show it, with the unit."""
    signal = SIGNALS[fit.relation.signal]
    per = "/s" if fit.relation.order else ""
    return float(registry().Quantity(value, signal.unit).to(signal.report_unit).magnitude), signal.report_unit + per
