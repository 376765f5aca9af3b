"""Kinematic relations between the signals of a recording, which hold whatever the vehicle.

Each relation computes a measured signal from others. ``exact`` relations hold for any rigid body in the plane, so that
slope 1, delay 0 and offset 0 are expected; the others neglect something, and state how much that may be.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from harness.common.arrays import Floats
from harness.models.signals import SIGNALS
from harness.recordings.motion.kinematics import Sources, velocity_of_pose

MOVING = 2.0
"""m/s above which the course over ground is that of the vehicle and not that of the noise."""

_BACKWARDS = 0.1
"""m/s beyond which a negative speed is one."""
_UNSIGNED = ("speed", "longitudinal_velocity", "speed_tractor")


@dataclass(frozen=True)
class Relation:
    """One signal computed from others.

    Attributes:
        signal: The signal that is checked.
        needs: The signals it is computed from.
        formula: How, in words for the report.
        compute: The function; takes smoothed signals and their derivatives.
        exact: Whether it holds for any motion in the plane, so that delay and offset are judged as well.
        arm: What a lever arm between the sensors would add per metre; None if nothing. Its signals are not needed.
        late: What positions would add that are a second later than the heading; None if nothing.
        slope: Slope to be expected, and by which factor it may be off for what the relation neglects.
        or_slope: Another one, if the signal is recorded in one of two ways.
        misfit: Share of the signal that it neglects.
        bank: Standard deviation in SI units of what the signal holds in proportion to itself beyond the relation.
        lag: Standard deviation in s of how late one side is for what the relation neglects; infinite: it tells no
            delay.
        through_zero: Whether both sides are zero together, so that there is no offset (a speed).
        circular: Whether both sides are angles, alike if they differ by full turns.
        order: Derivative of the signal that is compared.
        where: In which samples it holds; empty: in all.
    """

    signal: str
    needs: tuple[str, ...]
    formula: str
    compute: Callable[[Sources], Floats]
    exact: bool = True
    arm: Callable[[Sources], Floats] | None = None
    late: Callable[[Sources], Floats] | None = None
    slope: tuple[float, float] = (1.0, 1.0)
    or_slope: tuple[float, float] | None = None
    misfit: float = 0.05
    bank: float = 0.0
    lag: float = 0.0
    through_zero: bool = False
    circular: bool = False
    order: int = 0
    where: str = ""

    def __reduce__(self) -> tuple[Callable[..., Relation], tuple[object, ...]]:
        """Pickle it by its place among ``RELATIONS``, whose functions have no names."""
        return relation_of, (self.signal, self.needs, self.formula)

    @property
    def signals(self) -> tuple[str, ...]:
        """All signals that take part."""
        return (self.signal, *self.needs)

    @property
    def quasi_static(self) -> bool:
        """Whether it neglects how slip angles build up, so that it holds for slow motion alone."""
        return not self.exact and not self.circular and self.lag >= _SIDESLIP_LAG

    @cached_property
    def highest(self) -> int:
        """The highest derivative of a signal that is compared."""
        asked = _Asked()
        asked.rate(self.signal, self.order)
        for side in (self.compute, self.arm, self.late):
            if side is not None:
                side(asked)  # type: ignore[arg-type]
        return asked.highest

    def expected(self, slope: float) -> tuple[float, float]:
        """Return the slope to be expected, of two the one that a slope found fits better, and its factor."""
        if self.or_slope is None or slope == 0:
            return self.slope
        return min(self.slope, self.or_slope, key=lambda e: abs(np.log(abs(slope) / e[0])) / np.log(e[1]))


class _Asked:
    """Signals that note which derivatives they are asked for."""

    def __init__(self) -> None:
        self.signals, self.highest = SIGNALS, 0

    def __getitem__(self, name: str) -> Floats:
        return self.rate(name, 0)

    def rate(self, name: str, derivative: int = 1) -> Floats:
        """Return one sample of it."""
        self.highest = max(self.highest, derivative)
        return np.ones(1)


def ground_speed(s: Sources) -> Floats:
    """Return the speed over ground in m/s, from positions."""
    return np.hypot(s.rate("position_x"), s.rate("position_y"))


def _signed(speed: str) -> Callable[[Sources], Floats]:
    """Return the speed over ground, with the sign of a speed."""
    return lambda s: np.where(s[speed] < -_BACKWARDS, -1.0, 1.0) * ground_speed(s)


def _course(s: Sources) -> Floats:
    """Return the course over ground in rad, that of the rear where a speed is negative."""
    back = next((s[n] < -_BACKWARDS for n in _UNSIGNED if n in s.signals), False)
    course = np.arctan2(s.rate("position_y"), s.rate("position_x")) + np.where(back, np.pi, 0.0)
    return np.where(ground_speed(s) > MOVING, course, np.nan)


def _course_rate(s: Sources) -> Floats:
    """Return the rate of the course in rad/s, ``(x' y'' - y' x'') / v^2``, where the vehicle moves."""
    v_x, v_y, a_x, a_y = (s.rate(f"position_{axis}", order) for order in (1, 2) for axis in "xy")
    squared = v_x**2 + v_y**2
    return np.where(squared > MOVING**2, (v_x * a_y - v_y * a_x) / np.maximum(squared, MOVING**2), np.nan)


def _product(first: str, second: str) -> Callable[[Sources], Floats]:
    return lambda s: s[first] * s[second]


def _rate_of(signal: str) -> Callable[[Sources], Floats]:
    return lambda s: s.rate(signal)


def _turning(signal: str) -> Callable[[Sources], Floats]:
    """Return what a sensor one metre to the right adds to a speed; nothing where the signal is not recorded."""
    return lambda s: s[signal] if signal in s.signals else np.full(1, np.nan)


_SIDESLIP_LAG = 0.08
"""s by which the course turns before or after the heading: how far the CoG is from the neutral point, over v."""
_PLACE = ("position_x", "position_y")
_POSE = (*_PLACE, "heading")
_SPEEDS = (("", "longitudinal_velocity"), ("", "speed"), ("_tractor", "speed_tractor"), ("_tractor", "speed"))
_STEERING = {"road_wheel_angle": ((0.3, 3.0), None), "steering_wheel_angle": ((0.02, 2.2), (0.25, 1.25))}
"""Yaw rate over speed and angle in 1/m, one over wheelbase and ratio, and the factor by which vehicles differ.

