"""The drive that fills the columns of a header, and how a proposal fared."""

from __future__ import annotations

import itertools
import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from harness.common.errors import UserError
from harness.recordings.proposal.propose import Proposal, propose

_FACTORS = {
    "s": 1.0, "us": 1e6, "ms": 1e3, "m": 1.0, "1": 1.0, "N*m": 1.0, "1/km": 1e3, "rad": 1.0, "deg": 180 / np.pi,
    "m/s": 1.0, "km/h": 3.6, "mph": 1 / 0.44704, "ft/s": 1 / 0.3048, "knot": 3600 / 1852,
    "rad/s": 1.0, "mrad/s": 1e3, "deg/s": 180 / np.pi, "rpm": 30 / np.pi, "rad/s^2": 1.0,
    "m/s2": 1.0, "g": 1 / 9.80665, "ft/s2": 1 / 0.3048,
}  # fmt: skip
"""Units by how many of them an SI unit is."""

_RIGHT = {
    "speed": {"speed": "v vx"},
    "yaw rate": {"yaw_rate": "r", "yaw_rate_tractor": "r"},
    "steering": {"steering_wheel_angle": "swa", "road_wheel_angle": "delta"},
    "lateral acceleration": {"lateral_acceleration": "ay", "lateral_acceleration_tractor": "ay"},
    "longitudinal acceleration": {"longitudinal_acceleration": "ax"},
}
"""What is asked of a log: signals of a map, and the quantities that their columns may hold."""


@dataclass(frozen=True)
class Column:
    """One column of a log: what it holds, counted in which direction, and how many of its units an SI unit is."""

    name: str
    quantity: str
    sign: int
    factor: float


@dataclass(frozen=True)
class Log:
    """One log.

    Attributes:
        title: Whose header it is.
        rate: Samples in a second.
        columns: Its columns by name.
    """

    title: str
    rate: float
    columns: dict[str, Column]

    def write(self, path: Path, seed: int) -> Path:
        """Write a drive of 90 s under this header as semicolon-separated values, and return the path."""
        holds = drive(self.rate, seed)
        values = [c.sign * c.factor * holds[c.quantity] for c in self.columns.values()]
        lines = [";".join(self.columns), *(";".join(f"{x:.9g}" for x in row) for row in np.transpose(values))]
        path.write_text("\n".join(lines) + "\n", encoding="utf-8")
        return path

    def judged(self, found: Proposal) -> dict[str, str]:
        """Return what a proposal made of each signal that is asked for: ``right``, ``left out`` or ``wrong: why``.

        Signs count among each other: which of two is right a recording does not say.
        """
        guesses = {g.signal: g for g in found.guesses}
        signs = {
            self.columns[g.column].sign * g.sign
            for signal, g in guesses.items()
            if signal.startswith(("yaw_rate", "lateral_acc", "steering", "road")) and g.column in self.columns
        }
        return {asked: self._judged(found, right, len(signs) > 1) for asked, right in _RIGHT.items()}

    def _judged(self, found: Proposal, right: dict[str, str], torn: bool) -> str:
        fits = {c.name for c in self.columns.values() for holds in right.values() if c.quantity in holds.split()}
        guesses = [g for g in found.guesses if g.signal in right]
        for g in guesses:
            column = self.columns[g.column]
            if column.quantity not in right[g.signal].split():
                return f"wrong: {g.signal} is '{g.column}', which holds {column.quantity}"
            factor = float(np.nanmax(np.abs(g.si)) / np.nanmax(np.abs(g.values)))
            if not np.isclose(factor * column.factor, 1.0, rtol=1e-3):
                return f"wrong: {g.signal} is '{g.column}' in {g.unit}"
            if torn and g.signal.startswith(("yaw", "lateral", "steering", "road")):
                return "wrong: signs of lateral signals contradict each other"
            if g.signal.startswith("longitudinal") and column.sign * g.sign < 0:
                return f"wrong: {g.signal} is reversed"
        if guesses or not fits:
            return "right"
        return "left out" if all(found.left_out.get(name) for name in fits) else "wrong: left out without a reason"


def judged(table: str, folder: Path, seeds: Sequence[int]) -> list[str]:
    """Return how each signal of each log fared, for drives of several seeds; a refusal names all columns."""
    fared = []
    for log, seed in itertools.product(logs(table), seeds):
        try:
            answers = log.judged(propose(log.write(folder / "log.csv", seed)))
        except UserError:
            answers = dict.fromkeys(_RIGHT, "left out")
        fared += [f"{log.title}, {asked}: {answer}" for asked, answer in answers.items()]
    return fared


