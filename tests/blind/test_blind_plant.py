"""The blind plant obeys physics and shares nothing with what it judges."""

from __future__ import annotations

import ast
import sys
from pathlib import Path

import numpy as np
import plant
import pytest
import sympy as sp
from plant_cases import Channel, Truth
from plant_drives import DRIVERS, RUN_IN, STEP, half_steps
from plant_drives import draw as draw_drive
from plant_environment import Column, Surroundings, inputs, steered
from plant_equations import GRAVITY, INPUTS, OUTPUTS, Car, Semitrailer, semitrailer_rates
from plant_sensors import NOISE, record, sensed
from plant_simulation import solve

from harness.models.assembly.assemble import assemble, symbol
from support.blind_vehicles import EARLY, NOMINAL

pytestmark = pytest.mark.proof


FOLDER = Path(plant.__file__).parent


def constant(seconds: float, step: float = 1e-3, **values: float) -> np.ndarray:
    """Return inputs at half steps that do not change; speed 15 m/s, dry road, nothing else unless stated."""
    row = {**dict.fromkeys(INPUTS, 0.0), "speed": 15.0, "grip": 1.0, "stiffness": 1.0, **values}
    return np.tile([row[name] for name in INPUTS], (2 * round(seconds / step) + 1, 1))


def named(vehicle: str, out: np.ndarray) -> dict[str, np.ndarray]:
    return dict(zip(OUTPUTS[vehicle], out.T, strict=True))


# --- apart from what it judges


def test_plant_imports_nothing_of_the_project():
    allowed = {"numpy", "numba", "pyarrow", *sys.stdlib_module_names}
    files = sorted(FOLDER.glob("plant*.py"))
    own = {f.stem for f in files}
    assert len(files) > 5
    for file in files:
        for node in ast.walk(ast.parse(file.read_text())):
            names = [a.name for a in node.names] if isinstance(node, ast.Import) else []
            if isinstance(node, ast.ImportFrom):
                assert node.level == 0
                names = [node.module]
            for name in names:
                assert name.split(".")[0] in allowed | own, f"{file.name} imports {name}"
            assert not (isinstance(node, ast.Name) and node.id == "__import__")


# --- the same vehicle as the nominal model, found another way


MODEL = assemble("semitrailer", "magic_formula")


@pytest.fixture(scope="module")
def nominal():
    """Return ``f(x, u, p)`` of the project's semitrailer: derivatives, then coupling force."""
    ports = [(symbol(n), e) for n, e in MODEL.ports.items()]
    arguments = [[symbol(n) for n in part] for part in (MODEL.states, MODEL.inputs, MODEL.parameter_names)]
    wanted = [*MODEL.derivatives, symbol("coupling_force")]
    return sp.lambdify(arguments, wanted, modules="math", cse=lambda e: (ports, e))


def tied(x: np.ndarray, speed: float, p: Semitrailer) -> list[float]:
    """Return the ten states of the project's semitrailer for those of the plant."""
    a_2 = p.kingpin_from_rear - p.trailer_cog_from_rear
    v_y1 = np.sin(x[3]) * speed + np.cos(x[3]) * x[2] + p.tractor_cog_to_kingpin * x[0]
    return [v_y1, x[0], x[2] - a_2 * x[1], x[1], x[3], *x[4:9]]


