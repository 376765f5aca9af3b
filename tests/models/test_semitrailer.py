"""The semitrailer obeys physics: weight, symmetry, stability, kinematics and the kingpin tie."""

from __future__ import annotations

import numpy as np
import pytest

from harness.models.assembly.assemble import assemble
from harness.models.parameters import ziaukas_2023
from harness.models.vehicles import semitrailer
from support.numeric import euler, evaluator, jacobian, named

VALUES = ziaukas_2023.VALUES
MODEL = assemble("semitrailer", "magic_formula")
SIZE = np.array([1.0, 0.1, 1.0, 0.1, 0.1, *[1e4] * 5])
KMH = 1 / 3.6
RATIO = VALUES["steering_ratio"]
MASSES = [7.5e3, 12e3, 16e3, 20e3, 24e3, 28e3, 32e3]


def geometry(values: dict[str, float]) -> tuple[float, float, list[float]]:
    """Return a_1 + b_1, e_1 = b_1 - h_1 and the kingpin's distances to the trailer axles, in m."""
    rear = [values[f"axle_{a}_from_rear"] for a in ("21", "22", "23")]
    return (
        values["tractor_cog_to_front_axle"] + values["tractor_cog_to_rear_axle"],
        values["tractor_cog_to_rear_axle"] - values["tractor_cog_to_kingpin"],
        [values["kingpin_from_rear"] - r for r in rear],
    )


def random_state(rng: np.random.Generator) -> np.ndarray:
    """Return a state within the range of hard driving (the tie does not hold)."""
    return rng.uniform(-1, 1, 10) * np.array([2.0, 0.6, 2.0, 0.6, 1.0, *[5e4] * 5])


def inputs(time: np.ndarray, steering: np.ndarray | float, speed: np.ndarray | float) -> np.ndarray:
    """Return the input samples (samples, 3), the speed's derivative taken from its samples."""
    v = np.broadcast_to(np.asarray(speed, dtype=float), time.shape)
    delta = np.broadcast_to(np.asarray(steering, dtype=float), time.shape)
    return np.column_stack([delta, v, np.gradient(v, time)])


# --- axle loads


@pytest.mark.parametrize("seed", range(8))
def test_axle_loads_carry_the_weight_and_balance_each_body(seed):
    rng = np.random.default_rng(seed)
    values = {
        **VALUES,
        "tractor_mass": rng.uniform(6e3, 1e4),
        "trailer_mass": rng.uniform(6e3, 4e4),
        "trailer_cog_from_rear": rng.uniform(4.5, 11.0),
        "tractor_cog_to_kingpin": rng.uniform(0.5, 2.5),
    }
    loads = evaluator(MODEL, values, [f"vertical_load_axle_{a}" for a in MODEL.axles])(
        random_state(rng), np.array([0.3, 10.0, 0.0])
    )
    g = semitrailer.GRAVITY
    weight_1, weight_2 = g * values["tractor_mass"], g * values["trailer_mass"]
    assert loads.sum() == pytest.approx(weight_1 + weight_2, rel=1e-12)

    kingpin = weight_2 - loads[2:].sum()
    a_1, b_1 = values["tractor_cog_to_front_axle"], values["tractor_cog_to_rear_axle"]
    a_2 = values["kingpin_from_rear"] - values["trailer_cog_from_rear"]
    b_22 = values["trailer_cog_from_rear"] - values["axle_22_from_rear"]
    pitch_1 = loads[0] * a_1 - loads[1] * b_1 + kingpin * values["tractor_cog_to_kingpin"]
    pitch_2 = kingpin * a_2 - loads[2:].sum() * b_22
    assert pitch_1 == pytest.approx(0.0, abs=1e-9 * weight_1)
    assert pitch_2 == pytest.approx(0.0, abs=1e-9 * weight_2)
    assert np.ptp(loads[2:]) == 0.0


def test_reference_axle_loads_are_those_of_a_truck():
    loads = evaluator(MODEL, VALUES, [f"vertical_load_axle_{a}" for a in MODEL.axles])(
        np.zeros(10), np.array([0.0, 10.0, 0.0])
    )
    assert (loads > 0).all()
    # Near the usual limits of a steered and a driven axle (7.5 t, 11.5 t) and of three together (24 t).
    assert (loads / semitrailer.GRAVITY < np.array([8e3, 12e3, 8e3, 8e3, 8e3])).all()


