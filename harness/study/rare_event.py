"""Rare event of a population by subset simulation: the largest error on the worst drive exceeds a limit.

All vehicles have the noise of the first, so that the error is a function of the factors alone.
"""

from __future__ import annotations

import json
from dataclasses import asdict
from pathlib import Path

import joblib
import numpy as np

from harness.common.arrays import Floats
from harness.common.errors import UserError
from harness.common.files import write_files
from harness.config.specs import RareEventSpec
from harness.study import rare_file
from harness.study.design import LARGEST_UNIT, Unit, values_of
from harness.study.evaluate import StudyEvaluator
from harness.study.score_names import ESTIMATOR_DIVERGED, STATUS
from harness.study.subset_simulation import rare_event


def write(evaluator: StudyEvaluator, folder: Path, jobs: int) -> None:
    """Estimate the rare event of a study and write it next to its scores, where it is not there yet.

    Args:
        evaluator: Of the study.
        folder: The result folder.
        jobs: Threads.
    """
    study, spec = evaluator.study, evaluator.study.rare_event
    assert spec is not None
    asked = {"study_hash": study.hash, **asdict(spec)}
    if asked.items() <= rare_file.read(folder, study.hash).items():
        return
    design = study.design(spec.design)
    try:
        answer = asdict(
            rare_event(
                lambda normal: largest_errors(evaluator, spec, values_of(design, normal), jobs),
                len(design.factors),
                spec.limit,
                spec.samples,
                study.seed,
            )
        )
    except UserError as error:  # which the report says: the study itself is done
        answer = {"not_reached": str(error)}
    write_files(folder, {rare_file.FILE: json.dumps({**asked, **answer}, indent=1) + "\n"})


def largest_errors(evaluator: StudyEvaluator, spec: RareEventSpec, values: Floats, jobs: int) -> Floats:
    """Return the largest error of each vehicle on its worst drive, SI, infinite where the estimator diverged.

    Args:
        evaluator: Of the study.
        spec: What is asked for.
        values: Of the factors, ``(vehicle, factor)``.
        jobs: Threads.
    """
    study = evaluator.study
    index = study.designs.index(study.design(spec.design))
    target, estimator = study.targets.index(spec.target), [e.name for e in study.estimators].index(spec.estimator)
    there = evaluator.at(index, values[None])
    size = min(LARGEST_UNIT, -(-len(values) // jobs))
    units = [
        Unit(index, 0, drive, first, min(first + size, len(values)), 0, 1)
        for first in range(0, len(values), size)
        for drive in range(len(study.drives))
    ]

    def errors(unit: Unit) -> Floats:
        result = there.evaluate(unit)
        lost = result[STATUS][:, 0, estimator] == ESTIMATOR_DIVERGED
        return np.where(lost, np.inf, result["max_error"][:, 0, estimator, target])

    each = joblib.Parallel(n_jobs=jobs, backend="threading")(joblib.delayed(errors)(unit) for unit in units)
    return np.concatenate(
        [np.fmax.reduce(each[i : i + len(study.drives)]) for i in range(0, len(each), len(study.drives))]
    )
