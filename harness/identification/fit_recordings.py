"""Recordings in, parameters and report out: what commands and the Python interface share."""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr
from pydantic import BaseModel

from harness.common.arrays import Floats
from harness.common.errors import UserError
from harness.common.failures import Failures
from harness.common.files import write_files
from harness.common.registry import closest
from harness.config import ModelSpec
from harness.config.model_choice import complete
from harness.config.parameter_set import load_set
from harness.identification.contract import Fit, Problem, load_method, settings_of
from harness.identification.data import DriveData, refuse_the_same, steered, step_of
from harness.identification.earlier_result import EarlierResult, record_of_recordings
from harness.identification.expectation import reached_errors, reached_rmse, record_of_errors
from harness.identification.free_run import blocks
from harness.identification.innovations import Innovations
from harness.identification.measured_file import finely, fitted_parameters, names_of, refuse_repeated
from harness.identification.planned_drive import driven_otherwise
from harness.identification.report import report
from harness.identification.result import FILE, Judged, answer, judge, series_of, write_outcome
from harness.models.assembly.degradation import refuse_degradations
from harness.recordings.check.examine import recording_warnings
from harness.reporting.document import Prose, plain


@dataclass(frozen=True)
class FitTask:
    """What is to be fitted.

    Attributes:
        spec: The model; the search begins at its values.
        train: Recordings to fit, each with its ``name`` as attribute.
        free: Parameters to find.
        test: Held-out recordings.
        method: File in ``harness/identification/methods``.
        settings: Of the method; its defaults for what is absent.
        seed: Of the method's random numbers.
        jobs: Threads; all cores by default.
        stated: Keys of the model, so that it can be fitted again.
        after: Identification behind which drives of these were planned.
    """

    spec: ModelSpec
    train: Sequence[xr.Dataset]
    free: tuple[str, ...]
    test: Sequence[xr.Dataset] = ()
    method: str = "likelihood"
    settings: Mapping[str, Any] = field(default_factory=dict)
    seed: int = 0
    jobs: int | None = None
    stated: Mapping[str, Any] = field(default_factory=dict)
    after: EarlierResult | None = None

    def asked(self, settings: BaseModel) -> dict[str, Any]:
        """Return what ``EarlierResult`` reads of it, with the settings as the method takes them."""
        train, test = (record_of_recordings(recordings) for recordings in (self.train, self.test))
        kept = {"settings": settings.model_dump(mode="json", exclude_unset=True), "train": train, "test": test}
        return {
            "model": dict(self.stated),
            "free": list(self.free),
            "method": self.method,
            "seed": int(self.seed),
            **kept,
        }


@dataclass(frozen=True)
class Fitted:
    """A model fitted to recordings.

    Attributes:
        problem: The model before the fit, with the fitted recordings.
        fit: What was found.
        tests: The held-out recordings.
        notes: Irregularities of the recordings, with the evidence.
    """

    problem: Problem
    fit: Fit
    tests: tuple[DriveData, ...]
    notes: tuple[str, ...] = ()

    @property
    def drives(self) -> tuple[DriveData, ...]:
        """The fitted recordings."""
        return self.problem.drives

    @property
    def free(self) -> tuple[str, ...]:
        """Names of the parameters that were to be found."""
        return tuple(self.problem.free)

    @cached_property
    def judged(self) -> list[Judged]:
        """Every recording against the model before and after the fit, the fitted ones first."""
        return judge(self.problem, self.fit, self.tests)

    @property
    def answer(self) -> str:
        """The result in sentences; of a comparison that cannot be made it says nothing, the report does."""
        with contextlib.suppress(ArithmeticError, ValueError):
            return answer(self.fit, self.judged)
        return answer(self.fit)

    def write(self, folder: Path, command: str) -> list[Path]:
        """Write the parameter set, ``identify.json``, the recordings over time and the report; return their paths.

        Args:
            folder: Where to.
            command: How it was made, for the report.

        Raises:
            UserError: If the folder cannot be written to.
        """
        failures = Failures(folder)
        judged = failures.attempt("the comparison with the recordings", lambda: self.judged, lambda _: [])
        not_made = [Prose(plain(sentence)) for sentence in failures.sentences]
        names = ", ".join(drive.name for drive in self.drives)
        return [
            *write_outcome(folder, self.fit, judged, f"harness identify, method {self.fit.method}, on {names}"),
            *write_files(folder, {FILE: series_of(judged, self.problem.innovations.model)}),
            *report(self.fit, judged, command, evidence=not_made or None, notes=self.notes).write(
                folder, failures=failures
            ),
        ]


