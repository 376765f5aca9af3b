"""Drives whose plant shares nothing with the program: kinematics in NumPy, one clock or two, calm, constant or lively.

What the drives of ``drives.py`` lack: speed that does not vary, stretches that excite nothing, rates from 1 to 200 Hz,
bodies that roll, roads that bank, devices whose channels are all late, and two faults at once.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
import scipy

from harness.common.arrays import Floats
from harness.recordings.readers import Table

PLANTED = ("nothing", "one fault", "one device", "two faults")
STYLES = ("lively", "mixed", "constant speed", "calm")
DEVICES = {
    "positions": ("position_x", "position_y"),
    "receiver": ("position_x", "position_y", "heading", "longitudinal_velocity", "lateral_velocity"),
    "inertial unit": ("yaw_rate", "lateral_acceleration", "longitudinal_acceleration"),
    "bus": ("speed", "yaw_rate", "lateral_acceleration", "longitudinal_acceleration", "steering_wheel_angle"),
}
_FINE = 0.005
"""s between the samples of the plant."""
_GRAVITY = 9.81
_NOISE = {
    "position_x": (0.01, 0.03), "position_y": (0.01, 0.03), "heading": (5e-4, 3e-3), "speed": (0.01, 0.05),
    "longitudinal_velocity": (0.01, 0.05), "lateral_velocity": (0.01, 0.05), "yaw_rate": (1e-3, 5e-3),
    "lateral_acceleration": (0.03, 0.15), "longitudinal_acceleration": (0.03, 0.15),
    "steering_wheel_angle": (1e-3, 5e-3),
}  # fmt: skip
"""Least and largest standard deviation of the noise of a channel, SI units."""
UNITS = {"rad": "deg", "rad/s": "deg/s", "m/s": "km/h", "m/s^2": "g_0"}


@dataclass(frozen=True)
class Fault:
    """One fault that is planted.

    Attributes:
        kind: Of the finding that names it: ``delay``, ``scale``, ``offset``, ``sign`` or ``unit``.
        signals: All that it concerns.
        size: s late, factor minus 1, SI units; the factor of a unit.
    """

    kind: str
    signals: tuple[str, ...]
    size: float


@dataclass
class Foreign:
    """A drive with its faults, as a reader returns it, and the map that reads it.

    Attributes:
        style: How it was driven, one of ``STYLES``.
        faults: What is wrong with it.
        tables: One per clock.
        mapping: Channel map.
        rates: Hz of the bus and of the receiver.
    """

    style: str
    faults: tuple[Fault, ...]
    tables: list[Table]
    mapping: dict[str, object]
    rates: tuple[float, float]
    words: str = field(default="")


def _wandering(rng: np.random.Generator, samples: int, memory: float) -> Floats:
    """Return a smooth random signal of unit standard deviation that forgets within ``memory`` seconds."""
    weight = _FINE / memory
    raw = rng.normal(size=samples + int(8 * memory / _FINE))
    for _ in range(3):
        raw = scipy.signal.lfilter([weight], [1, weight - 1], raw)
    kept = raw[-samples:]
    return (kept - kept.mean()) / kept.std()


def _integral(rate: Floats) -> Floats:
    return np.concatenate([[0.0], np.cumsum((rate[1:] + rate[:-1]) / 2) * _FINE])


def motion(rng: np.random.Generator, style: str) -> dict[str, Floats]:
    """Return the true signals of a drive, and ``time``, every 5 ms; the accelerometer leans with body and road."""
    time = np.arange(0, rng.uniform(90, 240), _FINE)
    n = len(time)
    lively = np.ones(n)
    if style == "mixed":
        begin = rng.uniform(0.2, 0.5) * time[-1]
        lively = 1 - scipy.special.expit((time - begin) / 2) + scipy.special.expit((time - begin - time[-1] / 3) / 2)
    speed = rng.uniform(10, 30)
    varies = {"constant speed": 0.0, "calm": rng.uniform(0.0, 0.15)}.get(style, rng.uniform(1.5, 0.25 * speed))
    v_x = np.maximum(speed + varies * lively * _wandering(rng, n, rng.uniform(2, 5)), 3.0)
    turns = rng.uniform(0.002, 0.008) if style == "calm" else rng.uniform(0.8, 2.2) / speed
    r = turns * lively * _wandering(rng, n, rng.uniform(0.7, 2.0))
    front, rear = rng.uniform(1.0, 1.6, 2)
    mass, stiffness, ratio = rng.uniform(1200, 2300), rng.uniform(8e4, 1.8e5), rng.uniform(13, 18)
    v_y = (rear - mass * front * v_x**2 / ((front + rear) * stiffness)) * r
    heading = rng.uniform(-np.pi, np.pi) + _integral(r)
    a_x, a_y = np.gradient(v_x, _FINE) - v_y * r, np.gradient(v_y, _FINE) + v_x * r
    leans = np.radians(rng.uniform(0, 6)) / _GRAVITY * a_y + np.radians(rng.uniform(0, 1.2)) * _wandering(rng, n, 6.0)
    return {
        "time": time,
        "position_x": _integral(v_x * np.cos(heading) - v_y * np.sin(heading)),
        "position_y": _integral(v_x * np.sin(heading) + v_y * np.cos(heading)),
        "heading": heading,
        "speed": v_x,
        "longitudinal_velocity": v_x,
        "lateral_velocity": v_y,
        "yaw_rate": r,
        "lateral_acceleration": a_y + _GRAVITY * np.sin(leans),
        "longitudinal_acceleration": a_x + _GRAVITY * np.radians(rng.uniform(0, 0.6)) * _wandering(rng, n, 8.0),
        "steering_wheel_angle": ratio * ((front + rear) * r / v_x + rng.uniform(0, 0.003) * v_x * r),
    }


def recorded(rng: np.random.Generator) -> list[str]:
    """Return the signals that a drive's loggers hold: positions and the bus, and more or less of the rest."""
    names = ["position_x", "position_y", "speed", "yaw_rate"]
    names += ["heading"] * (rng.random() < 0.75)
    names += ["longitudinal_velocity", "lateral_velocity"] * (rng.random() < 0.3)
    names += [n for n in ("lateral_acceleration", "longitudinal_acceleration", "steering_wheel_angle")
              if rng.random() < 0.8]  # fmt: skip
    return names


