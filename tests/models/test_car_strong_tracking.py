"""Li's car with stiffnesses as states: the equations, initial values, inputs from sensors, and a drop of stiffness."""

from __future__ import annotations

import types
from functools import cache
from pathlib import Path

import numpy as np
import pytest
import sympy as sp

from harness.common.errors import ModelError, UserError
from harness.config import load_study
from harness.engine.compile import compile_model
from harness.engine.simd.lanes import LANES
from harness.estimation.compiled_estimator import CompiledEstimator
from harness.models.assembly.assemble import assemble, symbol
from harness.models.assembly.expressions import larger
from harness.models.roles import PARAMETERS, VEHICLES
from harness.runner.contract import Batch, Held, InputSeries
from harness.runner.scores import Scoring
from harness.simulation.drives import build_drive
from harness.simulation.simulate import first_state, in_lanes, input_table
from harness.study.compiled_study import CompiledStudy
from support.cars import CAR, CONTEXT, WHEELS, function_of

# --- Li's car


def test_li_s_equations_with_negative_stiffness_are_ours():
    model = assemble("car_3dof")
    v_x, beta, r, k_1, k_2 = (symbol(s) for s in model.states)
    delta = symbol("steering_wheel_angle") / symbol("steering_ratio")
    m, I_z, a, b = (symbol(n) for n in ("mass", "yaw_inertia", "cog_to_front_axle", "cog_to_rear_axle"))
    K_1, K_2 = -k_1, -k_2  # the paper's
    printed = {
        "yaw_rate": (a**2 * K_1 + b**2 * K_2) / (I_z * v_x) * r
        + (a * K_1 - b * K_2) / I_z * beta
        - a * K_1 / I_z * delta,
        "sideslip_angle": (a * K_1 - b * K_2 - m * v_x**2) / (m * v_x**2) * r
        + (K_1 + K_2) / (m * v_x) * beta
        - K_1 / (m * v_x) * delta,
        "longitudinal_velocity": symbol("longitudinal_acceleration") + v_x * beta * r,
    }
    for state, expected in printed.items():
        ours = model.expand(model.derivatives[model.states.index(state)]).replace(larger, lambda *_: v_x)
        assert sp.simplify(ours - expected) == 0
    a_y = (a * K_1 - b * K_2) / (m * v_x) * r + (K_1 + K_2) / m * beta - K_1 / m * delta
    assert sp.simplify(model.expand(symbol("lateral_acceleration")).replace(larger, lambda *_: v_x) - a_y) == 0


def test_first_values_come_from_parameters_and_the_drive():
    model = assemble("car_3dof")
    profile = build_drive("j_turn", {"speed": 21.0, "amplitude": 0.1}, CONTEXT)
    parameters = np.arange(1.0, 1.0 + len(model.parameters))[:, None] * np.ones(LANES)
    x = dict(zip(model.states, first_state(model, parameters, profile)[:, 0], strict=True))
    index = model.parameter_names.index
    assert x["longitudinal_velocity"] == 21.0
    assert x["cornering_stiffness_front"] == 1.0 + index("first_stiffness_front")
    assert x["cornering_stiffness_rear"] == 1.0 + index("first_stiffness_rear")
    assert x["sideslip_angle"] == x["yaw_rate"] == 0.0


@pytest.mark.parametrize(
    ("start", "says"),
    [({"yaw_rat": 1.0}, "'yaw_rat', which is no state; closest: yaw_rate"), ({"yaw_rate": "sped"}, "closest: speed")],
)
def test_a_wrong_start_is_refused(start, says):
    vehicle = types.ModuleType("car_3dof")
    vehicle.__dict__.update(vars(VEHICLES.load("car_3dof")))
    vehicle.START = start
    with pytest.raises(ModelError, match=says):
        assemble(vehicle)


STUDY = Path(__file__).parents[2] / "studies" / "car-strong-tracking.toml"


@pytest.mark.parametrize("sensors", ["car_inertial", "car_lateral"])
def test_an_input_that_no_drive_states_comes_from_the_plant(sensors, tmp_path):
    """From its sensor, noise included; where it has none, exactly. One lane's input is not another's."""
    text = STUDY.read_text().replace('sensors = "car_inertial"', f'sensors = "{sensors}"')
    if sensors == "car_lateral":
        text = text.replace("longitudinal_acceleration = 1e-4\n", "")
    (tmp_path / "study.toml").write_text(text)
    compiled = CompiledStudy(load_study(tmp_path / "study.toml"))
    assert compiled.supplied == ("longitudinal_acceleration",)
    drive, rng = compiled.drives[0], np.random.default_rng(0)
    samples = len(drive.profile.time)
    truth = rng.normal(size=(samples, len(compiled.plant.signal_names), LANES))
    measured = rng.normal(size=(samples, compiled.plant.ny, LANES))
    known = compiled.known(0, Batch(truth, measured, np.full(LANES, float(samples))))
    names = list(compiled.belief.model.inputs)
    if sensors == "car_inertial":
        source = measured[:, list(compiled.plant.model.outputs).index("longitudinal_acceleration")]
    else:
        source = truth[:, compiled.plant.signal_names.index("longitudinal_acceleration")]
    np.testing.assert_array_equal(known[:, names.index("longitudinal_acceleration")], source)
    steering = in_lanes(drive.profile.steering_wheel_angle)
    np.testing.assert_array_equal(known[:, names.index("steering_wheel_angle")], steering)
    assert np.isnan(drive.belief[:, names.index("longitudinal_acceleration")]).all()  # not written into


