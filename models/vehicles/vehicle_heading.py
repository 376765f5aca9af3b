"""Heading of a vehicle by dead reckoning: the wheels' encoders tell its change, a gyro measures it (KIT 2015).

Exercise 2: ``theta(n+1) = theta(n) + d_theta(n) + v(n)``. The change of heading per sample that the encoders of the
left and right wheels give is the input; its noise is the process noise. The measured output is the heading that the
integrated gyro gives.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from models.contracts import Parameter

if TYPE_CHECKING:
    from models.assemble import Builder

STATES: tuple[str, ...] = ("heading",)
INPUTS: tuple[str, ...] = ("heading_increment",)
AXLES: dict[str, str] = {}
VALID: dict[str, float] = {"heading": 1e4}
PARAMETERS: tuple[Parameter, ...] = ()


def equations(v: Builder) -> None:
    """State the difference equation."""
    v.next_value("heading", v.state("heading") + v.input("heading_increment"))
