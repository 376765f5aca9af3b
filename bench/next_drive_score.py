"""Score of ``bench.next_drive_proof``: names that stand behind further drives, against the seals and what was expected.

A model is named by the effects that it has, wherever they act: parameters that it moves are no claim. Of names that
stand together in a model, as no drive so far tells them apart, each has a share of its probability. Probabilities are
those of the trace, beside which none of its models may be right. In field quality delays, drifts and a wheel radius are
of the recording and of no name.
"""

from __future__ import annotations

import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise, product
from pathlib import Path
from textwrap import fill
from typing import Any

import numpy as np

from bench.attribution.score import FAILED
from bench.attribution.tables import share
from harness.common.arrays import Floats
from harness.common.files import renewed, write_files
from harness.diagnosis.earlier_trace import models_left
from harness.models.assembly.placement import split
from harness.reporting import style

FIRST, PLANNED = "trace", "plan.json"
"""In a case's folder: the trace of the calm drives; drives, seconds and expectations of each arm."""

AS_LONG = ("designed", "sweep", "random")
"""What is driven: as planned, and by the rules of ISO 7401 for as long."""

ARMS = (*AS_LONG, *(f"{arm} twice" for arm in AS_LONG))
"""With each for twice as long, where no name stood then."""

STANDS = 0.95
"""Probability from which a name stands."""

OF_RECORDING = frozenset(
    {"sensor_delay", "steering_delay", "speed_delay", "sensor_bias", "sensor_drift", "wheel_radius_error"}
)
"""Effects that a recording in field quality has anyway."""

PAGE = Path(__file__).parents[1] / "docs" / "next-drive.md"
PICTURE = "next-drive-reliability.svg"
MARKS = ("<!-- written by python -m bench.next_drive_proof -->", "<!-- end -->")

_WIDTH = 120
"""Columns of a line of the page."""

Name = tuple[frozenset[str], frozenset[str]]
"""Effects that a model has, and the parameters that it moves."""


def names_in(traced: Mapping[str, Any], is_field: bool) -> dict[Name, float]:
    """Return the probability of every name of a trace; what they lack of one is that of none of these."""
    models = (traced["posterior"] or {"models": []})["models"]
    names: dict[Name, float] = {}
    for m in models:
        together = {_name(hypotheses, is_field) for hypotheses in product(*m["added"])}
        for name in together:
            names[name] = names.get(name, 0.0) + m["probability"] / len(together)
    return names


def _name(hypotheses: Sequence[Mapping[str, str]], is_field: bool) -> Name:
    effects = frozenset(split(h["name"])[0] for h in hypotheses if h["kind"] != "parameter")
    parameters = frozenset(h["name"] for h in hypotheses if h["kind"] == "parameter")
    return effects - (OF_RECORDING if is_field else set()), parameters


def standing(traced: Mapping[str, Any], is_field: bool) -> frozenset[str] | None:
    """Return the effects of the name that stands, if one does."""
    by_effects: dict[frozenset[str], float] = {}
    for (effects, _), p in names_in(traced, is_field).items():
        by_effects[effects] = by_effects.get(effects, 0.0) + p
    return next((effects for effects, p in by_effects.items() if p >= STANDS), None)


def probability_of_right(traced: Mapping[str, Any], sealed: Mapping[str, Any]) -> float:
    """Return the probability of the name that is right; an effect's equal counts as the effect."""
    is_field = sealed["quality"] == "field"
    accepted = {n: e["name"] for e in sealed["effects"] for n in (e["name"], *e["equivalent"])}
    true = {e["name"] for e in sealed["effects"]} - (OF_RECORDING if is_field else set())

    def is_right(name: Name) -> bool:
        effects, parameters = name
        claimed = {accepted.get(n, n) for n in effects}
        equal = {accepted[f"parameter:{n}"] for n in parameters if f"parameter:{n}" in accepted}
        return claimed | equal == true

    return sum(p for name, p in names_in(traced, is_field).items() if is_right(name))


@dataclass(frozen=True)
class Driven:
    """An arm of a case.

    Attributes:
        seconds: Of driving behind the calm drives; those of the arm half as long where a name stood behind that.
        expected: Probability of the right name that was expected, if one of the planned models is right.
        right: Probability of the right name behind the drives.
        stands: Whether a name stands.
        none: Probability that none of the models is right.
    """

    seconds: float
    expected: float
    right: float
    stands: bool
    none: float

    @property
    def settled(self) -> bool:
        """Whether the right name stands."""
        return self.right >= STANDS

    @property
    def misled(self) -> bool:
        """Whether a wrong name stands."""
        return self.stands and not self.settled


