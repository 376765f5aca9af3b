"""Read a tuning file, as ``harness tune`` writes it, into the estimators of a study."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

from harness.common import locations, registry
from harness.common.errors import UserError
from harness.common.files import read_toml
from harness.common.units import to_si
from harness.config.problems import Problems
from harness.config.schema import TuningTable
from harness.config.specs import NOISE_GROUPS, EstimatorSpec

_NAMED = 6
"""Training drives up to which the rule names each."""


def _file(name: str, folder: Path) -> Path:
    """Return the path of a tuning file, named as a set of drives is: bare, or as a file from the study's folder."""
    if not name.endswith(".toml"):
        return locations.find(locations.TUNINGS, name, folder / "tuned")
    return next((b / name for b in (folder, Path()) if (b / name).is_file()), folder / name)


def with_tuning(
    stated: str | TuningTable | None, specs: list[EstimatorSpec], folder: Path, problems: Problems
) -> tuple[list[EstimatorSpec], str]:
    """Return the estimators with the noise factors of a tuning file or its table, and the rule in words."""
    if stated is None:
        return specs, ""
    where = "this table"
    try:
        if isinstance(stated, TuningTable):
            content = stated.model_dump()
        else:
            where = str(path := _file(stated, folder))
            content = read_toml(path)
    except UserError as error:
        problems.add("tuning", f"{error}; write it by: harness tune")
        return specs, ""
    try:
        factors = {
            e: {g: to_si(table[g], "", f"factor '{g}' of '{e}'") for g in NOISE_GROUPS}
            for e, table in content["estimator"].items()
        }
        rule = content["rule"] if isinstance(stated, TuningTable) else _in_words(content)
    except (KeyError, TypeError, ValueError, AttributeError, UserError) as error:
        problems.add("tuning", f"{where} is not a tuning file ({error}); write it anew by: harness tune")
        return specs, ""
    wrong = [(e, g) for e, table in factors.items() for g, factor in table.items() if not factor > 0]
    for estimator, group in wrong:
        problems.add("tuning", f"{where}: factor '{group}' of '{estimator}' must be a positive number")
    unknown = [e for e in factors if e not in [s.name for s in specs]]
    for estimator in unknown:
        near = registry.closest(estimator, [s.name for s in specs])
        problems.add("tuning", f"{where} tunes '{estimator}', which is no estimator of this study{near}")
    return [replace(s, noise=factors.get(s.name, {})) for s in specs], rule


def as_table(path: Path) -> dict[str, Any]:
    """Return what a study states in place of the name of a tuning file.

    Raises:
        UserError: If it cannot be read.
    """
    content = read_toml(path)
    factors = {e: {g: table[g] for g in NOISE_GROUPS} for e, table in content["estimator"].items()}
    return {"rule": _in_words(content), "estimator": factors}


def _in_words(content: dict[str, Any]) -> str:
    """Return the rule of a tuning file, its drives and its budget in words."""
    drives = content["drives"]
    trained_on = ", ".join(drives) if len(drives) <= _NAMED else f"{len(drives)} drives"
    return f"{content['rule']} ({trained_on}; {int(content['budget'])} candidates each)"