def test_semitrailer_has_the_derivatives_of_the_nominal_model(nominal):
    rng = np.random.default_rng(0)
    for _ in range(50):
        kept = {k: v * rng.uniform(0.9, 1.1) for k, v in plant.published("semitrailer").items()}
        kept["trailer_cog_from_rear"] = rng.uniform(6.0, 9.0)
        p, x, rate = Semitrailer(**kept), np.zeros(16), np.zeros(16)
        x[:9] = rng.uniform(-1, 1, 9) * [0.4, 0.4, 2.0, 0.7, *[5e4] * 5]
        u = constant(0.0, steering_wheel_angle=rng.uniform(-4, 4), speed=rng.uniform(3, 25), speed_rate=rng.normal())[0]
        out = np.zeros(len(OUTPUTS["semitrailer"]))
        semitrailer_rates(x, u, p, rate, out)
        v_x1 = np.cos(x[3]) * u[1] - np.sin(x[3]) * x[2]
        a_2 = kept["kingpin_from_rear"] - kept["trailer_cog_from_rear"]
        mine = [out[4] - x[0] * v_x1, rate[0], rate[2] - a_2 * rate[1], rate[1], rate[3], *rate[4:9], out[12]]
        values = {"constraint_rate": 10.0, **kept}
        theirs = nominal(tied(x, u[1], p), [u[0], u[1], u[2]], [values[n] for n in MODEL.parameter_names])
        np.testing.assert_allclose(mine, theirs, rtol=1e-9, atol=1e-9)


def test_published_values_are_those_of_the_reference_set():
    from harness.models.parameters import ziaukas_2023

    theirs = {k: v for k, v in ziaukas_2023.VALUES.items() if k != "constraint_rate"}
    assert plant.published("semitrailer") == theirs


def test_a_drive_agrees_with_the_nominal_model_within_discretisation(nominal, plans):
    u = inputs(plans["semitrailer"], Column(), Surroundings(), EARLY, np.random.default_rng(0))
    u = u[round(2 * RUN_IN / STEP) :][: 2 * 8000 + 1]
    mine = named("semitrailer", solve(NOMINAL["semitrailer"], u, STEP))
    values = {"constraint_rate": 10.0, **plant.published("semitrailer")}
    p = [values[n] for n in MODEL.parameter_names]

    def f(x: np.ndarray, row: np.ndarray) -> np.ndarray:
        return np.array(nominal(x, row[:3], p)[:-1])

    x, coarse, states = np.zeros(10), u[::10], []
    for k in range(0, len(coarse) - 2, 2):
        states.append(x)
        k_1 = f(x, coarse[k])
        k_2 = f(x + 0.005 * k_1, coarse[k + 1])
        k_3 = f(x + 0.005 * k_2, coarse[k + 1])
        x = x + 0.01 / 6 * (k_1 + 2 * k_2 + 2 * k_3 + f(x + 0.01 * k_3, coarse[k + 2]))
    theirs = dict(zip(MODEL.states, np.array(states).T, strict=True))
    for name in ("yaw_rate_tractor", "yaw_rate_trailer", "articulation_angle", "lateral_force_axle_21"):
        size = np.abs(theirs[name]).max()
        assert size > 0
        np.testing.assert_allclose(mine[name][:-1:10], theirs[name], atol=1e-5 * size)


# --- physics


def test_energy_is_balanced(plans):
    truth = Truth("semitrailer", {"kingpin_dry_moment": 8e3, "kingpin_damping": 4e4})
    p, plan = truth.equations(), plans["semitrailer"]
    u = inputs(plan, Column(), Surroundings(), EARLY, np.random.default_rng(0))
    y = named("semitrailer", solve(truth, u, STEP))
    wheel, v_x2 = u[::2, 0], u[::2, 1]
    w_1, w_2, theta = (y[n] for n in ("yaw_rate_tractor", "yaw_rate_trailer", "articulation_angle"))
    v_y1, v_y2 = y["lateral_velocity_tractor"], y["lateral_velocity_trailer"]
    q = v_y2 + (p.kingpin_from_rear - p.trailer_cog_from_rear) * w_2
    v_x1 = np.cos(theta) * v_x2 - np.sin(theta) * q
    J_2 = p.trailer_mass * (p.trailer_track**2 + p.trailer_length**2) / 12
    energy = p.tractor_mass * (v_x1**2 + v_y1**2) + p.tractor_yaw_inertia * w_1**2
    energy = 0.5 * (energy + p.trailer_mass * (v_x2**2 + v_y2**2) + J_2 * w_2**2)
    # The kingpin passes on no force along the trailer: drive and brakes of each body keep its own speed.
    X_1 = p.tractor_mass * (np.gradient(v_x1, STEP) - w_1 * v_y1) + np.sin(theta) * y["coupling_force"]
    X_2 = p.trailer_mass * (np.gradient(v_x2, STEP) - w_2 * v_y2)
    front = y["lateral_force_axle_11"] * np.cos(wheel / p.steering_ratio) * (v_y1 + p.tractor_cog_to_front_axle * w_1)
    power = front + y["lateral_force_axle_12"] * (v_y1 - p.tractor_cog_to_rear_axle * w_1) + X_1 * v_x1 + X_2 * v_x2
    for axle in ("21", "22", "23"):
        b = p.trailer_cog_from_rear - getattr(p, f"axle_{axle}_from_rear")
        power = power + y[f"lateral_force_axle_{axle}"] * (v_y2 - b * w_2)
    turning = w_2 - w_1
    lost = p.kingpin_dry_moment * np.tanh(turning / 0.002) * turning + p.kingpin_damping * turning**2
    assert (lost >= 0).all()
    work = np.concatenate([[0.0], np.cumsum((power[1:] + power[:-1] - lost[1:] - lost[:-1]) * STEP / 2)])
    assert lost.sum() * STEP > 100 * np.abs(energy - energy[0] - work).max()
    np.testing.assert_allclose(energy - energy[0], work, atol=1e-5 * np.ptp(energy))


