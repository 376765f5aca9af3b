"""Plant of a study that is an FMU, in its worker process."""

from __future__ import annotations

import contextlib
import functools
import math
import os
from collections.abc import Callable, Mapping
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np

from harness.common import places
from harness.common.arrays import Floats
from harness.common.cache import cache_folder
from harness.common.errors import UserError
from harness.engine.codegen.integrators import TABLEAUX
from harness.engine.compile import load_source
from harness.engine.kernel_source import kernel_source
from harness.external.bodies import Run
from harness.external.description import Description, Port, digest_of
from harness.external.fmu import loops
from harness.external.fmu.instance import Failed, Instance, Library, status_word
from harness.external.fmu.model import FmuModel, read_model
from harness.external.fmu.read import scalar_variable

_CHECKED = 200
"""Samples over which a run after a reset must be that of a new instance, bit by bit."""


@functools.cache
def compiled() -> ModuleType:
    """Return the loops over time as compiled functions."""
    functions: list[Callable[..., Any]] = [
        loops.co_simulate, loops.exchange, loops.observe, loops.many_ahead, loops.many_outputs, loops.get_states,
        loops.copy_states, loops.free_states, loops.move_particles,
    ]  # fmt: skip
    return load_source("fmu", kernel_source("Loops over FMUs", functions))


class FmuPlant:
    """An FMU that is run over drives (``harness.external.bodies.PlantBody``).

    Args:
        path: The FMU.
        description: Of the plant.
        integrator, substeps: Method, and steps per sample, of a model exchange.
    """

    def __init__(self, path: Path, description: Description, integrator: str = "euler", substeps: int = 1) -> None:
        model = read_model(path)
        interface = model.interface(description.facts.get("interface"))
        self._description, self._substeps = description, substeps
        self._tableau = tuple(np.array(row) for row in TABLEAUX[integrator])
        self._given = references(model, (*description.inputs, *description.disturbances))
        self._read = references(model, description.outputs)
        self._inputs = description.inputs + description.disturbances
        names = [port.variable for port in self._inputs]
        self._by_event = any(model.variables[name].variability == "discrete" for name in names)
        variables = [scalar_variable(model, p.variable, str(path)) for p in description.parameters]
        self._starts = [(v.reference, v.start) for v in variables]
        self._held: dict[int, float] = {}  # what a new instance holds, by value reference, where it has been read
        self._library = Library(model, interface)
        self._instance = Instance(self._library)
        self._checked = False
        self._mark = cache_folder() / "fmu-resets" / digest_of(path)
        self._instance.resets = not _left_behind(self._mark)

    def simulate(self, step: float, inputs: Floats, disturbances: Floats, values: Floats) -> Run:
        """Run over a drive; see ``harness.external.bodies.PlantBody``."""
        own = self._library.model.fixed_step
        if own and abs(step / own - round(step / own)) > 1e-6:
            reason = f"it takes steps of {own:g} s, of which the sample time of {step:g} s is no multiple"
            return Run(np.zeros((len(inputs), len(self._read))), 0, reason)
        given = to_variables(np.column_stack([inputs, disturbances]), self._inputs)
        run = self._run(step, given, values)
        if not self._checked and run.reached == len(given) and self._instance.resets:
            self._check_reset(step, given[:_CHECKED], values, run.outputs[:_CHECKED])
        return run

    def _check_reset(self, step: float, given: Floats, values: Floats, outputs: Floats) -> None:
        """Find out whether a reset does what it says: not every FMU gives the run of a new instance then.

        One that ends its process by its reset is marked and is not reset by the process that follows.
        """
        self._checked = True
        with contextlib.suppress(OSError):
            places.write(self._mark, str(os.getpid()).encode())
        again = self._run(step, given, values)
        self._instance.resets &= again.outputs.tobytes() == outputs.tobytes()
        with contextlib.suppress(OSError):
            places.write(self._mark, None)

    def _begin(self, values: Floats, first: Floats) -> None:
        """Initialise a run; a parameter at its start is set only where a new instance holds another value.

        Raises:
            Failed: If the FMU refuses something.
        """
        instance, parameters, at_start = self._instance, {}, {}
        for p, value, (reference, start) in zip(self._description.parameters, values, self._starts, strict=True):
            if value != p.value:
                parameters[reference] = (value - p.offset) / p.scale
            elif self._held.get(reference, start) == start:
                at_start[reference] = start
            else:
                parameters[reference] = start
        instance.begin(parameters, at_start, self._given.tolist(), first)
        unread = [r for r in at_start if r not in self._held and r not in instance.was_set]
        if not unread:
            return
        try:
            self._held.update(zip(unread, instance.read(unread), strict=True))
        except Failed:  # what it does not say is taken to be as it states
            self._held.update({r: at_start[r] for r in unread})
            instance.discard()
        if not instance.is_there or any(self._held[r] != at_start[r] for r in unread):
            instance.free()
            self._begin(values, first)

    def _run(self, step: float, given: Floats, values: Floats) -> Run:
        library, instance, model = self._library, self._instance, self._library.model
        outputs = np.zeros((len(given), len(self._read)))
        try:
            self._begin(values, given[0])
        except Failed as error:
            return Run(outputs, 0, str(error))
        ends = model.version, library.addresses, instance.address
        if library.interface == "co-simulation":
            reached, why, status = compiled().co_simulate(*ends, step, given, self._given, self._read, outputs)
        else:
            reached, why, status = compiled().exchange(
                *ends, (step, self._substeps, self._by_event), self._tableau, given, self._given, self._read, outputs,
                (model.derivatives, model.indicators),
            )  # fmt: skip
        names = [port.variable for port in self._description.outputs]
        reason = reason_of(
            library, instance, why, status, names, outputs[min(reached, len(outputs) - 1)], reached * step
        )
        return Run(to_signals(outputs, self._description.outputs), int(reached), reason)


