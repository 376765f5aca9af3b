"""The scalar system on which the lecture computes a Kalman filter by hand: ``x(n+1) = 0.5 x(n) + u(n) + v(n)``.

KIT 2015, exercise 1. It is no vehicle, but small enough to check every number of a filter.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from models.contracts import Parameter

if TYPE_CHECKING:
    from models.assemble import Builder

STATES: tuple[str, ...] = ("example_state",)
INPUTS: tuple[str, ...] = ("example_input",)
AXLES: dict[str, str] = {}
VALID: dict[str, float] = {"example_state": 1e6}

PARAMETERS: tuple[Parameter, ...] = (
    Parameter("transition", "A", "dimensionless", -2.0, 2.0, "share of the state that is left one sample later"),
)


def equations(v: Builder) -> None:
    """State the difference equation."""
    v.next_value("example_state", v.p("transition") * v.state("example_state") + v.input("example_input"))
