"""Model description of an FMU: variables, interfaces and platforms, read by FMPy after the text has been checked."""

from __future__ import annotations

import io
import math
import posixpath
import zipfile
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

from harness.common.errors import UserError
from harness.external.fmu import archive

Interface = Literal["co-simulation", "model-exchange"]
INTERFACES: tuple[Interface, ...] = ("co-simulation", "model-exchange")

REALS = ("Real", "Float64")
"""Types of the variables that signals and parameters may be."""


@dataclass(frozen=True)
class Variable:
    """A variable of an FMU.

    Attributes:
        name: As the FMU states it.
        reference: Its value reference.
        type: As FMI calls it: ``Real``, ``Float64``, ``Boolean``.
        causality, variability: As FMI calls them.
        unit: As the FMU states it; empty where it states none.
        start, lower, upper: In that unit; NaN, or infinite, where it states none.
        description: In words.
        scalar: Whether it is no array.
    """

    name: str
    reference: int
    type: str
    causality: str
    variability: str
    unit: str = ""
    start: float = math.nan
    lower: float = -math.inf
    upper: float = math.inf
    description: str = ""
    scalar: bool = True

    @property
    def is_real(self) -> bool:
        """Whether it is one number with a decimal point."""
        return self.type in REALS and self.scalar

    @property
    def is_parameter(self) -> bool:
        """Whether a study may vary it."""
        adjustable = self.causality == "parameter" and self.variability in ("fixed", "tunable")
        return self.is_real and adjustable and math.isfinite(self.start)


@dataclass(frozen=True)
class BaseUnit:
    """A unit in base units of SI: ``factor`` times the value plus ``offset``."""

    exponents: tuple[tuple[str, int], ...]
    factor: float
    offset: float


@dataclass(frozen=True)
class FmuModel:
    """What an FMU says of itself.

    Attributes:
        path: Its file.
        version: 2 or 3.
        name, token, tool, description: Of the model; what the FMU wants to be instantiated with; what wrote it.
        identifiers: Of its library by interface.
        one_per_process, needs_tool, keeps_state: By interface: whether only one instance may be in a process, whether
            a program has to be installed, whether its state can be got and set.
        variables: By name.
        units: By name.
        states: Variables that are continuous states, in their order.
        derivatives, indicators: Number of continuous states, and of event indicators.
        fixed_step: Step of a co-simulation of FMI 3 that has one of its own, s; zero if it has none.
        log_categories: Names.
        platforms: Of its binaries.
        libraries: Names of the entries in ``binaries``.
        has_sources: Whether there is C code in it.
    """

    path: Path
    version: int
    name: str
    token: str
    tool: str
    description: str
    identifiers: Mapping[Interface, str]
    one_per_process: frozenset[Interface]
    needs_tool: frozenset[Interface]
    keeps_state: frozenset[Interface]
    variables: Mapping[str, Variable]
    units: Mapping[str, BaseUnit]
    states: tuple[str, ...]
    derivatives: int
    indicators: int
    fixed_step: float
    log_categories: tuple[str, ...]
    platforms: tuple[str, ...]
    libraries: frozenset[str]
    has_sources: bool

    def interface(self, wanted: str | None = None) -> Interface:
        """Return the interface that is used: co-simulation where there is a choice and none is stated.

        Raises:
            UserError: If it does not have that.
        """
        if wanted is None:
            return next(i for i in INTERFACES if i in self.identifiers)
        for each in INTERFACES:
            if each == wanted and each in self.identifiers:
                return each
        raise UserError(f"{self.path}: offers {' and '.join(self.identifiers)}, not {wanted}")

    def library(self, interface: Interface) -> str:
        """Return the entry that is this platform's library.

        Raises:
            UserError: If there is none.
        """
        here, extension = platform_of(self.version)
        entry = f"binaries/{here}/{self.identifiers[interface]}{extension}"
        if entry in self.libraries:
            return entry
        if self.platforms:
            what = f"its binaries are for {', '.join(self.platforms)}"
        else:
            what = "it has C code only; compile it first: fmpy compile FILE" if self.has_sources else "it has no binary"
        raise UserError(f"{self.path}: no binary for this platform ({entry}); {what}")


def fmpy() -> Any:
    """Return FMPy.

    Raises:
        UserError: If it is not installed.
    """
    try:
        import fmpy
        import fmpy.model_description
    except ImportError:
        raise UserError(
            "FMUs are read with FMPy, which is not installed: pip install 'robustness-harness[fmu]'"
        ) from None
    return fmpy


def platform_of(version: int) -> tuple[str, str]:
    """Return what an FMU calls this platform, and the extension of its libraries."""
    installed = fmpy()
    return (installed.platform if version == 2 else installed.platform_tuple), installed.sharedLibraryExtension


def read_model(path: Path) -> FmuModel:
    """Read what an FMU says of itself; nothing of it is unpacked or run.

    Raises:
        UserError: If it is none, would do harm, or is of a version or kind that cannot be used.
    """
    with archive.opened(path) as zipped:
        text = archive.contents(zipped, archive.DESCRIPTION, path, archive.LARGEST_DESCRIPTION)
        files = zipped.namelist()
    _refuse_version(_checked_root(text, path), path)
    try:
        described = fmpy().model_description.read_model_description(_alone(text), validate=False)
        return _model(described, files, path)
    except UserError:
        raise
    except Exception as error:  # FMPy raises what its parts raise
        raise UserError(
            f"{path}: its {archive.DESCRIPTION} cannot be read: {' '.join(str(error).split())[:300]}"
        ) from None


