"""The command line: run, report, list, simulate, check, estimate, tune, identify, trace, observability, realtime, ...

What exit statuses mean stands in docs/reliability.md. Everything heavy is imported inside the commands, so that help
appears at once.
"""

from __future__ import annotations

import functools
import io
import json
import os
import re
import sys
from collections import Counter
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

import typer
import typer.core
from rich.console import Console
from rich.text import Text

from harness.cli.export import export
from harness.cli.guard import answered, guarded, place_of_output, show_tracebacks
from harness.cli.models import observability, simulate
from harness.cli.monitor import monitor
from harness.cli.new import new
from harness.cli.next_drive import next_drive
from harness.cli.options import HERE, MOST, RESULTS, DatabaseOption, agree_to, place, study_path
from harness.cli.outputs import refuse_unfit
from harness.cli.recordings import estimate, identify, loop, trace
from harness.cli.studies import realtime, remedy, status, verify, view
from harness.cli.tune import tune
from harness.common.errors import UserError
from harness.common.files import LIMITED, refuse_url
from harness.common.places import is_url
from harness.common.stages import showing

if TYPE_CHECKING:
    from harness.api.results import Results


_NONE_AT_ALL = ("--estimator", "-e", "--estimators")
"""Options of which an empty word says something: run none."""

RENAMED: dict[str, dict[str, str]] = {
    "identify": {"--data": "--train"},
    "trace": {"--estimators": "--estimator"},
    "tune": {"--drives": "--drive", "--only": "--estimator"},
}
"""What options are called today, by command and former name."""

_ANYWHERE = ("--debug", "--no-limits")


def _plain(parameters: list[Any]) -> list[Any]:
    """Show no type behind a flag, which takes no value."""
    for parameter in parameters:
        if getattr(parameter, "is_flag", False):
            parameter.metavar = ""
    return parameters


class _Commands(typer.core.TyperGroup):
    """Accepts options anywhere on the line that are appended to a line that failed; and no empty word."""

    def get_params(self, ctx: Any) -> list[Any]:
        """Return the parameters; a flag has no type."""
        return _plain(super().get_params(ctx))

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:
        """Move ``--debug`` and ``--no-limits`` to the front; an empty line asks for help.

        Raises:
            BadParameter: If a word is empty: as a path it would be the working directory.
        """
        args = args or ["--help"]
        for number, (before, word) in enumerate(zip(["", *args], args, strict=False), 1):
            option, equals, value = word.partition("=") if word.startswith("--") else (before, "", word)
            if not value.strip() and (equals or value == word) and option not in _NONE_AT_ALL:
                raise typer.BadParameter(
                    f"word {number} of the command is empty, as of a variable that is not set: leave it out, or write "
                    "'.' for the working directory",
                    ctx,
                )
        first = [option for option in _ANYWHERE if option in args]
        args = [*first, *(a for a in args if a not in _ANYWHERE)]
        return super().parse_args(ctx, args)


class _Command(typer.core.TyperCommand):
    """Refuses an option that is given twice where it takes one value, or with one value where it takes several.

    The last would win without a word, or a recording count twice.
    """

    def get_params(self, ctx: Any) -> list[Any]:
        """Return the parameters; a flag has no type."""
        return _plain(super().get_params(ctx))

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:
        """Read the words of a command, former names of options as those of today.

        Raises:
            BadParameter: If an option is given twice.
        """
        args = [_today(str(self.name), word) for word in args]
        given, _, order = self.make_parser(ctx).parse_args(list(args))
        for option, count in Counter(p for p in order if isinstance(p, typer.core.TyperOption)).items():
            values = given[str(option.name)] if option.multiple else [""] * count
            meant = Counter(map(os.path.realpath, values))  # ./a is a, and a word that is no file stays itself
            twice = next((v for v in reversed(values) if meant[os.path.realpath(v)] > 1), None)
            if twice is not None and (not option.is_flag or option.secondary_opts):
                raise typer.BadParameter(f"is given twice{twice and f', as {twice}'}; give it once", ctx, option)
        return super().parse_args(ctx, args)


