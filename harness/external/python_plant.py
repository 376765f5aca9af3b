"""A plant that is a Python class: what it declares, and its runs in a worker process.

A class declares ``inputs``, ``outputs`` and ``parameters``, and may declare ``disturbances``, ``limits``, ``wheelbase``
and ``steering_ratio`` (``docs/external-plants.md``). It is made once without arguments, and has either
``simulate(time, inputs, values)`` for a whole drive, or ``reset(values)`` and ``step(inputs, dt)``, which returns what
is published now, with these inputs, and then moves on by ``dt``. Numbers are in the units that it declares.
"""

from __future__ import annotations

import functools
import math
import os
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from harness.common import units
from harness.common.arrays import Floats
from harness.common.errors import UserError
from harness.common.registry import closest
from harness.external.bodies import Run
from harness.external.description import Description, ExternalParameter, Port, digest_of, refuse_unfit
from harness.external.references import imported, located
from harness.models.signals import SIGNALS

DECLARED = ("inputs", "outputs", "parameters", "disturbances", "limits", "wheelbase", "steering_ratio")


class PythonPlant:
    """A class of somebody else as a plant.

    Args:
        plant: The class.
        description: Of it; ``None`` where only ``declared`` is called.
    """

    def __init__(self, plant: type, description: Description | None) -> None:
        self._class, self._plant, self._description = plant, plant(), description

    def declared(self) -> dict[str, Any]:
        """Return what the class declares, in plain values."""
        there = {name: getattr(self._plant, name) for name in DECLARED if hasattr(self._plant, name)}
        whole = hasattr(self._plant, "simulate")
        if not whole and not (hasattr(self._plant, "reset") and hasattr(self._plant, "step")):
            raise UserError("it has neither simulate(time, inputs, values) nor reset(values) and step(inputs, dt)")
        return {n: dict(v) if isinstance(v, Mapping) else v for n, v in there.items()} | {"whole": whole}

    def simulate(self, step: float, inputs: Floats, disturbances: Floats, values: Floats) -> Run:
        """Run over a drive, see ``harness.external.bodies.PlantBody``."""
        description, samples = self._description, len(inputs)
        assert description is not None
        ports = (*description.inputs, *description.disturbances)
        columns = (np.concatenate([inputs, disturbances], axis=1) - [p.offset for p in ports]) / [
            p.scale for p in ports
        ]
        given = {p.variable: columns[:, i] for i, p in enumerate(ports)}
        held = {
            p.variable: (float(value) - p.offset) / p.scale
            for p, value in zip(description.parameters, values, strict=True)
        }
        if hasattr(self._plant, "simulate"):
            time = step * np.arange(samples)
            outputs, reached, reason = self._table(self._plant.simulate(time, given, held), samples), samples, ""
        else:
            outputs, reached, reason = self._stepped(step, given, held, samples)
        outputs = outputs * [p.scale for p in description.outputs] + [p.offset for p in description.outputs]
        return Run(outputs, reached, reason)

    def _stepped(
        self, step: float, given: dict[str, Floats], held: dict[str, float], samples: int
    ) -> tuple[Floats, int, str]:
        assert self._description is not None
        names = [p.variable for p in self._description.outputs]
        outputs = np.full((samples, len(names)), np.nan)
        self._plant.reset(held)
        rows = list(zip(*(column.tolist() for column in given.values()), strict=True)) or [()] * samples
        for k, row in enumerate(rows):
            try:
                published = self._plant.step(dict(zip(given, row, strict=True)), step)
            except Exception as error:
                return outputs, k, f"{type(error).__name__}: {error}"
            self._refuse_missing(published)
            for i, name in enumerate(names):
                outputs[k, i] = published[name]
        return outputs, samples, ""

    def _table(self, published: Any, samples: int) -> Floats:
        assert self._description is not None
        self._refuse_missing(published)
        columns = [np.asarray(published[p.variable], dtype=float) for p in self._description.outputs]
        for port, column in zip(self._description.outputs, columns, strict=True):
            if column.shape not in ((samples,), ()):
                raise UserError(f"output '{port.variable}' has the shape {column.shape}, for {samples} samples")
        return np.column_stack([np.broadcast_to(column, samples) for column in columns])

    def _refuse_missing(self, published: Any) -> None:
        assert self._description is not None
        names = {p.variable for p in self._description.outputs}
        if not isinstance(published, Mapping):
            raise UserError(f"it returned {type(published).__name__} in place of a mapping with its outputs")
        if missing := sorted(names - set(published)):
            raise UserError(f"it returned no output '{missing[0]}'")


def load(loader: Mapping[str, Any]) -> PythonPlant:
    """Return the plant that a loader makes, see ``harness.external.bodies.load``."""
    content = loader.get("description")
    return PythonPlant(imported(loader), None if content is None else Description.of(content))


