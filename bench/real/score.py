"""Score of a trace of a realistic plant against its seal, and the table against what is asked."""

from __future__ import annotations

import json
import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from bench.attribution.score import FAILED, SECONDS
from bench.attribution.tables import header, line, share
from bench.real.run import TRACE
from harness.models.assembly.placement import split

PARAMETER = "parameter:"
SURE = 0.9
"""Probability from which on a thing that is not there counts as claimed."""

QUANTILE = 1.96
"""Of the normal distribution, for intervals of 95 %."""


class Claim(NamedTuple):
    """One thing that a trace says: its name, ``parameter:`` before that of a parameter, and by how much what differs.

    ``sizes`` are difference to the baseline and standard error by the library's parameter; empty without a baseline.
    """

    name: str
    sizes: Mapping[str, tuple[float, float]]


class Answer(NamedTuple):
    """What a trace says, whatever its file looks like.

    ``sets`` are the names in each model of the 90 % set, ``probabilities`` those of effects, by name.
    """

    verdict: str
    claims: tuple[Claim, ...]
    sets: tuple[frozenset[str], ...]
    probabilities: Mapping[str, float]


def answer_of(traced: Mapping[str, Any]) -> Answer:
    """Read ``trace.json``; with a baseline the claims are its changes, and models and probabilities are of changes."""
    claims = _changes(traced["baseline"]["changes"]) if traced.get("baseline") else _additions(traced)
    models = (traced.get("confusable") or {"models": []})["models"]
    sets = tuple(frozenset(_plain(h) for alike in m["added"] for h in alike) for m in models)
    probabilities: dict[str, float] = {}
    for h in (traced.get("posterior") or {"hypotheses": []})["hypotheses"]:
        if h["kind"] == "effect":
            name = _plain(h)
            probabilities[name] = max(probabilities.get(name, 0.0), float(h["probability"]))
    return Answer(str(traced["verdict"]), claims, sets, probabilities)


def _changes(changes: Sequence[Mapping[str, Any]]) -> tuple[Claim, ...]:
    sizes: dict[str, dict[str, tuple[float, float]]] = {}
    for c in changes:
        own = sizes.setdefault(_plain({"name": c["hypothesis"], "kind": c["kind"]}), {})
        if c["change"] is not None and c["std"] is not None:
            own[c["parameter"]] = (float(c["change"]), float(c["std"]))
    return tuple(Claim(name, own) for name, own in sizes.items())


def _additions(traced: Mapping[str, Any]) -> tuple[Claim, ...]:
    claims = [Claim(a["effect"], {}) for a in traced["added"]]
    return (*claims, *(Claim(PARAMETER + a["effect"], {}) for a in traced["parameters"]))


def _plain(h: Mapping[str, str]) -> str:
    return PARAMETER + h["name"] if h["kind"] == "parameter" else split(h["name"])[0]


@dataclass(frozen=True)
class Scored:
    """One case, scored.

    Attributes:
        case: Its name.
        repeat: Its repeat.
        vehicle: Of the plant.
        design: ``baseline`` or ``alone``.
        change: Kind of what has changed; empty if nothing has.
        verdict: What the trace says; ``failed`` if there is none.
        claimed: Names, in their order.
        alarm: Whether it says that something is missing or has changed, with a name or without.
        first: Whether the first of them is right.
        covered: Whether a model of the 90 % set has a right name.
        in_set: Models in that set.
        holds: Whether the 95 % interval of the right claim holds what is true; ``None`` if none can be judged.
        wrong: Largest probability of an effect that is not there; of one that has not changed, with a baseline.
        worse: Whether the model with the additions has a larger error out of sample than the nominal one.
        seconds: Of the trace; NaN if it was interrupted.
    """

    case: str
    repeat: int
    vehicle: str
    design: str
    change: str
    verdict: str
    claimed: tuple[str, ...]
    alarm: bool
    first: bool
    covered: bool
    in_set: int
    holds: bool | None
    wrong: float
    worse: bool
    seconds: float


def score(folder: Path) -> Scored:
    """Compare what was traced in a folder with what its seal says."""
    sealed = json.loads((folder / "sealed.json").read_text(encoding="utf-8"))
    file, with_baseline = folder / TRACE, sealed["design"] == "baseline"
    traced = json.loads(file.read_text(encoding="utf-8")) if file.exists() else None
    answer = answer_of(traced) if traced else Answer("failed", (), (), {})
    change = sealed["change"]
    right = frozenset(change["names"]) if change else frozenset()
    there = right if with_baseline else right | set(sealed["there"])
    seconds = folder / SECONDS
    return Scored(
        sealed["case"],
        sealed["repeat"],
        sealed["vehicle"],
        sealed["design"],
        change["kind"] if change else "",
        answer.verdict,
        tuple(c.name for c in answer.claims),
        bool(answer.claims) or answer.verdict != "adequate",
        bool(answer.claims) and answer.claims[0].name in right,
        any(names & right for names in answer.sets),
        len(answer.sets),
        _holds(answer.claims, change["parameters"]) if change else None,
        max((p for name, p in answer.probabilities.items() if name not in there), default=math.nan),
        _worse(traced["error"]) if traced else False,
        float(seconds.read_text(encoding="utf-8")) if seconds.exists() else math.nan,
    )


def _holds(claims: Iterable[Claim], true: Mapping[str, float]) -> bool | None:
    sizes = {name: size for claim in claims for name, size in claim.sizes.items() if name in true}
    if not sizes:
        return None
    return all(abs(value - true[name]) <= QUANTILE * std for name, (value, std) in sizes.items())


