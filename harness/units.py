"""Text with a unit becomes a number in SI units: ``"24 t"`` is ``24000.0`` where kg is expected.

Stricter than pint on three counts: an angle is not a plain number (pint lets ``rad``, ``%`` and ``1`` convert
into each other and makes 6.28 Hz of ``"60 rpm"``), a mass in ``"ton"`` is refused (907 kg in pint, 1000 kg to
most readers; ``"t"`` is the metric tonne), and text begins with a number (pint reads ``"kg"`` as 1 kg).
"""

from __future__ import annotations

import functools
import math
import re

import pint

from harness.errors import UserError

_AMBIGUOUS = {"ton": "'t' (1000 kg)", "tons": "'t' (1000 kg)"}
_NUMBER_FIRST = re.compile(r"\s*[+-]?\s*(\d|\.\d)")


@functools.cache
def registry() -> pint.UnitRegistry:
    """Return the project's one unit registry (quantities of two registries do not mix)."""
    return pint.UnitRegistry(autoconvert_offset_to_baseunit=True)


def to_si(value: object, unit: str, where: str) -> float:
    """Return a number of a study, channel map or option in SI units.

    Args:
        value: A number, taken to be in ``unit`` already, or text with a unit: ``"60 deg"``, ``"5 %"``.
        unit: SI unit the result is in, as pint reads it; ``""`` or ``"dimensionless"`` for a plain number.
        where: File and key, named in the error.

    Raises:
        UserError: If the value is no finite number, text without a unit, or its unit does not fit.
    """
    if isinstance(value, bool) or not isinstance(value, int | float | str):
        raise UserError(
            f"{where}: expected a number{_in(unit)} or text with a unit, got {type(value).__name__} {value!r}"
        )
    if isinstance(value, str):
        if _is_number(value):
            hint = f"write e.g. '{value} {unit}'" if _in(unit) != " without a unit" else "write it without quotes"
            raise UserError(f"{where}: {value!r} has no unit; {hint}")
        number = _parse(value, unit, where)
    else:
        number = float(value)
    if not math.isfinite(number):
        raise UserError(f"{where}: {value!r} is not a finite number; write one{_in(unit)}")
    return number


def scale(source: str, target: str, where: str) -> float:
    """Return the factor from one unit to another, e.g. ``scale("deg/s", "rad/s", "channel map")``.

    Args:
        source: Unit of the data (one without an offset); ``""`` for a plain number.
        target: Unit wanted.
        where: File and key, named in the error.

    Raises:
        UserError: If a unit is unknown or the two do not fit.
    """
    return _parse(f"1 {_plain(source)}", target, where)


def _parse(text: str, unit: str, where: str) -> float:
    """Convert a number with a unit to a magnitude in ``unit``."""
    for word, better in _AMBIGUOUS.items():
        if re.search(rf"(?<![a-z_]){word}(?![a-z_])", text):
            raise UserError(f"{where}: '{word}' in {text!r} may be the short ton; write {better}")
    example = _example(unit)
    if not _NUMBER_FIRST.match(text):
        raise UserError(f"{where}: {text!r} is not a number with a unit; write e.g. '{example}'")
    units = registry()
    try:
        quantity: pint.Quantity = units.Quantity(text)
        root = quantity.to_root_units().units
    except Exception as error:
        # pint raises its own errors, the tokenizer's and plain arithmetic ones.
        raise UserError(
            f"{where}: cannot read {text!r} as a number with a unit ({error}); write e.g. '{example}'"
        ) from None
    # Root units keep the radian, which pint's dimensions do not.
    if root != units.Quantity(1.0, _plain(unit)).to_root_units().units:
        raise UserError(f"{where}: {text!r} does not fit; a quantity{_in(unit)} is expected, e.g. '{example}'")
    return float(quantity.to(_plain(unit)).magnitude)


def _is_number(text: str) -> bool:
    try:
        float(text)
    except ValueError:
        return False
    return True


def _plain(unit: str) -> str:
    """Return the unit for pint, to which a plain number is ``dimensionless``."""
    return unit.strip() or "dimensionless"


def _in(unit: str) -> str:
    return f" in {unit}" if _plain(unit) != "dimensionless" else " without a unit"


def _example(unit: str) -> str:
    common = {
        "rad": "60 deg",
        "m/s": "36 km/h",
        "Hz": "0.2 Hz",
        "kg": "24 t",
        "s": "80 s",
        "rad/s": "10 deg/s",
    }
    return common.get(unit, "5 %" if _plain(unit) == "dimensionless" else f"1 {unit}")
