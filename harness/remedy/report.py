"""The report on remedies: the answer in words, a table to decide by, and what could be known at best."""

from __future__ import annotations

import textwrap
from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.lines import Line2D

from harness.common.files import write_files
from harness.config import ModelSpec, StudySpec
from harness.config.parameter_set import UNSURE, set_text
from harness.models.quantities import listed, quantity, words
from harness.models.signals import SIGNALS
from harness.remedy.answer import answer, drivers_of, further, times
from harness.remedy.choices import AS_IT_IS, Remedy, prior
from harness.remedy.choices import parameters as parameters_of
from harness.remedy.judge import RemedyOutcome, harm, nominal_cost
from harness.remedy.run import Tried
from harness.reporting import style
from harness.reporting.document import (
    Block,
    Bullets,
    Drawing,
    Listing,
    Prose,
    Report,
    Section,
    Sheet,
    plain,
    strong,
)
from harness.reporting.style import in_unit, number, percent, with_unit

BELIEF = "belief.toml"
STUDY = "study.toml"


def report(tried: Tried, command: str) -> Report:
    """Return the report.

    Args:
        tried: From ``try_remedies``.
        command: The command that is running, for the record.
    """
    title = f"What helps where the {drivers_of(tried)} {'is' if len(tried.drivers) == 1 else 'are'} not as believed?"
    sections = [
        Section(partial(_answer, tried), "Answer"),
        *(
            [Section(partial(_levels, tried), "How large are the errors at every level?")]
            if len(tried.outcomes[0].levels) > 1
            else []
        ),
        *([Section(partial(_promise, tried), "What could be known at best?")] if tried.promise else []),
        Section(partial(_made, tried, command), "How was this made?"),
    ]
    return Report(title, sections)


def write_remedy(tried: Tried, out: Path, command: str) -> list[Path]:
    """Write the report, the belief to take and its study into a folder; return the files.

    Args:
        tried: From ``try_remedies``.
        out: The folder.
        command: The command that is running, for the record.

    Raises:
        UserError: If the folder cannot be written to.
    """
    files = {BELIEF: belief_text(tried), STUDY: tried.best.study.text}
    return [*report(tried, command).write(out), *write_files(out, files)]


def belief_text(tried: Tried) -> str:
    """Return the parameter file that states the belief of the remedy to take."""
    spec = believed(tried.best.study)
    keys = {
        "sensors": spec.sensors,
        "unknown_inputs": list(spec.unknown_inputs),
        **{
            key: [
                {"name": s.name, "prior": s.prior, **({"walk": s.walk} if s.walk else {})}
                for s in spec.parameter_states
                if s.considered == considered
            ]
            for key, considered in zip(UNSURE[1:], (False, True), strict=True)
        },
    }
    source = f"harness remedy on the study '{tried.study.name}': {tried.best.remedy.words}"
    return set_text(spec, source, {}, further={k: v for k, v in keys.items() if v})


def believed(study: StudySpec) -> ModelSpec:
    """Return the belief of a study of one estimator, with the noise that this is tuned to."""
    spec, factors = study.belief, study.estimators[0].noise
    file = study.path.parent / spec.parameters  # the path in a study is from its folder
    groups = {s: "unknown_inputs" if s in spec.unknown_inputs else "process" for s in spec.process_noise}
    return replace(
        spec,
        parameters=str(file) if file.is_file() else spec.parameters,
        process_noise={s: v * factors.get(groups[s], 1.0) for s, v in spec.process_noise.items()},
        measurement_noise={o: v * factors.get("measurement", 1.0) for o, v in spec.measurement_noise.items()},
        parameter_states=tuple(
            replace(s, walk=s.walk * factors.get("process", 1.0) ** 0.5) for s in spec.parameter_states
        ),
    )


def _answer(tried: Tried) -> list[Block]:
    first = tried.outcomes[0]
    blocks: list[Block] = [Prose(strong(answer(tried)))]
    if first.boxes:
        caption = "How far all factors may drift together before a drive exceeds its limit, the remedy to take first"
        more = len(tried.outcomes) - _MOST_DRAWN
        caption += f"; {more} more stand in the table." if more > 0 else "."
        blocks.append(Drawing(partial(_draw_boxes, tried), caption, "Box that each remedy tolerates"))
    elif len(first.levels) > 1:
        caption = (
            "Median RMSE at each level, lost runs counted as infinitely wrong (no point); grey: the vehicle is as "
            "believed."
        )
        blocks.append(Drawing(partial(_draw_levels, tried), caption, "Median error of remedies over the levels"))
    bullets = Bullets([f"{strong(head)} {plain(text)}" for head, text in further(tried)])
    return [*blocks, bullets, _table(tried), _further_table(tried)]


