"""Remedies for what a trace found and no online model has: the amended plant, the nominal belief."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path

from harness.common.errors import UserError
from harness.common.files import parse_toml
from harness.config import StudySpec, build_study
from harness.diagnosis.result.study_gain import REPEATS, bare_tables, change_times
from harness.remedy.choices import Equipment, Remedy, adapted


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
