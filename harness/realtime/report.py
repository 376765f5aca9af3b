"""The report of ``harness realtime``: the answer in words, the figure as Bild 6.9, the tables, how it was measured."""

from __future__ import annotations

import json
from collections.abc import Sequence

import numpy as np
import xarray as xr
from matplotlib.axes import Axes
from matplotlib.lines import Line2D

from harness.models.quantities import listed
from harness.realtime.measure import TURN
from harness.realtime.outcome import PACES, PUBLISHED, STORE, published_ratio
from harness.reporting import style
from harness.reporting.document import (
    Block,
    Bullets,
    Listing,
    Picture,
    Prose,
    Report,
    Section,
    Sheet,
    plain,
)
from harness.reporting.style import number, percent, with_unit

_MICRO = 1e6
_WARM, _CYCLE = PACES
_OF_THE_CYCLE = 0.1
"""Share of the cycle that an estimator may take and still leave a controller to other tasks, for the wording."""


def answer(outcome: xr.Dataset) -> str:
    """Return the answer in one or two sentences."""
    cycle = outcome.attrs["cycle"]
    quantile = outcome["quantile"].sel(pace=_CYCLE)
    typical, rare, longest = (quantile.sel(share=share) for share in (0.5, 0.999, 1.0))
    slowest = str(outcome["estimator"].values[int(np.argmax(typical.values))])
    late = outcome["step_time"].sel(pace=_CYCLE) > cycle
    load, ms = float(typical.max()) / cycle, f"{1e3 * cycle:g} ms"
    if load >= 1.0:
        verdict = f"{slowest}, the slowest, does not fit into the cycle of {ms} on this core"
    elif late.any():
        taken_away = int((late & outcome["interrupted"]).sum())
        verdict = (
            f"In the median every estimator fits into the cycle of {ms}, but {int(late.sum())} of {late.size} steps "
            f"took longer, {taken_away} of them interrupted by the operating system"
        )
    else:
        room = "with room to spare" if load < _OF_THE_CYCLE else "on this core"
        verdict = f"Every estimator fits into the cycle of {ms} {room}"
    return (
        f"{verdict}: the slowest, {slowest}, takes {_micro(float(typical.max()))} in the median ({percent(load)} of "
        f"the cycle), one step in a thousand takes more than {_micro(float(rare.sel(estimator=slowest)))}, and the "
        f"longest step of any estimator took {_micro(float(longest.max()))}." + _left_out(outcome)
    )


def _left_out(outcome: xr.Dataset) -> str:
    """Say which estimators of the study were not timed; empty where all were."""
    names = json.loads(outcome.attrs.get("left_out", "[]"))
    return f" Not timed: {listed(names)}, since single steps of an FMU cannot be." if names else ""


def report(outcome: xr.Dataset, findings: Sequence[Block] = ()) -> Report:
    """Return the report.

    Args:
        outcome: From ``harness.realtime.outcome.judge``.
        findings: What stands below the answer.
    """
    sections = [
        Section(
            lambda: [Prose(plain(answer(outcome)) + " " + plain(_ratios_in_words(outcome)))], "Answer", headed=False
        ),
        *findings,
        Section(lambda: [figure(outcome)], "How long does a step take, and how often longer?", headed=False),
        Section(lambda: _tables(outcome), "How long does a step of each estimator take?", headed=False),
        Section(lambda: _said(outcome), "What does this say of a controller?"),
        Section(lambda: _made(outcome), "How was this made?"),
    ]
    return Report("Does each estimator fit into the cycle of a controller?", sections)


def _said(outcome: xr.Dataset) -> list[Block]:
    return [
        Bullets([plain(text) for text in _meaning(outcome)]),
    ]


def _made(outcome: xr.Dataset) -> list[Block]:
    return [
        Sheet(["item", "value"], _facts(outcome), "Configuration of the measurement.", left=2),
        Prose(
            plain("The study whose estimators were timed; of its drives only the one named above, none of its designs:")
        ),
        Listing(str(outcome.attrs["study"]).rstrip("\n"), "toml"),
    ]


def _micro(seconds: float) -> str:
    return with_unit(_MICRO * seconds, "µs")


def _kinds(outcome: xr.Dataset) -> dict[str, str]:
    kinds: dict[str, str] = json.loads(outcome.attrs["kinds"])
    return kinds


