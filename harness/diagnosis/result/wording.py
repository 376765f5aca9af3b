"""What a disturbance looks like, where it acts and how large it is, in words."""

from __future__ import annotations

import numpy as np

from harness.diagnosis.innovations.disturbance_inputs import DisturbanceInput
from harness.diagnosis.residuals.order_analysis import PeriodicDisturbance
from harness.diagnosis.residuals.spline_curves import Curve
from harness.diagnosis.residuals.unmodelled import UnmodelledDisturbance
from harness.models.quantities import print_unit, quantity, words
from harness.models.signals import SIGNALS
from harness.reporting import style

_PURE = 0.8
"""Share of a curve's power from which it counts as odd or even."""

_SURE = 0.95
"""Probability from which a claim is made without a word of doubt."""

_LIKELY = 2 / 3
"""Probability from which what is claimed is called probable, as the IPCC does (Mastrandrea et al. 2010)."""

_CLAIMS = {
    "lacks": ("probably lacks", "may lack"),
    "have": ("probably have", "may have"),
    "was wrong": ("was probably wrong", "may have been wrong"),
    "were wrong": ("were probably wrong", "may have been wrong"),
    "is": ("is probably", "may be"),
}
"""What is claimed of something probable, and of something that may as well not be so."""

_FLAT = 0.3
"""Slope at the end of a curve over its steepest one, below which it saturates."""


def unmodelled_words(found: UnmodelledDisturbance) -> list[str]:
    """Return what each part of an unmodelled disturbance looks like."""
    return [*map(described, found.periodic), *map(described, found.curves)]


def described(found: Curve | PeriodicDisturbance) -> str:
    """Say what a disturbance looks like."""
    return _periodic(found) if isinstance(found, PeriodicDisturbance) else _curve(found)


def _periodic(found: PeriodicDisturbance) -> str:
    grows = f" at {style.number(found.speed)} m/s and growing with the square of the speed" if found.growth else ""
    size = amount(found.amplitude, found.disturbance_input)
    return (
        f"{entry(found.disturbance_input)}, once per {style.number(found.wavelength)} m driven, reaching {size}" + grows
    )


def _curve(curve: Curve) -> str:
    """Say what a curve looks like: ``coupling moment, odd in the articulation angle, reaching 16 kN·m``."""
    low, high = curve.basis.ends
    reach = min(-low, high)
    kind = "a function of"
    if reach > 0.3 * max(-low, high):
        grid = np.linspace(0.0, reach, 100)
        left, right = curve.at(-grid), curve.at(grid)
        odd, even = 0.5 * (right - left), 0.5 * (right + left)
        total = np.sum(odd**2) + np.sum(even**2)
        kind = "odd in" if np.sum(odd**2) > _PURE * total else "even in" if np.sum(even**2) > _PURE * total else kind
    grid = np.linspace(low, high, 200)
    values = curve.at(grid)
    slopes = np.abs(np.gradient(values, grid))
    ends = max(slopes[2], slopes[-3])
    largest = float(np.abs(values).max())
    verb = "saturating at" if ends < _FLAT * slopes.max() and np.argmax(slopes) not in (0, 199) else "reaching"
    return f"{entry(curve.disturbance_input)}, {kind} the {curve.regressor.words}, {verb} " + amount(
        largest, curve.disturbance_input
    )


def entry(disturbance_input: DisturbanceInput) -> str:
    """Return an input in words."""
    if disturbance_input.kind == "equation":
        return f"equation of the {words(disturbance_input.ports[0])}"
    return (
        f"sensor of the {words(disturbance_input.name)}"
        if disturbance_input.kind == "sensor"
        else words(disturbance_input.name)
    )


def amount(value: float, disturbance_input: DisturbanceInput) -> str:
    """Write a disturbance with its unit as reports do."""
    unit, scale = shown(disturbance_input)
    return style.with_unit(scale * value, unit)


def shown(disturbance_input: DisturbanceInput) -> tuple[str, float]:
    """Return the unit in which reports show a disturbance, and how many of it make an SI unit."""
    if disturbance_input.kind == "equation":
        return print_unit(disturbance_input.unit), 1.0
    q = quantity(disturbance_input.ports[0].removeprefix("sensor_"))
    known = SIGNALS.get(q.name)
    return (
        (q.unit, q.scale)
        if known and known.unit == disturbance_input.unit
        else (print_unit(disturbance_input.unit), 1.0)
    )


def in_words(probability: float) -> str:
    """Write a probability as a number of cases: ``9 in 10``."""
    if probability > 0.995:
        return "more than 99 in 100"
    if probability < 0.005:
        return "less than 1 in 100"
    tenths = 0.05 <= probability < 0.95
    return f"{round(10 * probability)} in 10" if tenths else f"{round(100 * probability)} in 100"


def claim(verb: str, probability: float | None, rest: str = "") -> str:
    """Return a claim that is as strong as its probability, which follows it where there is doubt.

    Args:
        verb: One of ``_CLAIMS``.
        probability: ``None`` where it is not known.
        rest: What follows the verb.
    """
    if probability is None or probability >= _SURE:
        return f"{verb} {rest}".rstrip()
    probably, may = _CLAIMS[verb]
    return f"{f'{probably if probability >= _LIKELY else may} {rest}'.rstrip()} ({in_words(probability)})"
