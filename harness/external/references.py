"""Classes and functions of somebody else, named ``module:Name``: their file, and how a worker process imports them."""

from __future__ import annotations

import importlib
import importlib.util
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from harness.common.errors import UserError


def located(reference: str, folders: Sequence[Path]) -> tuple[Path | None, dict[str, Any]]:
    """Return the file of ``module:Class`` and what a worker makes it from.

    Args:
        reference: As a study names it.
        folders: In which the module is looked for, before the packages that are installed.

    Returns:
        The file, ``None`` where it is one of an installed package, and the loader without its kind.

    Raises:
        UserError: If the reference has another form.
    """
    module, colon, name = reference.partition(":")
    if not colon or not all(part.isidentifier() for part in (*module.split("."), name)):
        raise UserError(f"'{reference}' names no class; write 'module:Class', such as 'my_plant:Plant'")
    loader: dict[str, Any] = {"module": module, "name": name, "import_from": []}
    for folder in folders:
        stem = folder.joinpath(*module.split("."))
        for file in (stem.with_suffix(".py"), stem / "__init__.py"):
            if file.is_file():
                return file, {**loader, "import_from": [str(folder.resolve())]}
    return None, loader


def installed(reference: str) -> Path | None:
    """Return the file of a module of ``module:Name`` among installed packages, which are not imported for it."""
    top, *parts = reference.partition(":")[0].split(".")
    spec = importlib.util.find_spec(top)
    if spec is None or spec.origin is None:
        return None
    stem = Path(spec.origin).parent.joinpath(*parts) if parts else Path(spec.origin).with_suffix("")
    files = stem.with_suffix(".py"), stem / "__init__.py"
    return next((file for file in files if file.is_file()), None)


def imported(loader: Mapping[str, Any]) -> Any:
    """Return what a loader names, in a worker process.

    Raises:
        UserError: If there is no such module, it does not import, or has no such name.
    """
    reference = f"{loader['module']}:{loader['name']}"
    try:
        module = importlib.import_module(loader["module"])
    except ModuleNotFoundError as error:
        if error.name and loader["module"].startswith(error.name):
            raise UserError(
                f"'{reference}': there is no module '{error.name}' next to the study, in the working directory or "
                "among the installed packages"
            ) from None
        raise
    if not hasattr(module, loader["name"]):
        there = [n for n, value in vars(module).items() if callable(value) and n[:1] != "_"]
        listing = f"there are: {', '.join(there)}" if there else "no class or function is in it"
        raise UserError(f"'{reference}': {module.__file__} has no '{loader['name']}'; {listing}")
    return getattr(module, loader["name"])
