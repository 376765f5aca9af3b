"""The fifteen kinds of what may change of a vehicle between two days, each in three sizes, and its name in the library.

The sizes are those of tolerances, of a fleet and of a defect, as in ``docs/attribution.md``. Names are the library's,
``parameter:<name>`` for a parameter of the model; all that stand together describe the same motion in such drives.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from bench.real.sensors import CHANNELS, Fault
from bench.real.specimens import AXLES, Values, assemble, effective_stiffness, lean

MAGNITUDES = ("small", "medium", "large")


@dataclass(frozen=True)
class Change:
    """What has changed.

    Attributes:
        kind: One of ``KINDS``.
        place: Axle, body or channel; empty where there is one only.
        size: In the plant's words, SI or a share.
        values: New values of the vehicle, by name.
        column: What lag (s), delay (s) and play (rad at the road wheels) of the column grow by.
        fault: Of the sensors.
        names: That are right, in the library's words.
        parameters: By how much parameters of the library change, of those names that have one equation with the plant.
    """

    kind: str
    place: str
    size: float
    values: Mapping[str, float] = field(default_factory=dict)
    column: Mapping[str, float] = field(default_factory=dict)
    fault: Fault = field(default_factory=Fault)
    names: tuple[str, ...] = ()
    parameters: Mapping[str, float] = field(default_factory=dict)


_SIZES: dict[str, tuple[tuple[float, float, float], bool]] = {
    "mass": ((0.05, 0.12, 0.25), False),
    "inertia": ((0.10, 0.22, 0.45), True),
    "stiffness": ((0.06, 0.15, 0.30), True),
    "friction": ((-0.15, -0.30, -0.45), False),
    "compliance": ((0.06, 0.18, 0.45), False),
    "lag": ((0.02, 0.05, 0.12), False),
    "delay": ((0.015, 0.04, 0.10), False),
    "gain": ((0.02, 0.05, 0.12), True),
    "bias": ((1.0, 3.0, 10.0), True),
    "wheel_radius": ((0.01, 0.025, 0.06), True),
    "play": ((0.0008, 0.002, 0.005), False),
    "load_shift": ((0.02, 0.05, 0.10), True),
    "brake_pull": ((0.05, 0.12, 0.30), True),
    "axle_steer": ((0.1, 0.3, 0.8), True),
    "roll_stiffness": ((-0.12, -0.25, -0.45), False),
}
"""Three sizes of each kind, and whether the sign is drawn.