def test_runge_kutta_is_of_fourth_order(plans):
    # No kinks: the steering of this drive is smooth between the corners of its ramps, so a sine is used instead.
    u = constant(4.0, steering_wheel_angle=0.0)
    u[:, 0] = 0.8 * np.sin(2 * np.pi * np.linspace(0, 4, len(u)))
    last = [solve(NOMINAL["semitrailer"], u[::n], n * STEP)[-1, :4] for n in (1, 10, 20)]
    ratio = np.abs(last[2] - last[0]) / np.abs(last[1] - last[0])
    assert (ratio > 12).all(), ratio


def slope(load: float, peak: float, at: float) -> float:
    return peak * 2 * load * at / (load**2 + at**2)  # sin(2 atan(x)) = 2 x / (1 + x^2)


def test_car_turns_on_the_circle_of_the_linear_theory():
    p, v, delta = Car(), 25.0, 1e-4
    last = named("car", solve(NOMINAL["car"], constant(10.0, steering_wheel_angle=delta * 16, speed=v), STEP)[-1:])
    a, b = p.cog_to_front_axle, p.cog_to_rear_axle
    weight = p.mass * GRAVITY / (a + b)
    C_1 = slope(weight * b, p.stiffness_peak_front, p.stiffness_load_front)
    C_2 = slope(weight * a, p.stiffness_peak_rear, p.stiffness_load_rear)
    understeer = p.mass * (b * C_2 - a * C_1) / (C_1 * C_2)
    assert last["yaw_rate"] == pytest.approx(v * delta / (a + b + understeer / (a + b) * v**2), rel=1e-6)
    assert last["lateral_acceleration"] == pytest.approx(v * last["yaw_rate"], rel=1e-6)


