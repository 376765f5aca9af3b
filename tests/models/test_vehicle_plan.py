"""Where axles and coupling stand, read out of the equations, is where the parameters have them."""

import pytest
import sympy as sp

from harness.models.assembly.assemble import Body, assemble
from harness.models.assembly.plan import Planner, _guessed
from harness.models.contracts import Parameter
from harness.models.roles import PARAMETERS, VEHICLES
from harness.testing.small_models import module


def plan(vehicle, tyre=None, effects=(), **other):
    file = VEHICLES.load(vehicle)
    sets = (PARAMETERS.load(name) for name in PARAMETERS.names())
    values = next(dict(s.VALUES) for s in sets if vehicle == s.VEHICLE) | other
    return Planner(assemble(file, tyre, effects), file).plan(values), values


@pytest.mark.parametrize(
    ("vehicle", "tyre"), [("car", "linear"), ("car_friction", "magic_formula"), ("car_3dof", None)]
)
def test_of_single_track_cars(vehicle, tyre):
    found, values = plan(vehicle, tyre)
    front, rear = found.axles["front"], found.axles["rear"]
    assert (front.x, rear.x) == pytest.approx((values["cog_to_front_axle"], -values["cog_to_rear_axle"]))
    assert (front.y, rear.y, front.steered, rear.steered) == (0, 0, 1, 0)
    assert found.coupling is None


def test_the_reference_of_the_velocity_is_not_taken_for_the_centre_of_gravity():
    found, values = plan("car_reference_point")
    assert found.axles["front"].x == pytest.approx(values["cog_to_front_axle"])
    assert found.axles["rear"].x == pytest.approx(values["cog_to_front_axle"] - values["axle_distance"])


def test_wheels_of_a_two_track_car_stand_half_a_track_from_the_middle():
    found, values = plan("car_two_track", "linear")
    for wheel, at in found.axles.items():
        track = values["track_front" if wheel[0] == "f" else "track_rear"]
        assert at.y == pytest.approx(track / 2 * (1 if wheel[1] == "l" else -1))


def test_of_the_semitrailer_at_another_loading():
    found, values = plan("semitrailer", "linear", trailer_cog_from_rear=7.0)
    assert found.coupling == pytest.approx((-values["tractor_cog_to_kingpin"], values["kingpin_from_rear"] - 7.0))
    assert found.axles["22"].x == pytest.approx(values["axle_22_from_rear"] - 7.0)
    assert found.along("22") == pytest.approx(
        -values["tractor_cog_to_kingpin"] - values["kingpin_from_rear"] + values["axle_22_from_rear"]
    )
    trailer, tractor = found.outlines["trailer"], found.outlines["tractor"]
    assert (trailer.front, trailer.back) == pytest.approx((values["trailer_length"] - 7.0, -7.0))
    assert trailer.stated
    assert not tractor.stated


def test_of_a_vehicle_that_the_library_does_not_have():
    def equations(v):
        m, w, v_y, v_x = v.p("mass"), v.state("yaw_rate"), v.state("lateral_velocity"), v.input("speed")
        v.body("", Body(v_x, v_y, w, m, sp.Integer(5)))
        delta = v.port("road_wheel_angle", v.input("steering_wheel_angle") / 20)
        forces = [
            v.tyre(axle, steer * delta - sp.atan((v_y + x * w) / v_x), m * 3, sp.Integer(1))
            for axle, (x, steer) in {
                "1": (3, 1),
                "2": (1.5, sp.Rational(1, 2)),
                "tag": (-2, sp.Rational(-1, 5)),
            }.items()
        ]
        v.derivative("lateral_velocity", sum(forces) / m - v_x * w)
        v.derivative("yaw_rate", (3 * forces[0] + 1.5 * forces[1] - 2 * forces[2]) / m)

    vehicle = module(
        "four_steered", STATES=("lateral_velocity", "yaw_rate"), INPUTS=("steering_wheel_angle", "speed"),
        AXLES={"1": "1", "2": "1", "tag": "1"}, VALID={}, equations=equations,
        PARAMETERS=(Parameter("mass", "m", "kg", 1.0, 1e5, "mass"),),
    )  # fmt: skip
    found = Planner(assemble(vehicle, "linear"), vehicle).plan({"mass": 1e4})
    assert [(a.x, round(a.steered, 9)) for a in found.axles.values()] == [(3.0, 1.0), (1.5, 0.5), (-2.0, -0.2)]


def test_what_has_no_axles_has_no_plan():
    assert plan("scalar_example")[0] is None
    assert plan("vehicle_heading")[0] is None


@pytest.mark.parametrize(
    ("vehicle", "lengths"),
    [
        ("car", {"cog_to_front_axle", "cog_to_rear_axle"}),
        (
            "semitrailer",
            {
                *(f"tractor_cog_to_{n}" for n in ("front_axle", "rear_axle", "kingpin")),
                *("kingpin_from_rear", "trailer_cog_from_rear"),
                *(f"axle_{n}_from_rear" for n in (21, 22, 23)),
            },
        ),
    ],
)
def test_what_says_where_axles_and_coupling_are_is_a_length(vehicle, lengths):
    file = VEHICLES.load(vehicle)
    model = assemble(file, "linear" if vehicle == "car" else "magic_formula")
    assert Planner(model, file).lengths == lengths


@pytest.mark.parametrize(
    ("points", "width"),
    [([(-1.0, 0.0), (2.0, 0.0)], 1.8), ([(-4.0, 0.0), (8.0, 0.0)], 2.5), ([(-1.0, -0.7), (2.0, 0.8)], 1.6)],
)
def test_a_guessed_outline_is_as_wide_as_its_wheels_stand_else_as_its_length_says(points, width):
    """Three fifths of the length, a lorry's width at most; a quarter of the length ahead and behind."""
    outline, (back, front) = _guessed(points), (points[0][0], points[1][0])
    assert outline.width == pytest.approx(width)
    overhang = (front - back) / 4
    assert (outline.back, outline.front) == pytest.approx((back - overhang, front + overhang))