def logs(table: str) -> list[Log]:
    """Return the logs of a table."""
    made = []
    for title, body in re.findall(r"^# (.*)\n((?:[^#].*\n?)*)", table.strip() + "\n", re.MULTILINE):
        columns = {}
        for text in re.split(r";\s+", body.strip().replace(";\n", "; ").replace("\n", "; ")):
            name, holds, unit = re.fullmatch(r"(.*?) = (\S+) (\S+)", text).groups()
            columns[name] = Column(name, holds.lstrip("-"), -1 if holds[0] == "-" else 1, _FACTORS.get(unit, 1.0))
        title, _, rate = title.partition(" @ ")
        made.append(Log(title, float(rate or 20), columns))
    return made


def drive(rate: float, seed: int) -> dict[str, np.ndarray]:
    """Return what may be recorded of 90 s of a car that weaves, speeds up and brakes, in SI units, with noise."""
    rng = np.random.default_rng(seed)
    t = np.arange(0.0, 90.0, 1 / rate)
    mean, phase = rng.choice([9.0, 14.0, 22.0]), rng.uniform(0, 2 * np.pi, 4)
    v = mean * (1 + 0.25 * np.sin(2 * np.pi * t / 37 + phase[0]) + 0.08 * np.sin(2 * np.pi * t / 13 + phase[1]))
    swings = np.sin(2 * np.pi * t / 9 + phase[2]) + 0.8 * np.sin(2 * np.pi * t / 23 + phase[3]) + 0.3
    r = 0.012 * mean * swings / v * 9
    beta = (1.3 - 0.004 * v**2) * r / v
    course = 0.7 + np.cumsum(r) / rate + beta
    east, north = np.cumsum(v * np.cos(course)) / rate, np.cumsum(v * np.sin(course)) / rate
    ay, ax = 1.04 * (v * r + np.gradient(v * beta, t)), np.gradient(v, t) - v * beta * r
    delta = 2.8 * r / v + 0.002 * v * r
    psi, swa, track = course - beta, 16 * delta, 0.75
    trailer = np.convolve(np.r_[np.zeros(int(rate)), r], np.ones(int(rate) + 1) / (int(rate) + 1), "valid")[: len(t)]
    clean = {
        "v": v, "vx": v * np.cos(beta), "vy": v * beta, "r": r, "ax": ax, "ay": ay, "az": 9.81 + 0 * t,
        "swa": swa, "delta": delta, "swr": np.gradient(swa, t), "beta": beta, "racc": np.gradient(r, t),
        "roll": 0.006 * ay, "pitch": -0.004 * ax, "p": np.gradient(0.006 * ay, t), "q": np.gradient(-0.004 * ax, t),
        "vE": v * np.cos(course), "vN": v * np.sin(course), "climb": 0.1 * np.sin(t / 20), "E": east, "N": north,
        "wfl": v - track * r, "wfr": v + track * r, "wrl": v - track * r, "wrr": v + track * r,
        "rt": trailer, "hitch": np.cumsum(trailer - r) / rate, "hitchrate": trailer - r, "ayt": v * trailer,
        "curvature": r / v, "slip": 0.01 * ax, "wind": 4 + np.sin(t / 7), "cruise": np.round(v.mean()) + 0 * t,
    }  # fmt: skip
    clean |= {f"n{wheel}": clean[f"w{wheel}"] / 0.31 for wheel in ("fl", "fr", "rl", "rr")}
    gear = np.clip(v // 4, 1, 6)
    engine = 40 + 50 * v / gear
    clean |= {"engine": engine, "shaft": engine / 3, "motor": 30 * v, "turbine": 900 * np.sin(t / 9) ** 2 + 4000}
    sizes = {"v": 0.03, "vx": 0.03, "r": 0.003, "rt": 0.003, "ay": 0.1, "ax": 0.1, "swa": 0.005, "delta": 0.0004}
    noisy = {name: values + sizes.get(name, 1e-3) * rng.normal(size=len(t)) for name, values in clean.items()}
    wrapped = np.angle(np.exp(1j * psi))
    return noisy | {
        "t": t, "psi": wrapped, "course": (np.pi / 2 - course) % (2 * np.pi), "alt": 400 + t / 30, "gear": gear,
        "lat": np.radians(48 + np.degrees(north / 6.371e6)),
        "lon": np.radians(11 + np.degrees(east / 6.371e6 / np.cos(np.radians(48)))),
        "fan": 80 + 60 * np.round(np.abs(np.sin(t / 25))), "throttle": 0.2 + 0.1 * np.sin(t / 5),
        "percent": 20 + 10 * np.sin(t / 5), "swpercent": 100 * swa / 8.2, "brake": 2 + np.sin(t / 6), "sats": 9 + 0 * t,
        "noise": np.abs(rng.normal(size=len(t))), "temp": 80 + t / 40, "pwm": 1500 + 300 * np.sin(t / 4),
        "torque": 3 * np.sin(2 * np.pi * t / 9), "quat": np.sin(psi / 2),
    }  # fmt: skip
