"""``harness trace``: what does the model lack that these drives can show?"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer
from rich.console import Console
from rich.text import Text

from harness.cli.declared import takes
from harness.cli.options import MOST, JobsOption, MaybeModelOptions, command, listed, model_of, printed, study_path
from harness.cli.recorded_options import MeasuredOptions
from harness.common.stages import showing

if TYPE_CHECKING:
    from harness.identification.measured_file import MeasuredStudy


@dataclass(frozen=True, kw_only=True)
class TraceOptions(MeasuredOptions):
    """A model that may lack something, and recordings that may show it."""

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

    @property
    def needed(self) -> dict[str, Any]:
        """What is needed further without a file, by its option."""
        return {"--test": self.test}


@takes(TraceOptions)
def trace(task: TraceOptions) -> None:
    """Find the physical effect that a model lacks or the parameter that is wrong, and how much the model improves.

    Takes a file of measured drives, such as studies/loops/genesis.toml, or a model and recordings. Parameters to fit
    are the cornering stiffnesses if none are named. Writes trace.json, the nominal and the amended model as parameter
    files, and a report; of a file also loop.json, each held-out drive with the published, refitted and amended model.
    """
    from harness.api.diagnosis import Diagnosis
    from harness.api.recordings import read_recording

    if (of_file := task.of_file("trace")) is not None:
        return _trace_file(*of_file, task.jobs)
    assert task.out is not None
    study = None if task.study is None else study_path(task.study)
    estimators = None if task.estimators is None else listed(task.estimators)
    diagnosis = Diagnosis(listed(task.free or []), estimators, study, task.repeats, task.jobs)
    train, test = ([read_recording(path, task.channels) for path in paths] for paths in (task.train, task.test))
    diagnosis.fit(model_of(task.model), train, test, task.out)
    with showing(Console(stderr=True), "writing the report"):
        written = diagnosis.report(task.out, command())
    return printed(diagnosis.answer_, written)


def loop(
    file: Annotated[Path, typer.Argument(help="File of measured drives, such as studies/loops/genesis.toml.")],
    out: Annotated[
        Path | None, typer.Option("--out", "-o", help="Folder of the results; results/loop-<name> if absent.")
    ] = None,
    jobs: JobsOption = None,
) -> None:
    """Trace a file of measured drives: former name of harness trace FILE."""
    Console(stderr=True).print(Text("note: harness loop FILE is called harness trace FILE"), soft_wrap=True)
    task = MeasuredOptions(file=file, model=MaybeModelOptions(), out=out, jobs=jobs)
    if (of_file := task.of_file("loop")) is not None:
        _trace_file(*of_file, jobs)


def _trace_file(study: MeasuredStudy, out: Path, jobs: int | None) -> None:
    """Trace the drives of a file, and its changed drives; say so where their folder is absent."""
    from harness.diagnosis.measured_study import trace_study

    if study.absent:
        Console().print(Text(study.absent), soft_wrap=True)
        return
    console = Console(stderr=True)
    with showing(console, "reading the recordings"):
        drives = study.drives()
    *answers, last = trace_study(study, drives, out, jobs, console)
    for answer in answers:
        printed(answer, ())
    printed(last, [out / "report.html"])
