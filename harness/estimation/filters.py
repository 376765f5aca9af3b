"""Estimators by their kind, as filters of the runner."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from harness.common.errors import UserError
from harness.engine.compile import CompiledModel
from harness.estimation.compiled_estimator import CompiledEstimator
from harness.estimation.contract import load_estimator
from harness.runner.contract import Filter


def estimator_of(
    kind: str, compiled: CompiledModel, settings: Mapping[str, Any], folder: Path = Path(), uncertain: bool = False
) -> Filter:
    """Return an estimator that believes in a compiled model.

    Args:
        kind: File in ``harness/estimation/methods``.
        compiled: The belief, see ``CompiledEstimator``.
        settings: The estimator's settings as in a study.
        folder: Folder of the study, to which files that settings name are relative.
        uncertain: Whether it is told what errors of the inputs do.

    Raises:
        UserError: If a setting does not fit, or the estimator not the model.
    """
    file = load_estimator(kind)
    if not hasattr(file, "filter_of"):
        return CompiledEstimator(kind, compiled, dict(settings), folder, uncertain)
    try:
        chosen = file.Settings(**settings)
    except ValueError as error:
        raise UserError(f"settings of estimator '{kind}': {error}") from error
    made: Filter = file.filter_of(chosen, compiled, folder)
    return made
