"""Text with a unit becomes a number in SI units: ``"24 t"`` is ``24000.0`` where kg is expected.

Stricter than pint, which evaluates any arithmetic and passes over commas (``"1,5 m"`` is 15 m to it, ``"1 500 kg"``
500 kg): text is one number with a decimal point and no thousands separator, then one unit. An angle is not a plain
number (pint lets ``rad``, ``%`` and ``1`` convert into each other and makes 6.28 Hz of ``"60 rpm"``), a mass in
``"ton"`` is refused (907 kg in pint, 1000 kg to most readers; ``"t"`` is the metric tonne).
"""

from __future__ import annotations

import functools
import math
import re
from collections.abc import Mapping
from typing import TYPE_CHECKING

from harness.common.cache import JSON, cache_folder, kept
from harness.common.errors import UserError

if TYPE_CHECKING:
    import pint

_EVERYDAY = (
    ("s", "ms", "min", "h"), ("m", "cm", "mm", "km"), ("rad", "deg", "°"), ("kg", "t"), ("N", "kN"), ("Hz",),
    ("dimensionless", "%"), ("m/s", "km/h"), ("rad/s", "deg/s"), ("m/s^2",), ("N*m", "kN*m"), ("kg*m^2",),
    ("N/rad", "kN/rad", "N/deg", "kN/deg"),
)  # fmt: skip
"""Units as studies write them, by what they measure."""
_AMBIGUOUS = {"ton": "'t' (1000 kg)", "tons": "'t' (1000 kg)"}
_EXPONENT = r"(?:[eE][+-]?\d+)?"
_NUMBER = re.compile(rf"[+-]?\s*(?:\d+\.?\d*|\.\d+){_EXPONENT}", re.ASCII)
_NOT_FINITE = re.compile(r"[+-]?\s*(?:nan|inf|infinity)", re.IGNORECASE)
_UNIT = re.compile(
    r"(?![*^⁺⁻⁰¹²³⁴-⁹])"
    r"(?:(?<![\w.])1\s*/|[A-Za-zÅµͰ-ϿΩ]\w*|[%‰°]|(?:\*\*|\^)\s*(?:[+-]?\d+(?:\.\d+)?|\([^,()]*\))|[⁺⁻⁰¹²³⁴-⁹]+|[*/·()\s])*"
)
_ROOT = re.compile(r"\bsqrt\(([^()]*)\)")
"""A square root, as walks have it (``m/sqrt(h)``), which pint does not read."""
_SQUARED = 1e150
"""Largest size of a number, and by its inverse the smallest one: the squares of both are numbers."""
_MARKS = ",'’‘`´_"
_SEPARATED = re.compile(rf"([+-]?\s*)(\d*(?:[.{_MARKS}]+\d+|\s\d{{3}}(?!\d))+)(?=({_EXPONENT}))\3(.*)", re.DOTALL)
_GROUPED_CELL = re.compile(rf"[+-]?(?:\d{{1,3}}(?:[{_MARKS}\s]\d{{3}})+(?:[.,]\d+)?|\d*,\d+{_EXPONENT})")
"""A cell of a table that is surely meant as a number; ``2024_09_16`` and ``16.09.2024`` are not."""


@functools.cache
def registry() -> pint.UnitRegistry:
    """Return the project's one unit registry (quantities of two registries do not mix).

    Raises:
        UserError: If the cache is refused.
    """
    import pint

    folder = cache_folder() / "units"
    try:  # reading pint's definitions takes ten times as long as what it keeps of them
        return pint.UnitRegistry(autoconvert_offset_to_baseunit=True, cache_folder=folder)
    except Exception:  # whatever reading damaged pickles raises, or writing where nothing may be written
        return pint.UnitRegistry(autoconvert_offset_to_baseunit=True)


def to_si(value: object, unit: str, where: str) -> float:
    """Return a number of a study, channel map or option in SI units.

    Args:
        value: A number, taken to be in ``unit`` already, or text with a unit: ``"60 deg"``, ``"5 %"``.
        unit: SI unit the result is in, as pint reads it; ``""`` or ``"dimensionless"`` for a plain number.
        where: File and key, named in the error.

    Raises:
        UserError: If the value is no finite number, too large or too small to be squared, text without a unit, text
            with a decimal comma or a thousands separator, or its unit does not fit.
    """
    if isinstance(value, bool) or not isinstance(value, int | float | str):
        raise UserError(
            f"{where}: expected a number{_in(unit)} or text with a unit, got {type(value).__name__} {value!r}"
        )
    if isinstance(value, str):
        if unclear := separators(value):
            raise UserError(f"{where}: {unclear}")
        plain = plain_number(value)
        if plain is not None and math.isfinite(plain):
            hint = f"write e.g. '{value} {unit}'" if _in(unit) != " without a unit" else "write it without quotes"
            raise UserError(f"{where}: {value!r} has no unit; {hint}")
        number = _parse(value, unit, where) if plain is None else plain
    else:
        number = float(value)
    if not math.isfinite(number):
        raise UserError(f"{where}: {value!r} is not a finite number; write one{_in(unit)}")
    _refuse_extreme(number, value, where)
    return number


