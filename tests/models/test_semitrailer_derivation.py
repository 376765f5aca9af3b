"""The semitrailer's equations against an independent derivation by Lagrange's equations of the second kind.

Two rigid bodies move freely in the plane (six generalised coordinates). Tyre forces act at the axles,
the kingpin force along the trailer's lateral axis on both bodies. There is no longitudinal kingpin force
(the thesis leaves it out); a longitudinal force through each body's own axis keeps the prescribed speed
instead. Unknown are six accelerations, the kingpin force and the two longitudinal forces; there are six
equations of Lagrange, two of the kingpin (same acceleration of its point on both bodies) and one of the
prescribed speed.
"""

from __future__ import annotations

from functools import lru_cache

import numpy as np
import pytest
import sympy as sp
from sympy.physics import mechanics as me

from harness.models.assembly.assemble import assemble
from harness.models.parameters import ziaukas_2023
from support.numeric import evaluator

G = 9.81
TRAILER_AXLES = ("21", "22", "23")
AXLES = ("11", "12", *TRAILER_AXLES)
t = me.dynamicsymbols._t


@lru_cache(maxsize=1)
def derive():
    """Return numeric functions of the linear system ``M z = r`` and of the axles' velocities.

    ``z`` holds the six accelerations, the kingpin force and both longitudinal forces.
    """
    q = me.dynamicsymbols("X1 Y1 psi1 X2 Y2 psi2")
    qd = [c.diff(t) for c in q]
    m1, J1, a1, b1, h1, m2, J2, a2, b21, b22, b23 = geometry = sp.symbols("m1 J1 a1 b1 h1 m2 J2 a2 b21 b22 b23")
    delta, H, T1, T2, rate = sp.symbols("delta H T1 T2 rate")
    F = sp.symbols("F11 F12 F21 F22 F23")

    N = me.ReferenceFrame("N")
    tractor, trailer = N.orientnew("B1", "Axis", (q[2], N.z)), N.orientnew("B2", "Axis", (q[5], N.z))
    wheel = tractor.orientnew("W", "Axis", (delta, N.z))
    O = me.Point("O")  # noqa: E741
    O.set_vel(N, 0)
    centres = []
    for x, y, name in ((q[0], q[1], "S1"), (q[3], q[4], "S2")):
        centre = O.locatenew(name, x * N.x + y * N.y)
        centre.set_vel(N, x.diff(t) * N.x + y.diff(t) * N.y)
        centres.append(centre)

    def on(body: int, distance: sp.Expr, name: str) -> me.Point:
        frame = (tractor, trailer)[body]
        point = centres[body].locatenew(name, distance * frame.x)
        point.v2pt_theory(centres[body], N, frame)
        return point

    axle = {
        "11": on(0, a1, "A11"),
        "12": on(0, -b1, "A12"),
        **{a: on(1, -b, f"A{a}") for a, b in zip(TRAILER_AXLES, (b21, b22, b23), strict=True)},
    }
    kingpin = on(0, -h1, "K1"), on(1, a2, "K2")
    lateral = {"11": wheel.y, "12": tractor.y, "21": trailer.y, "22": trailer.y, "23": trailer.y}
    forces = [(axle[a], f * lateral[a]) for a, f in zip(AXLES, F, strict=True)]
    forces += [(kingpin[0], H * trailer.y), (kingpin[1], -H * trailer.y)]
    forces += [(centres[0], T1 * tractor.x), (centres[1], T2 * trailer.x)]

    energy = sum(
        m * centre.vel(N).dot(centre.vel(N)) / 2 + J * w**2 / 2
        for m, J, centre, w in ((m1, J1, centres[0], qd[2]), (m2, J2, centres[1], qd[5]))
    )
    method = me.LagrangesMethod(energy, q, forcelist=forces, frame=N)
    gap = kingpin[0].acc(N) - kingpin[1].acc(N)
    speed = centres[1].vel(N).dot(trailer.x)
    conditions = [*method.form_lagranges_equations(), gap.dot(N.x), gap.dot(N.y), speed.diff(t) - rate]

    acceleration, velocity, position = sp.symbols("A:6"), sp.symbols("V:6"), sp.symbols("Q:6")
    plain = [
        *zip([c.diff(t, 2) for c in q], acceleration, strict=True),
        *zip(qd, velocity, strict=True),
        *zip(q, position, strict=True),
    ]
    conditions = [sp.expand(c.doit()).subs(plain) for c in conditions]
    unknown = [*acceleration, H, T1, T2]
    matrix, right = sp.linear_eq_to_matrix(conditions, unknown)
    slips = [
        sp.Matrix([axle[a].vel(N).dot(frame.x), axle[a].vel(N).dot(frame.y)]).subs(plain)
        for a, frame in zip(AXLES, (tractor, tractor, trailer, trailer, trailer), strict=True)
    ]
    arguments = [position, velocity, F, delta, rate, geometry]
    return sp.lambdify(arguments, [matrix, right]), sp.lambdify(arguments, slips)