def _today(command: str, word: str) -> str:
    """Return a word of a command line under the name that its option has today; say so on stderr."""
    option, equals, value = word.partition("=")
    name = RENAMED.get(command, {}).get(option)
    if name is None:
        return word
    Console(stderr=True).print(Text(f"note: {option} of harness {command} is called {name}"), soft_wrap=True)
    return f"{name}{equals}{value}"


app = typer.Typer(
    cls=_Commands,
    pretty_exceptions_enable=False,
    rich_markup_mode="rich",
    context_settings={"help_option_names": ["-h", "--help"]},
)
_command = functools.partial(app.command, cls=_Command)


def _version(wanted: bool) -> None:
    if wanted:
        from harness import __version__

        typer.echo(f"harness {__version__}")
        raise typer.Exit


@app.callback()
def _common(
    version: Annotated[
        bool, typer.Option("--version", help="Print the version.", callback=_version, is_eager=True)
    ] = False,
    debug: Annotated[bool, typer.Option("--debug", help="Show the traceback of an error.")] = False,
    no_limits: Annotated[
        bool, typer.Option("--no-limits", help="Read tables of any size, with lines and columns of any number.")
    ] = False,
) -> None:
    """Which estimator can be trusted on this vehicle, and how far may it drift from what is believed?"""
    show_tracebacks(debug)
    LIMITED[0] = not no_limits


def _run_command(name: str, place: Path | None, command: Callable[[], None]) -> None:
    if place is not None:
        refuse_url(place)
    refuse_unfit(name, place)
    command()


def _answers_errors(command: Callable[..., None]) -> Callable[..., None]:
    """Turn what a command raises into one message and an exit status."""

    @functools.wraps(command)
    def answering(*args: Any, **kwargs: Any) -> None:
        place = place_of_output(kwargs)
        whole = functools.partial(_run_command, command.__name__, place, functools.partial(command, *args, **kwargs))
        status = guarded(whole, place)
        if status:
            raise typer.Exit(status)

    return answering


@_command()
@_answers_errors
def run(
    study: Annotated[str, typer.Argument(help="Study file, or the name of a study; harness list studies shows them.")],
    jobs: Annotated[
        int | None,
        typer.Option(
            "--jobs", "-j", min=1, max=MOST, help="Worker threads, or processes of --dask local; all cores if absent."
        ),
    ] = None,
    out: Annotated[
        Path | None,
        typer.Option("--out", "-o", parser=place, help="Result folder or URL; results/<name of the study> if absent."),
    ] = None,
    scheduler: Annotated[
        str | None, typer.Option("--scheduler", help="Run on the workers of this Dask scheduler: tcp://HOST:PORT.")
    ] = None,
    dask: Annotated[
        Literal["local"] | None, typer.Option("--dask", help="Run on Dask worker processes of this machine.")
    ] = None,
    quick: Annotated[
        bool,
        typer.Option("--quick", help="A first look: fewer drives, repeats and Sobol points, in results/<name>-quick."),
    ] = False,
    yes: Annotated[
        bool, typer.Option("--yes", "-y", help="Begin without asking what takes above an hour or 10 GB.")
    ] = False,
    restart: Annotated[
        bool, typer.Option("--restart", help="Throw away the result that is in the folder, and say what it was.")
    ] = False,
    device: Annotated[
        Literal["cpu", "cuda"], typer.Option("--device", help="Run on the processor or on a graphics card of NVIDIA.")
    ] = "cpu",
) -> None:
    """Run a study and write its report.

    Says first how many runs there are, how long they take and how much disk.
    An interrupted run continues where it stopped.
    The scores are identical to the bit for any number of workers.
    """
    if scheduler is not None and (dask is not None or jobs is not None):
        raise UserError("--scheduler says which workers run the study; leave out --dask and --jobs")
    if device != "cpu" and (scheduler is not None or dask is not None or jobs is not None):
        raise UserError("a graphics card runs the study by itself; leave out --scheduler, --dask and --jobs")
    from harness.api.study import read_study

    path = study_path(study)
    loaded = read_study(path.resolve() if scheduler is not None else path, quick)  # workers start in other folders
    agree = None if yes else agree_to
    results = loaded.run(out, jobs, scheduler=scheduler, dask=dask, agree=agree, restart=restart, device=device)
    _write_report(results, Console(), answer=True)


