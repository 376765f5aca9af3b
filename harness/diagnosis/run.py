"""A trace from recordings to an outcome on disk: what ``harness trace`` and ``harness loop`` share.

Recordings have to be long and lively enough. While it works a trace says what it does and how long it will take yet.
"""

from __future__ import annotations

import math
import re
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr
from rich.console import Console
from rich.progress import TimeElapsedColumn
from rich.text import Text
from threadpoolctl import threadpool_limits

from harness.common.errors import UserError
from harness.common.failures import Failures
from harness.common.places import inside
from harness.common.stages import bar
from harness.config import ModelSpec
from harness.diagnosis.criteria import CALM
from harness.diagnosis.earlier_trace import EarlierTrace
from harness.diagnosis.fitting import KeptFits
from harness.diagnosis.gain_ranges import gain_ranges
from harness.diagnosis.model.augmented_model import AugmentedModel
from harness.diagnosis.model.hypotheses import random_processes
from harness.diagnosis.result.changes import since
from harness.diagnosis.result.estimator_gain import EstimatorErrors, compile_estimators, estimators_on
from harness.diagnosis.result.expectation import ExpectationMet, expectation_met
from harness.diagnosis.result.outcome import Outcome, outcome_of
from harness.diagnosis.result.record import write_outcome
from harness.diagnosis.result.shown_effects import EffectsShown, effects_shown
from harness.diagnosis.result.study_gain import REPEATS, StudyGain, refuse_study, study_gain
from harness.diagnosis.selection.baseline import learnt, of_roads
from harness.diagnosis.selection.earlier_models import EarlierDrives
from harness.diagnosis.selection.forward_selection import trace
from harness.diagnosis.selection.growth import spacing_of
from harness.identification.data import DriveData, measurements_of, steered
from harness.identification.earlier_result import record_of_recordings
from harness.identification.measured_file import SHORT_BY, SHORTEST, names_of, refuse_repeated
from harness.identification.planned_drive import driven_otherwise
from harness.identification.signal_noise import thinned
from harness.recordings.check.examine import recording_warnings

_ROUND, _GROWTH = re.compile(r"round (\d+):"), "growth, round "


class Stages:
    """The stages of a trace by the time at which they began.

    How many rounds there will be is not known. The last one adds nothing and is as long as the one before it or
    shorter, so that is what is left of them at least. What follows the rounds, where every addition is questioned,
    takes about as long as they did: with many additions longer, with few or none far shorter. Of growth it is not said.

    Args:
        clock: Returns s.
    """

    def __init__(self, clock: Callable[[], float] = time.monotonic) -> None:
        self._clock, self._begun = clock, clock()
        self._rounds: list[float] = []  # how long each took, but for the one that is running
        self._round, self._since, self._ended = 0, 0.0, math.inf

    def line(self, what: str) -> str:
        """Return a stage in a line: what, since when, and about how long it takes yet where that can be said."""
        now = self._clock()
        match = _ROUND.match(what)
        if what.startswith(_GROWTH):
            self._rounds, self._round = [], 0
        if match and int(match[1]) > self._round:
            if self._round:
                self._rounds.append(min(now, self._ended) - self._since)
            self._round, self._since, self._ended = int(match[1]), now, math.inf
        elif not match and self._round:
            self._ended = min(self._ended, now)
        return f"{_minutes(now - self._begun)}  {what}{self._remaining(now)}"

    def _remaining(self, now: float) -> str:
        """Return how long is left, once a whole round is known."""
        if not self._rounds:
            return ""
        last = self._rounds[-1]
        if now < self._ended:
            remaining = max(0.0, self._since + last - now) + sum(self._rounds) + last
            return f"; about {_minutes(remaining)} left if it is the last round"
        remaining = sum(self._rounds) + self._ended - self._since - (now - self._ended)
        return f"; about {_minutes(remaining)} left" if remaining > 0 else ""


def _minutes(seconds: float) -> str:
    return f"{int(seconds) // 60}:{int(seconds) % 60:02d}"


