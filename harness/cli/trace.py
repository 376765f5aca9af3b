"""``harness trace``: what does the model lack that these drives can show?"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import typer
from rich.console import Console

from harness.cli.declared import takes
from harness.cli.options import MOST, JobsOption, ModelOptions, command, listed, model_of, printed, study_path
from harness.cli.recorded_options import TEST, ChannelsOption, FreeOption, TrainOption
from harness.common.stages import showing


@dataclass(frozen=True, kw_only=True)
class TraceTask:
    """A model that may lack something, and recordings that may show it."""

    model: ModelOptions
    train: TrainOption
    test: Annotated[list[Path], typer.Option("--test", "-t", help=TEST)]
    out: Annotated[Path, typer.Option("--out", "-o", help="Folder of trace.json, the amended model and the report.")]
    channels: ChannelsOption = None
    free: FreeOption = None
    estimators: Annotated[
        list[str] | None,
        typer.Option(
            "--estimator",
            "-e",
            help="Estimators run on the test drives before and after; repeatable; ekf,ukf,cdkf if absent.",
        ),
    ] = None
    study: Annotated[
        str | None, typer.Option("--study", help="Study of the same vehicle that measures the gain of the amendment.")
    ] = None
    repeats: Annotated[
        int, typer.Option("--repeats", min=1, max=MOST, help="Noise realisations of each level of that study.")
    ] = 8
    jobs: JobsOption = None


@takes(TraceTask)
def trace(task: TraceTask) -> None:
    """Find the physical effect that a model lacks or the parameter that is wrong, and how much the model improves.

    Parameters to fit are the cornering stiffnesses if none are named. Writes trace.json, the nominal and the amended
    model as parameter files, and a report.
    """
    from harness.api.diagnosis import ESTIMATORS, Diagnosis
    from harness.api.recordings import read_recording

    study = None if task.study is None else study_path(task.study)
    estimators = ESTIMATORS if task.estimators is None else listed(task.estimators)
    diagnosis = Diagnosis(listed(task.free or []), estimators, study, task.repeats, task.jobs)
    train, test = ([read_recording(path, task.channels) for path in paths] for paths in (task.train, task.test))
    diagnosis.fit(model_of(task.model), train, test, task.out)
    with showing(Console(stderr=True), "writing the report"):
        written = diagnosis.report(task.out, command())
    printed(diagnosis.answer_, written)
