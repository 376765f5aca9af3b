"""Units of FMUs: from their definitions, or their names as Modelica writes them, to the SI units of signals."""

from __future__ import annotations

import math
import re
from typing import Any, NamedTuple

from harness.common.errors import UserError
from harness.common.units import registry, scale, to_si
from harness.external.fmu.model import BaseUnit, FmuModel

_EXPONENT = re.compile(r"([A-Za-z])(-?\d+)")
_PINT = {"kilogram": "kg", "meter": "m", "second": "s", "ampere": "A", "kelvin": "K", "mole": "mol", "candela": "cd"}
_REMEDY = 'state the right one in the map: { variable = "...", unit = "..." }'
_PLAIN = ("", "1", "-", "dimensionless")


class Conversion(NamedTuple):
    """A value in SI is ``scale`` times that of the variable plus ``offset``, in ``unit``."""

    scale: float
    offset: float
    unit: str


def written(unit: str) -> str:
    """Return a unit as pint reads it: Modelica writes ``kg.m2`` and ``N.m/rad``."""
    return _EXPONENT.sub(r"\1^\2", unit.replace(".", "*")) if unit not in _PLAIN else "dimensionless"


def stated(unit: str, target: str, where: str) -> Conversion:
    """Return the conversion of a unit that a map or a study states.

    Args:
        unit: As stated.
        target: SI unit that it must fit; empty for that of whatever it measures.
        where: File and key, named in the error.

    Raises:
        UserError: If it is none, or does not fit.
    """
    source = written(unit)
    if not target:
        target = _coherent(source, where)
    if source == "dimensionless" or target in _PLAIN:
        return Conversion(scale(source, target, where), 0.0, target)
    zero = to_si(f"0 {source}", target, where)
    return Conversion(to_si(f"1 {source}", target, where) - zero, zero, target)


def of_variable(model: FmuModel, unit: str, target: str, where: str) -> Conversion:
    """Return the conversion of a unit that an FMU states for a variable.

    Args:
        model: The FMU, whose definition of the unit counts where there is one.
        unit: Its name.
        target: SI unit that it must fit.
        where: File and key, named in the error.

    Raises:
        UserError: If it does not fit, or nobody says what it is.
    """
    defined = model.units.get(unit)
    if defined is None:
        try:
            scale(written(unit), written(unit), where)
        except UserError:
            raise UserError(f"{where}: nobody knows its unit '{unit}'; {_REMEDY}") from None
        return stated(unit, target, where)
    if not defined.exponents and defined.factor == 1.0:
        return stated("1", target, where)
    if dict(defined.exponents) != dict(exponents(target)) and not _lacks_radians_only(unit, defined, target):
        raise UserError(
            f"{where}: its unit '{unit}' is {base_units(defined.exponents)} in base units, but {target or '1'} is "
            f"expected; {_REMEDY}"
        )
    return Conversion(defined.factor, defined.offset, target)


def _lacks_radians_only(unit: str, defined: BaseUnit, target: str) -> bool:
    """Return whether a unit fits by its name, and its definition does not know the radian, as some tools write it."""
    wanted, has = dict(exponents(target)), dict(defined.exponents)
    wanted.pop("rad", None)
    try:
        by_name = stated(unit, target, "")
    except UserError:
        return False
    return has == wanted and math.isclose(by_name.scale, defined.factor)


def of_parameter(model: FmuModel, unit: str) -> Conversion | None:
    """Return the conversion of a parameter's unit to SI; ``None`` where nobody says what it is."""
    defined = model.units.get(unit)
    try:
        conversion = stated(unit, "", "")
    except UserError:
        conversion = None
    if defined is None:
        return conversion
    if conversion is not None and (math.isclose(conversion.scale, defined.factor) and _same(conversion, defined)):
        return Conversion(defined.factor, defined.offset, conversion.unit)
    return Conversion(defined.factor, defined.offset, base_units(defined.exponents))


def _same(conversion: Conversion, defined: BaseUnit) -> bool:
    return dict(exponents(conversion.unit)) == dict(defined.exponents)


def _coherent(source: str, where: str) -> str:
    """Return the SI unit of what a unit measures: itself where it is one."""
    if source == "dimensionless":
        return source
    scale(source, source, where)  # whether it is a unit at all
    base = base_units(exponents(source))
    zero = to_si(f"0 {source}", base, where)
    return source if zero == 0.0 and to_si(f"1 {source}", base, where) == 1.0 else base


def exponents(unit: str) -> tuple[tuple[str, int], ...]:
    """Return the exponents of the base units of SI of a unit that pint reads."""
    if unit in _PLAIN:
        return ()
    units = registry()
    root = units.Quantity(1.0, unit).to_root_units().units
    order = ["kg", "m", "s", "A", "K", "mol", "cd", "rad"]
    result: dict[str, Any] = {}
    powers: dict[str, Any] = dict(root._units)
    for name, power in powers.items():
        short = {**_PINT, "gram": "kg", "radian": "rad"}.get(name, name)
        result[short] = power if int(power) != power else int(power)
    return tuple(sorted(result.items(), key=lambda e: order.index(e[0]) if e[0] in order else len(order)))


def base_units(powers: tuple[tuple[str, int], ...]) -> str:
    """Return base units as text that pint reads."""
    above = [name if power == 1 else f"{name}^{power}" for name, power in powers if power > 0]
    below = [name if power == -1 else f"{name}^{-power}" for name, power in powers if power < 0]
    if not above and not below:
        return "dimensionless"
    divisor = f"({'*'.join(below)})" if len(below) > 1 else "".join(below)
    return f"{'*'.join(above) or '1'}{'/' if below else ''}{divisor}"
