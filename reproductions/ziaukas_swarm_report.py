"""Report of the swarm study: Bild 4.6 to 4.9 and table 4.6 of Ziaukas 2023."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from matplotlib.lines import Line2D

from harness.common.arrays import Floats
from harness.identification.methods.swarm import Settings, SwarmResult
from harness.identification.simulation_error import Free
from harness.models.quantities import quantity, words
from harness.reporting import style
from harness.reporting.document import (
    Block,
    Heading,
    Listing,
    Picture,
    Prose,
    Report,
    Sheet,
    plain,
)
from reproductions.simulated_recording import Setup

PRINTED = {
    "yaw_rate_tractor": ((1.38, 7.24), (1.51, 7.11)),
    "yaw_rate_trailer": ((0.81, 4.03), (0.84, 2.79)),
    "articulation_angle": ((0.65, 2.0), (0.64, 2.11)),
    "lateral_force_axle_21": ((0.94, 5.97), (1.43, 9.57)),
}
"""RMSE and largest deviation, empty and laden, in deg/s, deg and kN (Ziaukas 2023, table 4.6)."""

_RUN, _WORST, _BEST = (look.line for look in style.looks(["runs", "worst", "best"]).values())
_POINTS = 1500
"""Drawn per line."""


def report(problem: Setup, results: Mapping[str, Sequence[SwarmResult]], settings: Settings, command: str) -> Report:
    """Return the report.

    Args:
        problem: The drives and what was hidden.
        results: What each optimiser found, run by run; the first is the swarm.
        settings: Of the swarm.
        command: That made the report.
    """
    runs = results["swarm"]
    order = np.argsort([f.cost for f in runs])
    best, worst = runs[order[0]], runs[order[-1]]
    hidden = float(problem.fit(problem.hidden[None])[0])
    diverged = sum(f.diverged for f in runs) / sum(f.evaluated for f in runs)
    winner, overall = min(((n, f) for n, fs in results.items() for f in fs), key=lambda pair: pair[1].cost)
    near = sum(f.cost < 1.05 * best.cost for f in runs)
    blocks: list[Block] = [
        Prose(
            plain(
                f"The best of {len(runs)} swarms errs by {best.cost:.4f}, the hidden parameters themselves by "
                f"{hidden:.4f}, which is the noise. {near} of {len(runs)} swarms end within 5 % of the best; in the "
                f"thesis all of 100 did. {_scatter(problem.fit.free, runs)} {style.percent(diverged)} of all "
                f"candidates diverged. The least cost of all searches, {overall.cost:.4f}, is that of {winner}."
            )
        ),
        Picture(
            histograms(problem.fit.free, runs, best, worst, problem.hidden),
            f"What {len(runs)} swarms found, over the search range (Bild 4.6).",
            "Histograms of the identified parameters over their search ranges",
        ),
        Heading("Do the swarms converge?"),
        Picture(
            costs(results, hidden),
            "Cost (4.26) of the best candidate so far (Bild 4.7), with differential evolution of as many candidates "
            f"beside it: {settings.particles} candidates, {settings.iterations} iterations.",
            "Cost over the iterations",
        ),
        _optimisers(results),
        Heading("What was found?"),
        _parameters(problem.fit.free, runs, (best, overall), problem.hidden),
        Heading("Does the simulation follow held-out drives?"),
        *_validation(problem, winner, overall),
    ]
    for drive in problem.judge.drives:
        number = "4.8" if "empty" in drive.name else "4.9"
        blocks.append(
            Picture(
                over_time(problem, drive.name, overall),
                f"Measurement and free run of the best parameters ({winner}), {drive.name} (Bild {number}).",
                f"Inputs and outputs over time, {drive.name}",
            )
        )
    blocks += [Heading("How it was made"), Listing(command)]
    return Report("Which parameters of the semitrailer does a particle swarm find?", blocks)


def _spread(free: Sequence[Free], runs: Sequence[SwarmResult]) -> Floats:
    """Return the interquartile range of each parameter over its search range."""
    width = np.array([f.upper - f.lower for f in free])
    low, high = np.quantile([f.values for f in runs], [0.25, 0.75], axis=0)
    return np.asarray((high - low) / width)


def _scatter(free: Sequence[Free], runs: Sequence[SwarmResult]) -> str:
    order = np.argsort(_spread(free, runs))
    least, most = (", ".join(_label(free[i]) for i in some) for some in (order[:3], order[-3:][::-1]))
    return f"Over its range scatter least: {least}; most: {most}."


def _label(free: Free) -> str:
    load = "" if not free.drives else ", empty" if "empty" in free.drives[0] else ", laden"
    return words(free.parameter) + load


def _optimisers(results: Mapping[str, Sequence[SwarmResult]]) -> Sheet:
    rows = []
    for name, runs in results.items():
        cost = [f.cost for f in runs]
        share = sum(f.diverged for f in runs) / sum(f.evaluated for f in runs)
        rows.append(
            [
                name,
                str(len(runs)),
                str(runs[0].evaluated),
                *(f"{v:.4f}" for v in (min(cost), np.median(cost), max(cost))),
                style.percent(share),
            ]
        )
    header = ["optimiser", "runs", "candidates", "least cost", "median", "largest", "diverged"]
    return Sheet(
        header,
        rows,
        "Searches with the same number of candidates per run; logarithmic: the stiffness coefficients are.",
    )


def _parameters(
    free: Sequence[Free], runs: Sequence[SwarmResult], chosen: tuple[SwarmResult, SwarmResult], hidden: Floats
) -> Sheet:
    rows, spread = [], _spread(free, runs)
    for i, parameter in enumerate(free):
        rows.append(
            [
                _label(parameter),
                style.number(parameter.lower),
                style.number(parameter.upper),
                style.number(float(hidden[i])),
                *(_value(parameter, f.values[i]) for f in chosen),
                style.percent(float(spread[i])),
            ]
        )
    header = ["parameter, SI", "from", "to", "hidden", "best swarm", "best of all", "scatter"]
    return Sheet(
        header, rows, "Search ranges of table 4.4. Scatter: interquartile range of the swarms over the search range."
    )


def _value(free: Free, value: float) -> str:
    return style.number(float(value)) + (" (bound)" if free.end_at(value) else "")


def _validation(problem: Setup, winner: str, best: SwarmResult) -> list[Block]:
    """Return table 4.6, a table per drive to judge, which come empty first."""
    sheets: list[Block] = []
    for number, drive in enumerate(problem.judge.drives):
        model, noise = (problem.judged(drive.name, values) for values in (best.values, problem.hidden))
        load = "laden" if "laden" in drive.name else "empty"
        rows = []
        for name in PRINTED:
            q = quantity(name)
            values = (q.scale * v for v in (*model[name], noise[name][0]))
            theirs = (f"{v:g}" for v in PRINTED[name][load == "laden"])
            rows.append([f"{q.words}{style.in_unit(q.unit)}", *(style.number(v) for v in values), *theirs])
        caption = f"Table 4.6 for {drive.name}: free run of the best parameters ({winner}) against noisy measurements."
        if number == 0:
            caption += (
                " Noise: RMSE of the hidden parameters. The thesis measured a real vehicle, which no model fits; here "
                "the model has the plant's equations."
            )
        followed = int(np.sum(np.isfinite(problem.free_run(drive.name, best.values)["yaw_rate_tractor"])))
        if followed < len(drive.time):
            caption += f" The model left its range of validity at {drive.time[followed]:.1f} s; errors up to then."
        header = ["signal", "RMSE", "largest", "noise", "thesis: RMSE", "largest"]
        sheets.append(Sheet(header, rows, caption))
    return sheets


def histograms(
    free: Sequence[Free], runs: Sequence[SwarmResult], best: SwarmResult, worst: SwarmResult, hidden: Floats
) -> bytes:
    """Draw what was found as strips over the search ranges, a row per parameter (Bild 4.6)."""
    values = np.array([f.values for f in runs])
    with style.drawing():
        fig = style.figure(8.6)
        axes = fig.subplots()
        for i, parameter in enumerate(free):
            row, place = (
                len(free) - 1 - i,
                lambda v, parameter=parameter: (v - parameter.lower) / (parameter.upper - parameter.lower),
            )
            heights, edges = np.histogram(place(values[:, i]), bins=20, range=(0.0, 1.0))
            axes.bar(
                edges[:-1], 0.8 * heights / len(runs), 0.05, bottom=row, align="edge", color=_RUN, alpha=0.55, lw=0
            )
            for value, colour in ((worst.values[i], _WORST), (best.values[i], _BEST), (hidden[i], style.TRUTH)):
                ls = ":" if colour == style.TRUTH else "-"
                axes.plot([place(value)] * 2, [row, row + 0.8], color=colour, ls=ls, lw=1.6)
            axes.axhline(row, color="#bbbbbb", lw=0.5)
        labels = [f"{_label(f)}\n{style.number(f.lower)} to {style.number(f.upper)}" for f in reversed(free)]
        axes.set_yticks(np.arange(len(free)) + 0.4, labels)
        axes.tick_params(axis="y", length=0)
        axes.set_xlim(-0.01, 1.01)
        axes.set_xlabel("place in the search range; height: share of the runs")
        handles = [
            Line2D([], [], color=_RUN, lw=5, alpha=0.55, label="runs"),
            Line2D([], [], color=_BEST, lw=1.6, label="best"),
            Line2D([], [], color=_WORST, lw=1.6, label="worst"),
            Line2D([], [], color=style.TRUTH, lw=1.6, ls=":", label="hidden"),
        ]
        style.head(fig, f"Where in its range does each of {len(runs)} swarms put the parameters?", handles)
        return style.svg(fig)


def costs(results: Mapping[str, Sequence[SwarmResult]], hidden: float) -> bytes:
    """Draw the cost over the iterations, a panel per optimiser (Bild 4.7)."""
    with style.drawing():
        fig = style.figure(1.0 + 2.1 * len(results))
        panels = fig.subplots(len(results), 1, sharex=True, sharey=True, squeeze=False)[:, 0]
        for axes, (name, runs) in zip(panels, results.items(), strict=True):
            order = np.argsort([f.cost for f in runs])
            for place in [*order[1:-1], order[-1], order[0]]:
                colour = _BEST if place == order[0] else _WORST if place == order[-1] else _RUN
                axes.semilogy(runs[place].history, color=colour, lw=1.3 if colour != _RUN else 0.6)
            axes.axhline(hidden, color=style.TRUTH, ls=":", lw=1.0)
            axes.set_ylabel("cost")
            axes.set_title(f"{name}, {len(runs)} runs", loc="left")
            axes.grid(axis="y")
        panels[-1].set_xlabel("iteration")
        handles = [
            Line2D([], [], color=_BEST, lw=1.3, label="best"),
            Line2D([], [], color=_WORST, lw=1.3, label="worst"),
            Line2D([], [], color=_RUN, lw=0.6, label="others"),
            Line2D([], [], color=style.TRUTH, ls=":", label="hidden parameters"),
        ]
        style.head(fig, "How low does the cost fall, and does every run get there?", handles)
        return style.svg(fig)


def over_time(problem: Setup, name: str, best: SwarmResult) -> bytes:
    """Draw inputs and outputs of a drive to judge (Bild 4.8, 4.9)."""
    drive = next(d for d in problem.judge.drives if d.name == name)
    some = slice(None, None, max(1, len(drive.time) // _POINTS))
    time, profile = drive.time[some], problem.profiles[name]
    model = problem.free_run(name, best.values)
    with style.drawing():
        fig = style.figure(8.8)
        panels = fig.subplots(2 + len(model), 1, sharex=True)
        for axes, signal in zip(panels, ("steering_wheel_angle", "speed"), strict=False):
            q = quantity(signal)
            axes.plot(time, q.scale * getattr(profile, signal)[some], color=style.TRUTH)
            axes.set_ylabel(f"{q.words.replace(' ', chr(10), 1)}\n{style.in_unit(q.unit).strip()}")
        for a, (axes, output) in enumerate(zip(panels[2:], model, strict=True)):
            q = quantity(output)
            axes.plot(time, q.scale * drive.measurements[some, a], color=style.MEASURED, lw=0.6)
            axes.plot(time, q.scale * model[output][some], color=_BEST, lw=1.0)
            axes.set_ylabel(f"{q.words.replace(' ', chr(10), 1)}\n{style.in_unit(q.unit).strip()}")
        for axes in panels:
            axes.grid(True)
        panels[-1].set_xlabel("time in s")
        handles = [
            Line2D([], [], color=style.MEASURED, lw=0.9, label="measured"),
            Line2D([], [], color=_BEST, lw=1.0, label="simulated, best parameters"),
        ]
        style.head(fig, f"Does the simulation follow {name}?", handles)
        return style.svg(fig)