# --- symmetry


@pytest.mark.parametrize("tyre", ["magic_formula", "linear"])
def test_mirrored_states_and_steering_give_mirrored_derivatives(tyre):
    model = assemble("semitrailer", tyre)
    f = evaluator(model, VALUES)
    rng = np.random.default_rng(1)
    for _ in range(50):
        x, delta = random_state(rng), rng.uniform(-8, 8)
        v, rate = rng.uniform(0.0, 25.0), rng.uniform(-3, 3)
        left = f(x, np.array([delta, v, rate]))
        right = f(-x, np.array([-delta, v, rate]))
        assert left == pytest.approx(-right, rel=1e-12, abs=1e-12)
        assert np.abs(left).min() > 0


# --- stability


@pytest.mark.parametrize("rate", [0.0, 10.0])
@pytest.mark.parametrize("mass", MASSES)
def test_straight_run_is_stable_in_continuous_time(mass, rate):
    f = evaluator(MODEL, {**VALUES, "trailer_mass": mass, "constraint_rate": rate})
    for v in np.array([2, 5, 10, 20, 30, 40, 50, 60, 70, 80, 90]) * KMH:
        eigenvalues = np.linalg.eigvals(jacobian(f, np.zeros(10), np.array([0.0, v, 0.0]), SIZE))
        real = np.sort(eigenvalues.real)
        if rate == 0.0:  # as printed, a violated tie stays as it is: one eigenvalue at zero, and only one
            assert abs(real[-1]) < 1e-6
            real = real[:-1]
        assert real[-1] < -0.05


@pytest.mark.parametrize("mass", MASSES)
def test_straight_run_is_stable_for_the_euler_map(mass):
    f = evaluator(MODEL, {**VALUES, "trailer_mass": mass})
    for v in [1.5, *np.array([10, 20, 30, 40, 50, 60, 70, 80, 90]) * KMH]:
        a = jacobian(f, np.zeros(10), np.array([0.0, v, 0.0]), SIZE)
        assert np.abs(np.linalg.eigvals(np.eye(10) + 0.01 * a)).max() < 0.9995


def test_euler_at_10_ms_needs_walking_pace():
    """The tyre's spring (relaxation) and the body's mass swing at low speed, and Euler feeds such a swing."""
    f = evaluator(MODEL, {**VALUES, "trailer_mass": 8e3})
    a = jacobian(f, np.zeros(10), np.array([0.0, 0.8, 0.0]), SIZE)
    assert np.linalg.eigvals(a).real.max() < 0
    assert np.abs(np.linalg.eigvals(np.eye(10) + 0.01 * a)).max() > 1
    assert np.abs(np.linalg.eigvals(np.eye(10) + 0.005 * a)).max() < 1


@pytest.mark.parametrize("mass", [7.5e3, 24e3, 32e3])
def test_perturbed_straight_run_comes_back(mass):
    f = evaluator(MODEL, {**VALUES, "trailer_mass": mass})
    time = np.arange(0, 10, 0.01)
    start = np.zeros(10)
    start[:5] = [0.5, 0.1, -0.5, -0.1, 0.05]  # the tie does not hold either
    x = euler(f, start, inputs(time, 0.0, 90 * KMH), 0.01)
    assert np.isfinite(x).all()
    assert np.abs(x[200:] / SIZE).max() < np.abs(x[:200] / SIZE).max() * 0.3
    assert np.abs(x[-1] / SIZE).max() < 1e-2 * np.abs(start / SIZE).max()


# --- steady circle


# Three axles in a row scrub in a circle and push the tractor a little; all in one place, they roll freely.
ONE_AXLE = {
    "axle_21_from_rear": VALUES["axle_22_from_rear"],
    "axle_23_from_rear": VALUES["axle_22_from_rear"],
}