def test_an_input_that_the_plant_does_not_have_is_refused(tmp_path):
    text = STUDY.read_text()
    begin, end = text.index("[plant]"), text.index("[belief]")
    truck = (
        '[plant]\nvehicle = "semitrailer"\nparameters = "ziaukas_2023"\ntyre = "magic_formula"\nsensors = "series"\n'
    )
    (tmp_path / "study.toml").write_text(text[:begin] + truck + text[end:])
    with pytest.raises(UserError, match="the belief needs input 'longitudinal_acceleration', which the plant does not"):
        load_study(tmp_path / "study.toml")


# --- a stiffness that drops


DROP, SHARE = 6.0, 0.6
Q = np.array([1e-6, 1e-7, 1e-7, 1e5, 1e5])
TRUE = ("longitudinal_velocity", "sideslip_angle", "yaw_rate", "cornering_stiffness_front", "cornering_stiffness_rear")
MEASURED = ("lateral_acceleration", "longitudinal_acceleration")


@cache
def drop_at_six_seconds():
    """Return the profile and the signals ``(samples, TRUE and MEASURED)`` of a sine at 20 m/s on failing tyres."""
    soft = types.ModuleType("soft")
    soft.PORT, soft.READS = tuple(f"cornering_stiffness_axle_{w}" for w in WHEELS), ()
    soft.PARAMETERS, soft.STATES = (), ()
    soft.apply = lambda e, value: value * (1 - (1 - SHARE) * sp.Heaviside(e.time - DROP, 0))
    model = assemble("car_two_track", "linear", {"soft": soft})
    options = {"speed": 20, "duration": 10, "lead_in": 1, "fade": 1, "frequency": 0.5, "amplitude": "40 deg"}
    profile = build_drive("sine", options | {"lateral_acceleration_limit": 20}, CONTEXT)
    f = function_of(model, (*TRUE, *MEASURED))
    x = dict.fromkeys(model.states, 0.0) | {"longitudinal_velocity": 20.0, "friction_coefficient": 1.0}
    kept = []
    for k, time in enumerate(profile.time):
        inputs = {"steering_wheel_angle": profile.steering_wheel_angle[k], "speed": 20.0, "time": time}
        found = f(CAR | {"speed_gain": 5.0, "camber_thrust": 0.0} | inputs | x)
        kept.append(found[len(x) :])
        x = {n: v + 0.01 * d for (n, v), d in zip(x.items(), found, strict=False)}
    return profile, np.array(kept)


def stiffness_error(**settings) -> np.ndarray:
    """Return the mean error of both stiffnesses in N/rad over time."""
    profile, kept = drop_at_six_seconds()
    noise = 0.01 * np.random.default_rng(1).standard_normal((len(kept), 2, LANES))
    truth, measured = in_lanes(kept[:, :5]), in_lanes(kept[:, 5:]) + noise
    model = assemble("car_3dof", None, (), "car_lateral")
    belief = compile_model(model, 0.01, "euler", 1, TRUE)
    inputs = in_lanes(input_table(profile, model, MEASURED[1:]))
    inputs[:, 1] = measured[:, 1]
    p = in_lanes(belief.parameter_vector(dict(PARAMETERS.load("li_2017").VALUES)))
    filter_ = CompiledEstimator("st_cdkf", belief, settings)
    held = Held(p, in_lanes(Q), np.full((1, LANES), 0.005), first_state(model, p, profile), in_lanes(Q))
    record = Scoring(truth, TRUE, np.full(LANES, float(len(kept))), keep=True)
    scores = filter_.run(InputSeries(inputs), np.ascontiguousarray(measured[:, :1]), held, record).scores()
    assert scores.kept is not None
    assert (scores.diverged_at == len(kept)).all()
    return np.abs(scores.kept[:, 0, 3:] - truth[:, 3:]).mean(axis=(1, 2))


def test_fading_follows_a_drop_of_stiffness_faster():
    faded, plain = stiffness_error(softening=4.0), stiffness_error(fading=False)
    before, after = slice(400, 600), slice(600, 700)
    assert plain[after].mean() > 2 * plain[before].mean()  # the drop is one that matters
    assert faded[after].mean() < 0.65 * plain[after].mean()
    assert faded[after].mean() > 0
