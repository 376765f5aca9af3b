"""Catalogue of what may be wrong with the plant: physical effects at three magnitudes.

Keys name fields of ``Semitrailer`` or ``Car``, ``Column``, ``Surroundings``, or ``<field of Channel>@<channel>``.
Where a basis is given it says what the medium magnitude is on a real vehicle; README.md says it at more length.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
from plant_sensors import ACCELEROMETER, NOISE, outputs

MAGNITUDES = ("small", "medium", "large")


@dataclass(frozen=True)
class Effect:
    """A physical effect.

    Attributes:
        name: In the library's words where the library has it.
        values: Three magnitudes of each key; ``{}`` in a key stands for the place.
        units: Of each key, in the order of ``values``.
        basis: How the magnitudes were chosen.
        places: Axles or channels, one of which is drawn.
        scale: Factor on the values by place, for values that are relative to something of the place.
        signed: Whether the sign is drawn; all keys change theirs together.
        change: Field of ``Changes`` at whose time it sets in.
        equivalent: Names under which the tracer may report the same equations.
        in_library: Whether the library has it.
        first_draw: Seed of the first draw that may choose it, so that earlier ones stay what they were.
    """

    name: str
    values: dict[str, tuple[float, float, float]]
    units: tuple[str, ...]
    basis: str
    places: tuple[str, ...] = ()
    scale: Mapping[str, float] = field(default_factory=dict)
    signed: bool = False
    change: str = ""
    equivalent: tuple[str, ...] = ()
    in_library: bool = True
    first_draw: int = 0

    def draw(self, magnitude: str, rng: np.random.Generator) -> tuple[str, dict[str, float]]:
        """Return the place (empty if there is no choice) and the values in SI units."""
        place = str(rng.choice(self.places)) if self.places else ""
        factor = self.scale.get(place, 1.0) * (float(rng.choice([-1.0, 1.0])) if self.signed else 1.0)
        column = MAGNITUDES.index(magnitude)
        return place, {key.format(place): factor * three[column] for key, three in self.values.items()}


def _ladder(small: float, medium: float, large: float, *shares: float) -> list[tuple[float, float, float]]:
    """Return one triple per share of the same three magnitudes."""
    return [(small * s, medium * s, large * s) for s in shares]


def _sensors(vehicle: str) -> list[Effect]:
    """Return what may be wrong with the sensors of a vehicle."""
    channels, accelerometer = outputs(vehicle), ACCELEROMETER[vehicle]
    gyros = tuple(c for c in channels if c.startswith("yaw_rate"))
    return [
        Effect(
            "sensor_bias",
            {"bias@{}": (1.0, 3.0, 10.0)},
            ("",),
            "1, 3 and 10 standard deviations of the channel's noise",
            places=channels,
            scale=NOISE[vehicle],
            signed=True,
        ),
        Effect(
            "sensor_gain",
            {"gain_error@{}": (0.01, 0.03, 0.10)},
            ("1",),
            "1 % is a good calibration, 3 % the data sheet of a series sensor, 10 % a wrong one",
            places=channels,
            signed=True,
        ),
        Effect(
            "sensor_gain_speed",
            {"gain_loss_per_speed@{}": (1 / 800, 1 / 400, 1 / 200)},
            ("s/m",),
            "the large one is the 1 - v/200 of the dissertation",
            places=gyros,
        ),
        Effect(
            "sensor_delay",
            {"sensor_delay@{}": (0.01, 0.03, 0.08)},
            ("s",),
            "one, three and eight samples; a busy bus delays by some 30 ms",
            places=channels,
        ),
        Effect(
            "sensor_lever_arm",
            {f"lever_arm@{accelerometer}": (0.2, 0.6, 1.5)},
            ("m",),
            "a sensor under the seat instead of in the centre of gravity",
            signed=True,
        ),
        Effect(
            "accelerometer_roll",
            {f"roll_per_acceleration@{accelerometer}": (0.002, 0.006, 0.015)},
            ("rad*s^2/m",),
            "3.4 deg of lean per g are usual, 8 deg a tall load on soft springs",
            equivalent=("sensor_gain",),
        ),
        Effect(
            "sensor_misalignment",
            {"misalignment@{}": (0.01, 0.03, 0.08)},
            ("rad",),
            "0.6, 1.7 and 4.6 deg about the vertical axis; fitted by eye it is some 2 deg",
            places=tuple(c for c in (accelerometer, "lateral_velocity") if c in channels),
            signed=True,
            first_draw=4098,
        ),
    ]


def _column(wheelbase_gain: float) -> list[Effect]:
    """Return what may be wrong with the steering; the angles that a vehicle uses differ by ``wheelbase_gain``."""
    g = wheelbase_gain
    return [
        Effect(
            "steering_offset",
            {"offset": (0.01 * g, 0.04 * g, 0.12 * g)},
            ("rad",),
            "0.6, 2.3 and 7 deg at the truck's steering wheel; half of that at the car's",
            signed=True,
        ),
        Effect(
            "steering_ratio_nonlinear",
            {"progression": (0.02 / g**2, 0.06 / g**2, 0.15 / g**2)},
            ("1/rad^2",),
            "2, 6 and 15 % shorter ratio at one radian (truck)",
        ),
        Effect("steering_lag", {"lag": (0.02, 0.06, 0.15)}, ("s",), "hydraulic assistance lags by 50 to 100 ms"),
        Effect("steering_delay", {"delay": (0.01, 0.04, 0.10)}, ("s",), "steer-by-wire and bus delay by 40 ms"),
        Effect(
            "steering_backlash",
            {"play": (0.01 * g, 0.04 * g, 0.10 * g)},
            ("rad",),
            "half the play: 2.3 deg; a worn truck column has 5 deg to either side",
        ),
    ]


_ONE, _TRAILER, _YAW, _TURN = _ladder(1500.0, 4000.0, 8000.0, 0.25, 1.0, 0.125, -1.3)

SEMITRAILER: list[Effect] = [
    Effect(
        "crosswind",
        {
            "gust_force_tractor": _ONE,
            "gust_force_trailer": _TRAILER,
            "gust_moment_tractor": _YAW,
            "gust_moment_trailer": _TURN,
        },
        ("N", "N", "N*m", "N*m"),
        "side area 35 m^2, 9, 14 and 20 m/s across; pressure centre 1.3 m behind the trailer's CoG",
        signed=True,
        change="gust",
    ),
    Effect("road_bank", {"bank": (0.01, 0.025, 0.06)}, ("rad",), "roads are crowned by 2.5 %, curves 6 %", signed=True),
    Effect(
        "road_bank_varying",
        {"bank_deviation": (0.005, 0.015, 0.03)},
        ("rad",),
        "standard deviation along a country road",
        equivalent=("road_bank",),
    ),
    Effect(
        "steering_ratio",
        {"steering_ratio": (23 * 1.02, 23 * 1.06, 23 * 1.15)},
        ("1",),
        "tolerance, other steering arm, other gearbox",
        equivalent=("parameter:steering_ratio",),
    ),
    *_column(1.0),
    Effect(
        "steering_compliance",
        {"steering_compliance": (1e-7, 3e-7, 8e-7)},
        ("rad/N",),
        "3e-7 is 0.17 deg per 10 kN of the front axle",
    ),
    Effect("kingpin_friction", {"kingpin_dry_moment": (2e3, 8e3, 2e4)}, ("N*m",), "mu 0.1, load 80 kN, radius 0.3 m"),
    Effect(
        "kingpin_damping", {"kingpin_damping": (1e4, 4e4, 1.2e5)}, ("N*m*s/rad",), "articulation dampers of long trucks"
    ),
    Effect(
        "lateral_load_transfer",
        {"transfer_loss": (0.7, 2.0, 4.0)},
        ("1",),
        "(2 h / track)^2 = 4 times half the curvature of the stiffness over load (0.55): 2.2",
    ),
    Effect(
        "longitudinal_load_transfer",
        {"tractor_cog_height": (0.5, 1.0, 1.4), "trailer_cog_height": (0.9, 1.8, 2.5)},
        ("m", "m"),
        "heights of the centres of gravity",
    ),
    Effect(
        "roll_steer",
        {"roll_steer_trailer": (4e-4, 1.3e-3, 4e-3)},
        ("rad*s^2/m",),
        "5 deg of roll per g, 5, 15 and 45 % of it steers",
    ),
    Effect(
        "self_steering_axle",
        {"self_steering": (3e-7, 1.5e-6, 8e-6)},
        ("rad/N",),
        "castor trail 0.05 m over the centring stiffness of the steered axle",
    ),
    Effect("lifted_axle", {"lift": (0.3, 0.6, 0.99)}, ("1",), "pressure taken off the bellows, or up altogether"),
    Effect(
        "tyre_force_offset",
        {"force_offset_{}": (150.0, 500.0, 1500.0)},
        ("N",),
        "ply steer and conicity, 0.5 to 2 % of the axle's load",
        places=("11", "12", "2"),
        signed=True,
    ),
    Effect(
        "friction_change",
        {"friction_drop": (0.15, 0.35, 0.55)},
        ("1",),
        "damp, wet, snow",
        change="friction",
    ),
    Effect(
        "tyre_stiffness_drift",
        {"stiffness_drift": (-4e-4, -1e-3, -2e-3)},
        ("1/s",),
        "5, 12 and 24 % softer after two minutes of warming up",
    ),
    Effect(
        "combined_slip",
        {"combined_slip": (0.5, 0.8, 1.1)},
        ("1",),
        "1 is the friction ellipse with equal axes; from 1.5 on the truck jackknifes",
    ),
    Effect("yaw_moment_control", {"yaw_control": (2e4, 6e4, 2e5)}, ("N*m*s/rad",), "brakes one side of the tractor"),
    Effect(
        "liquid_slosh",
        {"slosh_mass": (1e3, 4e3, 1e4), "slosh_frequency": (3.0, 3.0, 3.0)},
        ("kg", "rad/s"),
        "4, 17 and 42 % of the trailer's mass swing, 0.48 Hz",
    ),
    Effect(
        "payload_shift",
        {"payload_shift": (-0.2, -0.6, -1.2)},
        ("m",),
        "half of the load slips back by 1.2 m",
        change="payload",
    ),
    Effect(
        "aerodynamic_side_force",
        {"side_force_slope": (25.0, 60.0, 95.0)},
        ("N*s^2/m^2",),
        "density / 2 * 35 m^2 * slope of c_y, 1.2, 2.8 and 4.5 per rad",
    ),
    *_sensors("semitrailer"),
]

CAR: list[Effect] = [
    Effect(
        "crosswind",
        {"gust_force": (150.0, 400.0, 1000.0), "gust_moment": (30.0, 80.0, 200.0)},
        ("N", "N*m"),
        "side area 4 m^2, 8, 13 and 20 m/s across; pressure centre 0.2 m ahead of the CoG",
        signed=True,
        change="gust",
    ),
    *(e for e in SEMITRAILER if e.name in ("road_bank", "road_bank_varying", "tyre_stiffness_drift")),
    Effect(
        "steering_ratio",
        {"steering_ratio": (16 * 1.02, 16 * 1.06, 16 * 1.15)},
        ("1",),
        "tolerance, other steering arm, other gearbox",
        equivalent=("parameter:steering_ratio",),
    ),
    *_column(0.5),
    Effect(
        "steering_compliance",
        {"steering_compliance": (2e-7, 6e-7, 1.5e-6)},
        ("rad/N",),
        "2, 6 and 14 % of the front stiffness",
        equivalent=("parameter:stiffness_peak_front",),
    ),
    Effect(
        "longitudinal_load_transfer", {"cog_height": (0.3, 0.55, 0.8)}, ("m",), "height of the CoG of a saloon 0.55 m"
    ),
    Effect(
        "roll_steer", {"roll_steer": (2e-4, 6e-4, 2e-3)}, ("rad*s^2/m",), "4 deg of roll per g, 3, 8 and 28 % of it"
    ),
    Effect("tyre_relaxation", {"relaxation_length": (0.1, 0.4, 1.0)}, ("m",), "0.3 to 0.6 m is usual"),
    Effect(
        "tyre_force_offset",
        {"force_offset_{}": (30.0, 100.0, 300.0)},
        ("N",),
        "ply steer and conicity of two tyres",
        places=("front", "rear"),
        signed=True,
    ),
    Effect(
        "tyre_saturation", {"inverse_friction": (0.7, 1.0, 1.4)}, ("1",), "friction 1.4, 1.0 and 0.7, shape factor 1.3"
    ),
    Effect("yaw_moment_control", {"yaw_control": (1e3, 4e3, 1.2e4)}, ("N*m*s/rad",), "torque vectoring"),
    Effect(
        "aerodynamic_side_force",
        {"side_force_slope": (5.0, 15.0, 40.0)},
        ("N*s^2/m^2",),
        "density / 2 * 4 m^2 * slope of c_y, 2, 6 and 16 per rad",
    ),
    *_sensors("car"),
]

UNLISTED_SEMITRAILER: list[Effect] = [
    Effect(
        "wheel_imbalance",
        {"wheel_moment": (1e3, 4e3, 1.2e4)},
        ("N*m",),
        "non-uniform steered tyres, once per turn",
        in_library=False,
    ),
    Effect("tyre_memory", {"tyre_memory": (0.2, 0.5, 1.0)}, ("1",), "rubber stiffer when quick", in_library=False),
    Effect(
        "kingpin_spring",
        {"kingpin_cubic": (5e5, 2e6, 8e6)},
        ("N*m/rad^3",),
        "hardening stop of a guided coupling, 16 kN m at 0.2 rad",
        in_library=False,
    ),
    Effect("tandem_scrub", {"scrub_moment": (3e3, 1e4, 3e4)}, ("N*m",), "twin tyres against turning", in_library=False),
    Effect(
        "baffle_impact",
        {"slosh_mass": (1e3, 3e3, 8e3), "baffle_stiffness": (1e6, 3e6, 8e6)},
        ("kg", "N/m"),
        "a load that swings until it hits",
        in_library=False,
    ),
    Effect(
        "drivetrain_pulses",
        {"torque_pulse": (3e3, 1e4, 3e4)},
        ("N*m",),
        "jerks of unequal half shafts",
        in_library=False,
    ),
    Effect(
        "wheel_lift", {"lift_off": (0.1, 0.25, 0.5)}, ("1",), "inner wheels of the trailer in the air", in_library=False
    ),
]

UNLISTED_CAR: list[Effect] = [
    Effect("wheel_imbalance", {"wheel_moment": (300.0, 1e3, 3e3)}, ("N*m",), "once per wheel turn", in_library=False),
    Effect("tyre_memory", {"tyre_memory": (0.2, 0.5, 1.0)}, ("1",), "rubber stiffer when quick", in_library=False),
    Effect("drivetrain_pulses", {"torque_pulse": (200.0, 600.0, 2e3)}, ("N*m",), "jerks", in_library=False),
]

CATALOGUE: dict[str, dict[str, Effect]] = {
    "semitrailer": {e.name: e for e in (*SEMITRAILER, *UNLISTED_SEMITRAILER)},
    "car": {e.name: e for e in (*CAR, *UNLISTED_CAR)},
}