@pytest.mark.parametrize(("change", "tolerance"), [(ONE_AXLE, 0.008), ({}, 0.045)], ids=["one", "three"])
@pytest.mark.parametrize("road_wheel", [0.05, 0.15, -0.15])
def test_slow_circle_follows_the_kinematics(road_wheel, change, tolerance):
    values = {**VALUES, **change}
    f = evaluator(MODEL, values)
    speed, time = 2.0, np.arange(0, 60, 0.01)
    ramp = np.clip(time / 5, 0, 1)
    x = named(MODEL, euler(f, np.zeros(10), inputs(time, RATIO * road_wheel * ramp, speed), 0.01)[-1])

    # Rolling without side slip; three axles roll as one where their lateral slips balance about the kingpin.
    l_1, e_1, behind = geometry(values)
    l_2 = sum(d**2 for d in behind) / sum(behind)
    sign = np.sign(road_wheel)
    radius_1 = l_1 / np.tan(abs(road_wheel))
    radius_k = np.hypot(radius_1, e_1)
    radius_2 = np.sqrt(radius_k**2 - l_2**2)
    yaw_rate = sign * speed / radius_2
    articulation = sign * (np.arctan(e_1 / radius_1) - np.arcsin(l_2 / radius_k))

    assert x.yaw_rate_tractor == pytest.approx(x.yaw_rate_trailer, rel=1e-4)
    assert x.yaw_rate_trailer == pytest.approx(yaw_rate, rel=tolerance)
    assert x.articulation_angle == pytest.approx(articulation, rel=tolerance)
    assert np.sign(x.articulation_angle) == -sign  # the trailer's heading lags the tractor's


def test_steady_circle_forces_carry_the_centripetal_acceleration():
    f = evaluator(MODEL, VALUES)
    time = np.arange(0, 30, 0.01)
    u = inputs(time, RATIO * 0.02 * np.clip(time / 5, 0, 1), 15.0)
    run = euler(f, np.zeros(10), u, 0.01)
    x = named(MODEL, run[-1])
    ports = evaluator(MODEL, VALUES, ["coupling_force", "lateral_acceleration_trailer", "speed_tractor"])
    kingpin, a_y2, _ = ports(run[-1], u[-1])
    forces = x.lateral_force_axle_21 + x.lateral_force_axle_22 + x.lateral_force_axle_23
    assert a_y2 == pytest.approx(15.0 * x.yaw_rate_trailer, rel=1e-6)
    assert forces - kingpin == pytest.approx(VALUES["trailer_mass"] * a_y2, rel=1e-9)
    assert 1.0 < a_y2 < 3.0
    # Two bodies on one circle: the horizontal tyre forces carry both masses (cosines of small angles).
    total = forces + x.lateral_force_axle_11 + x.lateral_force_axle_12
    both = (VALUES["trailer_mass"] + VALUES["tractor_mass"]) * 15.0 * x.yaw_rate_trailer
    assert total == pytest.approx(both, rel=0.02)


# --- kingpin tie


def violation(values: dict[str, float], x: np.ndarray, u: np.ndarray) -> np.ndarray:
    gamma = evaluator(MODEL, values, ["constraint_violation"])
    return np.array([gamma(a, b)[0] for a, b in zip(x, u, strict=True)])


def drive(rate: float, noise_seed: int | None) -> np.ndarray:
    """Return the kingpin's slip over a 20 s sine drive at 15 m/s, with or without process noise."""
    values = {**VALUES, "constraint_rate": rate}
    time = np.arange(0, 20, 0.01)
    u = inputs(time, RATIO * 0.03 * np.sin(2 * np.pi * 0.25 * time), 15.0)
    noise = None
    if noise_seed is not None:
        std = np.sqrt([ziaukas_2023.PROCESS_NOISE[s] for s in MODEL.states])
        noise = np.random.default_rng(noise_seed).normal(0, std, (len(time), 10))
    x = euler(evaluator(MODEL, values), np.zeros(10), u, 0.01, noise)
    assert np.abs(x[:, 3]).max() > 0.1  # a drive worth the name
    return violation(values, x, u)


def test_tie_holds_without_noise():
    assert np.abs(drive(10.0, None)).max() < 2e-6
    assert np.abs(drive(0.0, None)).max() < 2e-5  # what the Euler steps leave, and nothing pulls it back


