"""Export an estimator of a study, with a run that it is tested on."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from harness.common.arrays import Floats
from harness.common.errors import UserError
from harness.common.files import parse_toml
from harness.common.registry import closest
from harness.config import DesignSpec, StudySpec, build_study
from harness.config.parameter_set import load_set
from harness.config.specs import DriveSpec, EstimatorSpec
from harness.estimation.compiled_estimator import CompiledEstimator
from harness.estimation.contract import load_estimator
from harness.realtime.export import folder
from harness.realtime.export.interface import interface_of, name_in_c
from harness.realtime.export.library import Precision, library_of
from harness.realtime.export.monitor import read_monitor
from harness.realtime.export.source import Export
from harness.runner.contract import History
from harness.runner.history import EverySample
from harness.runner.monitor import Watching
from harness.study.design import Unit
from harness.study.evaluate import StudyEvaluator
from harness.study.run_noise import Case


@dataclass(frozen=True)
class Exported:
    """An estimator as C.

    Attributes:
        export: What it is.
        files: Text by file name.
        estimator: The same for studies.
        inputs, history: Of the recorded run: what was known ``(samples, nu)``, and what the estimator made of it.
        recorded: That run, in words.
    """

    export: Export
    files: Mapping[str, str]
    estimator: CompiledEstimator
    inputs: Floats
    history: History
    recorded: str

    @property
    def answer(self) -> str:
        """What it is, in a sentence."""
        lines = self.files[f"{self.export.name}.c"].count("\n")
        return (
            f"{self.export.title} in C: {lines:,} lines, {self.export.memory:,} bytes of memory for each that runs, "
            f"{self.export.precision} precision; 'make check' in the folder builds it and replays {self.recorded}"
        )


def chosen(study: StudySpec, estimator: str | None) -> EstimatorSpec:
    """Return an estimator of a study by name, the first by default.

    Raises:
        UserError: If there is none of that name, or it is no kernel.
    """
    names = [e.name for e in study.estimators]
    if estimator is not None and estimator not in names:
        raise UserError(
            f"--estimator '{estimator}': study '{study.name}' has none of that name{closest(estimator, names)}"
        )
    spec = study.estimators[0 if estimator is None else names.index(estimator)]
    if hasattr(load_estimator(spec.kind), "filter_of"):
        raise UserError(f"estimator '{spec.name}' ({spec.kind}) cannot be exported: it is no kernel of the harness")
    return spec


def believing(study: StudySpec, path: Path) -> StudySpec:
    """Return a study whose belief is a parameter file, with the sensors that it names.

    Args:
        study: Of the same vehicle. What its belief states of unknown inputs and parameters stands where the file says
            nothing of it; values and noise of its own do not.
        path: Of the file.

    Raises:
        UserError: If it is none, or does not fit.
    """
    if not path.is_file():
        raise UserError(f"--parameters {path}: there is no such file")
    stated, table = load_set(str(path.resolve()), Path(), "--parameters"), parse_toml(study.text, str(study.path))
    away = {"parameters", "values", "noise", "effects", *stated.unsure, *(["sensors"] if stated.sensors else [])}
    table["belief"] = {k: v for k, v in table.get("belief", {}).items() if k not in away}
    table["belief"]["parameters"] = str(path.resolve())
    if stated.sensors:
        table["plant"]["sensors"] = stated.sensors
    table.pop("history", None)
    return build_study(table, study.path)


def export(
    study: StudySpec,
    estimator: str | None = None,
    precision: Precision = "double",
    name: str | None = None,
    recorded: tuple[str | None, float] = (None, 20.0),
    say: Callable[[str], None] = lambda _: None,
    monitor: Path | None = None,
) -> Exported:
    """Return an estimator of a study as C.

    Args:
        study: The study; its designs do not matter.
        estimator: Its name there, the first by default.
        precision: Of the numbers.
        name: That everything in C begins with; study and estimator by default.
        recorded: Name of the drive of the recorded run, the first by default, and s of it, or the whole if it is
            shorter.
        say: Informed of what is going on.
        monitor: File of its trust monitor, printed next to it.

    Raises:
        UserError: If there is no such estimator, drive or monitor, or it cannot be printed.
    """
    spec, duration = chosen(study, estimator), recorded[1]
    whole = name_in_c(name, f"{study.name}_{spec.name}")
    if study.belief.input_noise:
        raise UserError(
            f"estimator '{spec.name}' ({spec.kind}) cannot be exported: the belief states noise of inputs "
            f"({', '.join(study.belief.input_noise)}), of which exported estimators know nothing; leave noise.input out"
        )
    driven = _drive(study, *recorded)
    say("building model and drive")
    alone = dataclasses.replace(
        study, drives=(driven,), estimators=(spec,), designs=(DesignSpec("export", ()),), history=(), over_time=None
    )
    evaluator = StudyEvaluator(alone)
    compiled, made = evaluator.compiled, evaluator.compiled.estimators[0]
    assert isinstance(made, CompiledEstimator)
    watch = None if monitor is None else read_monitor(monitor, study.hash, spec.name, made)
    unit, cases = Unit(0, 0, 0, 0, 1), [Case(0, 0)]
    there = len(compiled.drives[0].profile.time)
    samples = int(min(duration / study.belief.step + 1.5, there))
    say(f"recording {samples} samples of drive '{driven.name}'")
    batch, held = evaluator.simulate(unit, cases, samples), evaluator.held(unit, cases, "belief")
    inputs, believed = evaluator.inputs(0, 0, batch, held), evaluator.believed_by(0, unit, cases, held)
    measurements = compiled.measured(batch.measurements)
    history = made.run(inputs, measurements, believed, EverySample(of_signals=True))
    values = believed.values[:, 0].tolist()
    say("printing the kernels")
    library = library_of(spec.name, made, None if watch is None else watch.bounds, values)
    untuned = dataclasses.replace(held, first_variance=compiled.first_variance(held.process_noise))
    settings = ", ".join(f"{key} = {value}" for key, value in spec.settings.items())
    export = Export(
        whole,
        " ".join(f"Estimator '{spec.name}' ({spec.kind}) of study '{study.name}'".split()).replace("*/", "* /"),
        library,
        interface_of(compiled.belief, values),
        precision,
        study.belief.step,
        {group: getattr(believed, group)[:, 0].tolist() for group in (*_VARIANCES, "first")},
        {group: _ratio(*(getattr(each, group)[:, 0] for each in (believed, untuned))) for group in _VARIANCES},
        study.hash,
        f"Settings: {settings or 'none'}.",
        watch,
    )
    y = measurements[..., 0].copy()
    y[0] = np.nan
    trust = None
    if watch is not None:
        trust = made.run(inputs, measurements, believed, Watching(watch.bounds)).verdicts[:, :2, 0]
    files = folder.contents(export, made.has_covariance, inputs.at[..., 0], y, history, trust)
    length = f"{(samples - 1) * study.belief.step:g} s of drive '{driven.name}'"
    whole_drive = ", which is no longer" if duration > (there - 1) * study.belief.step else ""
    return Exported(export, files, made, inputs.at[..., 0], history, f"{length}{whole_drive}")


_VARIANCES = ("process_noise", "measurement_noise", "first_variance")
"""Of what is believed, that which tuning changes."""


def _drive(study: StudySpec, drive: str | None, duration: float) -> DriveSpec:
    """Return a drive of a study by name, the first by default, of which so many s are wanted."""
    drives = [d.name for d in study.drives]
    if drive is not None and drive not in drives:
        raise UserError(f"--drive {drive}: study '{study.name}' has no such drive{closest(drive, drives)}")
    if not duration >= study.belief.step:
        raise UserError(f"duration: {duration:g} s is less than a sample of {study.belief.step:g} s; record more")
    return study.drives[0 if drive is None else drives.index(drive)]


def _ratio(tuned: Floats, untuned: Floats) -> list[float]:
    """Return tuned variances over others; 1 where these are zero."""
    return [float(t / u) if u > 0 else 1.0 for t, u in zip(tuned, untuned, strict=True)]