Some record the angle of the road wheels as that of the steering wheel, of a vehicle whose steering ratio is then 1.
"""


def _yaw_rates() -> list[Relation]:
    """Return the relations of yaw rates."""
    relations = []
    for rate in ("yaw_rate", "yaw_rate_tractor"):
        relations += [
            Relation(rate, ("heading",), "rate of the heading", _rate_of("heading")),
            Relation(rate, _PLACE, "rate of the course over ground", _course_rate, exact=False, slope=(1.0, 1.04),
                     misfit=0.2, lag=_SIDESLIP_LAG, where=f"faster than {MOVING:g} m/s"),
        ]  # fmt: skip
    relations.append(
        Relation("yaw_rate_trailer", ("yaw_rate_tractor",), "yaw rate of the tractor", lambda s: s["yaw_rate_tractor"],
                 exact=False, slope=(1.0, 1.05), misfit=0.4, lag=np.inf)
    )  # fmt: skip
    relations.append(
        Relation("articulation_angle", ("yaw_rate_tractor", "yaw_rate_trailer"),
                 "its rate from the difference of the yaw rates",
                 lambda s: s["yaw_rate_trailer"] - s["yaw_rate_tractor"], order=1)
    )  # fmt: skip
    relations.append(Relation("yaw_acceleration", ("yaw_rate",), "rate of the yaw rate", _rate_of("yaw_rate")))
    for angle, (expected, of_wheels) in _STEERING.items():
        for rate, speed in (("yaw_rate", "longitudinal_velocity"), ("yaw_rate", "speed"),
                            ("yaw_rate_tractor", "speed_tractor"), ("yaw_rate_tractor", "speed")):  # fmt: skip
            words = f"in proportion to v_x times {angle.replace('_', ' ')}"
            relations.append(
                Relation(rate, (speed, angle), words, _product(speed, angle), exact=False, slope=expected,
                         or_slope=of_wheels, misfit=0.3, lag=np.inf)
            )  # fmt: skip
    return relations


def _speeds() -> list[Relation]:
    """Return the relations of speeds and velocities."""
    return [
        Relation("longitudinal_velocity", _POSE, "rate of the position along the heading",
                 lambda s: velocity_of_pose(s)[0], arm=_turning("yaw_rate"), through_zero=True),
        Relation("lateral_velocity", _POSE, "rate of the position across the heading",
                 lambda s: velocity_of_pose(s)[1], arm=lambda s: s.rate("heading"), exact=False,
                 late=lambda s: ground_speed(s) * s.rate("heading"), slope=(1.0, 1.15), misfit=0.3, lag=np.inf),
        *(
            Relation(name, _PLACE, "speed over ground", _signed(name), arm=_turning(rate), through_zero=True)
            for name, rate in (("speed", "yaw_rate"), ("speed_tractor", "yaw_rate_tractor"),
                               ("longitudinal_velocity", "yaw_rate"))
        ),
        Relation("speed", ("longitudinal_velocity",), "longitudinal velocity", lambda s: s["longitudinal_velocity"],
                 through_zero=True, arm=_turning("yaw_rate")),
        Relation("speed_tractor", ("speed",), "speed", lambda s: s["speed"], exact=False, slope=(1.0, 1.03),
                 lag=0.02, through_zero=True),
        Relation("sideslip_angle", ("longitudinal_velocity", "lateral_velocity"), "arctan(v_y / v_x)",
                 lambda s: np.arctan2(s["lateral_velocity"], s["longitudinal_velocity"])),
        Relation("heading", _PLACE, "course over ground", _course, exact=False, lag=np.inf, circular=True,
                 where=f"faster than {MOVING:g} m/s"),
    ]  # fmt: skip


_BANK = 9.81 * np.radians(0.5)
"""m/s^2; what the bank of a road that is built for its curvature adds along with the lateral acceleration."""

_LEANING = (1.04, 1.03)
"""Slope of a lateral accelerometer that leans with the body: up to 7 degrees per g add up to 12 %."""


def _accelerations() -> list[Relation]:
    """Return the relations of accelerations."""
    motion = ("longitudinal_velocity", "lateral_velocity", "yaw_rate")
    relations = [
        Relation("lateral_acceleration", motion, "dv_y/dt + v_x r",
                 lambda s: s.rate("lateral_velocity") + s["longitudinal_velocity"] * s["yaw_rate"],
                 arm=lambda s: s.rate("yaw_rate"), slope=_LEANING, bank=_BANK),
        Relation("longitudinal_acceleration", motion, "dv_x/dt - v_y r",
                 lambda s: s.rate("longitudinal_velocity") - s["lateral_velocity"] * s["yaw_rate"],
                 arm=lambda s: -(s["yaw_rate"] ** 2), slope=(1.0, 1.05)),
        Relation("longitudinal_acceleration", ("speed",), "dv/dt", _rate_of("speed"), exact=False, slope=(1.0, 1.08),
                 misfit=0.2, lag=0.03),
    ]  # fmt: skip
    for body, speed in (*_SPEEDS, ("_trailer", "speed"), ("_trailer", "speed_tractor")):
        rate = f"yaw_rate{body}"
        relations.append(
            Relation(f"lateral_acceleration{body}", (speed, rate), "v_x r", _product(speed, rate), exact=False,
                     slope=(1.0, 1.06), misfit=0.25, bank=_BANK, lag=_SIDESLIP_LAG)
        )  # fmt: skip
    for body in ("", "_tractor"):
        relations.append(
            Relation(f"lateral_acceleration{body}", _PLACE, "speed over ground times the rate of the course",
                     lambda s: ground_speed(s) * _course_rate(s), exact=False, slope=(1.0, 1.06), misfit=0.25,
                     bank=_BANK, lag=2 * _SIDESLIP_LAG)
        )  # fmt: skip
    return relations


RELATIONS: tuple[Relation, ...] = tuple(
    sorted((*_yaw_rates(), *_speeds(), *_accelerations()), key=lambda relation: not relation.exact)
)
"""Every relation, the exact ones first; of those with the same signal and formula the first that is recorded counts."""


def relation_of(signal: str, needs: tuple[str, ...], formula: str) -> Relation:
    """Return a relation of ``RELATIONS``."""
    return next(r for r in RELATIONS if (r.signal, r.needs, r.formula) == (signal, needs, formula))
