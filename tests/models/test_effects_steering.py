"""Effects of steering and coupling against physics: gains and phases, play, energy taken from turning."""

from __future__ import annotations

import numpy as np
import pytest

from harness.common.errors import ModelError
from harness.models.assembly.algebraic_loops import solve_loops
from harness.models.assembly.model import symbol
from support.effects import VALUES, G, built, look, point, values
from support.numeric import euler, evaluator, jacobian


def test_offset_and_ratio_of_the_steering():
    ratio = VALUES["car"]["steering_ratio"]
    (offset,) = look(
        "car", ("steering_offset",), ("road_wheel_angle",), {"steering_offset": 0.01}, steering_wheel_angle=1.0
    )
    (slower,) = look(
        "car", ("steering_ratio",), ("road_wheel_angle",), {"steering_ratio_error": 0.25}, steering_wheel_angle=1.0
    )
    assert offset == pytest.approx(1 / ratio + 0.01)
    assert slower == pytest.approx(1 / (1.25 * ratio))


@pytest.mark.parametrize("progression", [-0.8, 0.5, 3.0])
def test_a_progressive_ratio_is_odd_monotonic_and_reaches_its_gain(progression):
    own = {"steering_progression": progression, "steering_centre_width": 0.05}
    ratio = VALUES["car"]["steering_ratio"]
    wheel = np.linspace(-1.0, 1.0, 201)

    def f(angle: float) -> float:
        at = {"steering_wheel_angle": angle * ratio}
        return look("car", ("steering_ratio_nonlinear",), ("road_wheel_angle",), own, **at)[0]

    angle = np.array([f(d) for d in wheel])
    assert angle == pytest.approx(-angle[::-1])
    assert (np.diff(angle) > 0).all()
    assert angle[-1] == pytest.approx((1 + progression) * 1.0, rel=0.01)
    assert f(0.05) == pytest.approx(0.05 * (1 + progression / 2))


def follow(effect: str, own: dict, wheel: np.ndarray, step: float, tyre: str = "linear") -> np.ndarray:
    """Return the road-wheel angle over time for one of the steering wheel, of a car at rest otherwise."""
    model = built("car", (effect,), tyre)
    numbers = values(model, "car", **own)
    f, angle = evaluator(model, numbers), evaluator(model, numbers, ("road_wheel_angle",))
    inputs = np.array([point(model, steering_wheel_angle=w, speed=2.0)[1] for w in wheel])
    x = euler(f, point(model)[0], inputs, step)
    return np.array([angle(state, u)[0] for state, u in zip(x, inputs, strict=True)])


@pytest.mark.parametrize(
    ("effect", "amount"),
    [(e, a) for e in ("steering_lag", "steering_delay") for a in (0.0, 0.02, 0.1, 0.2)] + [("steering_delay", -0.04)],
)
def test_lag_and_delay_have_gain_and_phase_of_their_names(effect, amount):
    """Measured at 1 Hz, where a driver steers; exact at zero."""
    step, omega, ratio = 1e-3, 2 * np.pi, VALUES["car"]["steering_ratio"]
    time = np.arange(0, 4, step)
    angle = follow(effect, {effect: amount}, ratio * np.sin(omega * time), step)[-1000:]
    gain = 2 * np.mean(angle * np.exp(-1j * omega * time[-1000:])) * 1j
    wanted = 1 / (1 + 1j * omega * amount) if effect == "steering_lag" else np.exp(-1j * omega * amount)
    assert abs(gain - wanted) < (1e-9 if amount == 0 else 0.02)


def test_no_filter_of_the_past_follows_a_negative_delay():
    """Of 40 ms it is 7 % and 5 ms off at 2 Hz, so recordings are read ahead (``FilteredModel.read_ahead``)."""
    step, omega, ratio = 1e-3, 4 * np.pi, VALUES["car"]["steering_ratio"]
    time = np.arange(0, 4, step)
    angle = follow("steering_delay", {"steering_delay": -0.04}, ratio * np.sin(omega * time), step)[-1000:]
    gain = 2 * np.mean(angle * np.exp(-1j * omega * time[-1000:])) * 1j
    assert abs(gain) - 1 == pytest.approx(0.066, abs=0.006)
    assert np.angle(gain * np.exp(-0.04j * omega)) / omega == pytest.approx(5.4e-3, abs=2e-4)


@pytest.mark.parametrize("effect", ["steering_lag", "steering_delay", "sensor_delay@yaw_rate", "tyre_relaxation"])
@pytest.mark.parametrize("amount", [0.0, 0.01, 0.3])
def test_states_of_lags_are_stable_in_steps_of_ten_milliseconds(effect, amount):
    model = built("car", (effect,), "linear")
    name = next(n for n in model.parameter_names if n.startswith(effect.partition("@")[0]))
    own = dict.fromkeys([n for n in model.parameter_names if n.startswith(name[:12])], amount)
    f = evaluator(model, values(model, "car", **{n: v for n, v in own.items() if n not in VALUES["car"]}))
    x, u = point(model, speed=35.0)
    A = np.eye(len(x)) + 0.01 * jacobian(f, x, u, np.ones(len(x)))
    assert np.abs(np.linalg.eigvals(A)).max() < 1.0


