"""Description of a plant that is an FMU, by the FMU itself and the map from its variables to signals."""

from __future__ import annotations

import difflib
import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from harness.common.errors import UserError, closest
from harness.common.units import to_si
from harness.external.description import (
    Description,
    ExternalParameter,
    Port,
    digest_of,
    refuse_unfit,
    refuse_unfit_parameter,
)
from harness.external.fmu.model import REALS, FmuModel, Variable, read_model
from harness.external.fmu.units import Conversion, of_parameter, of_variable, stated
from harness.models.contracts import DRIVE_INPUTS
from harness.models.signals import SIGNALS

TABLES = ("inputs", "outputs", "process_noise", "parameters", "limits", "vehicle")
"""Tables of the map of a plant."""

OBSERVER_TABLES = ("inputs", "measurements", "estimates", "variances", "valid", "nis", "parameters")
"""Tables of the map of an observer."""

_PORT_KEYS = ("variable", "unit", "scale", "offset")
_PARAMETER_KEYS = ("variable", "unit", "lower", "upper")


def describe(
    path: Path,
    content: Mapping[str, Any] | None = None,
    where: str = "map",
    file: str | None = None,
    interface: str | None = None,
) -> Description:
    """Return the description of an FMU; nothing of it is unpacked or run.

    Args:
        path: The FMU.
        content: Its map; without one, variables that are called as signals are these signals.
        where: The map's file, named in errors.
        file: The FMU as the study names it.
        interface: ``co-simulation`` or ``model-exchange``; co-simulation where there is a choice and none is stated.

    Raises:
        UserError: If the FMU or its map does not do, in one line that names file and key.
    """
    model = read_model(path)
    used = model.interface(interface)
    model.library(used)
    if not content:
        content, where = named_alike(model), str(path)
        if not content["outputs"]:
            raise UserError(
                f"{path}: none of its outputs is called as a signal is; it needs a map: harness new plant {path.name}"
            )
    ports = _Ports(model, where)
    _refuse_unknown(content, TABLES, where, "table")
    tables = {name: _table(content, name, where) for name in TABLES}
    outputs = ports.of("outputs", tables["outputs"], ("output", "local", "input"))
    if not outputs:
        raise UserError(f"{where}: outputs: a plant publishes something; name at least one signal")
    inputs = ports.of("inputs", tables["inputs"], ("input",))
    disturbances = ports.of("process_noise", tables["process_noise"], ("input",))
    _refuse_twice((*inputs, *disturbances), where)
    _refuse_unknown(tables["vehicle"], ("wheelbase", "steering_ratio"), f"{where}: vehicle")
    _refuse_unknown(tables["limits"], tuple(port.signal for port in outputs), f"{where}: limits", "published signal")
    vehicle = tables["vehicle"]
    description = Description(
        kind="fmu",
        file=str(path) if file is None else file,
        digests={path.name: digest_of(path)},
        inputs=inputs,
        outputs=outputs,
        disturbances=disturbances,
        parameters=parameters(model, tables["parameters"], where),
        limits={
            name: to_si(value, SIGNALS[name].unit, f"{where}: limits.{name}")
            for name, value in tables["limits"].items()
        },
        wheelbase=to_si(vehicle["wheelbase"], "m", f"{where}: vehicle.wheelbase") if "wheelbase" in vehicle else None,
        steering_ratio=(
            to_si(vehicle["steering_ratio"], "dimensionless", f"{where}: vehicle.steering_ratio")
            if "steering_ratio" in vehicle
            else None
        ),
        facts=facts(model, used),
    )
    refuse_unfit(description, where)
    return description


@dataclass(frozen=True)
class Observer:
    """Variables of an estimator that is an FMU.

    Attributes:
        inputs, measurements, estimates, variances: What it is given and gives.
        nis: Variable that is the normalised innovation squared.
        valid: Inputs that say whether a measurement is there, by signal.
        parameters: Its parameters.
    """

    inputs: tuple[Port, ...]
    measurements: tuple[Port, ...]
    estimates: tuple[Port, ...]
    variances: tuple[Port, ...]
    nis: str | None
    valid: dict[str, str]
    parameters: tuple[ExternalParameter, ...]


