"""Score of the trace of one case against the truth, and the table of all."""

from __future__ import annotations

import json
import math
import tomllib
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from bench.attribution.score import CURVE, FAILED
from bench.foreign.cases import CASES, TRUTH
from bench.foreign.run import TRACE
from harness.diagnosis.model.hypotheses import ALL_PARAMETERS
from harness.models.assembly.placement import split
from harness.models.quantities import words

SURE = 0.9
"""Probability from which on a wrong name of an effect that the library lacks is a wrong answer."""

STANDARD_ERRORS = 3.0
"""By which one of many values differs from the stated one if it is named as wrong."""

_OF_INPUTS = {"steering_delay": "steering_wheel_angle", "speed_delay": "speed"}


@dataclass(frozen=True)
class Scored:
    """One case, scored.

    Attributes:
        case: Its letter.
        missing: What is missing, in words.
        verdict: What the trace says; ``failed`` if there is none.
        vehicle: What was added that is no fault of the recording which is there: ``name`` or ``name@place``.
        recording: Faults of the recording that were named and are there, one that was planted in a sensor among them.
        parameters: Stated values that were named as wrong.
        truth: Probability of what is missing; NaN if the library has no word for it, or there are no probabilities.
        none: Probability of none of these; NaN if there are no probabilities.
        delay: Largest error of how much later one channel is than another, in ms; NaN if there is no trace.
        right: Whether the case counts as solved.
    """

    case: str
    missing: str
    verdict: str
    vehicle: tuple[str, ...]
    recording: tuple[str, ...]
    parameters: tuple[str, ...]
    truth: float
    none: float
    delay: float
    right: bool


def gathered(out: Path) -> list[Scored]:
    """Return every case of a folder that was traced or could not be, scored, in the order of their letters."""
    ended = [out / name for name in CASES if (out / name / TRACE).exists() or (out / name / FAILED).exists()]
    return [score(folder) for folder in ended]


def score(folder: Path) -> Scored:
    """Compare what was traced in a folder with what is true; where there is no trace it ended in an error."""
    true = json.loads((folder / TRUTH).read_text(encoding="utf-8"))
    if not (folder / TRACE).exists():
        return Scored(true["name"], true["missing"], "failed", (), (), (), math.nan, math.nan, math.nan, False)
    traced = json.loads((folder / TRACE).read_text(encoding="utf-8"))
    stated = tomllib.loads((folder / "nominal.toml").read_text(encoding="utf-8"))["values"]
    return compare(true, traced, stated)


def compare(true: Mapping[str, Any], traced: Mapping[str, Any], stated: Mapping[str, float]) -> Scored:
    """Score the content of a ``trace.json``.

    Args:
        true: Content of ``truth.json``.
        traced: Content of ``trace.json``.
        stated: Values of the nominal model.
    """
    added = [_placed(a) for a in traced["added"]]
    vehicle = [name for name in added if name not in true["faults"]]
    vehicle += [CURVE] if traced["verdict"] == "amended" and traced["unnamed"] else []
    return Scored(
        true["name"],
        true["missing"],
        traced["verdict"],
        tuple(vehicle),
        tuple(name for name in added if name in true["faults"]),
        _wrong_values(traced["parameters"], stated),
        _probability(true, traced["posterior"]),
        traced["posterior"]["none_of_these"] if traced["posterior"] else math.nan,
        _delay_error(true["delays"], traced["added"]),
        _right(true, added, vehicle, traced["posterior"]),
    )


def _placed(added: Mapping[str, Any]) -> str:
    return f"{added['effect']}@{added['place']}" if added["place"] else str(added["effect"])


def _right(
    true: Mapping[str, Any], added: Collection[str], vehicle: Collection[str], posterior: Mapping[str, Any] | None
) -> bool:
    """Return whether a case is solved; an effect that is a wrong parameter under another name is no claim."""
    claims = [name for name in vehicle if name not in true["values"]]
    match true["kind"]:
        case "nothing" | "parameters":
            return not claims
        case "sensor":
            return set(true["effects"]) <= set(added) and not claims
        case "unlisted":
            return _surest_wrong(true, posterior) < SURE if posterior else not claims
    return set(true["effects"]) <= set(added)


