"""Parameters of a plant of somebody else from recordings, by the simulation error alone.

The plant runs free over the recorded inputs, from the state in which it starts, and its outputs are compared with what
was measured behind the first second. ``least-squares`` is Gauss and Newton's method with bounds (Branch, Coleman and Li
1999, in SciPy); ``swarm`` is that of ``harness.identification.methods.swarm``, with the same cost (Ziaukas 2023, 4.26).
Standard errors are those of coloured residuals: the sum over blocks of the outer products of the gradients stands
between two inverses of the information (White 1980, by blocks of time).
"""

from __future__ import annotations

import json
import math
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import joblib
import numpy as np
import xarray as xr

from harness.common.arrays import Floats
from harness.common.errors import UserError
from harness.common.files import toml_text, write_files
from harness.common.registry import closest
from harness.common.units import to_si
from harness.config import ModelSpec
from harness.identification import report
from harness.identification.contract import Estimate, Fit, Verdict, settings_of
from harness.identification.data import DriveData, drive_from, refuse_the_same
from harness.identification.measured_file import names_of, refuse_repeated
from harness.identification.methods import swarm
from harness.identification.result import FILE, DriveJudgement, Judged, answer, failure, record, rms, series_of
from harness.identification.simulation_error import Free
from harness.identification.whiteness import Whiteness
from harness.models.quantities import listed, words
from harness.recordings.check.examine import recording_warnings
from harness.reporting.document import Prose, Report, Section, plain
from harness.simulation.external_plant import ExternalPlant

METHODS = ("least-squares", "swarm")

SETTLING = 1.0
"""Seconds at the beginning of each recording that do not count: nothing says in which state a plant must start."""

BLOCK = 2.0
"""Seconds over which residuals may be correlated."""

_STEP = 1e-4
"""Of differences, as a share of a value or of its range."""

_NO_WHITENESS = Whiteness(*(math.nan,) * 4, np.empty(0), np.empty(0), math.nan)
"""Of a plant without a filter."""


@dataclass(frozen=True)
class PlantTask:
    """What is to be fitted.

    Attributes:
        spec: The plant; its sensors are what the recordings have of its outputs.
        train: Recordings to fit.
        free: Parameters to find.
        bounds: Ends of their search, SI or text with a unit; those of the plant where none are stated.
        test: Held-out recordings.
        method: One of ``METHODS``.
        settings: Of the swarm.
        seed: Of the swarm.
        jobs: Processes; all cores by default.
    """

    spec: ModelSpec
    train: Sequence[xr.Dataset]
    free: tuple[str, ...]
    bounds: Mapping[str, tuple[Any, Any]] = field(default_factory=dict)
    test: Sequence[xr.Dataset] = ()
    method: str = "least-squares"
    settings: Mapping[str, Any] = field(default_factory=dict)
    seed: int = 0
    jobs: int | None = None


class PlantRuns:
    """A plant that runs free over recordings.

    Args:
        spec: The plant.
        drives: The recordings.
        jobs: Processes.
    """

    def __init__(self, spec: ModelSpec, drives: Sequence[DriveData], jobs: int) -> None:
        self.spec, self.drives, self._jobs = spec, tuple(drives), jobs
        self._plant, self._names = ExternalPlant(spec), spec.model().parameter_names

    def outputs(self, candidates: Sequence[Mapping[str, float]]) -> list[list[Floats]]:
        """Return the outputs of each candidate on each recording ``(samples, ny)``, NaN where the plant was lost."""
        tasks = [(drive, {**self.spec.values, **c}) for c in candidates for drive in self.drives]

        def run(task: tuple[DriveData, Mapping[str, float]]) -> Floats:
            drive, values = task
            return self._plant.outputs(drive.inputs, np.array([values[n] for n in self._names]))

        with ThreadPoolExecutor(self._jobs) as pool:
            rows = list(pool.map(run, tasks))
        size = len(self.drives)
        return [rows[i : i + size] for i in range(0, len(rows), size)]

    def lost(self) -> list[str]:
        """Return why runs were lost, in words."""
        return self._plant.losses.taken()

    def close(self) -> None:
        """End the processes."""
        self._plant.close()


