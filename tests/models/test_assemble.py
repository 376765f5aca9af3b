"""Wiring errors are refused when a model is assembled, with a message that names the parts."""

from __future__ import annotations

import types

import pytest
import sympy as sp

from harness.common.errors import ModelError
from harness.models.assembly.assemble import assemble, symbol
from harness.models.contracts import Parameter
from support.numeric import evaluator


def part(name: str, **exports) -> types.ModuleType:
    module = types.ModuleType(name)
    for key, value in exports.items():
        setattr(module, key, value)
    return module


def parameter(name: str, unit: str = "dimensionless", neutral: float | None = None) -> Parameter:
    return Parameter(name, name[0], unit, 0.0, 10.0, name, neutral)


def vehicle(equations, **more) -> types.ModuleType:
    """Return a small vehicle: a yaw rate that lags behind the steering."""
    base = {
        "STATES": ("yaw_rate_tractor",),
        "INPUTS": ("steering_wheel_angle", "speed"),
        "PARAMETERS": (parameter("lag", "s"), parameter("steering_ratio")),
        "AXLES": {},
        "VALID": {"yaw_rate_tractor": 5.0},
        "equations": equations,
    }
    return part("harness.models.vehicles.toy", **{**base, **more})


def steer(v) -> None:
    angle = v.port("road_wheel_angle", v.input("steering_wheel_angle") / v.p("steering_ratio"))
    v.derivative("yaw_rate_tractor", (angle - v.state("yaw_rate_tractor")) / v.p("lag"))


def effect(apply, **more) -> types.ModuleType:
    base = {
        "PORT": "road_wheel_angle",
        "READS": (),
        "PARAMETERS": (parameter("gain", neutral=1.0),),
        "STATES": (),
    }
    return part("toy_effect", apply=apply, **{**base, **more})


def scaled(e, value):
    return e.p("gain") * value


GYRO = part("gyro", OUTPUTS={"yaw_rate_tractor": "yaw_rate_tractor"})
VALUES = {"lag": 0.5, "steering_ratio": 2.0, "gain": 3.0}


def rate(model, x, u, values=VALUES, **quantities):
    return evaluator(model, values, **quantities)(x, u)


# --- a model that fits together


def test_a_small_vehicle_becomes_a_model():
    model = assemble(vehicle(steer), sensors=GYRO)
    assert model.name == "toy"
    assert model.states == ("yaw_rate_tractor",)
    assert model.inputs == ("steering_wheel_angle", "speed")
    assert model.parameter_names == ("lag", "steering_ratio")
    assert list(model.outputs) == ["yaw_rate_tractor"]
    assert rate(model, [0.25], [1.0, 10.0]) == pytest.approx([(0.5 - 0.25) / 0.5])
    assert model.expand(model.outputs["yaw_rate_tractor"]) == symbol("yaw_rate_tractor")


def test_resolve_knows_states_inputs_and_ports_only():
    model = assemble(vehicle(steer))
    for name in ("yaw_rate_tractor", "speed", "road_wheel_angle"):
        assert model.resolve(name) == symbol(name)
    with pytest.raises(ModelError, match=r"'toy' has no quantity 'yaw_rate'; closest: .*yaw_rate_tractor"):
        model.resolve("yaw_rate")


def test_ports_are_in_order_of_use_even_if_published_late():
    def equations(v):
        angle = v.port("road_wheel_angle", symbol("slip_angle_axle_11") + v.input("steering_wheel_angle"))
        v.port("slip_angle_axle_11", 2 * v.input("speed"))
        v.derivative("yaw_rate_tractor", angle)

    model = assemble(vehicle(equations))
    assert list(model.ports) == ["slip_angle_axle_11", "road_wheel_angle"]
    assert rate(model, [0.0], [1.0, 10.0]) == pytest.approx([21.0])


def test_a_rate_becomes_an_input_that_knows_its_source():
    def equations(v):
        v.derivative("yaw_rate_tractor", v.rate("speed") + v.rate("speed"))

    model = assemble(vehicle(equations))
    assert model.inputs == ("steering_wheel_angle", "speed", "speed_rate")
    assert model.rates == {"speed_rate": "speed"}
    assert rate(model, [0.0], [0.0, 1.0, 2.0]) == pytest.approx([4.0])


# --- vehicles wired wrongly


def twice_a_port(v):
    steer(v)
    v.port("road_wheel_angle", 1)


