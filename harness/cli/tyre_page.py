"""Page of the tyres of a parameter file: the curve of each, with a Magic Formula of four coefficients fitted."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.lines import Line2D
from scipy.optimize import least_squares

from harness.common.arrays import Floats
from harness.config.derived import axles_of
from harness.config.specs import ModelSpec
from harness.config.tyre_parameters import FittedTyre, remarks
from harness.models.quantities import words
from harness.reporting import style
from harness.reporting.document import Bullets, Drawing, Report, Section, Sheet, plain

LARGEST = np.radians(15.0)
"""Slip angle to which curves are drawn and fitted; tyres are measured about so far."""

LOADS = (0.5, 1.0, 1.5)
"""Over the static load; the fit is to 1."""

_FILE, _FOUR = style.looks(["file", "four coefficients"]).values()


def magic_formula(slip: Floats, b: float, c: float, d: float, e: float) -> Floats:
    """Return ``D sin(C atan(B a - E (B a - atan(B a))))`` (Pacejka 2012, 4.10)."""
    x = b * slip
    force: Floats = d * np.sin(c * np.arctan(x - e * (x - np.arctan(x))))
    return force


def four_coefficients(slip: Floats, force: Floats) -> tuple[float, float, float, float]:
    """Return B (1/rad), C, D (N) and E of the least squares."""
    largest = float(np.abs(force).max())
    slope = float(force[1] / slip[1])
    first = np.array([slope / (1.3 * largest), 1.3, 1.0, 0.0])

    def rest(x: Floats) -> Floats:
        return magic_formula(slip, x[0], x[1], x[2], x[3]) - force / largest

    fit = least_squares(rest, first, x_scale=[first[0], 1.0, 1.0, 1.0], bounds=([1e-3, 0.1, 0.1, -50], [1e3, 3, 5, 1]))
    b, c, d, e = map(float, fit.x)
    return b, c, d * largest, e


def report(spec: ModelSpec, tyres: Sequence[FittedTyre]) -> Report:
    """Return the page of a model on tyres of property files."""
    axles = axles_of(spec)
    assert axles is not None
    slip, loads = np.linspace(0.0, LARGEST, 121), axles.loads(spec.values)
    curves: dict[str, list[Floats]] = {}
    for tyre in tyres:
        axle = axles.groups[tyre.group][0]
        curves[tyre.group] = [axles.force(axle, spec.values, slip, share * loads[axle]) for share in LOADS]
    fits = {group: four_coefficients(slip, each[LOADS.index(1.0)]) for group, each in curves.items()}
    rows = []
    for group, fit in fits.items():
        b, c, d, e = fit
        off = [
            style.percent(float(np.abs(share * magic_formula(slip, *fit) - curve).max()) / (share * d))
            for share, curve in zip(LOADS, curves[group], strict=True)
        ]
        rows.append([words(group), *(style.number(x) for x in (b, c, d / 1e3, e, b * c * d / 1e3)), *off])
    header = ["tyres", "B in 1/rad", "C", "D in kN", "E", "BCD in kN/rad", *(f"off at {s:g} F_z" for s in LOADS)]
    return Report(
        f"Which lateral force do the tyres of the {words(spec.vehicle)} have?",
        [
            Section(lambda: [Bullets([plain(f"{line}.") for line in remarks(spec, tyres)])], "From the files"),
            Section(
                lambda: [
                    Drawing(
                        lambda: _drawn(slip, curves, fits),
                        "Steady lateral force of an axle (of a wheel, where the vehicle has wheels) without camber "
                        f"under {', '.join(f'{s:g}' for s in LOADS)} times its static load, and the Magic Formula D "
                        "sin(C atan(B a - E (B a - atan(B a)))) that is fitted at 1 and has D in proportion to the "
                        "load elsewhere.",
                        "Lateral force over slip angle of each group of tyres, from the file and fitted.",
                    ),
                    Sheet(header, rows, f"The fit, and its largest error to {np.degrees(LARGEST):g}° over D.", left=1),
                ],
                "Next to four coefficients",
            ),
        ],
    )


def _drawn(slip: Floats, curves: dict[str, list[Floats]], fits: dict[str, tuple[float, float, float, float]]) -> bytes:
    degrees = np.degrees(slip)
    with style.drawing():
        fig = style.figure(1.2 + 1.9 * len(curves))
        panels = fig.subplots(len(curves), 1, sharex=True, squeeze=False)[:, 0]
        for axes, (group, each) in zip(panels, curves.items(), strict=True):
            for share, curve in zip(LOADS, each, strict=True):
                four = share * magic_formula(slip, *fits[group])
                axes.plot(degrees, curve / 1e3, color=_FILE.line, ls=_FILE.dashes)
                axes.plot(degrees, four / 1e3, color=_FOUR.line, ls=_FOUR.dashes)
            axes.set_title(f"{words(group)}: lateral force in kN", loc="left")
            axes.set_xlim(0.0, degrees[-1])
            axes.set_ylim(bottom=0.0)
            axes.grid(True)
        panels[-1].set_xlabel("slip angle in °")
        handles = [
            Line2D([], [], color=look.line, ls=look.dashes, label=label)
            for look, label in ((_FILE, "of the file"), (_FOUR, "four coefficients"))
        ]
        style.head(fig, "How far do four coefficients follow the tyre?", handles)
        return style.svg(fig)