@dataclass(frozen=True)
class FittedPlant:
    """A plant fitted to recordings.

    Attributes:
        fit: What was found.
        drives: The recordings that were fitted.
        free: Names of the parameters.
        judged: Every recording before and after the fit, the fitted ones first.
        tests: The held-out recordings.
        notes: Irregularities of the recordings, with the evidence.
    """

    fit: Fit
    drives: tuple[DriveData, ...]
    free: tuple[str, ...]
    judged: list[Judged]
    tests: tuple[DriveData, ...]
    notes: tuple[str, ...] = ()

    @cached_property
    def answer(self) -> str:
        """The result in sentences."""
        return answer(self.fit, self.judged)

    def write(self, folder: Path, command: str) -> list[Path]:
        """Write ``plant.toml``, ``identify.json``, the recordings over time and the report; return their paths.

        Raises:
            UserError: If the folder cannot be written to.
        """
        external = self.fit.spec.external
        assert external is not None
        values = {e.name: e.value for e in self.fit.estimates}
        table = {"plant": {external.description.kind: external.description.file, "values": values}}
        remark = f"# {failed}\n" if (failed := failure(self.judged)) else ""
        contents: dict[str, str | bytes] = {
            "plant.toml": f"# For a study: what harness identify found.\n{remark}{toml_text(table)}",
            "identify.json": json.dumps(record(self.fit, self.judged), indent=2) + "\n",
            FILE: series_of(self.judged, self.fit.spec.model()),
        }
        return [*write_files(folder, contents), *self._report(command).write(folder)]

    def _report(self, command: str) -> Report:
        fit, judged = self.fit, self.judged
        begins = (
            "Free run: the plant is simulated over the recorded inputs from the state in which it starts; the first "
            f"{SETTLING:g} s do not count."
        )
        sections = [
            Section(lambda: report.answered(fit, judged, self.notes), "What was found?"),
            *report.gains(fit, judged),
            Section(lambda: report.parameters(fit), "Which values?"),
            Section(
                lambda: [Prose(plain(begins)), *report.drawn(fit, judged)], "Does the simulation follow the drives?"
            ),
            Section(lambda: report.certainty(fit), "Which estimates are correlated?"),
            Section(lambda: report.made(fit, command), "How was it made?"),
        ]
        return Report(f"What do the recordings say about {fit.spec.model().name}?", sections)


