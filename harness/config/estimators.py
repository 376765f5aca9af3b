"""Resolve ``[[estimator]]``: its kind known, its settings checked and completed."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from pydantic import BaseModel, ValidationError

from harness.common import registry
from harness.common.units import refuse_misread
from harness.config.named_files import folder_of
from harness.config.problems import Problems, add_validation_errors, below, refuse_twice, validated
from harness.config.roles import ESTIMATORS
from harness.config.schema import EstimatorTable
from harness.config.specs import EstimatorSpec


def single_estimator(kind: str, settings: Mapping[str, Any], where: str) -> EstimatorSpec:
    """Return an estimator that is stated outside a study, its settings completed.

    Args:
        kind: File in ``harness/estimation/methods``.
        settings: As in ``[[estimator]]``.
        where: Named in errors in place of the file.

    Raises:
        UserError: If there is no such estimator or it has no such setting.
    """
    problems = Problems(where)
    table = validated({**settings, "kind": kind}, EstimatorTable, problems)
    problems.stop()
    assert table is not None
    spec = _estimator(table, "", Path(), problems)
    problems.stop()
    return spec


def resolve_estimators(tables: list[EstimatorTable], folder: Path, problems: Problems) -> list[EstimatorSpec]:
    """Return the estimators of a study, their settings completed."""
    specs = [_estimator(table, f"estimator[{i}]", folder, problems) for i, table in enumerate(tables)]
    refuse_twice([s.name for s in specs], "estimator", "name", problems)
    return specs


def _estimator(table: EstimatorTable, key: str, folder: Path, problems: Problems) -> EstimatorSpec:
    settings = table.further
    with problems.catch(below(key, "kind")):
        module = ESTIMATORS.load(table.kind, ())
        model: type[BaseModel] | None = getattr(module, "Settings", None)
        known = [] if model is None else sorted(model.model_fields)
        unknown = [k for k in settings if k not in known]
        for name in unknown:
            problems.add(
                below(key, name),
                f"estimator '{table.kind}' has no setting '{name}'{registry.closest(name, known)}",
            )
        if model is not None and not unknown:
            refuse_misread(settings, problems.at(key))
            try:
                settings = model.model_validate(settings).model_dump()
            except ValidationError as error:
                add_validation_errors(problems, error, model, key)
    return EstimatorSpec(table.name or table.kind, table.kind, settings, folder_of(settings, (folder, Path())))
