"""The command line: run, report, campaign, list, simulate, check, identify, trace, observability, realtime, ...

Exit status 0: done; 1: the work failed; 2: the request was wrong (one message says what, where and how to
mend it); 130: interrupted, and the next run goes on from there. Everything heavy is imported inside the
commands, so that help appears at once.
"""

from __future__ import annotations

import contextlib
import functools
import json
import re
import sys
import traceback
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal, NoReturn

import typer
import typer.core
from rich.console import Console
from rich.text import Text

from harness.command_line import RESULTS, STUDIES, pairs, parameter_set, study_path
from harness.errors import UserError
from harness.identify.command import identify
from harness.loop.command import trace
from harness.loop.study_command import loop
from harness.realtime.command import realtime

if TYPE_CHECKING:
    from harness.configure import DriveSpec, ModelSpec

FAILED, WRONG, INTERRUPTED = 1, 2, 130
_state = {"debug": False}


class _Commands(typer.core.TyperGroup):
    """Lets ``--debug`` stand anywhere on the line, since one adds it to a line that failed."""

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:
        """Move ``--debug`` to the front."""
        if "--debug" in args:
            args = ["--debug", *(a for a in args if a != "--debug")]
        return super().parse_args(ctx, args)


app = typer.Typer(
    cls=_Commands,
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
    rich_markup_mode="rich",
    context_settings={"help_option_names": ["-h", "--help"]},
)


def _version(wanted: bool) -> None:
    if wanted:
        from importlib.metadata import version

        typer.echo(f"harness {version('robustness-harness')}")
        raise typer.Exit


@app.callback()
def _common(
    version: Annotated[
        bool, typer.Option("--version", help="Print the version.", callback=_version, is_eager=True)
    ] = False,
    debug: Annotated[bool, typer.Option("--debug", help="Show the traceback of an error.")] = False,
) -> None:
    """Which estimator can be trusted on this vehicle, and how far may it drift from what is believed?"""
    _state["debug"] = debug


def _answers_errors(command: Callable[..., None]) -> Callable[..., None]:
    """Turn what a command raises into one message and an exit status."""

    @functools.wraps(command)
    def guarded(*args: Any, **kwargs: Any) -> None:
        try:
            command(*args, **kwargs)
        except KeyboardInterrupt:
            _fail("interrupted", "what is finished is kept; the same command goes on from there", INTERRUPTED)
        except (typer.Exit, BrokenPipeError):
            raise
        except Exception as error:
            from models.contracts import ModelError  # after the help, because it imports NumPy

            if isinstance(error, UserError | ModelError):
                _fail("error", str(error), WRONG)
            _fail("failed", f"{type(error).__name__}: {error} (--debug shows where)", FAILED)

    return guarded


def _fail(title: str, message: str, status: int) -> NoReturn:
    """Print a message in red on stderr, the traceback first if asked for, and leave."""
    if _state["debug"] and status != INTERRUPTED:
        traceback.print_exc()
    Console(stderr=True).print(Text(f"{title}: {message}", style="red"), soft_wrap=True)
    raise typer.Exit(status)


@app.command()
@_answers_errors
def run(
    study: Annotated[str, typer.Argument(help="Study file, or the name of one in studies/.")],
    jobs: Annotated[
        int | None,
        typer.Option("--jobs", "-j", min=1, help="Worker threads, or processes of --dask local; all cores if absent."),
    ] = None,
    out: Annotated[
        Path | None, typer.Option("--out", "-o", help="Result folder; results/<name of the study> if absent.")
    ] = None,
    scheduler: Annotated[
        str | None, typer.Option("--scheduler", help="Run on the workers of this Dask scheduler: tcp://HOST:PORT.")
    ] = None,
    dask: Annotated[
        Literal["local"] | None, typer.Option("--dask", help="Run on Dask worker processes of this machine.")
    ] = None,
) -> None:
    """Run a study and write its report.

    An interrupted run goes on where it stopped.
    The scores are the same bits whatever the number of workers.
    """
    if scheduler is not None and (dask is not None or jobs is not None):
        raise UserError("--scheduler says which workers run the study; leave out --dask and --jobs")
    from harness.configure import load_study

    path = study_path(study)
    loaded = load_study(path.resolve() if scheduler is not None else path)  # workers start in other folders
    from harness.run import run_study

    console = Console()
    with contextlib.ExitStack() as stack:
        client = None
        if scheduler is not None or dask is not None:
            from harness.cluster import connected

            client = stack.enter_context(connected(scheduler, jobs))
        folder = run_study(loaded, out if out is not None else RESULTS / loaded.name, jobs, console, client)
    from harness.report import headline

    console.print(Text(headline(folder), style="bold"), soft_wrap=True)
    for path in sorted(folder.glob("report.*")):
        console.print(Text(str(path)), soft_wrap=True)


