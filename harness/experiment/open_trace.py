"""What a trace left to be told apart: the models of its confusable set, as ``trace.json`` has them."""

from __future__ import annotations

import json
import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from harness.common.arrays import Floats
from harness.common.errors import UserError
from harness.common.files import read_text
from harness.config import ModelSpec
from harness.diagnosis.earlier_trace import TRACE
from harness.diagnosis.result.shown_effects import detection_limits
from harness.experiment.information import fitted_spec
from harness.identification.data import DriveData
from harness.identification.signal_noise import thinned
from harness.models.quantities import words

_MOST = 4
"""Models of the set that are told apart, the likeliest; each is run over what each other leaves."""


@dataclass(frozen=True)
class DrivesSoFar:
    """The drives of a trace.

    Attributes:
        levels: Levels of the process noise: variances per step by state.
        fitted: s of driving that were fitted.
        held_out: s of driving that judged: a trace leaves out the first seconds of a drive.
        spacing: How many steps apart samples of each output are; one where it is not stated.
    """

    levels: tuple[Mapping[str, float], ...]
    fitted: float
    held_out: float
    spacing: Mapping[str, int] = field(default_factory=dict)

    def as_recorded(self, drive: DriveData, outputs: Iterable[str]) -> DriveData:
        """Return a planned drive with samples as far apart as those of the drives so far."""
        return thinned(drive, [self.spacing.get(name, 1) for name in outputs])


@dataclass(frozen=True)
class AtLevel:
    """What the fitted drives say of a model at a level of the process noise, in SI units.

    Attributes:
        log_posterior: With the parameters as fitted.
        gradient: Of that ``(n,)``.
        information: On the parameters ``(n, n)``.
    """

    log_posterior: float
    gradient: Floats
    information: Floats


@dataclass(frozen=True)
class RivalModel:
    """A model of the confusable set.

    Attributes:
        name: What it has beyond the nominal model, in words; of several models without what all of them have.
        added: The same by ``name`` and ``kind``.
        share: Its probability if one of the set is right.
        values: By parameter, as fitted.
        errors: Their standard errors; infinite where the drives say nothing.
        correlation: Of them ``(n, n)``.
        measurement_noise: Variance with which it was fitted, by output.
        at_levels: What the drives so far say of it at each level of the process noise.
    """

    name: str
    added: Sequence[Mapping[str, str]]
    share: float
    values: dict[str, float]
    errors: Floats
    correlation: Floats
    measurement_noise: Mapping[str, float]
    at_levels: tuple[AtLevel, ...]


@dataclass(frozen=True)
class OpenTrace:
    """What a trace left to be told apart.

    Attributes:
        spec: The nominal model.
        rivals: The confusable set, the likeliest first.
        drives: Of the trace.
        none: Probability that none of them is right.
        detectable: By hypothesis and amplitude the detection limit; infinite where the drives could show none.
    """

    spec: ModelSpec
    rivals: tuple[RivalModel, ...]
    drives: DrivesSoFar
    none: float = 0.0
    detectable: Mapping[str, Mapping[str, float]] = field(default_factory=dict)

    def measured_by(self, sensors: str) -> OpenTrace:
        """Return the same before drives with other sensors; what the drives so far say stays.

        Raises:
            UserError: If the noise of one is not known.
        """
        return replace(self, spec=fitted_spec(Path(self.spec.parameters), sensors))


def read_trace(folder: Path, least: int = 2) -> OpenTrace:
    """Return the nominal model of a trace and its confusable set.

    Args:
        folder: Of the trace.
        least: How many models there must be.

    Raises:
        UserError: If the trace left nothing to be told apart, or an older version wrote it.
    """
    file = folder / TRACE
    text = read_text(file)
    try:
        content: dict[str, Any] = json.loads(text)
        confusable, none = content["confusable"], float(content["posterior"]["none_of_these"])
        outputs, noise = list(content["error"]), confusable["noise"]
        seconds = float(noise["fitted_seconds"]), float(noise["held_out_seconds"])
        drives = DrivesSoFar(tuple(noise["levels"]), *seconds, noise.get("spacing", {}))
        each = [r for m in confusable["models"] for r in _rivals(m)]
        rivals = tuple(sorted(each, key=lambda r: -r.share)[:_MOST])
    except (ValueError, KeyError, TypeError) as error:
        raise UserError(f"{file}: holds no confusable set with estimates; run harness trace again") from error
    if len(rivals) < least:
        raise UserError(
            f"{file}: the trace left one model, {rivals[0].name}; nothing is to be told apart; say what to show (--for)"
        )
    rivals = _named_apart(rivals)
    spec = fitted_spec(folder / "nominal.toml", ", ".join(outputs))
    return OpenTrace(spec, rivals, drives, none, _detectable(content.get("candidates", ())))


