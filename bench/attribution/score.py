"""Score of the trace of one case against its seal."""

from __future__ import annotations

import json
import math
from collections.abc import Container, Mapping, Sequence
from dataclasses import asdict, dataclass, fields
from pathlib import Path
from typing import Any

from harness.diagnosis.criteria import EXCESS
from harness.models.assembly.placement import split
from harness.models.quantities import print_unit
from harness.reporting import style

MAGNITUDES = ("small", "medium", "large")
FAILED = "failed.txt"
"""In a case's folder: why it could not be traced, which counts as a wrong answer."""

SECONDS = "seconds.txt"
"""In a case's folder: how long its trace took on all cores, without compilation."""

NOTHING, UNRESOLVED, PARAMETER, CURVE = "nothing", "unresolved", "a parameter", "a curve"
"""First claims of a trace that names no effect."""

_PARAMETER = "parameter:"
_UNTRACED: dict[str, Any] = {
    "verdict": "failed",
    **{key: [] for key in ("added", "parameters", "candidates")},
    **dict.fromkeys(("confusable", "posterior")),
    "excess": {"before": None, "after": None},
}
_SHOWN = {"rad": (180.0 / math.pi, "°"), "N": (1e-3, "kN"), "N*m": (1e-3, "kN·m"), "s": (1e3, "ms")}
"""Factor and unit in which sizes are shown."""


@dataclass(frozen=True)
class Scored:
    """One case, scored.

    Attributes:
        case: Its name.
        repeat: Its repeat.
        vehicle: Of the plant.
        kind: ``none``, ``parameters``, ``effect``, ``pair`` or ``unlisted``.
        magnitude: ``small``, ``medium``, ``large`` or empty.
        verdict: What the trace says; ``failed`` if there is none.
        expected: What it should say.
        true: Names of the effects that are there.
        claimed: Effects added, in their order.
        first: The first claim: an effect, the true one where the claim is an equivalent of it, or one of the words
            for traces that name none; of an unlisted effect ``unresolved`` where that is the verdict.
        named: How many of the true effects were added, under their own name or an equivalent.
        found: The same, or stand in the confusable set.
        extra: Effects added that are not true.
        misplaced: True effects that were added, but at another axle, body or sensor.
        right: Whether the case counts as solved.
        closed: Share of the gap between nominal model and oracle that was closed, on the root of the held-out excess;
            NaN if there was no gap.
        oracle: Held-out excess of the oracle; NaN if the sensors' noise is the floor.
        errors: Relative error of each parameter that both sides name.
        size: What the first true effect is, in the plant's words.
        reach: Its size over the smallest one that the score test said these drives could show (three standard errors);
            NaN if the library has no such parameter.
        quality: Of the recordings, of ``run.QUALITIES``.
        recording: Faults of the recording that were named; they are there, and no claim about the vehicle.
        covered: Whether one model of the confusable set has all true effects.
        in_set: Models in that set; 0 if there is none.
        wrong: Largest probability of an effect that is not there; NaN if there are no probabilities.
        seconds: Of the trace; NaN if it did not have all cores from its beginning to its end.
    """

    case: str
    repeat: int
    vehicle: str
    kind: str
    magnitude: str
    verdict: str
    expected: str
    true: tuple[str, ...]
    claimed: tuple[str, ...]
    first: str
    named: int
    found: int
    extra: tuple[str, ...]
    misplaced: tuple[str, ...]
    right: bool
    closed: float
    oracle: float
    errors: dict[str, float]
    size: str
    reach: float
    quality: str = "clean"
    recording: tuple[str, ...] = ()
    covered: bool = False
    in_set: int = 0
    wrong: float = math.nan
    seconds: float = math.nan