class FreeRunResiduals:
    """Residuals of candidates: simulated less measured, over the spread of the output over all recordings.

    Args:
        runs: The plant on the recordings.
        free: What is searched.
    """

    def __init__(self, runs: PlantRuns, free: Sequence[Free]) -> None:
        self._runs, self.free = runs, tuple(free)
        drives = runs.drives
        self._counted = [(d.time[:, None] >= SETTLING) & np.isfinite(d.measurements) for d in drives]
        measured = np.concatenate(
            [np.where(c, d.measurements, np.nan) for d, c in zip(drives, self._counted, strict=True)]
        )
        self._scale = np.sqrt(np.nansum((measured - np.nanmean(measured, axis=0)) ** 2, axis=0))
        for name, size in zip(runs.spec.model().outputs, self._scale, strict=True):
            if not size > 0.0:
                raise UserError(f"'{name}' does not vary in the recordings; choose sensors without it")
        self.block = np.concatenate(
            [
                np.repeat((1e6 * i + d.time // BLOCK)[:, None], d.measurements.shape[1], axis=1)[c]
                for i, (d, c) in enumerate(zip(drives, self._counted, strict=True))
            ]
        )

    def residuals(self, candidates: Floats) -> Floats:
        """Return the residuals ``(candidates, n)`` of candidates ``(candidates, free)``; NaN where a run was lost."""
        named = [dict(zip((f.parameter for f in self.free), map(float, row), strict=True)) for row in candidates]
        rows = []
        for outputs in self._runs.outputs(named):
            of_drives = zip(outputs, self._runs.drives, self._counted, strict=True)
            rows.append(np.concatenate([((y - d.measurements) / self._scale)[c] for y, d, c in of_drives]))
        return np.array(rows)

    def __call__(self, candidates: Floats) -> Floats:
        """Return the sum of squares of each candidate, infinite where a run was lost ``(candidates,)``."""
        total = np.sum(self.residuals(candidates) ** 2, axis=1)
        return np.where(np.isfinite(total), total, np.inf)

    def slopes(self, values: Floats) -> Floats:
        """Return the derivatives of the residuals ``(n, free)`` by differences on the side that has room."""
        upper = np.array([f.upper for f in self.free])
        step = _STEP * np.maximum(np.abs(values), _typical(self.free))
        step = np.where(values + step > upper, -step, step)
        candidates = np.concatenate([values[None], values + np.diag(step)])
        rows = self.residuals(candidates)
        return (rows[1:] - rows[0]).T / step


def _typical(free: Sequence[Free]) -> Floats:
    widths = np.array([f.upper - f.lower for f in free])
    return np.where(np.isfinite(widths), 0.1 * widths, 1e-6)


def fit_plant(task: PlantTask, say: Callable[[str], None] = lambda _: None) -> FittedPlant:
    """Fit parameters of a plant to recordings.

    Raises:
        UserError: If a parameter, method, setting or signal is unknown or missing, or the plant fails at its start.
    """
    if task.method not in METHODS:
        raise UserError(f"method: a plant of somebody else is fitted by {' or '.join(METHODS)}, not by '{task.method}'")
    refuse_the_same(task.train, task.test)
    recordings = [*task.train, *task.test]
    names, model = names_of(recordings), task.spec.model()
    drives = [drive_from(r, model, name) for r, name in zip(recordings, names, strict=True)]
    train, test = tuple(drives[: len(task.train)]), tuple(drives[len(task.train) :])
    chosen = settings_of(swarm, task.settings) if task.method == "swarm" else None
    if chosen is None and task.settings:
        raise UserError(f"settings: least-squares has none, not '{next(iter(task.settings))}'")
    free = _free(task)
    runs = PlantRuns(task.spec, drives, task.jobs or joblib.cpu_count())
    try:
        misfit = FreeRunResiduals(PlantRuns(task.spec, train, task.jobs or joblib.cpu_count()), free)
        say(f"{task.method} over {len(train)} recordings")
        fit = _searched(task, misfit, free, chosen)
        before, after = runs.outputs([task.spec.values, fit.spec.values])
    finally:
        runs.close()
    judgements = [
        Judged(i >= len(train), _judged(d, b), _judged(d, a))
        for i, (d, b, a) in enumerate(zip(drives, before, after, strict=True))
    ]
    return FittedPlant(fit, train, task.free, judgements, test, recording_warnings(recordings))


def _free(task: PlantTask) -> list[Free]:
    declared = {p.name: p for p in task.spec.model().parameters}
    if not task.free:
        raise UserError(f"free: name the parameters to estimate; the plant has: {', '.join(declared)}")
    refuse_repeated(task.free, "free")
    free = []
    for name in task.free:
        if name not in declared:
            raise UserError(f"free: the plant has no parameter '{name}'{closest(name, list(declared))}")
        unit, ends = declared[name].unit, (declared[name].lower, declared[name].upper)
        if name in task.bounds:
            lower, upper = (to_si(end, unit, f"free: {name}") for end in task.bounds[name])
            ends = max(lower, ends[0]), min(upper, ends[1])
        if not ends[0] < ends[1]:
            raise UserError(f"free: {name}: there is nothing between {ends[0]:g} and {ends[1]:g} {unit}")
        if task.method == "swarm" and not np.isfinite(ends).all():
            raise UserError(f"free: a swarm needs a range of {name}; state it as '{name}=LOWER:UPPER'")
        free.append(Free(name, *ends))
    return free


def _searched(task: PlantTask, misfit: FreeRunResiduals, free: Sequence[Free], settings: swarm.Settings | None) -> Fit:
    from scipy.optimize import least_squares

    lower, upper = (np.array([getattr(f, end) for f in free]) for end in ("lower", "upper"))
    start = np.clip([task.spec.values[f.parameter] for f in free], lower, upper)
    before = float(misfit(start[None])[0])
    if not math.isfinite(before):
        reasons = misfit._runs.lost()
        raise UserError(f"the plant fails at its start: {reasons[0] if reasons else 'its outputs are no numbers'}")
    if settings is None:
        solution = least_squares(
            lambda x: np.nan_to_num(misfit.residuals(x[None])[0], nan=1e3),
            start, lambda x: np.nan_to_num(misfit.slopes(x)), (lower, upper), x_scale=_scale(start, free), max_nfev=50,
        )  # fmt: skip
        values, converged, further = solution.x, bool(solution.success), {}
        history: tuple[float, ...] = (before, 2.0 * float(solution.cost))
    else:
        searched = swarm.optimise(misfit, lower, upper, task.seed, settings)
        if not math.isfinite(searched.cost):
            raise UserError(f"all {searched.evaluated} candidates were lost; narrow their ranges")
        values, history, converged = searched.values, tuple(map(float, searched.history)), True
        further = {"evaluated": searched.evaluated, "diverged": searched.diverged}
    certainty = _Certainty(misfit, values)
    units = {p.name: p.unit for p in task.spec.model().parameters}
    estimates = tuple(
        certainty.estimate(i, free, units[f.parameter], float(start[i]), float(values[i])) for i, f in enumerate(free)
    )
    named = {f.parameter: float(v) for f, v in zip(free, values, strict=True)}
    return Fit(
        method=task.method,
        spec=replace(task.spec, values={**task.spec.values, **named}),
        estimates=estimates,
        correlation=certainty.correlation,
        objective="sum of squared errors of the free run over the variance of each output",
        before=before,
        after=float(misfit(values[None])[0]),
        history=history,
        converged=converged,
        notes=tuple(misfit._runs.lost()),
        further=further,
    )


def _scale(start: Floats, free: Sequence[Free]) -> Floats:
    return np.maximum(np.abs(start), _typical(free))


class _Certainty:
    """How well residuals that are correlated within blocks determine values.

    Attributes:
        errors: Standard errors ``(free,)``; infinite where the residuals do not depend on a value.
        alone: The same if all other values were known ``(free,)``.
        correlation: ``(free, free)``; empty where there is none.
    """

    def __init__(self, misfit: FreeRunResiduals, values: Floats) -> None:
        residual, slopes = misfit.residuals(values[None])[0], misfit.slopes(values)
        size = np.sqrt(np.sum(slopes**2, axis=0))
        self.correlation = np.empty((0, 0))
        self.errors = self.alone = np.where(size > 0.0, math.nan, math.inf)
        if not (np.isfinite(size).all() and (size > 0.0).all()):
            return
        scaled = slopes / size
        inverse = np.linalg.pinv(scaled.T @ scaled, rcond=1e-12)
        _, block = np.unique(misfit.block, return_inverse=True)
        gradients = np.zeros((block.max() + 1, len(size)))
        np.add.at(gradients, block, scaled * residual[:, None])
        spread = gradients.T @ gradients
        covariance = inverse @ spread @ inverse
        deviations = np.sqrt(np.diag(covariance))
        self.errors, self.alone = deviations / size, np.sqrt(np.diag(spread)) / size
        self.correlation = np.clip(covariance / np.maximum(np.outer(deviations, deviations), 1e-300), -1.0, 1.0)

    def estimate(self, i: int, free: Sequence[Free], unit: str, start: float, value: float) -> Estimate:
        """Return a parameter with what the recordings say of it."""
        own, error = free[i], float(self.errors[i])
        end = own.end_at(value) if math.isfinite(own.upper - own.lower) else ""
        ends = (value - 1.96 * error, value + 1.96 * error) if math.isfinite(error) else (math.nan, math.nan)
        verdict: Verdict = "determined" if error < 0.1 * abs(value) else "weakly determined"
        reason = ""
        if end:
            verdict, reason = "at its bound", f"the search ended at its {end} bound, {getattr(own, end):g} {unit}"
        elif not error < 0.5 * abs(value):
            verdict, reason = "not determined", "its standard error is above half its value"
            if self.alone[i] < 0.1 * abs(value):
                others = [j for j in range(len(free)) if j != i and abs(self.correlation[i, j]) > 0.95]
                names = listed([words(free[j].parameter) for j in others])
                verdict, reason = "confounded", f"the recordings determine it only together with {names or 'others'}"
        return Estimate(own.parameter, unit, start, value, error, *ends, verdict, reason)


def _judged(drive: DriveData, simulated: Floats) -> DriveJudgement:
    simulated = np.where(drive.time[:, None] >= SETTLING, simulated, np.nan)
    nothing = np.full(simulated.shape[1], math.nan)
    return DriveJudgement(
        drive, simulated, rms(drive.measurements - simulated), nothing, math.nan, (_NO_WHITENESS,) * len(nothing)
    )
