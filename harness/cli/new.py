"""``harness new``: a commented file to start from, which works as it is."""

from __future__ import annotations

import keyword
from dataclasses import replace
from importlib import resources
from pathlib import Path
from typing import Annotated, Literal

import typer
from rich.console import Console
from rich.text import Text

from harness.cli.options import DatabaseOption, ModelOptions, ParametersOption
from harness.common import locations
from harness.common.errors import UserError
from harness.common.files import write_files
from harness.common.places import refuse_links

Form = Literal["kernels", "observer", "python", "library"]

Kind = Literal[
    "project", "vehicle", "effect", "degradation", "estimator", "tyre", "study", "channels", "parameters", "plant"
]

WRITES: dict[str, dict[str, str]] = {
    "project": {
        "harness.toml": "project.toml",
        "README.md": "project.md",
        ".gitignore": "gitignore",
        "studies/first.toml": "study.toml",
    },
    "vehicle": {
        "vehicles/{name}.py": "vehicle.py",
        "parameters/{name}_values.py": "parameters.py",
        "tests/test_{name}.py": "vehicle_test.py",
    },
    "effect": {"effects/{name}.py": "effect.py", "tests/test_{name}.py": "effect_test.py"},
    "degradation": {
        "degradations/{name}.py": "degradation.py",
        "tests/test_{name}.py": "degradation_test.py",
    },
    "estimator": {"estimators/{name}.py": "estimator.py", "tests/test_{name}.py": "estimator_test.py"},
    "estimator observer": {"estimators/{name}.py": "observer_kernels.py", "tests/test_{name}.py": "estimator_test.py"},
    "estimator python": {"studies/{name}.py": "observer.py"},
    "estimator library": {"studies/{name}.c": "observer.c"},
    "tyre": {"tyres/{name}.py": "tyre.py", "tests/test_{name}.py": "tyre_test.py"},
    "study": {"studies/{name}.toml": "study.toml"},
}
"""Files by kind, behind it the form of an estimator, each with the template that it is made from."""

FOREIGN = ("estimator python", "estimator library")
"""Entries that run in processes of their own, so that they may lie outside of a project."""

ROLES = {kind: f"{kind}s" for kind in ("vehicle", "effect", "degradation", "estimator", "tyre")}

NEXT = {
    "project": "cd {name} && harness run first",
    "vehicle": "pytest tests/test_{name}.py; harness simulate {name} --drive sine --out sine.csv",
    "effect": 'pytest tests/test_{name}.py; in a study: plant = {{ ..., effects = ["{name}"] }}',
    "degradation": 'pytest tests/test_{name}.py; in a study: plant = {{ ..., effects = ["{name}"] }}',
    "estimator": 'pytest tests/test_{name}.py; in a study: [[estimator]] kind = "{name}"',
    "estimator observer": 'pytest tests/test_{name}.py; in a study: [[estimator]] kind = "{name}"',
    "estimator python": 'in a study of a car: [[estimator]] kind = "external", python = "{name}:Observer"',
    "estimator library": "in studies: cc -O2 -shared -fPIC {name}.c -o lib{name}.so -lm; what a study states is in "
    "its first lines",
    "tyre": 'pytest tests/test_{name}.py; in a study: plant = {{ ..., tyre = "{name}" }}',
    "study": "harness run {name}",
    "channels": "look at every entry, then: harness check {given} --channels {name}",
    "plant": 'look at every entry, then in a study: plant = {{ fmu = "{given}", map = "{name}" }}',
    "parameters": "write your own values into it, then: --parameters {name} where a command takes a model",
}
"""What to do with what was written."""