@dataclass(frozen=True)
class Open:
    """A case whose calm drives left several names.

    Attributes:
        case: Its name and draw.
        group: Vehicle and quality.
        commit: Of the code that planned.
        before: Probability of the right name behind the calm drives.
        held: Whether one of the models that the plan told apart has the right name.
        arms: By name.
    """

    case: str
    group: str
    commit: str
    before: float
    held: bool
    arms: dict[str, Driven]


@dataclass(frozen=True)
class Scored:
    """All cases of a folder.

    Attributes:
        traced: By group, cases whose calm drives were traced.
        alone: By group, those in which no name stands though one model is left, for which nothing is planned: its names
            stand together, or none of these may be right.
        opened: Those that left several names and were driven in every arm.
        failed: By group, cases that ended in an error.
    """

    traced: dict[str, int]
    alone: dict[str, int]
    opened: tuple[Open, ...]
    failed: dict[str, int]


def scored_cases(out: Path) -> Scored:
    """Return the cases of a folder of ``bench.next_drive_proof`` against their seals."""
    traced, alone, failed, opened = {}, {}, {}, []
    for group in sorted(p for p in out.glob("*-*") if p.is_dir()):
        first = sorted(group.glob(f"*/{FIRST}/trace.json"))
        traced[group.name] = len(first)
        failed[group.name] = len(list(group.glob(f"*/{FAILED}")))
        alone[group.name] = sum(_is_alone(file) for file in first)
        cases = [_case(file.parents[1]) for file in first if (file.parents[1] / PLANNED).exists()]
        opened += [case for case in cases if case is not None]
    return Scored(traced, alone, tuple(opened), failed)


def _is_alone(file: Path) -> bool:
    traced = json.loads(file.read_text(encoding="utf-8"))
    return standing(traced, file.parents[2].name.endswith("field")) is None and models_left(traced) < 2


def _case(folder: Path) -> Open | None:
    """Return a case; nothing if an arm is not there yet."""
    plan, sealed = (json.loads((folder / name).read_text(encoding="utf-8")) for name in (PLANNED, "sealed.json"))
    arms: dict[str, Driven] = {}
    for arm in ARMS:
        halved = arms.get(arm.removesuffix(" twice"))
        if halved is not None and halved.stands:
            arms[arm] = halved
            continue
        file = folder / arm.replace(" ", "-") / "trace.json"
        if not file.exists():
            return None
        arms[arm] = _driven(json.loads(file.read_text(encoding="utf-8")), sealed, plan["arms"][arm])
    first = json.loads((folder / FIRST / "trace.json").read_text(encoding="utf-8"))
    kept = {**first, "posterior": {"models": _planned_for(plan["arms"][ARMS[0]]["expected"]["models"], first)}}
    return Open(
        folder.name, folder.parent.name, plan["commit"], probability_of_right(first, sealed),
        probability_of_right(kept, sealed) > 0.0, arms,
    )  # fmt: skip


def _planned_for(expected: Mapping[str, Any], traced: Mapping[str, Any]) -> list[dict[str, Any]]:
    """Return the models of a plan as those of a posterior; earlier plans have the likeliest of the confusable set."""
    models = sorted(traced["confusable"]["models"], key=lambda m: -m["share"])[: len(expected)]
    firsts = ([alike[0] for alike in m["added"]] for m in models)
    added = [row["added"] if "added" in row else next(firsts) for row in expected.values()]
    return [
        {"added": [[h] for h in hypotheses], "probability": row["share"]}
        for hypotheses, row in zip(added, expected.values(), strict=True)
    ]


def _driven(traced: Mapping[str, Any], sealed: Mapping[str, Any], arm: Mapping[str, Any]) -> Driven:
    return Driven(
        arm["seconds"],
        arm["expected"]["probability"],
        probability_of_right(traced, sealed),
        standing(traced, sealed["quality"] == "field") is not None,
        (traced["posterior"] or {"none_of_these": math.nan})["none_of_these"],
    )


def difference(opened: Sequence[Open], arm: str, other: str) -> tuple[float, float, float]:
    """Return by how much more of the cases an arm settles than another, with its 95 % interval (bootstrap of cases)."""
    each = np.array([float(o.arms[arm].settled) - float(o.arms[other].settled) for o in opened])
    low, high = _interval(each)
    return float(each.mean()), low, high


def _interval(values: Floats) -> tuple[float, float]:
    """Return the 95 % interval of a mean by 10,000 resamples of what it is of."""
    again = np.random.default_rng(0).integers(len(values), size=(10_000, len(values)))
    low, high = np.quantile(values[again].mean(axis=1), [0.025, 0.975])
    return float(low), float(high)


