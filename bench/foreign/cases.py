"""The thirteen cases: what is missing in each, and how one is drawn and written.

The seed of a case decides its tyres, its logger and its three drives. What a tracer gets are ``d1.csv``, ``d2.csv``,
``d3.csv``, ``map.toml`` and ``nominal.toml``; ``truth.json`` is for the scoring.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from bench.foreign.driver import DURATION, Driver, draw_bank, draw_speed, draw_wind, half_steps
from bench.foreign.logger import Logger, csv_text, draw_delays, map_text, record
from bench.foreign.vehicle import AXLES, BANK, PUBLISHED, STEP, Floats, Truck, integrate, truck

DRIVES = ("d1", "d2", "d3")
TRUTH = "truth.json"
"""Written last: a case without it is written anew."""

SPREAD, FARTHEST = 0.03, 0.06
"""Standard deviation and limit of how far the cornering stiffness of an axle is from the published one, as a share."""

WIND_AHEAD = 0.4
"""m ahead of the trailer's CoG, where the wind acts."""


@dataclass(frozen=True)
class Case:
    """What is missing, and how it is driven and recorded.

    Attributes:
        name: A letter.
        seed: Of everything that is drawn.
        kind: ``nothing``, ``parameters``, ``effect``, ``sensor`` (a fault planted in one) or ``unlisted``.
        missing: In words, with its size.
        effects: What a trace should add, in the words of the project, ``name`` or ``name@place``.
        values: Parameters that are not as published, in SI units.
        acts: Fields of ``Truck`` that make the effects.
        shares: In which the trailer's axles carry its rear load.
        wind: Whether there is any.
        uneven: Whether the bank of the road varies.
        later_friction: To which the road's friction changes in each drive, if it does.
        gain: Of the articulation sensor.
        articulation_noise: Its standard deviation in degrees; drawn if ``None``.
        speed_noise: Of the recorded speed, m/s.
        five: Whether the trailer has an accelerometer.
        fast: Highest speed, m/s.
        hardest: Largest lateral acceleration that the driver asks for, m/s^2.
    """

    name: str
    seed: int
    kind: str
    missing: str
    effects: tuple[str, ...] = ()
    values: Mapping[str, float] = field(default_factory=dict)
    acts: Mapping[str, float] = field(default_factory=dict)
    shares: tuple[float, float, float] = (1.0, 1.0, 1.0)
    wind: bool = False
    uneven: bool = False
    later_friction: float | None = None
    gain: float = 1.0
    articulation_noise: float | None = None
    speed_noise: float = 0.02
    five: bool = False
    fast: float = 24.0
    hardest: float = 3.7