def _rows(tried: Tried) -> list[RemedyOutcome]:
    return [*_in_order(tried), *([tried.ideal] if tried.ideal else [])]


def _table(tried: Tried) -> Sheet:
    """Return the table to decide by: the best first, and what it is measured against last."""
    first = tried.outcomes[0]
    header = ["remedy"]
    header += [f"box, {first.targets[t].words}" for t in first.boxes]
    header += [f"{q.words}{in_unit(q.unit)}" for q in first.targets]
    header += ["as believed", "runs consistent", "time per step"]
    rows = []
    for o in _rows(tried):
        cost = nominal_cost(o, first)
        rows.append(
            [
                o.remedy.phrase_with_sensors(tried.drivers),
                *(percent(o.boxes[t].box) if t in o.boxes else "–" for t in first.boxes),
                *(_against(o, first, t) for t in range(len(o.targets))),
                times(cost) if np.isfinite(cost) or np.isinf(cost) else "–",
                percent(o.consistent) if np.isfinite(o.consistent) else "–",
                times(o.step_time / first.step_time),
            ]
        )
    ideal = "the amended model believed" if tried.traced else "what nobody can do: know the parameters"
    level = ", at the level where it is largest" if len(first.levels) > 1 else ""
    box = "Box: how far all factors may drift together, of the way to the edges. " if first.boxes else ""
    caption = (
        "The remedies on the same points, drives and noise, the one to take first"
        + (f"; last, {ideal}. " if tried.ideal else ". ")
        + f"{box}Errors: median RMSE{level}, lost runs counted as infinitely wrong (∞), and over that as it is. As "
        "believed: the error where the vehicle is as believed, over that as it is. Runs consistent: those whose "
        "average NEES is below its 95 % bound. Time: in the study's lanes, over that as it is."
    )
    return Sheet(_broken(header), rows, caption)


def _against(o: RemedyOutcome, first: RemedyOutcome, t: int) -> str:
    """Write an error at the worst level, and over that as it is."""
    highest, before = o.medians[t].max(), first.medians[t].max()
    ratio = "" if o is first or not np.isfinite(highest) else f" ({times(highest / before)})"
    return _error(highest) + ratio


def _further_table(tried: Tried) -> Sheet:
    """Return what else is known of every remedy."""
    first = tried.outcomes[0]
    header = ["remedy", *(f"worst run, {q.words}{in_unit(q.unit)}" for q in first.targets)]
    header += [f"half of the ways, {first.targets[t].words}" for t in first.boxes]
    header += ["runs lost", "NEES", "states"]
    rows = [
        [
            o.remedy.phrase_with_sensors(tried.drivers),
            *(_error(v) for v in o.worst),
            *(percent(o.boxes[t].typical) if t in o.boxes else "–" for t in first.boxes),
            percent(o.lost),
            number(o.nees, 2) if np.isfinite(o.nees) else "–",
            f"{o.states}",
        ]
        for o in _rows(tried)
    ]
    ways = (
        "Half of the ways: how far half of the directions in which everything drifts may be gone. "
        if first.boxes
        else ""
    )
    caption = (
        f"What else is known of them. {ways}Runs in which the vehicle itself left the range of its model are no "
        "remedy's: they end boxes and count as nothing else. NEES: median over its expectation."
    )
    return Sheet(_broken(header), rows, caption)


def _broken(header: Sequence[str]) -> list[str]:
    """Break the heads of numbers into lines, so that the words have the room."""
    return ["\n".join(textwrap.wrap(h, 13)) for h in header]


def _error(value: float) -> str:
    return "∞" if np.isinf(value) else number(value)


def _levels(tried: Tried) -> list[Block]:
    first = tried.outcomes[0]
    shown = [*tried.outcomes, *([tried.ideal] if tried.ideal else [])]
    blocks: list[Block] = []
    for t, q in enumerate(first.targets):
        rows = [[o.remedy.phrase_with_sensors(tried.drivers), *(_error(v) for v in o.medians[t])] for o in shown]
        blocks.append(Sheet(["remedy", *first.levels], rows, f"Median RMSE of {q.words}{in_unit(q.unit)}."))
    return blocks