def test_semitrailer_turns_on_the_circle_of_the_linear_theory():
    p, v, delta = Semitrailer(), 18.0, 1e-5
    u = constant(60.0, steering_wheel_angle=delta * p.steering_ratio, speed=v)
    last = named("semitrailer", solve(NOMINAL["semitrailer"], u, STEP)[-1:])
    a_1, b_1, h_1 = p.tractor_cog_to_front_axle, p.tractor_cog_to_rear_axle, p.tractor_cog_to_kingpin
    a_2 = p.kingpin_from_rear - p.trailer_cog_from_rear
    arms = p.kingpin_from_rear - np.array([p.axle_21_from_rear, p.axle_22_from_rear, p.axle_23_from_rear])
    on_kingpin = p.trailer_mass * GRAVITY * (arms[1] - a_2) / arms[1]
    third = (p.trailer_mass * GRAVITY - on_kingpin) / 3
    F_z11 = (p.tractor_mass * GRAVITY * b_1 + on_kingpin * (b_1 - h_1)) / (a_1 + b_1)
    F_z12 = p.tractor_mass * GRAVITY + on_kingpin - F_z11

    C_11 = slope(F_z11, p.stiffness_peak_11, p.stiffness_load_11)
    C_12 = slope(F_z12, p.stiffness_peak_12, p.stiffness_load_12)
    C_2 = slope(third, p.stiffness_peak_2, p.stiffness_load_2)
    # Per unit of yaw rate: moments about the kingpin give its lateral velocity, then forces hand on to the front.
    q = (np.sum(arms**2) - p.trailer_mass * v**2 * a_2 / C_2) / arms.sum()
    trailer = C_2 * (arms - q) / v
    H = trailer.sum() - p.trailer_mass * v
    F_11 = (b_1 * (p.tractor_mass * v - H) + h_1 * H) / (a_1 + b_1)
    F_12 = p.tractor_mass * v - H - F_11
    gain = 1 / ((a_1 + b_1) / v + F_11 / C_11 - F_12 / C_12)
    assert last["yaw_rate_tractor"] == pytest.approx(gain * delta, rel=1e-6)
    assert last["yaw_rate_trailer"] == pytest.approx(gain * delta, rel=1e-6)
    assert last["lateral_force_axle_21"] == pytest.approx(trailer[0] * gain * delta, rel=1e-6)
    assert last["coupling_force"] == pytest.approx(H * gain * delta, rel=1e-6)
    theta = (b_1 - v * F_12 / C_12 - h_1 - q) / v
    assert last["articulation_angle"] == pytest.approx(theta * gain * delta, rel=1e-6)


def test_on_a_bank_the_tyres_carry_the_downhill_force():
    u = constant(40.0, bank=0.02, steering_wheel_angle=0.0)
    last = named("semitrailer", solve(NOMINAL["semitrailer"], u, STEP)[-1:])
    p, r = Semitrailer(), last["yaw_rate_tractor"]
    forces = sum(last[f"lateral_force_axle_{a}"] for a in ("11", "12", "21", "22", "23"))
    down = (p.tractor_mass + p.trailer_mass) * GRAVITY * np.sin(0.02)
    # The tractor's share of the kingpin force acts in trailer axes, hence the small angle.
    assert forces == pytest.approx(down + (p.tractor_mass + p.trailer_mass) * r * 15.0, rel=2e-3)
    assert r < 0  # to the right, downhill
    assert last["lateral_acceleration_tractor"] == pytest.approx(GRAVITY * np.sin(0.02) + r * 15.0, rel=2e-2)


def test_load_swings_at_its_own_frequency_and_pushes_back():
    # An almost weightless load on a truck in a gust: it swings freely afterwards.
    truth = Truth("semitrailer", {"slosh_mass": 1.0, "slosh_damping": 0.0, "gust_force_trailer": 8e3})
    u = constant(30.0)
    u[: 2 * 3000, 3] = 1.0
    x, out = np.zeros(16), np.zeros((30001, len(OUTPUTS["semitrailer"])))
    from plant_equations import integrate

    integrate(x, u, truth.equations(), STEP, out)
    earlier = np.zeros(16)
    period = 2 * np.pi / 3.0
    integrate(
        earlier, u[: 2 * round((30.0 - period) / STEP) + 1], truth.equations(), STEP, out[: -round(period / STEP)]
    )
    amplitude = np.hypot(x[9], x[10] / 3.0)
    assert amplitude > 0.005
    np.testing.assert_allclose([x[9], x[10] / 3.0], [earlier[9], earlier[10] / 3.0], atol=0.01 * amplitude)


# --- steering column, sensors, drives


def test_column_lags_delays_and_has_play():
    t = half_steps()
    angle = 0.5 * np.sin(2.0 * t)
    late = steered(angle, Column(delay=0.05))
    np.testing.assert_allclose(late[1000:], 0.5 * np.sin(2.0 * (t[1000:] - 0.05)), atol=1e-12)
    lag = steered(angle, Column(lag=0.2))[20000:]
    np.testing.assert_allclose(lag, 0.5 / np.sqrt(1 + 0.4**2) * np.sin(2.0 * t[20000:] - np.arctan(0.4)), atol=1e-7)
    play = steered(angle, Column(play=0.1))
    assert np.abs(play - angle).max() == pytest.approx(0.1)
    still = np.abs(np.diff(play)) < 1e-15
    assert 0.05 < still[20000:].mean() < 0.5  # after each turn it stands until the gap is closed