@_command()
@_answers_errors
def report(folder: Annotated[Path, typer.Argument(parser=place, help="Result folder of a finished study.")]) -> None:
    """Write the report of a finished study again.

    HTML and PDF come from the stored scores; nothing is recomputed.
    """
    if not is_url(folder) and not folder.is_dir():
        there = sorted(str(p) for p in folder.parent.glob("*") if p.is_dir())
        raise UserError(f"{folder}: there is no such folder{_closest(str(folder), there)}")
    from harness.api.results import open_results

    _write_report(open_results(folder), Console())


def _write_report(results: Results, console: Console, answer: bool = False) -> None:
    """Write the report of a finished study, print its answer if asked for, and its files."""
    from harness.study.report import NOT_VERIFIABLE

    aside = Console(stderr=True)
    with showing(aside, "writing the report"):
        files = results.report()
    if not results.is_verifiable:
        aside.print(Text(f"{results.folder}: {NOT_VERIFIABLE}", style="yellow"), soft_wrap=True)
    if answer:
        console.print(Text(results.answer, style="bold"), soft_wrap=True)
    for path in files:
        console.print(Text(str(path)), soft_wrap=True)


@_command()
@_answers_errors
def campaign(
    results: Annotated[Path, typer.Argument(help="Folder with the results of the studies.")] = RESULTS,
    out: Annotated[Path, typer.Option("--out", "-o", help="Folder of the report.")] = RESULTS / "campaign",
) -> None:
    """Gather the finished studies into one report.

    Which estimator, inside which envelope, how often it fails, what drives its error; which findings of the
    dissertation are reproduced.
    """
    from harness.reporting.hooks import hooks

    refuse_url(results)
    writers = hooks("campaign")
    if not writers:
        raise UserError(
            "nothing is installed that gathers studies: the findings of the dissertation and their tests come with a "
            "checkout, where 'make setup' installs them (docs/campaign.md)"
        )
    console = Console()
    for path in (path for write in writers for path in write(results, out)):
        console.print(Text(str(path)), soft_wrap=True)


def _closest(word: str, choices: list[str]) -> str:
    from harness.common.registry import closest

    return closest(word, choices)


@_command("list")
@_answers_errors
def list_(
    role: Annotated[
        str | None,
        typer.Argument(
            help="models (all parts of a model), vehicles, tyres, effects, sensors, parameters, drives, "
            "estimators, readers, signals, studies, drive-sets, channels or networks, all of these if absent; or fmu."
        ),
    ] = None,
    name: Annotated[
        str | None, typer.Argument(help="One file of that role, with its settings; of fmu its file.")
    ] = None,
) -> None:
    """Show what there is to choose from.

    Every component of a role with where it comes from, or one of them with its settings.
    """
    from harness.cli.listing import ROLES, show

    if role is None:
        Console().print(Text("\n".join(f"harness list {each}" for each in (*ROLES, "fmu FILE"))), soft_wrap=True)
        return
    show(_wide_console(), role, name, HERE)


def _wide_console() -> Console:
    """Return a console that does not squeeze tables into 80 columns when the output is a file or a pipe."""
    return Console() if sys.stdout.isatty() else Console(width=160)