def _left_behind(mark: Path) -> bool:
    """Return whether a process has ended without removing its mark."""
    try:
        os.kill(int(mark.read_bytes()), 0)
    except FileNotFoundError:
        return False
    except (OSError, ValueError):
        return True
    return False  # it is at it just now


def reason_of(
    library: Library, instance: Instance, why: int, status: int, names: list[str], row: Floats, time: float
) -> str:
    """Return why a run ended at a time, in words; empty where it is whole.

    ``why`` is an index in ``harness.external.fmu.loops.WHY``, ``status`` what the FMU returned last, ``row`` the last
    values of the variables that are read, by ``names``. An instance that has failed is not used again.
    """
    if why == loops.WHOLE:
        return ""
    if status == 3:
        instance.free()
    elif status > 3:
        instance.discard()
    if why == loops.NO_NUMBER:
        name, value = next((n, v) for n, v in zip(names, row, strict=True) if not math.isfinite(v))
        return library.words(f"'{name}' is {value} at t = {time:g} s")
    if why in (loops.TERMINATED, loops.ENDLESS, loops.EARLY):
        return library.words(f"{loops.WHY[why]} at t = {time:g} s")
    return library.words(f"{loops.WHY[why]} returned {status_word(status)} at t = {time:g} s")


def references(model: FmuModel, ports: tuple[Port, ...]) -> np.ndarray[Any, np.dtype[np.uint32]]:
    """Return the value references of the variables of ports."""
    numbers = [scalar_variable(model, port.variable, str(model.path)).reference for port in ports]
    return np.array(numbers, dtype=np.uint32)


def to_variables(signals: Floats, ports: tuple[Port, ...]) -> Floats:
    """Return signals in SI ``(samples, n)`` as values of variables."""
    values = signals.copy()
    for i, port in enumerate(ports):
        if (port.scale, port.offset) != (1.0, 0.0):
            values[:, i] = (values[:, i] - port.offset) / port.scale
    return np.ascontiguousarray(values)


def to_signals(values: Floats, ports: tuple[Port, ...]) -> Floats:
    """Return values of variables ``(samples, n)`` as signals in SI, written over them."""
    for i, port in enumerate(ports):
        if (port.scale, port.offset) != (1.0, 0.0):
            values[:, i] = port.scale * values[:, i] + port.offset
    return values


def load(loader: Mapping[str, Any]) -> FmuPlant:
    """Return the plant that a loader makes.

    Raises:
        UserError: If the FMU cannot be loaded.
    """
    integrator = loader.get("integrator", "euler")
    if integrator not in TABLEAUX:
        raise UserError(f"unknown integrator '{integrator}'; there are: {', '.join(TABLEAUX)}")
    return FmuPlant(
        Path(loader["file"]), Description.of(loader["description"]), integrator, int(loader.get("substeps", 1))
    )
