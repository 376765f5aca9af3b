"""Gain of an amendment in a study: the amended plant, with estimators that believe the nominal or amended model.

Both runs of the study have the same plant, points, drives and noise, so they are compared run by run. Each belief has
the noise variances that were fitted with it: those of a model that lacks something are larger, as after tuning.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from rich.console import Console

from harness.common import statistics
from harness.common.arrays import Floats
from harness.common.errors import UserError
from harness.common.files import read_toml
from harness.common.places import inside, remove
from harness.config import ModelSpec, StudySpec, build_study, load_study
from harness.config.schema import as_table
from harness.config.self_contained import without_files
from harness.simulation.drives import profile_of
from harness.study.results import Design, read
from harness.study.run import run_study
from harness.study.score_names import OK
from harness.study.store import STORE

REPEATS = 8
"""Runs of each level and drive with other noise, unless stated: as many as run side by side (``LANES``)."""

_PLANT = ("vehicle", "sensors", "integrator", "substeps", "step")
_BELIEF = ("unknown_inputs", "sensors", "integrator", "substeps")
"""What of the study's models is kept; values, tyre, effects and noise are those that were fitted."""


@dataclass(frozen=True)
class Gain:
    """Errors of one estimator in one target, believing the nominal and the amended model.

    Attributes:
        estimator: Its name.
        target: Number of the target.
        band: Number of the level; ``None`` for all together.
        before: Median error with the nominal belief over the runs that both finished, in the target's report unit.
        after: The same with the amended belief.
        ratio: After over before.
        lost: Runs that the estimator or the plant did not finish, with the nominal and the amended belief.
    """

    estimator: str
    target: int
    band: int | None
    before: float
    after: float
    ratio: statistics.Interval
    lost: tuple[int, int]


@dataclass(frozen=True)
class StudyGain:
    """A study with the amended plant against both beliefs.

    Attributes:
        study: Its file.
        title: Its question.
        nominal: Scores with the nominal belief.
        amended: Scores with the amended belief.
        seed: Of the study.
        change_times: When changes begin in every drive, s, by parameter.
    """

    study: Path
    title: str
    nominal: Design
    amended: Design
    seed: int
    change_times: dict[str, float]

    def gain(self, estimator: int, target: int, band: int | None = None) -> Gain:
        """Return what believing the amended model gains, at one level or over all of them."""
        levels = slice(None) if band is None else slice(band, band + 1)
        designs = (self.nominal, self.amended)
        runs = [_by_run(d.rmse[target, levels, estimator]) for d in designs]
        both = np.isfinite(runs).all(axis=0)
        before, after = (float(np.median(r[both])) if both.any() else np.nan for r in runs)
        ratio = statistics.median_ratio(runs[0], runs[1], self.nominal.strata.ravel(), seed=self.seed)
        lost = [int(np.sum(d.status[levels, estimator] != OK)) for d in designs]
        return Gain(self.nominal.estimators[estimator], target, band, before, after, ratio, (lost[0], lost[1]))


def _by_run(values: Floats) -> Floats:
    """Return ``(band, drive, sample, repeat)`` as ``(run, band)``: levels share the noise of a run."""
    return values.reshape(len(values), -1).T


def refuse_study(path: Path, spec: ModelSpec) -> None:
    """Refuse a study that cannot be run with a traced model, before the tracing.

    Raises:
        UserError: If the study or one of its drives is wrong, or of another vehicle or tyre.
    """
    study = load_study(path)
    plant = study.plant
    for what, own, traced in (("vehicle", plant.vehicle, spec.vehicle), ("tyre", plant.tyre, spec.tyre)):
        if own != traced:
            raise UserError(
                f"{path}: plant.{what} is '{own}', that of the traced model '{traced}'; name a study of the same {what}"
            )
    for drive in study.drives:
        profile_of(plant, drive)


def study_gain(
    path: Path,
    folder: Path,
    models: Mapping[str, ModelSpec],
    estimators: Sequence[str],
    repeats: int = REPEATS,
    jobs: int | None = None,
    say: Callable[[str], None] = lambda _: None,
) -> StudyGain:
    """Run the first design of a study with the amended plant and both beliefs.

    Args:
        path: The study.
        folder: Holds ``nominal.toml`` and ``amended.toml``; scores go to ``worth/nominal`` and ``worth/amended`` in it.
        models: What these files hold: ``nominal`` and ``amended``.
        estimators: Files in ``harness/estimation/methods``; settings are those of the study where it has them.
        repeats: Runs of each level and drive with other noise.
        jobs: Threads; all cores by default.
        say: Receives what is being run, in words.

    Raises:
        UserError, ModelError: If the study cannot be run with these models.
    """
    content = read_toml(path)
    times = change_times(models["amended"], load_study(path))

    def with_belief(name: str) -> StudySpec:
        table = bare_tables(content, estimators, repeats)
        table["name"] += f"-{name}"
        for side, model in (("plant", "amended"), ("belief", name)):
            table[side]["parameters"] = str((folder / f"{model}.toml").resolve())
            table[side]["values"] = {n: v for n, v in times.items() if n in models[model].values}
        return build_study(table, path)

    study = with_belief("amended")
    studies = {"nominal": replace(with_belief("nominal"), designs=study.designs), "amended": study}
    by_belief: dict[str, Design] = {}
    for name, each in studies.items():
        say(f"{study.name}: believing the {name} model")
        out = inside(folder, f"worth/{name}")
        remove(out / STORE)  # of an earlier trace into the same folder
        run_study(without_files(each), out, jobs, Console(quiet=True))
        by_belief[name] = read(out).designs[0]
    return StudyGain(path, study.title or study.name, by_belief["nominal"], by_belief["amended"], study.seed, times)


def change_times(amended: ModelSpec, study: StudySpec) -> dict[str, float]:
    """Return when changes begin: each drive has its own, so here they are spread evenly over the shortest one."""
    names = [p.name for p in amended.model().parameters if p.per_drive]
    shortest = min(profile_of(study.plant, d).time[-1] for d in study.drives)
    return {n: round(float(shortest) * (k + 1) / (len(names) + 1), 1) for k, n in enumerate(names)}


def bare_tables(content: dict[str, Any], estimators: Sequence[str], repeats: int) -> dict[str, Any]:
    """Return what is kept of a study file: drives, targets, sensors, its first design, and no values of its own."""
    sides = {"plant": _PLANT, "belief": _BELIEF}
    kept = ("name", "title", "seed", "targets", "drives", "drive")
    there = _different([e for e in map(as_table, content["estimator"]) if e["kind"] in estimators])
    more = [{"name": k.upper(), "kind": k} for k in estimators if k not in [e["kind"] for e in there]]
    return {
        **{k: content[k] for k in kept if k in content},
        **{side: {k: v for k, v in content.get(side, {}).items() if k in keys} for side, keys in sides.items()},
        "estimator": [*there, *more],
        "design": [{**content["design"][0], "repeats": repeats}],
    }


def _different(estimators: list[dict[str, Any]]) -> list[dict[str, Any]]:
    """Return estimators without those that differ from an earlier one in the name alone, as they do by their tuning."""
    settings = [{k: v for k, v in e.items() if k != "name"} for e in estimators]
    return [e for i, e in enumerate(estimators) if settings[i] not in settings[:i]]
