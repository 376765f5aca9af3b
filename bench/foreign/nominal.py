"""What is published about the truck, as the parameter file that the tracer gets."""

from __future__ import annotations

from bench.foreign.logger import Logger
from bench.foreign.vehicle import AXLES, PUBLISHED

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
