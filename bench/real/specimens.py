"""A car and a semitrailer as they are built: their values, the vehicle that follows, and what a data sheet says of it.

Values are dictionaries in SI units, so that a case changes one by its name. The data sheet is of a single track:
masses, inertias and lengths as they are, and of each axle the Magic Formula that comes closest to what tyres,
suspension and column do together.
"""

from __future__ import annotations

import math
from collections.abc import Mapping

import numpy as np

from bench.real.vehicle import (
    CONICITY,
    DY,
    FZ0,
    GRAVITY,
    KY,
    KY_LOAD,
    SIGMA,
    TYRES,
    Floats,
    Plant,
    lateral_force,
)

Values = Mapping[str, float]

AXLES = {"car": ("front", "rear"), "semitrailer": ("11", "12", "21", "22", "23")}
GROUPS = {"car": ("front", "rear"), "semitrailer": ("11", "12", "2")}
"""Axles, and those that share a tyre, as the library calls them."""

CAR: dict[str, float] = {
    "mass": 1480.0,
    "yaw_inertia": 2450.0,
    "cog_to_front_axle": 1.15,
    "cog_to_rear_axle": 1.55,
    "steering_ratio": 15.6,
    "steering_compliance": 0.9e-6,
    "cog_height": 0.55,
    "sprung_share": 0.88,
    "roll_inertia": 420.0,
    "roll_axis_front": 0.07,
    "roll_axis_rear": 0.13,
    "roll_stiffness_front": 5.2e4,
    "roll_stiffness_rear": 3.9e4,
    "roll_damping_front": 2100.0,
    "roll_damping_rear": 1800.0,
    "frame_stiffness": 7e5,
    "frame_damping": 600.0,
    "track_front": 1.55,
    "track_rear": 1.54,
    "pitch_frequency": 8.8,
    "pitch_damping": 0.3,
    "drag": 0.40,
    "side_air": 1.4,
    "toe_compliance_front": 3.0e-7,
    "toe_compliance_rear": 0.8e-7,
    "roll_steer_front": -0.05,
    "roll_steer_rear": 0.04,
    "brake_front": 0.66,
    "grip": 1.0,
    "stiffness_front": 1.0,
    "stiffness_rear": 1.0,
}
SEMITRAILER: dict[str, float] = {
    "tractor_mass": 7900.0,
    "tractor_yaw_inertia": 30000.0,
    "tractor_cog_to_front_axle": 1.30,
    "tractor_cog_to_rear_axle": 2.40,
    "tractor_cog_to_kingpin": 1.80,
    "trailer_mass": 22000.0,
    "trailer_track": 2.55,
    "trailer_length": 13.6,
    "trailer_inertia_scale": 0.85,
    "kingpin_from_rear": 12.0,
    "axle_21_from_rear": 5.5,
    "axle_22_from_rear": 4.2,
    "axle_23_from_rear": 2.9,
    "trailer_cog_from_rear": 7.4,
    "steering_ratio": 20.0,
    "steering_compliance": 3.0e-7,
    "tractor_cog_height": 1.05,
    "trailer_cog_height": 1.85,
    "tractor_sprung_share": 0.80,
    "trailer_sprung_share": 0.87,
    "tractor_roll_inertia": 5000.0,
    "trailer_roll_inertia": 26000.0,
    "roll_axis_11": 0.60,
    "roll_axis_12": 0.78,
    "roll_axis_2": 0.70,
    "roll_stiffness_11": 2.6e5,
    "roll_stiffness_12": 5.4e5,
    "roll_stiffness_2": 9.5e5,
    "roll_damping_11": 1.2e4,
    "roll_damping_12": 2.4e4,
    "roll_damping_2": 5.5e4,
    "tractor_frame_stiffness": 3.0e5,
    "tractor_frame_damping": 3000.0,
    "trailer_frame_stiffness": 7.0e5,
    "trailer_frame_damping": 5000.0,
    "track_11": 2.04,
    "track_12": 1.84,
    "track_2": 2.04,
    "pitch_frequency": 8.0,
    "pitch_damping": 0.3,
    "drag": 3.2,
    "side_air_tractor": 2.0,
    "side_air_trailer": 12.0,
    "toe_compliance_11": 0.5e-7,
    "toe_compliance_12": 0.2e-7,
    "toe_compliance_2": 0.4e-7,
    "roll_steer_11": -0.04,
    "roll_steer_12": 0.03,
    "roll_steer_2": 0.05,
    "kingpin_play": 0.001,
    "kingpin_friction": 900.0,
    "fifth_wheel_height": 1.15,
    "fifth_wheel_roll_stiffness": 8.0e5,
    "fifth_wheel_roll_damping": 4000.0,
    "fifth_wheel_roll_play": 0.004,
    "grip": 1.0,
    "stiffness_11": 1.0,
    "stiffness_12": 1.0,
    "stiffness_2": 1.0,
}
BUILT = {"car": CAR, "semitrailer": SEMITRAILER}

