"""Mixture of the confusable models of a trace: the plant that can be any of them, and a design for each."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from dataclasses import replace
from typing import Any

from harness.diagnosis.result.outcome import Outcome
from harness.identification.posterior_study import STUDY, Mixture, posterior_study
from harness.models.assembly.placement import split

_MOST = 4
"""Models of the set that are drawn, the likeliest, as many as ``harness next-drive`` tells apart."""

_LONGEST = 60
"""Characters of the name of a design; a model of more has its number."""


def study_of(outcome: Outcome, file: str, confusable: Mapping[str, Any] | None) -> dict[str, str]:
    """Return the study of what the drives leave open, by the name of its file; nothing where none can be made.

    Args:
        outcome: The trace.
        file: The amended model next to the study.
        confusable: As in ``trace.json``.
    """
    if outcome.refused is not None:
        return {}
    study = posterior_study(
        outcome.amended,
        file,
        [(name, error) for name, _, error in outcome.estimates],
        outcome.trace.fitting.drives,
        "The trace is unresolved" if outcome.verdict == "unresolved" else "",
        mixture_of(outcome, confusable),
    )
    return {STUDY: study} if study else {}


def mixture_of(outcome: Outcome, confusable: Mapping[str, Any] | None) -> Mixture | None:
    """Return the models that the drives leave open; ``None`` of fewer than two that can be drawn.

    The plant has the effects of all of them, and whatever any of them moved is as in the nominal model: an effect is
    neutral, and happened before the drive. Each design draws what its model moved.

    Args:
        outcome: The trace.
        confusable: As in ``trace.json``.
    """
    models = list(enumerate(confusable["models"] if confusable else [], 1))
    drawn = [(number, m) for number, m in models[:_MOST] if m["share"] > 0 and _is_drawable(m)]
    if len(drawn) < 2:
        return None
    amended, augmented = outcome.amended, outcome.trace.fitting.augmented
    added = [a[0]["name"] for _, m in drawn for a in m["added"] if a[0]["kind"] == "effect"]
    names = dict.fromkeys([*amended.effects, *added])
    effects = tuple(n for n in names if "@" not in n or split(n)[0] not in names)
    stated = dict(zip(augmented.names, map(float, augmented.stated()), strict=True))
    moved = {e["name"] for _, m in drawn for e in m["estimates"]}
    values = {
        p.name: p.lower if p.per_drive else stated[p.name]
        for p in replace(amended, effects=effects).model().parameters
        if p.name in moved or p.name not in amended.values
    }
    common = frozenset[str].intersection(*(frozenset(_added(m)) for _, m in models))
    names_of = {number: _name(m, number, common) for number, m in models}
    taken = {number for number, _ in drawn}
    return Mixture(
        effects,
        values,
        tuple((names_of[number], number, float(m["share"])) for number, m in drawn),
        tuple(f"{names_of[number]} ({m['share']:.2g})" for number, m in models if number not in taken),
    )


def _added(model: Mapping[str, Any]) -> list[str]:
    """Return the names of what a model has beyond the nominal one, of what is alike the first."""
    return [alike[0]["name"] for alike in model["added"]]


def _is_drawable(model: Mapping[str, Any]) -> bool:
    """Whether a model has parameters, and each a standard error."""
    errors = [e["standard_error"] for e in model["estimates"] if " " not in e["name"]]
    return bool(errors) and all(error is not None and math.isfinite(error) and error > 0 for error in errors)


def _name(model: Mapping[str, Any], number: int, common: frozenset[str]) -> str:
    """Return the name of a model's design: what it has beyond what all models have in common."""
    own = "-and-".join(name for name in _added(model) if name not in common)
    name = re.sub(r"[^A-Za-z0-9._-]", ".", own) or ("nothing-more" if common else "nothing-added")
    return name if len(name) <= _LONGEST and name[0].isalnum() else f"model-{number}"