def turn(angle: float) -> np.ndarray:
    return np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])


def random_case(seed: int):
    """Return the model's state and inputs, the free bodies' positions and velocities, and the parameters."""
    rng = np.random.default_rng(seed)
    values = dict(ziaukas_2023.VALUES)
    values |= {
        "tractor_mass": rng.uniform(6e3, 1e4),
        "tractor_yaw_inertia": rng.uniform(2e4, 6e4),
        "trailer_mass": rng.uniform(6e3, 3.6e4),
        "trailer_inertia_scale": rng.uniform(0.7, 1.6),
        "trailer_cog_from_rear": rng.uniform(5.0, 10.0),
        "constraint_rate": rng.choice([0.0, 3.0, 10.0]),
    }
    a_2 = values["kingpin_from_rear"] - values["trailer_cog_from_rear"]
    h_1 = values["tractor_cog_to_kingpin"]
    theta, psi_1 = rng.uniform(-1.0, 1.0), rng.uniform(-np.pi, np.pi)
    w_1, w_2, v_x2, v_y2 = *rng.uniform(-0.6, 0.6, 2), rng.uniform(6, 20), rng.uniform(-2, 2)
    psi_2 = psi_1 + theta
    e_x, e_y = turn(psi_1).T
    # Body 1 takes the velocity of the kingpin from body 2 (rigid-body kinematics, not the model's formula).
    kingpin = turn(psi_2) @ np.array([v_x2, v_y2 + a_2 * w_2])
    velocity_1, velocity_2 = kingpin + w_1 * h_1 * e_y, turn(psi_2) @ np.array([v_x2, v_y2])
    place_1 = rng.uniform(-50, 50, 2)
    place_2 = place_1 - h_1 * e_x - a_2 * turn(psi_2)[:, 0]
    forces = rng.uniform(-5e4, 5e4, 5)
    steering, rate = rng.uniform(-8, 8), rng.uniform(-3, 3)
    x = np.array([velocity_1 @ e_y, w_1, v_y2, w_2, theta, *forces])
    position = np.array([*place_1, psi_1, *place_2, psi_2])
    velocity = np.array([*velocity_1, w_1, *velocity_2, w_2])
    return values, x, np.array([steering, v_x2, rate]), position, velocity


def bodies(values: dict[str, float]) -> list[float]:
    """Return m1, J1, a1, b1, h1, m2, J2, a2, b21, b22, b23 in SI units."""
    cog = values["trailer_cog_from_rear"]
    mass = values["trailer_mass"]
    box = mass * (values["trailer_track"] ** 2 + values["trailer_length"] ** 2) / 12  # a plate's yaw inertia
    return [
        values["tractor_mass"],
        values["tractor_yaw_inertia"],
        values["tractor_cog_to_front_axle"],
        values["tractor_cog_to_rear_axle"],
        values["tractor_cog_to_kingpin"],
        mass,
        values["trailer_inertia_scale"] * box,
        values["kingpin_from_rear"] - cog,
        *[cog - values[f"axle_{a}_from_rear"] for a in TRAILER_AXLES],
    ]


