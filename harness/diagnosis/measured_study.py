"""Trace of the drives of a file and then of its changed drives, with the published model and the fitted ones."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import xarray as xr
from rich.console import Console

from harness.common.files import json_text, write_files
from harness.common.places import inside
from harness.common.stages import showing
from harness.config import ModelSpec
from harness.diagnosis.report.report import report
from harness.diagnosis.result.changes import record_of_changes
from harness.diagnosis.result.outcome import Outcome
from harness.diagnosis.result.study_gain import REPEATS
from harness.diagnosis.run import TraceTask, run_trace
from harness.identification.candidates import Candidates
from harness.identification.earlier_result import with_absolute_paths
from harness.identification.measured_file import MeasuredStudy
from harness.identification.report import spans_sheet
from harness.identification.result import judged_on
from harness.models.quantities import quantity
from harness.reporting import style
from harness.reporting.document import Block, Prose, Section, Sheet, plain

Errors = dict[str, dict[str, dict[str, dict[str, float]]]]


def trace_study(
    study: MeasuredStudy, drives: dict[str, list[xr.Dataset]], folder: Path, jobs: int | None, console: Console
) -> list[str]:
    """Trace what the model lacks in the drives of a file, write the results and return the answers in sentences.

    What changed in the changed drives since all others follows the question that the file asks.

    Args:
        study: The file.
        drives: Its recordings by the key that names them (``MeasuredStudy.drives``).
        folder: Of the results; those of the changed drives go to ``changed`` in it.
        jobs: Threads; all cores if ``None``.
        console: Takes progress and warnings.

    Raises:
        UserError: If the recordings cannot be traced or the folder cannot be written to.
    """
    outcome = _trace(study, study.nominal(), drives, folder, jobs, console)
    answers = [outcome.answer]
    if study.raw.changed is not None:
        answers += [
            study.raw.changed.question,
            _changed(study, study.nominal(), drives, inside(folder, "changed"), jobs, console),
        ]
    return answers


def _trace(
    study: MeasuredStudy,
    spec: ModelSpec,
    drives: dict[str, list[xr.Dataset]],
    folder: Path,
    jobs: int | None,
    console: Console,
) -> Outcome:
    """Trace what the nominal model lacks and write the results."""
    raw, worth = study.raw, study.raw.worth
    task = replace(
        _task(study, spec, drives, "", jobs),
        free=study.fitted_parameters(),
        study=study.path.parent / worth.study if worth else None,
        repeats=worth.repeats if worth else REPEATS,
    )
    outcome = run_trace(task, folder, console)
    about = Section(lambda: _about(study, ""), "Which drives?", headed=False)
    _write(study, outcome, spec, raw.title, [about], folder, console)
    return outcome


def _changed(
    study: MeasuredStudy,
    spec: ModelSpec,
    drives: dict[str, list[xr.Dataset]],
    folder: Path,
    jobs: int | None,
    console: Console,
) -> str:
    """Find what changed since the drives of the file in its changed drives; write the results."""
    assert study.raw.changed is not None
    earlier = (*drives["train"], *drives["test"])
    task = replace(_task(study, spec, drives, "changed.", jobs), free=study.fitted_parameters(), baseline=earlier)
    outcome = run_trace(task, folder, console)
    write_files(folder, {"changed.json": json_text(record_of_changes(outcome))})
    evidence = [Section(lambda: _about(study, "changed."), "Which drives?", headed=False)]
    _write(study, outcome, spec, study.raw.changed.question, evidence, folder, console)
    return outcome.answer


def _task(
    study: MeasuredStudy, spec: ModelSpec, drives: dict[str, list[xr.Dataset]], part: str, jobs: int | None
) -> TraceTask:
    """Return what is to be traced in one part of a file, nothing refitted beforehand."""
    raw = study.raw
    return TraceTask(
        spec,
        drives[f"{part}train"],
        drives[f"{part}test"],
        (),
        tuple(raw.estimators),
        excluded=study.excluded,
        rounds=raw.rounds,
        stated_noise=raw.stated_noise,
        jobs=jobs,
        stated=with_absolute_paths(study.stated),
    )


def _write(
    study: MeasuredStudy,
    outcome: Outcome,
    stated: ModelSpec,
    title: str,
    evidence: list[Section],
    folder: Path,
    console: Console,
) -> None:
    """Write ``loop.json`` and the report, with further evidence."""
    with showing(console, "writing the report"):
        errors = outcome.failures.attempt(
            "loop.json, the error of each model on the held-out drives", lambda: held_out(outcome, stated), lambda _: {}
        )
        write_files(folder, {"loop.json": json_text(errors)})
        table = Section(
            lambda: [_errors(errors)] if errors else [], "How large is the error on each held-out drive?", headed=False
        )
        made = report(outcome, f"harness trace {study.path}", title, [table, *evidence])
        made.write(folder, failures=outcome.failures)


def held_out(outcome: Outcome, stated: ModelSpec) -> Errors:
    """Return the simulation error on each held-out drive, in SI units, by drive, output, model and measure.

    ``published`` is the ``stated`` model, ``refitted`` the one with its own parameters fitted, ``amended`` with all
    that was added. ``rmse`` counts a constant error, ``std`` does not.
    """
    trace = outcome.trace
    augmented = trace.fitting.augmented
    published = augmented.stated()
    for name, value in stated.values.items():
        published[augmented.row(name)] = value
    at = replace(Candidates.of(augmented.spec), values=published[:, None])
    by_drive: Errors = {}
    for drive, refitted, amended in zip(trace.held_out.drives, trace.before.drives, trace.after.drives, strict=True):
        simulated = {
            "published": judged_on(augmented, [drive], at)[0].simulated,
            "refitted": refitted.simulated,
            "amended": amended.simulated,
        }
        errors = {k: drive.measurements - s for k, s in simulated.items()}
        by_drive[drive.name] = {
            name: {
                k: {"rmse": float(np.sqrt(np.nanmean(e[:, a] ** 2))), "std": float(np.nanstd(e[:, a]))}
                for k, e in errors.items()
            }
            for a, name in enumerate(augmented.model.outputs)
        }
    return by_drive


def _about(study: MeasuredStudy, part: str) -> list[Block]:

    spans = study.spans()
    further: list[Block] = [spans_sheet({"fitted": spans[f"{part}train"], "held out": spans[f"{part}test"]})]
    if study.raw.bank_map:
        text = (
            "The bank of the road is a map over the path, from accelerometer and velocities of the fitted drives. No "
            "drive was given a bank computed from itself. Whether the map is used is one of the hypotheses."
        )
        further.append(Prose(plain(text)))
    if study.raw.exclude:
        rows = [[e.effect.replace("_", " "), e.reason] for e in study.raw.exclude]
        further.append(Sheet(["effect", "why it was not tried"], rows, "Effects left out.", left=2))
    return further


def _errors(errors: Errors) -> Block:

    rows, models = [], ("published", "refitted", "amended")
    for drive, outputs in errors.items():
        for name, by_model in outputs.items():
            q = quantity(name)
            numbers = [q.scale * by_model[m][kind] for kind in ("rmse", "std") for m in models]
            rows.append([drive, q.words, q.unit, *map(style.number, numbers)])
    header = ["drive", "output", "unit", *models, *(f"{m}, std." for m in models)]
    caption = (
        "Each held-out drive: simulation error as root mean square, and as standard deviation, which leaves out a "
        "constant error. Published: as stated, nothing fitted; where the vehicle may have changed, "
        "as it was before."
    )
    return Sheet(header, rows, caption, left=3)