def test_compliant_steering_yields_to_the_force_and_lessens_the_turn():
    model = built("car", ("steering_compliance",), "linear")
    _, u = point(model, steering_wheel_angle=0.5)
    turn = {}
    for compliance in (0.0, 2e-6):
        numbers = values(model, "car", steering_compliance=compliance)
        x = euler(evaluator(model, numbers), point(model)[0], np.tile(u, (1500, 1)), 0.005)[-1]
        force, angle = evaluator(model, numbers, ("lateral_force_steered_axle", "road_wheel_angle"))(x, u)
        turn[compliance] = x[model.states.index("yaw_rate")]
        assert angle == pytest.approx(0.5 / VALUES["car"]["steering_ratio"] - compliance * force, rel=1e-6)
    assert 0 < turn[2e-6] < turn[0.0]


@pytest.mark.parametrize("angle", [-0.2, -0.03, 0.0, 0.01, 0.06, 0.12, 0.3])
@pytest.mark.parametrize("compliance", [1e-6, 6e-6])
def test_angle_and_force_of_a_compliant_steering_agree_at_every_slip(compliance, angle):
    """With the root that bisection finds; the Magic Formula is written out here."""
    v = VALUES["car"]
    l_f, l_r = v["cog_to_front_axle"], v["cog_to_rear_axle"]
    load = v["mass"] * G * l_r / (l_f + l_r)
    stiffness = v["stiffness_peak_front"] * np.sin(2 * np.arctan(load / v["stiffness_load_front"]))
    limit, shape = v["friction"] * load, v["shape_factor_front"]

    def force(slip: float) -> float:
        return limit * np.sin(shape * np.arctan(stiffness / (shape * limit) * np.tan(slip)))

    drift = np.arctan((0.3 + l_f * 0.2) / 20.0)
    low, high = -1.0, 1.0
    for _ in range(100):
        middle = (low + high) / 2
        low, high = (middle, high) if middle + compliance * force(middle - drift) < angle else (low, middle)
    at = {"lateral_velocity": 0.3, "yaw_rate": 0.2, "steering_wheel_angle": angle * v["steering_ratio"]}
    names, own = ("road_wheel_angle", "lateral_force_steered_axle"), {"steering_compliance": compliance}
    turned, made = look("car", ("steering_compliance",), names, own, **at)
    right = 1e-6 if compliance == 1e-6 else 3e-3  # gains of the loop of 0.16 and 1
    assert made == pytest.approx(force(middle - drift), rel=right)
    assert angle - turned == pytest.approx(angle - middle, rel=right)


def test_a_vehicle_whose_tyre_forces_are_states_yields_without_a_loop():
    found = look(
        "semitrailer",
        ("steering_compliance",),
        ("road_wheel_angle",),
        {"steering_compliance": 1e-6},
        lateral_force_axle_11=2e4,
    )
    assert found == pytest.approx([-0.02])


def test_loops_that_depend_on_each_other_are_refused():
    ports = {name: symbol("k") * symbol(other) for name, other in (("a", "b"), ("b", "a"))}
    with pytest.raises(ModelError, match="'a' and 'b' depend on each other"):
        solve_loops(ports, ("a", "b"))


def test_a_steering_that_yields_late_ends_where_one_that_yields_at_once_does():
    late = built("car", ("steering_compliance_lag",), "linear")
    own = {"lagged_compliance": 2e-6, "compliance_lag": 0.1}
    _, u = point(late, steering_wheel_angle=0.5)
    run = euler(evaluator(late, values(late, "car", **own)), point(late)[0], np.tile(u, (1500, 1)), 0.005)
    yaw_rate = late.states.index("yaw_rate")
    once = built("car", ("steering_compliance",), "linear")
    at_once = euler(
        evaluator(once, values(once, "car", steering_compliance=2e-6)), point(once)[0], np.tile(u, (1500, 1)), 0.005
    )
    assert run[-1, yaw_rate] == pytest.approx(at_once[-1, 1], rel=1e-6)
    assert run[20, yaw_rate] > 1.05 * at_once[20, 1]


def test_play_is_crossed_on_every_reversal_and_only_there():
    half, step = 0.01, 1e-3
    time = np.arange(0, 8, step)
    wheel = 0.05 * np.sin(2 * np.pi * 0.25 * time)
    angle = follow("steering_backlash", {"steering_backlash": half}, wheel * VALUES["car"]["steering_ratio"], step)
    late = time > 4
    lost = wheel - angle
    assert np.abs(lost).max() <= half * (1 + 1e-9)
    rising, falling = np.gradient(wheel) > 1e-5, np.gradient(wheel) < -1e-5
    middle = late & (np.abs(wheel) < 0.005)
    assert lost[middle & rising] == pytest.approx(half, rel=0.01)  # pushed from below: the wheels are behind
    assert lost[middle & falling] == pytest.approx(-half, rel=0.01)
    area = np.sum((angle[late] - wheel[late]) * np.gradient(wheel[late]))
    assert area < -3 * half * 0.05  # a loop of hysteresis, of height 2 b and about 0.1 wide


@pytest.mark.parametrize("values", [{"kingpin_friction": 8e3, "kingpin_friction_rate": 0.01}, {"kingpin_damping": 2e4}])
def test_the_kingpin_takes_energy_from_turning_and_acts_on_both_bodies(values):
    effect, size = next(iter(values.items()))
    for rate in (-0.2, 0.3):
        at = {"yaw_rate_tractor": 0.1, "yaw_rate_trailer": 0.1 + rate}
        (moment,) = look("semitrailer", (effect,), ("coupling_moment",), values, **at)
        assert moment * rate < 0
    assert abs(moment) == pytest.approx(size if effect == "kingpin_friction" else size * 0.3)
    still = {"yaw_rate_tractor": 0.1, "yaw_rate_trailer": 0.1}
    assert look("semitrailer", (effect,), ("coupling_moment",), values, **still) == pytest.approx([0.0])