def _worse(error: Mapping[str, Mapping[str, Any]]) -> bool:
    """Whether the mean square of the simulation error over the held-out drives grew, all outputs alike.

    Plain errors: the floor over which a trace judges them is that of its own model. What has no number strays without
    end.
    """
    before, after = ([math.inf if e[k] is None else e[k] for e in error.values()] for k in ("before", "after"))
    if not all(map(math.isfinite, [*before, *after])):
        return sum(map(math.isfinite, after)) < sum(map(math.isfinite, before))
    return float(np.mean([(a / b) ** 2 for a, b in zip(after, before, strict=True)])) > 1.0


def said(folder: Path) -> str:
    """Return a case in a line."""
    s = score(folder)
    right = s.first if s.change else not s.alarm
    return f"{s.verdict}, {', '.join(s.claimed) or 'nothing claimed'}, {'right' if right else 'wrong'}"


def gathered(folder: Path) -> list[Scored]:
    """Return every case of a folder that was traced or could not be, in the order of the names."""
    ended = {f.parents[1] for f in folder.glob(f"*/{TRACE.as_posix()}")} | {
        f.parent for f in folder.glob(f"*/{FAILED}")
    }
    return [score(case) for case in sorted(ended) if (case / "sealed.json").exists()]


def files(folder: Path) -> dict[str, str]:
    """Return scores and tables of a folder by the name of their files."""
    scored = gathered(folder)
    return {"attribution.json": text(scored), "attribution.md": tables(scored) + case_table(scored)}


def text(scored: Sequence[Scored]) -> str:
    """Return cases as JSON; what is not finite is ``null``."""
    plain = [{k: None if v != v else v for k, v in asdict(s).items()} for s in scored]
    return json.dumps(plain, indent=1) + "\n"


def tables(scored: Sequence[Scored]) -> str:
    """Return the table against what is asked, by vehicle, and that of the kinds of change."""
    vehicles = list(dict.fromkeys(s.vehicle for s in scored))
    groups = {v: [s for s in scored if s.vehicle == v] for v in vehicles} | {"all": list(scored)}
    lines = header(["realistic plants", "asked", *groups], 1)
    for what, asked, measured in _ASKED:
        lines.append(line([what, asked, *(measured(cases) for cases in groups.values())]))
    kinds = header(["changed", "cases", "named first", "in the 90 % set", "interval holds it", "named instead"], 1)
    for kind in dict.fromkeys(s.change for s in scored if s.change):
        own = [s for s in scored if s.change == kind]
        instead = ", ".join(sorted({s.claimed[0] if s.claimed else "nothing" for s in own if not s.first}))
        counts = [sum(s.first for s in own), sum(s.covered for s in own)]
        held = [s.holds for s in own if s.holds is not None]
        kinds.append(line([kind, str(len(own)), *map(str, counts), f"{sum(held)} of {len(held)}", instead or "–"]))
    return "\n".join(lines) + "\n\n" + "\n".join(kinds) + "\n"


def _of(cases: Iterable[Scored], design: str, changed: bool) -> list[Scored]:
    return [s for s in cases if s.design == design and bool(s.change) == changed]


def _times(cases: Sequence[Scored], design: str) -> str:
    seconds = [s.seconds for s in cases if s.design == design and math.isfinite(s.seconds)]
    return f"{np.median(seconds):.0f} s, {max(seconds):.0f} s ({len(seconds)})" if seconds else "–"


_ASKED = (
    (
        "baseline, nothing changed: a change claimed",
        "5 %",
        lambda c: share(s.alarm for s in _of(c, "baseline", False)),
    ),
    ("baseline, one changed: named first", "80 %", lambda c: share(s.first for s in _of(c, "baseline", True))),
    ("in the 90 % set", "90 %", lambda c: share(s.covered for s in _of(c, "baseline", True))),
    (
        "its 95 % interval holds the truth",
        "90 %",
        lambda c: share(s.holds for s in _of(c, "baseline", True) if s.holds is not None),
    ),
    ("alone, one changed: in the 90 % set", "75 %", lambda c: share(s.covered for s in _of(c, "alone", True))),
    (
        "a thing that is not there, with 0.9 or more",
        "10 %",
        lambda c: share(s.wrong >= SURE for s in _of(c, "alone", True)),
    ),
    (
        "alone, nothing changed: a thing that is not there",
        "–",
        lambda c: share(s.wrong >= SURE for s in _of(c, "alone", False)),
    ),
    ("larger error out of sample than before", "0", lambda c: share(s.worse for s in c)),
    ("time of a trace, median and longest: alone", "–", lambda c: _times(c, "alone")),
    ("with a baseline", "two of those", lambda c: _times(c, "baseline")),
    ("ended without a report", "0", lambda c: share(s.verdict == "failed" for s in c)),
)
"""What is measured, what is asked of it, and how."""


def case_table(scored: Sequence[Scored]) -> str:
    """Return the list of all cases."""
    lines = header(["case", "verdict", "claimed", "first", "in the set", "interval", "wrong"], 3)
    for s in scored:
        holds = "–" if s.holds is None else ("yes" if s.holds else "no")
        flags = ["yes" if s.first else "no", "yes" if s.covered else "no", holds]
        wrong = "–" if math.isnan(s.wrong) else f"{s.wrong:.2f}"
        lines.append(line([f"{s.case}, {s.repeat}", s.verdict, ", ".join(s.claimed) or "–", *flags, wrong]))
    return "\n## Cases\n\n" + "\n".join(lines) + "\n"
