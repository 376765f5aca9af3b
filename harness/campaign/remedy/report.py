"""The report on remedies: the answer in words, a table to decide by, and what could be known at best."""

from __future__ import annotations

from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.lines import Line2D

from harness.campaign.remedy.answer import further, headline, times
from harness.campaign.remedy.choices import AS_IT_IS, Remedy, prior
from harness.campaign.remedy.choices import parameters as parameters_of
from harness.campaign.remedy.judge import Outcome, harm, nominal_cost
from harness.campaign.remedy.run import Tried
from harness.common.files import write_files
from harness.config import ModelSpec, Study
from harness.config.parameter_set import UNSURE, set_text
from harness.models.quantities import listed, quantity, words
from harness.models.signals import SIGNALS
from harness.reporting import style
from harness.reporting.document import (
    Block,
    Bullets,
    Document,
    Drawing,
    Heading,
    Listing,
    Prose,
    Section,
    Sheet,
    plain,
    strong,
    write,
)
from harness.reporting.style import in_unit, number, percent

BELIEF = "belief.toml"
STUDY = "study.toml"


def write_report(tried: Tried, out: Path, command: str) -> list[Path]:
    """Write the report, the belief to take and its study into a folder; return the files.

    Args:
        tried: From ``try_remedies``.
        out: The folder.
        command: The command that is running, for the record.

    Raises:
        UserError: If the folder cannot be written to.
    """
    title = f"What helps where the {_drivers(tried)} {'is' if len(tried.drivers) == 1 else 'are'} not as believed?"
    sections = [
        Section(partial(_answer, tried), "Answer"),
        Section(partial(_levels, tried), "How large are the errors at every level?"),
        *([Section(partial(_promise, tried), "What could be known at best?")] if tried.promise else []),
        Section(partial(_made, tried, command), "How was this made?"),
    ]
    files = {BELIEF: belief_text(tried), STUDY: tried.best.study.text}
    return [*write(Document(title, sections), out), *write_files(out, files)]


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


def believed(study: Study) -> ModelSpec:
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


def _drivers(tried: Tried) -> str:
    return listed([words(d) for d in tried.drivers])


def _answer(tried: Tried) -> list[Block]:
    return [
        Heading("Answer"),
        Prose(strong(headline(tried))),
        Bullets([f"{strong(head)} {plain(text)}" for head, text in further(tried)]),
        _table(tried),
    ]


def _table(tried: Tried) -> Sheet:
    """Return the table to decide by: the best first, and what it is measured against last."""
    first = tried.outcomes[0]
    order = [tried.best, *sorted((o for o in tried.outcomes if o is not tried.best), key=lambda o: harm(o, first))]
    header = ["remedy", "measured in addition"]
    for q in first.targets:
        header += [f"{q.words}{in_unit(q.unit)}, worst level", "worst run"]
    header += [f"box, {first.targets[t].words}" for t in first.boxes]
    header += ["as believed", "NEES", "runs consistent", "time per step"]
    rows = [_row(o, first) for o in order] + ([_row(tried.known, first)] if tried.known else [])
    ideal = "the amended model believed" if tried.traced else "what nobody can do: know the parameters"
    caption = (
        "The remedies on the same points, drives and noise, the one to take first; "
        + (f"last, {ideal}. " if tried.known else "")
        + "Worst level: median RMSE at the level where it is largest, lost runs counted as infinitely wrong (∞), and "
        "over that as it is. As believed: median RMSE where the vehicle is as believed, over that as it is. NEES: "
        "median over its expectation. Runs consistent: those whose average NEES is below its 95 % bound. Time: in the "
        "study's lanes, over that as it is."
    )
    if first.boxes:
        caption += " Box: how far all parameters may drift together, of the way to the edges."
    return Sheet(header, rows, caption, left=2)


def _row(o: Outcome, first: Outcome) -> list[str]:
    found = [o.remedy.does, o.remedy.measures]
    for t in range(len(o.targets)):
        highest, before = o.medians[t].max(), first.medians[t].max()
        ratio = "" if o is first or not np.isfinite(highest) else f" ({number(highest / before, 2)}×)"
        found += [_error(highest) + ratio, _error(o.worst[t])]
    found += [f"{percent(o.boxes[t].box)}" if t in o.boxes else "–" for t in first.boxes]
    cost = nominal_cost(o, first)
    found.append("–" if not np.isfinite(cost) and not np.isinf(cost) else times(cost))
    found += [number(o.nees, 2), percent(o.consistent) if np.isfinite(o.consistent) else "–"]
    return [*found, times(o.step_time / first.step_time)]