@_command()
@_answers_errors
def check(
    file: Annotated[Path, typer.Argument(help="Recording: a file, or a folder with one signal per file.")],
    channels: Annotated[
        Path | None,
        typer.Option("--channels", "-c", help="Channel map; none for columns that are signals in SI units."),
    ] = None,
    databases: DatabaseOption = None,
    parameters: Annotated[
        str | None,
        typer.Option(
            "--parameters",
            help="Parameter set or TOML parameter file: curves of a car's axles, and a fit that tries the mended map.",
        ),
    ] = None,
    out: Annotated[
        Path | None, typer.Option("--out", "-o", help="Folder of the report; results/check-<name> if absent.")
    ] = None,
) -> None:
    """Check a measured drive.

    What does the file hold, where are its gaps, and do its signals agree with each other?
    """
    from harness.identification.fit_recordings import NominalFit
    from harness.recordings.check.check_report import print_findings, write_check
    from harness.recordings.check.run import check_recording

    with showing(Console(stderr=True), "comparing") as show:
        fit_error = None if parameters is None else NominalFit(parameters, lambda text: show(f"trying the map: {text}"))
        findings = check_recording(file, channels, parameters, fit_error, databases or ())
    console = _wide_console()
    print_findings(findings, console)
    name = file.resolve().name.split(".")[0]
    for path in write_check(findings, out if out is not None else RESULTS / f"check-{name}"):
        console.print(Text(str(path)), soft_wrap=True)


@_command()
@_answers_errors
def cache(
    clear: Annotated[bool, typer.Option("--clear", help="Delete the compiled kernels.")] = False,
) -> None:
    """Show or clear the compiled kernels."""
    from harness.common.cache import cache_folder

    folder = cache_folder()
    # Only what load_source and numba wrote: the folder is the user's choice and may hold other things.
    generated = [p for p in folder.glob("*.py") if re.fullmatch(r".+_[0-9a-f]{8,}", p.stem) and p.is_file()]
    caches = [p for p in folder.glob("__pycache__/*") if re.match(r".+_[0-9a-f]{8,}\.", p.name) and p.is_file()]
    size = sum(p.stat().st_size for p in (*generated, *caches))
    if clear:
        for path in (*generated, *caches):
            path.unlink(missing_ok=True)
        for each in (folder / "__pycache__", folder):
            if each.is_dir() and not any(each.iterdir()):
                each.rmdir()
    count, verb = len(generated) + len(caches), "deleted from" if clear else "in"
    Console().print(Text(f"{count} files, {size / 2**20:.1f} MiB {verb} {folder}"), soft_wrap=True)


@_command()
@_answers_errors
def schema(
    out: Annotated[Path | None, typer.Option("--out", "-o", help="File to write; stdout if absent.")] = None,
) -> None:
    """Write the JSON schema of a study file.

    For editors that complete and check TOML.
    """
    from harness.config import study_schema, write_schema

    if out is None:
        typer.echo(json.dumps(study_schema(), indent=2))
        return
    write_schema(out)
    Console().print(Text(str(out)), soft_wrap=True)


_command()(_answers_errors(simulate))
_command()(_answers_errors(observability))
_command()(_answers_errors(tune))
_command()(_answers_errors(estimate))
_command()(_answers_errors(identify))
_command()(_answers_errors(trace))
_command()(_answers_errors(loop))
_command()(_answers_errors(realtime))
_command()(_answers_errors(remedy))
_command()(_answers_errors(next_drive))
_command()(_answers_errors(export))
_command()(_answers_errors(monitor))
_command()(_answers_errors(new))
_command()(_answers_errors(verify))
_command()(_answers_errors(status))
_command()(_answers_errors(view))


def main() -> None:
    """Run the command line (the entry point of the ``harness`` script)."""
    for name in ("stdout", "stderr"):
        if getattr(sys, name) is None:  # closed by whoever started the command: nobody reads it
            setattr(sys, name, os.fdopen(os.open(os.devnull, os.O_WRONLY), "w", encoding="utf-8"))
        stream = getattr(sys, name)
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="replace")  # a console or pipe without Greek letters, as on Windows
    try:
        app()
    except Exception as error:  # outside of commands: help that cannot be printed
        sys.exit(answered(error))


if __name__ == "__main__":
    main()
