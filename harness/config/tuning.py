"""Read a tuning file, as ``harness tune`` writes it, into the estimators of a study."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

from harness.common import locations, registry
from harness.common.errors import UserError
from harness.common.files import read_toml
from harness.common.units import to_si
from harness.config.problems import Problems
from harness.config.specs import NOISE_GROUPS, EstimatorSpec

_NAMED = 6
"""Training drives up to which the rule names each."""


def _file(name: str, folder: Path) -> Path:
    """Return the path of a tuning file, named as a set of drives is: bare, or as a file from the study's folder."""
    if not name.endswith(".toml"):
        return locations.find(locations.TUNINGS, name, folder / "tuned")
    return next((b / name for b in (folder, Path()) if (b / name).is_file()), folder / name)


def with_tuning(
    name: str | None, specs: list[EstimatorSpec], folder: Path, problems: Problems
) -> tuple[list[EstimatorSpec], str]:
    """Return the estimators with the noise factors of a tuning file, and the rule in words."""
    if name is None:
        return specs, ""
    try:
        path = _file(name, folder)
        content = read_toml(path)
    except UserError as error:
        problems.add("tuning", f"{error}; write it by: harness tune")
        return specs, ""
    try:
        factors = {
            e: {g: to_si(table[g], "", f"factor '{g}' of '{e}'") for g in NOISE_GROUPS}
            for e, table in content["estimator"].items()
        }
        drives = content["drives"]
        of = ", ".join(drives) if len(drives) <= _NAMED else f"{len(drives)} drives"
        rule = f"{content['rule']} ({of}; {int(content['budget'])} candidates each)"
    except (KeyError, TypeError, ValueError, AttributeError, UserError) as error:
        problems.add("tuning", f"{path} is not a tuning file ({error}); write it anew by: harness tune")
        return specs, ""
    wrong = [(e, g) for e, table in factors.items() for g, factor in table.items() if not factor > 0]
    for estimator, group in wrong:
        problems.add("tuning", f"{path}: factor '{group}' of '{estimator}' must be a positive number")
    unknown = [e for e in factors if e not in [s.name for s in specs]]
    for estimator in unknown:
        near = registry.closest(estimator, [s.name for s in specs])
        problems.add("tuning", f"{path} tunes '{estimator}', which is no estimator of this study{near}")
    return [replace(s, noise=factors.get(s.name, {})) for s in specs], rule