def _error(value: float) -> str:
    return "∞" if np.isinf(value) else number(value)


def _levels(tried: Tried) -> list[Block]:
    first = tried.outcomes[0]
    shown = [*tried.outcomes, *([tried.known] if tried.known else [])]
    found: list[Block] = [Heading("How large are the errors at every level?")]
    if len(first.levels) > 1:
        caption = (
            "Median RMSE of each remedy at each level, lost runs counted as infinitely wrong (no point); grey: the "
            "vehicle is as believed."
        )
        found.append(Drawing(partial(_draw, tried), caption, "Median error of each remedy over the levels"))
    for t, q in enumerate(first.targets):
        rows = [[o.remedy.words, *(_error(v) for v in o.medians[t])] for o in shown]
        found.append(Sheet(["remedy", *first.levels], rows, f"Median RMSE of {q.words}{in_unit(q.unit)}."))
    return found


def _draw(tried: Tried) -> bytes:
    """Draw the study as it is, the remedy to take, the best without a sensor, and the ideal."""
    first = tried.outcomes[0]
    bare = [o for o in tried.outcomes if not o.remedy.added and o is not first]
    chosen = {AS_IT_IS.words: first}
    if bare:
        one = min(bare, key=lambda o: harm(o, first))
        chosen[f"without a further sensor: {one.remedy.words}"] = one
    chosen[f"to take: {tried.best.remedy.words}"] = tried.best
    if tried.known:
        chosen["the same, parameters known"] = tried.known
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
        style.head(fig, f"How large is the error where the {_drivers(tried)} differs from the belief?", handles)
        return style.svg(fig)


def _panel(axes: Axes, t: int, chosen: dict[str, Outcome], looks: dict[str, style.Look], first: Outcome) -> None:
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
    axes.set_ylabel(f"RMSE{in_unit(first.targets[t].unit)}")
    axes.grid(axis="y")


def _promise(tried: Tried) -> list[Block]:
    """Say what the best estimator could know of the parameters, by equipment and drive."""
    known = {f.parameter: f for f in parameters_of(tried.study)}
    drives = [d.name for d in tried.study.drives]
    rows = []
    for equipment, left in tried.promise.items():
        for d, name in enumerate(tried.drivers):
            factor = known[name]
            shown = quantity(name, factor.unit) if name in SIGNALS else None
            scale, unit = (shown.scale, shown.unit) if shown else (1.0, factor.unit)
            added = Remedy(equipment=equipment).measures
            first = prior(factor) * scale
            rows.append(
                [
                    added if d == 0 else "",
                    f"{words(name)}{in_unit(unit)}",
                    number(first),
                    *(number(first * v) for v in left[:, d]),
                ]
            )
    text = (
        "The smallest standard deviation to which any estimator can know the parameters after each drive, from the "
        "Fisher information with process noise along it (Tichavsky, Muravchik and Nehorai 1998), all parameters that "
        "drive the error being unknown. It is a bound: where it is small a filter need not reach it. Where it stays "
        "near the first deviation, no estimator can find the parameter on that drive."
    )
    blocks: list[Block] = [Heading("What could be known at best?"), Prose(plain(text))]
    header = ["measured in addition", "parameter", "known to ±", *(words(d) for d in drives)]
    blocks.append(Sheet(header, rows, "Standard deviation at the end of each drive at best.", left=2))
    if tried.measuring:
        sets = "; ".join(Remedy(equipment=e).measures for e in tried.measuring)
        blocks.append(Prose(plain(f"Not tried, because they measure a target itself: {sets}.")))
    if tried.impossible:
        blocks.append(Bullets([plain(f"Not possible: {what}: {why}") for what, why in tried.impossible.items()]))
    return blocks


def _made(tried: Tried, command: str) -> list[Block]:
    text = (
        f"{command}. Estimator: {tried.estimator}. Each remedy is a study of its own, in the folder that the list "
        f"names; harness report writes its report. {BELIEF} is the belief of the remedy to take, a parameter file that "
        f"[belief] parameters of a study and harness estimate --parameters take; {STUDY} is its study."
    )
    rows = [[o.remedy.words, o.remedy.slug] for o in (*tried.outcomes, *([tried.known] if tried.known else []))]
    return [
        Heading("How was this made?"),
        Prose(plain(text)),
        Sheet(["remedy", "folder"], rows, "Where the runs are.", left=2),
        Listing(tried.best.study.text.rstrip("\n"), "toml"),
    ]
