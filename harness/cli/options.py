"""What the commands share: where studies and results are, and a model or a drive stated by options."""

from __future__ import annotations

import functools
import sys
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

import typer
from rich.console import Console
from rich.text import Text

from harness.common.errors import ModelError, UserError
from harness.models.roles import PARAMETERS, SENSORS, VEHICLES

if TYPE_CHECKING:
    import xarray as xr

    from harness.config import DriveSpec, ModelSpec

STUDIES = Path("studies")
RESULTS = Path("results")
DEFAULT_SENSORS = "series"
"""Sensors of a model without recordings, where the vehicle has them."""

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
EffectOption = Annotated[
    list[str] | None,
    typer.Option("--effect", help="Effect in force, repeatable; those of the parameter file if absent."),
]
SensorsOption = Annotated[
    str | None,
    typer.Option(
        "--sensors", help="Sensors; those of the parameter file, or the series ones, or the only ones that fit."
    ),
]
RecordedSensorsOption = Annotated[
    str | None,
    typer.Option("--sensors", help="Sensors; those of the parameter file, or those that use most of the recordings."),
]
DriveOption = Annotated[
    list[str] | None,
    typer.Option("--option", metavar="NAME=VALUE", help='Option of the drive: amplitude="60 deg".'),
]


def answers_errors(command: Callable[[Sequence[str]], None]) -> Callable[[Sequence[str]], int]:
    """Let the command of a module return its exit status: 2, with one line on stderr, if what it was given is wrong."""

    @functools.wraps(command)
    def answering(arguments: Sequence[str]) -> int:
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
    from harness.common.registry import closest

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
    from harness.common.units import plain_number

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
    from harness.common.units import plain_number, to_si

    plain = plain_number(given)
    number = to_si(given if plain is None else plain, unit, option)
    if number <= 0:
        raise UserError(f"{option}: {given!r} must be above zero")
    return number


@dataclass(frozen=True)
class ModelOptions:
    """A model as the options of a command state it; ``None`` or empty is what was not given.

    Attributes:
        vehicle: File in ``models/vehicles``.
        parameters: File in ``models/parameters`` or path of a TOML parameter file.
        tyre: File in ``models/tyres``.
        effects: Files in ``models/effects``.
        sensors: File in ``models/sensors``.
        values: ``NAME=VALUE``, as ``--set`` takes them.
    """

    vehicle: str
    parameters: str | None = None
    tyre: str | None = None
    effects: Sequence[str] | None = None
    sensors: str | None = None
    values: list[str] | None = None


def model_table(
    options: ModelOptions, recordings: Sequence[xr.Dataset] | None = None
) -> tuple[dict[str, Any], tuple[str, ...]]:
    """Return a model given by options as ``[plant]`` of a study states it: the one place where options become a model.

    Tyre, effects and sensors that are not given are those that the parameter file states. Effects and sensors that are
    given take their place, and a note says so; a tyre cannot, because the values belong to it. What neither states is
    ``magic_formula`` where a tyre is needed, no effect, and the sensors that use most of the recordings or, without
    recordings, the series ones.

    Args:
        options: What was given.
        recordings: Those that the model is for, if any.

    Returns:
        The table, and notes for the user in sentences without a full stop.

    Raises:
        UserError: If the vehicle has several parameter sets or sensors to choose from, or the recordings contain no
            complete set of sensors.
        ModelError: If there is no such vehicle or parameter set.
    """
    from harness.config.parameter_set import load_set

    vehicle, name = options.vehicle, parameter_set(options.vehicle, options.parameters)
    stated = load_set(name, Path(), "--parameters")
    if stated.vehicle != vehicle:
        raise UserError(f"--parameters: '{name}' holds values of vehicle '{stated.vehicle}', not of '{vehicle}'")
    notes: list[str] = []
    if options.effects and stated.effects and tuple(options.effects) != stated.effects:
        chosen, there = ", ".join(options.effects), ", ".join(stated.effects)
        notes.append(f"--effect: the model has {chosen}, in place of {there} of {stated.source}")
    tyre = options.tyre or stated.tyre
    if tyre is None and VEHICLES.load(vehicle).AXLES:
        tyre = "magic_formula"
    sensors = options.sensors or stated.sensors
    if options.sensors and stated.sensors and options.sensors != stated.sensors:
        notes.append(f"--sensors: {options.sensors}, in place of {stated.sensors} of {stated.source}")
    if sensors is None and recordings is not None:
        sensors, lacking = _most_sensors(vehicle, tyre, recordings)
        notes += lacking
    elif sensors is None:
        sensors = _usual_sensors(vehicle, tyre)
    table = {
        "vehicle": vehicle,
        "parameters": name,
        "tyre": tyre,
        "effects": list(options.effects) if options.effects else None,
        "sensors": sensors,
        "values": pairs(options.values, "--set"),
    }
    return {key: value for key, value in table.items() if value is not None}, tuple(notes)