def draw(seed: int, planted: str) -> Foreign:
    """Return a drawn drive.

    Args:
        seed: Of the drive; every ``planted`` of a seed has the same motion and loggers.
        planted: One of ``PLANTED``.
    """
    rng = np.random.default_rng([seed, 31])
    style = STYLES[rng.choice(len(STYLES), p=[0.4, 0.2, 0.2, 0.2])]
    truth, names = motion(rng, style), recorded(rng)
    bus_rate = float(rng.choice([1, 2, 5, 10, 20, 50, 100, 200], p=[0.05, 0.05, 0.1, 0.15, 0.1, 0.2, 0.25, 0.1]))
    receiver_rate = float(rng.choice([r for r in (1, 2, 5, 10, 20, 50, 100, 200) if r <= bus_rate][-4:]))
    two_clocks = bool(rng.random() < 0.4)
    noise = {n: rng.uniform(*_NOISE[n]) for n in names}
    own = np.random.default_rng([seed, 32, PLANTED.index(planted)])
    faults = _faults(own, planted, names)
    time = truth["time"]
    at_bus = np.arange(0.6, time[-1] - 0.05, 1 / bus_rate)
    at_receiver = at_bus[:: max(round(bus_rate / receiver_rate), 1)]
    if two_clocks:
        at_receiver = np.arange(0.6 + own.uniform(0, 1 / receiver_rate), time[-1] - 0.05, 1 / receiver_rate)
    mapping: dict[str, object] = {"title": f"foreign {seed}"}
    bus: dict[str, Floats] = {"t_bus": at_bus}
    receiver: dict[str, Floats] = {"t_receiver": at_receiver}
    for name in names:
        navigates = name in DEVICES["receiver"]
        at = at_receiver if navigates else at_bus
        late = sum(f.size for f in faults if f.kind == "delay" and name in f.signals)
        values = np.interp(at - late, time, truth[name]) + noise[name] * own.normal(size=len(at))
        for fault in faults:
            if name in fault.signals and fault.kind != "delay":
                values = {"scale": values * (1 + fault.size), "offset": values + fault.size,
                          "sign": -values, "unit": values * fault.size}[fault.kind]  # fmt: skip
        unit = {"heading": "rad", "yaw_rate": "rad/s", "steering_wheel_angle": "rad"}.get(name, "m/s")
        unit = "m/s^2" if "acceleration" in name else "m" if "position" in name else unit
        column = f"{'nav' if navigates else 'can'}_{name}"
        mapping[name] = {"channel": column, "unit": unit}
        if navigates and not two_clocks:
            sparse = np.full(len(at_bus), np.nan)
            sparse[:: max(round(bus_rate / receiver_rate), 1)] = values
            bus[column] = sparse
        else:
            (receiver if navigates else bus)[column] = values
    mapping["time"] = [{"channel": "t_bus", "unit": "s"}]
    tables = [Table(bus, {})]
    if two_clocks:
        mapping["time"] = [{"channel": c, "unit": "s"} for c in ("t_bus", "t_receiver")]
        tables.append(Table(receiver, {}))
    said = f"{style}, bus {bus_rate:g} Hz, receiver {receiver_rate:g} Hz, {len(tables)} clocks"
    return Foreign(style, faults, tables, mapping, (bus_rate, receiver_rate), said)


def _faults(rng: np.random.Generator, planted: str, names: list[str]) -> tuple[Fault, ...]:
    """Return what is wrong with a drive."""
    if planted == "nothing":
        return ()
    device = str(rng.choice(list(DEVICES)))
    late = Fault("delay", tuple(n for n in DEVICES[device] if n in names), float(rng.uniform(0.05, 0.4)))
    if planted == "one device":
        return (late,)
    either = float(rng.choice([-1, 1]))
    single = [
        Fault("scale", ("speed",), either * float(rng.uniform(0.01, 0.06))),
        Fault("offset", ("yaw_rate",), either * float(rng.uniform(0.01, 0.04))),
        Fault("sign", ("yaw_rate",), -1.0),
        Fault("unit", ("yaw_rate",), float(rng.choice([np.degrees(1), np.radians(1)]))),
        Fault("unit", ("speed",), float(rng.choice([3.6, 1 / 3.6]))),
        Fault("delay", ("speed",), float(rng.uniform(0.05, 0.4))),
        Fault("delay", ("yaw_rate",), float(rng.uniform(0.05, 0.4))),
    ]
    if "heading" not in names:
        single = [f for f in single if f.kind != "offset" and f != single[6]]
    first = single[rng.integers(len(single))]
    if planted == "one fault":
        return (first,)
    others = [f for f in (*single, late) if not set(f.signals) & set(first.signals)]
    return first, others[rng.integers(len(others))]
