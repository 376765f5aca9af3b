"""A drive or an estimator that is stated outside a study, checked as one of a study is."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any, TypeVar

from pydantic import ValidationError

from harness.config.load import drive_specs, estimator_specs
from harness.config.problems import Problems, add_validation_errors
from harness.config.schema import DriveTable, EstimatorTable, OpenTable
from harness.config.specs import DriveSpec, EstimatorSpec

_Table = TypeVar("_Table", bound=OpenTable)


def single_drive(content: Mapping[str, Any], where: str) -> DriveSpec:
    """Return a drive.

    Args:
        content: Keys and values as in ``[[drive]]``; a file that it names is looked for in the working directory.
        where: Named in errors in place of the file.

    Raises:
        UserError: If there is no such kind, or it has no such option or needs another one.
    """
    problems = Problems(where, "drive[0]")
    specs = drive_specs([_table(content, DriveTable, problems)], Path(), Path(), problems, [])
    problems.stop()
    return specs[0]


def single_estimator(content: Mapping[str, Any], where: str) -> EstimatorSpec:
    """Return an estimator.

    Args:
        content: Keys and values as in ``[[estimator]]``; a file that it names is looked for in the working directory.
        where: Named in errors in place of the file.

    Raises:
        UserError: If there is no such estimator, it has no such setting, or a setting does not fit.
    """
    problems = Problems(where, "estimator[0]")
    specs = estimator_specs([_table(content, EstimatorTable, problems)], Path(), problems)
    problems.stop()
    return specs[0]


def _table(content: Mapping[str, Any], table: type[_Table], problems: Problems) -> _Table:
    try:
        return table.model_validate(dict(content))
    except ValidationError as error:
        add_validation_errors(problems, error, table)
        problems.stop()
        raise