def port_over_a_state(v):
    v.port("yaw_rate_tractor", 1)


def twice_a_derivative(v):
    steer(v)
    v.derivative("yaw_rate_tractor", 0)


def cycle(v):
    v.port("road_wheel_angle", 2 * symbol("slip_angle_axle_11"))
    v.port("slip_angle_axle_11", 3 * symbol("road_wheel_angle"))
    v.derivative("yaw_rate_tractor", symbol("road_wheel_angle"))


@pytest.mark.parametrize(
    ("equations", "says"),
    [
        (twice_a_port, "'road_wheel_angle' has two writers in 'toy'"),
        (port_over_a_state, "'yaw_rate_tractor' has two writers in 'toy'"),
        (twice_a_derivative, "the derivative of 'yaw_rate_tractor' has two writers in 'toy'"),
        (cycle, "'toy': ports read each other in a cycle: road_wheel_angle -> slip_angle_axle_11 -> road_"),
        (lambda v: None, "'toy': no derivative for yaw_rate_tractor"),
        (lambda v: v.derivative("speed_tractor", 0), "'speed_tractor' is not a state of 'toy'"),
        (lambda v: v.state("yaw"), "reads undeclared state 'yaw'"),
        (lambda v: v.input("brake"), "reads undeclared input 'brake'"),
        (lambda v: v.p("mass"), "reads undeclared parameter 'mass'"),
        (
            lambda v: v.port("road_wheel_angel", 1),
            "no known signal (models/signals.py, or SIGNALS of the file); closest: road_wheel_angle",
        ),
        (lambda v: v.tyre("11", 0, 1, 1), "vehicle 'toy' needs a tyre"),
    ],
)
def test_a_vehicle_wired_wrongly_is_refused(equations, says):
    with pytest.raises(ModelError) as caught:
        assemble(vehicle(equations))
    assert says in str(caught.value)


@pytest.mark.parametrize(
    ("stranger", "says"),
    [
        (symbol("slip_angle_axle_11"), "reads 'slip_angle_axle_11', which nothing provides"),
        (
            symbol("steering_ration"),
            "reads 'steering_ration', which nothing provides; closest: steering_ratio",
        ),
        (sp.Symbol("lag"), "reads 'lag', which nothing provides"),  # not the builder's real symbol
    ],
)
def test_a_symbol_that_nothing_provides_is_refused(stranger, says):
    with pytest.raises(ModelError) as caught:
        assemble(vehicle(lambda v: v.derivative("yaw_rate_tractor", stranger * v.p("lag"))))
    assert f"'toy': the equation of 'd/dt yaw_rate_tractor' {says}" in str(caught.value)


def test_a_sensor_of_something_unpublished_is_refused_with_the_closest():
    sensors = part("wrong", OUTPUTS={"yaw_rate_trailer": "yaw_rate_trailer"})
    with pytest.raises(ModelError) as caught:
        assemble(vehicle(steer), sensors=sensors)
    assert "measures 'yaw_rate_trailer', which 'toy' does not publish" in str(caught.value)
    assert "closest: yaw_rate_tractor" in str(caught.value)


# --- effects


def test_an_effect_changes_its_port_and_nothing_else():
    model = assemble(vehicle(steer), effects={"gain": effect(scaled)})
    assert model.effects == ("gain",)
    assert model.parameter_names == ("lag", "steering_ratio", "gain")
    assert rate(model, [0.0], [1.0, 10.0]) == pytest.approx([3.0 * 0.5 / 0.5])


def test_effects_on_one_port_act_in_their_order():
    offset = effect(lambda e, value: value + e.p("offset"), PARAMETERS=(parameter("offset", "rad"),))
    values = {**VALUES, "offset": 1.0}
    first = assemble(vehicle(steer), effects={"gain": effect(scaled), "offset": offset})
    last = assemble(vehicle(steer), effects={"offset": offset, "gain": effect(scaled)})
    assert rate(first, [0.0], [1.0, 0.0], values) == pytest.approx([(3 * 0.5 + 1) / 0.5])
    assert rate(last, [0.0], [1.0, 0.0], values) == pytest.approx([3 * (0.5 + 1) / 0.5])