def score(folder: Path, traced_in: str = "trace") -> Scored:
    """Compare what was traced in a folder with what the seal says.

    Args:
        folder: Holds ``sealed.json``, and ``oracle.json`` if one was fitted.
        traced_in: Folder in it with the ``trace.json``; where there is none the trace ended in an error.
    """
    sealed, trace = json.loads((folder / "sealed.json").read_text()), folder / traced_in / "trace.json"
    traced = json.loads(trace.read_text()) if trace.exists() else _UNTRACED
    traced, recording = _of_vehicle(traced, sealed)
    oracle = _oracle(folder / "oracle.json")
    accepted = {name: e["name"] for e in sealed["effects"] for name in (e["name"], *e["equivalent"])}
    claimed = [a["effect"] for a in traced["added"]]
    named = {accepted.get(n) for n in (*claimed, *(_PARAMETER + a["effect"] for a in traced["parameters"]))} - {None}
    alike = {accepted.get(n) for n in _alike(traced)} if claimed or traced["parameters"] else set()
    candidates = named | (alike - {None})
    first_effect = sealed["effects"][0] if sealed["effects"] else None
    return Scored(
        sealed["case"],
        sealed["repeat"],
        sealed["vehicle"],
        sealed["kind"],
        next((m for m in MAGNITUDES if sealed["case"].endswith(f"-{m}")), ""),
        traced["verdict"],
        _expected(sealed, claimed, named),
        tuple(e["name"] for e in sealed["effects"]),
        tuple(claimed),
        _first(traced, accepted, sealed["kind"]),
        len(named),
        len(candidates),
        tuple(n for n in claimed if n not in accepted),
        tuple(e["name"] for e in sealed["effects"] if _misplaced(e, traced["added"])),
        _right(sealed, traced["verdict"], claimed, len(candidates)),
        _closed(traced["excess"], oracle),
        oracle,
        _errors(traced, sealed),
        _size(first_effect, sealed["noise"]) if first_effect else "",
        _reach(first_effect["oracle"]["parameters"], traced["candidates"]) if first_effect else math.nan,
        sealed.get("quality", "clean"),
        recording,
        any({accepted.get(n) for n in names} >= set(accepted.values()) for names in _sets(traced)),
        len(_sets(traced)),
        _wrong(traced, {*accepted, *(f["name"] for f in sealed.get("recording", []))}),
        float((folder / SECONDS).read_text(encoding="utf-8")) if (folder / SECONDS).exists() else math.nan,
    )


def _of_vehicle(traced: Mapping[str, Any], sealed: Mapping[str, Any]) -> tuple[dict[str, Any], tuple[str, ...]]:
    """Return what a trace says of the vehicle, and which faults of the recording it named.

    A delay or a drift of the recording that is there, and is named as such, is a finding about the file. A model that
    was amended by such faults alone is an adequate one of the vehicle.
    """
    true = {name for e in sealed["effects"] for name in (e["name"], *e["equivalent"])}
    faults = [(f["name"], f["place"]) for f in sealed.get("recording", []) if f["name"] not in true]

    def of_recording(a: Mapping[str, Any]) -> bool:
        place = a.get("place")
        return any(a["effect"] == name and (not place or not at or place == at) for name, at in faults)

    named = [a for a in traced["added"] if of_recording(a)]
    remaining = [a for a in traced["added"] if not of_recording(a)]
    verdict = "adequate" if named and not remaining and traced["verdict"] == "amended" else traced["verdict"]
    return {**traced, "added": remaining, "verdict": verdict}, tuple(a["effect"] for a in named)


def _expected(sealed: Mapping[str, Any], claimed: Sequence[str], named: Container[str]) -> str:
    """Return the verdict that is right: of effects that were found as parameters of the model, that it is adequate."""
    as_parameters = not claimed and bool(sealed["effects"]) and all(e["name"] in named for e in sealed["effects"])
    return "adequate" if as_parameters else str(sealed["expected_verdict"])


def _oracle(file: Path) -> float:
    excess = json.loads(file.read_text(encoding="utf-8"))["excess"] if file.exists() else None
    return math.nan if excess is None else float(excess)


def _alike(traced: Mapping[str, Any]) -> set[str]:
    """Return everything in the confusable set, parameters with their prefix."""
    return {name for names in _sets(traced) for name in names}


def _sets(traced: Mapping[str, Any]) -> list[set[str]]:
    """Return what each model of the confusable set has, parameters with their prefix."""
    models = (traced["confusable"] or {"models": []})["models"]
    return [{_plain(h) for alike in m["added"] for h in alike} for m in models]


def _plain(h: Mapping[str, str]) -> str:
    return _PARAMETER + h["name"] if h["kind"] == "parameter" else split(h["name"])[0]


def _wrong(traced: Mapping[str, Any], there: Container[str]) -> float:
    """Return the largest probability of an effect that is not there, whatever its place.

    Models with it at several places are counted more than once, so that it is at most that of any of the models.
    """
    if not traced.get("posterior"):
        return math.nan
    probabilities: dict[str, float] = {}
    most = 1.0 - traced["posterior"]["none_of_these"]
    for h in traced["posterior"]["hypotheses"]:
        if h["kind"] == "effect" and _plain(h) not in there:
            probabilities[_plain(h)] = min(most, probabilities.get(_plain(h), 0.0) + h["probability"])
    return max(probabilities.values(), default=0.0)


