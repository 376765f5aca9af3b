"""From a folder of ``harness identify``, ``trace`` or ``run`` to the drives that tell most of what it left open."""

from __future__ import annotations

import os
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path

import numpy as np
from threadpoolctl import threadpool_limits

from harness.common.errors import UserError
from harness.config import ModelSpec
from harness.config.model_choice import fitting_sensors
from harness.config.posterior import FILES as FITS
from harness.diagnosis.earlier_trace import TRACE
from harness.experiment.compound import TraceGoal
from harness.experiment.contract import ExpectedOutcome, Goal, total
from harness.experiment.design import DrivePlan, design
from harness.experiment.detection import DetectionGoal
from harness.experiment.information import Criterion, EstimationGoal, read_fit
from harness.experiment.kept_drives import KeptDrives, basis
from harness.experiment.limits import Limits
from harness.experiment.manoeuvres import Manoeuvre, SearchRange, chosen
from harness.experiment.open_trace import read_trace
from harness.experiment.rehearsal import Rehearsal, Rehearsed
from harness.experiment.study_error import SCORES, StudyGoal, read_study
from harness.models.roles import SENSORS

_SPARE = 1.0
"""s by which a planned drive is longer than the shortest recording that is taken: a recorder may begin late."""


@dataclass(frozen=True)
class DesignTask:
    """What drives are asked for.

    Attributes:
        folder: Of the result.
        wanted: Parameters that count, with weights; see ``EstimationGoal`` and ``read_study``.
        criterion: ``D``, ``A`` or ``c``.
        limits: Of every drive.
        budget: s of driving.
        manoeuvres: Names; all by default.
        effort: Drives that are tried of each.
        sensors: Whether the same drives are judged with every set of sensors of the vehicle too.
        seed: Of the points tried and the versions of the vehicle drawn.
        jobs: Threads; all cores by default.
        out: Folder of the result, where drives that were tried are kept until it is written; none are by default.
    """

    folder: Path
    wanted: Mapping[str, float] = field(default_factory=dict)
    criterion: Criterion = "D"
    limits: Limits = field(default_factory=Limits)
    budget: float = 60.0
    manoeuvres: tuple[str, ...] = ()
    effort: int = 24
    sensors: bool = False
    seed: int = 0
    jobs: int | None = None
    out: Path | None = None


@dataclass(frozen=True)
class Equipped:
    """The planned drives with other sensors.

    Attributes:
        name: Set of sensors.
        outputs: What it measures.
        expectation: Behind the drives; in words why there is none.
    """

    name: str
    outputs: tuple[str, ...]
    expectation: ExpectedOutcome | str


@dataclass(frozen=True)
class Designed:
    """Drives as planned.

    Attributes:
        task: What was asked for.
        plant: The vehicle.
        goal: What is to be found out.
        plan: The drives.
        equipped: The same drives with each set of sensors of the vehicle, where asked for.
    """

    task: DesignTask
    plant: ModelSpec
    goal: Goal
    plan: DrivePlan
    equipped: tuple[Equipped, ...] = ()

    @cached_property
    def unchanged(self) -> ExpectedOutcome:
        """What is expected without any further drive."""
        with threadpool_limits(1):
            return self.goal.expectation(None)

    @cached_property
    def expectation(self) -> ExpectedOutcome:
        """What is expected behind the planned drives."""
        with threadpool_limits(1):
            return self.goal.expectation(self.plan.evidence)

    @cached_property
    def alone(self) -> tuple[ExpectedOutcome, ...]:
        """What is expected behind each of the ranked drives by itself, repeated as often as the budget allows."""
        with threadpool_limits(1):
            return tuple(self.goal.expectation(total([(t.evidence, t.times)])) for t in self.plan.ranked)


def design_drives(task: DesignTask, say: Callable[[str], None] = lambda _: None) -> Designed:
    """Return the drives that tell most of what a result left open.

    Args:
        task: What is asked for.
        say: Takes a line on what is being done.

    Raises:
        UserError: If the folder holds no result that can be gone on from, or no drive keeps to the limits.
    """
    with threadpool_limits(1):  # threads of the linear algebra would wait for those of the drives
        return _designed(task, say)


def _designed(task: DesignTask, say: Callable[[str], None]) -> Designed:
    manoeuvres = chosen(task.manoeuvres)
    if not task.budget > 0:
        raise UserError(f"budget: {task.budget:g} s leaves nothing to drive")
    say("compiling")
    goal = _goal(task)
    spec = goal.model.spec
    shortest = goal.shortest + _SPARE if goal.shortest else 0.0
    if task.limits.duration < shortest or task.budget < goal.turns * shortest:
        raise UserError(
            f"{task.folder}: drives of a trace last {shortest:g} s at least, each is driven {goal.turns} times; "
            f"a duration of {task.limits.duration:g} s and a budget of {task.budget:g} s leave no room for that"
        )
    rehearsal = Rehearsal(goal.model, spec, goal.versions, goal.recorded, task.limits)
    jobs = task.jobs or os.cpu_count() or 1
    room = SearchRange.of(spec, task.limits, shortest, goal.lead_in, task.seed)
    kept = _kept(task, goal, manoeuvres)
    plan = design(goal, rehearsal, room, manoeuvres, task.budget, task.effort, jobs, task.seed, say, kept)
    if not plan.sequence:
        raise UserError(_no_plan(plan, task))
    return Designed(task, spec, goal, plan, _equipped(task, goal, plan, say) if task.sensors else ())


