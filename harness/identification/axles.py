"""Cornering stiffness of the axles and understeer gradient that follow from parameters, for reports."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from harness.common.units import scale
from harness.config.derived import axle_parameters, axle_values
from harness.config.specs import ModelSpec
from harness.identification.contract import Fit
from harness.models.quantities import print_unit, words
from harness.reporting import style
from harness.reporting.document import Block, Sheet

_REPORT_UNITS = {"N/rad": "kN/rad", "rad*s^2/m": "deg*s^2/m"}
_STEP = 1e-4
"""Of the differences by which a standard error is carried over, in standard errors of the parameter."""


@dataclass(frozen=True)
class AxleEstimate:
    """One quantity of the axles at their static loads, SI units.

    Attributes:
        name: ``axle_stiffness_<group>`` or ``understeer_gradient``.
        unit: SI unit.
        start: Before the fit.
        value: With what was found.
        error: Standard error by the slopes with the parameters (delta method); NaN where the fit states none.
    """

    name: str
    unit: str
    start: float
    value: float
    error: float


def axle_estimates(fit: Fit) -> list[AxleEstimate]:
    """Return cornering stiffness and understeer gradient before and after a fit, with standard errors."""
    physical = [e for e in fit.estimates if e.name in fit.spec.values]
    before = axle_values(replace(fit.spec, values=fit.spec.values | {e.name: e.start for e in physical}))
    after = axle_values(fit.spec)
    slopes: dict[str, list[float]] = {name: [] for name in after}
    for e in physical:
        step = _STEP * (e.error if math.isfinite(e.error) and e.error > 0 else abs(e.value) or 1.0)
        moved = axle_values(fit.spec, fit.spec.values | {e.name: e.value + step})
        for name in after:
            slopes[name].append((moved[name] - after[name]) / step)
    units = {name: p.unit for name, p in axle_parameters(fit.spec).items()}
    rows = []
    for name, value in after.items():
        parts = np.array([s * e.error if s else 0.0 for s, e in zip(slopes[name], physical, strict=True)])
        n = len(parts)
        correlation = fit.correlation[:n, :n] if fit.correlation.size else np.full((n, n), math.nan)
        rows.append(AxleEstimate(name, units[name], before[name], value, _spread(parts, correlation)))
    return rows


def _spread(parts: np.ndarray, correlation: np.ndarray) -> float:
    moving = parts != 0.0
    if not moving.any():
        return 0.0
    if not np.isfinite(parts).all():
        return math.inf if np.isinf(parts).any() else math.nan
    return math.sqrt(max(float(parts[moving] @ correlation[np.ix_(moving, moving)] @ parts[moving]), 0.0))


def axle_sheet(fit: Fit) -> list[Block]:
    """Return the table of a fit; none of a vehicle without axles."""
    columns = {e.name: (e.start, e.value, e.error) for e in axle_estimates(fit)}
    return _sheet(fit.spec, ("before", "found", "std. error"), columns)


def axle_comparison(models: Mapping[str, ModelSpec]) -> list[Block]:
    """Return the table of several models of one vehicle, by what they are; none of a vehicle without axles."""
    values = [axle_values(spec) for spec in models.values()]
    columns = {name: tuple(v[name] for v in values) for name in values[0]}
    return _sheet(next(iter(models.values())), tuple(models), columns)


def _sheet(spec: ModelSpec, header: tuple[str, ...], columns: Mapping[str, tuple[float, ...]]) -> list[Block]:
    rows = []
    for name, numbers in columns.items():
        unit = axle_parameters(spec)[name].unit
        shown = _REPORT_UNITS[unit]
        factor = 1 / scale(shown, unit, name)
        rows.append([words(name), print_unit(shown), *(style.number(factor * x) for x in numbers)])
    caption = "What follows for the axles at their static loads, without effects."
    return [Sheet(["quantity", "unit", *header], rows, caption, left=2)] if rows else []
