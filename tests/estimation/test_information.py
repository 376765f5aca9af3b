"""What a drive tells of parameters at best."""

import numpy as np
import pytest

from harness.config import resolve_single
from harness.estimation.information import parameter_information, smallest_covariance
from harness.estimation.observability import synthetic_manoeuvre

TRUCK = {"vehicle": "semitrailer", "parameters": "ziaukas_2023", "tyre": "magic_formula"}


def bound(*names, sensors="stability_control", **further):
    table = {**TRUCK, "sensors": sensors, "unknown_parameters": list(names), **further}
    return parameter_information(resolve_single(table, "test", "belief"), synthetic_manoeuvre())


def test_a_constant_is_known_as_the_mean_of_its_measurements():
    """Measured directly, with a wide prior: the deviation falls with the root of the number of samples."""
    samples, r = 101, 0.04
    still, c = np.ones((samples - 1, 1, 1)), np.ones((samples, 1, 1))
    found = smallest_covariance(still, c, np.zeros((1, 1)), np.array([[r]]), np.array([[1e6]]))
    assert found[-1, 0, 0] == pytest.approx(r / (samples - 1), rel=1e-6)


def test_the_mass_is_known_once_the_steering_moves():
    std = bound({"name": "trailer_mass", "prior": "8 t"})["std"][:, 0]
    assert float(std[0]) == pytest.approx(8000.0)
    assert float(std.sel(time=3.9, method="nearest")) > 7900.0
    assert float(std[-1]) < 800.0


def test_a_sensor_more_tells_more():
    few = bound({"name": "trailer_mass", "prior": "8 t"}, sensors="series", unknown_inputs=["steering_wheel_angle"])
    many = bound({"name": "trailer_mass", "prior": "8 t"})
    assert float(few["std"][-1, 0]) > 2 * float(many["std"][-1, 0])


def test_another_unknown_makes_a_parameter_less_known():
    pair, alone = bound("trailer_mass", "trailer_inertia_scale"), bound("trailer_mass")
    assert pair["correlation"].to_numpy() == pytest.approx(pair["correlation"].to_numpy().T)
    assert float(pair["std"][-1, 0]) > 1.001 * float(alone["std"][-1, 0])
