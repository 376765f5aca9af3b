"""Candidates run free over recordings, eight at a time, and are judged by the sum of normalised errors.

The cost is that of Ziaukas 2023 (4.26): per measured output the Euclidean norm of what the model leaves of the
measurement, over the norm of what its mean leaves, summed over the outputs. Norms go over all samples of all recordings
together; missing samples count in neither.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass

import numpy as np

from harness.common.arrays import Floats
from harness.common.errors import UserError
from harness.common.registry import closest
from harness.engine.compile import CompiledModel, load_source, paste
from harness.engine.kernel_names import (
    LANES,
    NY,
    any_of,
    get,
    output,
    put,
    select,
    splat,
)
from harness.identification.data import DriveData, started_by
from harness.runner.simulation_loop import FREE, outside, record_start, record_state, run_vehicle, state_room

ValuesByDrive = Mapping[str, Mapping[str, float]]
"""Values of parameters that differ between recordings, by the name of the recording."""

AT_END = 1e-3
"""Share of a search range within which a value counts as lying at its end."""


def squared_errors(u, y, c, limits, x0, sums):
    """Run eight candidates over a recording and add up their squared errors, until all have left the limits.

    Args:
        u: Inputs ``(samples, nu)``, the same for all candidates.
        y: Measurements ``(samples, ny)``; NaN where missing.
        c: Constants of the candidates ``(nc, LANES)``.
        limits: Largest magnitude of each state ``(nx,)``.
        x0: First state ``(nx, LANES)``.
        sums: Sum of squares per output, then 1 for a candidate that left the limits, written ``(ny + 1, LANES)``.
    """
    run_vehicle((u, u), c, x0, (y, limits, sums))


def begin_errors(samples, record):
    """Set all sums to zero."""
    _, _, sums = record
    for a in range(NY + 1):
        put(splat(0.0), sums, a)


def add_errors(k, x, u, c, room, record):
    """Add the squared errors of a sample; return whether all candidates have left the limits."""
    y, limits, sums = record
    (seen,) = room
    lost = select(outside(x, limits) > 0.0, 1.0, get(sums, NY))
    put(lost, sums, NY)
    output(x, u, c, seen)
    for a in range(NY):
        if not np.isnan(y[k, a]):
            rest = get(seen, a) - y[k, a]
            put(get(sums, a) + rest * rest, sums, a)
    return not any_of(lost == 0.0)


def room_of_errors():
    """Return outputs in lanes."""
    return (np.empty((NY, LANES)),)


MISFIT = FREE | {state_room: room_of_errors, record_start: begin_errors, record_state: add_errors}
"""Kernels that ``squared_errors`` is made of."""


@dataclass(frozen=True)
class Free:
    """A parameter to be found.

    Attributes:
        parameter: Parameter of the model.
        lower: Smallest value searched, SI.
        upper: Largest value searched, SI.
        drives: Names of the recordings it holds for, such as those of one load; empty for all.
    """

    parameter: str
    lower: float
    upper: float
    drives: tuple[str, ...] = ()

    def end_at(self, value: float) -> str:
        """Return at which end of the search range a value lies, ``lower`` or ``upper``, else nothing.

        The range may span decades, so the tolerance at the lower end is relative to its magnitude.
        """
        width = self.upper - self.lower
        if value - self.lower <= AT_END * min(width, abs(self.lower) or width):
            return "lower"
        return "upper" if self.upper - value <= AT_END * width else ""


class Misfit:
    """The cost (4.26) of candidates on recordings.

    Args:
        compiled: The model; its outputs are compared.
        values: Every parameter of the model, SI; free ones are replaced.
        free: What is searched.
        drives: What is compared with.
        per_drive: Values that differ between recordings.
        jobs: Threads.

    Raises:
        UserError: If a free parameter or recording is unknown, bounds are empty, nothing is measured, or a
            measurement does not vary.
    """

    def __init__(
        self,
        compiled: CompiledModel,
        values: Mapping[str, float],
        free: Sequence[Free],
        drives: Sequence[DriveData],
        per_drive: ValuesByDrive | None = None,
        jobs: int = 1,
    ) -> None:
        self.compiled, self.free, self.drives, self.jobs = compiled, tuple(free), tuple(drives), jobs
        _check(compiled, self.free, self.drives)
        self._kernel = load_source("misfit", paste(compiled, "misfit", [squared_errors], MISFIT)).squared_errors
        self._limits = compiled.model.limits
        names = compiled.model.parameter_names
        self._values = [compiled.parameter_vector({**values, **(per_drive or {}).get(d.name, {})}) for d in self.drives]
        self._rows = [
            [(i, names.index(f.parameter)) for i, f in enumerate(self.free) if not f.drives or d.name in f.drives]
            for d in self.drives
        ]
        self._starts = started_by(compiled.model)
        self.scale = _spread(compiled, self.drives)
        self.lower, self.upper = (np.array([getattr(f, end) for f in self.free]) for end in ("lower", "upper"))

    def parameters(self, drive: int, candidates: Floats) -> Floats:
        """Return the model's parameters on a recording, ``(np, candidates)``, for candidates ``(candidates, free)``."""
        values = np.repeat(self._values[drive][:, None], len(candidates), axis=1)
        for i, row in self._rows[drive]:
            values[row] = candidates[:, i]
        return values

    def norms(self, candidates: Floats) -> Floats:
        """Return the norm of the errors per recording, candidate and output, ``(drives, candidates, ny)``.

        It is infinite for a candidate that leaves the range in which the model's equations hold.

        Args:
            candidates: Values of the free parameters, SI ``(candidates, free)``.
        """
        count, ny = len(candidates), self.compiled.ny
        groups = -(-count // LANES)
        filled = candidates[np.minimum(np.arange(groups * LANES), count - 1)]
        totals = np.empty((len(self.drives), groups, ny + 1, LANES))

        def run(task: int) -> None:
            d, group = divmod(task, groups)
            drive, values = self.drives[d], self.parameters(d, filled[group * LANES : (group + 1) * LANES])
            x0 = np.repeat(drive.first_mean[:, None], LANES, axis=1)
            for state, row in self._starts.items():
                x0[state] = values[row]
            constants = self.compiled.constants(values)
            self._kernel(drive.inputs, drive.measurements, constants, self._limits, x0, totals[d, group])

        with ThreadPoolExecutor(self.jobs) as pool:
            list(pool.map(run, range(len(self.drives) * groups)))
        sums = totals.transpose(0, 1, 3, 2).reshape(len(self.drives), -1, ny + 1)[:, :count]
        lost = (sums[..., ny] > 0) | ~np.isfinite(sums[..., :ny]).all(axis=-1)
        with np.errstate(invalid="ignore"):
            return np.where(lost[..., None], np.inf, np.sqrt(sums[..., :ny]))

    def __call__(self, candidates: Floats) -> Floats:
        """Return the cost of each candidate, infinite if it diverges on any recording, ``(candidates,)``."""
        total = np.sqrt(np.sum(self.norms(candidates) ** 2, axis=0))
        return np.asarray(np.sum(total / self.scale, axis=1))


def _check(compiled: CompiledModel, free: Sequence[Free], drives: Sequence[DriveData]) -> None:
    names = [d.name for d in drives]
    if not free:
        raise UserError("no parameter is free; name at least one")
    if not drives:
        raise UserError("no recording is given; identification needs at least one")
    for parameter in free:
        if parameter.parameter not in compiled.model.parameter_names:
            near = closest(parameter.parameter, compiled.model.parameter_names)
            raise UserError(f"model '{compiled.model.name}' has no parameter '{parameter.parameter}'{near}")
        if not parameter.lower < parameter.upper:
            raise UserError(
                f"'{parameter.parameter}': the search range {parameter.lower:g} to {parameter.upper:g} is empty"
            )
        for name in parameter.drives:
            if name not in names:
                raise UserError(
                    f"'{parameter.parameter}' holds for recording '{name}', which is not there{closest(name, names)}"
                )


def _spread(compiled: CompiledModel, drives: Sequence[DriveData]) -> Floats:
    """Return the norm of each output about its mean over all recordings, the denominators of (4.26), ``(ny,)``."""
    every = np.concatenate([d.measurements for d in drives])
    for column, name in zip(every.T, compiled.model.outputs, strict=True):
        if np.isnan(column).all():
            raise UserError(f"'{name}' is measured in none of the recordings; leave it out of the sensors")
        if not np.nanstd(column) > 0:
            raise UserError(f"'{name}' does not vary in any recording, so errors cannot be compared with it")
    return np.asarray(np.sqrt(np.nansum((every - np.nanmean(every, axis=0)) ** 2, axis=0)))