# FZ0, CY, DY, DY_LOAD, EY, EY_LOAD, KY, KY_LOAD, CONICITY, BYK, BYK_SLIP, CYK, KX, SIGMA, TYRES
_TYRES = {
    "front": (4200.0, 1.34, 1.03, -0.13, -0.5, -0.3, 18.0, 1.7, 0.0, 9.5, 7.5, 1.04, 22.0, 0.45, 1.0),
    "rear": (4200.0, 1.34, 1.03, -0.13, -0.5, -0.3, 19.0, 1.7, 0.0, 9.5, 7.5, 1.04, 22.0, 0.45, 1.0),
    "11": (32000.0, 1.32, 0.82, -0.09, -0.4, -0.2, 6.7, 1.8, 0.0, 7.5, 6.0, 1.05, 12.0, 0.50, 1.0),
    "12": (25000.0, 1.30, 0.80, -0.08, -0.4, -0.2, 6.6, 1.8, 0.0, 7.5, 6.0, 1.05, 12.0, 0.46, 2.0),
    "2": (22000.0, 1.28, 0.80, -0.08, -0.4, -0.2, 6.4, 1.8, 0.0, 7.5, 6.0, 1.05, 12.0, 0.52, 1.0),
}
_PIN = (2.5e7, 1.5e5)
"""Stiffness (N/m) and damping (N s/m) of the kingpin's seat."""


def group_of(vehicle: str, axle: str) -> str:
    """Return the group of an axle."""
    return "2" if vehicle == "semitrailer" and axle.startswith("2") else axle


def assemble(vehicle: str, v: Values) -> Plant:
    """Return the vehicle of some values; what ``v`` lacks of faults of an axle is absent.

    Faults: ``conicity_<axle>`` and ``askew_<axle>`` in rad, ``pull_<axle>`` as a share.
    """
    axles = AXLES[vehicle]
    groups = [group_of(vehicle, a) for a in axles]
    tyre = np.array([_TYRES[g] for g in groups])
    tyre[:, KY] *= [v[f"stiffness_{g}"] for g in groups]
    tyre[:, DY] *= v["grip"]
    tyre[:, CONICITY] = [v.get(f"conicity_{a}", 0.0) for a in axles]
    common = {
        "tyre": tyre,
        "track": np.array([v[f"track_{g}"] for g in groups]),
        "roll_centre": np.array([v[f"roll_axis_{g}"] for g in groups]),
        "toe": np.array([v[f"toe_compliance_{g}"] for g in groups]),
        "roll_steer": np.array([v[f"roll_steer_{g}"] for g in groups]),
        "askew": np.array([v.get(f"askew_{a}", 0.0) for a in axles]),
        "pull": np.array([v.get(f"pull_{a}", 0.0) for a in axles]),
        "steered": np.array([1.0] + [0.0] * (len(axles) - 1)),
        "compliance": v["steering_compliance"],
    }
    return Plant(**(_car(v) if vehicle == "car" else _semitrailer(v)), **common)


def _unit(mass: float, inertia: float, sprung: float, roll_inertia: float, x: Floats, h: Floats) -> tuple[Floats, ...]:
    """Return of a unit the inverse mass matrix, and of its ends place and mass times height over the roll axis."""
    shares = np.array([-x[1], x[0]]) / (x[0] - x[1])
    ends = sprung * shares
    m = np.zeros((4, 4))
    m[0, 0], m[1, 1] = mass, inertia
    for e in range(2):
        m[0, 2 + e] = m[2 + e, 0] = -ends[e] * h[e]
        m[1, 2 + e] = m[2 + e, 1] = -ends[e] * h[e] * x[e]
        m[2 + e, 2 + e] = roll_inertia * shares[e] + ends[e] * h[e] ** 2
    return np.linalg.inv(m), x, ends * h


