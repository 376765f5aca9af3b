"""Options that commands share: places of studies and results, a model and a drive stated on the command line."""

from __future__ import annotations

import functools
import shlex
import sys
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer
from rich.console import Console
from rich.text import Text

from harness.cli.guard import guarded, place_of_output
from harness.common import locations, places
from harness.common.errors import UserError

if TYPE_CHECKING:
    from harness.api.drive import Drive
    from harness.api.model import Model

HERE = Path("studies")
"""Studies of the working directory, whether or not it is a project."""
RESULTS = Path("results")
MOST = 100_000
"""Largest count that an option takes: with more nothing would end, and most of it is a slip of the hand."""
ParametersOption = Annotated[
    str | None,
    typer.Option(
        "--parameters", help="Parameter set, or a TOML parameter file; the vehicle's usual or only set if absent."
    ),
]
TyreOption = Annotated[
    str | None, typer.Option("--tyre", help="Tyre; that of the parameter file, or magic_formula where one is needed.")
]
JobsOption = Annotated[int | None, typer.Option("--jobs", "-j", min=1, max=MOST, help="Threads; all cores if absent.")]
DatabaseOption = Annotated[
    list[str] | None,
    typer.Option(
        "--database",
        metavar="[BUS=]FILE",
        help="What the frames of bus logs hold: DBC, ARXML, KCD or SYM; else as the map says; repeatable.",
    ),
]
SeedOption = Annotated[int, typer.Option("--seed", min=0, help="Seed of what draws random numbers.")]
SignalOption = Annotated[
    list[str] | None,
    typer.Option("--signal", help="Further quantity of the model, such as a tyre force; repeatable."),
]
UnknownOption = Annotated[
    list[str] | None,
    typer.Option("--unknown-input", help="Input that is estimated as a random walk with the states; repeatable."),
]
ParameterOption = Annotated[
    list[str] | None,
    typer.Option(
        "--unknown-parameter",
        metavar="NAME[,prior=..][,walk=..]",
        help='Parameter to estimate with the states: trailer_mass,prior="4 t"; repeatable.',
    ),
]
DriveOption = Annotated[
    list[str] | None,
    typer.Option("--option", metavar="NAME=VALUE", help='Option of the drive: amplitude="60 deg".'),
]


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

    vehicle: Annotated[str, typer.Option("--model", "-m", help="Vehicle; harness list vehicles shows them.")]
    parameters: ParametersOption = None
    tyre: TyreOption = None
    effects: Annotated[
        list[str] | None,
        typer.Option("--effect", help="Effect in force, repeatable; those of the parameter file if absent."),
    ] = None
    sensors: Annotated[
        str | None,
        typer.Option(
            "--sensors",
            help="Sensors, or signals with commas between; those of the parameter file if absent, or all that "
            "recordings hold, or the usual ones of the vehicle.",
        ),
    ] = None
    values: Annotated[
        list[str] | None,
        typer.Option("--set", metavar="NAME=VALUE", help='Parameter that differs from the set: trailer_mass="8 t".'),
    ] = None


@dataclass(frozen=True)
class MaybeModelOptions(ModelOptions):
    """A model that is not always asked for."""

    vehicle: Annotated[str, typer.Option("--model", "-m", help="Vehicle; harness list vehicles shows them.")] = ""


@dataclass(frozen=True)
class VehicleOptions(ModelOptions):
    """A model whose vehicle is an argument, or named by ``--model`` as elsewhere."""

    vehicle: Annotated[str, typer.Argument(help="Vehicle; harness list vehicles shows them.")] = ""
    model: Annotated[str, typer.Option("--model", "-m", help="The vehicle, as other commands take it.")] = ""

    @property
    def named(self) -> ModelOptions:
        """The model, its vehicle named one way.

        Raises:
            UserError: If it is named both ways, or not at all.
        """
        if bool(self.vehicle) == bool(self.model):
            raise UserError("name one vehicle, by --model or as the argument; harness list vehicles shows them")
        return replace(self, vehicle=self.vehicle or self.model)


def answers_errors(command: Callable[[Sequence[str]], None]) -> Callable[[Sequence[str]], int]:
    """Let the command of a module return its exit status, see ``harness.cli.guard``."""

    @functools.wraps(command)
    def answering(arguments: Sequence[str]) -> int:
        return guarded(lambda: command(arguments), place_of_output(arguments))

    return answering


def place(given: str) -> Path:
    """Return a folder from its path or URL; typer answers what is wrong with it as with any option.

    Raises:
        BadParameter: If nothing is installed that knows such a URL.
    """
    try:
        return places.place(given)
    except UserError as error:
        raise typer.BadParameter(str(error)) from None


def study_path(study: str) -> Path:
    """Return the file of a study given by path or by its name, see ``harness.common.locations``.

    Raises:
        UserError: If there is neither, with the closest names.
    """
    path = Path(study)
    return path if path.is_file() or path.suffix == ".toml" else locations.find(locations.STUDIES, study, HERE)


def agree_to(cost: str) -> None:
    """Ask on the terminal whether to begin what costs this.

    Raises:
        UserError: If nobody agrees, or there is no terminal.
    """
    if not sys.stdin.isatty():
        raise UserError(f"{cost}; nothing is begun: begin it with --yes, or state less (repeats, samples, drives)")
    if not typer.confirm("Begin?", err=True):
        raise UserError("nothing is begun")


def pairs(given: list[str] | None, option: str) -> dict[str, Any]:
    """Read ``NAME=VALUE`` pairs; a value that is a number becomes one, text keeps its unit.

    Raises:
        UserError: If an entry has no name or no value, or two have one name.
    """
    from harness.common.units import plain_number

    values: dict[str, Any] = {}
    for item in given or []:
        name, equals, text = item.partition("=")
        if not equals or not name.strip() or not text.strip():
            raise UserError(f"{option} '{item}': write NAME=VALUE, e.g. {option} speed=\"10 m/s\"")
        name, number = name.strip(), plain_number(text)
        if name in values:
            raise UserError(f"{option} {name}=: is given twice, as {values[name]} and {text.strip()}; give it once")
        values[name] = text.strip() if number is None else number
    return values


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


def listed(given: Iterable[str]) -> tuple[str, ...]:
    """Return the names of an option that is repeated, or holds several with commas between them."""
    return tuple(n for each in given for n in (part.strip() for part in each.split(",")) if n)


def command() -> str:
    """Return the command that is running, as reports say how they were made."""
    return " ".join(["harness", *map(shlex.quote, sys.argv[1:])])


def printed(answer: str, lines: Iterable[str | Path]) -> None:
    """Print the answer of a command, and below it further sentences and the files that were written."""
    console = Console()
    console.print(Text(answer, style="bold"), soft_wrap=True)
    for line in lines:
        console.print(Text(str(line)), soft_wrap=True)


def model_of(options: ModelOptions, **further: Any) -> Model:
    """Return a model given by options.

    Args:
        options: What was given.
        further: More keys of ``[plant]``, such as ``integrator``.

    Raises:
        UserError, ModelError: As ``harness.model``.
    """
    from harness.api.model import model

    return model(
        options.vehicle,
        options.parameters,
        tyre=options.tyre,
        effects=options.effects or None,
        sensors=options.sensors,
        values=pairs(options.values, "--set") or None,
        **further,
    )


def drive_of(kind: str, options: list[str] | None) -> Drive:
    """Return a drive given on the command line."""
    from harness.api.drive import drive

    return drive(kind, **pairs(options, "--option"))