def _alone(text: bytes) -> io.BytesIO:
    """Return a zip that holds a model description only: FMPy reads no other entry that nobody has checked."""
    buffer = io.BytesIO()
    with zipfile.ZipFile(buffer, "w") as zipped:
        zipped.writestr(archive.DESCRIPTION, text)
    return buffer


def _checked_root(text: bytes, path: Path) -> Any:
    """Return the root element; a text with a document type, which entities come with, is refused."""
    fmpy()
    from lxml import etree

    parser = etree.XMLParser(resolve_entities=False, load_dtd=False, no_network=True, huge_tree=False)
    try:
        root = etree.fromstring(text, parser)
    except (etree.XMLSyntaxError, ValueError) as error:
        raise UserError(f"{path}: its {archive.DESCRIPTION} is no XML: {' '.join(str(error).split())[:200]}") from None
    if root.getroottree().docinfo.doctype:
        raise UserError(f"{path}: its {archive.DESCRIPTION} declares a document type, which none of an FMU needs")
    if root.tag != "fmiModelDescription":
        raise UserError(f"{path}: its {archive.DESCRIPTION} describes no FMU, but <{str(root.tag)[:100]}>")
    return root


def _refuse_version(root: Any, path: Path) -> None:
    version = root.get("fmiVersion", "")
    if version.startswith("1."):
        raise UserError(f"{path}: is of FMI {version}; export it as FMI 2.0 or 3.0")
    if version != "2.0" and not (version.startswith("3.0") and version[3:4] in ("", ".")):
        raise UserError(f"{path}: is of FMI {version[:20] or 'without a version'}; 2.0 and 3.0 are known")


def _model(described: Any, files: list[str], path: Path) -> FmuModel:
    version = described.fmiMajorVersion
    parts = {"co-simulation": described.coSimulation, "model-exchange": described.modelExchange}
    offered: dict[Interface, Any] = {name: parts[name] for name in INTERFACES if parts[name] is not None}
    if not offered:
        raise UserError(f"{path}: offers neither co-simulation nor model exchange, which are what can be used")
    for part in offered.values():
        if not part.modelIdentifier or not set(part.modelIdentifier).isdisjoint("/\\\0"):
            raise UserError(f"{path}: names its library {part.modelIdentifier!r}, which no file is called")
    variables: dict[str, Variable] = {}
    for each in described.modelVariables:
        if each.name in variables:
            raise UserError(f"{path}: its variable '{each.name[:200]}' is there twice")
        variables[each.name] = _variable(each)
    binaries = [name for name in files if name.startswith("binaries/") and not name.endswith("/")]
    return FmuModel(
        path=path,
        version=version,
        name=described.modelName or path.stem,
        token=described.guid or "",
        tool=described.generationTool or "",
        description=described.description or "",
        identifiers={name: part.modelIdentifier for name, part in offered.items()},
        one_per_process=frozenset(n for n, part in offered.items() if part.canBeInstantiatedOnlyOncePerProcess),
        needs_tool=frozenset(n for n, part in offered.items() if part.needsExecutionTool),
        keeps_state=frozenset(n for n, part in offered.items() if part.canGetAndSetFMUstate),
        variables=variables,
        units={unit.name: _base(unit.baseUnit) for unit in described.unitDefinitions if unit.baseUnit is not None},
        states=tuple(each.variable.derivative.name for each in described.derivatives if each.variable.derivative),
        derivatives=described.numberOfContinuousStates,
        indicators=described.numberOfEventIndicators,
        fixed_step=float(getattr(described.coSimulation, "fixedInternalStepSize", None) or 0.0),
        log_categories=tuple(category.name for category in described.logCategories),
        platforms=tuple(sorted({posixpath.dirname(name).split("/")[1] for name in binaries if name.count("/") > 1})),
        libraries=frozenset(binaries),
        has_sources=any(name.startswith("sources/") and name.endswith(".c") for name in files),
    )


def _variable(each: Any) -> Variable:
    declared = each.declaredType
    is_number = each.type in REALS and not each.dimensions

    def number(name: str, otherwise: float) -> float:
        text = getattr(each, name) or getattr(declared, name, None)
        return float(text) if text is not None and is_number else otherwise

    return Variable(
        name=each.name,
        reference=each.valueReference,
        type=each.type,
        causality=each.causality or "local",
        variability=each.variability or "",
        unit=each.unit or getattr(declared, "unit", None) or "",
        start=float(each.start) if each.start not in (None, "") and is_number else math.nan,
        lower=number("min", -math.inf),
        upper=number("max", math.inf),
        description=" ".join((each.description or "").split()),
        scalar=not each.dimensions,
    )


def _base(unit: Any) -> BaseUnit:
    names = ("kg", "m", "s", "A", "K", "mol", "cd", "rad")
    exponents = tuple((name, getattr(unit, name)) for name in names if getattr(unit, name))
    return BaseUnit(exponents, unit.factor, unit.offset)