def test_noise_has_the_stated_deviation_and_sensors_their_faults(plans):
    out = solve(NOMINAL["car"], constant(RUN_IN + 120.0, steering_wheel_angle=0.3, speed=20.0), STEP)
    known = {"steering_wheel_angle": np.full(len(out), 0.3), "speed": np.full(len(out), 20.0)}
    clean = record("car", out, known, {}, np.random.default_rng(1))
    assert len(clean["time"]) == 12001
    assert clean["time"][-1] == pytest.approx(120.0)
    for name, deviation in NOISE["car"].items():
        assert clean[name].std() == pytest.approx(deviation, rel=0.05)
    wrong = {
        "yaw_rate": Channel(bias=0.1, gain_error=0.2, gain_loss_per_speed=0.005),
        "lateral_acceleration": Channel(roll_per_acceleration=0.01),
    }
    faulty = record("car", out, known, wrong, np.random.default_rng(1))
    y = named("car", out[-1:])
    assert (faulty["yaw_rate"] - clean["yaw_rate"]).mean() == pytest.approx(0.1 + y["yaw_rate"][0] * (0.2 - 0.1))
    a = y["lateral_acceleration"][0]
    seen = a * np.cos(0.01 * a) + GRAVITY * np.sin(0.01 * a)
    assert (faulty["lateral_acceleration"] - clean["lateral_acceleration"])[-1] == pytest.approx(seen - a)
    np.testing.assert_array_equal(faulty["lateral_velocity"], clean["lateral_velocity"])


def test_a_turned_sensor_reads_a_part_of_what_lies_across():
    out = solve(NOMINAL["car"], constant(RUN_IN + 120.0, steering_wheel_angle=0.3, speed=20.0), STEP)
    braking = {"steering_wheel_angle": np.full(len(out), 0.3), "speed": 20.0 - 2.0 * np.arange(len(out)) * STEP}
    y, turned = named("car", out[-1:]), Channel(misalignment=0.04)
    wrong = {"lateral_acceleration": turned, "lateral_velocity": turned}
    found = {name: values[-1] for name, values in sensed("car", out, braking, wrong).items()}
    a, v = y["lateral_acceleration"][0], y["lateral_velocity"][0]
    assert found["lateral_acceleration"] == pytest.approx(a * np.cos(0.04) + 2.0 * np.sin(0.04))
    assert found["lateral_velocity"] == pytest.approx(v * np.cos(0.04) - braking["speed"][-1] * np.sin(0.04))


@pytest.mark.parametrize("vehicle", ["semitrailer", "car"])
def test_drives_are_varied_and_stay_within_the_drivers_habits(vehicle):
    driver = DRIVERS[vehicle]
    for seed in range(2):
        d = draw_drive(vehicle, np.random.default_rng(seed))
        assert len({m["name"] for m in d.manoeuvres}) == 5
        assert driver.slowest - 1e-9 <= d.speed.min()
        assert d.speed.max() <= driver.fastest + 1e-9
        assert np.abs(d.speed_rate).max() <= driver.speeding_up * (1 + 1e-9)
        np.testing.assert_allclose(np.gradient(d.speed, d.time), d.speed_rate, atol=2e-3)
        asked = d.steering_wheel_angle / driver.steering_ratio / (driver.wheelbase / d.speed**2 + driver.understeer)
        assert driver.hardest * 0.4 < np.abs(asked).max() <= driver.hardest
        assert np.abs(np.diff(d.steering_wheel_angle)).max() / (STEP / 2) < 20.0  # rad/s; hands do no more
        assert np.abs(d.steering_wheel_angle[d.time < 2.0]).max() == 0.0
