"""Estimator that is an FMU of an observer, for co-simulation, in its worker process."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from harness.common.arrays import Floats
from harness.common.errors import UserError
from harness.external.bodies import Estimates
from harness.external.description import Port
from harness.external.fmu.instance import Failed, Instance, Library
from harness.external.fmu.model import FmuModel, read_model
from harness.external.fmu.plants import compiled, reason_of, references, to_signals, to_variables
from harness.external.fmu.read import scalar_variable


class FmuObserver:
    """An FMU that is given inputs and measurements and gives estimates (``harness.external.bodies.EstimatorBody``).

    A measurement that is missing keeps its last value. An input of the FMU that is called ``valid_<signal>``, or that
    ``valid`` names, says whether it is there.

    Args:
        path: The FMU.
        ports: Inputs, measurements, estimates and, if there are any, variances.
        nis: Variable that is the normalised innovation squared.
        valid: Variables that say whether a measurement is there, by signal.
        settings: Values of parameters of the FMU, in its units, by variable.
    """

    def __init__(
        self,
        path: Path,
        ports: Mapping[str, Sequence[Port]],
        nis: str | None = None,
        valid: Mapping[str, str] | None = None,
        settings: Mapping[str, float] | None = None,
    ) -> None:
        model = read_model(path)
        self._library = Library(model, model.interface("co-simulation"))
        self._instance = Instance(self._library)
        self._instance.resets = False  # whether a reset does it all cannot be told from estimates
        self._given = (*ports["inputs"], *ports["measurements"])
        self._measurements = tuple(ports["measurements"])
        self._read = (*ports["estimates"], *ports["variances"])
        self._sizes = len(ports["estimates"]), len(ports["variances"])
        further = () if nis is None else (Port("nis", nis, "1"),)
        self._names = [port.variable for port in (*self._read, *further)]
        self._refs_in, self._refs_out = references(model, self._given), references(model, (*self._read, *further))
        self._valid, self._valid_real, self._rows = _validity(model, self._measurements, valid or {})
        self._settings = {
            scalar_variable(model, name, f"{path}: settings").reference: float(value)
            for name, value in (settings or {}).items()
        }

    def estimate(self, step: float, inputs: Floats, measurements: Floats, values: Floats, seed: int) -> Estimates:
        """Run over what was measured; see ``harness.external.bodies.EstimatorBody``."""
        library, instance = self._library, self._instance
        starts = [library.model.variables[port.variable].start for port in self._measurements]
        present = ~np.isnan(measurements)
        held = _held(to_variables(measurements, self._measurements), present, np.nan_to_num(starts))
        known = to_variables(inputs, self._given[: inputs.shape[1]])
        given = np.ascontiguousarray(np.column_stack([known, held]))
        rows = np.zeros((len(given), len(self._names)))
        flags = np.ascontiguousarray(present[:, self._rows], dtype=float)
        try:
            instance.begin(self._settings, {}, self._refs_in.tolist(), given[0])
        except Failed as error:
            return Estimates(rows[:, : self._sizes[0]], None, None, 0, str(error))
        reached, why, status = compiled().observe(
            library.model.version, library.addresses, instance.address, step, given, self._refs_in, flags, self._valid,
            self._valid_real, self._refs_out, rows,
        )  # fmt: skip
        last = rows[min(reached, len(rows) - 1)]
        reason = reason_of(library, instance, why, status, self._names, last, reached * step)
        targets, variances = self._sizes
        nis = rows[:, -1].copy() if len(self._names) > targets + variances else None
        signals = to_signals(rows[:, : targets + variances].copy(), self._read)
        spread = signals[:, targets:] if variances else None
        return Estimates(signals[:, :targets], spread, nis, int(reached), reason)


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

    Raises:
        UserError: If the FMU cannot be loaded, or is none for co-simulation.
    """
    names = ("inputs", "measurements", "estimates", "variances")
    ports = {name: tuple(Port(**entry) for entry in loader.get(name) or ()) for name in names}
    return FmuObserver(Path(loader["file"]), ports, loader.get("nis"), loader.get("valid"), loader.get("settings"))