@contextmanager
def progress(console: Console) -> Iterator[Callable[[str], None]]:
    """Show what is being done: a moving bar on a terminal, elsewhere a line per stage."""
    stages = Stages()
    if not console.is_terminal:

        def line(what: str) -> None:
            console.print(Text(stages.line(what)), soft_wrap=True)

        line("compiling the library of effects")
        yield line
        return
    with bar(console, TimeElapsedColumn(), widest=54) as progress_bar:
        task = progress_bar.add_task("compiling the library of effects", total=None)
        yield lambda what: progress_bar.update(task, description=stages.line(what))


_LIVELY = "quick steering, a steady circle to either side and lane changes, two minutes or more"


def refuse_recordings(recordings: Sequence[xr.Dataset], spec: ModelSpec) -> None:
    """Refuse a recording that is not informative enough, before anything is compiled.

    Raises:
        UserError: If one is too short or too calm, with what to drive; if an input of the model is missing or has gaps.
    """
    for recording in recordings:
        measurements_of(steered(recording, spec.values), spec.model(), str(recording.attrs["file"]))
        file, time = recording.attrs["file"], recording["time"].to_numpy()
        if time[-1] - time[0] < SHORTEST - SHORT_BY:
            raise UserError(
                f"{file}: lasts {time[-1] - time[0]:.1f} s, too short to identify what is missing; record at least "
                f"{SHORTEST:.0f} s, better {_LIVELY}"
            )
        reached = _lateral_acceleration(recording)
        if reached < CALM:
            raise UserError(
                f"{file}: for 95 % of the time the lateral acceleration (speed times yaw rate) is below {reached:.2f} "
                f"m/s^2, too little excitation to identify what is missing; drive {_LIVELY}, so that it passes "
                f"{CALM:g} m/s^2"
            )


def _lateral_acceleration(recording: xr.Dataset) -> float:
    """Return what 95 % of the samples stay below in m/s^2; infinite where speed or yaw rate are not recorded."""
    rates = [str(n) for n in recording if str(n).startswith("yaw_rate")]
    speeds = [n for n in ("speed", "longitudinal_velocity") if n in recording]
    if not rates or not speeds:
        return np.inf
    both = np.abs(recording[rates[0]].to_numpy() * recording[speeds[0]].to_numpy())
    finite = both[np.isfinite(both)]
    return float(np.quantile(finite, 0.95)) if finite.size else np.inf


UNFINISHED = "unfinished"
"""Folder in that of the results which keeps the fits of a trace until it has ended."""


@dataclass(frozen=True)
class TraceTask:
    """What is to be traced.

    Attributes:
        spec: The nominal model.
        train: Recordings to fit, each with its ``name`` as attribute.
        test: Held-out recordings.
        free: Parameters of the nominal model that are fitted in any case.
        estimators: Files in ``harness/estimation/methods``, run with the nominal and the amended model.
        study: Study that is run with the amended model as the plant and both as beliefs, if any.
        repeats: Its runs of each level and drive with other noise.
        excluded: Effects that are not tried.
        rounds: Largest number of additions, as in ``trace``.
        stated_noise: Whether the noise is held as stated.
        jobs: Threads; all cores by default.
        notes: What else the report has to say about the recordings.
        baseline: Earlier recordings of the same vehicle, two or more: what is sought is what changed since.
        stated: Keys of the nominal model, so that it can be traced again.
        after: Trace behind which drives of these were planned.
    """

    spec: ModelSpec
    train: list[xr.Dataset]
    test: list[xr.Dataset]
    free: tuple[str, ...]
    estimators: tuple[str, ...]
    study: Path | None = None
    repeats: int = REPEATS
    excluded: frozenset[str] = frozenset()
    rounds: int | None = None
    stated_noise: bool = False
    jobs: int | None = None
    notes: tuple[str, ...] = ()
    baseline: tuple[xr.Dataset, ...] = ()
    stated: Mapping[str, Any] = field(default_factory=dict)
    after: EarlierTrace | None = None

    @property
    def asked(self) -> dict[str, Any]:
        """What ``EarlierTrace`` reads of it."""
        train, test = (record_of_recordings(recordings) for recordings in (self.train, self.test))
        return {
            "model": dict(self.stated),
            "free": list(self.free),
            "train": train,
            "test": test,
            "estimators": list(self.estimators),
            "excluded": sorted(self.excluded),
            "rounds": self.rounds,
            "stated_noise": self.stated_noise,
        }

    @property
    def recordings(self) -> list[xr.Dataset]:
        """All recordings, those of the baseline last."""
        return [*self.train, *self.test, *self.baseline]


