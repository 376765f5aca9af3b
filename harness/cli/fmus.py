"""FMUs on the command line: the table of their variables, and a proposed map from these to signals."""

from __future__ import annotations

import math
import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from rich.console import Console
from rich.table import Table
from rich.text import Text

from harness.common import locations
from harness.common.errors import UserError
from harness.common.files import toml_text, write_files
from harness.external.fmu.model import FmuModel, Variable, read_model
from harness.external.fmu.read import describe
from harness.external.fmu.units import of_parameter, of_variable, written
from harness.models.contracts import DRIVE_INPUTS
from harness.models.signals import SIGNALS
from harness.recordings.proposal.column_names import read_name

RATIO = 16.0
"""Steering ratio that is proposed where the FMU is steered at its road wheels: that of a car."""

_LEAST_SURE = 1.6
"""Least log odds of a name that is taken for a signal, as for the columns of recordings."""

_EFFORTS = ("N", "N*m", "kg*m/s^2", "kg*m^2/s^2")
_EFFORT_WORDS = re.compile(r"(?P<force>force|wind|gust|kraft)|moment|torque", re.IGNORECASE)
"""Inputs that may take process noise, by unit and by name."""

_SHOWN = 40
"""Variables without a signal that a proposal names."""


def show(console: Console, path: Path) -> None:
    """Print what an FMU has: its interfaces and platforms, inputs, outputs and parameters.

    Raises:
        UserError: If it is none, or would do harm.
    """
    model = read_model(path)
    kinds = [
        f"{name}{' (one instance per process)' if name in model.one_per_process else ''}"
        f"{' (needs a program to be installed)' if name in model.needs_tool else ''}"
        for name in model.identifiers
    ]
    about = {
        "": model.description,
        "FMI": f"{model.version}.0, {' and '.join(kinds)}",
        "platforms": ", ".join(model.platforms) or ("C code only" if model.has_sources else "none"),
        "written by": model.tool,
    }
    console.print(Text(f"{model.name} in {locations.shown(path)}"), soft_wrap=True)
    for what, words in about.items():
        if words:
            console.print(Text(f"{what}: {words}" if what else words), soft_wrap=True)
    console.print()
    for title, chosen in (
        ("inputs", [v for v in model.variables.values() if v.causality == "input"]),
        ("outputs", [v for v in model.variables.values() if v.causality == "output"]),
        ("parameters", [v for v in model.variables.values() if v.is_parameter]),
    ):
        _table(console, title, chosen)


def _table(console: Console, title: str, variables: Sequence[Variable]) -> None:
    if not variables:
        console.print(Text(f"{title}: there are none\n"))
        return
    table = Table(title=title, title_justify="left", title_style="bold", box=None, pad_edge=False)
    headings = ("name", "unit", "start", "from", "to", "variability", "meaning")
    for i, heading in enumerate(headings):
        table.add_column(heading, no_wrap=i == 0, overflow="fold")
    for v in variables:
        numbers = (f"{n:g}" if math.isfinite(n) else "" for n in (v.start, v.lower, v.upper))
        kind = v.variability if v.is_real else f"{v.variability}, {v.type}{'' if v.scalar else ' array'}"
        table.add_row(*(Text(cell) for cell in (v.name, v.unit, *numbers, kind, v.description)))
    console.print(table)
    console.print()


@dataclass(frozen=True)
class _Guess:
    """A variable, the signal that it may be, how surely, why, and what the map says of it."""

    variable: Variable
    signal: str
    sure: float
    why: str
    entry: str | dict[str, object]


def write_map(path: Path, out: Path | None) -> tuple[Path, list[Path]]:
    """Propose a map of an FMU and write it; return its file and all that was written.

    Raises:
        UserError: If the FMU does not do, no output of it is a signal, or the file is there already.
    """
    out = Path(f"{path.stem}.toml") if out is None else out
    if out.exists():
        raise UserError(f"{locations.shown(out)}: is there already, and nothing is written over; say another by --out")
    return out, write_files(out.parent, {out.name: proposed(read_model(path))})


def proposed(model: FmuModel) -> str:
    """Return the text of a map that works as it is, with comments on what is open.

    Raises:
        UserError: If no output is a signal by its name, unit or description.
    """
    reals = [v for v in model.variables.values() if v.is_real]
    inputs = _chosen(model, [v for v in reals if v.causality == "input"], of_inputs=True)
    outputs = _chosen(model, [v for v in reals if v.causality == "output"], of_inputs=False)
    if not outputs:
        raise UserError(
            f"{model.path}: none of its {sum(v.causality == 'output' for v in reals)} outputs is a signal by its name, "
            f"unit or description; write the map by hand (docs/external-plants.md): harness list fmu {model.path.name}"
        )
    noise = _process_noise(model, [v for v in reals if v.causality == "input"], {g.variable.name for g in inputs})
    content: dict[str, object] = {"inputs": {g.signal: g.entry for g in inputs}}
    content["outputs"] = {g.signal: g.entry for g in outputs}
    if noise:
        content["process_noise"] = noise
    comments: dict[tuple[str, ...], str] = {}
    comments |= {(table, g.signal): g.why for table, part in (("inputs", inputs), ("outputs", outputs)) for g in part}
    describe(model.path, content, "the proposed map")
    taken = {g.variable.name for g in (*inputs, *outputs)} | {_name_of(entry) for entry in noise.values()}
    lines = _open_questions(model, [g.signal for g in inputs], reals, taken)
    return "".join(f"# {line}\n" for line in lines) + "\n" + toml_text(content, comments=comments)


