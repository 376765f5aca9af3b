"""The folder is the registry: find a file by its stem, check its exports, suggest the closest name."""

from __future__ import annotations

import difflib
import importlib.util
import pkgutil
from dataclasses import dataclass
from pathlib import Path
from types import ModuleType

from harness.common.errors import ModelError


def closest(word: str, choices: list[str] | tuple[str, ...]) -> str:
    """Return ``"; closest: a, b"`` for the choices that resemble the word, or the whole list if none does."""
    near = difflib.get_close_matches(word, choices, n=3, cutoff=0.5)
    if near:
        return f"; closest: {', '.join(near)}"
    return f"; there are: {', '.join(choices)}" if choices else "; there are none"


@dataclass(frozen=True)
class Role:
    """What the files of one package are for.

    Attributes:
        package: The package, or its dotted name where whoever declares the role must not import it.
        what: What one file is, as messages call it.
        exports: Names that every file must define.
        contract: File that says what they are.
    """

    package: ModuleType | str
    what: str
    exports: tuple[str, ...]
    contract: str = "models/contracts.py"

    def names(self) -> list[str]:
        """Return the sorted stems of the files."""
        return sorted(m.name for m in pkgutil.iter_modules(self._package.__path__) if not m.name.startswith("_"))

    def load(self, name: str, exports: tuple[str, ...] | None = None) -> ModuleType:
        """Import a file and check that it exports what its role requires.

        Args:
            name: Stem of the file.
            exports: Names the module must define; by default those of the role.

        Raises:
            ModelError: If there is no such file (with the closest names) or an export is missing.
        """
        available = self.names()
        if name not in available:
            raise ModelError(f"unknown {self.what} '{name}'{closest(name, available)}")
        module = _imported(f"{self._package.__name__}.{name}")
        missing = [e for e in (self.exports if exports is None else exports) if not hasattr(module, e)]
        if missing:
            raise ModelError(f"{module.__file__}: missing export {', '.join(missing)} (see {self.contract})")
        return module

    @property
    def folder(self) -> Path:
        """Folder of the files."""
        return Path(self._package.__path__[0])

    @property
    def _package(self) -> ModuleType:
        return importlib.import_module(self.package) if isinstance(self.package, str) else self.package


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
