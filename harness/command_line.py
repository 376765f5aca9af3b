"""What the commands share: where studies and results are, pairs of name and value, a vehicle's parameter set."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from harness.errors import UserError

STUDIES = Path("studies")
RESULTS = Path("results")


def study_path(study: str) -> Path:
    """Return the file of a study given by path or by its name in ``studies/``.

    Raises:
        UserError: If there is neither, with the closest names.
    """
    from models.registry import closest

    path, named = Path(study), STUDIES / f"{study}.toml"
    if path.is_file() or path.suffix == ".toml":
        return path
    if named.is_file():
        return named
    there = sorted(p.stem for p in STUDIES.glob("*.toml"))
    raise UserError(f"there is no study file '{study}' and no {named}{closest(study, there)}")


def pairs(given: list[str] | None, option: str) -> dict[str, Any]:
    """Read ``NAME=VALUE`` pairs; a value that is a number becomes one, text keeps its unit.

    Raises:
        UserError: If an entry has no name or no value.
    """
    found: dict[str, Any] = {}
    for item in given or []:
        name, equals, text = item.partition("=")
        if not equals or not name.strip() or not text.strip():
            raise UserError(f"{option} '{item}': write NAME=VALUE, e.g. {option} speed=\"10 m/s\"")
        try:
            found[name.strip()] = float(text)
        except ValueError:
            found[name.strip()] = text.strip()
    return found


def parameter_set(vehicle: str, given: str | None) -> str:
    """Return the parameter set asked for, or the vehicle's only one.

    Raises:
        UserError: If none is asked for and the vehicle has none or several.
        ModelError: If there is no such vehicle.
    """
    from models import registry

    registry.load("models.vehicles", vehicle)
    if given is not None:
        return given
    sets = registry.names("models.parameters")
    fit = [n for n in sets if vehicle == registry.load("models.parameters", n).VEHICLE]
    if len(fit) != 1:
        there = ", ".join(fit) or "none, so write one or a TOML parameter file"
        raise UserError(f"--parameters: which set of '{vehicle}'? There are: {there}")
    return fit[0]