def _car(v: Values) -> dict[str, object]:
    front, rear, mass = v["cog_to_front_axle"], v["cog_to_rear_axle"], v["mass"]
    base = front + rear
    x = np.array([front, -rear])
    heights = v["cog_height"] - np.array([v["roll_axis_front"], v["roll_axis_rear"]])
    inverse, end_x, end_mh = _unit(mass, v["yaw_inertia"], v["sprung_share"] * mass, v["roll_inertia"], x, heights)
    transfer = mass * v["cog_height"] / base
    return {
        "mass": np.array([mass]),
        "transfer": np.array([[-transfer], [transfer]]),
        "pitch": np.array([[v["pitch_frequency"], v["pitch_damping"]]]),
        "inverse": inverse[None],
        "end_x": end_x[None],
        "end_mh": end_mh[None],
        "end_springs": np.array([[[v[f"roll_stiffness_{e}"], v[f"roll_damping_{e}"]] for e in ("front", "rear")]]),
        "torsion": np.array([[v["frame_stiffness"], v["frame_damping"]]]),
        "air": np.array([[v["drag"], v["side_air"]]]),
        "unit": np.zeros(2, np.int64),
        "end": np.array([0, 1]),
        "x": x,
        "load": mass * GRAVITY * np.array([rear, front]) / base,
        "share": np.ones(2),
        "drive": np.array([1.0, 0.0]),
        "brake": np.array([v["brake_front"], 1.0 - v["brake_front"]]),
        "hitch": np.zeros(12),
    }


def _semitrailer(v: Values) -> dict[str, object]:
    a1, b1, h1 = v["tractor_cog_to_front_axle"], v["tractor_cog_to_rear_axle"], v["tractor_cog_to_kingpin"]
    m1, m2, cog = v["tractor_mass"], v["trailer_mass"], v["trailer_cog_from_rear"]
    a2 = v["kingpin_from_rear"] - cog
    b2 = cog - np.array([v[f"axle_{a}_from_rear"] for a in ("21", "22", "23")])
    l1, l2 = a1 + b1, a2 + b2[1]
    kingpin = m2 * GRAVITY * b2[1] / l2
    on_kingpin, fifth = (b1 - h1) / l1, v["fifth_wheel_height"]
    load = [m1 * GRAVITY * b1 / l1 + kingpin * on_kingpin, m1 * GRAVITY * a1 / l1 + kingpin * (1 - on_kingpin)]
    pitch_1, pitch_2 = m1 * v["tractor_cog_height"] / l1, m2 * v["trailer_cog_height"] / l2
    inertia = v["trailer_inertia_scale"] * m2 * (v["trailer_track"] ** 2 + v["trailer_length"] ** 2) / 12
    h = v["tractor_cog_height"], v["trailer_cog_height"]
    units = (
        _unit(
            m1,
            v["tractor_yaw_inertia"],
            v["tractor_sprung_share"] * m1,
            v["tractor_roll_inertia"],
            np.array([a1, -b1]),
            h[0] - np.array([v["roll_axis_11"], v["roll_axis_12"]]),
        ),
        _unit(
            m2,
            inertia,
            v["trailer_sprung_share"] * m2,
            v["trailer_roll_inertia"],
            np.array([a2, -b2[1]]),
            h[1] - np.array([fifth, v["roll_axis_2"]]),
        ),
    )
    springs = [[v[f"roll_stiffness_{g}"], v[f"roll_damping_{g}"]] for g in ("11", "12", "2")]
    frames = [[v[f"{u}_frame_stiffness"], v[f"{u}_frame_damping"]] for u in ("tractor", "trailer")]
    roll = v["fifth_wheel_roll_stiffness"], v["fifth_wheel_roll_damping"], v["fifth_wheel_roll_play"]
    brake = np.array([0.22, 0.30, 0.16, 0.16, 0.16])
    return {
        "mass": np.array([m1, m2]),
        "transfer": np.array(
            [
                [-pitch_1, -pitch_2 * on_kingpin],
                [pitch_1, -pitch_2 * (1 - on_kingpin)],
                *([[0.0, pitch_2 / 3]] * 3),
            ]
        ),
        "pitch": np.array([[v["pitch_frequency"], v["pitch_damping"]]] * 2),
        **{name: np.array([u[k] for u in units]) for k, name in enumerate(("inverse", "end_x", "end_mh"))},
        "end_springs": np.array([springs[:2], [[0.0, 0.0], springs[2]]]),
        "torsion": np.array(frames),
        "air": np.array([[v["drag"], v["side_air_tractor"]], [0.0, v["side_air_trailer"]]]),
        "unit": np.array([0, 0, 1, 1, 1]),
        "end": np.array([0, 1, 1, 1, 1]),
        "x": np.array([a1, -b1, *-b2]),
        "load": np.array([*load, *[m2 * GRAVITY * a2 / l2 / 3] * 3]),
        "share": np.array([1.0, 1.0, 1 / 3, 1 / 3, 1 / 3]),
        "drive": np.array([0.0, 1.0, 0.0, 0.0, 0.0]),
        "brake": brake,
        "hitch": np.array(
            [h1, a2, *_PIN, v["kingpin_play"], *roll, v["kingpin_friction"], 0.003, fifth - v["roll_axis_12"], 0.0]
        ),
    }