def run_trace(task: TraceTask, folder: Path, console: Console, augmented: AugmentedModel | None = None) -> Outcome:
    """Trace, run the estimators and the study, and write ``trace.json`` and both models.

    Irregularities of the recordings are printed before anything is computed, and are part of the outcome. The verdict
    is written as soon as there is one; what fails thereafter is stated by the outcome, and its traceback is in
    ``errors.txt``.

    Args:
        task: What is to be traced.
        folder: Of the results.
        console: Where warnings and what is being done are shown.
        augmented: The model of the task, compiled, from an earlier one that differs in its recordings only.

    Raises:
        UserError, ModelError: If recordings, model or study do not fit each other, or the folder cannot be written to.
    """
    recordings = task.recordings
    if len(task.baseline) == 1:
        raise UserError("baseline: one recording cannot be fitted and judged; state two or more")
    refuse_repeated(task.estimators, "estimators")
    refuse_recordings(recordings, task.spec)
    if task.study is not None:
        refuse_study(task.study, task.spec)
    notes = (*task.notes, *recording_warnings(recordings))
    failures = Failures(folder, console)
    for note in notes:
        console.print(Text(f"warning: {note}", style="yellow"), soft_wrap=True)
    kept = KeptFits(inside(folder, UNFINISHED))
    # Drives share the cores. Threads of the linear algebra would wait for each other: twice the time of a score test.
    try:
        with threadpool_limits(1), progress(console) as say:
            augmented = (augmented or augmented_model_of(task)).within(gain_ranges(recordings))
            outcome = _since(task, augmented, say, failures, kept) if task.baseline else None
            outcome = outcome or _searched(task, augmented, say, failures, kept)
            outcome = _with_expectation(replace(outcome, notes=notes, asked=task.asked), task)
            write_outcome(outcome, folder)
            _compile(task, outcome, say)
            for kind in task.estimators:
                outcome = replace(outcome, estimators=(*outcome.estimators, *_estimated(task, outcome, kind, say)))
            if task.study is not None:
                outcome = replace(outcome, study_gain=_study_gain(task, outcome, folder, say))
            write_outcome(outcome, folder)
    except KeyboardInterrupt:
        fits = kept.taken + kept.written
        console.print(
            Text(
                f"interrupted: {fits} fits are kept in {kept.folder}; the same trace into {folder} goes on from there"
            ),
            soft_wrap=True,
        )
        raise
    kept.remove()
    return outcome


def _with_expectation(outcome: Outcome, task: TraceTask) -> Outcome:
    """Return an outcome whose answer says whether what was expected of planned drives came true."""
    earlier = task.after
    if earlier is None:
        return outcome

    def compared() -> ExpectationMet | EffectsShown | None:
        posterior, otherwise = outcome.posterior, _driven_otherwise(task, earlier)
        if "models" in earlier.plan["expected"]:
            return expectation_met(earlier.content, earlier.plan, posterior, otherwise)
        found = {h: outcome.values[h.name] for h in outcome.added}
        inclusion = None if posterior is None else posterior.inclusion()
        return effects_shown(earlier.content, earlier.plan, outcome.trace.rounds, found, inclusion, otherwise)

    met = outcome.failures.attempt("the comparison with what was expected", compared, lambda _: None)
    return outcome if met is None else replace(outcome, expectation=met, answer=f"{outcome.answer} {met.words}")


def _driven_otherwise(task: TraceTask, earlier: EarlierTrace) -> str:
    """Return why what planned drives were to tell is not to be expected of those that were driven; empty if it is."""
    if not earlier.driven_since(task.test):
        return "none of the drives since judges, state one of each two as test"
    return driven_otherwise(earlier.driven_since(task.recordings), earlier.place, earlier.plan)