def _name_of(entry: object) -> str:
    return str(entry["variable"]) if isinstance(entry, dict) else str(entry)


def _open_questions(model: FmuModel, inputs: Sequence[str], reals: Sequence[Variable], taken: set[str]) -> list[str]:
    parameters = [v.name for v in reals if v.is_parameter]
    lines = [
        "Proposed by harness new plant: a guess, look at every entry, its sign too (docs/external-plants.md).",
        "Axes are those of ISO 8855: x forward, y left, z up; what is the other way round: scale = -1.",
    ]
    lines += [f"No input was taken for {name}: drives state it." for name in DRIVE_INPUTS if name not in inputs]
    if parameters:
        some = ", ".join(parameters[:5]) + (", ..." if len(parameters) > 5 else "")
        lines.append(f"Its {len(parameters)} parameters are factors under their own names ({some}); to rename one, or")
        lines.append(f'state its unit:  [parameters]  mass = {{ variable = "{parameters[0]}", unit = "kg" }}')
    lines.append('Beyond which magnitude it is out of control:  [limits]  yaw_rate = "60 deg/s"')
    lines.append('Where drives ask for a lateral acceleration:  [vehicle]  wheelbase = "2.7 m"  steering_ratio = 16')
    rest = [v for v in reals if v.causality in ("input", "output") and v.name not in taken]
    lines += [
        f"Not used: {v.causality} {v.name}"
        + f" in {v.unit}" * bool(v.unit)
        + f" ({v.description})" * bool(v.description)
        for v in rest[:_SHOWN]
    ]
    return lines + ([f"Not used: {len(rest) - _SHOWN} more"] if len(rest) > _SHOWN else [])


def _chosen(model: FmuModel, variables: Sequence[Variable], of_inputs: bool) -> list[_Guess]:
    """Return the likeliest variable of each signal, each variable once."""
    articulated = any(v.name == "articulation_angle" or read_name(v.name).trailer for v in model.variables.values())
    guesses = [g for v in variables for g in _guesses(model, v, of_inputs, articulated)]
    chosen: dict[str, _Guess] = {}
    for guess in sorted(guesses, key=lambda g: -g.sure):
        if guess.signal not in chosen and guess.variable.name not in {g.variable.name for g in chosen.values()}:
            chosen[guess.signal] = guess
    return list(chosen.values())


def _guesses(model: FmuModel, v: Variable, of_inputs: bool, articulated: bool) -> list[_Guess]:
    """Return what a variable may be, by its name and by its description."""
    if v.name in SIGNALS:
        readings = [(v.name, 10.0, "by its name")]
    else:
        readings = []
        for text, by, less in ((v.name, "its name", 0.0), (v.description, "its description", 0.5)):
            reading = read_name(text, v.unit) if text else None
            if reading is not None and reading.signal and reading.sure - less >= _LEAST_SURE:
                body = "" if of_inputs else "_trailer" if reading.trailer else "_tractor" if articulated else ""
                signal = f"{reading.signal}{body}" if f"{reading.signal}{body}" in SIGNALS else reading.signal
                readings.append((signal, reading.sure - less, f"by {by}"))
    guesses = []
    for signal, sure, why in readings:
        factor = 1.0
        if of_inputs and signal == "road_wheel_angle":
            signal, factor = "steering_wheel_angle", RATIO
            why += f"; the steering ratio of {RATIO:g} is a guess: scale is the right one"
        if of_inputs and signal not in DRIVE_INPUTS and v.name != signal:
            continue
        if (entry := _entry(model, v, signal, factor)) is not None:
            guesses.append(_Guess(v, signal, sure, why + _doubt(v, signal), entry))
    return guesses


def _doubt(v: Variable, signal: str) -> str:
    plain = SIGNALS[signal].unit in ("1", "dimensionless")
    return "" if v.unit or plain else "; the FMU states no unit, SI is assumed"


def _entry(model: FmuModel, v: Variable, signal: str, factor: float) -> str | dict[str, object] | None:
    """Return what a map says of a variable; ``None`` where its unit does not fit the signal."""
    import tomlkit  # which takes a part of the start of a listing

    target, entry = SIGNALS[signal].unit, tomlkit.inline_table()
    entry["variable"] = v.name
    if not v.unit and target not in ("1", "dimensionless"):
        entry["unit"] = target
    else:
        try:
            of_variable(model, v.unit, target, "")
        except UserError:
            return None
    if factor != 1.0:
        entry["scale"] = factor
    return v.name if len(entry) == 1 else entry


def _process_noise(model: FmuModel, inputs: Sequence[Variable], taken: set[str]) -> dict[str, object]:
    """Return inputs that are forces or moments, by their unit or else by their name, under names of their own."""
    import tomlkit

    noise: dict[str, object] = {}
    for v in inputs:
        own = of_parameter(model, v.unit)
        name = re.sub(r"\W+", "_", v.name).strip("_").lower()
        if v.name in taken or not name or name in noise:
            continue
        if v.unit and own is not None and written(own.unit) in _EFFORTS:
            noise[name] = v.name
        elif not v.unit and (word := _EFFORT_WORDS.search(v.name)):
            entry = tomlkit.inline_table()
            entry.update({"variable": v.name, "unit": "N" if word["force"] else "N*m"})
            noise[name] = entry
    return noise
