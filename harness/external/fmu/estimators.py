"""Estimator that is an FMU of an observer, for co-simulation, in its worker process."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from harness.common.arrays import Floats
from harness.common.errors import UserError, closest
from harness.common.files import read_toml
from harness.common.units import to_si
from harness.external.bodies import RunEstimates
from harness.external.description import ExternalParameter, Port
from harness.external.fmu.instance import Failed, Instance, Library
from harness.external.fmu.model import FmuModel, read_model
from harness.external.fmu.plants import compiled, reason_of, references, to_signals, to_variables
from harness.external.fmu.read import Observer, observer


class FmuObserver:
    """An FMU that is given inputs and measurements and gives estimates (``harness.external.bodies.EstimatorBody``).

    A measurement that is missing keeps its last value. An input of the FMU that is called ``valid_<signal>``, or that
    its map names so, says whether it is there.

    Args:
        model: The FMU.
        variables: What it is given and gives.
        values: Names of its parameters that a run states.
        settings: Values of other parameters by name, in SI or with a unit.
        where: Its file, named in errors.
    """

    def __init__(
        self, model: FmuModel, variables: Observer, values: Sequence[str], settings: Mapping[str, Any], where: str
    ) -> None:
        self._library = Library(model, model.interface("co-simulation"))
        self._instance = Instance(self._library)
        self._instance.resets = False  # whether a reset does it all cannot be told from estimates
        self._variables = variables
        self._given = (*variables.inputs, *variables.measurements)
        self._read = (*variables.estimates, *variables.variances)
        further = () if variables.nis is None else (Port("nis", variables.nis, "1"),)
        self._names = [port.variable for port in (*self._read, *further)]
        self._refs_in, self._refs_out = references(model, self._given), references(model, (*self._read, *further))
        self._valid, self._valid_real, self._rows = _validity(model, variables.measurements, variables.valid)
        parameters = {p.name: p for p in variables.parameters}
        for name in (*values, *settings):
            if name not in parameters:
                raise UserError(f"{where}: it has no parameter '{name}'{closest(name, list(parameters))}")
        self._values = [parameters[name] for name in values]
        stated = {parameters[n]: to_si(v, parameters[n].unit, f"settings.{n}") for n, v in settings.items()}
        self._settings = self._by_reference(stated)

    def _by_reference(self, values: Mapping[ExternalParameter, float]) -> dict[int, float]:
        variables = self._library.model.variables
        return {variables[p.variable].reference: (value - p.offset) / p.scale for p, value in values.items()}

    def declared(self) -> dict[str, Any]:
        """Return the signals that it is given and gives."""
        groups = ("inputs", "measurements", "estimates")
        signals = {name: [port.signal for port in getattr(self._variables, name)] for name in groups}
        return {**signals, "variances": bool(self._variables.variances), "nis": self._variables.nis is not None}

    def estimate(self, step: float, inputs: Floats, measurements: Floats, values: Floats, seed: int) -> RunEstimates:
        """Run over what was measured; see ``harness.external.bodies.EstimatorBody``."""
        library, instance = self._library, self._instance
        starts = [library.model.variables[port.variable].start for port in self._variables.measurements]
        present = ~np.isnan(measurements)
        held = _held(to_variables(measurements, self._variables.measurements), present, np.nan_to_num(starts))
        known_inputs = to_variables(inputs, self._given[: inputs.shape[1]])
        given = np.ascontiguousarray(np.column_stack([known_inputs, held]))
        rows = np.zeros((len(given), len(self._names)))
        flags = np.ascontiguousarray(present[:, self._rows], dtype=float)
        try:
            stated = self._by_reference(dict(zip(self._values, values.tolist(), strict=True)))
            instance.begin({**self._settings, **stated}, {}, self._refs_in.tolist(), given[0])
        except Failed as error:
            return self._estimates(rows, 0, str(error))
        reached, why, status = compiled().observe(
            library.model.version, library.addresses, instance.address, step, given, self._refs_in, flags, self._valid,
            self._valid_real, self._refs_out, rows,
        )  # fmt: skip
        last = rows[min(reached, len(rows) - 1)]
        reason = reason_of(library, instance, why, status, self._names, last, reached * step)
        return self._estimates(rows, int(reached), reason)

    def _estimates(self, rows: Floats, reached: int, reason: str) -> RunEstimates:
        """Return what was read from the variables ``(samples, n)``."""
        count, width = len(self._variables.estimates), len(self._read)
        signals = to_signals(rows[:, :width].copy(), self._read)
        spread = signals[:, count:] if self._variables.variances else None
        return RunEstimates(
            signals[:, :count], spread, None if self._variables.nis is None else rows[:, width], reached, reason
        )


def _held(values: Floats, present: Any, starts: Floats) -> Floats:
    """Return measurements with the last value, or the start of the variable, where one is missing."""
    held, last = np.empty_like(values), starts.copy()
    for k in range(len(values)):
        last = np.where(present[k], values[k], last)
        held[k] = last
    return held


def _validity(
    model: FmuModel, measurements: tuple[Port, ...], valid: Mapping[str, str]
) -> tuple[np.ndarray[Any, np.dtype[np.uint32]], bool, list[int]]:
    """Return the inputs that say whether a measurement is there, whether they are reals, and which measurements."""
    chosen, rows = [], []
    for row, port in enumerate(measurements):
        variable = model.variables.get(valid.get(port.signal, f"valid_{port.signal}"))
        if variable is not None and variable.causality == "input":
            chosen.append(variable)
            rows.append(row)
        elif port.signal in valid:
            raise UserError(f"{model.path}: valid: there is no input '{valid[port.signal]}'")
    real = {variable.is_real for variable in chosen}
    if len(real) > 1 or any(not v.is_real and v.type != "Boolean" for v in chosen):
        raise UserError(f"{model.path}: the inputs that say what is valid must be all Boolean or all real")
    return np.array([v.reference for v in chosen], dtype=np.uint32), real == {True}, rows


def load(loader: Mapping[str, Any]) -> FmuObserver:
    """Return the observer that a loader makes.

    Args:
        loader: ``file`` is its path; ``inputs``, ``measurements`` and ``estimates`` the signals, ``None`` for all that
            it has; ``values`` the parameters that runs state; ``settings`` those that do not change, and the path of
            its map, ``map``.

    Raises:
        UserError: If the FMU cannot be loaded, or is none for co-simulation.
    """
    path, settings = Path(loader["file"]), dict(loader.get("settings") or {})
    chosen = settings.pop("map", None)
    content, where = ({}, str(path)) if chosen is None else (read_toml(Path(chosen)), str(chosen))
    model = read_model(path)
    model.library(model.interface("co-simulation"))
    variables = observer(model, content, {n: loader.get(n) for n in ("inputs", "measurements", "estimates")}, where)
    return FmuObserver(model, variables, loader.get("values") or (), settings, str(path))