def _promise(tried: Tried) -> list[Block]:
    """Say what the best estimator could know of the parameters, by equipment and drive."""
    factors = {f.parameter: f for f in parameters_of(tried.study)}
    drives = [d.name for d in tried.study.drives]
    rows = []
    for equipment, promise in tried.promise.items():
        for d, name in enumerate(tried.drivers):
            factor = factors[name]
            shown = quantity(name, factor.unit) if name in SIGNALS else None
            scale, unit = (shown.scale, shown.unit) if shown else (1.0, factor.unit)
            added = Remedy(equipment=equipment).measures
            first = prior(factor) * scale
            rows.append(
                [
                    added if d == 0 else "",
                    f"{words(name)}{in_unit(unit)}",
                    number(first),
                    *(number(first * v) for v in promise.remaining[:, d]),
                ]
            )
    text = (
        "The smallest standard deviation to which any estimator can know the parameters after each drive, from the "
        "Fisher information with process noise along it (Tichavsky, Muravchik and Nehorai 1998), all parameters that "
        "drive the error being unknown. It is a bound: where it is small a filter need not reach it. Where it stays "
        "near the first deviation, no estimator can find the parameter on that drive."
    )
    blocks: list[Block] = [Prose(plain(text))]
    header = ["measured in addition", "parameter", "known to ±", *(words(d) for d in drives)]
    blocks.append(Sheet(header, rows, "Standard deviation at the end of each drive at best.", left=2))
    blocks += _smallest(tried, drives)
    if tried.measuring:
        sets = "; ".join(Remedy(equipment=e).measures for e in tried.measuring)
        blocks.append(Prose(plain(f"Not tried, because they measure a target itself: {sets}.")))
    if tried.impossible:
        blocks.append(Bullets([plain(f"Not possible: {what}: {why}") for what, why in tried.impossible.items()]))
    return blocks


def _smallest(tried: Tried, drives: Sequence[str]) -> list[Block]:
    """Say what the best estimator is left with in the targets while the parameters are unknown."""
    rows = []
    for equipment, promise in tried.promise.items():
        for t, q in enumerate(tried.outcomes[0].targets):
            added = Remedy(equipment=equipment).measures if t == 0 else ""
            rows.append([added, f"{q.words}{in_unit(q.unit)}", *(number(v) for v in promise.smallest[:, t])])
    limits = [
        f"{with_unit(tried.study.limits[q.name] * q.scale, q.unit)} for the {q.words}"
        for q in tried.outcomes[0].targets
        if q.name in tried.study.limits
    ]
    text = (
        "The same bound for what is to be estimated, from the first sample on: the smallest RMSE in the mean over "
        "vehicles whose parameters differ from the belief as the study varies them. Some of these vehicles are further "
        "off than the mean." + (f" The limits are {listed(limits)}." if limits else "")
    )
    header = ["measured in addition", "target", *(words(d) for d in drives)]
    return [Prose(plain(text)), Sheet(header, rows, "Smallest RMSE along each drive.", left=2)]


def _made(tried: Tried, command: str) -> list[Block]:
    text = (
        f"{command}. Estimator: {tried.estimator}. Each remedy is a study of its own, in the folder that the list "
        f"names; harness report writes its report. {BELIEF} is the belief of the remedy to take, a parameter file that "
        f"[belief] parameters of a study and harness estimate --parameters take; {STUDY} is its study."
    )
    rows = [[o.remedy.words, o.remedy.slug] for o in (*tried.outcomes, *([tried.ideal] if tried.ideal else []))]
    return [
        Prose(plain(text)),
        Sheet(["remedy", "folder"], rows, "Where the runs are.", left=2),
        Listing(tried.best.study.text.rstrip("\n"), "toml"),
    ]


_MOST_DRAWN = 6
"""Remedies whose boxes are drawn, the best first; the table has all."""

_LINE = 0.165
_WIDTH = 50


def _in_order(tried: Tried) -> list[RemedyOutcome]:
    """Return all outcomes, the one to take first, then by the harm that is left."""
    first = tried.outcomes[0]
    return [tried.best, *sorted((o for o in tried.outcomes if o is not tried.best), key=lambda o: harm(o, first))]


