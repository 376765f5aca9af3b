"""Parameter that changed between drives: in words, as a table and as ``changed.json``."""

from __future__ import annotations

import math
from typing import Any

from harness.config import ModelSpec
from harness.diagnosis.model.hypotheses import ALL_PARAMETERS
from harness.diagnosis.result.answer import gap
from harness.diagnosis.result.outcome import Outcome
from harness.diagnosis.selection.parameter_changes import Changes, ParameterChange
from harness.models.quantities import print_unit, words
from harness.reporting import style
from harness.reporting.document import Sheet

_SHOWN = 8
"""Parameters in the table."""


def answer(changes: Changes, outcome: Outcome, before: ModelSpec) -> str:
    """Return what changed, in sentences.

    Args:
        changes: Every parameter, refitted alone.
        outcome: What was traced from the model with the likeliest of them.
        before: The model as it was before the change.
    """
    change, added = changes.found, outcome.trace.added
    if change is None and not added:
        return outcome.answer
    sentences = []
    if change is not None:
        sentences = [
            _sentence(change.parameter.name, change.stated, change.value, change.std, change.parameter.unit),
            f"Of all single parameters it explains these drives best.{gap(changes.before, change.held_out)}",
        ]
    for h in added:
        if h.name == ALL_PARAMETERS:
            sentences.append("Further parameters changed, which these drives cannot distinguish.")
        elif h.kind == "effect":
            sentences.append(f"{_capital(h.name.replace('@', ' of '))} was added.")
        else:
            v = outcome.values[h.name][0]
            sentences.append(_sentence(h.name, before.values[h.name], v.value, v.std, v.unit))
    return " ".join(sentences)


def _capital(name: str) -> str:
    text = words(name)
    return text[:1].upper() + text[1:]


def _sentence(name: str, was: float, now: float, spread: float, unit: str) -> str:
    unit = f" {print_unit(unit)}".rstrip()
    return f"{_capital(name)} changed from {style.number(was)} to {style.uncertain(now, spread)}{unit}."


def table(changes: Changes) -> Sheet:
    """Return the parameters as a table, the likeliest change first."""
    header = ["parameter", "unit", "before", "now", "std. error", "gain in BIC", "held-out excess"]
    caption = (
        "Every parameter refitted alone, the likeliest first. Held-out excess: mean square of the simulation "
        "error over the variance of the sensor noise, less one, summed over the outputs; "
        f"{style.number(changes.before.normalised_excess_mse)} as it was before. "
        "The trace starts from the first if that meets the "
        "criteria of an addition, otherwise from the model as it was before."
    )
    return Sheet(header, [_row(c) for c in changes.tried[:_SHOWN]], caption, left=2)


def _row(c: ParameterChange) -> list[str]:
    numbers = (c.stated, c.value, c.std)
    shown = [style.number(n) for n in numbers]
    normalised_excess_mse = (
        style.number(c.held_out.normalised_excess_mse)
        if math.isfinite(c.held_out.normalised_excess_mse)
        else "leaves its range"
    )
    return [words(c.parameter.name), print_unit(c.parameter.unit), *shown, f"{c.bic:.0f}", normalised_excess_mse]


def record(changes: Changes) -> dict[str, Any]:
    """Return the content of ``changed.json`` in SI units."""
    return {
        "found": changes.found.parameter.name if changes.found else None,
        "held_out_excess_before": changes.before.normalised_excess_mse,
        "tried": [
            {
                "name": c.parameter.name,
                "unit": c.parameter.unit,
                "stated": c.stated,
                "value": c.value,
                "std": c.std,
                "bic_gain": c.bic,
                "held_out_log_likelihood": c.held_out.log_likelihood,
                "held_out_excess": c.held_out.normalised_excess_mse,
            }
            for c in changes.tried
        ],
    }