@app.command()
@_answers_errors
def report(folder: Annotated[Path, typer.Argument(help="Result folder of a finished study.")]) -> None:
    """Write the report of a finished study again.

    HTML and PDF come from the stored scores; nothing is computed anew.
    """
    if not folder.is_dir():
        there = sorted(str(p) for p in folder.parent.glob("*") if p.is_dir())
        raise UserError(f"{folder}: there is no such folder{_closest(str(folder), there)}")
    from harness.report import write_report

    console = Console()
    for path in write_report(folder):
        console.print(Text(str(path)), soft_wrap=True)


@app.command()
@_answers_errors
def campaign(
    results: Annotated[Path, typer.Argument(help="Folder with the results of the studies.")] = RESULTS,
    out: Annotated[Path, typer.Option("--out", "-o", help="Folder of the report.")] = RESULTS / "campaign",
) -> None:
    """Gather the finished studies into one report.

    Which estimator, inside which envelope, how often it fails, what drives its error; what of the dissertation holds.
    """
    from harness.campaign import write_campaign

    console = Console()
    for path in write_campaign(results, out):
        console.print(Text(str(path)), soft_wrap=True)


def _closest(word: str, choices: list[str]) -> str:
    from models.registry import closest

    return closest(word, choices)


@app.command()
@_answers_errors
def tune(
    study: Annotated[str, typer.Argument(help="Study file, or the name of one in studies/.")],
    drives: Annotated[str, typer.Option("--drives", help="Training drives: a name in studies/drives or a TOML file.")],
    out: Annotated[Path, typer.Option("--out", "-o", help="Tuning file to write; a study names it by tuning = ...")],
    budget: Annotated[int, typer.Option("--budget", min=1, help="Candidates per estimator.")] = 240,
    repeats: Annotated[int, typer.Option("--repeats", min=1, help="Runs of each drive with other noise.")] = 1,
) -> None:
    """Tune the noise that every estimator of a study believes, by one rule and within one budget.

    Factors on process noise, random walk of the unknown inputs and measurement noise maximise the likelihood of the
    innovations on the training drives, simulated at the nominal plant.
    """
    import dataclasses

    from rich.table import Table

    from harness.configure import load_drives, load_study
    from harness.tune import tune as search
    from harness.tune import write_tuning

    loaded = load_study(study_path(study))
    training = dataclasses.replace(loaded, drives=load_drives(drives, loaded.path.parent))
    console = Console(stderr=True)
    with console.status("tuning") as status:
        found = search(training, budget, repeats, lambda name: status.update(f"tuning {name}"))
    write_tuning(out, training, budget, repeats, found)
    table = Table("estimator", "process", "unknown inputs", "measurement", "log-likelihood before", "after", box=None)
    for name, tuning in found.items():
        factors = [f"{tuning.factors[group]:.3g}" for group in ("process", "unknown_inputs", "measurement")]
        table.add_row(name, *factors, f"{tuning.before:.1f}", f"{tuning.after:.1f}")
    Console().print(table)
    typer.echo(out)