def _draw_boxes(tried: Tried) -> bytes:
    """Draw the boxes of the best remedies, of the study as it is, and with the parameters known, by target."""
    first = tried.outcomes[0]
    order = _in_order(tried)[:_MOST_DRAWN]
    shown = [*order, *([first] if first not in order else []), *([tried.ideal] if tried.ideal else [])]
    names = [first.targets[t].words for t in first.boxes]
    looks = style.looks(names)
    labels = [textwrap.wrap(_label(o, tried), _WIDTH) for o in shown]
    row = _LINE * max(2.3, *(len(lines) for lines in labels))
    high = 0.8 / len(names)
    with style.drawing():
        fig = style.figure(1.3 + row * len(shown))
        axes = fig.subplots()
        for k, (t, name) in enumerate(zip(first.boxes, names, strict=True)):
            with style.series(axes, name):
                values = [100 * o.boxes[t].box for o in shown]
                y = np.arange(len(shown)) - 0.4 + (k + 0.5) * high
                look = looks[name]
                axes.barh(y, values, 0.85 * high, color=look.tint, edgecolor=look.line, hatch=look.hatch, label=name)
                for value, place in zip(values, y, strict=True):
                    axes.text(value + 1, place, percent(value / 100), va="center", fontsize=7.5)
        axes.set_yticks(range(len(shown)), ["\n".join(lines) for lines in labels], fontsize=8)
        axes.invert_yaxis()
        axes.set_xlim(0, 108)
        axes.set_xticks(range(0, 101, 20))
        axes.set_xlabel("box that is tolerated, % of the way to the edges")
        axes.grid(axis="x")
        style.head(fig, "How far may everything drift together?", axes.get_legend_handles_labels()[0])
        return style.svg(fig)


def _label(o: RemedyOutcome, tried: Tried) -> str:
    label = o.remedy.phrase_with_sensors(tried.drivers)
    return f"to take: {label}" if o is tried.best and o is not tried.outcomes[0] else label


def _draw_levels(tried: Tried) -> bytes:
    """Draw the study as it is, the remedy to take, the best without a sensor, and the ideal, over the levels."""
    first = tried.outcomes[0]
    bare = [o for o in tried.outcomes if not o.remedy.added and o is not first]
    chosen = {AS_IT_IS.words: first}
    if bare:
        taken = min(bare, key=lambda o: harm(o, first))
        chosen[f"without a further sensor: {taken.remedy.phrase(tried.drivers)}"] = taken
    chosen[f"to take: {tried.best.remedy.phrase_with_sensors(tried.drivers)}"] = tried.best
    if tried.ideal:
        chosen["the same, parameters known"] = tried.ideal
    looks = style.looks(list(chosen))
    with style.drawing():
        fig = style.figure(1.1 + 2.2 * len(first.targets))
        panels = fig.subplots(len(first.targets), 1, sharex=True, squeeze=False)[:, 0]
        for t, axes in enumerate(panels):
            _panel(axes, t, chosen, looks, first)
        panels[-1].set_xticks(range(len(first.levels)), first.levels)
        handles = [
            Line2D([], [], color=looks[n].line, ls=looks[n].dashes, marker=looks[n].marker, label=n) for n in chosen
        ]
        drivers = listed([words(d) for d in tried.drivers])
        style.head(fig, f"How large is the error where the {drivers} differs from the belief?", handles)
        return style.svg(fig)


def _panel(
    axes: Axes, t: int, chosen: dict[str, RemedyOutcome], looks: dict[str, style.Look], first: RemedyOutcome
) -> None:
    style.mark_matched(axes, first.home)
    seen = []
    for name, o in chosen.items():
        values = np.where(np.isfinite(o.medians[t]), o.medians[t], np.nan)
        seen += [v for v in values if v > 0]
        with style.series(axes, name):
            axes.plot(
                range(len(values)), values, marker=looks[name].marker, ls=looks[name].dashes, color=looks[name].line
            )
    if seen:
        style.logarithmic(axes, min(seen), max(seen))
    axes.set_title(first.targets[t].words, loc="left")
    axes.set_ylabel(f"RMSE{style.in_unit(first.targets[t].unit)}")
    axes.grid(axis="y")