def test_noise_makes_the_tie_walk_unless_the_rate_holds_it():
    """The slip is a random walk as printed, an Ornstein-Uhlenbeck process when it is pulled back."""
    q = ziaukas_2023.PROCESS_NOISE
    a_2, h_1 = VALUES["kingpin_from_rear"] - VALUES["trailer_cog_from_rear"], VALUES["tractor_cog_to_kingpin"]
    # The variance that one step adds to cos(theta) (v_y2 + a_2 w_2) + sin(theta) v_x2 - (v_y1 - h_1 w_1).
    per_step = (
        q["lateral_velocity_trailer"]
        + a_2**2 * q["yaw_rate_trailer"]
        + 15.0**2 * q["articulation_angle"]
        + q["lateral_velocity_tractor"]
        + h_1**2 * q["yaw_rate_tractor"]
    )
    runs = range(6)
    free = np.sqrt(np.mean([drive(0.0, seed)[-400:] ** 2 for seed in runs]))
    held = np.sqrt(np.mean([drive(10.0, seed)[-1500:] ** 2 for seed in runs]))
    assert 0.5 < free / np.sqrt(1800 * per_step) < 1.7  # 6 correlated ends: a rough estimate of the spread
    assert held == pytest.approx(np.sqrt(per_step / (1 - 0.9**2)), rel=0.15)


@pytest.mark.parametrize("rate", [0.0, 10.0])
def test_derivatives_keep_the_tie_when_the_speed_changes(rate):
    """The slip's own derivative is -rate * slip at any state, speed and acceleration."""
    values = {**VALUES, "constraint_rate": rate}
    f, gamma = evaluator(MODEL, values), evaluator(MODEL, values, ["constraint_violation"])
    rng = np.random.default_rng(2)
    for _ in range(30):
        x, h = random_state(rng), 1e-6
        u = np.array([rng.uniform(-5, 5), rng.uniform(3, 25), rng.uniform(-4, 4)])
        ahead, du = h * f(x, u), np.array([0.0, h * u[2], 0.0])
        slope = (gamma(x + ahead, u + du)[0] - gamma(x - ahead, u - du)[0]) / (2 * h)
        assert slope == pytest.approx(-rate * gamma(x, u)[0], abs=2e-6)


def test_braking_in_a_tight_turn_keeps_the_tie_only_with_the_speed_rate():
    values = {**VALUES, "constraint_rate": 0.0}
    time = np.arange(0, 20, 0.002)
    speed = 6.0 - 4.0 * np.clip((time - 12) / 4, 0, 1)
    u = inputs(time, RATIO * 0.25 * np.clip(time / 4, 0, 1), speed)
    f = evaluator(MODEL, values)
    x = euler(f, np.zeros(10), u, 0.002)
    assert abs(x[6000, 4]) > 0.3
    kept = violation(values, x, u)
    without = u * np.array([1.0, 1.0, 0.0])
    lost = violation(values, euler(f, np.zeros(10), without, 0.002), without)
    assert abs(kept[-1] - kept[6000]) < 0.02
    assert abs(lost[-1] - lost[6000]) > 1.0


# --- joint checks of parameters


@pytest.mark.parametrize(
    ("change", "names", "says"),
    [
        ({"kingpin_from_rear": 14.0}, "kingpin_from_rear", "outside the trailer"),
        ({"trailer_cog_from_rear": 4.0}, "trailer_cog_from_rear", "middle axle"),
        ({"trailer_cog_from_rear": 12.5}, "trailer_cog_from_rear", "kingpin"),
        ({"tractor_cog_to_kingpin": 4.0}, "tractor_cog_to_kingpin", "wheelbase"),
    ],
)
def test_impossible_geometry_is_named(change, names, says):
    wrong = semitrailer.check({**VALUES, **change})
    assert [n for n, _ in wrong] == [names]
    assert says in wrong[0][1]


def test_possible_geometry_passes():
    assert semitrailer.check(VALUES) == []
    assert semitrailer.wheelbase(VALUES) == pytest.approx(3.71)
