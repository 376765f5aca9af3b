"""Try remedies one after the other, each as a study of its own in a folder of its own."""

from __future__ import annotations

import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import NamedTuple

import numpy as np
from rich.console import Console
from rich.text import Text

from harness.common.errors import ModelError, UserError
from harness.common.files import parse_toml
from harness.common.lock import locked
from harness.common.places import inside
from harness.common.stages import showing
from harness.config import StudySpec, build_study
from harness.config.self_contained import without_files
from harness.diagnosis.result.study_gain import REPEATS, bare_tables, change_times
from harness.engine.simd.lanes import LANES
from harness.estimation.contract import load_estimator
from harness.realtime.measure import contestants, measure
from harness.realtime.outcome import PACES
from harness.remedy import choices
from harness.remedy.choices import AS_IT_IS, Equipment, Remedy, adapted
from harness.remedy.judge import Promise, RemedyOutcome, best, harm, judged, promises
from harness.study.design import Unit
from harness.study.evaluate import StudyEvaluator
from harness.study.report.ranking import Ranking
from harness.study.results import Design, read
from harness.study.run import Agree, run_study
from harness.study.run_noise import Case
from harness.study.worst_case import POINTS, tune_for_worst_case, write_worst_case

CANDIDATES = 64
"""Candidates of noise when an estimator is tuned for the worst case."""

DRIVES_THE_ERROR = 0.1
"""Total Sobol index from which on a factor drives the error."""

_TIMED = 1000
"""Samples of a run over which steps are timed in lanes."""

_IN_CYCLE = 300
"""Steps that are timed one in a cycle."""


@dataclass(frozen=True)
class Tried:
    """Everything that a report is made of.

    Attributes:
        study: The study, as it is.
        estimator: Name of the estimator.
        drivers: The parameters that drive the error, the strongest first.
        outcomes: Of every remedy, the study as it is first.
        best: The one to take.
        ideal: As with it, but the drivers are known; ``None`` where that cannot be had.
        cycle: Median time of a step in a cycle of its own, one run, in s, as it is and with the remedy to take; NaN
            where the system has no clock for it.
        slower: How many times longer a step in lanes takes with the remedy to take than as it is, and than with its
            sensors alone, measured in turn; the second is NaN where it measures nothing more.
        traced: Whether the drivers are effects that a trace named, which the plant has and the belief lacks.
        promise: What could be known at best, by equipment; ``None`` stands for the study's own.
        measuring: Equipments that measure a target itself, which are not tried.
        impossible: Remedies that could not be built, with the reason.
    """

    study: StudySpec
    estimator: str
    drivers: tuple[str, ...]
    outcomes: list[RemedyOutcome]
    best: RemedyOutcome
    ideal: RemedyOutcome | None
    cycle: tuple[float, float]
    slower: tuple[float, float]
    promise: dict[Equipment | None, Promise]
    measuring: list[Equipment]
    impossible: dict[str, str] = field(default_factory=dict)
    traced: bool = False