_ALL = (
    Case("a", 101, "nothing", "nothing"),
    Case("b", 202, "nothing", "nothing; the speed is noisier", speed_noise=0.03, five=True),
    Case(
        "c",
        303,
        "parameters",
        "trailer mass 28.8 t in place of 24 t, its CoG 8.1 m from the rear in place of 7.8 m",
        values={"trailer_mass": 28800.0, "trailer_cog_from_rear": 8.1},
        five=True,
    ),
    Case(
        "d",
        404,
        "parameters",
        "yaw inertia of the tractor 43750 kg·m² in place of 35000, steering ratio 23.92 in place of 23",
        values={"tractor_yaw_inertia": 43750.0, "steering_ratio": 23.92},
    ),
    Case("e", 505, "effect", "steering lag of 60 ms", ("steering_lag",), acts={"steering_lag": 0.06}),
    Case(
        "f",
        606,
        "effect",
        "crosswind on the trailer: 1.5 kN, and 4.5 kN more in a gust of 20 to 30 s",
        ("crosswind@trailer",),
        wind=True,
        five=True,
    ),
    Case(
        "g",
        707,
        "effect",
        "the last axle steers itself: 0.75 of its slip angle is lost, 80 ms late",
        ("self_steering_axle@23",),
        acts={"self_steering": 0.75},
        five=True,
    ),
    Case(
        "h",
        818,
        "sensor",
        "the articulation sensor reads 3.5 % too much",
        ("sensor_gain@articulation_angle",),
        gain=1.035,
        articulation_noise=0.05,
        fast=14.0,
        hardest=4.2,
    ),
    Case(
        "i",
        909,
        "effect",
        "the last axle is steered by 0.2 of the articulation angle",
        ("forced_steering@23",),
        acts={"forced_steering": 0.2},
        five=True,
    ),
    Case(
        "j",
        1010,
        "effect",
        "the road's friction falls from 0.9 to 0.35 within 0.6 s",
        ("friction_change",),
        later_friction=0.35,
        hardest=4.3,
    ),
    Case(
        "k",
        1111,
        "effect",
        "the road is banked by 0.02 rad, and the first axle of the trailer is lifted",
        ("road_bank", "lifted_axle@21"),
        acts={"bank": 0.02},
        shares=(1e-6, 1.0, 1.0),
        five=True,
    ),
    Case(
        "l",
        1212,
        "unlisted",
        "a locked differential on the drive axle: 8.6 kN·m against a bend of 100 m radius",
        acts={"locked_differential": 8.6e5},
        five=True,
    ),
    Case(
        "m",
        1313,
        "effect",
        "a bank of the road that goes from level to level, up to 0.03 rad",
        ("road_bank_varying",),
        uneven=True,
    ),
)
CASES = {case.name: case for case in _ALL}
"""By their letter."""


def write_case(case: Case, folder: Path, seconds: float = DURATION) -> None:
    """Draw a case and write what the tracer gets, and then what is true.

    Args:
        case: Which.
        folder: Where to, made if absent.
        seconds: Length of each of its three drives.

    Raises:
        FloatingPointError: If the truck left the range in which its equations hold.
    """
    rng = np.random.default_rng(case.seed)
    stiffness = 1 + np.clip(SPREAD * rng.standard_normal(5), -FARTHEST, FARTHEST)
    logger = _draw_logger(case, rng)
    driven = truck(case.values, stiffness, case.shares)._replace(**case.acts)
    folder.mkdir(parents=True, exist_ok=True)
    stories = {}
    for name in DRIVES:
        recorded, stories[name] = _drive(case, driven, logger, int(rng.integers(2**60)), seconds)
        (folder / f"{name}.csv").write_text(csv_text(recorded), encoding="utf-8")
    (folder / "map.toml").write_text(map_text(logger), encoding="utf-8")
    (folder / "nominal.toml").write_text(nominal_text(logger), encoding="utf-8")
    (folder / TRUTH).write_text(json.dumps(_truth(case, logger, stiffness, stories), indent=1) + "\n", encoding="utf-8")


def _draw_logger(case: Case, rng: np.random.Generator) -> Logger:
    delays = draw_delays(rng)
    gyroscopes, drifts = rng.uniform(0.15, 0.2, 2), rng.uniform(0.05, 0.1, 2)
    noise = float(rng.uniform(0.05, 0.1))
    noise = noise if case.articulation_noise is None else case.articulation_noise
    return Logger(delays, gyroscopes, drifts, noise, case.gain, case.speed_noise, case.five)


