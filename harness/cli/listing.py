"""Tables of ``harness list``: every component of a role with the first line of its docstring, and its settings.

Nothing is listed here by hand. Docstrings are read without importing the files, so that a listing is quick and a file
that does not import still shows.
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

from harness.common import components, locations
from harness.common.components import Component
from harness.common.errors import UserError
from harness.common.files import read_toml
from harness.common.registry import Role, closest
from harness.config.roles import ESTIMATORS
from harness.models.assembly.placement import OF_SIGNAL, is_degradation
from harness.models.roles import ROLES as MODEL_ROLES
from harness.models.roles import TYRES, VEHICLES
from harness.recordings.readers import READERS

if TYPE_CHECKING:
    from harness.models.contracts import Option, Parameter

LISTED: dict[str, Role] = {**MODEL_ROLES, "estimators": ESTIMATORS, "readers": READERS}
"""Roles by the word of the command."""

FILES: dict[str, locations.Kind] = {
    "studies": locations.STUDIES,
    "drive-sets": locations.DRIVE_SETS,
    "channels": locations.CHANNELS,
    "networks": locations.NETWORKS,
}
"""Kinds of data files by the word of the command."""

ROLES: tuple[str, ...] = ("models", *LISTED, "signals", *FILES)


def show(console: Console, role: str, name: str | None = None, here: Path | None = None) -> None:
    """Print a role as a table, or one file of it with its settings.

    Args:
        console: Where to print.
        role: One of ``ROLES``, ``models`` is every part of a model; or ``fmu``.
        name: One file of the role; its settings are printed then. Of ``fmu`` its file.
        here: Folder of studies that come before those of project and package.

    Raises:
        UserError: If there is no such role.
        ModelError: If there is no such file.
    """
    if role == "fmu":
        from harness.cli import fmus

        if name is None:
            raise UserError("whose variables? harness list fmu FILE")
        fmus.show(console, Path(name))
        return
    if role not in ROLES:
        raise UserError(f"unknown role '{role}'{closest(role, ROLES)}")
    if role == "models":
        for part in ("vehicles", "tyres", "effects", "degradations", "sensors", "parameters"):
            show(console, part)
    elif role in FILES:
        _files(console, role, here if role == "studies" else None)
    elif role == "signals":
        _signals(console)
    elif name is not None:
        if role == "effects" and is_degradation(name):
            role = "degradations"
            console.print(Text(f"{name} is a degradation of sensors, which is named among the effects of a plant"))
        LISTED[role].load(name)
        component = LISTED[role].components()[name]
        console.print(Text(f"{name}: {summary(component)}"))
        console.print(Text(f"from {_origin(component)}" if component.path is None else f"in {component.path}"))
        _details(console, role, name)
        if role == "parameters":
            _axles(console, name)
    else:
        components_ = LISTED[role].components()
        _table(console, role, _HEADINGS, [(n, summary(c), _origin(c)) for n, c in components_.items()])
        if role in ("drives", "parameters"):
            for each in components_:
                _details(console, role, each)


_HEADINGS = ("name", "what it is", "from")


def summary(component: Component) -> str:
    """Return the first line of a component's docstring without importing it."""
    if component.module is not None:
        doc = component.module.__doc__
    else:
        path = components.file_of(component)
        try:
            doc = ast.get_docstring(ast.parse(path.read_text(encoding="utf-8"))) if path is not None else None
        except (OSError, SyntaxError, ValueError) as error:
            doc = f"(cannot be read: {error})"
    return " ".join((doc or "(no docstring)").split("\n\n")[0].split())


def _origin(component: Component) -> str:
    """Return where a component comes from; for one outside the package with its file."""
    if component.origin == components.OURS or component.path is None:
        return component.origin
    return f"{component.origin}: {locations.shown(component.path)}"