def test_an_effect_on_an_unpublished_port_is_refused_with_the_closest():
    wrong = effect(scaled, PORT="vertical_load_axle_11")
    with pytest.raises(ModelError) as caught:
        assemble(vehicle(steer), effects={"gain": wrong})
    text = "effect 'gain' changes port 'vertical_load_axle_11', which 'toy' does not publish"
    assert text in str(caught.value)
    assert "road_wheel_angle" in str(caught.value)


def test_an_effect_that_reads_what_nothing_provides_is_refused():
    wrong = effect(lambda e, value: value + e.read("coupling_force") * e.p("gain"))
    with pytest.raises(ModelError, match="effect 'gain' reads 'coupling_force', which nothing provides"):
        assemble(vehicle(steer), effects={"gain": wrong})


def test_an_effect_may_read_only_parameters_it_declares():
    wrong = effect(lambda e, value: value * e.p("gian"))
    with pytest.raises(ModelError, match=r"effect 'gain' reads parameter 'gian' .*closest: gain"):
        assemble(vehicle(steer), effects={"gain": wrong})


def test_an_effect_may_not_take_a_parameter_that_exists():
    wrong = effect(lambda e, value: value, PARAMETERS=(parameter("lag", "s"),))
    with pytest.raises(ModelError, match="effect 'late' declares parameter 'lag', which exists already"):
        assemble(vehicle(steer), effects={"late": wrong})


def test_an_effect_that_closes_a_loop_is_refused():
    def equations(v):
        steer(v)
        v.port("slip_angle_axle_11", symbol("road_wheel_angle") - v.state("yaw_rate_tractor"))

    compliance = effect(lambda e, value: value - e.p("gain") * e.read("slip_angle_axle_11"))
    with pytest.raises(ModelError, match="cycle: road_wheel_angle -> slip_angle_axle_11 -> road_wheel_angle"):
        assemble(vehicle(equations), effects={"compliance": compliance})


def test_an_effect_may_have_a_state_of_its_own():
    def apply(e, value):
        lagging = e.read("speed_tractor")
        e.derivative("speed_tractor", (value - lagging) / e.p("gain"))
        return lagging

    model = assemble(vehicle(steer), effects={"lag_of_steering": effect(apply, STATES=("speed_tractor",))})
    assert model.states == ("yaw_rate_tractor", "speed_tractor")
    found = rate(model, [0.0, 0.2], [1.0, 10.0])
    assert found == pytest.approx([0.2 / 0.5, (0.5 - 0.2) / 3.0])


@pytest.mark.parametrize("factor", [1, 2])
def test_a_shared_state_has_one_derivative_however_often_it_is_stated(factor):
    def apply(e, value):
        e.derivative("speed_tractor", value, shared=True)
        e.derivative("speed_tractor", factor * value, shared=True)
        return value

    again = {"again": effect(apply, STATES=("speed_tractor",))}
    if factor == 1:
        assert assemble(vehicle(steer), effects=again).states == ("yaw_rate_tractor", "speed_tractor")
        return
    with pytest.raises(ModelError, match="the derivative of 'speed_tractor' has two writers in 'toy'"):
        assemble(vehicle(steer), effects=again)


def test_a_state_of_an_effect_without_derivative_is_refused():
    wrong = effect(scaled, STATES=("speed_tractor",))
    with pytest.raises(ModelError, match="no derivative for speed_tractor"):
        assemble(vehicle(steer), effects={"gain": wrong})


def test_an_effect_may_depend_on_time():
    gust = effect(lambda e, value: sp.Piecewise((value, e.time < 5), (e.p("gain") * value, True)))
    model = assemble(vehicle(steer), effects={"gust": gust})
    assert model.inputs == ("steering_wheel_angle", "speed", "time")
    before, after = (rate(model, [0.0], [1.0, 10.0, t])[0] for t in (4.0, 6.0))
    assert after == pytest.approx(3 * before)
    assert "time" not in assemble(vehicle(steer)).inputs


def test_an_effect_on_a_sensor_changes_what_is_measured_only():
    drift = effect(scaled, PORT="sensor_yaw_rate_tractor")
    model = assemble(vehicle(steer), effects={"gain": drift}, sensors=GYRO)
    plain = assemble(vehicle(steer), sensors=GYRO)
    assert model.derivatives == plain.derivatives
    assert model.expand(model.outputs["yaw_rate_tractor"]) == symbol("gain") * symbol("yaw_rate_tractor")