def _detectable(candidates: Sequence[Mapping[str, Any]]) -> dict[str, dict[str, float]]:
    """Return the detection limits that a trace states; infinite where the drives could show none."""
    return detection_limits(
        (c["name"], c["kind"], {n: math.inf if v is None else float(v) for n, v in c["detectable"].items()})
        for c in candidates
    )


def _rivals(model: dict[str, Any]) -> list[RivalModel]:
    """Return a model of the set, and those with something else that the drives so far cannot tell from an addition."""
    first = _rival(model)
    others = [_in_the_place(first, model, other) for other in model.get("alike", ())]
    return [replace(first, share=first.share - sum(o.share for o in others)), *others]


def _in_the_place(first: RivalModel, model: Mapping[str, Any], other: Mapping[str, Any]) -> RivalModel:
    """Return a model with one addition instead of another, whose amplitude does the same over the drives so far.

    What these say of the amplitude that goes they so say of the one that comes; the shapes that go with it stay fixed.
    So does what is known already of the one that comes, where earlier drives of the vehicle left it free.
    """
    goes, *shapes = other["parameters"]
    kept = [i for i, name in enumerate(first.values) if name not in (*shapes, other["amplitude"])]
    names = [list(first.values)[i] for i in kept]
    # Traces of earlier versions hold no ratio; there both amplitudes are zero in the nominal model.
    ratio = other.get("ratio") or other["value"] / first.values[goes]
    scale = np.array([ratio if n == goes else 1.0 for n in names])
    square = np.ix_(kept, kept)
    at_levels = tuple(
        AtLevel(at.log_posterior, at.gradient[kept] / scale, at.information[square] / np.outer(scale, scale))
        for at in first.at_levels
    )
    added = [
        {"name": other["name"], "kind": other["kind"]} if h["name"] == other["instead_of"] else h for h in first.added
    ]
    return RivalModel(
        _named(added),
        added,
        first.share * other["share"],
        {other["amplitude"] if n == goes else n: other["value"] if n == goes else first.values[n] for n in names},
        first.errors[kept] * np.abs(scale),
        first.correlation[square] * np.outer(np.sign(scale), np.sign(scale)),
        first.measurement_noise,
        at_levels,
    )


def _named_apart(rivals: tuple[RivalModel, ...]) -> tuple[RivalModel, ...]:
    """Return models by what tells them apart: what several of them all have is in no question."""
    each = [{(h["kind"], h["name"]) for h in r.added} for r in rivals]
    common = set.intersection(*each) if len(rivals) > 1 else set()
    return tuple(replace(r, name=_named([h for h in r.added if (h["kind"], h["name"]) not in common])) for r in rivals)


def _named(added: Sequence[Mapping[str, str]]) -> str:
    return " and ".join(words(h["name"].replace("@", " ")) for h in added) or "nothing added"


def _rival(model: dict[str, Any]) -> RivalModel:
    added = [alike[0] for alike in model["added"]]
    rows = model["estimates"]
    errors = [math.inf if e["standard_error"] is None else float(e["standard_error"]) for e in rows]
    at_levels = [
        AtLevel(
            float(level["log_posterior"]),
            np.array(level["gradient"], dtype=float),
            np.array(level["information"], dtype=float).reshape(len(rows), len(rows)),
        )
        for level in model["at_levels"]
    ]
    return RivalModel(
        _named(added),
        added,
        float(model["share"]),
        {e["name"]: float(e["value"]) for e in rows},
        np.array(errors),
        np.array(model["correlation"], dtype=float).reshape(len(rows), len(rows)),
        model["measurement_noise"],
        tuple(at_levels),
    )
