"""A trust monitor as a file: its bounds, the envelope of its study, and how often it was right there."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass, fields
from pathlib import Path
from typing import Any

import numpy as np

from harness.common.errors import UserError
from harness.common.files import parse_toml, read_text, toml_text
from harness.runner.contract import Filter
from harness.runner.monitor import Bounds, bounds_of

Range = tuple[float, float]


@dataclass(frozen=True)
class Monitor:
    """A monitor of one estimator of one study; ``harness monitor`` writes it.

    Attributes:
        study: Digest of the study.
        estimator: Its name there.
        step: Sample time in s.
        window: Samples that averages go over.
        presence: Least share of samples with a measurement.
        nis: Bounds of the NIS in standard deviations of its average.
        bias: Bound of each measurement's innovation, in the same.
        inputs, rates, measurements, estimates: Range of each in the runs in which the study kept its limits, SI; rates
            per s.
        says: How often it was right, in sentences.
    """

    study: str
    estimator: str
    step: float
    window: int
    presence: float
    nis: Range
    bias: Mapping[str, float]
    inputs: Mapping[str, Range]
    rates: Mapping[str, Range]
    measurements: Mapping[str, Range]
    estimates: Mapping[str, Range]
    says: Sequence[str]

    @property
    def bounds(self) -> Bounds:
        """What its kernel reads."""
        rates = [(low * self.step, high * self.step) for low, high in self.rates.values()]
        ranges = [*self.inputs.values(), *rates, *self.measurements.values(), *self.estimates.values()]
        lowest, highest = np.ascontiguousarray(np.array(ranges, dtype=float).T)
        return bounds_of(self.window, self.nis, list(self.bias.values()), self.presence, lowest, highest)

    @property
    def text(self) -> str:
        """The file."""
        return toml_text({k: list(v) if isinstance(v, tuple) else v for k, v in asdict(self).items()})


def read_monitor(path: Path, study: str, name: str, estimator: Filter) -> Monitor:
    """Return the monitor in a file.

    Args:
        path: The file.
        study: Digest of the study that it has to be of.
        name: Of the estimator that it has to be of.
        estimator: That.

    Raises:
        UserError: If it is none, or one of something else.
    """
    table = parse_toml(read_text(path), str(path))
    names = {f.name for f in fields(Monitor)}
    if set(table) != names:
        off = sorted(set(table) ^ names)[0]
        state = "is unknown" if off in table else "is missing"
        raise UserError(f"{path}: key '{off}' {state}; give the file that harness monitor wrote")
    if (table["study"], table["estimator"]) != (study, name):
        raise UserError(
            f"{path}: it was counted on estimator '{table['estimator']}' of another study or belief than that of "
            f"'{name}' here; count it again: harness monitor STUDY --estimator '{name}', with the same "
            "--parameters"
        )
    inputs, outputs = estimator.ports.inputs, estimator.ports.outputs
    groups: dict[str, Iterable[str]] = {"bias": outputs, "inputs": inputs, "rates": inputs, "measurements": outputs}
    groups["estimates"] = estimator.signals
    for key, expected in groups.items():
        if not isinstance(table[key], dict) or list(table[key]) != list(expected):
            raise UserError(f"{path}: {key}: expected {', '.join(expected) or 'nothing'} in this order")
    for key in ("inputs", "rates", "measurements", "estimates"):
        table[key] = {name: _range(value, f"{path}: {key}.{name}") for name, value in table[key].items()}
    numbers = {key: table[key] for key in ("step", "window", "presence")}
    numbers |= {f"bias.{name}": value for name, value in table["bias"].items()}
    for key, value in numbers.items():
        if isinstance(value, bool) or not isinstance(value, int | float) or not 0 < value < math.inf:
            raise UserError(f"{path}: {key}: expected a number above 0, not {value!r}")
    nis = _range(table["nis"], f"{path}: nis")
    if not nis[0] < 0.0 < nis[1]:
        raise UserError(f"{path}: nis: expected a number below 0 and one above it, not {list(nis)}")
    if not isinstance(table["says"], list) or not all(isinstance(s, str) for s in table["says"]):
        raise UserError(f"{path}: says: expected a list of sentences")
    return Monitor(**{**table, "nis": nis})


def _range(value: Any, where: str) -> Range:
    """Return two numbers in order.

    Raises:
        UserError: If these are none.
    """
    is_pair = isinstance(value, list) and len(value) == 2
    numbers = [float(v) for v in value if isinstance(v, int | float) and not isinstance(v, bool)] if is_pair else []
    if len(numbers) != 2 or not numbers[0] <= numbers[1]:
        raise UserError(f"{where}: expected two numbers, the smaller one first, not {value!r}")
    return numbers[0], numbers[1]
