"""Reference tables of the documentation, from the registries: parameters, options, settings, keys, commands.

``python -m bench.reference build/docs`` puts each table where a page of that folder has a line
``<!-- generated: settings ukf -->``; ``make docs`` does it to a copy of ``docs/``. The pages of the repository hold the
lines alone, so no table can disagree with the code.
"""

from __future__ import annotations

import functools
import importlib
import inspect
import json
import re
from collections.abc import Callable, Iterable, Sequence
from math import isfinite
from pathlib import Path
from types import ModuleType
from typing import Any

import typer
from pydantic import BaseModel

import harness
from harness.cli.drive_tables import kinds_table
from harness.cli.drive_tables import table as peaks_table
from harness.cli.main import app
from harness.common.arguments import Parser
from harness.config.roles import ESTIMATORS
from harness.config.schema import study_schema
from harness.models.assembly.candidates import placements
from harness.models.assembly.placement import OF_SIGNAL, place_of, ports_of
from harness.models.contracts import Parameter
from harness.models.roles import EFFECTS, TYRES, VEHICLES

ROOT = Path(__file__).parents[1]
FORMULA = re.compile(
    r"```.*?^```|`[^`\n]+`|\$\$(?P<block>.+?)\$\$|\$(?P<inline>[^$\s](?:[^$]*[^$\s])?)\$", re.DOTALL | re.MULTILINE
)
"""Code, which is passed over, or a formula."""

LINE = re.compile(r"^<!-- generated: ([\w-]+)((?: [\w./-]+)*) -->$", re.MULTILINE)
NO_CAR = "scalar_example"
"""The vehicle of the contract tests, which no page counts."""


def filled(page: str) -> str:
    """Return a page with its tables.

    Raises:
        KeyError: If a line names no table.
    """
    return LINE.sub(lambda line: TABLES[line[1]](*line[2].split()).rstrip(), page)


def with_formulas(page: str) -> str:
    """Return a page whose LaTeX formulas are MathML, which browsers draw without scripts or fonts from elsewhere."""
    return FORMULA.sub(_formula, page)


def _formula(part: re.Match[str]) -> str:
    latex = part["block"] or part["inline"]
    if latex is None:
        return part[0]
    from latex2mathml.converter import convert  # of the extra docs, which tests of the tables do without

    latex = " ".join(latex.split()).replace("{aligned}", "{align*}")
    shown = convert(latex, display="block" if part["block"] else "inline")
    for character in "|*_":  # of Markdown
        shown = shown.replace(character, f"&#{ord(character)};")
    return f"\n<div>{shown}</div>\n" if part["block"] else f"<span>{shown}</span>"