def fit_recordings(task: FitTask, say: Callable[[str], None] = lambda _: None) -> Fitted:
    """Fit a model to recordings.

    Args:
        task: What is to be fitted.
        say: Receives what is being done, in words.

    Raises:
        UserError: If a parameter, setting or signal is unknown or missing, or a held-out recording is fitted as well.
        ModelError: If there is no such method.
    """
    method = load_method(task.method)
    settings = settings_of(method, task.settings)
    _check_free(task.spec, task.free)
    refuse_the_same(task.train, task.test)
    innovations = Innovations(task.spec, jobs=task.jobs)
    recordings = [*task.train, *task.test]
    names = names_of(recordings)
    drives = [innovations.drive(r, name, "joined") for r, name in zip(recordings, names, strict=True)]
    problem = Problem(innovations, tuple(drives[: len(task.train)]), task.free, task.seed)
    fit = method.identify(problem, settings, lambda text: say(f"{task.method}: {text}"))
    fit = replace(fit, asked=task.asked(settings))
    if task.after is not None:
        plan = task.after.plan
        reached = reached_errors(plan, fit.estimates, fit.spec)
        otherwise = driven_otherwise(task.after.driven_since(task.train), task.after.place, plan)
        rmse = reached_rmse(plan, fit.estimates, fit.correlation) if "errors" in plan["expected"] else ()
        fit = replace(fit, planned=record_of_errors(reached, otherwise, rmse))
    return Fitted(problem, fit, tuple(drives[len(task.train) :]), recording_warnings(recordings))


def _check_free(spec: ModelSpec, names: Sequence[str]) -> None:
    """Refuse names that the model does not have before anything is compiled."""
    refuse_degradations(spec.model())
    parameters = spec.model().parameter_names
    if not names:
        raise UserError(f"free: name the parameters to estimate; the model has: {', '.join(parameters)}")
    for name in names:
        if name not in parameters:
            raise UserError(f"free: the model has no parameter '{name}'{closest(name, parameters)}")
    refuse_repeated(names, "free")


_LONGEST = 300.0
"""s; the middle of a longer recording is fitted."""

_SETTINGS = {"iterations": 15, "annealings": 0, "profiles": False}
_GEARED = ("steering_ratio",)
"""Fitted in addition to the stiffnesses where the model has it: a wrong map is seen in it first."""


class NominalFit:
    """Error of the model of a parameter set on a recording, fitted to it.

    Args:
        parameters: Parameter set or path of a parameter file, which names vehicle, tyre and effects.
        say: Receives what is being done, in words.

    Raises:
        UserError: If there is no such file, or anything in it is wrong.
        ModelError: If there is no such set.
    """

    def __init__(self, parameters: str, say: Callable[[str], None] = lambda _: None) -> None:
        self.parameters, self._say = parameters, say
        self._vehicle = load_set(parameters, Path(), "--parameters").vehicle

    def __call__(self, recording: xr.Dataset) -> Floats:
        """Fit stiffnesses and steering ratio, and return the squared error of the free run in each block ``(blocks,)``.

        It is the mean over the outputs, each over its variance in the recording; infinite where the free run leaves
        the range in which the equations hold.

        Args:
            recording: As ``load_recording`` returns it.

        Raises:
            UserError: If the model cannot run over the recording, or nothing that it measures is recorded.
        """
        step, samples = step_of(recording), recording.sizes["time"]
        spare = max(samples - int(_LONGEST / step), 0) // 2
        part = recording.isel(time=slice(spare, samples - spare))
        part = part.assign_coords(time=part["time"] - part["time"][0]).assign_attrs(name="the recording")
        table, _ = complete({"vehicle": self._vehicle, "parameters": self.parameters}, [part])
        spec = finely(table, step, f"--parameters {self.parameters}")
        names = spec.model().parameter_names
        free = (*fitted_parameters(spec, [], "free"), *(n for n in _GEARED if n in names))
        fitted = fit_recordings(FitTask(spec, [steered(part, spec.values)], free, settings=_SETTINGS), self._say)
        (judged,) = fitted.judged
        drive = judged.drive
        with np.errstate(invalid="ignore", divide="ignore"):
            error = (drive.measurements - judged.after.simulated) ** 2 / np.nanvar(drive.measurements, axis=0)
        if not judged.after.stays:
            return np.full(blocks(drive), np.inf)
        each = [p[np.isfinite(p)] for p in np.array_split(error, blocks(drive))]
        return np.array([p.mean() if p.size else np.nan for p in each])