def _refuse_extreme(number: float, value: object, where: str) -> None:
    """Refuse a number whose square, a variance say, would be infinite or 0."""
    if number and not 1 / _SQUARED <= abs(number) <= _SQUARED:
        size = "large" if abs(number) > 1 else "small"
        raise UserError(f"{where}: {value!r} is too {size} to be squared; write 0, or a size from 1e-150 to 1e150")


def si_unit(written: str) -> str:
    """Return the SI unit without a prefix that a unit belongs to: ``N/rad`` for ``kN/rad``, ``kg`` for ``t``.

    Raises:
        UserError: If it is no unit.
    """
    try:
        quantity = registry().Quantity(1.0, written or "dimensionless")
        plain = 1.0 * registry().dimensionless
        for name, power in quantity.unit_items():
            plain *= registry().Quantity(1.0, registry().parse_unit_name(name)[0][1]) ** power
        units = plain.units if plain.to_base_units().magnitude == 1.0 else quantity.to_base_units().units
    except Exception as error:  # pint raises of many kinds
        raise UserError(f"'{written}' is no unit: {error}") from None
    return "" if units == registry().dimensionless else f"{units:~}".replace(" ", "")


def line(written: str, unit: str) -> tuple[float, float]:
    """Return factor and offset that take numbers of one unit to another.

    Raises:
        UserError: If the units do not fit.
    """
    try:
        own, other = (registry().Unit(each or "dimensionless") for each in (written, unit))
        zero, one = (registry().Quantity(x, own).to(other).magnitude for x in (0.0, 1.0))
    except Exception as error:  # pint raises of many kinds
        raise UserError(f"'{written}' does not fit the unit '{unit or 'none'}': {error}") from None
    return float(one - zero), float(zero)


def plain_number(text: str) -> float | None:
    """Return the number that a text is, NaN and infinity included; ``None`` if it has a unit or is no number.

    ``float`` would take more: ``"1_500"`` and digits of other scripts.
    """
    text = _plain_signs(text)
    if _NUMBER.fullmatch(text):
        return float(text.replace(" ", ""))
    return float(text.replace(" ", "")) if _NOT_FINITE.fullmatch(text) else None


def split(text: str) -> tuple[str, str] | None:
    """Return number and unit of a text, or ``None`` if it is not one number with a unit."""
    text = _plain_signs(text)
    number = _NUMBER.match(text)
    unit = text[number.end() :].strip() if number else ""
    return (number.group(), unit) if number and _UNIT.fullmatch(unit) else None


def separators(text: str) -> str:
    """Return the readings of a text that begins with a number with a decimal comma or thousands separators.

    Returns:
        The readings and the remedy; empty if the text begins with no such number.
    """
    meant = " or ".join(f"'{reading}'" for reading in _readings(text))
    if " or " in meant:
        return f"{text!r} may mean {meant}; write the one that is meant (decimal point, no thousands separator)"
    return f"{text!r} means {meant}; write it so (decimal point, no thousands separator)" if meant else ""


def separators_in_cell(text: str) -> str:
    """Return the same for a whole cell of a table, where a text may as well be a date or a label."""
    return separators(text) if _GROUPED_CELL.fullmatch(_plain_signs(text)) else ""


def refuse_misread(values: object, where: str) -> None:
    """Refuse settings, at any depth, with a number that has separators as text, is not finite, or cannot be squared.

    Args:
        values: What a file or an option gives for settings that pydantic reads, which takes ``"1_5"`` for 15.
        where: File and key, named in the error.

    Raises:
        UserError: If there is one.
    """
    if isinstance(values, Mapping):
        for key, value in values.items():
            refuse_misread(value, f"{where}.{key}" if where else str(key))
    elif isinstance(values, list | tuple):
        for i, value in enumerate(values):
            refuse_misread(value, f"{where}[{i}]")
    elif isinstance(values, str):
        match = _SEPARATED.match(_plain_signs(values))
        if match and not match[4] and (unclear := separators(values)):
            raise UserError(f"{where}: {unclear}")
        values = plain_number(values)
    if isinstance(values, float) and not math.isfinite(values):
        raise UserError(f"{where}: {values!r} is not a finite number")
    if isinstance(values, float):
        _refuse_extreme(values, values, where)


