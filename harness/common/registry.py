"""Roles: find a component by its name, check its exports, suggest the closest name.

Of our own the folder is the registry; what else there is says ``harness.common.components``.
"""

from __future__ import annotations

import importlib
from dataclasses import dataclass
from types import ModuleType

from harness.common import components
from harness.common.errors import ModelError, closest


@dataclass(frozen=True)
class Role:
    """Role of the components of one kind.

    Attributes:
        package: The package of our own, or its dotted name where whoever declares the role must not import it.
        what: What one is, as messages call it.
        exports: Names that every one must define.
        contract: File that says what they are.
        word: What the role is called where components come from outside (``components.WORDS``); empty for a role of
            which there are our own only.
        instead: Name that one may define in place of ``exports``; empty for none.
    """

    package: ModuleType | str
    what: str
    exports: tuple[str, ...]
    contract: str = "models/contracts.py"
    word: str = ""
    instead: str = ""

    def names(self) -> list[str]:
        """Return the sorted names, whatever place they come from."""
        return list(self.components())

    def components(self) -> dict[str, components.Component]:
        """Return every component by its name, not imported.

        Raises:
            ModelError: If two places claim one name.
        """
        return components.find(self.word, self._package)

    def load(self, name: str, exports: tuple[str, ...] | None = None) -> ModuleType:
        """Import a component and check that it exports what its role requires.

        Args:
            name: Its name: the stem of its file, unless it was registered or declared under another.
            exports: Names the module must define; by default those of the role.

        Raises:
            ModelError: If there is none of that name (with the closest names) or an export is missing.
        """
        available = self.components()
        if name not in available:
            raise ModelError(f"unknown {self.what} '{name}'{closest(name, list(available))}")
        module = _imported(available[name])
        if exports is None:
            exports = () if self.instead and hasattr(module, self.instead) else self.exports
        missing = [e for e in exports if not hasattr(module, e)]
        if missing:
            raise ModelError(f"{available[name].place}: missing export {', '.join(missing)} (see {self.contract})")
        return module

    @property
    def _package(self) -> ModuleType:
        return importlib.import_module(self.package) if isinstance(self.package, str) else self.package


def _imported(component: components.Component) -> ModuleType:
    try:
        return component.load()
    except (ImportError, ModelError) as error:
        cause = error if isinstance(error, ImportError) else error.__cause__
        if not isinstance(cause, ImportError) or (cause.name or "").partition(".")[0] != "models":
            raise
        raise ModelError(
            f"{component.place}: there is no '{cause.name}' of the harness, its models are imported as "
            "harness.models: write `from harness.models.contracts import ...`"
        ) from None