def observer(
    model: FmuModel, content: Mapping[str, Any], names: Mapping[str, Sequence[str] | None], where: str
) -> Observer:
    """Return the variables of an estimator that is an FMU.

    Args:
        model: The FMU.
        content: Its map: tables as for a plant, ``inputs``, ``measurements``, ``estimates``, ``parameters`` and, where
            the FMU gives them, ``variances`` of the estimates; ``valid`` by measurement, and ``nis``. Signals that it
            lacks are variables that are called so.
        names: Signals that it is given, ``inputs`` and ``measurements``, and gives, ``estimates``; ``None`` for those
            of the map or, without one, all variables that are called as signals.
        where: The map's file, or that of the FMU, named in errors.

    Raises:
        UserError: If the FMU or its map does not do.
    """
    _refuse_unknown(content, OBSERVER_TABLES, where, "table")
    ports, alike, given = _Ports(model, where), named_alike(model), {}
    otherwise = {
        "inputs": [n for n in alike["inputs"] if n in DRIVE_INPUTS],
        "measurements": [n for n in alike["inputs"] if n not in DRIVE_INPUTS],
        "estimates": list(alike["outputs"]),
    }
    for name, causalities in (("inputs", ("input",)), ("measurements", ("input",)), ("estimates", ("output", "local"))):
        table, wanted = _table(content, name, where), names[name]
        if wanted is None:
            wanted = list(table) if content else otherwise[name]
        given[name] = ports.of(name, {n: table.get(n, n) for n in wanted}, causalities)
    _refuse_twice((*given["inputs"], *given["measurements"]), where)
    spread, nis = _table(content, "variances", where), content.get("nis")
    estimates = [p.signal for p in given["estimates"]]
    if not estimates:
        raise UserError(f"{where}: estimates: an observer estimates something; name at least one signal")
    missing = [n for n in estimates if spread and n not in spread]
    if missing:
        raise UserError(f"{where}: variances: there is none of {missing[0]}; state them of all estimates, or of none")
    variances = [
        Port(p.signal, scalar_variable(model, spread[p.signal], f"{where}: variances.{p.signal}").name, "", p.scale**2)
        for p in given["estimates"]
        if spread
    ]
    return Observer(
        **given,
        variances=tuple(variances),
        nis=None if nis is None else scalar_variable(model, nis, f"{where}: nis").name,
        valid=dict(_table(content, "valid", where)),
        parameters=parameters(model, _table(content, "parameters", where), where),
    )


def facts(model: FmuModel, interface: str) -> dict[str, str]:
    """Return what else there is to say of an FMU."""
    stated_ = {
        "model": model.name,
        "fmi_version": f"{model.version}.0",
        "interface": interface,
        "platforms": ", ".join(model.platforms),
        "generation_tool": model.tool,
        "one_per_process": "yes" if interface in model.one_per_process else "",
        "needs_tool": "yes" if interface in model.needs_tool else "",
        "keeps_state": "yes" if interface in model.keeps_state else "",
    }
    return {name: value for name, value in stated_.items() if value}


def named_alike(model: FmuModel) -> dict[str, dict[str, str]]:
    """Return a map of the variables that are called as signals are."""
    reals = [v for v in model.variables.values() if v.is_real and v.name in SIGNALS]
    return {
        "inputs": {v.name: v.name for v in reals if v.causality == "input"},
        "outputs": {v.name: v.name for v in reals if v.causality == "output"},
    }


def _table(content: Mapping[str, Any], name: str, where: str) -> Mapping[str, Any]:
    table = content.get(name, {})
    if not isinstance(table, Mapping):
        raise UserError(f"{where}: {name}: expected a table [{name}], got {type(table).__name__} {table!r}")
    return table


def _refuse_unknown(table: Mapping[str, Any], names: tuple[str, ...], where: str, what: str = "key") -> None:
    for key in table:
        if key not in names:
            raise UserError(f"{where}: unknown {what} '{key}'{closest(key, names)}")


def _refuse_twice(ports: Iterable[Port], where: str) -> None:
    by_variable: dict[str, str] = {}
    for port in ports:
        if port.variable in by_variable:
            raise UserError(
                f"{where}: the variable '{port.variable}' is given both {by_variable[port.variable]} and {port.signal}"
            )
        by_variable[port.variable] = port.signal


@dataclass(frozen=True)
class _Entry:
    """What a map says of a signal or parameter."""

    variable: str
    settings: Mapping[str, Any]


def _entry(value: object, keys: tuple[str, ...], key: str) -> _Entry:
    if isinstance(value, str):
        return _Entry(value, {})
    if not isinstance(value, Mapping) or not isinstance(value.get("variable"), str):
        raise UserError(
            f'{key}: expected the name of a variable, or {{ variable = "...", unit = "..." }}, got {value!r}'
        )
    _refuse_unknown(value, keys, key)
    unit = value.get("unit", "")
    if not isinstance(unit, str):
        raise UserError(f"{key}.unit: expected text, got {unit!r}")
    return _Entry(value["variable"], value)