def try_remedies(
    study: StudySpec,
    out: Path,
    estimator: str | None = None,
    most: int = 2,
    jobs: int | None = None,
    agree: Agree | None = None,
    restart: bool = False,
    console: Console | None = None,
) -> Tried:
    """Try remedies on the points, drives and noise of a study; what is finished is kept.

    Args:
        study: The study; where its plant has effects that the belief lacks, remedies against these.
        out: Folder; each remedy gets one in it.
        estimator: Name of the estimator; the first EKF by default, else the first estimator.
        most: Largest number of equipments tried, those that promise most.
        jobs: Worker threads; by default one per core.
        agree: Asked before a remedy takes above an hour or 10 GB.
        restart: Throw away what is in the folders.
        console: Where progress is shown; by default stderr.

    Raises:
        UserError: If the study has no parameter that drives the error, or no such estimator.
    """
    console = console or Console(stderr=True)
    name, is_traced = _estimator(study, estimator), not choices.parameters(study) and bool(named(study))
    if not is_traced:
        choices.main_design(study)
    tunable = load_estimator(_kind(study, name)).HAS_COVARIANCE
    with locked(out, f"harness remedy of the study '{study.name}'"):
        attempt = partial(_attempt, study, name, out, jobs, agree, restart, console)
        console.print(Text(AS_IT_IS.words, style="bold"))
        first = attempt(AS_IT_IS)
        plan = _against_effects(study, name, most) if is_traced else _plan(study, name, out, most, console)
        outcomes = [first, *_all(attempt, plan.further, console, plan.impossible)]
        outcomes += _more_estimated(attempt, outcomes, plan, console)
        leading = best(outcomes, first).remedy
        tuned = replace(leading, tuned=True)
        if tunable and not leading.banked and tuned not in plan.further:
            outcomes += _all(attempt, [tuned], console, plan.impossible)
        chosen = best(outcomes, first)
        ideal = Remedy(amended=True) if is_traced else Remedy(ideal_parameters=plan.drivers)
        attempted = _all(attempt, [replace(ideal, equipment=chosen.remedy.equipment)], console, {})
        with showing(console, "timing single steps"):
            cycle = step_in_cycle(first.study), step_in_cycle(chosen.study)
            alone = Remedy(equipment=chosen.remedy.equipment)
            plain = next((o.study for o in outcomes if o.remedy == alone and alone != AS_IT_IS), None)
            steps = steps_in_turn([chosen.study, first.study, *([plain] if plain else [])])
    return Tried(
        study=study,
        estimator=name,
        drivers=plan.drivers,
        outcomes=outcomes,
        best=chosen,
        ideal=attempted[0] if attempted else None,
        cycle=cycle,
        slower=(steps[0] / steps[1], steps[0] / steps[2] if plain else float("nan")),
        promise=plan.promise,
        measuring=_of_use(study)[1],
        impossible=plan.impossible,
        traced=is_traced,
    )


class _Plan(NamedTuple):
    """What drives the error, what is to be tried, and what is known beforehand."""

    drivers: tuple[str, ...]
    further: list[Remedy]
    promise: dict[Equipment | None, Promise]
    impossible: dict[str, str]
    banks: bool = False  # whether a bank may stand in the place of the estimator


def _plan(study: StudySpec, estimator: str, out: Path, most: int, console: Console) -> _Plan:
    """Return what is to be tried against parameters, by the results of the study as it is."""
    drivers = _drivers(read(out / AS_IT_IS.slug).designs[0], [f.parameter for f in choices.parameters(study)])
    if not drivers:
        raise UserError(
            f"{out / AS_IT_IS.slug}: no parameter of design '{study.designs[0].name}' drives the error of "
            f"'{estimator}': there is nothing to remedy"
        )
    equipments, _ = _of_use(study)
    with showing(console, "what could be known of the parameters at best"):
        promise, impossible = promises(study, estimator, drivers, equipments)
    chosen = choices.promising({e: promise[e].share for e in equipments if e in promise}, most)
    file = load_estimator(_kind(study, estimator))
    alone = choices.singles(drivers, file.KALMAN_TYPE, file.HAS_COVARIANCE)
    further = [*alone, *choices.pairs(drivers, chosen, file.KALMAN_TYPE)]
    return _Plan(tuple(drivers), further, promise, impossible, file.KALMAN_TYPE)


def _against_effects(study: StudySpec, estimator: str, most: int) -> _Plan:
    """Return what is to be tried against effects that the belief lacks; the equipments are those of fewest signals."""
    chosen = sorted(_of_use(study)[0], key=lambda e: len(e.added))[:most]
    file = load_estimator(_kind(study, estimator))
    further = list(remedies(chosen, file.KALMAN_TYPE, file.HAS_COVARIANCE))
    return _Plan(tuple(named(study)), further, {}, {})


