"""Every vehicle of the library drives every kind of drive that needs no file, with all defaults."""

import numpy as np
import pytest

import harness as h
from harness.common.errors import ModelError, UserError
from harness.identification.measured_file import FINE
from harness.models.contracts import DRIVE_INPUTS
from harness.models.drive_options import kinds, options_of
from harness.models.drives._shapes import AMPLITUDE, LIMIT
from harness.models.roles import VEHICLES
from harness.simulation.drives import profile_of

WITHOUT_FILE = sorted(kind for kind, options in kinds().items() if all(o.default is not None for o in options))


def test_only_recorded_drives_need_a_file():
    assert set(kinds()) - set(WITHOUT_FILE) == {"from_file"}


@pytest.mark.parametrize("vehicle", VEHICLES.names())
def test_every_kind_with_its_defaults(vehicle):
    model = h.model(vehicle, integrator=FINE)
    measured = set(model.spec.model().inputs) - {"time", *DRIVE_INPUTS, *model.spec.model().rates}
    for kind in WITHOUT_FILE:
        drive = h.drive(kind)
        profile = profile_of(model.spec, drive)
        if measured - set(profile.further):  # a vehicle that follows a sensor has nothing to follow
            with pytest.raises(UserError, match="a simulated drive has no input"):
                h.simulate(model, drive)
            continue
        driven = h.simulate(model, drive)
        assert driven.sizes["time"] == len(profile.time), kind
        assert all(np.isfinite(values).all() for values in driven.data_vars.values()), kind


def test_a_default_amplitude_keeps_to_the_limit_and_a_stated_one_is_refused():
    """The wheelbase of a car takes what a tractor's does at its speed less the ratio of both."""
    car, truck = h.model("car"), h.model("semitrailer")
    sine = options_of("sine")
    default = next(o.default for o in sine if o.name == AMPLITUDE.name)
    steered = {v: np.abs(profile_of(m.spec, h.drive("sine")).steering_wheel_angle).max()
               for v, m in (("car", car), ("truck", truck))}  # fmt: skip
    assert steered["truck"] == pytest.approx(default, rel=1e-3)
    wheelbase = sum(car.spec.values[n] for n in ("cog_to_front_axle", "cog_to_rear_axle"))
    allowed = car.spec.values["steering_ratio"] * np.arctan(LIMIT.default * wheelbase / 15.0**2)
    assert steered["car"] == pytest.approx(allowed)
    with pytest.raises(ModelError, match=r"asks for 3\.28 m/s\^2"):
        profile_of(car.spec, h.drive("sine", amplitude=default))
    raised = profile_of(car.spec, h.drive("sine", lateral_acceleration_limit=4))
    assert np.abs(raised.steering_wheel_angle).max() == pytest.approx(default, rel=1e-3)
