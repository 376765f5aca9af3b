"""The folder is the registry: find a file by its stem, check its exports, suggest the closest name."""

from __future__ import annotations

import difflib
import importlib.util
import pkgutil
from types import ModuleType

from harness.common.errors import ModelError

EXPORTS: dict[str, tuple[str, ...]] = {
    "vehicles": ("STATES", "INPUTS", "PARAMETERS", "AXLES", "VALID", "equations"),
    "tyres": ("PARAMETERS", "lateral_force"),
    "effects": ("PORT", "READS", "PARAMETERS", "STATES", "apply"),
    "sensors": ("OUTPUTS",),
    "parameters": ("VEHICLE", "VALUES", "PROCESS_NOISE", "MEASUREMENT_NOISE", "NOISE_STEP"),
    "drives": ("OPTIONS", "generate"),
}
"""What a file in each folder of ``models/`` must define (``models/contracts.py`` says what it is)."""


def names(package: str) -> list[str]:
    """Return the sorted stems of the files in a role's package.

    Args:
        package: Dotted package, e.g. ``harness.models.vehicles``.
    """
    found = importlib.import_module(package)
    return sorted(m.name for m in pkgutil.iter_modules(found.__path__) if not m.name.startswith("_"))


def closest(word: str, choices: list[str] | tuple[str, ...]) -> str:
    """Return ``"; closest: a, b"`` for the choices that resemble the word, or the whole list if none does."""
    near = difflib.get_close_matches(word, choices, n=3, cutoff=0.5)
    if near:
        return f"; closest: {', '.join(near)}"
    return f"; there are: {', '.join(choices)}" if choices else "; there are none"


def load(package: str, name: str, exports: tuple[str, ...] | None = None) -> ModuleType:
    """Import the file ``name`` of a role and check that it exports what its role requires.

    Args:
        package: Dotted package, e.g. ``harness.models.tyres``.
        name: Stem of the file.
        exports: Names the module must define; by default those of the role in ``EXPORTS``.

    Raises:
        ModelError: If there is no such file (with the closest names) or an export is missing.
    """
    role = package.rsplit(".", 1)[-1]
    available = names(package)
    if name not in available:
        raise ModelError(f"unknown {role.rstrip('s')} '{name}'{closest(name, available)}")
    module = _imported(f"{package}.{name}")
    required = EXPORTS.get(role, ()) if exports is None else exports
    missing = [e for e in required if not hasattr(module, e)]
    if missing:
        raise ModelError(f"{module.__file__}: missing export {', '.join(missing)} (see models/contracts.py)")
    return module


def _imported(name: str) -> ModuleType:
    try:
        return importlib.import_module(name)
    except ImportError as error:
        if (error.name or "").partition(".")[0] != "models":
            raise
        spec = importlib.util.find_spec(name)
        raise ModelError(
            f"{spec.origin if spec else name}: there is no '{error.name}' of the harness, its models are imported as "
            "harness.models: write `from harness.models.contracts import ...`"
        ) from None