class _Ports:
    """Reader of the tables that give signals their variables.

    Args:
        model: The FMU.
        where: File, named in errors.
    """

    def __init__(self, model: FmuModel, where: str) -> None:
        self._model, self._where = model, where

    def of(self, name: str, table: Mapping[str, Any], causalities: tuple[str, ...]) -> tuple[Port, ...]:
        """Return the ports of a table, whose variables must be of one of some causalities."""
        return tuple(self._port(name, signal, value, causalities) for signal, value in table.items())

    def _port(self, name: str, signal: str, value: object, causalities: tuple[str, ...]) -> Port:
        key = f"{self._where}: {name}.{signal}"
        if name != "process_noise" and signal not in SIGNALS:
            near = difflib.get_close_matches(signal, list(SIGNALS), n=3, cutoff=0.5)
            hint = f"; closest: {', '.join(near)}" if near else ""
            raise UserError(f"{key}: no such signal{hint}; harness list signals shows all")
        entry = _entry(value, _PORT_KEYS, key)
        variable = scalar_variable(self._model, entry.variable, key)
        if variable.causality not in causalities:
            raise UserError(
                f"{key}: '{variable.name}' is {_article(variable.causality)} of the FMU, no {causalities[0]}"
            )
        target = SIGNALS[signal].unit if signal in SIGNALS else ""
        own = self._conversion(entry, variable, target, key)
        factor = _number(entry.settings.get("scale", 1.0), f"{key}.scale")
        if factor == 0.0:
            raise UserError(f"{key}.scale: 0 would make nothing of it; write -1 to turn its sign")
        offset = to_si(entry.settings.get("offset", 0.0), own.unit, f"{key}.offset")
        return Port(signal, variable.name, own.unit, own.scale * factor, own.offset + offset)

    def _conversion(self, entry: _Entry, variable: Variable, target: str, key: str) -> Conversion:
        if "unit" in entry.settings:
            return stated(entry.settings["unit"], target, f"{key}.unit")
        if not target:
            return of_parameter(self._model, variable.unit) or Conversion(1.0, 0.0, "dimensionless")
        if not variable.unit and target not in ("1", "dimensionless"):
            raise UserError(
                f"{key}: the FMU states no unit for '{variable.name}'; state it: "
                f'{{ variable = "{variable.name}", unit = "{target}" }}'
            )
        return of_variable(self._model, variable.unit, target, f"{key}: '{variable.name}'")


def scalar_variable(model: FmuModel, name: str, key: str) -> Variable:
    """Return a variable that is one number.

    Raises:
        UserError: If there is none of that name, or it is something else.
    """
    variable = model.variables.get(name)
    if variable is None:
        near = difflib.get_close_matches(name, list(model.variables), n=3, cutoff=0.5)
        hint = f"; closest: {', '.join(near)}" if near else ""
        raise UserError(f"{key}: the FMU has no variable '{name}'{hint}; harness list fmu {model.path.name} shows all")
    if not variable.scalar:
        raise UserError(f"{key}: '{name}' is an array; a signal is one number")
    if variable.type not in REALS:
        raise UserError(f"{key}: '{name}' is of type {variable.type}; a signal is {' or '.join(REALS)}")
    return variable


def _article(causality: str) -> str:
    return f"an {causality}" if causality[0] in "aeiou" else f"a {causality}"


def _number(value: object, key: str) -> float:
    if isinstance(value, bool) or not isinstance(value, int | float) or not math.isfinite(value):
        raise UserError(f"{key}: expected a number, got {value!r}")
    return float(value)


def parameters(model: FmuModel, table: Mapping[str, Any], where: str) -> tuple[ExternalParameter, ...]:
    """Return the parameters of an FMU: those that a map renames first, then all others under their own names."""
    renamed: dict[str, ExternalParameter] = {}
    for name, value in table.items():
        key = f"{where}: parameters.{name}"
        entry = _entry(value, _PARAMETER_KEYS, key)
        variable = scalar_variable(model, entry.variable, key)
        if not variable.is_parameter:
            kind = f"{_article(variable.causality)} ({variable.variability})"
            raise UserError(f"{key}: '{variable.name}' is {kind}, none that can be set and has a start")
        if variable.name in renamed:
            raise UserError(f"{key}: the variable '{variable.name}' is '{renamed[variable.name].name}' already")
        renamed[variable.name] = _parameter(model, name, variable, entry.settings, key)
    others = [v for v in model.variables.values() if v.is_parameter and v.name not in renamed]
    named = {p.name for p in renamed.values()}
    for variable in others:
        if variable.name in named:
            raise UserError(f"{where}: parameters.{variable.name}: is the name of another parameter of the FMU")
    return (*renamed.values(), *(_parameter(model, v.name, v, {}, f"{where}: parameters.{v.name}") for v in others))


def _parameter(
    model: FmuModel, name: str, variable: Variable, settings: Mapping[str, Any], key: str
) -> ExternalParameter:
    meaning = variable.description
    if "unit" in settings:
        own = stated(settings["unit"], "", f"{key}.unit")
    else:
        by_fmu = of_parameter(model, variable.unit)
        own = by_fmu or Conversion(1.0, 0.0, "dimensionless")
        if by_fmu is None:
            meaning = f"{meaning} (in {variable.unit})".strip()
    if variable.lower > variable.upper:
        raise UserError(
            f"{model.path}: its variable '{variable.name}' has the minimum {variable.lower:g} above the maximum "
            f"{variable.upper:g}"
        )
    ends = sorted(own.scale * bound + own.offset for bound in (variable.lower, variable.upper))
    lower, upper = (
        to_si(settings[name_], own.unit, f"{key}.{name_}") if name_ in settings else bound
        for name_, bound in zip(("lower", "upper"), ends, strict=True)
    )
    value = own.scale * variable.start + own.offset
    parameter = ExternalParameter(name, variable.name, own.unit, value, lower, upper, own.scale, own.offset, meaning)
    refuse_unfit_parameter(parameter, key)
    return parameter
