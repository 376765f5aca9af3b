"""Axle forces and slip angles from measured motion, and the slope that starts an identification.

After Sun 2015, 3.40 to 3.48. The balance of forces and moments of a car on two axles is ``F_f + F_r = m a_y`` and
``l_f F_f - l_r F_r = J dr/dt``. The printed (3.40) and (3.41) leave out the factors ``l_r/L`` and ``l_f/L`` that follow
from it, and (3.42), (3.43) take ``dv_x/dt`` for the longitudinal acceleration ``a_x`` that (2.11), (2.12) have.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import xarray as xr

from harness.common.arrays import Floats
from harness.common.errors import UserError
from harness.models.effects._gravity import GRAVITY
from harness.models.signals import TRUTH
from harness.recordings.motion.kinematics import DERIVED, Sources

_SLOWEST = 3.0
"""m/s; below it slip angles are noise."""
_LINE = 0.7
"""Least correlation of force and slip angle at which the points are a line and not a cloud."""
_LINEAR = 0.4
"""Lateral force over load up to which the slope is taken; beyond it a tyre on dry road bends."""
_WINDOW = 0.3
"""s, over which what the axle forces take is smoothed."""


@dataclass(frozen=True)
class Car:
    """Masses and lengths in the force and moment balance of a car.

    Attributes:
        mass: kg.
        yaw_inertia: kg m^2.
        cog_to_front_axle, cog_to_rear_axle: m.
        cog_height: m; 0 leaves the transfer of load between the axles out.
    """

    mass: float
    yaw_inertia: float
    cog_to_front_axle: float
    cog_to_rear_axle: float
    cog_height: float = 0.0

    @property
    def wheelbase(self) -> float:
        """Distance of the axles in m."""
        return self.cog_to_front_axle + self.cog_to_rear_axle


@dataclass(frozen=True)
class Axles:
    """Lateral forces and loads in N and slip angles in rad of front and rear axle, each of shape ``(samples,)``."""

    force_front: Floats
    force_rear: Floats
    load_front: Floats
    load_rear: Floats
    slip_front: Floats
    slip_rear: Floats


@dataclass(frozen=True)
class Slope:
    """Straight line through lateral force over load against slip angle.

    Attributes:
        value: 1/rad, the normalised cornering stiffness (3.46, 3.47).
        correlation: Of force over load with the slip angle, 1 for points on the line.
        offset: rad, slip angle at which the line passes zero: steering offset, toe or bias of the lateral velocity.
        samples: Samples in the linear range.
    """

    value: float
    correlation: float
    offset: float
    samples: int


def axle_forces(car: Car, lateral_acceleration: Any, yaw_acceleration: Any) -> tuple[Any, Any]:
    """Return the lateral forces in N of front and rear axle (3.40, 3.41).

    Args:
        car: Masses and lengths.
        lateral_acceleration: Of the CoG, m/s^2, without gravity.
        yaw_acceleration: rad/s^2.
    """
    force, moment = car.mass * lateral_acceleration, car.yaw_inertia * yaw_acceleration
    return (
        (car.cog_to_rear_axle * force + moment) / car.wheelbase,
        (car.cog_to_front_axle * force - moment) / car.wheelbase,
    )


def axle_loads(car: Car, longitudinal_acceleration: Any) -> tuple[Any, Any]:
    """Return the vertical loads in N of front and rear axle (3.42, 3.43) at an acceleration of the CoG in m/s^2."""
    transfer = car.cog_height * car.mass * longitudinal_acceleration
    weight = car.mass * GRAVITY
    return (
        (car.cog_to_rear_axle * weight - transfer) / car.wheelbase,
        (car.cog_to_front_axle * weight + transfer) / car.wheelbase,
    )


def slip_angles(car: Car, road_wheel_angle: Any, v_x: Any, v_y: Any, yaw_rate: Any) -> tuple[Any, Any]:
    """Return the slip angles in rad of front and rear axle from the velocity of the CoG (3.44, 3.45).

    Positive when they make a force to the left, as everywhere in this project.
    """
    front = road_wheel_angle - np.arctan2(v_y + car.cog_to_front_axle * yaw_rate, v_x)
    return front, -np.arctan2(v_y - car.cog_to_rear_axle * yaw_rate, v_x)


def axle_curves(car: Car, signals: dict[str, Floats]) -> Axles:
    """Return forces, loads and slip angles along a recording; NaN where it is slower than 3 m/s.

    Args:
        car: Masses and lengths.
        signals: ``lateral_acceleration``, ``yaw_acceleration``, ``road_wheel_angle``, ``longitudinal_velocity``,
            ``lateral_velocity``, ``yaw_rate`` and, if known, ``longitudinal_acceleration``, at the CoG and in SI units.
    """
    v_x = np.where(signals["longitudinal_velocity"] > _SLOWEST, signals["longitudinal_velocity"], np.nan)
    forces = axle_forces(car, signals["lateral_acceleration"], signals["yaw_acceleration"])
    loads = axle_loads(car, signals.get("longitudinal_acceleration", np.zeros_like(v_x)))
    slips = slip_angles(car, signals["road_wheel_angle"], v_x, signals["lateral_velocity"], signals["yaw_rate"])
    return Axles(*forces, *loads, *slips)


def cornering_slope(slip: Floats, force: Floats, load: Floats) -> Slope | None:
    """Return the slope of force over load against slip in the linear range, as the start of an identification.

    Both carry errors, so the line is that of total least squares after scaling by the standard deviations (reduced
    major axis): regression of force on a noisy slip angle would come out too flat.

    Returns:
        The slope, or None if there are fewer than 20 samples or they scatter too much to show a rising line.
    """
    share = force / load
    rows = np.isfinite(slip) & np.isfinite(share)
    rows[rows] &= np.abs(share[rows]) < _LINEAR
    if rows.sum() < 20:
        return None
    x, y = slip[rows], share[rows]
    likeness = float(np.corrcoef(x, y)[0, 1])
    if not likeness > _LINE:
        return None
    value = float(y.std() / x.std())
    return Slope(
        value=value,
        correlation=likeness,
        offset=float(x.mean() - y.mean() / value),
        samples=int(rows.sum()),
    )


@dataclass(frozen=True)
class AxleCurve:
    """One axle's curve and the straight line through its beginning."""

    name: str
    slip: Floats
    share: Floats
    slope: Slope | None


