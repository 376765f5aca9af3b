"""What ``harness list`` shows: every file of a role with the first line of its docstring, and its settings.

The folders are read, nothing is listed here by hand. Docstrings are read without importing the files, so
that a listing is quick and a file that does not import still shows.
"""

from __future__ import annotations

import ast
from collections.abc import Sequence
from math import degrees, isfinite
from pathlib import Path
from typing import TYPE_CHECKING

from rich.console import Console
from rich.table import Table
from rich.text import Text

from harness.common.errors import UserError
from harness.common.files import read_toml
from harness.common.registry import Role, closest
from harness.config.roles import ESTIMATORS
from harness.models.assembly.placement import OF_SIGNAL
from harness.models.roles import ROLES as MODEL_ROLES
from harness.models.roles import TYRES, VEHICLES
from harness.recordings.readers import READERS

if TYPE_CHECKING:
    from harness.models.contracts import Option, Parameter

LISTED: dict[str, Role] = {**MODEL_ROLES, "estimators": ESTIMATORS, "readers": READERS}
"""Roles by the word of the command."""

ROLES: tuple[str, ...] = ("models", *LISTED, "signals", "studies")


def show(console: Console, role: str, name: str | None = None, studies: Sequence[Path] = ()) -> None:
    """Print a role as a table, or one file of it with its settings.

    Args:
        console: Where to print.
        role: One of ``ROLES``; ``models`` is every part of a model.
        name: One file of the role; its settings are printed then.
        studies: Folders of study files; one of a name that an earlier folder has is passed over.

    Raises:
        UserError: If there is no such role.
        ModelError: If there is no such file.
    """
    if role not in ROLES:
        raise UserError(f"unknown role '{role}'{closest(role, ROLES)}")
    if role == "models":
        for part in ("vehicles", "tyres", "effects", "sensors", "parameters"):
            show(console, part)
    elif role == "studies":
        _table(console, "studies", ("study", "question"), _studies(studies))
    elif role == "signals":
        _signals(console)
    elif name is not None:
        LISTED[role].load(name)
        console.print(Text(f"{name}: {summary(LISTED[role], name)}"))
        _details(console, role, name)
    else:
        files = LISTED[role]
        _table(console, role, ("name", "what it is"), [(n, summary(files, n)) for n in files.names()])
        if role in ("drives", "parameters"):
            for each in files.names():
                _details(console, role, each)


def summary(role: Role, name: str) -> str:
    """Return the first line of a file's docstring without importing the file."""
    folder = role.folder
    path = folder / f"{name}.py"
    if not path.is_file():
        path = folder / name / "__init__.py"
    doc = ast.get_docstring(ast.parse(path.read_text(encoding="utf-8"))) or "(no docstring)"
    return " ".join(doc.split("\n\n")[0].split())


def _studies(folders: Sequence[Path]) -> list[tuple[str, str]]:
    """Return name and question of every study file."""
    found = {path.stem: path for folder in reversed(folders) for path in folder.glob("*.toml")}
    rows = []
    for name, path in sorted(found.items()):
        try:
            rows.append((name, str(read_toml(path).get("title", ""))))
        except UserError as error:
            rows.append((name, str(error)))
    return rows


def _table(console: Console, title: str, headings: tuple[str, ...], rows: Sequence[tuple[str, ...]]) -> None:
    if not rows:
        console.print(Text(f"{title}: there are none"))
        return
    table = Table(title=title, title_justify="left", title_style="bold", box=None, pad_edge=False)
    for i, heading in enumerate(headings):
        table.add_column(heading, no_wrap=i == 0, overflow="fold")
    for row in rows:
        table.add_row(*(Text(cell) for cell in row))
    console.print(table)
    console.print()


def _details(console: Console, role: str, name: str) -> None:
    module = LISTED[role].load(name, () if role == "estimators" else None)
    if role == "drives":
        from harness.models.drive_options import options_of

        rows = [(o.name, _default(o), _range(o.unit, o.lower, o.upper), o.meaning) for o in options_of(name)]
        _table(console, f"options of {name}", ("option", "default", "allowed", "meaning"), rows)
    elif role == "parameters":
        _parameter_set(console, name, module.VEHICLE, module.VALUES)
    elif role in ("vehicles", "tyres", "effects"):
        rows = [(p.name, *_allowed(p), p.meaning) for p in module.PARAMETERS]
        _table(console, f"parameters of {name}", ("parameter", "allowed", "unit", "meaning"), rows)
    elif role == "sensors":
        _table(console, f"outputs of {name}", ("output", "signal"), list(module.OUTPUTS.items()))
    elif role == "estimators" and hasattr(module, "Settings"):
        fields = module.Settings.model_fields.items()
        rows = [(n, str(f.default), "", f.description or "") for n, f in fields]
        _table(console, f"settings of {name}", ("setting", "default", "", "meaning"), rows)


def _parameter_set(console: Console, name: str, vehicle: str, values: dict[str, float]) -> None:
    """Print the values of a set with unit and meaning, tyre parameters of every axle group included."""
    module = VEHICLES.load(vehicle)
    known: dict[str, Parameter] = {p.name: p for p in module.PARAMETERS}
    for tyre in TYRES.names():
        for p in TYRES.load(tyre).PARAMETERS:
            known |= {f"{p.name}_{group}": p for group in module.AXLES.values()}
    rows = []
    for parameter, value in values.items():
        p = known.get(parameter)
        rows.append((parameter, f"{value:g}", _unit(p.unit) if p else "", p.meaning if p else ""))
    _table(console, f"values of {name} ({vehicle})", ("parameter", "value", "unit", "meaning"), rows)


def _signals(console: Console) -> None:
    from harness.models.signals import SIGNALS

    rows = [(s.name, _unit(s.unit), _unit(s.report_unit), s.meaning) for s in SIGNALS.values()]
    _table(console, "signals", ("signal", "unit", "in reports", "meaning"), rows)


def _unit(unit: str) -> str:
    return "" if unit == "dimensionless" else unit


def _allowed(p: Parameter) -> tuple[str, str]:
    """Return range and unit of a parameter; one of a measured signal counts that signal's usual magnitude."""
    if p.unit == OF_SIGNAL:
        return f"{_shown(p.lower, '')} to {_shown(p.upper, '')} times its usual magnitude", "that of the signal"
    return _range(p.unit, p.lower, p.upper), _unit(p.unit)


def _shown(value: float, unit: str) -> str:
    """Write a number without its unit, an angle in degrees."""
    return f"{degrees(value) if unit.startswith('rad') else value:.6g}"


def _in_words(unit: str) -> str:
    return unit.replace("rad", "deg", 1) if unit.startswith("rad") else _unit(unit)


def _default(option: Option) -> str:
    if option.default is None:
        return "required"
    if option.unit == "text":
        return str(option.default)
    if not isfinite(option.default):
        return "none"
    return f"{_shown(option.default, option.unit)} {_in_words(option.unit)}".strip()


def _range(unit: str, lower: float, upper: float) -> str:
    if unit == "text":
        return "text"
    end = _shown(upper, unit) if isfinite(upper) else "any"
    return f"{_shown(lower, unit)} to {end} {_in_words(unit)}".strip()
