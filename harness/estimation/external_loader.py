"""Loaders of estimators of somebody else, from what a study states (``harness.external.estimators``)."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from harness.common.errors import UserError
from harness.external.references import located

KINDS = ("python", "library", "fmu", "onnx")

GROUPS = ("inputs", "measurements", "estimates")


def kind_of(settings: Mapping[str, Any]) -> str:
    """Return the kind of the loader (``harness.external.bodies.MODULES``)."""
    kind = next(k for k in KINDS if settings[k] is not None)
    return f"estimator-{kind}" if settings["filter"] is None else "estimator-fmu-belief"


def loader_of(settings: Mapping[str, Any], folder: Path, where: str) -> dict[str, Any]:
    """Return the loader of an estimator, but for the values that it gets.

    Args:
        settings: Those of ``harness/estimation/methods/external.py``.
        folder: To which files are relative.
        where: Named in errors.

    Raises:
        UserError: If a file is not there.
    """
    kind = next(k for k in KINDS if settings[k] is not None)
    loader = {
        "kind": kind_of(settings),
        "settings": _with_files(settings["settings"], folder),
        "filter": settings["filter"],
        "import_from": [str(folder.resolve())],  # what settings name may lie there
        **{name: settings[name] if settings[name] is None else list(settings[name]) for name in GROUPS},
        **{name: settings[name] for name in ("variances", "nis")},
    }
    if kind == "python":
        try:
            _, module = located(settings[kind], [folder, Path()])
        except UserError as error:
            raise UserError(f"{where}: {error}") from None
        path = dict.fromkeys([*loader["import_from"], *module["import_from"]])
        return {**module, **loader, "import_from": list(path)}
    file = folder / settings[kind]
    if not file.is_file():
        raise UserError(f"{where}: there is no file {file}")
    return {**loader, "file": str(file.resolve())}


def _with_files(value: Any, folder: Path) -> Any:
    """Return settings whose files are found from any folder."""
    if isinstance(value, Mapping):
        return {k: _with_files(v, folder) for k, v in value.items()}
    if isinstance(value, list):
        return [_with_files(v, folder) for v in value]
    if isinstance(value, str) and Path(value).suffix and (folder / value).is_file():
        return str((folder / value).resolve())
    return value