def new(
    kind: Annotated[Kind, typer.Argument(help="What to make: a project folder, or a file in the one you are in.")],
    name: Annotated[str, typer.Argument(help="Its name; for channels a recording, for a plant an FMU.")],
    out: Annotated[
        Path | None,
        typer.Option(
            "--out",
            "-o",
            help="Map to write; channels/<name of the recording>.toml, or <name of the FMU>.toml, if absent. Of an "
            "estimator in Python or C the folder, which need be in no project.",
        ),
    ] = None,
    model: Annotated[str | None, typer.Option("--model", "-m", help="For parameters: the vehicle they are of.")] = None,
    parameters: ParametersOption = None,
    tyres: Annotated[
        list[str] | None,
        typer.Option(
            "--tyre",
            metavar="NAME|[AXLE=]FILE[,twin]",
            help="For parameters: a tyre, or tyre property files (.tir), repeatable: one for all axles, one each from "
            "front to rear, or by name, 12=drive.tir; ,twin behind one for twin tyres.",
        ),
    ] = None,
    databases: DatabaseOption = None,
    form: Annotated[
        Form,
        typer.Option(
            "--kind",
            help="Of an estimator: a filter or, without covariance, an observer as kernels; a class in Python or a "
            "library in C next to the studies, which runs in processes of its own.",
        ),
    ] = "kernels",
) -> None:
    """Write a commented file to start from, which works as it is.

    A project folder with a study; in it a vehicle with values, an effect, a degradation of sensors, an estimator or a
    tyre, each with its test; a study; a channel map that is proposed from the names, units and values of a recording,
    or the map of a plant that is an FMU from its description; or a parameter file for a vehicle that there is already.
    """
    console = Console()
    entry = kind if form == "kernels" else f"{kind} {form}"
    if out is not None and kind not in ("channels", "plant") and entry not in FOREIGN:
        raise UserError(
            "--out is for channels, plants, and estimators of --kind python and library; other files have their place "
            "in the project folder"
        )
    if form != "kernels" and kind != "estimator":
        raise UserError("--kind is for estimators")
    if kind != "parameters" and (model or parameters or tyres):
        raise UserError("--model, --parameters and --tyre are for parameters")
    if kind != "channels" and databases:
        raise UserError("--database is for channels")
    if kind == "channels":
        called, written = _channels(name, databases or [], out, console)
    elif kind == "plant":
        from harness.cli.fmus import write_map

        out, written = write_map(Path(name), out)
        called = str(out)
    elif kind == "parameters":
        called, written = _parameters(name, ModelOptions(model or "", parameters), tyres or [], console)
    else:
        called = name
        written = write_new(entry, name, out)
    for path in written:
        console.print(Text(locations.shown(path)), soft_wrap=True)
    console.print(Text(f"next: {NEXT[entry].format(name=called, given=name)}"), style="bold", soft_wrap=True)


def write_new(entry: str, name: str, out: Path | None = None) -> list[Path]:
    """Write the files of an entry of ``WRITES``; return their paths.

    Args:
        entry: The entry.
        name: Of what is made.
        out: Folder for one of ``FOREIGN``, in place of that of the studies of the project.

    Raises:
        UserError: If the name does not do or is taken, there is no project, or a file is there already.
    """
    kind, _, form = entry.partition(" ")
    if kind == "project":
        root = Path(name)
        called = root.resolve().name
        if not called.replace("-", "").replace("_", "").replace(".", "").isalnum():
            raise UserError(f"new project: '{called}' does not do as a name; write letters, digits, - and _")
    else:
        root, called = _project(kind, entry) if out is None else out, name
        _refuse_name(kind, name)
    texts = {path.format(name=called): _filled(template, called) for path, template in WRITES[entry].items()}
    if out is not None:
        texts = {Path(path).name: text for path, text in texts.items()}
    if kind == "project":
        texts["studies/first.toml"] = _filled("study.toml", "first")
    refuse_links(root, texts)
    there = [root / path for path in texts if (root / path).exists()]
    if there:
        raise UserError(
            f"{locations.shown(there[0])}: is there already, and nothing is written over; choose another name"
        )
    written = []
    if form == "library":
        header = resources.files("harness.external").joinpath("estimators", "harness_estimator.h")
        texts[str(Path(next(iter(texts))).with_name(header.name))] = header.read_text(
            encoding="utf-8"
        )  # the same for all
    for path, text in texts.items():
        written += write_files((root / path).parent, {Path(path).name: text})
    return written


def _project(kind: str, entry: str) -> Path:
    root = locations.project()
    if root is None:
        otherwise = ", or say a folder by --out" if entry in FOREIGN else ""
        raise UserError(
            f"new {kind}: there is no {locations.MARK} here or above; make a project first: harness new project NAME, "
            f"then work in its folder{otherwise}"
        )
    return root


