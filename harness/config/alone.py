"""One run of a study as a study of its own, with the same random numbers."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from pydantic import ValidationError

from harness.common.errors import UserError
from harness.common.files import parse_toml
from harness.config.design_tables import DesignTable, FactorTable
from harness.config.entries import whole_paths
from harness.config.key_types import Quantity
from harness.config.load import build_study
from harness.config.schema import (
    CountTable,
    DriveTable,
    EstimatorTable,
    HistoryTable,
    ModelTable,
    ReportTable,
    StudyFile,
)
from harness.config.specs import CountFrom, DesignSpec, ModelSpec, Side, StudySpec


@dataclass(frozen=True)
class Change:
    """Another value than the run had: what if it were that?

    Attributes:
        parameter: As a factor of a design names it.
        value: A number in SI units, or text with a unit.
        of: Whose value it replaces.
    """

    parameter: str
    value: Quantity
    of: Side = "plant"


def alone(
    study: StudySpec,
    design: DesignSpec,
    drive: str,
    values: Sequence[float],
    count_from: CountFrom,
    changes: Sequence[Change] = (),
) -> StudySpec:
    """Return a study that holds a single run of another one, and gives it the same scores.

    Args:
        study: The other one.
        design: Its design that the run belongs to; that of the result is called the same and has one level of
            each factor.
        drive: Name of the drive.
        values: What each factor of the design has in the run, SI.
        count_from: Where the run's random numbers are.
        changes: Values that differ from the run's.

    Raises:
        UserError: If a change is not possible.
    """
    raw = StudyFile.model_validate(parse_toml(study.text, str(study.path)))
    spec = study.drive(drive)
    factors = {(f.parameter, f.of): float(v) for f, v in zip(design.factors, values, strict=True)}
    tables = [_table(parameter, side, value) for (parameter, side), value in _changed(factors, changes).items()]
    drawn = list(dict.fromkeys(name for history in study.history for name in history.signals))
    said = "; ".join(f"{c.parameter} of the {c.of} {c.value}" for c in changes)
    update: dict[str, Any] = {
        "title": f"{study.title or study.name} (one run on {drive}{f', but {said}' if said else ''})",
        "plant": _plant_with_whole_paths(raw.plant, study.plant),
        "drives": [],
        "drive": [DriveTable(name=spec.name, kind=spec.kind, **whole_paths(spec.options, spec.base))],
        "estimator": [_with_whole_paths(t, study) for t in raw.estimator],
        "design": [DesignTable(name=design.name, factor=tables)],
        "history": HistoryTable(design=design.name, drive=drive, signals=drawn),
        "report": ReportTable(),
        "count_from": CountTable(drive=count_from.drive, sample=count_from.sample, repeat=count_from.repeat),
    }
    return build_study(raw.model_copy(update=update), study.path)


def _changed(factors: Mapping[tuple[str, Side], float], changes: Sequence[Change]) -> dict[tuple[str, Side], Quantity]:
    """Return the factors with other values; one of both models gives way to one of each where only one changes."""
    factors_now: dict[tuple[str, Side], Quantity] = dict(factors)
    for change in changes:
        name, side = change.parameter, change.of
        if side == "both":
            factors_now.pop((name, "plant"), None)
            factors_now.pop((name, "belief"), None)
        elif (name, "both") in factors_now:
            factors_now[name, "belief" if side == "plant" else "plant"] = factors_now.pop((name, "both"))
        factors_now[name, side] = change.value
    return factors_now


def _plant_with_whole_paths(table: ModelTable | None, plant: ModelSpec) -> ModelTable | None:
    """Return a plant whose FMU and map are found from any folder."""
    folders = () if plant.external is None else plant.external.folders
    whole = {
        name: next((str((f / value).resolve()) for f in folders if (f / value).is_file()), value)
        for name in ("fmu", "map")
        if table is not None and (value := getattr(table, name)) is not None
    }
    return table.model_copy(update=whole) if table is not None and whole else table


def _with_whole_paths(table: EstimatorTable, study: StudySpec) -> EstimatorTable:
    spec = next(e for e in study.estimators if e.name == (table.name or table.kind))
    return table.model_copy(update=whole_paths(table.further, spec.base))


def _table(parameter: str, side: Side, value: Any) -> FactorTable:
    """Return a factor with one level."""
    try:
        return FactorTable(parameter=parameter, of=side, levels=[value])
    except ValidationError as error:
        said = error.errors()[0]["msg"].removeprefix("Value error, ")
        raise UserError(f"{parameter} of the {side} cannot be {value!r}: {said}") from None
