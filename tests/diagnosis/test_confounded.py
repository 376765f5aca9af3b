"""Directions that drives do not tell apart: known from the equations, and named in their words."""

import dataclasses
from types import SimpleNamespace

import numpy as np
import pytest

from harness.diagnosis.fitting import Fitting
from harness.diagnosis.model.hypotheses import coordinates, hypotheses
from harness.diagnosis.result.confounded import Direction, confounded, most, null_direction
from harness.diagnosis.selection.forward_selection import first_variances
from support.driven_car import FREE, driven

ALL = ("mass", "yaw_inertia", *FREE)


@pytest.fixture(scope="module")
def fitting(augmented):
    train = [augmented.drive(driven(seed, duration=30.0), f"drive {seed}") for seed in (40, 41)]
    return Fitting(augmented, train, first_variances(augmented, train))


def loaded(fitting):
    """Return the stated values, but tyres whose stiffness does not depend on the load: that of the axle is the best."""
    augmented, point = fitting.augmented, fitting.first()
    values, stated = point.values.copy(), augmented.spec.values
    a, b = stated["cog_to_front_axle"], stated["cog_to_rear_axle"]
    for axle, ahead in (("front", b), ("rear", a)):
        values[augmented.row(f"stiffness_load_{axle}")] = stated["mass"] * 9.80665 * ahead / (a + b)
    return dataclasses.replace(point, values=values)


def traced(fitting, free, *added):
    """Return a trace that ended at the stated values, with what it fitted."""
    augmented = fitting.augmented
    every = {h.name: h for h in hypotheses(augmented, free)}
    chosen = tuple(every[name] for name in added)
    final = SimpleNamespace(coordinates=coordinates(augmented, free, chosen, 2), point=loaded(fitting))
    return SimpleNamespace(fitting=fitting, free=free, added=chosen, final=final)


def test_lateral_sensors_know_no_mass_but_ratios_to_it(fitting):
    """m vy' = ..., I r' = ...: all of mass, inertia and both stiffnesses times one factor is the same motion."""
    directions = confounded(traced(fitting, ALL), ())
    assert {"mass", "yaw_inertia", *FREE} == {directions[0].parameter, *directions[0].changes}
    assert directions[0].powers == dict.fromkeys(directions[0].changes, 1.0)
    exact = [c / directions[0].change for c in directions[0].changes.values()]
    assert exact == pytest.approx([1.0, 1.0, 1.0], abs=1e-3)
    assert str(directions[0]) == (
        "These drives know the yaw inertia over the mass, the stiffness peak front over the mass and the stiffness "
        "peak rear over the mass, but none of these alone."
    )
    assert len(directions) == 1


def test_a_wrong_mass_hinges_on_what_was_held(fitting):
    """The inertia is stated and was not fitted; without it nothing would be confounded."""
    direction = confounded(traced(fitting, FREE, "mass"), ())[0]
    assert direction.parameter == "mass"
    assert {*direction.changes} == {"yaw_inertia", *FREE}


def test_what_hardly_changes_is_not_named(fitting):
    """At the stated values the stiffness grows with the load nearly as the mass does."""
    trace = traced(fitting, ALL)
    trace.final.point = fitting.first()
    direction = confounded(trace, ())[0]
    assert (direction.parameter, direction.named, direction.powers) == ("mass", ("yaw_inertia",), {"yaw_inertia": 1.0})
    assert {*direction.changes} == {"yaw_inertia", *FREE}
    assert str(direction) == "These drives know the yaw inertia over the mass, but neither alone."


def test_a_rival_that_is_absent_is_named_beside_what_changes_most():
    widths = np.array([0.2, 0.2, 0.05, np.inf])
    assert most({0: 0.15, 1: -0.01, 2: 0.04, 3: 3e-6}, widths) == [0, 2, 3]
    assert most({3: 3e-6}, widths) == [3]


def test_an_amplitude_that_ended_at_none_of_it_is_not_in_question(fitting):
    assert confounded(traced(fitting, (), "sensor_bias@yaw_rate"), ()) == ()


def test_what_the_drives_know_is_not_confounded(fitting, augmented):
    """A bias of one sensor is like no value of the vehicle."""
    trace = traced(fitting, (), "sensor_bias@yaw_rate")
    values = trace.final.point.values.copy()
    values[augmented.row("sensor_bias_yaw_rate")] = 0.01
    trace.final.point = dataclasses.replace(trace.final.point, values=values)
    assert confounded(trace, ()) == ()


def test_no_more_are_named_than_are_needed():
    rng = np.random.default_rng(5)
    X = rng.normal(size=(500, 5))
    X[:, 0] = 2.0 * X[:, 1] - X[:, 3]
    R = np.linalg.qr(100.0 * X, mode="r")
    assert null_direction(R, 0, [1, 2], [3, 4], 0.2) == pytest.approx({1: -0.4, 3: 0.2})
    assert null_direction(R, 0, [2], [4], 0.2) == {}
    assert null_direction(R, 4, [1, 2], [3], 0.2) == {}


def test_a_direction_is_said_in_powers_or_as_a_sum():
    def said(change, units=("kg", "N/rad"), logarithmic=True, name="mass"):
        names = (name, "stiffness")
        return str(
            Direction(
                name,
                0.1,
                {"stiffness": change},
                ("stiffness",),
                dict.fromkeys(names, logarithmic),
                dict(zip(names, units, strict=True)),
            )
        )

    assert said(0.1) == "These drives know the stiffness over the mass, but neither alone."
    assert said(-0.2) == "These drives know the stiffness times the square of the mass, but neither alone."
    assert said(0.05) == "These drives know the square of the stiffness over the mass, but neither alone."
    assert "do not tell the mass from the stiffness: +10.5 % of the mass acts as −6.97 % of the stiffness" in said(
        0.0723
    )