def _refuse_name(kind: str, name: str) -> None:
    if kind in ("study", "parameters"):
        if not name.replace("-", "").replace("_", "").isalnum():
            raise UserError(f"new {kind}: '{name}' does not do as a name; write letters, digits, - and _")
        return
    if not name.isidentifier() or keyword.iskeyword(name) or name.startswith("_") or name != name.lower():
        raise UserError(
            f"new {kind}: '{name}' does not do as a name; write it in small letters, digits and _: my_{kind}"
        )
    from harness.config.roles import ESTIMATORS
    from harness.models.roles import ROLES as MODEL_ROLES

    role = ESTIMATORS if kind == "estimator" else MODEL_ROLES[ROLES[kind]]
    existing = role.components().get(name)
    if existing is not None:
        raise UserError(
            f"new {kind}: '{name}' is there already: {existing.place} ({existing.origin}); choose another name"
        )


def _filled(template: str, name: str) -> str:
    text = resources.files("harness.cli").joinpath("templates", f"{template}.txt").read_text(encoding="utf-8")
    words = name.replace("_", " ").replace("-", " ")
    return text.replace("@NAME@", name).replace("@TITLE@", words[:1].upper() + words[1:]).replace("@WORDS@", words)


def _channels(given: str, databases: list[str], out: Path | None, console: Console) -> tuple[str, list[Path]]:
    """Propose a channel map of a recording, print what was guessed and why, and write it."""
    from harness.recordings.proposal.propose import propose
    from harness.recordings.readers import reader_of

    called = Path(given.rstrip("/")).name.partition(".")[0]
    if out is None:
        root = locations.project()
        out = Path(f"{called}.toml") if root is None else root / locations.CHANNELS.in_project / f"{called}.toml"
        if root is not None:
            refuse_links(root, [f"{locations.CHANNELS.in_project}/{called}.toml"])
    if out.exists():
        raise UserError(f"{locations.shown(out)}: is there already, and nothing is written over; say another by --out")
    if reader_of(out) is not None:
        raise UserError(
            f"--out {out}: a channel map is written as TOML, and '{out.suffix}' is the suffix of a recording; say "
            f"{out.with_suffix('.toml')}"
        )
    proposal = propose(Path(given), databases, out.parent)
    for sentence in proposal.lines():
        console.print(Text(sentence), soft_wrap=True)
    in_project = locations.project() is not None and out.parent.name == locations.CHANNELS.in_project
    return out.stem if in_project else str(out), write_files(out.parent, {out.name: proposal.text})


def _parameters(name: str, chosen: ModelOptions, tyres: list[str], console: Console) -> tuple[str, list[Path]]:
    """Write a parameter file of a vehicle that there is, with the values of one of its sets to be replaced.

    Args:
        name: Of the file.
        chosen: The vehicle and the set.
        tyres: The name of a tyre, or property files, whose curves are drawn into a page next to the file.
        console: Where what was taken from property files is said.
    """
    from harness.api.model import write_set
    from harness.cli.options import model_of
    from harness.models.roles import VEHICLES

    if not chosen.vehicle and len(tyres) > 0 and not tyres[0].isidentifier():
        chosen = replace(chosen, vehicle="car")
        console.print(Text("vehicle: car; another one by --model"))
    if not chosen.vehicle:
        raise UserError(f"new parameters: whose? say the vehicle by --model; there are: {', '.join(VEHICLES.names())}")
    name = name.removesuffix(".toml")
    _refuse_name("parameters", name)
    out = Path(f"{name}.toml")
    if out.exists():
        raise UserError(f"{locations.shown(out)}: is there already, and nothing is written over; choose another name")
    if len(tyres) == 1 and tyres[0].isidentifier():
        chosen, tyres = replace(chosen, tyre=tyres[0]), []
    base = model_of(chosen)
    if not tyres:
        return str(out), [base.write(out, "write here where each value comes from")]
    from harness.cli.tyre_page import report
    from harness.config.tyre_parameters import fitted, on_tyres, remarks

    fit = fitted(base.spec, tyres)
    spec = on_tyres(base.spec, fit)
    for sentence in remarks(spec, fit):
        console.print(Text(sentence), soft_wrap=True)
    files = ", ".join(dict.fromkeys(f"{t.file.path.name} ({t.file.kind})" for t in fit))
    written = write_set(
        spec, out, f"tyres: {files}, friction: a factor on theirs; write here where the rest comes from"
    )
    return str(out), [written, *report(spec, fit).write(Path(), f"{name}-tyres")]