def _files(console: Console, role: str, here: Path | None) -> None:
    """Print data files by name, with their title and where they come from."""
    kind = FILES[role]
    rows: list[tuple[str, str, str]] = []
    for name, path in locations.files(kind, here).items():
        title = ""
        if kind.suffix == ".toml":
            try:
                title = str(read_toml(path).get("title", ""))
            except UserError as error:
                title = str(error)
        ours = kind.in_package / path.name
        is_ours = ours.is_file() and ours.resolve() == path.resolve()
        instead = " (in place of ours)" if ours.is_file() and not is_ours else ""
        rows.append((name, title, components.OURS if is_ours else f"{locations.shown(path)}{instead}"))
    _table(console, role, ("name", "question" if role == "studies" else "title", "from"), rows)


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
    elif role in ("vehicles", "tyres", "effects", "degradations"):
        rows = [(p.name, *_allowed(p), p.meaning) for p in module.PARAMETERS]
        _table(console, f"parameters of {name}", ("parameter", "allowed", "unit", "meaning"), rows)
        if role == "vehicles":
            _quantities(console, name)
    elif role == "sensors":
        _table(console, f"outputs of {name}", ("output", "signal"), list(module.OUTPUTS.items()))
    elif role == "estimators" and hasattr(module, "Settings"):
        fields = module.Settings.model_fields.items()
        rows = [(n, str(f.get_default(call_default_factory=True)), "", f.description or "") for n, f in fields]
        _table(console, f"settings of {name}", ("setting", "default", "", "meaning"), rows)


def _quantities(console: Console, vehicle: str) -> None:
    """Print what a vehicle computes: targets of studies, what ``--signal`` takes and ports that effects change."""
    from harness.models.assembly.assemble import assemble
    from harness.models.signals import SIGNALS

    tyre = "magic_formula" if VEHICLES.load(vehicle).AXLES else None
    model = assemble(vehicle, tyre)
    names = [n for n in (*model.states, *model.ports, *model.further) if n in SIGNALS]
    kinds = dict.fromkeys(model.states, "state") | dict.fromkeys(model.ports, "port")
    rows = [(n, kinds.get(n, "follows"), _unit(SIGNALS[n].unit), SIGNALS[n].meaning) for n in names]
    with_tyre = f" with {tyre}" if tyre else ""
    _table(console, f"quantities of {vehicle}{with_tyre}", ("signal", "kind", "unit", "meaning"), rows)


def _parameter_set(console: Console, name: str, vehicle: str, values: dict[str, float]) -> None:
    """Print the values of a set with unit and meaning, tyre parameters of every axle group included."""
    module = VEHICLES.load(vehicle)
    declared: dict[str, Parameter] = {p.name: p for p in module.PARAMETERS}
    for tyre in TYRES.names():
        for p in TYRES.load(tyre).PARAMETERS:
            declared |= {f"{p.name}_{group}": p for group in module.AXLES.values()}
    rows = []
    for parameter, value in values.items():
        p = declared.get(parameter)
        rows.append((parameter, f"{value:g}", _unit(p.unit) if p else "", p.meaning if p else ""))
    _table(console, f"values of {name} ({vehicle})", ("parameter", "value", "unit", "meaning"), rows)


def _axles(console: Console, name: str) -> None:
    """Print what follows from a set for the axles: studies may vary it in place of the tyres' parameters."""
    from harness.config import complete, largest_sensors, resolve_single
    from harness.config.derived import axle_parameters, axle_values

    table = complete({"vehicle": LISTED["parameters"].load(name).VEHICLE, "parameters": name}, choose_sensors=False)[0]
    spec = resolve_single({"sensors": largest_sensors(table), **table}, name)
    declared, values = axle_parameters(spec), axle_values(spec)
    if values:
        rows = [(n, f"{values[n]:g}", p.unit, p.meaning) for n, p in declared.items()]
        _table(console, f"axles of {name} with {spec.tyre}", ("quantity", "value", "unit", "meaning"), rows)


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