def _searched(
    task: TraceTask, augmented: AugmentedModel, say: Callable[[str], None], failures: Failures, kept: KeptFits
) -> Outcome:
    """Return the verdict on what the model of a task lacks."""
    fitted, held_out = drives_of(task, augmented)
    result = trace(
        augmented,
        fitted,
        held_out,
        task.free,
        say,
        rounds=task.rounds,
        stated_noise=task.stated_noise,
        failures=failures,
        kept=kept,
        earlier=EarlierDrives(models=task.after.models if task.after else ()),
    )
    if kept.taken:
        say(f"{kept.taken} fits of an interrupted trace were taken as they were")
    return outcome_of(result, say, failures)


def _since(
    task: TraceTask,
    augmented: AugmentedModel,
    say: Callable[[str], None],
    failures: Failures,
    kept: KeptFits,
) -> Outcome:
    """Return what changed since the baseline of a task."""
    recordings = list(task.baseline)
    named = zip(recordings, names_of(recordings), strict=True)
    recorded = augmented.share(lambda arguments: augmented.drive(*arguments), named)
    spacing = spacing_of(augmented, recorded, say)
    earlier = [thinned(d, spacing) for d in recorded]
    baseline = learnt(augmented, earlier, task.free, task.stated_noise, say, kept)
    fitted, held_out = ([thinned(d, spacing) for d in drives] for drives in drives_of(task, baseline.augmented))
    result = trace(
        baseline.augmented,
        fitted,
        held_out,
        of_roads(augmented),
        say,
        rounds=task.rounds,
        stated_noise=task.stated_noise,
        failures=failures,
        kept=kept,
        earlier=EarlierDrives(random_processes(augmented)),
    )
    known = tuple(h for h in baseline.added if h.kind == "effect")
    return since(outcome_of(replace(result, known=known), say, failures), baseline)


def augmented_model_of(task: TraceTask) -> AugmentedModel:
    """Return the model of a task with everything that its recordings could show, compiled."""
    signals = set.intersection(*({str(v) for v in r} for r in task.recordings))
    return AugmentedModel(task.spec, signals, task.jobs, task.excluded)


def drives_of(task: TraceTask, augmented: AugmentedModel) -> tuple[list[DriveData], list[DriveData]]:
    """Return the fitted and the held-out drives of a task in terms of its model."""
    recordings = task.train + task.test
    named = zip(recordings, names_of(recordings), strict=True)
    drives = augmented.share(lambda arguments: augmented.drive(*arguments), named)
    return drives[: len(task.train)], drives[len(task.train) :]


def _compile(task: TraceTask, outcome: Outcome, say: Callable[[str], None]) -> None:
    """Compile all estimators at once; what fails here is told where it fails again."""
    jobs = outcome.trace.fitting.augmented.jobs
    with suppress(Exception):
        compile_estimators((outcome.nominal, outcome.amended), task.estimators, task.test[0], jobs, say)


def _estimated(task: TraceTask, outcome: Outcome, kind: str, say: Callable[[str], None]) -> tuple[EstimatorErrors, ...]:
    """Return one estimator on the held-out drives; none if it cannot be run."""
    return outcome.failures.attempt(
        f"the estimates of {kind}",
        lambda: estimators_on(outcome.trace, outcome.amended, task.test, (kind,), say),
        lambda _: (),
    )


def _study_gain(task: TraceTask, outcome: Outcome, folder: Path, say: Callable[[str], None]) -> StudyGain | str:
    """Run the study; a trace is not lost because a study cannot be run with what it found."""
    assert task.study is not None
    study = task.study
    if not outcome.added:
        return f"Nothing was added to the model, so {study} was not run."
    models = {"nominal": outcome.nominal, "amended": outcome.amended}
    return outcome.failures.attempt(
        f"the study {study}",
        lambda: study_gain(study, folder, models, task.estimators, task.repeats, task.jobs, say),
        lambda why: f"{study} cannot be run with the amended model: {why}.",
    )