def _first(traced: Mapping[str, Any], accepted: Mapping[str, str], kind: str) -> str:
    if kind == "unlisted" and traced["verdict"] == UNRESOLVED:
        return UNRESOLVED  # what was added, the answer says, explains a part
    for a in traced["added"]:
        return accepted.get(a["effect"], a["effect"])
    for a in traced["parameters"]:
        if _PARAMETER + a["effect"] in accepted:
            return accepted[_PARAMETER + a["effect"]]
    if traced["verdict"] in (UNRESOLVED, "failed"):
        return str(traced["verdict"])
    if traced["verdict"] == "amended":
        return CURVE
    return PARAMETER if traced["parameters"] else NOTHING


def _misplaced(effect: Mapping[str, Any], added: Sequence[Mapping[str, Any]]) -> bool:
    """Whether an effect was added, but nowhere with a parameter that it really has."""
    true = effect["oracle"]["parameters"].keys()
    same = [a for a in added if a["effect"] == effect["name"]]
    return bool(true and same) and not any(true & a["parameters"].keys() for a in same)


def _right(sealed: Mapping[str, Any], verdict: str, claimed: Sequence[str], accepted: int) -> bool:
    if verdict == "failed":
        return False
    match sealed["kind"]:
        case "none" | "parameters":
            return not claimed and verdict != "amended"
        case "unlisted":
            return verdict == UNRESOLVED
    return accepted == len(sealed["effects"])


def _closed(excess: Mapping[str, float | None], oracle: float) -> float:
    """Return the share of the gap that was closed; a model that leaves the range of its equations strays without end.

    An oracle that does no better than the nominal model is no oracle; then the sensors' noise is the floor.
    """
    before, after = (math.inf if e is None else e for e in (excess["before"], excess["after"]))
    floor = oracle if oracle < before else 0.0
    if before - floor <= EXCESS:
        return math.nan
    if math.isinf(after):
        return 0.0
    if math.isinf(before):
        return 1.0
    return (math.sqrt(before) - math.sqrt(after)) / (math.sqrt(before) - math.sqrt(floor))


def _errors(traced: Mapping[str, Any], sealed: Mapping[str, Any]) -> dict[str, float]:
    values = {name: p["value"] for a in traced["added"] for name, p in a["parameters"].items()}
    same = [e["oracle"]["parameters"] for e in sealed["effects"] if e["oracle"]["form"] == "same"]
    true = {n: v for parameters in same for n, v in parameters.items()}
    return {n: abs(values[n] / v - 1.0) for n, v in true.items() if values.get(n) is not None and v != 0.0}


def _size(effect: Mapping[str, Any], noise: Mapping[str, float]) -> str:
    """Write the first parameter of an effect; one without a unit of its own in standard deviations of its channel."""
    first = next(iter(effect["parameters"].values()))
    value, unit = abs(first["value"]), first["unit"]
    if unit == "":
        return f"{style.number(value / noise[effect['place']])} σ"
    factor, shown = _SHOWN.get(unit, (1.0, print_unit(unit)))
    return style.with_unit(factor * value, shown)


def _reach(true: Mapping[str, float], candidates: Sequence[Mapping[str, Any]]) -> float:
    """Return the size over the limit that the first round predicts.

    An amplitude's limit is that of the hypothesis with the fewest others beside it; of several amplitudes the one
    that shows best counts.
    """
    limits = [c["detectable"] for c in candidates if c["round"] == 1 and c["kind"] == "effect"]
    reached = []
    for name, value in true.items():
        of_name = [limit for limit in limits if name in limit]
        if of_name:
            least = min(of_name, key=len)[name]
            reached.append(0.0 if least is None else abs(value) / least)
    return max(reached, default=math.nan)


def load(file: Path) -> list[Scored]:
    """Return what ``text`` wrote."""
    return [of_plain(case) for case in json.loads(file.read_text(encoding="utf-8"))]


def text(scored: Sequence[Scored]) -> str:
    """Return cases as JSON."""
    return json.dumps([as_plain(s) for s in scored], indent=1) + "\n"


def as_plain(scored: Scored) -> dict[str, Any]:
    """Return a case as JSON takes it; what is not finite is ``None``."""
    return {k: None if isinstance(v, float) and not math.isfinite(v) else v for k, v in asdict(scored).items()}


def of_plain(case: Mapping[str, Any]) -> Scored:
    """Return a case of what ``as_plain`` made of it."""
    lists = {f.name for f in fields(Scored) if str(f.type).startswith("tuple")}
    numbers = {f.name for f in fields(Scored) if f.type == "float"}

    def restored(name: str, value: Any) -> Any:
        if name in lists:
            return tuple(value)
        return math.nan if name in numbers and value is None else value

    return Scored(**{name: restored(name, value) for name, value in case.items()})
