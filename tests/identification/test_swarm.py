"""The particle swarm and its cost: against a quadratic, against a simulation by hand, and as a method."""

import dataclasses

import numpy as np
import pytest

from harness.common.errors import UserError
from harness.config import DriveSpec
from harness.engine.compile import compile_model
from harness.identification.contract import Problem, load_method, settings_of
from harness.identification.innovations import Innovations
from harness.identification.methods.swarm import Settings, identify, optimise
from harness.identification.simulation_error import Free, Misfit
from harness.simulation.drives import profile_of
from reproductions.simulated_recording import record
from reproductions.sun_em import DRIVE, car
from reproductions.ziaukas_swarm import DRIVES, main, setup, swarm_over_logarithms

FREE = ("stiffness_over_load_front", "cog_to_front_axle")


@pytest.fixture(scope="module")
def spec():
    return car(start=False)


@pytest.fixture(scope="module")
def drive(spec):
    profile = profile_of(spec, DriveSpec("lane change", "sine", dict(DRIVE), "lane change"))
    return record(spec, profile, "lane change", 3)


def cost_on(spec, drives, free=None, **more):
    compiled = compile_model(spec.model(), spec.step, spec.integrator, spec.substeps)
    wanted = free or [Free("stiffness_over_load_front", 4.0, 16.0), Free("cog_to_front_axle", 0.5, 2.0)]
    return Misfit(compiled, spec.values, wanted, drives, **more)


def by_hand(spec, drive, values):
    """The cost of (4.26) by Euler's method on the car's equations, written out."""
    v = {**spec.values, **values}
    front, rear, ratio = v["stiffness_over_load_front"], v["stiffness_over_load_rear"], v["mass_over_inertia"]
    l_f, L, h, g = v["cog_to_front_axle"], v["axle_distance"], v["cog_height"], 9.81
    l_r, x, squares = L - l_f, drive.first_mean.copy(), np.zeros(3)
    for (wheel, speed, rate), y in zip(drive.inputs, drive.measurements, strict=True):
        squares += np.where(np.isnan(y), 0.0, (y - x) ** 2)
        v_y, w, _ = x
        a_x = rate - w * v_y - w**2 * l_r
        f_f = front * (l_r * g - h * a_x) / L * (wheel / v["steering_ratio"] - (v_y + L * w) / speed)
        f_r = rear * (l_f * g + h * a_x) / L * (-v_y / speed)
        dw = ratio * (l_f * f_f - l_r * f_r)
        x = x + spec.step * np.array([f_f + f_r - w * speed - dw * l_r, dw, w])
    spread = np.nansum((drive.measurements - np.nanmean(drive.measurements, axis=0)) ** 2, axis=0)
    return np.sum(np.sqrt(squares / spread))


def test_the_cost_is_that_of_the_thesis_and_skips_missing_samples(spec, drive):
    holes = drive.measurements.copy()
    holes[100:150, 1] = np.nan
    drive = dataclasses.replace(drive, measurements=holes)
    candidates = np.array([[8.36, 1.014], [9.0, 1.2], [7.0, 0.9]])
    expected = [by_hand(spec, drive, dict(zip(FREE, c, strict=True))) for c in candidates]
    assert cost_on(spec, [drive])(candidates) == pytest.approx(expected, rel=1e-9)


def test_costs_do_not_depend_on_threads_or_neighbours(spec, drive):
    candidates = np.random.default_rng(1).uniform([4, 0.5], [16, 2], (19, 2))
    together = cost_on(spec, [drive, dataclasses.replace(drive, name="again")], jobs=2)(candidates)
    cost = cost_on(spec, [drive, dataclasses.replace(drive, name="again")])
    assert together.tolist() == [cost(c[None])[0] for c in candidates]


def test_a_parameter_may_belong_to_one_recording_and_be_known_in_another(spec, drive):
    other = dataclasses.replace(drive, name="other")
    free = [Free("cog_to_front_axle", 0.5, 2.0, ("other",)), Free("stiffness_over_load_front", 4.0, 16.0)]
    norms = cost_on(spec, [drive, other], free).norms(np.array([[1.3, 8.36]]))
    alone = cost_on(spec, [drive]).norms(np.array([[8.36, 1.014], [8.36, 1.3]]))
    np.testing.assert_array_equal(norms[:, 0], alone[0])
    known = {"other": {"cog_to_front_axle": 1.3}}
    same = cost_on(spec, [drive, other], free[1:], per_drive=known).norms(np.array([[8.36]]))
    np.testing.assert_array_equal(same[:, 0], alone[0])


def test_a_candidate_that_diverges_costs_infinity_and_others_do_not(spec, drive):
    wide = [Free("stiffness_over_load_front", 4.0, 1e6), Free("cog_to_front_axle", 0.5, 2.0)]
    costs = cost_on(spec, [drive], wide)(np.array([[8.36, 1.014], [1e5, 1.014]]))
    assert costs[1] == np.inf
    assert costs[0] == pytest.approx(cost_on(spec, [drive])(np.array([[8.36, 1.014]]))[0], rel=1e-12)


def test_bad_requests_name_what_is_wrong(spec, drive):
    for free, drives, message in (
        ([Free("stiffness", 1, 2)], [drive], "closest: stiffness"),
        ([Free(FREE[0], 2, 2)], [drive], "is empty"),
        ([Free(FREE[0], 1, 2, ("lane chnge",))], [drive], "closest: lane change"),
        ([Free(FREE[0], 1, 2)], [], "no recording"),
    ):
        with pytest.raises(UserError, match=message):
            cost_on(spec, drives, free)
    still = dataclasses.replace(drive, measurements=np.zeros_like(drive.measurements))
    with pytest.raises(UserError, match="does not vary"):
        cost_on(spec, [still])


