"""Report of the EM study: table 3.2, figures 3.10 and 3.11 of Sun 2015, and the methods beside each other."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from matplotlib.lines import Line2D

from harness.common.arrays import Floats
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

SYMBOLS = ("C_sf in 1/rad", "C_sr in 1/rad", "m/J in 1/m²", "l_f in m")
PRINTED = ((8.41, 0.59), (7.73, 0.64), (0.60, 3.2), (1.013, 0.1))
"""Value and relative error in percent (Sun 2015, table 3.2)."""

GOALS = (0.5, 0.5, 2.0, 0.5)
"""Largest median relative error in percent."""

_LINE, _MARK = (look.line for look in style.looks(["run", "mark"]).values())


@dataclass(frozen=True)
class Outcome:
    """One identification.

    Attributes:
        values: Parameters found ``(free,)``.
        path: Iterates of EM, the start first ``(iterations + 1, free)``; empty for other methods.
        process: Square roots of the process variances along the path ``(iterations + 1, nx)``; likewise.
        converged: Whether the method converged.
        seconds: CPU time of the fit.
    """

    values: Floats
    path: Floats
    process: Floats
    converged: bool
    seconds: float


def errors(outcomes: Sequence[Outcome], truth: Floats) -> Floats:
    """Return the magnitude of the relative errors in percent, ``(runs, free)``."""
    return 100 * np.abs(np.array([o.values for o in outcomes]) / truth - 1)


def report(truth: Floats, outcomes: Mapping[str, Sequence[Outcome]], q: tuple[Floats, Floats], command: str) -> Report:
    """Return the report.

    Args:
        truth: The plant's parameters ``(free,)``.
        outcomes: Outcomes by variant; the first is EM with the smoother, on all recordings.
        q: Values of each parameter and Q there, both ``(free, points)``.
        command: That made the report.
    """
    main, runs = next(iter(outcomes)), next(iter(outcomes.values()))
    median = np.median(errors(runs, truth), axis=0)
    within = sum(m <= goal for m, goal in zip(median, GOALS, strict=True))
    blocks: list[Block] = [
        Prose(
            plain(
                f"Over {len(runs)} recordings of 500 steps the median relative error is "
                + ", ".join(f"{style.number(m, 2)} % for {s.split()[0]}" for m, s in zip(median, SYMBOLS, strict=True))
                + f"; {within} of {len(GOALS)} meet their goal of "
                + ", ".join(f"{g:g}" for g in GOALS)
                + f" %. {sum(o.converged for o in runs)} of {len(runs)} converged, after "
                f"{np.median([len(o.path) - 1 for o in runs]):.0f} iterations and "
                f"{style.number(float(np.median([o.seconds for o in runs])), 2)} s of CPU time (medians)."
            )
        ),
        Picture(
            convergence(runs, truth),
            f"Iterates of {main} over their true values (figure 3.11 of Sun), {len(runs)} recordings, the first in "
            "orange. The process covariance, which Sun sets beforehand, is estimated as well and falls, because "
            "the plant has none: bottom, its standard deviation for the lateral velocity.",
            "Relative error of four parameters and the process noise over the iterations",
        ),
        Heading("What is identified?"),
        _table(runs, truth),
        Heading("Does Q point to the right value at the first iteration?"),
        Prose(plain(_directions(*q, truth))),
        Picture(
            profiles(*q, truth),
            "Q over each parameter, the other three at their wrong start, less its value at the start (figure 3.10 of "
            "Sun). Its maximum (dot) need not lie at the truth (dashed) while the others are wrong.",
            "Q over four parameters",
        ),
        Heading("How do smoother, filter, search and likelihood differ?"),
        _comparison(outcomes, truth),
        Prose(
            plain(
                "The filter's E-step weighs pairs of neighbouring samples by the measurements up to the later one, "
                "the smoother's by all. One at a time is Sun's search, with an E-step after each parameter; the "
                "stiffnesses are strongly correlated, so it moves along a narrow ridge in small steps. The likelihood "
                "method works with the extended Kalman filter in place of particles."
            )
        ),
        Heading("How it was made"),
        Listing(command),
    ]
    return Report("Does EM with particles find the parameters of the car of Sun 2015?", blocks)


def _directions(values: Floats, q: Floats, truth: Floats) -> str:
    largest = values[np.arange(len(truth)), q.argmax(axis=1)]
    shares = (f"{s.split()[0]} {100 * (v / t - 1):+.0f} %" for s, v, t in zip(SYMBOLS, largest, truth, strict=True))
    return f"With the other three at their wrong start, Q is largest off the truth by {', '.join(shares)}."


def _table(runs: Sequence[Outcome], truth: Floats) -> Sheet:
    values, error = np.array([o.values for o in runs]), errors(runs, truth)
    rows = [
        [
            SYMBOLS[i],
            f"{truth[i]:.4g}",
            f"{PRINTED[i][0]:.4g}",
            f"{PRINTED[i][1]:g} %",
            f"{np.median(values[:, i]):.4g}",
            f"{style.number(float(np.median(error[:, i])), 2)} %",
            f"{style.number(float(np.quantile(error[:, i], 0.95)), 2)} %",
            f"{GOALS[i]:g} %",
        ]
        for i in range(len(truth))
    ]
    header = ["parameter", "reference", "Sun", "its error", "ours, median", "median error", "95 % below", "goal"]
    return Sheet(header, rows, f"Table 3.2 of Sun (one run) beside {len(runs)} recordings with fresh noise.")


def _comparison(by_variant: Mapping[str, Sequence[Outcome]], truth: Floats) -> Sheet:
    count = min(len(outcomes) for outcomes in by_variant.values())
    rows = []
    for name, outcomes in by_variant.items():
        some = outcomes[:count]
        median = np.median(errors(some, truth), axis=0)
        rows.append(
            [
                name,
                *(f"{style.number(m, 2)} %" for m in median),
                f"{sum(o.converged for o in some)} of {count}",
                f"{style.number(float(np.median([o.seconds for o in some])), 2)} s",
            ]
        )
    header = ["method", *(s.split()[0] for s in SYMBOLS), "converged", "CPU time"]
    return Sheet(header, rows, f"Median relative errors over the same {count} recordings; median CPU time of a fit.")


def _formula(name: str) -> str:
    """Return the symbol as a formula: ``C_sf in 1/rad`` becomes ``$C_{sf}$``."""
    letter, _, index = name.split()[0].partition("_")
    return f"${letter}_{{{index}}}$" if index else f"${letter}$"


def convergence(runs: Sequence[Outcome], truth: Floats) -> bytes:
    """Draw the iterates of all runs, a panel per parameter and one for the process noise (figure 3.11)."""
    with style.drawing():
        fig = style.figure(7.6)
        panels = fig.subplots(len(truth) + 1, 1, sharex=True)
        for i, axes in enumerate(panels):
            for number, run in reversed(list(enumerate(runs))):
                line = 100 * (run.path[:, i] / truth[i] - 1) if i < len(truth) else run.process[:, 0]
                look = {"color": _MARK, "lw": 1.2} if number == 0 else {"color": _LINE, "lw": 0.4, "alpha": 0.4}
                axes.plot(line, **look)
            axes.grid(axis="y")
            if i < len(truth):
                axes.axhline(0.0, color=style.TRUTH, lw=0.7, ls="--")
                axes.set_yscale("symlog", linthresh=1.0)
                axes.yaxis.set_major_formatter(lambda value, _: f"{value:g}")
                axes.set_ylabel(f"{_formula(SYMBOLS[i])}\nerror in %", parse_math=True)
            else:
                path = np.concatenate([run.process[:, 0] for run in runs])
                style.logarithmic(axes, float(path.min()), float(path.max()))
                axes.set_ylabel("process noise\nin m/s")
        panels[-1].set_xlabel("iteration")
        handles = [
            Line2D([], [], color=_MARK, lw=1.2, label="first recording"),
            Line2D([], [], color=_LINE, lw=0.6, label="the others"),
            Line2D([], [], color=style.TRUTH, lw=0.7, ls="--", label="truth"),
        ]
        style.head(fig, "How fast does EM converge, and to which values?", handles)
        return style.svg(fig)


def profiles(values: Floats, q: Floats, truth: Floats) -> bytes:
    """Draw Q over each parameter (figure 3.10)."""
    with style.drawing():
        fig = style.figure(6.4)
        for axes, name, v, height, true in zip(fig.subplots(len(truth), 1), SYMBOLS, values, q, truth, strict=True):
            axes.plot(v, height, color=_LINE)
            axes.plot(v[height.argmax()], height.max(), "o", color=_MARK, ms=5)
            axes.axvline(true, color=style.TRUTH, lw=0.8, ls="--")
            axes.set_xlabel(f"{_formula(name)} in {name.split()[-1]}", parse_math=True)
            axes.set_ylabel("Q")
            axes.grid(axis="y")
        handles = [
            Line2D([], [], color=_MARK, marker="o", ls="", label="largest Q"),
            Line2D([], [], color=style.TRUTH, lw=0.8, ls="--", label="truth"),
        ]
        style.head(fig, "Where is Q largest along each parameter?", handles)
        return style.svg(fig)
