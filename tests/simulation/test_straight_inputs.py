"""Inputs that run straight between samples: what a simulation is driven by is what its recording is read as."""

import numpy as np

import harness as h
from harness.identification.measured_inputs import inputs_of
from harness.simulation.drives import profile_of
from harness.simulation.simulate import input_table, simulate_drive, straight


def test_a_recording_is_read_as_it_was_driven():
    truck = h.model("semitrailer", "ziaukas_2023")
    drive = h.drive("winding_road", duration="20 s", speed="15 m/s")
    model, step = truck.spec.model(), truck.spec.step
    at, between = straight(input_table(profile_of(truck.spec, drive), model), model)
    read = inputs_of(h.simulate(truck, drive, seed=1), model, step, "joined")
    np.testing.assert_array_equal(read.at, at)
    np.testing.assert_array_equal(read.between, between)
    speed, rate = (model.inputs.index(name) for name in ("speed", "speed_rate"))
    np.testing.assert_allclose(np.diff(at[:, speed]) / step, between[:-1, rate], atol=1e-12)
    assert np.ptp(at[:, rate]) > 0.1


def test_the_step_of_a_simulation_takes_the_inputs_behind_the_sample():
    """The same drive, sampled ten times as finely and held, is what straight inputs come near; held ones lag."""
    found = {}
    for step, held in (("10 ms", True), ("10 ms", False), ("1 ms", True)):
        car = h.model("car", "govindarajan_2018", sensors="car_series", integrator="rk4", step=step)
        drive = h.drive("sine", duration="10 s", amplitude="20 deg", frequency="1 Hz")
        profile = profile_of(car.spec, drive)
        every = round(0.01 / car.spec.step)
        found[step, held] = simulate_drive(car.spec, profile, held=held)["yaw_rate"].to_numpy()[::every]
    fine = found["1 ms", True]
    errors = {held: float(np.abs(found["10 ms", held] - fine).max()) for held in (True, False)}
    assert errors[False] < 0.3 * errors[True]
    assert errors[False] < 0.01 * np.abs(fine).max()
