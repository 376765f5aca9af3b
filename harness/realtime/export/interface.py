"""Names, units and frames of what an exported estimator gets and gives, as C identifiers."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

from harness.engine.c99.functions import RESERVED
from harness.engine.compile import CompiledModel
from harness.models.signals import signal_attributes


@dataclass(frozen=True)
class Quantity:
    """A number that goes in or comes out.

    Attributes:
        name: Word used in studies.
        field: C identifier.
        says: Unit, frame and meaning.
        value: What the study believes, of what it states.
    """

    name: str
    field: str
    says: str
    value: float | None = None

    @property
    def unit(self) -> str:
        """Unit, 1 of what has none."""
        return self.says.split(";")[0]


@dataclass(frozen=True)
class Interface:
    """All quantities of an estimator, in the order of the arrays of its kernels.

    Attributes:
        inputs, measurements, estimates, states: Signals.
        parameters: Of the vehicle.
    """

    inputs: tuple[Quantity, ...]
    measurements: tuple[Quantity, ...]
    estimates: tuple[Quantity, ...]
    states: tuple[Quantity, ...]
    parameters: tuple[Quantity, ...]


def interface_of(compiled: CompiledModel, values: Sequence[float]) -> Interface:
    """Return the quantities of an estimator.

    Args:
        compiled: What it believes.
        values: Of its parameters.
    """
    model = compiled.model
    groups = (model.inputs, model.outputs, compiled.signal_names, model.states)
    inputs, measurements, estimates, states = map(of_signals, groups)
    return Interface(inputs, measurements, estimates, states, of_parameters(compiled, values))


def of_signals(names: Iterable[str]) -> tuple[Quantity, ...]:
    """Return the quantities that signals are."""
    return _quantities((n, _of_signal(n)) for n in names)


def of_parameters(compiled: CompiledModel, values: Sequence[float]) -> tuple[Quantity, ...]:
    """Return the quantities that the parameters of a model are, with their values."""
    return _quantities(((p.name, _joined(p.unit, "", p.meaning)) for p in compiled.model.parameters), values)


def _of_signal(name: str) -> str:
    about: Mapping[str, str] = signal_attributes(name)
    return _joined(about["units"], about["frame"], about["long_name"])


def _joined(unit: str, frame: str, meaning: str) -> str:
    parts = [unit or "1", f"frame {frame}" if frame else "", meaning]
    return "; ".join(part for part in parts if part).replace("*/", "* /")


def _quantities(described: Iterable[tuple[str, str]], values: Sequence[float] = ()) -> tuple[Quantity, ...]:
    """Return quantities with fields that no two share."""
    taken: set[str] = set()
    quantities = []
    for place, (name, says) in enumerate(described):
        field = re.sub(r"\W+", "_", name, flags=re.ASCII)
        field = f"n_{field}" if field[:1].isdigit() else field
        while field in taken or field in RESERVED:
            field += "_"
        taken.add(field)
        quantities.append(Quantity(name, field, says, float(values[place]) if len(values) else None))
    return tuple(quantities)


TAKEN = RESERVED | {"cells", "estimator", "given", "line", "main", "number", "results", "step", "steps"}
"""Names that what comes with an estimator has itself."""


def identifier(name: str) -> str:
    """Return a name as a C identifier, for an estimator."""
    word = re.sub(r"\W+", "_", name, flags=re.ASCII).strip("_").lower()
    word = f"n_{word}" if word[:1].isdigit() else word
    return f"{word}_filter".strip("_") if word in TAKEN or not word else word
