"""The realistic plants: their equations against closed forms, textbook ranges, mirror images and smaller steps."""

import math

import numpy as np
import pytest

from bench.real.driver import HALF_STEP, column, draw_drive
from bench.real.specimens import AXLES, BUILT, assemble, data_sheet, effective_stiffness, lean
from bench.real.vehicle import (
    DY,
    FZ0,
    GRAVITY,
    KY,
    KY_LOAD,
    PHI,
    PHI_REAR,
    RATE,
    RATE_REAR,
    ROAD_WHEEL,
    SPEED,
    STEP,
    UNIT,
    R,
    U,
    V,
    _coupling,
    _rates,
    integrate,
    lateral_force,
)

VEHICLES = ("car", "semitrailer")
HARD = {"car": 0.02, "semitrailer": 0.02}
"""rad of the road wheels; about 0.25 g at 20 m/s."""


def driven(vehicle, angle, seconds=8.0, speed=20.0, step=STEP, **values):
    """Return states, axles and what is felt at a steady speed; the road-wheel angle is a number or a function of s."""
    p = assemble(vehicle, {**BUILT[vehicle], **values})
    t = np.arange(2 * round(seconds / step) + 1) * step / 2
    u = np.zeros((t.size, 4 + 2 * p.x.size))
    u[:, ROAD_WHEEL], u[:, SPEED] = angle(t) if callable(angle) else angle, speed
    return integrate(u, p, step)


def weave(t, size=0.015):
    return size * np.sin(2 * np.pi * 0.5 * t) * np.minimum(t, 1.0)


def modes(vehicle, speed=20.0):
    """Return frequency in Hz and damping ratio of every oscillation straight ahead, by its name's largest part."""
    p = assemble(vehicle, {**BUILT[vehicle], "kingpin_play": 0.0, "fifth_wheel_roll_play": 0.0})
    n, m = p.mass.size, p.x.size
    nx = UNIT * n + (3 if n > 1 else 0) + 2 * m
    y, u = np.zeros(nx), np.zeros(4 + 2 * m)
    y[U : n * UNIT : UNIT], u[SPEED] = speed, speed
    jacobian, up, down = np.zeros((nx, nx)), np.zeros(nx), np.zeros(nx)
    for k in range(nx):
        h = np.zeros(nx)
        h[k] = 1e-5
        _rates(y + h, u, p, up, np.zeros((m, 4)), np.zeros((n, 3)))
        _rates(y - h, u, p, down, np.zeros((m, 4)), np.zeros((n, 3)))
        jacobian[:, k] = (up - down) / 2e-5
    values, vectors = np.linalg.eig(jacobian)
    there = values.imag > 1e-3
    size = np.abs(values[there])
    return size / (2 * np.pi), -values[there].real / size, np.abs(vectors[:, there])


# --- tyres


def test_a_tyre_has_its_stiffness_its_peak_and_no_side():
    c = assemble("car", BUILT["car"]).tyre[0]
    stiffness = c[KY] * c[FZ0] * math.sin(2 * math.atan(1 / c[KY_LOAD]))
    assert lateral_force(1e-6, 0.0, c[FZ0], c) == pytest.approx(stiffness * 1e-6, rel=1e-4)
    slips = np.linspace(0.0, 0.6, 400)
    forces = np.array([lateral_force(s, 0.0, c[FZ0], c) for s in slips])
    assert forces.max() == pytest.approx(c[DY] * c[FZ0], rel=2e-3)
    assert lateral_force(-0.05, 0.0, 3000.0, c) == -lateral_force(0.05, 0.0, 3000.0, c)
    assert lateral_force(0.05, 0.0, -1.0, c) == 0.0
    assert lateral_force(0.05, 0.0, 8400.0, c) < 2 * lateral_force(0.05, 0.0, 4200.0, c)  # degressive


def test_a_braking_tyre_has_less_left_for_the_bend():
    c = assemble("car", BUILT["car"]).tyre[0]
    free, braked = (lateral_force(0.04, kappa, 4200.0, c) for kappa in (0.0, -0.03))
    assert 0.8 * free < braked < 0.99 * free
    assert lateral_force(0.04, 0.03, 4200.0, c) == pytest.approx(braked)


# --- vehicles


@pytest.mark.parametrize("vehicle", VEHICLES)
def test_static_loads_are_the_weight_and_balance_it(vehicle):
    p = assemble(vehicle, BUILT[vehicle])
    assert p.load.sum() == pytest.approx(p.mass.sum() * GRAVITY)
    last = p.unit == p.mass.size - 1
    ahead = p.hitch[1] * (p.mass[-1] * GRAVITY - p.load[last].sum())  # the kingpin carries what the axles do not
    assert p.load[last] @ p.x[last] + ahead == pytest.approx(0.0, abs=1e-6 * p.load.sum())