@app.command("list")
@_answers_errors
def list_(
    role: Annotated[
        str,
        typer.Argument(
            help="models (all parts of a model), vehicles, tyres, effects, sensors, parameters, drives, "
            "estimators, readers, signals or studies."
        ),
    ],
    name: Annotated[str | None, typer.Argument(help="One file of that role, with its settings.")] = None,
) -> None:
    """Show what there is to choose from.

    Every file of a role, or one of them with its settings.
    """
    from harness.listing import show

    show(_wide_console(), role, name, STUDIES)


def _wide_console() -> Console:
    """Return a console that does not squeeze tables into 80 columns when the output is a file or a pipe."""
    return Console() if sys.stdout.isatty() else Console(width=160)


_Set = Annotated[
    list[str] | None,
    typer.Option("--set", metavar="NAME=VALUE", help='Parameter that differs from the set: trailer_mass="8 t".'),
]
_Parameters = Annotated[
    str | None, typer.Option("--parameters", help="Parameter set; the vehicle's only one if absent.")
]
_Tyre = Annotated[str, typer.Option("--tyre", help="Tyre.")]
_Sensors = Annotated[str, typer.Option("--sensors", help="Sensor set.")]
_Options = Annotated[
    list[str] | None,
    typer.Option("--option", metavar="NAME=VALUE", help='Option of the drive: amplitude="60 deg".'),
]


@app.command()
@_answers_errors
def simulate(
    vehicle: Annotated[str, typer.Argument(help="Vehicle; harness list vehicles shows them.")],
    drive: Annotated[str, typer.Option("--drive", help="Kind of drive; harness list drives shows them.")],
    out: Annotated[Path, typer.Option("--out", "-o", help="File to write: .csv, .parquet or .nc.")],
    option: _Options = None,
    values: _Set = None,
    parameters: _Parameters = None,
    tyre: _Tyre = "magic_formula",
    effect: Annotated[list[str] | None, typer.Option("--effect", help="Effect in force; repeatable.")] = None,
    sensors: _Sensors = "series",
    signal: Annotated[list[str] | None, typer.Option("--signal", help="Further quantity to write; repeatable.")] = None,
    seed: Annotated[
        int | None,
        typer.Option("--seed", min=0, help="Seed of process and measurement noise; none if absent."),
    ] = None,
) -> None:
    """Simulate one drive and write it to a file.

    One column per signal, in SI units, under the names that harness list signals shows.
    """
    from harness.recording_file import check_target, write_recording

    check_target(out)
    spec = _model_spec(vehicle, parameters, tyre, effect or [], sensors, values)
    for name in signal or []:
        spec.model().resolve(name)
    from harness.drives import profile_of
    from harness.simulate import simulate_drive

    profile = profile_of(spec, _drive_spec(drive, option))
    recording = simulate_drive(spec, profile, signal or [], seed)
    write_recording(recording, out)
    samples, signals = recording.sizes["time"], len(recording.data_vars)
    Console().print(Text(f"{out}: {samples} samples of {signals} signals"), soft_wrap=True)


@app.command()
@_answers_errors
def check(
    file: Annotated[Path, typer.Argument(help="Recording: a file, or a folder with one signal per file.")],
    channels: Annotated[
        Path | None, typer.Option("--channels", help="Channel map; none for columns that are signals in SI units.")
    ] = None,
    parameters: Annotated[
        str | None, typer.Option("--parameters", help="Parameter set of a car, for the curves of its axles.")
    ] = None,
    out: Annotated[
        Path | None, typer.Option("--out", "-o", help="Folder of the report; results/check-<name> if absent.")
    ] = None,
) -> None:
    """Check a measured drive.

    What does the file hold, where are its gaps, and do its signals agree with each other?
    """
    from harness.measured.check import check_recording, print_findings, write_check

    findings = check_recording(file, channels, parameters)
    console = _wide_console()
    print_findings(findings, console)
    name = file.resolve().name.split(".")[0]
    for path in write_check(findings, out if out is not None else RESULTS / f"check-{name}"):
        console.print(Text(str(path)), soft_wrap=True)


