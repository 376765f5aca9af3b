"""A parameter as a trace found it."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Value:
    """Value and standard error of a parameter in SI units; the error is NaN where there is none."""

    name: str
    unit: str
    value: float
    std: float
