"""What the commands share: where studies and results are, and a model or a drive stated by options."""

from __future__ import annotations

import functools
import sys
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from harness.errors import UserError

if TYPE_CHECKING:
    from harness.configure import DriveSpec, ModelSpec

STUDIES = Path("studies")
RESULTS = Path("results")

SetOption = Annotated[
    list[str] | None,
    typer.Option("--set", metavar="NAME=VALUE", help='Parameter that differs from the set: trailer_mass="8 t".'),
]
ParametersOption = Annotated[
    str | None,
    typer.Option("--parameters", help="Parameter set, or a TOML parameter file; the vehicle's only set if absent."),
]
TyreOption = Annotated[
    str | None, typer.Option("--tyre", help="Tyre; that of the parameter file, or magic_formula where one is needed.")
]
SensorsOption = Annotated[str, typer.Option("--sensors", help="Sensor set.")]
DriveOption = Annotated[
    list[str] | None,
    typer.Option("--option", metavar="NAME=VALUE", help='Option of the drive: amplitude="60 deg".'),
]


def answers_errors(command: Callable[[Sequence[str]], None]) -> Callable[[Sequence[str]], int]:
    """Let the command of a module return its exit status: 2, with one line on stderr, if what it was given is wrong."""

    @functools.wraps(command)
    def answering(arguments: Sequence[str]) -> int:
        from models.contracts import ModelError

        try:
            command(arguments)
        except (UserError, ModelError) as error:
            print(f"error: {error}", file=sys.stderr)
            return 2
        return 0

    return answering


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
    from harness.units import plain_number

    found: dict[str, Any] = {}
    for item in given or []:
        name, equals, text = item.partition("=")
        if not equals or not name.strip() or not text.strip():
            raise UserError(f"{option} '{item}': write NAME=VALUE, e.g. {option} speed=\"10 m/s\"")
        number = plain_number(text)
        found[name.strip()] = text.strip() if number is None else number
    return found


def quantity(given: str, unit: str, option: str) -> float:
    """Return an option's number: plain in SI units, or with a unit.

    Raises:
        UserError: If it is neither, or not positive.
    """
    from harness.units import plain_number, to_si

    plain = plain_number(given)
    number = to_si(given if plain is None else plain, unit, option)
    if number <= 0:
        raise UserError(f"{option}: {given!r} must be above zero")
    return number


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


def model_table(
    vehicle: str,
    parameters: str | None,
    tyre: str | None,
    effects: list[str] | None,
    sensors: str | None,
    values: list[str] | None,
) -> dict[str, Any]:
    """Return a model given on the command line as ``[plant]`` of a study would state it.

    Tyre and effects that are not given are those of the parameter set.

    Raises:
        UserError, ModelError: If there is no such vehicle or parameter set.
    """
    from harness.configure.parameter_set import load_set
    from models import registry

    name = parameter_set(vehicle, parameters)
    if tyre is None:
        needed = "magic_formula" if registry.load("models.vehicles", vehicle).AXLES else None
        tyre = load_set(name, Path(), "--parameters").tyre or needed
    table = {
        "vehicle": vehicle,
        "parameters": name,
        "tyre": tyre,
        "effects": effects or None,
        "sensors": sensors,
        "values": pairs(values, "--set"),
    }
    return {key: value for key, value in table.items() if value is not None}


def model_spec(
    vehicle: str,
    parameters: str | None,
    tyre: str | None,
    effects: list[str] | None,
    sensors: str,
    values: list[str] | None,
) -> ModelSpec:
    """Resolve a model given on the command line."""
    from harness.configure import resolve_single

    return resolve_single(model_table(vehicle, parameters, tyre, effects, sensors, values), "command line")


def drive_spec(kind: str, options: list[str] | None) -> DriveSpec:
    """Return a drive given on the command line."""
    from harness.configure import DriveSpec

    return DriveSpec(kind, kind, pairs(options, "--option"), f"--drive {kind}", Path())