# --- the data sheet


def lean(vehicle: str, v: Values) -> float:
    """Return the roll angle per lateral acceleration, rad s^2/m; of a semitrailer as if it were one rigid body."""
    p = assemble(vehicle, v)
    return float(p.end_mh.sum() / (p.end_springs[:, :, 0].sum() - GRAVITY * p.end_mh.sum()))


def axle_curve(vehicle: str, v: Values, j: int, accelerations: Floats) -> tuple[Floats, Floats]:
    """Return lateral force (N) and slip angle (rad) of an axle in steady bends, suspension and column among it.

    Args:
        vehicle: ``car`` or ``semitrailer``.
        v: Values.
        j: Which axle.
        accelerations: In m/s^2, positive.
    """
    p, leaning = assemble(vehicle, v), lean(vehicle, v)
    force = p.load[j] / GRAVITY * accelerations
    slips = np.zeros(force.size)
    for k, (f, a) in enumerate(zip(force, accelerations, strict=True)):
        moment = p.share[j] * p.end_springs[p.unit[j], p.end[j], 0] * leaning * a + p.roll_centre[j] * f
        loads = 0.5 * p.load[j] + np.array([-1.0, 1.0]) * moment / p.track[j]
        low, high = 0.0, 0.5
        for _ in range(50):
            middle = 0.5 * (low + high)
            twins = p.tyre[j, TYRES]
            made = sum(twins * lateral_force(middle, 0.0, load / twins, p.tyre[j]) for load in loads)
            low, high = (middle, high) if made < f else (low, middle)
        give = p.toe[j] + (p.compliance if p.steered[j] else 0.0)
        slips[k] = low + give * f - p.roll_steer[j] * leaning * a
    return force, slips


def effective_stiffness(vehicle: str, v: Values, group: str) -> float:
    """Return the cornering stiffness of an axle in N/rad, suspension and column among it."""
    j = [group_of(vehicle, a) for a in AXLES[vehicle]].index(group)
    force, slip = axle_curve(vehicle, v, j, np.array([0.05]))
    return float(force[0] / slip[0])


_SHAPES = np.arange(0.8, 2.01, 0.05)
FASTEST = {"car": 5.5, "semitrailer": 3.2}
"""Lateral acceleration up to which the data sheet's tyres were fitted, m/s^2."""


def data_sheet(vehicle: str, v: Values) -> dict[str, float]:
    """Return what is published of a vehicle, by the names of the library's parameters."""
    p, groups = assemble(vehicle, v), [group_of(vehicle, a) for a in AXLES[vehicle]]
    lengths = {k: x for k, x in v.items() if k in _GEOMETRY[vehicle]}
    sheet = {**lengths, "friction": round(float(p.tyre[:, DY].mean()), 2), **_NUMERICAL[vehicle]}
    for group in GROUPS[vehicle]:
        j = groups.index(group)
        knee = float(round(2.0 * p.tyre[j, TYRES] * p.tyre[j, KY_LOAD] * p.tyre[j, FZ0], -2))
        stiffness = effective_stiffness(vehicle, v, group)
        force, slip = axle_curve(vehicle, v, j, np.linspace(0.3, FASTEST[vehicle], 18))
        capacity = sheet["friction"] * p.load[j]
        curves = [capacity * np.sin(c * np.arctan(stiffness / (c * capacity) * np.tan(slip))) for c in _SHAPES]
        best = int(np.argmin([np.sum((curve - force) ** 2) for curve in curves]))
        sheet[f"shape_factor_{group}"] = round(float(_SHAPES[best]), 2)
        sheet[f"stiffness_peak_{group}"] = round(stiffness / math.sin(2.0 * math.atan(float(p.load[j]) / knee)), -2)
        sheet[f"stiffness_load_{group}"] = knee
        if vehicle == "semitrailer":
            sheet[f"relaxation_length_{group}"] = float(p.tyre[j, SIGMA])
    return sheet


_GEOMETRY = {
    "car": ("mass", "yaw_inertia", "cog_to_front_axle", "cog_to_rear_axle", "steering_ratio"),
    "semitrailer": tuple(SEMITRAILER)[: list(SEMITRAILER).index("steering_ratio") + 1],
}
_NUMERICAL = {"car": {"reference_from_cog": 0.0, "lowest_speed": 1.5}, "semitrailer": {"constraint_rate": 10.0}}