def _readings(text: str) -> list[str]:
    """Return what a text that begins with a number with separators may mean; empty if it begins with none."""
    match = _SEPARATED.match(_plain_signs(text))
    if match is None:
        return []
    sign, digits, exponent, unit = match.groups()
    if digits.count(".") == sum(not c.isdigit() for c in digits) <= 1:
        return []  # an ordinary number
    *_, last = (c for c in digits if not c.isdigit())
    whole, _, decimals = digits.rpartition(last)
    if last == "." in whole and not all(len(group) == 3 for group in digits.split(".")[1:]):
        return []  # neither a number nor groups of digits
    candidates = [f"{_digits(whole) or '0'}.{decimals}"] if last in ".," and last not in whole else []
    candidates += [_digits(digits).lstrip("0") or "0"] if last != "." or last in whole else []
    return [f"{sign}{number}{exponent}{unit}" for number in candidates]


def _digits(text: str) -> str:
    return re.sub(r"\D", "", text)


def _plain_signs(text: str) -> str:
    """Return a text with the minus sign of typography as the one of programs."""
    return text.strip().replace("−", "-")


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
    if not _NUMBER.match(_plain_signs(text)):
        raise UserError(f"{where}: {text!r} is not a number with a unit; write e.g. '{example}'")
    parts = split(text)
    if parts is None:
        raise UserError(
            f"{where}: cannot read {text!r} as one number with one unit; write e.g. '{example}', with a decimal point"
        )
    number, source = float(parts[0].replace(" ", "")), parts[1]
    try:
        zero_value, unit_value = _ends(source, _plain(unit))
        if zero_value != 0.0:  # of a temperature, say
            return _converted(number, source, _plain(unit))
        return number * unit_value
    except _Unfit as unfit:
        gram = "; 'g' is the gram, standard gravity is 'g_0'" if unfit.is_gram else ""
        raise UserError(
            f"{where}: {text!r} does not fit; a quantity{_in(unit)} is expected, e.g. '{example}'{gram}"
        ) from None
    except UserError:  # of the cache of units
        raise
    except Exception as error:
        # pint raises its own errors, the tokenizer's and plain arithmetic ones.
        raise UserError(
            f"{where}: cannot read {text!r} as a number with a unit ({error}); write e.g. '{example}'"
        ) from None


class _Unfit(Exception):
    """Two units have other dimensions."""

    def __init__(self, is_gram: bool) -> None:
        super().__init__()
        self.is_gram = is_gram


@functools.lru_cache(maxsize=1024)
def _ends(source: str, target: str) -> tuple[float, float]:
    """Return what 0 and 1 of a unit are in another one."""
    of_zero, of_one = _everyday().get(f"{source} in {target}") or [_converted(n, source, target) for n in (0.0, 1.0)]
    return of_zero, of_one


@functools.cache
def _everyday() -> dict[str, list[float]]:
    """Return the ends of common conversions, from an earlier process: a start without pint is a fifth shorter."""
    from importlib.metadata import version  # which brings the package email with it; help does without

    def made() -> dict[str, list[float]]:
        pairs = [(a, b) for group in _EVERYDAY for a in group for b in group]
        return {f"{a} in {b}": [_converted(n, a, b) for n in (0.0, 1.0)] for a, b in pairs}

    return kept("conversions", f"pint {version('pint')} {_EVERYDAY}", made, JSON)


def _converted(number: float, source: str, target: str) -> float:
    """Return a number of one unit in another one, by pint."""
    units = registry()
    text = _ROOT.sub(r"(\1)**0.5", source)
    quantity: pint.Quantity = units.Quantity(f"{number!r} {text}")
    root = quantity.to_root_units().units
    # Root units keep the radian, which pint's dimensions do not.
    if root != units.Quantity(1.0, target).to_root_units().units:
        raise _Unfit(target == "m/s^2" and root == units.gram)
    return float(quantity.to(target).magnitude)


def _plain(unit: str) -> str:
    """Return the unit for pint, to which a plain number, in unit 1, is ``dimensionless``."""
    return "dimensionless" if unit.strip() in ("", "1") else unit.strip()


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
