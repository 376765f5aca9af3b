"""Time single steps of every estimator of a study, called once per cycle as on a controller."""

from __future__ import annotations

import contextlib
import dataclasses
import os
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import Any

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from harness.common.arrays import Floats
from harness.common.errors import UserError
from harness.common.process import forced_switches
from harness.common.registry import closest
from harness.config import DesignSpec, StudySpec
from harness.engine.compile import CompiledModel, in_one_lane, load_source, paste
from harness.engine.kernel_names import Belief, Info, State
from harness.estimation.compiled_estimator import CompiledEstimator
from harness.estimation.contract import kernels_of, load_estimator
from harness.estimation.external_filter import ExternalFilter
from harness.external.bodies import Timed
from harness.realtime import timed_loop
from harness.realtime.outcome import PACES
from harness.study.design import Unit
from harness.study.evaluate import StudyEvaluator
from harness.study.run_noise import Case

TURN = 100
"""Steps that an estimator takes without a pause before the next one's turn, so that all meet the same machine."""

_WARM_UP = 20  # steps before the first that counts


class Contestant:
    """An estimator about to be timed on one run.

    Args:
        kind: File in ``harness/estimation/methods``.
        compiled: What it believes, as studies compile it.
        belief, first: Constants, noise and first state; the first lane counts.
        inputs, measurements: What it sees ``(samples, nu | ny, LANES)``; the first lane counts.
    """

    def __init__(
        self, kind: str, compiled: CompiledModel, belief: Belief, first: State, inputs: Floats, measurements: Floats
    ) -> None:
        self._kernels = _kernels(kind, compiled)
        constants, process, measurement = map(
            _first_lane, (belief.constants, belief.process_noise, belief.measurement_noise)
        )
        self._belief = Belief(constants, process, measurement, belief.tuning, priors=belief.priors)
        self._first = State(*map(_first_lane, first))
        self._u, self._y = _first_lane(inputs), _first_lane(measurements)
        ny = compiled.ny
        self._info = Info(np.zeros((ny, 1)), np.zeros((ny, ny, 1)), *(np.zeros((1, 1)) for _ in range(4)))
        self._work = self._kernels.workspace()
        self.restart()

    def restart(self) -> None:
        """Go back to the first sample."""
        self._before = State(*(a.copy() for a in self._first))
        self._after = State(*(a.copy() for a in self._first))

    @property
    def mean(self) -> Floats:
        """The estimate ``(nx,)`` after the last step."""
        return self._before.mean[:, 0]

    def run(self, first: int, stop: int) -> Floats:
        """Take the samples from ``first`` to before ``stop``; return what each took in ns, the clock included."""
        ticks = np.zeros((stop - first, 2), dtype=np.int64)
        seen, before, after = slice(first - 1, stop), self._before, self._after
        self._kernels.timed_steps(
            before, self._u[seen], self._y[seen], self._belief, self._work, after, self._info, ticks
        )
        if len(ticks) % 2:
            self._before, self._after = after, before
        return (ticks[:, 1] - ticks[:, 0]).astype(float)

    def look(self, times: int) -> Floats:
        """Return how long nothing takes in ns, so many times: what the clock adds to a step."""
        ticks = np.zeros((times, 2), dtype=np.int64)
        self._kernels.timed_nothing(ticks)
        return (ticks[:, 1] - ticks[:, 0]).astype(float)


class ExternalContestant:
    """An estimator of somebody else about to be timed, in a process of its own.

    Args:
        take: From ``ExternalFilter.timed``.
    """

    def __init__(self, take: Callable[[slice, bool], Timed]) -> None:
        self._take = take
        self.restart()

    def restart(self) -> None:
        """Go back to the first sample."""
        self._begins = True

    def run(self, first: int, stop: int) -> Floats:
        """Take the samples as ``Contestant.run`` does; return what each took in ns, without the clock."""
        ticks, empty, self.mean = self._take(slice(0 if self._begins else first, stop), self._begins)
        self._begins = False
        return np.maximum(ticks[first - stop :] - empty, 0.0)

    def look(self, times: int) -> Floats:
        """Return zeros: the clock is subtracted already."""
        return np.zeros(times)


def _kernels(kind: str, compiled: CompiledModel) -> Any:
    file = load_estimator(kind)
    functions = [file.workspace, timed_loop.timed_steps, timed_loop.timed_nothing]
    source = paste(compiled, kind, functions, kernels_of(file, compiled.model))
    return load_source(f"time_{kind}", in_one_lane(source))


def _first_lane(array: Floats) -> Floats:
    return np.ascontiguousarray(array[..., :1])


