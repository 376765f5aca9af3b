"""A trace from recordings to an outcome on disk: what ``harness trace`` and ``harness loop`` share."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass, replace
from pathlib import Path

import xarray as xr
from rich.console import Console
from rich.text import Text
from threadpoolctl import threadpool_limits

from harness.common.failures import Failures
from harness.common.places import inside
from harness.config import ModelSpec
from harness.diagnosis.criteria import ROUNDS
from harness.diagnosis.fitting.kept_fits import KeptFits
from harness.diagnosis.known_gains import known_ranges
from harness.diagnosis.model.augmented_model import AugmentedModel
from harness.diagnosis.progress import progress
from harness.diagnosis.recording_checks import refuse_recordings
from harness.diagnosis.result.estimator_gain import Estimated, estimators_on
from harness.diagnosis.result.estimator_kernels import compile_estimators
from harness.diagnosis.result.outcome import Outcome, outcome_of
from harness.diagnosis.result.record import write_outcome
from harness.diagnosis.result.study_gain import REPEATS, StudyGain, refuse_study, study_gain
from harness.diagnosis.selection.forward_selection import trace
from harness.diagnosis.selection.parameter_changes import Changes, single_changes
from harness.identification.data import Drive
from harness.identification.measured_file import names_of, refuse_repeated
from harness.recordings.check.examine import recording_warnings

UNFINISHED = "unfinished"
"""Folder in that of the results which keeps the fits of a trace until it has ended."""


@dataclass(frozen=True)
class Task:
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
        rounds: Largest number of additions.
        stated_noise: Whether the noise is held as stated.
        jobs: Threads; all cores by default.
        notes: What else the report has to say about the recordings.
    """

    spec: ModelSpec
    train: list[xr.Dataset]
    test: list[xr.Dataset]
    free: tuple[str, ...]
    estimators: tuple[str, ...]
    study: Path | None = None
    repeats: int = REPEATS
    excluded: frozenset[str] = frozenset()
    rounds: int = ROUNDS
    stated_noise: bool = False
    jobs: int | None = None
    notes: tuple[str, ...] = ()


def run_trace(task: Task, folder: Path, console: Console, augmented: AugmentedModel | None = None) -> Outcome:
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
    recordings = task.train + task.test
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
            augmented = (augmented or augmented_model_of(task)).within(known_ranges(recordings))
            outcome = replace(_searched(task, augmented, say, failures, kept), notes=notes)
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


def _searched(
    task: Task, augmented: AugmentedModel, say: Callable[[str], None], failures: Failures, kept: KeptFits
) -> Outcome:
    """Return the verdict on what the model of a task lacks."""
    fitted, held_out = drives_of(task, augmented)
    found = trace(
        augmented,
        fitted,
        held_out,
        task.free,
        say,
        rounds=task.rounds,
        stated_noise=task.stated_noise,
        failures=failures,
        kept=kept,
    )
    if kept.taken:
        say(f"{kept.taken} fits of an interrupted trace were taken as they were")
    return outcome_of(found, say, failures)


def augmented_model_of(task: Task) -> AugmentedModel:
    """Return the model of a task with everything that its recordings could show, compiled."""
    signals = set.intersection(*({str(v) for v in r} for r in task.train + task.test))
    return AugmentedModel(task.spec, signals, task.jobs, task.excluded)


def run_changes(task: Task, console: Console) -> Changes:
    """Refit every parameter of the model of a task alone.

    Raises:
        UserError, ModelError: If recordings and model do not fit each other.
    """
    refuse_recordings(task.train + task.test, task.spec)
    with threadpool_limits(1), progress(console) as say:
        augmented = augmented_model_of(task)
        fitted, held_out = drives_of(task, augmented)
        return single_changes(augmented, fitted, held_out, task.stated_noise, say)


def drives_of(task: Task, augmented: AugmentedModel) -> tuple[list[Drive], list[Drive]]:
    """Return the fitted and the held-out drives of a task in terms of its model."""
    recordings = task.train + task.test
    named = zip(recordings, names_of(recordings), strict=True)
    drives = augmented.share(lambda one: augmented.drive(*one), named)
    return drives[: len(task.train)], drives[len(task.train) :]


def _compile(task: Task, outcome: Outcome, say: Callable[[str], None]) -> None:
    """Compile all estimators at once; what fails here is told where it fails again."""
    jobs = outcome.trace.fitting.augmented.jobs
    with suppress(Exception):
        compile_estimators((outcome.nominal, outcome.amended), task.estimators, task.test[0], jobs, say)


def _estimated(task: Task, outcome: Outcome, kind: str, say: Callable[[str], None]) -> tuple[Estimated, ...]:
    """Return one estimator on the held-out drives; none if it cannot be run."""
    return outcome.failures.attempt(
        f"the estimates of {kind}",
        lambda: estimators_on(outcome.trace, outcome.amended, task.test, (kind,), say),
        lambda _: (),
    )


def _study_gain(task: Task, outcome: Outcome, folder: Path, say: Callable[[str], None]) -> StudyGain | str:
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