def markdown(header: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    """Return a table; bars in cells are escaped."""
    lines = [header, ["---"] * len(header), *rows]
    return "\n".join(
        "| " + " | ".join(" ".join(cell.replace("|", r"\|").split()) for cell in line) + " |" for line in lines
    )


def settings(kind: str) -> str:
    """Return the settings of an estimator with default and meaning."""
    model = getattr(ESTIMATORS.load(kind, ()), "Settings", None)
    if model is None or not model.model_fields:
        return "No settings."
    return _fields(model, "setting")


def _fields(model: type[BaseModel], what: str) -> str:
    """Return the fields of a table with default and meaning."""
    rows = [(f"`{name}`", "required" if f.is_required() else _literal(f.get_default(call_default_factory=True)),
             f.description or "") for name, f in model.model_fields.items()]  # fmt: skip
    return markdown((what, "default", "meaning"), rows)


def effects() -> str:
    """Return a section for each effect: what it is, what it changes and where, its states and parameters."""
    vehicles = [v for v in VEHICLES.names() if v != NO_CAR and _fitting(v)]
    fits = {name: [v for v in vehicles if name in _fitting(v)] for name in EFFECTS.names()}
    everywhere = len(vehicles)
    return "\n\n".join(_effect(n, _codes(v) if len(v) < everywhere else "all vehicles") for n, v in fits.items())


@functools.cache
def _fitting(vehicle: str) -> frozenset[str]:
    """Return the effects that a vehicle takes with one of its tyres; those of sensors are left out."""
    tyres = TYRES.names() if VEHICLES.load(vehicle).AXLES else (None,)
    return frozenset(name.partition("@")[0] for tyre in tyres for name in placements(vehicle, tyre, None))


def _effect(name: str, vehicles: str) -> str:
    effect = EFFECTS.load(name)
    place = place_of(effect)
    facts = [f"Changes {_codes(ports_of(effect))}; parameters of {f'each {place}' if place else 'the vehicle'}."]
    facts += [f"Reads {_codes(effect.READS)}."] if effect.READS else []
    facts += [f"States: {_codes(effect.STATES)}."] if effect.STATES else []
    facts += [f"Fits {vehicles}."] if vehicles else []
    rows = [(f"`{p.name}`", f"${p.symbol}$", _unit(p), _span(p), _neutral(p), p.meaning) for p in effect.PARAMETERS]
    table = markdown(("parameter", "symbol", "unit", "bounds", "neutral", "meaning"), rows)
    return f"### `{name}`\n\n{_prose(effect)}\n\n{' '.join(facts)}\n\n{table}"


def _prose(module: ModuleType) -> str:
    """Return a docstring as Markdown."""
    return inspect.cleandoc(module.__doc__ or "").replace("``", "`")


def _codes(names: Iterable[str]) -> str:
    return ", ".join(f"`{name}`" for name in names)


def _unit(p: Parameter) -> str:
    return {OF_SIGNAL: "of the signal", "dimensionless": "–"}.get(p.unit, p.unit)


def _span(p: Parameter) -> str:
    return f"{p.lower:g} to {p.upper:g}" + (" times its usual magnitude" if p.unit == OF_SIGNAL else "")


def _neutral(p: Parameter) -> str:
    """Return the value at which the effect is absent, or where a search starts."""
    if p.neutral is not None:
        return f"{p.neutral:g}" + (f", natural {_values(p.natural)}" if p.natural else "")
    return "per drive" if p.per_drive else f"grid {_values(p.grid)}"


def _values(values: Iterable[float]) -> str:
    return ", ".join(f"{value:g}" for value in values)


def _literal(value: Any) -> str:
    nothing = value in (None, "", []) or isinstance(value, dict) or (isinstance(value, float) and not isfinite(value))
    return "–" if nothing else f"`{json.dumps(value, default=str)}`"


def keys(name: str = "") -> str:
    """Return the keys of a table of study files with default and meaning; of the whole file without a name."""
    schema = study_schema()
    table = schema["$defs"][name] if name else schema
    required = table.get("required", [])
    rows = [(f"`{key}`", "required" if key in required else _literal(entry.get("default")), entry["description"])
            for key, entry in table["properties"].items()]  # fmt: skip
    return markdown(("key", "default", "meaning"), rows)


def fields(module: str, name: str) -> str:
    """Return the keys of a table of another file, from its pydantic model."""
    return _fields(getattr(importlib.import_module(module), name), "key")


def commands() -> str:
    """Return a section for each command: what it does, its arguments and options."""
    group: Any = typer.main.get_command(app)
    return "\n\n".join(_command(name, command) for name, command in group.commands.items() if not command.hidden)


def _command(name: str, command: Any) -> str:
    rows = []
    for parameter in command.params:
        if getattr(parameter, "hidden", False) or parameter.name == "help":
            continue
        argument = parameter.param_type_name == "argument"
        names = [parameter.name.upper()] if argument else [*parameter.opts, *parameter.secondary_opts]
        shown = "required" if parameter.required else _default(parameter.default)
        rows.append((_codes(names), shown, parameter.help or ""))
    table = markdown(("argument or option", "default", "meaning"), rows)
    return f"## `harness {name}`\n\n{inspect.cleandoc(command.help or '')}\n\n{table}"


def _default(value: Any) -> str:
    return "" if value is None or value is False or callable(value) else _literal(value)


def peaks(name: str) -> str:
    """Return the peaks of the drives of ``studies/drives/<name>.toml`` on the reference semitrailer."""
    return peaks_table(ROOT / "studies" / "drives" / f"{name}.toml")


def public_names() -> str:
    """Return the lines at which mkdocstrings puts the documentation of each public name."""
    names = sorted(harness.__all__, key=str.lower)
    return "\n\n".join(f"::: {getattr(harness, name).__module__}.{name}" for name in names)


TABLES: dict[str, Callable[..., str]] = {
    "commands": commands,
    "drive-kinds": kinds_table,
    "drive-peaks": peaks,
    "effects": effects,
    "keys": fields,
    "public-names": public_names,
    "settings": settings,
    "study-keys": keys,
}
"""Tables by the name in a page; arguments stand behind it."""


def main() -> None:
    """Fill the pages of a folder."""
    parser = Parser(description=__doc__)
    parser.add_argument("folder", type=Path, help="copy of docs/")
    for path in sorted(parser.parse_args().folder.rglob("*.md")):
        before = path.read_text(encoding="utf-8")
        after = with_formulas(filled(before))
        if after != before:
            path.write_text(after, encoding="utf-8")


if __name__ == "__main__":
    main()
