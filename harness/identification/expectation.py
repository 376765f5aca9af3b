"""Standard errors that were expected behind planned drives against those that came."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from harness.config import ModelSpec
from harness.identification.contract import Estimate
from harness.models.quantities import listed, print_unit, words
from harness.reporting.style import number

_AS_EXPECTED = 0.2
"""Of the expected one, by which a standard error is off at most: those of ``bench.next_drive`` are by up to 0.17."""


@dataclass(frozen=True)
class ReachedError:
    """The standard error of a parameter behind planned drives.

    Attributes:
        name: Of the parameter.
        unit: SI unit.
        before: Before the drives; infinite if nothing was known.
        expected: By the plan; that of a positive parameter in proportion to the value of now.
        reached: Of the fit with the drives; NaN if its method states none.
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


def verdict_of(reached: Sequence[ReachedError], otherwise: str = "") -> str:
    """Return ``as expected``, ``larger`` or ``smaller``: that of the parameter that is furthest off.

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


def in_words(reached: Sequence[ReachedError], otherwise: str = "") -> str:
    """Return the same in a sentence; empty where no drives were planned."""
    if not reached:
        return ""
    if otherwise:
        return f"What was expected of the planned drives is not compared: {otherwise}."
    verdict = {
        "as expected": "The planned drives told what was expected",
        "larger": "The planned drives told less than was expected",
        "smaller": "The planned drives told more than was expected",
        "not stated": "Whether the planned drives told what was expected this method cannot say",
    }[verdict_of(reached)]
    errors = listed([
        f"that of {words(r.name)} is {number(r.reached)} {print_unit(r.unit)}".rstrip()
        + f" (expected {number(r.expected)}, before {number(r.before)})"
        for r in reached
    ])  # fmt: skip
    return f"{verdict}: of the standard errors {errors}."


def record_of_errors(reached: Sequence[ReachedError], otherwise: str = "") -> dict[str, Any] | None:
    """Return the content of ``after`` in ``identify.json``."""
    if not reached:
        return None
    return {
        "verdict": verdict_of(reached, otherwise),
        "words": in_words(reached, otherwise),
        "standard_errors": [
            {"name": r.name, "unit": r.unit}
            | {
                key: value if math.isfinite(value) else None
                for key in ("before", "expected", "reached", "ratio")
                for value in [getattr(r, key)]
            }
            for r in reached
        ],
    }
