"""An estimator as one C source: its kernels, and the functions that a control unit calls."""

from __future__ import annotations

import hashlib
import math
from collections.abc import Sequence
from dataclasses import dataclass
from types import FunctionType
from typing import Any, Literal

import numpy as np

from harness.common.errors import UserError
from harness.engine.c99 import values as v
from harness.engine.c99.program import Program
from harness.engine.c99.values import Array, Parts, Root
from harness.engine.compile import load_source, paste
from harness.engine.kernel_names import Belief, Info, State
from harness.estimation.compiled_estimator import CompiledEstimator
from harness.estimation.contract import kernels_of, load_estimator
from harness.realtime.export import kernels
from harness.runner import monitor
from harness.runner.monitor import Bounds

Precision = Literal["double", "float"]


@dataclass(frozen=True)
class Member:
    """An array in the memory of an estimator.

    Attributes:
        name: Of the member.
        size: Its numbers.
        meaning: One phrase.
    """

    name: str
    size: int
    meaning: str


@dataclass(frozen=True)
class Library:
    """What an estimator is in C.

    Attributes:
        source: Tables and functions of its kernels.
        begin, take, tell: Statements of ``begin_exported``, ``step_exported`` and ``tell_of_exported``, and those of a
            monitor.
        members: What it holds.
        digest: Of all that, whatever the precision.
    """

    source: str
    begin: list[str]
    take: list[str]
    tell: list[str]
    members: list[Member]
    digest: str


class MemoryLayout:
    """The memory of an estimator in the making."""

    def __init__(self) -> None:
        self.members: list[Member] = []

    def array(self, name: str, shape: tuple[int, ...], meaning: str) -> Array:
        """Return an array that is a member."""
        size = math.prod(shape)
        if size:
            self.members.append(Member(name, size, meaning))
        return Array("real", shape, Root(f"e->{name}"), v.whole(0))

    def scratch(self, shape: tuple[int, ...], zero: bool) -> Array:
        """Return a scratch array of a run; all are zero at first."""
        return self.array(f"work_{len(self.members)}", shape, "scratch of a step")


def library_of(
    name: str, estimator: CompiledEstimator, bounds: Bounds | None = None, parameters: Sequence[float] = ()
) -> Library:
    """Return an estimator in C.

    Args:
        name: Named in errors.
        estimator: The estimator.
        bounds: Of its monitor; none by default.
        parameters: That the study of the monitor believed.

    Raises:
        UserError: If it cannot be printed.
    """
    compiled, kind = estimator.compiled, estimator.kind
    title = f"estimator '{name}' ({kind}) cannot be exported"
    if estimator.is_random:
        raise UserError(f"{title}: it draws random numbers, which a control unit does not have")
    if compiled.kernels.CONDITIONS:
        raise UserError(f"{title}: effects of its model may be absent; state one with those that are there")
    file = load_estimator(kind)
    functions = [file.workspace, kernels.begin_exported, kernels.step_exported, kernels.tell_of_exported]
    functions += [] if bounds is None else [monitor.begin_watch, monitor.compare_parameters, monitor.watch]
    given = kernels_of(file, compiled.model)
    module = load_source(f"export_{kind}", paste(compiled, f"export of {kind}", functions, given))
    program, memory = Program(title), MemoryLayout()

    def function(of: Any) -> FunctionType:
        return getattr(module, of.__name__).py_func

    nx, nu, ny, ns = compiled.nx, compiled.nu, compiled.ny, len(compiled.signal_names)
    rows = estimator.init(np.zeros(nx), np.zeros(nx)).memory.shape[0]
    held = [
        memory.array("constants", (compiled.nc, 1), "of the model, from its parameters"),
        memory.array("process_noise", (nx, 1), "variances per sample"),
        memory.array("measurement_noise", (ny, 1), "variances"),
    ]
    belief = Parts(
        (*held, program.table("tuning", estimator.tuning), None, program.table("priors", estimator.priors)),
        Belief._fields,
    )
    state, after = (_state(memory, prefix, nx, rows) for prefix in ("", "next_"))
    before = memory.array("inputs_before", (nu, 1), "at the sample before")
    info = Parts(
        (
            memory.array("innovation", (ny, 1), "measurement minus its prediction"),
            memory.array("innovation_covariance", (ny, ny, 1), "row by row"),
            *(memory.array(n, (1, 1), m) for n, m in _SAID.items()),
        ),
        Info._fields,
    )
    room = Parts((memory.array("signals", (ns, 1), "scratch"), memory.array("slopes", (ns, nx, 1), "scratch")))
    work, _ = program.statements(function(file.workspace), [], memory.scratch)
    p, u, y, mean, variance = (
        Array("real", shape, Root(place), v.whole(0))
        for place, shape in (
            ("p", (1, len(compiled.model.parameters), 1)), ("u", (nu, 1)), ("y", (ny, 1)), ("first", (nx, 1)),
            ("variance", (nx, 1)),
        )
    )  # fmt: skip
    told = memory.array("estimates", (2, ns, 1), "signals, then their standard deviations")
    constants = held[0].reshaped((1, compiled.nc, 1))
    _, begin = program.statements(function(kernels.begin_exported), [p, mean, variance, constants, state])
    _, take = program.statements(function(kernels.step_exported), [state, before, u, y, belief, work, after, info])
    beyond = memory.array("outside", (1, 1), "1 where the state is beyond its limits or no number")
    limits = program.table("limits", estimator.limits)
    _, tell = program.statements(function(kernels.tell_of_exported), [state, u, belief, limits, room, told, beyond])
    if bounds is not None:
        watched = memory.array("watched", (monitor.size_of_monitor(nu, ny), 1), "averages and more of the monitor")
        trust = memory.array("trust", (3, 1), "level, reasons, and largest statistic over its bound")
        limits_of = Parts(tuple(program.table(f"monitor_{n}", b) for n, b in bounds._asdict().items()), Bounds._fields)
        believed = program.table("believed", np.array(parameters, dtype=float))
        begin += program.statements(function(monitor.begin_watch), [watched])[1]
        begin += program.statements(function(monitor.compare_parameters), [p, believed, watched])[1]
        arguments: list[v.Value] = [u, y, info, room.parts[0], beyond, limits_of, watched, trust]
        tell += program.statements(function(monitor.watch), arguments)[1]
    source = "\n\n".join(program.needed([*begin, *take, *tell]))
    digest = hashlib.sha256("\n".join([source, *begin, *take, *tell]).encode()).hexdigest()
    return Library(source, begin, take, tell, memory.members, digest)


_SAID = {
    "nis": "normalised innovation squared",
    "log_likelihood": "of the measurements of the sample",
    "seen": "measurements used",
    "repairs": "1 where a factor of a covariance had to be repaired",
}


def _state(memory: MemoryLayout, prefix: str, nx: int, rows: int) -> Parts:
    return Parts(
        (
            memory.array(f"{prefix}mean", (nx, 1), "estimated state"),
            memory.array(f"{prefix}covariance", (nx, nx, 1), "of its error, row by row"),
            memory.array(f"{prefix}memory", (rows, 1), "what the estimator carries besides the estimate"),
        ),
        State._fields,
    )