def _drive(
    case: Case, driven: Truck, logger: Logger, seed: int, seconds: float
) -> tuple[dict[str, Floats], dict[str, Any]]:
    """Return what is recorded of one drive, and what happened in it."""
    rng = np.random.default_rng(seed)
    t = half_steps(seconds)
    u = np.zeros((t.size, 6))
    u[:, 1], u[:, 2] = draw_speed(rng, t, fast=case.fast)
    u[:, 0] = Driver(rng, t, u[:, 1]).steering(case.hardest)
    story: dict[str, Any] = {}
    if case.wind:
        u[:, 3], story["gust"] = draw_wind(rng, t)
        u[:, 4] = WIND_AHEAD * u[:, 3]
    if case.uneven:
        u[:, BANK] = draw_bank(rng, t)
        story["bank"] = round(float(u[:, BANK].std()), 4)
    if case.later_friction is not None:
        begin = float(rng.uniform(42, 72))
        driven = driven._replace(later_friction=case.later_friction, friction_change=begin)
        story["friction_changes_at"] = round(begin, 1)
    outputs = integrate(u, driven, STEP)
    if not np.isfinite(outputs).all():
        raise FloatingPointError(f"case {case.name}: the truck left the range in which its equations hold")
    noise = np.random.default_rng(int(rng.integers(2**60)))
    return record(noise, outputs, u[::2, 0], logger, STEP), story | _extent(outputs)


def _extent(outputs: Floats) -> dict[str, Any]:
    """Return least and largest speed (m/s), largest lateral acceleration (m/s^2) and articulation (rad) of a drive."""
    speed, acceleration, angle = outputs[:, 0], np.abs(outputs[:, 4]), np.abs(outputs[:, 3])
    return {
        "speed": [round(float(speed.min()), 1), round(float(speed.max()), 1)],
        "lateral_acceleration": round(float(acceleration.max()), 2),
        "articulation_angle": round(float(angle.max()), 3),
    }


def _truth(case: Case, logger: Logger, stiffness: Floats, stories: Mapping[str, Any]) -> dict[str, Any]:
    """Return what is true of a case: delays in s, cornering stiffnesses over the published ones."""
    recorded = ("speed", "steering_wheel_angle", *logger.outputs)
    return {
        **{key: asdict(case)[key] for key in ("name", "seed", "kind", "missing", "effects", "values")},
        "faults": logger.faults,
        "delays": {signal: logger.delays[signal] for signal in recorded},
        "stiffness": [round(float(s), 4) for s in stiffness],
        "drives": stories,
    }


NUMERICAL = {"trailer_inertia_scale": 1.0, "constraint_rate": 10.0}
"""What the nominal model wants to know besides: yaw inertia over that of a box, rate that restores the kingpin tie."""

PROCESS_NOISE = {
    "lateral_velocity_tractor": 1e-10,
    "yaw_rate_tractor": 1e-10,
    "lateral_velocity_trailer": 5e-8,
    "yaw_rate_trailer": 1e-9,
    "articulation_angle": 1e-10,
    **{f"lateral_force_axle_{axle}": 1000.0 for axle in AXLES},
    "steering_wheel_angle": 1e-5,
}
"""First variances per step of ``NOISE_STEP``, SI squared; a trace fits them."""

NOISE_STEP = 0.01

MEASUREMENT_NOISE = {
    "yaw_rate_tractor": 1.0e-5,
    "yaw_rate_trailer": 1.0e-5,
    "articulation_angle": 1.7e-6,
    "lateral_acceleration_tractor": 0.0025,
    "lateral_acceleration_trailer": 0.0036,
}
"""First variances per sample, SI squared, as the data sheets of such sensors have them."""


def nominal_text(logger: Logger) -> str:
    """Return the parameter file of the published truck with the sensors of a logger."""
    noise = {signal: MEASUREMENT_NOISE[signal] for signal in logger.outputs}
    tables = {"values": {**PUBLISHED, **NUMERICAL}, "process_noise": PROCESS_NOISE, "measurement_noise": noise}
    lines = [
        'vehicle = "semitrailer"',
        'tyre = "brush"',
        f'sensors = "{", ".join(logger.outputs)}"',
        'source = "published values; the tyre is believed to be a brush tyre"',
        f"noise_step = {NOISE_STEP}",
    ]
    for name, table in tables.items():
        lines += ["", f"[{name}]", *(f"{key} = {value!r}" for key, value in table.items())]
    return "\n".join(lines) + "\n"
