"""Description of a plant of somebody else: its signals, parameters and files, as a study and its store have it."""

from __future__ import annotations

import hashlib
import math
from collections.abc import Mapping
from dataclasses import dataclass, field, fields
from pathlib import Path
from typing import Any, Literal

from harness.common.errors import UserError

Kind = Literal["fmu", "python"]


@dataclass(frozen=True)
class Port:
    """A signal and the variable that carries it.

    Attributes:
        signal: Name in ``models/signals.py``; of a disturbance any.
        variable: Name of the variable in the plant.
        unit: SI unit of the signal.
        scale, offset: The signal in SI is ``scale`` times the variable plus ``offset``.
    """

    signal: str
    variable: str
    unit: str
    scale: float = 1.0
    offset: float = 0.0


@dataclass(frozen=True)
class ExternalParameter:
    """A parameter of the plant, in SI.

    Attributes:
        name: In studies.
        variable: In the plant.
        unit: SI unit.
        value: Where the plant starts if nothing else is stated.
        lower, upper: Bounds, infinite where the plant states none.
        scale, offset: As of a port.
        meaning: In words, as the plant states it.
    """

    name: str
    variable: str
    unit: str
    value: float
    lower: float = -math.inf
    upper: float = math.inf
    scale: float = 1.0
    offset: float = 0.0
    meaning: str = ""


@dataclass(frozen=True)
class Description:
    """What a study knows of a plant without its file.

    Attributes:
        kind: What it is.
        file: FMU, or ``module:Class``, as the study names it.
        digests: SHA-256 of each file that decides what it does, by name.
        inputs: What a drive gives it.
        outputs: What it publishes: sensors and targets are among them.
        disturbances: Inputs that take process noise.
        parameters: What factors may vary.
        limits: Largest magnitude in SI by published signal, beyond which it is out of control.
        wheelbase, steering_ratio: For drives that ask for a lateral acceleration; in m, and steering wheel angle over
            the angle of the road wheels. ``None``: that of the belief.
        facts: What else there is to say, such as the version of FMI.
    """

    kind: Kind
    file: str
    digests: dict[str, str] = field(default_factory=dict)
    inputs: tuple[Port, ...] = ()
    outputs: tuple[Port, ...] = ()
    disturbances: tuple[Port, ...] = ()
    parameters: tuple[ExternalParameter, ...] = ()
    limits: dict[str, float] = field(default_factory=dict)
    wheelbase: float | None = None
    steering_ratio: float | None = None
    facts: dict[str, str] = field(default_factory=dict)

    def as_dict(self) -> dict[str, Any]:
        """Return it in numbers and text that JSON and TOML know; what is at its default is absent."""
        return _plain(self)

    @classmethod
    def of(cls, content: Mapping[str, Any]) -> Description:
        """Return that which ``as_dict`` wrote.

        Raises:
            UserError: If it is another's content.
        """
        try:
            ports = {
                name: tuple(Port(**entry) for entry in content.get(name, ()))
                for name in ("inputs", "outputs", "disturbances")
            }
            parameters = tuple(ExternalParameter(**entry) for entry in content.get("parameters", ()))
            return cls(**{**content, **ports, "parameters": parameters})
        except (TypeError, AttributeError) as error:
            raise UserError(f"this describes no plant: {error}") from None


def refuse_unfit(description: Description, where: str) -> None:
    """Refuse sizes, limits, units and bounds that no plant has.

    Args:
        description: Of a plant.
        where: File, named in the error.

    Raises:
        UserError: If one of them is out of its range, in one line with its key.
    """
    table = "vehicle." if description.kind == "fmu" else ""
    sizes = {f"{table}{name}": getattr(description, name) for name in ("wheelbase", "steering_ratio")}
    positive = sizes | {f"limits.{name}": limit for name, limit in description.limits.items()}
    for key, value in positive.items():
        if value is not None and not 0.0 < value < math.inf:
            raise UserError(f"{where}: {key}: must be positive and finite, got {value:g}")
    for group in ("inputs", "outputs", "disturbances"):
        for port in getattr(description, group):
            _refuse_unfit_scale(port, f"{where}: {group}.{port.signal}")
    for p in description.parameters:
        refuse_unfit_parameter(p, f"{where}: parameters.{p.name}")


def refuse_unfit_parameter(p: ExternalParameter, key: str) -> None:
    """Refuse a parameter whose unit, bounds or start cannot be.

    Raises:
        UserError: If one of them cannot.
    """
    _refuse_unfit_scale(p, key)
    if not p.lower <= p.upper:
        raise UserError(f"{key}: its lower bound {p.lower:g} is above its upper one {p.upper:g}")
    if not p.lower <= p.value <= p.upper:
        raise UserError(f"{key}: it starts at {p.value:g} {p.unit}, outside its bounds {p.lower:g} to {p.upper:g}")


def _refuse_unfit_scale(entry: Port | ExternalParameter, key: str) -> None:
    if not math.isfinite(entry.scale) or entry.scale == 0.0 or not math.isfinite(entry.offset):
        raise UserError(
            f"{key}: the unit of '{entry.variable}' is {entry.scale:g} times the SI unit, offset {entry.offset:g}, "
            "which says nothing of its size; state another unit"
        )


def _plain(record: Any) -> dict[str, Any]:
    """Return a record's fields that are not at their default, records in them alike."""
    content: dict[str, Any] = {}
    for each in fields(record):
        value = getattr(record, each.name)
        default = each.default_factory() if callable(each.default_factory) else each.default
        if value == default:
            continue
        content[each.name] = [_plain(entry) for entry in value] if isinstance(value, tuple) else value
    return content


def digest_of(path: Path) -> str:
    """Return the SHA-256 of a file.

    Raises:
        UserError: If it cannot be read.
    """
    try:
        with path.open("rb") as file:
            return hashlib.file_digest(file, "sha256").hexdigest()
    except OSError as error:
        raise UserError(f"{path}: {error.strerror}") from error