@pytest.mark.parametrize("vehicle", VEHICLES)
def test_straight_ahead_stays_straight_and_keeps_its_speed(vehicle):
    states, axles, _ = driven(vehicle, 0.0)
    assert np.abs(states[:, R]).max() < 1e-9
    assert states[-1, U] == pytest.approx(20.0, abs=0.03)
    assert axles[-1, :, 1:3].sum() == pytest.approx(assemble(vehicle, BUILT[vehicle]).load.sum(), rel=1e-6)


@pytest.mark.parametrize("vehicle", VEHICLES)
def test_left_and_right_are_alike(vehicle):
    (one, loads, felt), (other, mirrored, felt_there) = (
        driven(vehicle, lambda t, side=side: side * weave(t), 5.0) for side in (1.0, -1.0)
    )
    assert np.abs(felt[:, :, 0]).max() > 0.5
    assert felt[:, :, 0] == pytest.approx(-felt_there[:, :, 0], abs=1e-7)
    assert one[:, U] == pytest.approx(other[:, U], abs=1e-8)
    assert loads[:, :, 1] == pytest.approx(mirrored[:, :, 2], rel=1e-6)


def test_the_fifth_wheel_takes_the_power_at_which_it_is_strained_and_turned():
    p = assemble("semitrailer", BUILT["semitrailer"])
    y = np.random.default_rng(3).uniform(-1, 1, 2 * UNIT + 3 + 2 * p.x.size)
    force = np.zeros((2, 4))
    strained = _coupling(y, p, force)
    moving = np.array([y[[U, V, R, RATE_REAR]], y[[UNIT + U, UNIT + V, UNIT + R, UNIT + RATE]]])
    along, across = force[0, :2]
    moment, roll = force[0, 2] + p.hitch[0] * across, -force[1, 3]
    turned = moving[1, 2:] - moving[0, 2:]
    taken = np.array([along, across, moment, roll]) @ np.array([*strained, *turned])
    assert np.abs([along, across, moment, roll]).min() > 50.0
    assert (force * moving).sum() == pytest.approx(-taken, rel=1e-9)


@pytest.mark.parametrize("vehicle", VEHICLES)
def test_half_the_step_changes_nothing_that_a_sensor_would_see(vehicle):
    states, _, felt = driven(vehicle, weave, 4.0, fifth_wheel_roll_play=0.0, kingpin_play=0.0)
    finer, _, finely = driven(vehicle, weave, 4.0, step=STEP / 2, fifth_wheel_roll_play=0.0, kingpin_play=0.0)
    assert np.abs(states[:, R] - finer[::2, R]).max() < 1e-6 * np.abs(states[:, R]).max()
    assert np.abs(felt[:, 0, 0] - finely[::2, 0, 0]).max() < 1e-5 * np.abs(felt[:, 0, 0]).max()


@pytest.mark.parametrize("vehicle", VEHICLES)
def test_a_steady_bend_balances_forces_and_loads_and_leans_to_the_outside(vehicle):
    states, axles, felt = driven(vehicle, HARD[vehicle], 12.0)
    p = assemble(vehicle, BUILT[vehicle])
    lateral = states[-1, U] * states[-1, R]
    assert felt[-1, 0, 0] == pytest.approx(lateral, rel=0.01)
    assert axles[-1, :, 0].sum() == pytest.approx(p.mass.sum() * lateral, rel=0.01)
    assert axles[-1, :, 1:3].sum() == pytest.approx(p.mass.sum() * GRAVITY, rel=0.01)
    assert (axles[-1, :, 2] > axles[-1, :, 1]).all()  # a bend to the left loads the right wheels
    # All overturning moments about the ground are borne by the difference of the loads.
    borne = 0.5 * ((axles[-1, :, 2] - axles[-1, :, 1]) * p.track).sum()
    values = BUILT[vehicle]
    height = values.get("cog_height") or np.average(
        [values["tractor_cog_height"], values["trailer_cog_height"]], weights=p.mass
    )
    assert borne == pytest.approx(p.mass.sum() * lateral * height, rel=0.15)
    assert states[-1, PHI] > 0.0


@pytest.mark.parametrize(
    ("vehicle", "understeer", "roll"), [("car", (1.0, 4.0), (2.5, 6.0)), ("semitrailer", (1.0, 6.0), (3.0, 12.0))]
)
def test_understeer_and_lean_are_those_of_textbooks(vehicle, understeer, roll):
    states, _, felt = driven(vehicle, 0.012, 12.0)
    values = BUILT[vehicle]
    prefix = "" if vehicle == "car" else "tractor_"
    base = values[f"{prefix}cog_to_front_axle"] + values[f"{prefix}cog_to_rear_axle"]
    gradient = (0.012 - base * states[-1, R] / states[-1, U]) / felt[-1, 0, 0]
    assert understeer[0] < math.degrees(gradient * GRAVITY) < understeer[1]
    last = (assemble(vehicle, values).mass.size - 1) * UNIT
    leaning = states[-1, last + PHI_REAR] / felt[-1, -1, 0]
    assert roll[0] < math.degrees(leaning * GRAVITY) < roll[1]
    if vehicle == "car":
        assert leaning == pytest.approx(lean(vehicle, values), rel=0.03)