def _ratio(outcome: xr.Dataset, pace: str, estimator: str) -> str:
    median, lower, upper = outcome["ratio"].sel(pace=pace, estimator=estimator).values
    return f"{median:.2f} ({lower:.2f} to {upper:.2f})"


def _ratios_in_words(outcome: xr.Dataset) -> str:
    """Compare with the dissertation; empty where the study has nothing to compare."""
    kinds, reference = _kinds(outcome), outcome.attrs["reference"]
    published = {name: published_ratio(kind, kinds[reference]) for name, kind in kinds.items() if name != reference}
    parts = [
        f"{name} takes {_ratio(outcome, _WARM, name)} times as long as {reference} without a pause and "
        f"{_ratio(outcome, _CYCLE, name)} times once per cycle, where the dissertation has {there:.2f}"
        for name, there in published.items()
        if there is not None
    ]
    return "; ".join(parts) + "." if parts else ""


def figure(outcome: xr.Dataset) -> Picture:
    """Draw the times over the drive (Bild 6.9) and how often a step takes how long."""
    names = [str(n) for n in outcome["estimator"].values]
    looks = style.looks(names)
    cycle, times = outcome.attrs["cycle"], _MICRO * outcome["step_time"]
    shown = times.clip(min=float(times.where(times > 0).min()))
    with style.drawing():
        fig = style.figure(5.6)
        upper, lower = fig.subplots(2, 1)
        for name in names:
            look, load = looks[name], 1e-4 * shown.sel(pace=_CYCLE, estimator=name).values / cycle
            with style.series(upper, name), style.series(lower, name):
                upper.plot(outcome["time"].values, load, color=look.line, lw=0.5, alpha=0.8)
                for pace, width in ((_CYCLE, 1.3), (_WARM, 0.6)):
                    _exceedance(lower, shown.sel(pace=pace, estimator=name).values, look, width)
        per_cycle = 1e-4 * shown.sel(pace=_CYCLE) / cycle
        style.logarithmic(upper, float(per_cycle.min()), float(per_cycle.max()))
        upper.set_ylabel("load of the cycle in %")
        upper.set_xlabel("time along the drive in s")
        upper.set_title(f"one step every {1e3 * cycle:g} ms", loc="left")
        upper.margins(x=0)
        upper.grid(axis="y")
        lower.set_xscale("log")
        lower.set_yscale("log")
        for axis in (lower.xaxis, lower.yaxis):
            axis.set_major_formatter(lambda value, _: f"{value:g}")
        lower.set_ylim(0.8 / times.sizes["time"], 1.2)
        lower.set_xlabel("time per step in µs (thick: one step per cycle, thin: without a pause)")
        lower.set_ylabel("share of steps that\ntake at least as long")
        lower.grid()
        handles = [Line2D([], [], color=looks[n].line, ls=looks[n].dashes, lw=1.3, label=n) for n in names]
        style.head(
            fig, f"How long does a step take, and how often longer? n = {times.sizes['time']} steps each", handles
        )
        image = style.svg(fig)
    caption = (
        "Time per step of one run on one core. Above, over the drive, as Bild 6.9 of Ziaukas 2023; below, the share of "
        "steps that take at least so long: the median at 0.5, what one step in a thousand exceeds at 0.001."
    )
    return Picture(image, caption, "Time per step of each estimator over time and as a distribution")


def _exceedance(axes: Axes, values: np.ndarray, look: style.Look, width: float) -> None:
    ordered = np.sort(values)
    share = np.arange(len(ordered), 0, -1) / len(ordered)
    axes.step(ordered, share, where="pre", color=look.line, ls=look.dashes, lw=width)