def _no_plan(plan: DrivePlan, task: DesignTask) -> str:
    """Return why there is no plan, and how to come to one."""
    if not plan.ranked:
        reasons = "; ".join(f"{name}: {why}" for name, why in plan.refused.items())
        return f"no drive of {task.budget:g} s keeps to the limits ({reasons}); widen them or the budget"
    nothing = f"no drive within these limits tells anything that is not known now: of {plan.tried} that were rehearsed"
    if not any(array.any() for tried in plan.ranked for array in tried.evidence):
        return (
            f"{nothing} each is too calm to be judged; widen lateral_acceleration, "
            f"{task.limits.lateral_acceleration:.3g} m/s², or the limits of speed and steering"
        )
    return f"{nothing} none lowers the criterion; widen the limits or the budget, or try more of each (--effort)"


def _kept(task: DesignTask, goal: Goal, manoeuvres: Sequence[Manoeuvre]) -> KeptDrives:
    """Return the drives that an interrupted design of the same has tried."""
    if task.out is None:
        return KeptDrives()
    stated = sorted(task.wanted.items()), task.seed
    kinds = [m.kind for m in manoeuvres]
    return KeptDrives(task.out, basis(task.folder, goal, task.limits, stated, kinds))


def _goal(task: DesignTask) -> Goal:
    """Return what a result has left to be found out.

    Raises:
        UserError: If there is none, its vehicle has no steering wheel, or something is asked for that it has not.
    """
    if not task.folder.is_file() and not any((task.folder / name).exists() for name in (*FITS, SCORES)):
        raise UserError(
            f"{task.folder}: holds no {', '.join(FITS)} or {SCORES}; name the folder of harness identify, trace or run"
        )
    if (task.folder / SCORES).is_dir():
        if task.criterion != "D":
            raise UserError(f"{task.folder}: a criterion is asked of an identification; of a study errors count")
        studied = read_study(task.folder, task.wanted)
        _refuse_undriven(studied.spec, task.folder)
        return StudyGoal(studied)
    if not (task.folder / TRACE).is_file():
        fit = read_fit(task.folder)
        _refuse_undriven(fit.spec, task.folder)
        return EstimationGoal(fit, task.wanted, task.criterion, seed=task.seed)
    if task.criterion != "D" or any(weight != 1.0 for weight in task.wanted.values()):
        raise UserError(f"{task.folder}: criterion and weights are asked of an identification, not of a trace")
    trace = read_trace(task.folder, least=1 if task.wanted else 2)
    _refuse_undriven(trace.spec, task.folder)
    return DetectionGoal(trace, list(task.wanted)) if task.wanted else TraceGoal(trace)


def _refuse_undriven(spec: ModelSpec, folder: Path) -> None:
    """Refuse a vehicle that is not driven by steering wheel and speed, as the drives are."""
    inputs = spec.model().inputs
    if spec.external is not None or "steering_wheel_angle" not in inputs:
        raise UserError(f"{folder}: drives are planned for a vehicle with a steering wheel; its inputs are {inputs}")


@dataclass(frozen=True)
class _Judge:
    """A goal whose filter is compiled, with the planned drives and how often each is driven."""

    goal: Goal
    drives: tuple[tuple[Rehearsed, int], ...]

    @property
    def outputs(self) -> Sequence[str]:
        return list(self.goal.model.spec.model().outputs)

    def judges(self, outputs: Sequence[str]) -> bool:
        """Whether it has these outputs, and no parameter of another one, which they do not show."""
        absent = tuple(f"_{name}" for name in self.outputs if name not in outputs)
        return set(outputs) <= set(self.outputs) and not any(n.endswith(absent) for n in self.goal.model.names)

    def expectation(self, outputs: Sequence[str]) -> ExpectedOutcome:
        """Return what is expected behind the drives where all other outputs are missing."""
        there, parts = [name in outputs for name in self.outputs], []
        for drive, times in self.drives:
            data = tuple(replace(d, measurements=np.where(there, d.measurements, np.nan)) for d in drive.data)
            parts.append((self.goal.evidence(replace(drive, data=data)), times))
        return self.goal.expectation(total(parts))


def _equipped(task: DesignTask, goal: Goal, plan: DrivePlan, say: Callable[[str], None]) -> tuple[Equipped, ...]:
    """Return what the planned drives tell with each set of sensors of the vehicle; those so far had theirs.

    To compile a filter takes far longer than to run it, so one judges every set whose outputs it has.
    """
    spec = goal.model.spec
    sets = {name: tuple(SENSORS.load(name).OUTPUTS) for name in fitting_sensors(spec.vehicle, spec.tyre)}
    judges = [_Judge(goal, tuple((tried.rehearsed, times) for tried, times in plan.sequence))]
    found: dict[str, ExpectedOutcome | str] = {}
    for name in sorted(sets, key=lambda n: -len(sets[n])):
        say(f"sensors: {name}")
        try:
            judge = next((j for j in judges if j.judges(sets[name])), None)
            if judge is None:
                judge = _judge(task, goal.measured_by(name), plan)
                judges.append(judge)
            found[name] = judge.expectation(sets[name])
        except UserError as error:
            found[name] = str(error)
    return tuple(Equipped(name, outputs, found[name]) for name, outputs in sets.items())


def _judge(task: DesignTask, goal: Goal, plan: DrivePlan) -> _Judge:
    """Return a goal of other sensors with the planned drives.

    Raises:
        UserError: If one of them passes a limit.
    """
    rehearsal = Rehearsal(goal.model, goal.model.spec, goal.versions[: goal.recorded], goal.recorded, task.limits)
    drives = []
    for tried, times in plan.sequence:
        again = rehearsal.of(tried.rehearsed.drive)
        if isinstance(again, str):
            raise UserError(again)
        drives.append((again, times))
    return _Judge(goal, tuple(drives))