def model_spec(
    options: ModelOptions,
    recordings: Sequence[xr.Dataset] | None = None,
    side: Literal["plant", "belief"] = "plant",
    **further: Any,
) -> ModelSpec:
    """Resolve a model given by options, as ``model_table``, and print its notes.

    Args:
        options: What was given.
        recordings: Those that the model is for, if any.
        side: What the model is for, as ``harness.config.resolve_single`` takes it.
        further: More keys of ``[plant]`` or ``[belief]``, such as ``step``.
    """
    from harness.config import resolve_single

    table, notes = model_table(options, recordings)
    spec = resolve_single({**table, **further}, "command line", side)
    for note in notes:
        Console(stderr=True).print(Text(f"note: {note}"), soft_wrap=True)
    return spec


def parameter_set(vehicle: str, given: str | None) -> str:
    """Return the parameter set asked for, or the vehicle's only one.

    Raises:
        UserError: If none is asked for and the vehicle has none or several.
        ModelError: If there is no such vehicle.
    """
    VEHICLES.load(vehicle)
    if given is not None:
        return given
    sets = PARAMETERS.names()
    fit = [n for n in sets if vehicle == PARAMETERS.load(n).VEHICLE]
    if len(fit) == 1:
        return fit[0]
    there = f"There are {', '.join(fit)}; or write a TOML parameter file" if fit else "Write a TOML parameter file"
    raise UserError(f"--parameters: which values of '{vehicle}'? {there} (docs/studies.md)")


def _usual_sensors(vehicle: str, tyre: str | None) -> str:
    """Return the sensors of a vehicle where no recordings decide: the series ones, or the only ones that fit."""
    fit = [n for n in SENSORS.names() if _fits(vehicle, tyre, n)]
    if DEFAULT_SENSORS in fit or len(fit) == 1:
        return DEFAULT_SENSORS if DEFAULT_SENSORS in fit else fit[0]
    raise UserError(f"--sensors: which of '{vehicle}'? There are {', '.join(fit) or 'none that fit'}")


def _most_sensors(vehicle: str, tyre: str | None, recordings: Sequence[xr.Dataset]) -> tuple[str, tuple[str, ...]]:
    """Return the set of sensors that uses most signals of the recordings, and what a larger one would need.

    Raises:
        UserError: If there is none; with the signals that each lacks.
    """
    there = set.intersection(*({str(v).removeprefix("measured_") for v in r} for r in recordings))
    names = [n for n in SENSORS.names() if _fits(vehicle, tyre, n)]
    needs = {n: set(SENSORS.load(n).OUTPUTS) for n in names}
    complete = [n for n in names if needs[n] <= there]
    if not complete:
        lacking = "; ".join(f"'{n}' also needs {', '.join(sorted(needs[n] - there))}" for n in names)
        raise UserError(f"--sensors: the recordings contain no complete set of sensors of '{vehicle}': {lacking}")
    best, largest = (max(some, key=lambda n: len(needs[n])) for some in (complete, names))
    if len(needs[best]) == len(needs[largest]):
        return best, ()
    note = (
        f"the recordings lack {', '.join(sorted(needs[largest] - there))}, so sensors '{best}' are used "
        f"({', '.join(sorted(needs[best]))}), and what only '{largest}' would show cannot be found"
    )
    return best, (note,)


def _fits(vehicle: str, tyre: str | None, sensors: str) -> bool:
    """Whether a vehicle publishes what a set of sensors measures."""
    from harness.models.assembly.assemble import assemble

    try:
        assemble(vehicle, tyre, (), sensors)
    except ModelError:
        return False
    return True


def drive_spec(kind: str, options: list[str] | None) -> DriveSpec:
    """Return a drive given on the command line."""
    from harness.config import DriveSpec

    return DriveSpec(kind, kind, pairs(options, "--option"), f"--drive {kind}", Path())