Shares of the value, but for: compliance, as a share of the slip angle of the front tyres; lag and delay in s; bias in
0.3 °/s, 0.1 m/s^2, 0.1°, or 500 N; play as half of it at the road wheels in rad (2 mrad are 1.8° of a car's wheel);
load shift as a share of the wheelbase; axle steer in °."""

KINDS = tuple(_SIZES)

LACKS = {"multi_body": ("stiffness", "compliance", "axle_steer")}
"""Kinds that a plant cannot have."""

_BIAS = {"yaw_rate": math.radians(0.3), "lateral_acceleration": 0.1, "articulation_angle": math.radians(0.1)}


def kinds_of(vehicle: str) -> tuple[str, ...]:
    """Return the kinds of change of a vehicle."""
    return tuple(kind for kind in KINDS if kind not in LACKS.get(vehicle, ()))


def draw_change(
    vehicle: str,
    kind: str,
    magnitude: str,
    v: Values,
    sheet: Values,
    rng: np.random.Generator,
) -> Change:
    """Return a change of a vehicle.

    Args:
        vehicle: ``car``, ``semitrailer`` or ``multi_body``.
        kind: One of ``KINDS``.
        magnitude: One of ``MAGNITUDES``.
        v: Values before.
        sheet: What is published.
        rng: Decides sign and place.
    """
    sizes, signed = _SIZES[kind]
    s = sizes[MAGNITUDES.index(magnitude)] * (float(rng.choice([-1.0, 1.0])) if signed else 1.0)
    if kind in ("delay", "gain", "bias", "wheel_radius"):
        return _of_sensors(vehicle, kind, s, rng)
    if kind in ("lag", "play"):
        name = {"lag": "steering_lag", "play": "steering_backlash"}[kind]
        return Change(kind, "", s, column={kind: s}, names=(name,), parameters={name: s})
    if vehicle == "multi_body":
        return _of_multi_body(kind, s, sheet)
    return (_of_car if vehicle == "car" else _of_semitrailer)(kind, s, v, sheet, rng)


def _of_sensors(vehicle: str, kind: str, s: float, rng: np.random.Generator) -> Change:
    outputs = CHANNELS[vehicle][2:]
    if kind == "wheel_radius":
        return Change(
            kind, "", s, fault=Fault(radius=s), names=("wheel_radius_error",), parameters={"wheel_radius_error": s}
        )
    if kind == "delay" and rng.random() < 0.5:
        return Change(kind, "", s, column={"delay": s}, names=("steering_delay",), parameters={"steering_delay": s})
    channel = str(rng.choice(outputs))
    if kind == "delay":
        fault, name, parameter = Fault(delays={channel: s}), "sensor_delay", "sensor_delay"
    elif kind == "gain":
        fault, name, parameter = Fault(gains={channel: s}), "sensor_gain", "sensor_gain_error"
    else:
        s *= next((x for q, x in _BIAS.items() if channel.startswith(q)), 500.0)
        fault, name, parameter = Fault(biases={channel: s}), "sensor_bias", "sensor_bias"
    return Change(kind, channel, s, fault=fault, names=(name,), parameters={f"{parameter}_{channel}": s})


def _of_multi_body(kind: str, s: float, sheet: Values) -> Change:
    if kind in ("mass", "inertia", "friction"):
        name = {"mass": "mass", "inertia": "yaw_inertia", "friction": "friction"}[kind]
        own = "grip" if kind == "friction" else name
        return Change(
            kind,
            "",
            s,
            {own: 1.0 + s},
            names=(*_RIGHT.get(kind, ()), f"parameter:{name}"),
            parameters={name: s * sheet[name]},
        )
    if kind == "load_shift":
        shift = s * (sheet["cog_to_front_axle"] + sheet["cog_to_rear_axle"])
        return Change(kind, "", shift, {"shift": shift}, names=_SHIFTED, parameters={"payload_shift": shift})
    if kind == "brake_pull":
        return Change(kind, "", s, {"pull": s}, names=("brake_pull",))
    return Change(kind, "", s, {"roll_stiffness": 1.0 + s}, names=_RIGHT["roll_stiffness"])


_SHIFTED = ("payload_shift", "parameter:cog_to_front_axle", "parameter:cog_to_rear_axle")
_RIGHT: dict[str, tuple[str, ...]] = {
    "friction": ("friction_change",),
    "roll_stiffness": ("body_roll", "accelerometer_roll", "lateral_load_transfer", "roll_steer"),
    "axle_steer": ("tyre_force_offset", "steering_offset"),
}
"""Names beside the obvious one: the axle that stands askew is, without a sideslip sensor, an offset of the steering."""


def _scaled(v: Values, names: tuple[str, ...], s: float) -> dict[str, float]:
    return {name: v[name] * (1.0 + s) for name in names}


def _stiffness(vehicle: str, v: Values, sheet: Values, group: str, s: float) -> Change:
    """Return a change of the tyres of an axle; of the stiffness of the axle its suspension leaves a part."""
    values = {f"stiffness_{group}": v[f"stiffness_{group}"] * (1.0 + s)}
    return _softer(vehicle, v, sheet, group, Change("stiffness", group, s, values))


def _compliance(vehicle: str, v: Values, sheet: Values, s: float) -> Change:
    """Return a column that gives."""
    front = {"car": "front", "semitrailer": "11"}[vehicle]
    more = s / effective_stiffness(vehicle, v, front)
    values = {"steering_compliance": v["steering_compliance"] + more}
    return _softer(vehicle, v, sheet, front, Change("compliance", "", more, values))


def _softer(vehicle: str, v: Values, sheet: Values, group: str, change: Change) -> Change:
    """Return a change of an axle's stiffness with its names: as compliance it is the same, but where tyres saturate."""
    before, after = (effective_stiffness(vehicle, x, group) for x in (v, {**v, **change.values}))
    peak, given = f"stiffness_peak_{group}", 1.0 / after - 1.0 / before
    names = (f"parameter:{peak}", f"parameter:stiffness_load_{group}", "axle_compliance_steer")
    parameters = {peak: sheet[peak] * (after / before - 1.0), f"axle_compliance_steer_{group}": given}
    if group in ("front", "11"):
        names += ("steering_compliance", "steering_compliance_lag")
        parameters |= {"steering_compliance": given, "lagged_compliance": given}
    return replace(change, names=names, parameters=parameters)


def _pull(vehicle: str, v: Values, body: str, axles: Sequence[str], s: float) -> Change:
    """Return brakes that pull to one side; the library's offset counts with the braking force of the body."""
    p, own = assemble(vehicle, v), [AXLES[vehicle].index(a) for a in axles]
    offset = float((p.brake[own] * p.track[own]).sum()) * 0.5 * s * float(p.mass.sum() / p.mass[p.unit[own[0]]])
    values = {f"pull_{a}": v.get(f"pull_{a}", 0.0) + s for a in axles}
    name = "brake_pull" + (f"_{body}" if body else "")
    return Change("brake_pull", body, s, values, names=("brake_pull",), parameters={name: offset})


def _askew(axle: str, s: float) -> Change:
    angle = math.radians(s)
    return Change("axle_steer", axle, angle, {f"askew_{axle}": angle}, names=_RIGHT["axle_steer"])


def _of_car(kind: str, s: float, v: Values, sheet: Values, rng: np.random.Generator) -> Change:
    match kind:
        case "mass" | "inertia":
            name = {"mass": "mass", "inertia": "yaw_inertia"}[kind]
            return Change(
                kind, "", s, _scaled(v, (name,), s), names=(f"parameter:{name}",), parameters={name: s * v[name]}
            )
        case "stiffness":
            return _stiffness("car", v, sheet, str(rng.choice(["front", "rear"])), s)
        case "friction":
            return _friction(v, sheet, s)
        case "compliance":
            return _compliance("car", v, sheet, s)
        case "load_shift":
            shift = s * (v["cog_to_front_axle"] + v["cog_to_rear_axle"])
            values = {
                "cog_to_front_axle": v["cog_to_front_axle"] - shift,
                "cog_to_rear_axle": v["cog_to_rear_axle"] + shift,
            }
            return Change(kind, "", shift, values, names=_SHIFTED, parameters={"payload_shift": shift})
        case "brake_pull":
            return _pull("car", v, "", ("front", "rear"), s)
        case "axle_steer":
            askew = _askew("rear", s)
            return Change(**{**vars(askew), "parameters": {"steering_offset": -askew.size}})
    end = str(rng.choice(["front", "rear"]))
    values = _scaled(v, (f"roll_stiffness_{end}",), s)
    more = lean("car", {**v, **values}) - lean("car", v)
    parameters = {"body_roll_gain": more, "roll_gain": more}
    return Change(kind, end, s, values, names=_RIGHT[kind], parameters=parameters)


def _friction(v: Values, sheet: Values, s: float) -> Change:
    names = ("parameter:friction", *_RIGHT["friction"])
    return Change(
        "friction", "", s, _scaled(v, ("grip",), s), names=names, parameters={"friction": s * sheet["friction"]}
    )


def _of_semitrailer(kind: str, s: float, v: Values, sheet: Values, rng: np.random.Generator) -> Change:
    match kind:
        case "mass":
            body = str(rng.choice(["tractor", "trailer"]))
            name = f"{body}_mass"
            return Change(
                kind, body, s, _scaled(v, (name,), s), names=(f"parameter:{name}",), parameters={name: s * v[name]}
            )
        case "inertia":
            body = str(rng.choice(["tractor", "trailer"]))
            name = {"tractor": "tractor_yaw_inertia", "trailer": "trailer_inertia_scale"}[body]
            return Change(
                kind, body, s, _scaled(v, (name,), s), names=(f"parameter:{name}",), parameters={name: s * v[name]}
            )
        case "stiffness":
            return _stiffness("semitrailer", v, sheet, str(rng.choice(["11", "12", "2"])), s)
        case "friction":
            return _friction(v, sheet, s)
        case "compliance":
            return _compliance("semitrailer", v, sheet, s)
        case "load_shift":
            name, shift = "trailer_cog_from_rear", s * (v["kingpin_from_rear"] - v["axle_22_from_rear"])
            names = (f"parameter:{name}", "payload_shift")
            return Change(
                kind,
                "trailer",
                shift,
                {name: v[name] + shift},
                names=names,
                parameters={name: shift, "payload_shift_trailer": shift},
            )
        case "brake_pull":
            body = str(rng.choice(["tractor", "trailer"]))
            axles = ("11", "12") if body == "tractor" else ("21", "22", "23")
            return _pull("semitrailer", v, body, axles, s)
        case "axle_steer":
            return _askew(str(rng.choice(["12", "21", "22", "23"])), s)
    group = str(rng.choice(["11", "12", "2"]))
    return Change(kind, group, s, _scaled(v, (f"roll_stiffness_{group}",), s), names=_RIGHT[kind])