MODEL = assemble("semitrailer", "magic_formula")


@pytest.mark.parametrize("seed", range(25))
def test_bodies_move_as_lagrange_says(seed):
    values, x, u, position, velocity = random_case(seed)
    system, _ = derive()
    delta = u[0] / values["steering_ratio"]
    matrix, right = system(position, velocity, x[5:], delta, u[2], bodies(values))
    # Rows and unknowns differ by orders of magnitude (m/s2 and N): scale before solving.
    unit = np.array([1.0] * 6 + [1e4] * 3)
    scaled = matrix * unit
    rows = np.abs(scaled).max(axis=1, keepdims=True)
    z = unit * np.linalg.solve(scaled / rows, np.ravel(right) / rows[:, 0])

    expected = []
    for body in (0, 3):  # rates of the velocities in body axes
        psi, w = position[body + 2], velocity[body + 2]
        e_x, e_y = turn(psi).T
        expected += [e_y @ z[body : body + 2] - w * (e_x @ velocity[body : body + 2]), z[body + 2]]
    expected.append(velocity[5] - velocity[2])
    found = evaluator(MODEL, values)(x, u)[:5]
    assert found == pytest.approx(np.array(expected), rel=1e-9)
    force, slip = evaluator(MODEL, values, ["coupling_force", "constraint_violation"])(x, u)
    assert force == pytest.approx(z[6], rel=1e-9)
    assert abs(slip) < 1e-12 * np.abs(velocity).max() * 10


@pytest.mark.parametrize("seed", range(25))
def test_tyres_see_the_velocity_of_their_axle(seed):
    """Slip from the axle's velocity vector, force by Pacejka's formula and its lag, all written anew."""
    values, x, u, position, velocity = random_case(seed)
    _, axle_velocities = derive()
    delta = u[0] / values["steering_ratio"]
    m1, _, a1, b1, h1, m2, _, a2, _, b22, _ = geometry = bodies(values)
    kingpin = m2 * G * b22 / (a2 + b22)
    front = (m1 * G * b1 + kingpin * (b1 - h1)) / (a1 + b1)
    load = [front, m1 * G + kingpin - front, *[(m2 * G - kingpin) / 3] * 3]
    found = evaluator(MODEL, values)(x, u)[5:]
    alphas = evaluator(MODEL, values, [f"slip_angle_axle_{a}" for a in AXLES])(x, u)
    for i, v in enumerate(axle_velocities(position, velocity, x[5:], delta, u[2], geometry)):
        along, across = np.ravel(v)
        alpha = (delta if i == 0 else 0.0) - np.arctan2(across, along)
        assert alphas[i] == pytest.approx(alpha, rel=1e-9)
        group = ("11", "12", "2", "2", "2")[i]
        D = values["friction"] * load[i]
        stiffness = values[f"stiffness_peak_{group}"] * np.sin(
            2 * np.arctan(load[i] / values[f"stiffness_load_{group}"])
        )
        C = values[f"shape_factor_{group}"]
        steady = D * np.sin(C * np.arctan(stiffness / (C * D) * np.tan(alpha)))
        lag = values[f"relaxation_length_{group}"] / along
        assert found[i] == pytest.approx((steady - x[5 + i]) / lag, rel=1e-9)


def test_the_check_can_fail():
    """A coupling arm off by a millimetre is seen."""
    values, x, u, *_ = random_case(0)
    wrong = {**values, "tractor_cog_to_kingpin": values["tractor_cog_to_kingpin"] + 1e-3}
    right = evaluator(MODEL, values)(x, u)[:5]
    assert evaluator(MODEL, wrong)(x, u)[:5] != pytest.approx(right, rel=1e-6)
