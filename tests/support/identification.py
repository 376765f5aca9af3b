"""Recordings of known models, for the tests of identification."""

import dataclasses

import numpy as np

from harness.config import resolve_single
from harness.identification.innovations import Innovations
from harness.models.contracts import DriveContext
from harness.models.roles import VEHICLES
from harness.simulation.drives import build_drive
from harness.simulation.simulate import simulate_drive

CAR = {
    "vehicle": "car_reference_point",
    "parameters": "sun_2015",
    "sensors": "car_reference",
    "noise": {"process_scale": 0.01},  # Sun's is as large as the measurement noise and hides the inertia
}
TRUCK = {
    "vehicle": "semitrailer",
    "parameters": "ziaukas_2023",
    "tyre": "magic_formula",
    "sensors": "test_vehicle",
}


def model_of(table, **values):
    """Return a resolved model with some values replaced."""
    spec = resolve_single(table, "test")
    return dataclasses.replace(spec, values={**spec.values, **values})


def recorded(spec, seed, signals=(), kind="random_sequence", **options):
    """Return a simulated drive with its noise."""
    vehicle = VEHICLES.load(spec.vehicle)
    context = DriveContext(vehicle.wheelbase(spec.values), spec.values["steering_ratio"], spec.step)
    return simulate_drive(spec, build_drive(kind, options, context, "test"), signals, seed)


def car_fit(seed, duration=20.0, speed=15.0, jobs=1, kind="ekf", **values):
    """Return a car's filter with some values wrong, and a drive recorded by the right car."""
    recording = recorded(model_of(CAR), seed, duration=duration, speed=speed, speed_variation=2.0, amplitude=0.55)
    innovations = Innovations(model_of(CAR, **values), kind, jobs)
    return innovations, innovations.drive(recording, "drive")


def five_point(f, z, j, h):
    """Return the derivative of ``f`` over candidates ``(n, k)`` along one coordinate, of fourth order."""
    points = np.repeat(z[:, None], 4, axis=1)
    points[j] += h * np.array([-2.0, -1.0, 1.0, 2.0])
    low, before, after, high = f(points)
    return (8 * (after - before) - (high - low)) / (12 * h)