def _tables(outcome: xr.Dataset) -> list[Block]:
    cycle, kinds = outcome.attrs["cycle"], _kinds(outcome)
    rows = []
    for name in kinds:
        values = outcome["quantile"].sel(pace=_CYCLE, estimator=name).values
        mean = float(outcome["mean"].sel(pace=_CYCLE, estimator=name))
        times = outcome["step_time"].sel(pace=_CYCLE, estimator=name)
        rows.append(
            [
                name,
                *(number(_MICRO * v) for v in (*values, mean)),
                *(percent(v / cycle) for v in values),
                str(int((times > cycle).sum())),
                str(int(outcome["interrupted"].sel(estimator=name).sum())),
            ]
        )
    header = [
        "estimator",
        "median µs",
        "99.9 % µs",
        "max µs",
        "mean µs",
        "load median",
        "99.9 %",
        "max",
        "late",
        "intr.",
    ]
    caption = (
        f"One step every {1e3 * cycle:g} ms, {outcome.sizes['time']} steps: time per step, load relative to the "
        "cycle, steps longer than the cycle (late), and steps around which the operating system took the core away "
        "(intr.)."
    )
    return [Sheet(header, rows, caption), _ratio_table(outcome)]


def _ratio_table(outcome: xr.Dataset) -> Sheet:
    kinds, reference = _kinds(outcome), outcome.attrs["reference"]
    rows = []
    for name, kind in kinds.items():
        there = published_ratio(kind, kinds[reference])
        warm = float(outcome["quantile"].sel(pace=_WARM, estimator=name, share=0.5))
        means = [float(outcome["mean"].sel(pace=_CYCLE, estimator=n)) for n in (name, reference)]
        rows.append(
            [
                name,
                number(_MICRO * warm),
                *(_ratio(outcome, pace, name) if name != reference else "1" for pace in (_WARM, _CYCLE)),
                f"{means[0] / means[1]:.2f}" if name != reference else "1",
                "–" if there is None else f"{there:.2f}" if name != reference else "1",
            ]
        )
    header = ["estimator", "median µs, no pause", "ratio, no pause", "ratio, per cycle", "of means", "dissertation"]
    caption = (
        f"Time relative to {reference}: ratio of medians with its 95 % interval (bootstrap over blocks of a second) "
        "for steps without a pause and for one step per cycle, ratio of the means per cycle, and the ratio of mean "
        "loads in Ziaukas 2023, Bild 6.9."
    )
    return Sheet(header, rows, caption)


def _meaning(outcome: xr.Dataset) -> Sequence[str]:
    clock = {pace: float(outcome["clock"].sel(pace=pace).median()) for pace in PACES}
    return (
        "A study computes eight runs at once in the lanes of a SIMD register; a controller has one run. So the kernels "
        "were made anew from the same source for a single lane: scalar double-precision code that takes the same steps "
        "and gives the same estimates. What eight lanes save a study, a controller does not get.",
        "Once per cycle, all estimators take the same sample, each in a slot of its own, in an order drawn anew; the "
        "rest of the cycle is slept away. Other work of the machine empties the caches meanwhile, as other tasks of a "
        f"controller would. Without a pause, estimators take turns of {TURN} steps. Those ratios compare arithmetic, "
        "those per cycle include the effects of this machine.",
        "The clock is read in compiled code directly before and after a step. Two readings without a step between "
        f"take {1e9 * clock[_WARM]:.0f} ns without a pause and {1e9 * clock[_CYCLE]:.0f} ns per cycle in the median, "
        "which is subtracted. Compilation, reading of signals and writing of results are not part of a step.",
        "The dissertation ran generated C code on an ETAS ES910 prototyping module and gives mean loads of "
        f"{', '.join(f'{load} % ({kind.upper()})' for kind, load in PUBLISHED.items())} of a cycle of 10 ms. Its times "
        "cannot be compared with those of this machine; its ratios can, with two reservations: here the Jacobians are "
        "exact and their zeros are left out, and the network has other weights and delays than the unpublished one.",
        "The operating system of this machine is not a real-time one: long steps are mostly its interruptions, not the "
        "estimator's. The longest step here is therefore no bound for a controller.",
    )


def _facts(outcome: xr.Dataset) -> list[list[str]]:
    a = outcome.attrs
    versions = ", ".join(f"{k} {v}" for k, v in json.loads(a["versions"]).items())
    return [
        ["study", str(a["study_name"])],
        ["hash of the study", str(a["study_hash"])],
        ["drive", f"{a['drive']}, the first {number(float(outcome['time'][-1]))} s"],
        ["cycle", f"{1e3 * a['cycle']:g} ms"],
        ["machine", f"{a['machine']}, one of {a['cores']} cores"],
        ["load average at the end", f"{a['load_average']:.1f}"],
        ["commit", str(a["commit"])],
        ["versions", versions],
        ["times of all steps", STORE],
    ]