def table(scored: Scored) -> str:
    """Return what was settled as Markdown."""
    lines = []
    for group, count in scored.traced.items():
        own = [o for o in scored.opened if o.group == group]
        line = f"* {_said(group)}: {count} cases traced; {len(own)} left several names and were driven on, "
        line += f"{sum(o.held for o in own)} of them with the right name among those planned for."
        if scored.alone[group]:
            line += f" In {scored.alone[group]} no name stands though one model is left, so that nothing is planned."
        line += f" {scored.failed[group]} ended in an error." if scored.failed[group] else ""
        lines.append(fill(line, _WIDTH, subsequent_indent="  "))
    if not scored.opened:
        return "\n".join(lines) + "\n"
    more = [
        f"{100 * mean:+.0f} points against {other} ({100 * low:+.0f} to {100 * high:+.0f})"
        for other in ARMS
        if not other.startswith(ARMS[0])
        for mean, low, high in [difference(scored.opened, ARMS[0], other)]
    ]
    lines += ["", *_rows(scored), "", fill(f"Designed, paired over all cases: {', '.join(more)}.", _WIDTH)]
    return "\n".join(lines) + "\n"


def _said(group: str) -> str:
    return group.replace("-", ", ")


def _rows(scored: Scored) -> list[str]:
    """Return the rows of the arms: how many cases of each group are settled, and of all of them."""
    groups = [group for group in scored.traced if any(o.group == group for o in scored.opened)]
    head = ["driven", "s, mean", *map(_said, groups), "all", "planned for", "wrong name", "expected", "reached"]
    rows = [f"| {' | '.join(head)} |", f"|---|{'--:|' * (len(head) - 1)}"]
    for arm in ARMS:
        each = [o.arms[arm] for o in scored.opened]
        settled = [[o.arms[arm].settled for o in scored.opened if o.group == group] for group in groups]
        cells = [arm, f"{np.mean([d.seconds for d in each]):.0f}"]
        cells += [f"{sum(own)} of {len(own)}" for own in settled]
        cells += [share(d.settled for d in each), share(o.arms[arm].settled for o in scored.opened if o.held)]
        cells += [str(sum(d.misled for d in each))]
        cells += [f"{np.mean([getattr(d, what) for d in each]):.2f}" for what in ("expected", "right")]
        rows.append(f"| {' | '.join(cells)} |")
    return rows


_EDGES = (0.0, 0.6, 0.8, 0.9, 0.95, 0.99, 1.0)
_FEWEST = 3
"""Cases of a bin whose mean is stated."""


def reliability(scored: Scored) -> list[tuple[float, float, float, float, int]]:
    """Return, by bin of the expected probability, its mean, that of the reached one with its interval, and the number.

    Of the arms that were driven as long as planned, of cases whose right name was among those planned for.
    """
    pairs = np.array([(d.expected, d.right) for o in scored.opened if o.held for d in _as_long(o)]).reshape(-1, 2)
    rows = []
    for low, high in pairwise(_EDGES):
        within = pairs[(pairs[:, 0] >= low) & ((pairs[:, 0] < high) | (high == _EDGES[-1]))]
        if len(within) >= _FEWEST:
            rows.append((float(within[:, 0].mean()), float(within[:, 1].mean()), *_interval(within[:, 1]), len(within)))
    return rows


def _as_long(case: Open) -> list[Driven]:
    return [case.arms[arm] for arm in AS_LONG]


def figure(scored: Scored) -> bytes:
    """Return the reliability diagram: expected against reached probability of the right name."""
    with style.drawing():
        fig = style.figure(3.6)
        axes = fig.subplots()
        axes.plot([0, 1], [0, 1], ls=":", color=style.TRUTH, lw=0.9)
        looks = style.looks(AS_LONG)
        for arm, look in looks.items():
            each = [o.arms[arm] for o in scored.opened if o.held]
            axes.plot([d.expected for d in each], [d.right for d in each], look.marker, color=look.line, ms=3.5,
                      mfc="none", label=arm)  # fmt: skip
        rows = reliability(scored)
        if rows:
            expected, reached, low, high, _ = (np.array(column) for column in zip(*rows, strict=True))
            axes.errorbar(expected, reached, [reached - low, high - reached], fmt="o", color=style.TRUTH, ms=5,
                          label="mean of a bin, 95 %")  # fmt: skip
        axes.set_xlabel("expected probability of the right name")
        axes.set_ylabel("reached")
        handles, _ = axes.get_legend_handles_labels()
        style.head(fig, "Is the right name as probable as the plan expected?", handles)
        return style.svg(fig)


def page(scored: Scored) -> None:
    """Write table and figure into ``docs/next-drive.md``."""
    shown = f"![Expected and reached probability of the right name](pictures/{PICTURE})\n" if scored.opened else ""
    content = table(scored) + (f"\n{shown}" if shown else "")
    write_files(PAGE.parent, {PAGE.name: renewed(PAGE.read_text(encoding="utf-8"), content, *MARKS)})
    if scored.opened:
        write_files(PAGE.parent / "pictures", {PICTURE: figure(scored)})