def test_two_effects_on_one_sensor_are_both_used():
    offset = effect(
        lambda e, value: value + e.p("offset"),
        PORT="sensor_yaw_rate_tractor",
        PARAMETERS=(parameter("offset", "rad/s"),),
    )
    drift = effect(scaled, PORT="sensor_yaw_rate_tractor")
    model = assemble(vehicle(steer), effects={"gain": drift, "offset": offset}, sensors=GYRO)
    measured = model.expand(model.outputs["yaw_rate_tractor"])
    assert measured == symbol("gain") * symbol("yaw_rate_tractor") + symbol("offset")


def test_a_sensor_effect_that_depends_on_time_makes_time_an_input():
    drift = effect(
        lambda e, value: value + e.p("gain") * e.time,
        PORT="sensor_yaw_rate_tractor",
    )
    model = assemble(vehicle(steer), effects={"drift": drift}, sensors=GYRO)
    assert "time" in model.inputs


def test_an_effect_on_a_sensor_that_is_not_there_is_refused():
    drift = effect(scaled, PORT="sensor_yaw_rate_tractor")
    with pytest.raises(ModelError, match="changes port 'sensor_yaw_rate_tractor'"):
        assemble(vehicle(steer), effects={"gain": drift})


def test_an_effect_may_act_on_several_ports():
    def equations(v):
        left = v.port("slip_angle_axle_11", v.input("steering_wheel_angle"))
        right = v.port("slip_angle_axle_12", v.state("yaw_rate_tractor"))
        v.derivative("yaw_rate_tractor", left + right)

    both = effect(scaled, PORT=("slip_angle_axle_11", "slip_angle_axle_12"))
    model = assemble(vehicle(equations), effects={"gain": both})
    assert rate(model, [0.5], [1.0, 0.0]) == pytest.approx([3 * 1.5])


# --- unknown inputs


def test_augment_moves_an_unknown_input_into_the_state():
    model = assemble(vehicle(steer), sensors=GYRO)
    bigger = model.augment(["steering_wheel_angle"])
    assert bigger.states == ("yaw_rate_tractor", "steering_wheel_angle")
    assert bigger.inputs == ("speed",)
    assert bigger.derivatives[-1] == 0
    assert rate(bigger, [0.25, 1.0], [10.0]) == pytest.approx([0.5, 0.0])
    assert bigger.outputs == model.outputs
    assert model.states == ("yaw_rate_tractor",)  # the model it came from is as it was


def test_augment_keeps_the_order_asked_for_and_refuses_strangers():
    model = assemble(vehicle(steer))
    both = model.augment(["speed", "steering_wheel_angle"])
    assert both.states == ("yaw_rate_tractor", "speed", "steering_wheel_angle")
    assert both.inputs == ()
    with pytest.raises(ModelError, match="'steering' is not an input of 'toy'; closest: steering_wheel_angle"):
        model.augment(["steering"])
    with pytest.raises(ModelError, match="'speed' is not an input"):
        both.augment(["speed"])


# --- tyres


def test_axles_of_one_group_share_the_tyre_parameters():
    model = assemble("semitrailer", "linear")
    names = model.parameter_names
    assert [n for n in names if n.startswith("stiffness_peak")] == [
        "stiffness_peak_11",
        "stiffness_peak_12",
        "stiffness_peak_2",
    ]
    assert len(set(names)) == len(names)
    assert model.axles == ("11", "12", "21", "22", "23")


def test_a_tyre_may_read_only_parameters_it_declares():
    wrong = part("slick", PARAMETERS=(parameter("grip"),), lateral_force=lambda t: t.p("grp"))
    with pytest.raises(ModelError, match=r"tyre of axle 11 reads parameter 'grp' .*closest: grip"):
        assemble("semitrailer", wrong)


def test_a_tyre_without_parameters_is_possible():
    wrong = part("slick", PARAMETERS=(), lateral_force=lambda t: t.friction * t.vertical_load * t.slip_angle)
    model = assemble("semitrailer", wrong)
    assert model.name == "semitrailer+slick"
    assert not [n for n in model.parameter_names if n.startswith("stiffness")]


def test_unknown_parts_get_the_closest_name():
    with pytest.raises(ModelError, match="unknown vehicle 'semitrailers'; closest: semitrailer"):
        assemble("semitrailers")
    with pytest.raises(ModelError, match="unknown effect 'gust'"):
        assemble("semitrailer", "linear", ["gust"])