def axles_of(recordings: Sequence[xr.Dataset], values: Mapping[str, float], where: str) -> list[AxleCurve]:
    """Return the curves of front and rear axle over some drives, and the slopes that start an identification.

    Args:
        recordings: The drives. What is not measured, or with gravity in it, is derived.
        values: Parameters of a car: masses and lengths.
        where: What errors begin with.

    Raises:
        UserError: If a parameter or a signal is missing.
    """
    needed = ("mass", "yaw_inertia", "cog_to_front_axle", "cog_to_rear_axle")
    missing = [n for n in needed if n not in values]
    if missing:
        raise UserError(f"{where}: lacks {', '.join(missing)}; axle curves need the set of a car")
    mass, inertia, front, rear = (values[n] for n in needed)
    car = Car(mass, inertia, front, rear, values.get("cog_height", 0.0))
    curves = [axle_curves(car, _smooth(recording, values, where)) for recording in recordings]
    axles = []
    for end in ("front", "rear"):
        slip, force, load = (
            np.concatenate([getattr(c, f"{kind}_{end}") for c in curves]) for kind in ("slip", "force", "load")
        )
        axles.append(AxleCurve(end, slip, force / load, cornering_slope(slip, force, load)))
    return axles


def _smooth(recording: xr.Dataset, values: Mapping[str, float], where: str) -> dict[str, Floats]:
    """Return the smoothed signals that axle curves take."""
    step = float(recording["time"][1] - recording["time"][0])
    signals = {n: s for n, s in signals_of(recording).items() if not recording[n].attrs.get("includes_gravity")}
    if "road_wheel_angle" not in signals and "steering_wheel_angle" in signals and "steering_ratio" in values:
        signals["road_wheel_angle"] = signals["steering_wheel_angle"] / values["steering_ratio"]
    for name in ("lateral_acceleration", "longitudinal_acceleration", "yaw_acceleration"):
        needs, compute = DERIVED[name]
        if name not in signals and any(all(n in signals for n in each) for each in needs):
            signals[name] = compute(Sources(signals, step, _WINDOW))
    wanted = (
        *("lateral_acceleration", "yaw_acceleration", "road_wheel_angle"),
        *("longitudinal_velocity", "lateral_velocity", "yaw_rate"),
    )
    absent = [n for n in wanted if n not in signals]
    if absent:
        raise UserError(f"{where}: axle curves take {', '.join(absent)}, which the recording lacks")
    smooth = Sources(signals, step, _WINDOW)
    return {n: smooth[n] for n in (*wanted, "longitudinal_acceleration") if n in signals}


def signals_of(recording: xr.Dataset) -> dict[str, Floats]:
    """Return the signals of a recording by name, without the truths that a simulation wrote next to them."""
    return {str(n): np.asarray(v.values) for n, v in recording.data_vars.items() if not str(n).startswith(TRUTH)}