def _more_estimated(
    attempt: partial[RemedyOutcome], outcomes: Sequence[RemedyOutcome], plan: _Plan, console: Console
) -> list[RemedyOutcome]:
    """Estimate one more driver at a time, or bank over it, with those with which it gains most, as long as it gains.

    All together may be worse than some: what a drive does not tell apart is put down to the wrong one.
    """
    first, gained = outcomes[0], []
    for equipment in dict.fromkeys(o.remedy.equipment for o in outcomes):
        taken = next((o for o in outcomes if o.remedy == Remedy(equipment=equipment)), first)
        tried = [o for o in outcomes if o.remedy == Remedy(estimated=o.remedy.estimated[:1], equipment=equipment)]
        while tried and harm(better := min(tried, key=lambda o: harm(o, first)), first) < harm(taken, first):
            taken = better
            tried = _all(attempt, choices.enlarged(taken.remedy, plan.drivers, plan.banks), console, plan.impossible)
            gained += tried
    return gained


def _kind(study: StudySpec, estimator: str) -> str:
    return next(e.kind for e in study.estimators if e.name == estimator)


def _all(
    attempt: partial[RemedyOutcome], further: Sequence[Remedy], console: Console, lost: dict[str, str]
) -> list[RemedyOutcome]:
    """Try remedies, and note those that are not possible."""
    outcomes = []
    for number, remedy in enumerate(further, 1):
        console.print(Text(f"{remedy.words} ({number} of {len(further)} more)", style="bold"), soft_wrap=True)
        try:
            outcomes.append(attempt(remedy))
        except (UserError, ModelError) as error:
            if "run.lock" in str(error) or "--restart" in str(error):
                raise
            lost[remedy.words] = str(error)
            console.print(Text(f"not possible: {error}", style="yellow"), soft_wrap=True)
    return outcomes


def _estimator(study: StudySpec, asked: str | None) -> str:
    names = [e.name for e in study.estimators]
    if asked is None:
        return next((e.name for e in study.estimators if e.kind == "ekf"), names[0])
    if asked not in names:
        raise UserError(
            f"--estimator {asked}: study '{study.name}' has no such estimator; there are {', '.join(names)}"
        )
    return asked


def _attempt(
    study: StudySpec,
    estimator: str,
    out: Path,
    jobs: int | None,
    agree: Agree | None,
    restart: bool,
    console: Console,
    remedy: Remedy,
) -> RemedyOutcome:
    """Run one remedy, or go on with it, and return what came of it."""
    folder = inside(out, remedy.slug)
    tuning = _tuned(study, estimator, out, jobs, restart, console, remedy) if remedy.tuned else None
    changed = choices.applied(study, remedy, estimator, tuning)
    run_study(without_files(changed), folder, jobs, console, agree=agree, restart=restart)
    return judged(remedy, changed, read(folder), time_of_step(changed))


def _tuned(
    study: StudySpec, estimator: str, out: Path, jobs: int | None, restart: bool, console: Console, remedy: Remedy
) -> Path:
    """Return the file of the noise for the worst case, found on points and noise that the study does not score."""
    path = out / f"{remedy.slug}.toml"
    if restart or not path.is_file():
        bare = choices.applied(study, replace(remedy, tuned=False), estimator)
        with showing(console, "tuning for the worst case"):
            tuned = tune_for_worst_case(bare, bare.designs[0], CANDIDATES, weights=(1.0,), jobs=jobs)
        write_worst_case(path, bare, bare.designs[0], CANDIDATES, POINTS, tuned, "harness remedy")
    return path


def time_of_step(study: StudySpec, rounds: int = 10) -> float:
    """Return how long a step of a run takes in lanes of eight, the quickest of a few batches, in s of the processor."""
    evaluator = StudyEvaluator(study)
    unit, cases = Unit(0, 0, 0, 0, 1), [Case(0, 0)] * LANES
    samples = min(_TIMED, len(evaluator.compiled.drives[0].profile.time))
    batch, believed = evaluator.simulate(unit, cases, samples), evaluator.held(unit, cases, "belief")
    times = []
    for _ in range(rounds):
        begin = time.thread_time()
        evaluator.estimate(0, unit, cases, batch, believed)
        times.append(time.thread_time() - begin)
    return min(times) / samples / LANES


