"""Quantities as people read them: words, printed units and symbols of signals and parameters."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from harness.common.arrays import Floats
from harness.common.units import registry
from harness.models.signals import SIGNALS, turn_of


@dataclass(frozen=True)
class Quantity:
    """A signal as the report shows it.

    Attributes:
        name: Signal name.
        words: The name in words.
        symbol: LaTeX symbol for figures; the words where the signal has none.
        unit: Report unit as printed, e.g. ``kN`` or ``°``; empty for a plain number.
        scale: Report units per SI unit.
        meaning: One phrase of the table of signals.
    """

    name: str
    words: str
    symbol: str
    unit: str
    scale: float
    meaning: str = ""


def words(name: str) -> str:
    """Write a name of the project in words: ``trailer_cog_from_rear`` becomes ``trailer CoG from rear``."""
    return re.sub(r"\bcog\b", "CoG", name.replace("_", " ").strip())


def capital(text: str) -> str:
    """Write a text with a capital letter at its beginning; all others stay."""
    return text[:1].upper() + text[1:]


def print_unit(unit: str) -> str:
    """Write a unit as it is printed: ``m/s^2`` becomes ``m/s²``, ``deg`` becomes ``°``."""
    unit = unit.replace("**", "^").replace("*", "·")
    unit = re.sub(r"\bdeg(ree)?\b", "°", unit)
    for digit, raised in zip("234", "²³⁴", strict=True):
        unit = unit.replace(f"^{digit}", raised)
    return "" if unit in ("1", "dimensionless") else unit


def quantity(name: str, si_unit: str = "") -> Quantity:
    """Look a signal up; one that is not in the table is shown in its SI unit under its own name.

    Args:
        name: Signal name.
        si_unit: Unit of the stored numbers; empty for that of the table.
    """
    signal = SIGNALS.get(name)
    if signal is None:
        symbol = words(name).replace(" ", r"\ ")
        return Quantity(name, words(name), rf"\mathrm{{{symbol}}}", print_unit(si_unit), 1.0)
    source = registry().Quantity(1.0, si_unit or signal.unit)
    scale = float(source.to(signal.report_unit).magnitude)
    return Quantity(name, words(name), signal.symbol, print_unit(signal.report_unit), scale, signal.meaning)


def listed(parts: Sequence[str]) -> str:
    """Join with commas and ``and``; ``nothing`` if there are no parts."""
    if not parts:
        return "nothing"
    return parts[0] if len(parts) == 1 else f"{', '.join(parts[:-1])} and {parts[-1]}"


def difference(name: str, values: Floats, others: Floats) -> Floats:
    """Return values of a signal less others of it; of a periodic one modulo a turn, from -pi to pi."""
    apart: Floats = np.asarray(values) - np.asarray(others)
    turn = turn_of(name)
    return apart - turn * np.floor(apart / turn + 0.5) if turn else apart
