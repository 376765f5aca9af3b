"""The multi-body car of ``commonroad-vehicle-models`` (29 states, BMW 320i) as a realistic plant nobody here wrote.

Equations, tyres and parameters are those of the package (Althoff and Wuersching 2020); from here are the driver's
pedals, the bank of the road as a force and moment on the body, and what may change. Its axes have z down, so that its
roll angle is positive to the right; all in the plane has the signs of ISO 8855, since the car is symmetric.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np
from vehiclemodels.init_mb import init_mb
from vehiclemodels.parameters_vehicle2 import parameters_vehicle2
from vehiclemodels.vehicle_dynamics_mb import vehicle_dynamics_mb

from bench.real.driver import Drive
from bench.real.sensors import CAR, Logger
from bench.real.vehicle import GRAVITY, STEP, Floats

EVERY = 4
"""Steps of the other plants to one of this."""

RATIO = 16.0
SPEED_GAIN = 2.0
ROLL_ARM = 0.4
"""m; CoG of the body above its roll axis, from which the accelerometer's height counts."""

BUILT: dict[str, float] = {"mass": 1.0, "yaw_inertia": 1.0, "grip": 1.0, "stiffness": 1.0, "roll_stiffness": 1.0}
BUILT |= {"shift": 0.0, "pull": 0.0, "steering_ratio": RATIO}
"""Factors on the package's values, a shift of the CoG forward (m), and the share of a pull of the front brakes."""

SHEET: dict[str, float] = {
    "mass": 1093.295,
    "yaw_inertia": 1791.6,
    "cog_to_front_axle": 1.1562,
    "cog_to_rear_axle": 1.4227,
    "friction": 1.0489,
    "steering_ratio": RATIO,
    "reference_from_cog": 0.0,
    "lowest_speed": 1.5,
    "stiffness_peak_front": 1.096e7,
    "stiffness_load_front": 1e6,
    "stiffness_peak_rear": 1.096e7,
    "stiffness_load_rear": 1e6,
    "shape_factor_front": 1.3507,
    "shape_factor_rear": 1.3507,
}
"""What is published of it as a single track: the tyres' own stiffness, 21.9 times the load."""


def built(v: Mapping[str, float]) -> Any:
    """Return the package's parameters with those of a car; a load sits in its CoG."""
    p = parameters_vehicle2()
    added = p.m * (v["mass"] - 1.0)
    tyre = replace(
        p.tire, p_dy1=p.tire.p_dy1 * v["grip"], p_dx1=p.tire.p_dx1 * v["grip"], p_ky1=p.tire.p_ky1 * v["stiffness"]
    )
    roll = {name: getattr(p, name) * v["roll_stiffness"] for name in ("K_tsf", "K_tsr")}
    return replace(
        p,
        m=p.m + added,
        m_s=p.m_s + added,
        I_z=p.I_z * v["yaw_inertia"],
        a=p.a - v["shift"],
        b=p.b + v["shift"],
        tire=tyre,
        **roll,
    )


def drive_car(drive: Drive, road_wheel: Floats, v: Mapping[str, float], logger: Logger) -> dict[str, Floats]:
    """Return what each channel has to measure at every ``STEP``.

    Args:
        drive: Steering, speed and road; the unevenness is not used, the package's road is plane.
        road_wheel: Angle behind the column at half steps.
        v: What is different of the car, as ``BUILT``.
        logger: Where the sensors sit.
    """
    p, h = built(v), EVERY * STEP
    own, read = p.I_z, 2 * EVERY

    def rates(x: list[float], k: int) -> list[float]:
        pedals = SPEED_GAIN * (drive.speed[k] - x[3]) + drive.speed_rate[k]
        x = x.copy()
        x[2] = road_wheel[k]
        dx = vehicle_dynamics_mb(x, [0.0, pedals], p)
        braking = max(-pedals, 0.0) * p.m
        dx[5] += v["pull"] * 0.6 * braking * 0.5 * p.T_f / own
        for body in (10, 15, 20):  # the sprung mass and both axles
            dx[body] -= GRAVITY * drive.bank[k]
        return list(dx)

    x = list(init_mb([0.0, 0.0, 0.0, drive.speed[0], 0.0, 0.0, 0.0], p))
    count = (drive.time.size - 1) // read + 1
    out = np.zeros((count, 4))
    ahead, above = logger.places[0], logger.places[1] - ROLL_ARM
    for i in range(count):
        k = i * read
        k1 = rates(x, k)
        felt = k1[10] + x[5] * x[3] + GRAVITY * drive.bank[k] + ahead * k1[5] + above * k1[7]
        out[i] = x[3], x[5] - logger.tilt * x[7], felt * np.cos(x[6]) - GRAVITY * np.sin(x[6]), -x[6]
        if i + 1 == count:
            break
        k2 = rates([a + h / 2 * b for a, b in zip(x, k1, strict=True)], k + read // 2)
        k3 = rates([a + h / 2 * b for a, b in zip(x, k2, strict=True)], k + read // 2)
        k4 = rates([a + h * b for a, b in zip(x, k3, strict=True)], k + read)
        x = [a + h / 6 * (b + 2 * c + 2 * d + e) for a, b, c, d, e in zip(x, k1, k2, k3, k4, strict=True)]
    fine, coarse = np.arange(drive.time.size // 2 + 1) * STEP, np.arange(count) * h
    speed, yaw, acceleration = (np.interp(fine, coarse, out[:, c]) for c in range(3))
    return dict(zip(CAR, (drive.wheel[::2], speed, yaw, acceleration), strict=True))