def test_the_car_yaws_and_rolls_as_cars_do():
    frequency, damping, vectors = modes("car", 30.0)
    roll = [k for k in range(frequency.size) if vectors[[RATE, RATE + 2], k].min() > 0.3 and frequency[k] < 4.0]
    yaw = [k for k in range(frequency.size) if np.argmax(vectors[:, k]) == V]
    assert any(1.0 < frequency[k] < 2.2 and 0.15 < damping[k] < 0.55 for k in roll)
    assert [1.0 < frequency[k] < 2.0 and 0.4 < damping[k] < 0.8 for k in yaw] == [True]
    assert (damping > 0.0).all()


def test_the_semitrailer_rolls_slowly_and_is_stable():
    frequency, damping, _ = modes("semitrailer")
    assert (damping > 0.0).all()
    assert any(0.4 < f < 1.3 for f in frequency)
    assert frequency.max() < 60.0  # what one step of 1 ms can follow


def test_brakes_load_the_front_and_a_pull_turns_to_its_side():
    def braked(**values):
        p = assemble("car", {**BUILT["car"], **values})
        t = np.arange(4001) * HALF_STEP
        u = np.zeros((t.size, 8))
        u[:, 1], u[:, 2] = 25.0 - 4.0 * t, -4.0
        return integrate(u, p, STEP)

    states, axles, _ = braked()
    static = assemble("car", BUILT["car"]).load
    moved = axles[-1, 0, 1:3].sum() - static[0]
    assert moved == pytest.approx(1480.0 * 4.0 * 0.55 / 2.7, rel=0.1)
    assert states[-1, U] == pytest.approx(17.0, abs=0.3)
    assert braked(pull_front=0.2)[0][-1, R] > 0.005  # the left brake holds more


@pytest.mark.parametrize("vehicle", VEHICLES)
def test_the_data_sheet_describes_the_vehicle_within_a_few_percent(vehicle):
    values = BUILT[vehicle]
    sheet = data_sheet(vehicle, values)
    for group in ("front", "rear") if vehicle == "car" else ("11", "12", "2"):
        axles = AXLES[vehicle]
        j = next(k for k, a in enumerate(axles) if a.startswith(group))
        load = assemble(vehicle, values).load[j]
        stated = sheet[f"stiffness_peak_{group}"] * math.sin(2 * math.atan(load / sheet[f"stiffness_load_{group}"]))
        assert stated == pytest.approx(effective_stiffness(vehicle, values, group), rel=1e-3)
    if vehicle == "semitrailer":
        return
    states, _, _ = driven("car", 0.008, 10.0)
    front, rear = (effective_stiffness("car", values, g) for g in ("front", "rear"))
    lf, lr, mass = sheet["cog_to_front_axle"], sheet["cog_to_rear_axle"], sheet["mass"]
    gradient = mass / (lf + lr) * (lr / front - lf / rear)
    speed = states[-1, U]
    assert states[-1, R] == pytest.approx(0.008 * speed / (lf + lr + gradient * speed**2), rel=0.03)


# --- driver and column


def test_a_column_is_late_and_waits_within_its_play():
    wheel = np.concatenate([np.linspace(0.0, 1.6, 2001), np.linspace(1.6, 0.0, 2001)])
    ahead = column(wheel, 16.0, 0.0, 0.0, 0.0)
    assert ahead == pytest.approx(wheel / 16.0)
    late = column(wheel, 16.0, 0.0, 0.1, 0.0)
    assert late[400:] == pytest.approx(ahead[200:-200])
    loose = column(wheel, 16.0, 0.0, 0.0, 0.002)
    assert loose[1000] == pytest.approx(ahead[1000] - 0.002)
    assert loose[-1000] == pytest.approx(ahead[-1000] + 0.002)
    lagging = column(wheel, 16.0, 0.05, 0.0, 0.0)
    assert lagging[1990] == pytest.approx(ahead[1990] - 0.05 * 0.1, rel=1e-3)  # 0.1 rad/s at the road wheels


@pytest.mark.parametrize("vehicle", VEHICLES)
def test_drives_stay_where_an_engineer_stays(vehicle):
    wheels = 2 * len(AXLES[vehicle])
    for seed in range(5):
        drive = draw_drive(vehicle, wheels, np.random.default_rng(seed))
        assert 7.0 < drive.speed.min() < drive.speed.max() < 31.0
        asked = np.gradient(drive.speed, drive.time)
        assert asked == pytest.approx(drive.speed_rate, abs=0.02)
        assert np.abs(drive.bank).max() < 0.06
        names = [m[0] for m in drive.manoeuvres]
        assert {"circle_left", "circle_right", "slalom", "steps", "lane_changes"} <= set(names)
        assert drive.wheel.max() > 0.3
        assert drive.wheel.min() < -0.3
