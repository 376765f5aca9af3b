"""Limits of drives: as stated, and kept by every version of the vehicle."""

import numpy as np
import pytest

from harness.common.errors import UserError
from harness.config import single_drive
from harness.experiment.limits import Limits, PlannedMotion, limits_of, passed_by_vehicle
from harness.experiment.manoeuvres import MANOEUVRES, SearchRange
from harness.experiment.rehearsal import Rehearsal
from harness.identification.innovations import Innovations
from harness.simulation.drives import profile_of
from support.identification import CAR, model_of


@pytest.fixture(scope="module")
def car():
    return Innovations(model_of({**CAR, "integrator": "rk4"}), jobs=1)


def rehearsed(car, limits, versions=1, **options):
    values = car.stated()
    slipping = values.copy()
    slipping[car.names.index("stiffness_over_load_rear")] *= 0.2  # oversteers, and spins
    drive = single_drive(
        {"name": "a", "kind": "sine", "duration": 10.0, "lateral_acceleration_limit": 20.0} | options, "a"
    )
    return Rehearsal(car, car.spec, [values, slipping][:versions], 1, limits).of(drive)


def test_a_file_and_single_limits_are_read_with_their_units(tmp_path):
    file = tmp_path / "limits.toml"
    file.write_text('highest_speed = "90 km/h"\nroad_width = 12\n')
    limits = limits_of(file, {"road_width": "8 m"})
    assert (limits.highest_speed, limits.road_width, limits.road_length) == (25.0, 8.0, np.inf)


@pytest.mark.parametrize(
    ("stated", "said"),
    [
        ({"road_widht": 3.0}, "closest: road_width"),
        ({"road_width": "3 s"}, "limit, road_width"),
        ({"duration": -1.0}, "above zero"),
        ({"duration": 2.0}, "shorter than any manoeuvre"),
        ({"lowest_speed": 30.0}, "above highest_speed"),
    ],
)
def test_a_limit_that_is_none_is_refused(stated, said):
    with pytest.raises(UserError, match=said):
        limits_of(None, stated)


@pytest.mark.parametrize(
    ("passed", "limits", "options"),
    [
        ("steering_wheel_angle", {"steering_wheel_angle": 0.2}, {}),
        ("steering_rate", {"steering_rate": 0.1}, {}),
        ("highest_speed", {"highest_speed": 10.0}, {}),
        ("lowest_speed", {"lowest_speed": 18.0}, {}),
        ("duration", {"duration": 6.0}, {}),
        ("lateral_acceleration", {"lateral_acceleration": 0.5}, {}),
        ("longitudinal_acceleration", {"longitudinal_acceleration": 0.2}, {"kind": "step", "speed_change": -5.0}),
        ("friction", {"friction": 0.1}, {}),
        ("road_length", {"road_length": 100.0}, {}),
        ("road_width", {"road_width": 1.0}, {}),
    ],
)
def test_a_drive_that_passes_a_limit_is_refused_by_its_name(car, passed, limits, options):
    frequency = {} if "kind" in options else {"frequency": 0.3}
    options = {"speed": 15.0, "amplitude": 0.5} | frequency | options
    kept = rehearsed(car, Limits(), **options)
    assert not isinstance(kept, str)
    assert np.isfinite(kept.data[0].measurements).all()
    assert rehearsed(car, Limits(**limits), **options) == passed


def test_a_drive_is_refused_that_one_version_would_not_survive(car):
    options = {"speed": 18.0, "amplitude": 0.8, "frequency": 0.2, "duration": 20.0}
    limits = Limits(lateral_acceleration=9.0, duration=20.0)
    assert not isinstance(rehearsed(car, limits, **options), str)
    assert rehearsed(car, limits, versions=2, **options) == "lateral_acceleration"


def test_the_road_reaches_straight_on_behind_the_end(car):
    options = {"kind": "step", "speed": 10.0, "amplitude": 0.3, "duration": 6.0}
    ((_, y),) = rehearsed(car, Limits(), **options).motion.paths
    within, behind = np.ptp(y[:-1]), np.ptp(y)
    assert behind > 1.2 * within
    assert rehearsed(car, Limits(road_width=0.5 * (within + behind)), **options) == "road_width"


def test_the_road_is_that_of_every_body():
    straight, bent = (np.array([0.0, 50.0]), np.zeros(2)), (np.array([0.0, 40.0]), np.array([0.0, -5.0]))
    motion = PlannedMotion((straight, bent), np.zeros((2, 2)), np.zeros(2), np.zeros(2))
    assert passed_by_vehicle(motion, Limits(road_width=6.0)) == ""
    assert passed_by_vehicle(motion, Limits(road_width=4.0)) == "road_width"


@pytest.mark.parametrize("shortest", [0.0, 20.0])
@pytest.mark.parametrize("manoeuvre", MANOEUVRES, ids=lambda m: m.name)
def test_no_manoeuvre_is_cut_short_by_a_short_road(car, manoeuvre, shortest):
    room = SearchRange.of(car.spec, Limits(road_length=20.0, duration=10.0), shortest)
    drive = manoeuvre.drive(np.full(manoeuvre.free, 0.5), room, manoeuvre.name)
    assert drive.options["duration"] >= max(5.0, shortest)
    dwell = drive.kind == "sine_with_dwell"  # 1 s ahead, 1 / 0.7 s and 0.5 s
    assert not dwell or abs(profile_of(car.spec, drive).steering_wheel_angle[-1]) < 1e-9


@pytest.mark.parametrize("manoeuvre", MANOEUVRES, ids=lambda m: m.name)
def test_the_gentlest_of_each_manoeuvre_keeps_to_the_limits(car, manoeuvre):
    limits = Limits(lateral_acceleration=4.0, road_length=400.0)
    point = np.full(manoeuvre.free, 0.3)
    point[0] = 0.0
    drive = manoeuvre.drive(point, SearchRange.of(car.spec, limits), manoeuvre.name)
    kept = Rehearsal(car, car.spec, [car.stated()], 1, limits).of(drive)
    assert not isinstance(kept, str), kept
    assert np.abs(kept.motion.lateral_acceleration).max() > 0.1