def described(reference: str, folders: Sequence[Path], where: str) -> Description:
    """Return what a class declares; its code runs in a worker process.

    Args:
        reference: ``module:Class``.
        folders: See ``located``.
        where: File and key, for errors.

    Raises:
        UserError: If it cannot be imported, or declares what cannot be understood.
    """
    try:
        file, loader = located(reference, folders)
        stamp = None if file is None else (str(file), os.stat(file).st_mtime_ns)
        declared = _declared(
            tuple(sorted((k, tuple(v) if isinstance(v, list) else v) for k, v in loader.items())), stamp
        )
    except UserError as error:
        raise UserError(f"{where}: {error}") from None
    digests = {} if file is None else {file.name: digest_of(file)}
    return _description(reference, declared, digests, f"{where}: '{reference}'")


@functools.lru_cache(maxsize=16)
def _declared(loader: tuple[tuple[str, Any], ...], stamp: Any) -> dict[str, Any]:
    """Return what the class of a loader declares; ``stamp`` changes with its file."""
    from harness.external.processes import START_TIMEOUT, Lost, Worker

    worker = Worker({**dict(loader), "import_from": list(dict(loader)["import_from"]), "kind": "python"})
    try:
        declared = worker.call("declared", (), START_TIMEOUT)
    finally:
        worker.close()
    if isinstance(declared, Lost):
        raise UserError(declared.reason)
    return declared


def _description(reference: str, declared: Mapping[str, Any], digests: dict[str, str], where: str) -> Description:
    for name in ("inputs", "outputs", "parameters"):
        if not isinstance(declared.get(name), Mapping):
            raise UserError(f"{where}: the class declares no {name}; give it a table with units, {name} = {{...}}")
    limits = declared.get("limits", {})
    outputs = _ports(declared, "outputs", where)
    for name in limits:
        if name not in {p.signal for p in outputs}:
            raise UserError(f"{where}: limits: '{name}' is none of its outputs")
    of_outputs = {p.signal: p.unit for p in outputs}
    sizes = {
        name: units.to_si(declared[name], unit, f"{where}: {name}")
        for name, unit in (("wheelbase", "m"), ("steering_ratio", ""))
        if declared.get(name) is not None
    }
    description = Description(
        "python",
        reference,
        digests,
        _ports(declared, "inputs", where),
        outputs,
        _ports(declared, "disturbances", where),
        tuple(_parameter(name, entry, f"{where}: parameters.{name}") for name, entry in declared["parameters"].items()),
        {name: units.to_si(value, of_outputs[name], f"{where}: limits.{name}") for name, value in limits.items()},
        facts={"interface": "simulate" if declared["whole"] else "reset and step"},
        **sizes,
    )
    refuse_unfit(description, where)
    return description


def _ports(declared: Mapping[str, Any], group: str, where: str) -> tuple[Port, ...]:
    """Return the signals of a table ``{signal: unit}``, their units those of the class."""
    ports = []
    for name, written in declared.get(group, {}).items():
        try:
            own = _signal_unit(name, group, written)
            ports.append(Port(name, name, own, *units.line(str(written or ""), own)))
        except UserError as error:
            raise UserError(f"{where}: {group}.{name}: {error}") from None
    return tuple(ports)


def _signal_unit(name: str, group: str, written: Any) -> str:
    """Return the SI unit of a signal; of a disturbance that is no signal, that of its own unit."""
    source = name.removesuffix("_rate")
    if name in SIGNALS:
        return SIGNALS[name].unit
    if group == "inputs" and source in SIGNALS:
        return f"{SIGNALS[source].unit}/s"
    if group == "disturbances":
        return units.si_unit(str(written or ""))
    raise UserError(f"there is no such signal{closest(name, list(SIGNALS))}")


def _parameter(name: str, entry: Any, where: str) -> ExternalParameter:
    """Return a parameter that is declared by a number, text with a unit, or a table with ``value``."""
    table = dict(entry) if isinstance(entry, Mapping) else {"value": entry}
    if "value" not in table or set(table) - {"value", "unit", "lower", "upper", "meaning"}:
        raise UserError(f"{where}: a table has value, unit, lower, upper and meaning, this one {', '.join(table)}")
    value = table["value"]
    number_and_unit = units.split(value) if isinstance(value, str) else None
    written = str(table.get("unit", number_and_unit[1] if number_and_unit else ""))
    try:
        unit = units.si_unit(written)
        scale, offset = units.line(written, unit)
    except UserError as error:
        raise UserError(f"{where}: {error}") from None
    si = {}
    for key, default in (("value", None), ("lower", -math.inf), ("upper", math.inf)):
        raw = table.get(key, default)
        if isinstance(raw, int | float) and not isinstance(raw, bool):
            si[key] = raw * scale + offset
        else:
            si[key] = units.to_si(raw, unit, f"{where}: {key}")
    return ExternalParameter(name, name, unit, **si, scale=scale, offset=offset, meaning=str(table.get("meaning", "")))