def contestants(study: StudySpec, drive: str, duration: float) -> dict[str, Contestant | ExternalContestant]:
    """Return the estimators of a study at the beginning of one run in which plant and belief are as stated.

    Those that are FMUs are left out: single steps of them cannot be timed.

    Args:
        study: The study; its designs do not matter.
        drive: Name of one of its drives.
        duration: s of it.

    Raises:
        UserError: If there is no such drive, it is shorter, the system lacks the clock, or nothing can be timed.
    """
    if not hasattr(time, "CLOCK_MONOTONIC"):
        raise UserError("steps are timed by clock_gettime, which Windows lacks; use Linux or macOS for this command")
    names = [d.name for d in study.drives]
    if drive not in names:
        raise UserError(f"--drive {drive}: study '{study.name}' has no such drive{closest(drive, names)}")
    chosen = study.drives[names.index(drive)]
    evaluator = StudyEvaluator(
        dataclasses.replace(study, drives=(chosen,), designs=(DesignSpec("timed", ()),), history=(), over_time=None)
    )
    samples, there = round(duration / study.belief.step) + 1, len(evaluator.compiled.drives[0].profile.time)
    if samples > there or samples < 2:
        raise UserError(
            f"--duration {duration:g} s: give at least one step of {study.belief.step:g} s and no more than the "
            f"{(there - 1) * study.belief.step:g} s of drive '{drive}'"
        )
    unit, case = Unit(0, 0, 0, 0, 1), [Case(0, 0)]
    batch, believed = evaluator.simulate(unit, case, samples), evaluator.held(unit, case, "belief")
    belief, measurements = evaluator.compiled.belief, evaluator.compiled.measured(batch.measurements)
    field: dict[str, Contestant | ExternalContestant] = {}
    for i, (spec, estimator) in enumerate(zip(study.estimators, evaluator.compiled.estimators, strict=True)):
        inputs, held = evaluator.inputs(i, 0, batch, believed), evaluator.believed_by(i, unit, case, believed)
        if isinstance(estimator, ExternalFilter):
            if not estimator.times_steps:
                continue
            field[spec.name] = ExternalContestant(estimator.timed(inputs, measurements, held))
            continue
        assert isinstance(estimator, CompiledEstimator)
        field[spec.name] = Contestant(spec.kind, belief, *estimator.begin(held), inputs.at, measurements)
    if not field:
        raise UserError(
            f"study '{study.name}': steps of an FMU cannot be timed one by one, and it has no other estimator"
        )
    return field


def measure(
    field: Mapping[str, Contestant | ExternalContestant],
    samples: int,
    cycle: float,
    progress: Callable[[str], None] = lambda _: None,
) -> xr.Dataset:
    """Time every step of a run, first without a pause, in turns of ``TURN`` steps, and then one per cycle.

    In a cycle all estimators take the same sample, each in a slot of its own and in an order drawn anew. The time
    between is slept away, so caches and the processor's clock are as a task finds them that is woken up every cycle.

    Args:
        field: By name, from ``contestants``.
        samples: Of the run; the first is where estimators start and takes no step.
        cycle: Sample time in s.
        progress: Receives what is going on, in words.

    Returns:
        ``step_time`` over ``(pace, estimator, time)`` and ``clock`` over ``(pace, time)``: times in s, what the clock
        itself takes (its median at that pace) subtracted. ``interrupted`` over ``(estimator, time)``: whether the
        operating system took the core away around a step of the second pace.

    Raises:
        UserError: If an estimator does not give numbers to the end.
    """
    names, steps = list(field), samples - 1
    looks = next((c for c in field.values() if isinstance(c, Contestant)), field[names[0]])
    taken = np.empty((len(PACES), len(names) + 1, steps))
    for name, contestant in field.items():
        progress(f"compiling {name}")
        contestant.run(1, min(_WARM_UP, samples))
        contestant.look(1)
        contestant.restart()
    with _one_core():
        progress(f"timing {steps} steps {PACES[0]}")
        for first in range(1, samples, TURN):
            stop = min(first + TURN, samples)
            for e, name in enumerate(names):
                taken[0, e, first - 1 : stop - 1] = field[name].run(first, stop)
        for name, contestant in field.items():
            _refuse_divergence(name, contestant)
            contestant.restart()
        taken[0, -1] = looks.look(steps)
        progress(f"timing {steps} steps, one {PACES[1]} of {cycle:g} s")
        interrupted = _every_cycle(list(field.values()), looks, samples, cycle, taken[1])
    taken *= 1e-9
    overhead = np.median(taken[:, -1:], axis=2, keepdims=True)
    return xr.Dataset(
        {
            "step_time": (("pace", "estimator", "time"), taken[:, :-1] - overhead, {"units": "s"}),
            "clock": (("pace", "time"), taken[:, -1], {"units": "s", "long_name": "between two readings of the clock"}),
            "interrupted": (("estimator", "time"), interrupted, {"long_name": "core taken away around the step"}),
        },
        coords={
            "pace": np.array(PACES, dtype=object),
            "estimator": np.array(names, dtype=object),
            "time": ("time", cycle * np.arange(1, samples), {"units": "s"}),
        },
    )


def _every_cycle(
    field: Sequence[Contestant | ExternalContestant],
    looks: Contestant | ExternalContestant,
    samples: int,
    cycle: float,
    taken: Floats,
) -> NDArray[np.bool_]:
    """Let all take one sample per cycle; write the times in ns, the clock's last, and return who was interrupted."""
    interrupted = np.zeros((len(field), samples - 1), dtype=bool)
    begin, slots, rng = time.perf_counter() + cycle, len(field) + 1, np.random.default_rng(0)
    for k in range(1, samples):
        for slot, e in enumerate(rng.permutation(slots)):
            time.sleep(max(begin + (k - 1 + slot / slots) * cycle - time.perf_counter(), 0.0))
            if e == len(field):
                taken[e, k - 1] = looks.look(1)[0]
                continue
            switches = forced_switches()
            taken[e, k - 1] = field[e].run(k, k + 1)[0]
            interrupted[e, k - 1] = forced_switches() > switches
    return interrupted


def _refuse_divergence(name: str, contestant: Contestant | ExternalContestant) -> None:
    if not np.all(np.isfinite(contestant.mean)):
        raise UserError(f"estimator '{name}' diverges on this drive, so its time is meaningless; choose another drive")


@contextlib.contextmanager
def _one_core() -> Iterator[None]:
    """Keep to one core, where the system lets choose."""
    if not hasattr(os, "sched_setaffinity"):
        yield
        return
    allowed = os.sched_getaffinity(0)
    os.sched_setaffinity(0, {max(allowed)})
    try:
        yield
    finally:
        os.sched_setaffinity(0, allowed)