@app.command()
@_answers_errors
def observability(
    vehicle: Annotated[str, typer.Argument(help="Vehicle; harness list vehicles shows them.")],
    out: Annotated[Path, typer.Option("--out", "-o", help="Folder of the figure.")],
    unknown_input: Annotated[
        list[str] | None, typer.Option("--unknown-input", help="Input to be estimated; repeatable.")
    ] = None,
    drive: Annotated[
        str | None, typer.Option("--drive", help="Kind of drive; straight, sine, straight if absent.")
    ] = None,
    option: _Options = None,
    values: _Set = None,
    parameters: _Parameters = None,
    tyre: _Tyre = "magic_formula",
    sensors: _Sensors = "series",
) -> None:
    """Check structural observability along a drive.

    Can the states be told from the measurements at all? Straight ahead and under lateral excitation.
    """
    spec = _model_spec(vehicle, parameters, tyre, [], sensors, values)
    profile = None
    if drive is not None:
        from harness.drives import profile_of

        profile = profile_of(spec, _drive_spec(drive, option))
    elif option:
        raise UserError("--option belongs to a drive; name it with --drive")
    from harness.observability import report as check

    check(vehicle, spec.parameters, tyre, sensors, unknown_input or [], out, spec.values, profile)


def _model_spec(
    vehicle: str,
    parameters: str | None,
    tyre: str,
    effects: list[str],
    sensors: str,
    values: list[str] | None,
) -> ModelSpec:
    """Resolve a model given on the command line as a study's ``[plant]`` would be."""
    from harness.configure import resolve_single

    table = {
        "vehicle": vehicle,
        "parameters": parameter_set(vehicle, parameters),
        "tyre": tyre,
        "effects": effects,
        "sensors": sensors,
        "values": pairs(values, "--set"),
    }
    return resolve_single(table, "command line")


def _drive_spec(kind: str, options: list[str] | None) -> DriveSpec:
    from harness.configure import DriveSpec

    return DriveSpec(kind, kind, pairs(options, "--option"), f"--drive {kind}", Path())


@app.command()
@_answers_errors
def cache(
    clear: Annotated[bool, typer.Option("--clear", help="Delete the compiled kernels.")] = False,
) -> None:
    """Show or clear the compiled kernels."""
    from harness.compile import cache_folder

    folder = cache_folder()
    # Only what load_source and numba wrote: the folder is the user's choice and may hold other things.
    generated = [p for p in folder.glob("*.py") if re.fullmatch(r".+_[0-9a-f]{8,}", p.stem)]
    caches = [p for p in folder.glob("__pycache__/*") if re.match(r".+_[0-9a-f]{8,}\.", p.name)]
    size = sum(p.stat().st_size for p in (*generated, *caches))
    if clear:
        for path in (*generated, *caches):
            path.unlink(missing_ok=True)
        for each in (folder / "__pycache__", folder):
            if each.is_dir() and not any(each.iterdir()):
                each.rmdir()
    count, verb = len(generated) + len(caches), "deleted from" if clear else "in"
    Console().print(Text(f"{count} files, {size / 2**20:.1f} MiB {verb} {folder}"), soft_wrap=True)


@app.command()
@_answers_errors
def schema(
    out: Annotated[Path | None, typer.Option("--out", "-o", help="File to write; stdout if absent.")] = None,
) -> None:
    """Write the JSON schema of a study file.

    For editors that complete and check TOML.
    """
    from harness.configure import study_schema, write_schema

    if out is None:
        typer.echo(json.dumps(study_schema(), indent=2))
        return
    try:
        write_schema(out)
    except OSError as error:
        raise UserError(f"{out}: cannot be written: {error.strerror}") from None
    Console().print(Text(str(out)), soft_wrap=True)


app.command()(_answers_errors(identify))
app.command()(_answers_errors(trace))
app.command()(_answers_errors(loop))
app.command()(_answers_errors(realtime))


def main() -> None:
    """Run the command line (the entry point of the ``harness`` script)."""
    app()


if __name__ == "__main__":
    main()
