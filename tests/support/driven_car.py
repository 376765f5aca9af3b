"""Drives of a car that was simulated, with or without an effect, and a first fit to them."""

import dataclasses

from harness.config import resolve_single
from harness.diagnosis.fitting import Fitting
from harness.diagnosis.model.hypotheses import coordinates
from harness.diagnosis.selection.forward_selection import first_variances
from harness.models.contracts import DriveContext
from harness.models.roles import VEHICLES
from harness.simulation.drives import build_drive
from harness.simulation.simulate import simulate_drive

CAR = {"vehicle": "car", "parameters": "blanco_2021", "tyre": "linear", "sensors": "car_navigation"}


SIGNALS = ("steering_wheel_angle", "speed", "yaw_rate", "lateral_acceleration", "lateral_velocity")


FREE = ("stiffness_peak_front", "stiffness_peak_rear")


def driven(seed, effects=(), duration=60.0, **values):
    """Return a drive of a car that was simulated at 1 ms and recorded at 10 ms; only random effects have noise."""
    spec = resolve_single({**CAR, "effects": list(effects), "values": values, "step": "1 ms"}, "test")
    random = spec.model().noise
    noise = {s: random.get(s, 0.0) * spec.step for s in spec.process_noise}
    spec = dataclasses.replace(spec, process_noise=noise)
    vehicle = VEHICLES.load("car")
    context = DriveContext(vehicle.wheelbase(spec.values), spec.values["steering_ratio"], spec.step)
    options = {
        "duration": duration,
        "speed": 20.0,
        "speed_variation": 4.0,
        "amplitude": 0.015,
        "seed": seed,
        "lateral_acceleration_limit": 9.0,
    }
    profile = build_drive("random_sequence", options, context, "test")
    return simulate_drive(spec, profile, [], seed).isel(time=slice(None, None, 10))


def fitted(augmented, drives):
    fitting = Fitting(augmented, drives, first_variances(augmented, drives))
    return fitting, fitting.fit(coordinates(augmented, FREE, (), len(drives)), fitting.first(), 10)