def bowl(centre):
    def cost(candidates):
        found = np.sum((candidates - centre) ** 2, axis=1)
        return np.where(candidates[:, 0] > 0.8, np.inf, found)

    return cost


def test_the_swarm_finds_a_minimum_and_counts_what_diverges():
    centre, low, high = np.array([0.3, -0.2, 0.5]), -np.ones(3), np.ones(3)
    found = optimise(bowl(centre), low, high, 4, Settings(particles=40, iterations=120))
    np.testing.assert_allclose(found.values, centre, atol=1e-6)
    assert np.all(np.diff(found.history) <= 0)
    assert found.evaluated == 40 * 121
    assert 0 < found.diverged < found.evaluated / 4
    again = optimise(bowl(centre), low, high, 4, Settings(particles=40, iterations=120))
    assert again.history.tolist() == found.history.tolist()


def test_the_swarm_stays_in_its_box_and_says_when_nothing_is_finite():
    asked = []

    def cost(candidates):
        asked.append(candidates)
        return np.sum((candidates - 3.0) ** 2, axis=1)

    found = optimise(cost, -np.ones(2), np.ones(2), 0, Settings(particles=20, iterations=40))
    assert np.abs(np.concatenate(asked)).max() <= 1.0
    np.testing.assert_allclose(found.values, [1.0, 1.0])
    lost = optimise(lambda c: np.full(len(c), np.inf), -np.ones(2), np.ones(2), 0, Settings(particles=5, iterations=3))
    assert np.isnan(lost.values).all()
    assert lost.diverged == lost.evaluated == 20


def test_as_a_method_it_recovers_hidden_parameters_and_reports_a_bound(spec, drive):
    problem = Problem(Innovations(spec, jobs=1), (drive,), FREE, seed=2)
    file = load_method("swarm")
    small = {"particles": 24, "iterations": 40, "bounds": {FREE[0]: (4.0, 16.0), FREE[1]: (0.5, 2.0)}}
    fit = identify(problem, settings_of(file, small))
    assert fit.estimate(FREE[0]).value == pytest.approx(8.36, rel=5e-3)
    assert fit.estimate(FREE[1]).value == pytest.approx(1.014, rel=2e-2)
    assert fit.after <= fit.before * 1.01
    assert fit.spec.values[FREE[0]] == fit.estimate(FREE[0]).value
    narrow = {**small, "bounds": {FREE[0]: (9.0, 16.0), FREE[1]: (0.5, 2.0)}}
    assert identify(problem, settings_of(file, narrow)).estimate(FREE[0]).verdict == "at its bound"
    with pytest.raises(UserError, match="no free parameter"):
        identify(problem, settings_of(file, {"bounds": {"cog_height": (0.1, 1.0)}}))


def test_the_study_hides_what_table_4_4_searches(tmp_path):
    problem = setup(DRIVES, 1, 1)
    assert len(problem.hidden) == len(problem.fit.free) == 16
    assert np.all((problem.hidden > problem.fit.lower) & (problem.hidden < problem.fit.upper))
    wrong = problem.hidden * 1.05
    costs = problem.fit(np.array([problem.hidden, wrong]))
    assert costs[0] < costs[1]
    for drive in problem.judge.drives:
        run = problem.free_run(drive.name, problem.hidden)
        rest = drive.measurements - np.column_stack([run[o] for o in run])
        assert np.sqrt(np.mean(rest[:, 0] ** 2)) == pytest.approx(0.01, rel=0.1)  # the noise of the yaw rate
    other = tmp_path / "drives.toml"
    other.write_text('[[drive]]\nname = "fit-full-step"\nkind = "step"\n')
    with pytest.raises(UserError, match="must begin with"):
        setup(other, 1, 1)
    found = swarm_over_logarithms(problem.fit, 1, Settings(particles=40, iterations=1))
    assert np.all((found.values >= problem.fit.lower) & (found.values <= problem.fit.upper))
    assert problem.fit(found.values[None])[0] == pytest.approx(found.cost, rel=1e-12)
    unstable = np.where([f.parameter == "relaxation_length_12" for f in problem.fit.free], 0.05, problem.hidden)
    lost = problem.free_run("judge-empty-road", unstable)["yaw_rate_tractor"]
    assert np.isfinite(lost[:100]).all()
    assert np.isnan(lost[-1])


def test_the_study_writes_its_report(tmp_path, capsys):
    small = ["--repeats", "2", "--beside", "1", "--particles", "40", "--iterations", "1", "--out", str(tmp_path)]
    assert main(small) == 0
    assert (tmp_path / "report.pdf").stat().st_size > 20_000
    page = (tmp_path / "report.html").read_text()
    assert "of 2 swarms end within 5 % of the best" in page
    with np.load(tmp_path / "identify.npz") as kept:
        assert kept["swarm_values"].shape == (2, 16)
        assert kept["differential_evolution_cost"].shape == (1, 2)
        first = {name: kept[name] for name in kept.files}
    (tmp_path / "runs" / "swarm_02.npz").unlink()
    capsys.readouterr()
    assert main(small) == 0
    assert capsys.readouterr().err.count("kept from before") == 3
    with np.load(tmp_path / "identify.npz") as kept:
        for name in ("swarm_values", "swarm_cost", "swarm_logarithmic_values", "judged"):
            np.testing.assert_array_equal(kept[name], first[name])
    assert main([*small[:6], "--iterations", "2", *small[8:]]) == 2
    assert "made by other code or with other settings" in capsys.readouterr().err
    assert main([*small[2:], "--repeats", "0"]) == 2
    assert "must be at least 1" in capsys.readouterr().err
