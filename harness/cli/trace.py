"""``harness trace``: what does the model lack that these drives can show?"""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer
from rich.console import Console
from rich.text import Text

from harness.cli.options import (
    MOST,
    EffectOption,
    JobsOption,
    ParametersOption,
    RecordedSensorsOption,
    SetOption,
    TyreOption,
    study_path,
)
from harness.common.stages import showing


def trace(
    model: Annotated[str, typer.Option("--model", "-m", help="Vehicle; harness list vehicles shows them.")],
    train: Annotated[
        list[Path], typer.Option("--train", help="Recording to fit, or a part: lap.csv@0s:200s; repeatable.")
    ],
    test: Annotated[list[Path], typer.Option("--test", "-t", help="Held-out recording, or a part; repeatable.")],
    out: Annotated[Path, typer.Option("--out", "-o", help="Folder of trace.json, the amended model and the report.")],
    channels: Annotated[
        Path | None, typer.Option("--channels", "-c", help="Channel map of the recordings; signal names if absent.")
    ] = None,
    parameters: ParametersOption = None,
    tyre: TyreOption = None,
    effect: EffectOption = None,
    sensors: RecordedSensorsOption = None,
    values: SetOption = None,
    free: Annotated[
        list[str] | None,
        typer.Option(
            "--free", help="Nominal parameters that are always fitted, repeatable; cornering stiffnesses if absent."
        ),
    ] = None,
    estimators: Annotated[
        list[str] | None,
        typer.Option(
            "--estimators",
            help="Estimators run on the test drives before and after, repeatable; ekf,ukf,cdkf if absent.",
        ),
    ] = None,
    study: Annotated[
        str | None, typer.Option("--study", help="Study of the same vehicle that measures the gain of the amendment.")
    ] = None,
    repeats: Annotated[
        int, typer.Option("--repeats", min=1, max=MOST, help="Noise realisations of each level of that study.")
    ] = 8,
    jobs: JobsOption = None,
) -> None:
    """Find the physical effect that a model lacks or the parameter that is wrong, and how much the model improves.

    Writes trace.json, the nominal and the amended model as parameter files, and a report.
    """
    from harness.api.diagnosis import ESTIMATORS, Diagnosis
    from harness.api.recordings import read_recording
    from harness.cli.options import ModelOptions, command, listed, model_of

    path = None if study is None else study_path(study)
    run = ESTIMATORS if estimators is None else listed(estimators)
    diagnosis = Diagnosis(listed(free or []), run, path, repeats, jobs)
    fitted, held_out = ([read_recording(each, channels) for each in paths] for paths in (train, test))
    nominal = model_of(ModelOptions(model, parameters, tyre, effect, sensors, values))
    diagnosis.fit(nominal, fitted, held_out, out)
    with showing(Console(stderr=True), "writing the report"):
        written = diagnosis.report(out, command())
    Console().print(Text(diagnosis.answer_, style="bold"), soft_wrap=True)
    for file in written:
        Console().print(Text(str(file)), soft_wrap=True)