def _surest_wrong(true: Mapping[str, Any], posterior: Mapping[str, Any]) -> float:
    """Return the largest probability of an effect that is not there, all its places together.

    Models with it at several places are counted more than once, so that it is at most that of any of the models.
    """
    probabilities: dict[str, float] = {}
    most = 1.0 - posterior["none_of_these"]
    for h in posterior["hypotheses"]:
        if h["kind"] == "effect" and h["name"] not in true["faults"]:
            name = split(h["name"])[0]
            probabilities[name] = min(most, probabilities.get(name, 0.0) + h["probability"])
    return max(probabilities.values(), default=0.0)


def _probability(true: Mapping[str, Any], posterior: Mapping[str, Any] | None) -> float:
    """Return the probability of all models that say what is true.

    Of an effect those are the models that have it, of wrong parameters those with all of them or with all parameters
    at once and no effect that is not there, of nothing those that have faults of the recording alone.
    """
    if not posterior or true["kind"] == "unlisted":
        return math.nan
    return float(sum(m["probability"] for m in posterior["models"] if _says(true, m["added"])))


def _says(true: Mapping[str, Any], model: Sequence[Sequence[Mapping[str, str]]]) -> bool:
    names = {h["name"] for alike in model for h in alike}
    if true["kind"] in ("effect", "sensor"):
        return names >= set(true["effects"])
    true_names = {*true["faults"], *true["values"], *([ALL_PARAMETERS] if true["values"] else [])}
    claimed = any(all(h["name"] not in true_names for h in alike) for alike in model)
    return not claimed and (ALL_PARAMETERS in names or names >= true["values"].keys())


def _wrong_values(parameters: Sequence[Mapping[str, Any]], stated: Mapping[str, float]) -> tuple[str, ...]:
    """Return the stated values that are named as wrong; of all parameters at once those that moved beyond doubt."""
    names: list[str] = []
    for each in parameters:
        every = each["effect"] != ALL_PARAMETERS
        names += [
            name
            for name, v in each["parameters"].items()
            if every or abs(v["value"] - stated[name]) > STANDARD_ERRORS * v["std"]
        ]
    return tuple(names)


def _delay_error(true: Mapping[str, float], added: Sequence[Mapping[str, Any]]) -> float:
    """Return the largest error of how much later one channel is than another, in ms.

    A channel of which no delay was found is as late as the others of which none was; the speed counts where its delay
    was found, because a drive hardly shows it. A steering wheel that is recorded late is a negative delay of the
    steering.

    Args:
        true: Delays of the channels in s.
        added: Effects that a trace added.
    """
    delays = dict.fromkeys((signal for signal in true if signal != "speed"), 0.0)
    for a in added:
        value = next((p["value"] for p in a["parameters"].values()), 0.0)
        if a["effect"] in _OF_INPUTS:
            delays[_OF_INPUTS[a["effect"]]] = -value
        elif a["effect"] == "sensor_delay":
            delays[a["place"]] = value
    errors = [delays[signal] - true[signal] for signal in delays]
    return 1e3 * (max(errors) - min(errors))


HEAD = (
    "case",
    "missing",
    "verdict",
    "named of the vehicle",
    "named of the recording",
    "wrong values",
    "probability of the truth",
    "of none of these",
    "delays off by, ms",
    "right",
)


def table(scored: Sequence[Scored]) -> str:
    """Return the cases as a table in Markdown."""
    rows = [
        (
            s.case,
            s.missing,
            f"`{s.verdict}`",
            _named(s.vehicle),
            _named(s.recording),
            _named(s.parameters),
            _number(s.truth, 3),
            _number(s.none, 3),
            _number(s.delay, 1),
            "yes" if s.right else "no",
        )
        for s in scored
    ]
    lines = [HEAD, ("---",) * 6 + ("--:",) * 3 + ("---",), *rows]
    return "".join(f"| {' | '.join(line)} |\n" for line in lines)


def _named(names: Sequence[str]) -> str:
    """Return names in words, each once with all its places."""
    places: dict[str, list[str]] = {}
    for name, place in map(split, names):
        places.setdefault(words(name), []).extend([words(place)] if place else [])
    return "; ".join(f"{name} ({', '.join(at)})" if at else name for name, at in places.items()) or "–"


def _number(value: float, digits: int) -> str:
    return "–" if math.isnan(value) else f"{value:.{digits}f}"