def steps_in_turn(studies: Sequence[StudySpec]) -> list[float]:
    """Return the time of a step of each study, the least of several taken in turn, so that a busy machine slows all."""
    return [float(t) for t in np.min([[time_of_step(s, 3) for s in studies] for _ in range(4)], axis=0)]


def step_in_cycle(study: StudySpec) -> float:
    """Return the median time of a single run's step, one in every cycle, in s; NaN where it cannot be timed."""
    drive, cycle = study.drives[0].name, study.belief.step
    try:
        times = measure(contestants(study, drive, _IN_CYCLE * cycle), _IN_CYCLE + 1, cycle)
    except UserError:
        return float("nan")
    return float(np.median(times["step_time"].sel(pace=PACES[1])))


def _drivers(design: Design, names: Sequence[str]) -> list[str]:
    """Return the parameters that drive the error: by Sobol indices where there are any, else all that vary."""
    factors = [f.name for f in design.factors]
    if design.sampling != "saltelli":
        return list(names)
    ranking, strength = Ranking(design, 0), dict.fromkeys(names, 0.0)
    for per_estimator in ranking.errors:
        for indices in (f for f in per_estimator if f is not None):
            for name in names:
                strength[name] = max(strength[name], indices.total[factors.index(name)].value)
    some = [n for n in names if strength[n] >= DRIVES_THE_ERROR]
    return sorted(some, key=lambda n: -strength[n])


def _of_use(study: StudySpec) -> tuple[list[Equipment], list[Equipment]]:
    """Return larger equipments, and apart from them those that measure a target, which ask for no estimator."""
    equipments = choices.equipments(study)
    measuring = [e for e in equipments if set(e.added) & set(study.targets)]
    return [e for e in equipments if e not in measuring], measuring


def traced_study(study: StudySpec, folder: Path) -> StudySpec:
    """Return the drives, targets, sensors and estimators of a study with the plant that a trace amended.

    The belief is the nominal model; each has the noise that was fitted with it. Nothing else is varied. Changes, which
    have a time in each recording, are spread over the shortest drive.

    Args:
        study: Of the traced vehicle.
        folder: That ``harness trace`` wrote, with ``nominal.toml`` and ``amended.toml``.

    Raises:
        UserError: If the trace named nothing, or the study is of another vehicle.
    """
    files = {"plant": folder / "amended.toml", "belief": folder / "nominal.toml"}
    for path in files.values():
        if not path.is_file():
            raise UserError(f"--trace {folder}: there is no {path.name}: the trace named no effect, or it is no trace")
    table = bare_tables(parse_toml(study.text, str(study.path)), [e.kind for e in study.estimators], REPEATS)
    for side, path in files.items():
        table[side]["parameters"] = str(path.resolve())
    table["name"] += f"-{folder.name}"
    table["design"] = [{"name": "traced", "repeats": REPEATS}]
    changed = build_study(table, study.path)
    if times := change_times(changed.plant, changed):
        table["plant"]["values"] = times
        changed = build_study(table, study.path)
    if not named(changed):
        raise UserError(f"--trace {folder}: its amended model has no effect that the nominal one lacks")
    return changed


def named(study: StudySpec) -> list[str]:
    """Return the effects that only the plant has."""
    return [e for e in study.plant.effects if e not in study.belief.effects]


def remedies(chosen: Sequence[Equipment], considers: bool, tunable: bool) -> Iterator[Remedy]:
    """Return what needs no model of the effect: other noise, other filters, and measuring more with each of these.

    Args:
        chosen: Equipments to try.
        considers: Whether the estimator is of the Kalman type, in whose place others may stand.
        tunable: Whether the estimator believes noise.
    """
    for equipment in (None, *chosen):
        if equipment is not None:
            yield Remedy(equipment=equipment)
        elif tunable:
            yield Remedy(tuned=True)
        if considers:
            for kind in adapted():
                yield Remedy(adapted=kind, equipment=equipment)
