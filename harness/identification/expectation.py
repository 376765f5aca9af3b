"""Errors that were expected behind planned drives against those that came."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from harness.common.arrays import Floats
from harness.config import ModelSpec
from harness.identification.contract import Estimate
from harness.models.quantities import listed, print_unit, words
from harness.models.signals import SIGNALS
from harness.reporting.style import number

_AS_EXPECTED = 0.2
"""Of the expected one, by which a standard error is off at most: those of ``bench.next_drive`` are by up to 0.17."""


@dataclass(frozen=True)
class ReachedError:
    """An error behind planned drives: the standard error of a parameter, a detection limit, an estimator's error.

    Attributes:
        name: Of what it is the error.
        unit: SI unit.
        before: Before the drives; infinite if nothing was known.
        expected: By the plan; that of a positive parameter in proportion to the value of now.
        reached: With the drives; NaN if it is not stated.
    """

    name: str
    unit: str
    before: float
    expected: float
    reached: float

    @property
    def ratio(self) -> float:
        """Reached over expected one."""
        return self.reached / self.expected

    @property
    def words(self) -> str:
        """As it is reached, in brackets as it was expected and before."""
        reached = f"{number(self.reached)} {print_unit(self.unit)}".rstrip()
        return f"{reached} (expected {number(self.expected)}, before {number(self.before)})"

    @property
    def record(self) -> dict[str, float | None]:
        """All numbers; ``None`` where one is not finite."""
        values = {key: getattr(self, key) for key in ("before", "expected", "reached", "ratio")}
        return {key: value if math.isfinite(value) else None for key, value in values.items()}


def reached_errors(plan: Mapping[str, Any], estimates: Sequence[Estimate], spec: ModelSpec) -> tuple[ReachedError, ...]:
    """Return the standard errors of the parameters that drives were planned for, as far as they are fitted.

    Args:
        plan: ``next_drive.json`` of an identification.
        estimates: Of the fit with the drives.
        spec: The model.
    """
    positive, found = {p.name for p in spec.model().parameters if p.lower > 0}, {e.name: e for e in estimates}
    reached = []
    for name, entry in plan["expected"]["parameters"].items():
        if name not in found:
            continue
        before, expected = (
            math.inf if entry["standard_error"][k] is None else entry["standard_error"][k] for k in ("before", "after")
        )
        share = found[name].value / entry["value"] if name in positive else 1.0
        reached.append(ReachedError(name, entry["unit"], before, share * expected, found[name].error))
    return tuple(reached)


def reached_rmse(
    plan: Mapping[str, Any], estimates: Sequence[Estimate], correlation: Floats
) -> tuple[ReachedError, ...]:
    """Return the errors of estimators that believe a fit; of a plan behind a study, by the regression of that.

    A parameter that is not fitted is as little known as before.

    Args:
        plan: ``next_drive.json``.
        estimates: Of the fit with the drives.
        correlation: Of them ``(n, n)``; empty if the method states none.
    """
    factors, fitted = plan["expected"]["parameters"], {e.name: i for i, e in enumerate(estimates)}
    rows = [k for k, name in enumerate(factors) if name in fitted]
    taken = [fitted[name] for name in factors if name in fitted]
    spread = np.array([entry["standard_error"]["before"] for entry in factors.values()])
    shares = np.array([estimates[i].error for i in taken]) / spread[rows]
    covariance = np.eye(len(spread))
    known = correlation[np.ix_(taken, taken)] if correlation.size else np.nan
    covariance[np.ix_(rows, rows)] = known * np.outer(shares, shares)
    reached = []
    for e in plan["expected"]["errors"]:
        name, unit = f"{words(e['target'])} with {e['estimator']}", SIGNALS[e["target"]].unit
        square = e["square"]["floor"] + float(np.sum(np.array(e["square"]["curvature"]) * covariance))
        now, then = e["rmse"]["before"], e["rmse"]["after"]
        reached.append(ReachedError(name, unit, now, then, math.sqrt(min(max(square, 0.0), now**2))))
    return tuple(reached)


def verdict_of(reached: Sequence[ReachedError], otherwise: str = "") -> str:
    """Return ``as expected``, ``larger`` or ``smaller``: that of the one that is furthest off.

    ``not stated`` where there are no errors, ``not compared`` where it is said why something else was driven.
    """
    if otherwise:
        return "not compared"
    ratios = [r.ratio for r in reached if not math.isnan(r.ratio)]
    if not ratios:
        return "not stated"
    if max(ratios) > 1.0 + _AS_EXPECTED:
        return "larger"
    return "smaller" if min(ratios) < 1.0 - _AS_EXPECTED else "as expected"


INFORMATIVE = {
    "as expected": "The planned drives were as informative as expected",
    "larger": "The planned drives were less informative than expected",
    "smaller": "The planned drives were more informative than expected",
    "not stated": "Whether the planned drives were as informative as expected cannot be said",
}
"""Verdicts in words."""

NOT_COMPARED = "What was expected of the planned drives is not compared"


def in_words(reached: Sequence[ReachedError], otherwise: str = "", rmse: Sequence[ReachedError] = ()) -> str:
    """Return the same in sentences, with the errors of estimators by a study; empty where no drives were planned."""
    if not reached:
        return ""
    if otherwise:
        return f"{NOT_COMPARED}: {otherwise}."
    errors = listed([f"that of {words(r.name)} is {r.words}" for r in reached])
    said = f"{INFORMATIVE[verdict_of([*reached, *rmse])]}: of the standard errors {errors}."
    return f"{said} By the study then off (RMSE): {listed([f'{r.name} by {r.words}' for r in rmse])}." if rmse else said


def record_of_errors(
    reached: Sequence[ReachedError], otherwise: str = "", rmse: Sequence[ReachedError] = ()
) -> dict[str, Any] | None:
    """Return the content of ``after`` in ``identify.json``."""
    if not reached:
        return None
    by_key = {"standard_errors": reached, "errors": rmse}
    return {
        "verdict": verdict_of([*reached, *rmse], otherwise),
        "words": in_words(reached, otherwise, rmse),
        **{key: [{"name": r.name, "unit": r.unit, **r.record} for r in rows] for key, rows in by_key.items()},
    }
