"""The likelihood fit: finds what was hidden, with honest intervals, and says what the drives cannot tell."""

import dataclasses
from pathlib import Path

import numpy as np
import pytest

from harness.common.errors import UserError
from harness.identification.contract import Problem
from harness.identification.coordinates import Coordinates
from harness.identification.innovations import Innovations
from harness.identification.methods.likelihood import Search, Settings, first_noise, identify
from harness.identification.uncertainty import _judge, limits_of_knowledge
from support.identification import CAR, car_fit, model_of, recorded

STIFFNESS = ("stiffness_over_load_front", "stiffness_over_load_rear")
FREE = (*STIFFNESS, "mass_over_inertia")
WRONG = {"stiffness_over_load_front": 7.942, "stiffness_over_load_rear": 7.386, "mass_over_inertia": 0.56}
"""First values of Sun 2015, section 3.2."""
QUICK = Settings(profiles=False, annealings=0)


def problem_of(seed, free=FREE, duration=20.0, **values):
    innovations, drive = car_fit(seed, duration, **(values or WRONG))
    return Problem(innovations, (drive,), free)


def deviations(fit):
    """Return how many standard errors each parameter lies from the truth, in logarithms."""
    truth = model_of(CAR).values
    return np.array([np.log(fit.estimate(n).value / truth[n]) * fit.estimate(n).value / fit.estimate(n).error
                     for n in FREE])  # fmt: skip


def test_hidden_parameters_and_noise_come_back():
    fit = identify(problem_of(1), Settings())
    assert fit.converged
    assert fit.after > fit.before
    assert np.all(np.abs(deviations(fit)) < 3.5)
    truth = model_of(CAR)
    for output, variance in truth.measurement_noise.items():
        if output in fit.spec.measurement_noise:
            assert fit.spec.measurement_noise[output] == pytest.approx(variance, rel=0.2)
    for name in FREE:
        e = fit.estimate(name)
        assert e.lower < truth.values[name] < e.upper
        assert e.verdict == "determined"
        assert e.profile is not None
        assert e.profile.drop.min() == 0.0


def test_intervals_cover_the_truth_as_often_as_they_say():
    """16 data sets of three parameters; ``python -m bench.identify --coverage 100`` is the long form."""
    truth = model_of(CAR).values
    inside, distance = [], []
    for seed in range(100, 116):
        fit = identify(problem_of(seed, duration=5.0), QUICK)
        inside += [fit.estimate(n).lower < truth[n] < fit.estimate(n).upper for n in FREE]
        distance.append(deviations(fit) ** 2)
    assert 0.85 <= np.mean(inside) <= 1.0  # 0.95 of 48 within three standard deviations of a binomial
    assert 0.4 < np.mean(distance) < 1.8


def test_the_search_ends_where_the_gradient_vanishes():
    search = Search(problem_of(2), QUICK)
    found = search.climb(search.coordinates.centre)
    _, gradient, information = search.objective.slopes(found.z, np.ones(len(search.coordinates), dtype=bool))
    assert found.converged
    assert np.all(np.abs(gradient) < 0.1 * np.sqrt(np.diagonal(information)))


def test_a_drive_straight_ahead_determines_nothing_and_says_so():
    innovations = Innovations(model_of(CAR, **WRONG), jobs=1)
    calm = dataclasses.replace(model_of(CAR), process_noise={})  # or the noise would shake the car
    straight = recorded(calm, 3, duration=10.0, speed=15.0, amplitude=1e-9)
    fit = identify(Problem(innovations, (innovations.drive(straight, "straight"),), FREE), Settings())
    verdicts = {fit.estimate(n).verdict for n in FREE}
    assert "determined" not in verdicts
    assert "not determined" in verdicts


def test_recordings_without_noise_give_no_confident_number():
    """Errors are measured by the noise; where a simulation has none, no interval means anything."""
    innovations = Innovations(model_of(CAR, **WRONG), jobs=1)
    silent = dataclasses.replace(model_of(CAR), process_noise={}, measurement_noise={})
    exact = recorded(silent, 3, duration=10.0, speed=15.0, amplitude=1e-6)
    fit = identify(Problem(innovations, (innovations.drive(exact, "exact"),), STIFFNESS), QUICK)
    assert {fit.estimate(n).verdict for n in STIFFNESS} == {"not determined"}
    assert "the recordings show none of lateral_velocity_rear" in fit.estimate(STIFFNESS[0]).reason


def test_a_parameter_without_any_effect_is_not_determined():
    """The height of the CoG acts through the longitudinal acceleration alone; straight ahead there is none."""
    innovations = Innovations(model_of(CAR), jobs=1)
    calm = dataclasses.replace(model_of(CAR), process_noise={})
    drive = innovations.drive(recorded(calm, 4, duration=5.0, speed=15.0, amplitude=1e-9), "straight")
    fit = identify(Problem(innovations, (drive,), ("cog_height",)), QUICK)
    height = fit.estimate("cog_height")
    assert height.verdict == "not determined"
    stiffness = identify(Problem(innovations, (drive,), STIFFNESS), QUICK).estimate(STIFFNESS[0])
    assert stiffness.verdict == "not determined"
    assert stiffness.reason.startswith("these drives tell less of it than was stated of it before")
    assert stiffness.error <= 0.1 * stiffness.start  # what is known without any drive


def test_confounded_parameters_name_each_other():
    """Place of the CoG and yaw inertia enter as products at a nearly steady speed."""
    fit = identify(problem_of(5, ("mass_over_inertia", "cog_to_front_axle", "steering_ratio"), 5.0), QUICK)
    inertia, place, _ = fit.estimates[:3]
    assert abs(fit.correlation[0, 1]) > 0.9
    assert abs(fit.correlation[0, 2]) < abs(fit.correlation[0, 1])
    assert "confounded with cog to front axle" in inertia.reason
    assert "confounded with mass over inertia" in place.reason


def entangled(correlation, known=np.inf):
    """Return the verdict on each of three parameters that are all known to a hundredth, two of them correlated."""
    search = Search(problem_of(5, FREE, 5.0), QUICK)
    space = search.coordinates.with_coordinates(
        [dataclasses.replace(c, stated_std=known, prior=np.inf) for c in search.coordinates.coordinates]
    )
    information = 1e4 * np.eye(len(space))
    inverse = np.array([[1.0, correlation], [correlation, 1.0]]) * 1e-4
    information[:2, :2] = np.linalg.inv(inverse)
    knowledge = limits_of_knowledge(space, space.centre, information)
    return [_judge(space, knowledge, i, 0.0, -0.02, 0.02) for i in range(3)]


def test_a_narrow_interval_of_entangled_parameters_determines_neither():
    assert [verdict for verdict, _ in entangled(0.95)] == ["determined"] * 3
    assert [verdict for verdict, _ in entangled(-0.999)] == ["confounded", "confounded", "determined"]
    assert "confounded with stiffness over load rear (-1.00)" in entangled(-0.999)[0][1]


def test_what_was_known_better_before_is_not_determined():
    """Along the difference of the two the error is 1.38 %, along their sum 0.3 %; 1.2 % was stated of each."""
    assert [verdict for verdict, _ in entangled(-0.9, 0.02)] == ["determined"] * 3
    found = entangled(-0.9, 0.012)
    assert [verdict for verdict, _ in found] == ["not determined", "not determined", "determined"]
    assert "tell less of it than was stated" in found[0][1]


def test_noise_stays_above_the_steps_of_its_signal():
    """A signal in steps of 0.01 has at least their variance; one that is not quantised what it shows."""
    problem = problem_of(3)
    coarse = dataclasses.replace(problem.drives[0], measurements=problem.drives[0].measurements.copy())
    coarse.measurements[:, 0] = np.round(coarse.measurements[:, 0], 2)
    search = Search(dataclasses.replace(problem, drives=(coarse,)), QUICK)
    noise = [c for c in search.coordinates.coordinates if c.kind == "measurement"]
    assert np.exp(noise[0].lower) >= 0.999e-4 / 12
    assert noise[0].quantisation == pytest.approx(1e-4 / 12, rel=1e-6)
    exact = first_noise(problem)
    assert np.exp(noise[1].lower) == pytest.approx(exact[1] / 100)


def test_a_parameter_driven_to_its_bound_is_said_to_be_there():
    search = Search(problem_of(6, STIFFNESS), QUICK)
    first, *others = search.coordinates.coordinates
    search.coordinates.coordinates = (dataclasses.replace(first, upper=np.log(8.0)), *others)
    search.coordinates.upper[0] = np.log(8.0)
    fit = search.report(search.climb(search.coordinates.centre), 0.0, False, lambda _: None)
    assert fit.estimates[0].verdict == "at its bound"
    assert "upper bound 8" in fit.estimates[0].reason
    assert fit.estimates[0].value == pytest.approx(8.0)


def test_missing_samples_leave_the_estimate_where_it_was():
    whole = problem_of(7)
    fit = identify(whole, QUICK)
    holes = np.random.default_rng(0).random(whole.drives[0].measurements.shape) < 0.3
    whole.drives[0].measurements[holes] = np.nan
    again = identify(whole, QUICK)
    for name in FREE:
        a, b = fit.estimate(name), again.estimate(name)
        assert b.error > a.error
        assert abs(a.value - b.value) < 3 * b.error


def test_two_drives_tell_more_than_one():
    one = problem_of(8)
    other = one.innovations.drive(recorded(model_of(CAR), 9, duration=20.0, amplitude=0.55), "other")
    alone = identify(one, QUICK)
    both = identify(dataclasses.replace(one, drives=(*one.drives, other)), QUICK)
    for name in FREE:
        assert both.estimate(name).error < alone.estimate(name).error
    assert np.all(np.abs(deviations(both)) < 3.5)


def test_other_starts_find_the_same_summit():
    problem = problem_of(10, STIFFNESS)
    single = identify(problem, QUICK)
    several = identify(problem, Settings(profiles=False, annealings=0, starts=3))
    assert several.after == pytest.approx(single.after, abs=0.05)


def test_a_prior_holds_a_parameter_that_the_data_hardly_tell():
    free = problem_of(11, ("cog_height", *STIFFNESS), 10.0, cog_height=0.7)
    tight = Settings(profiles=False, annealings=0, priors={"cog_height": 0.001})
    loose = identify(free, QUICK).estimate("cog_height")
    held = identify(free, tight).estimate("cog_height")
    assert held.value == pytest.approx(0.7, abs=0.005)
    assert held.error <= 0.001
    assert loose.error > held.error


def test_priors_are_those_that_the_parameter_set_states(tmp_path, monkeypatch):
    """As in the refit of a trace: ``std`` of the set, a tenth of the value where it says nothing."""
    monkeypatch.chdir(tmp_path)
    car = model_of(CAR)
    values = "".join(f"{n} = {v!r}\n" for n, v in car.values.items())
    noise = "".join(
        f"[{kind}_noise]\n" + "".join(f"{n} = {v!r}\n" for n, v in variances.items())
        for kind, variances in (("process", car.process_noise), ("measurement", car.measurement_noise))
    )
    stated = f"[std]\n{STIFFNESS[0]} = 1e-3\n"
    Path("mine.toml").write_text(f'vehicle = "{car.vehicle}"\n[values]\n{values}{noise}{stated}', encoding="utf-8")
    spec = dataclasses.replace(car, parameters="mine.toml")
    names = (STIFFNESS[0], "cog_height")
    known = Coordinates.of(spec, names, np.ones(len(car.measurement_noise)), stated=True)
    slopes = [c.slope(c.centre) for c in known.coordinates[:2]]
    np.testing.assert_allclose(known.weight[:2] ** -0.5 * slopes, [1e-3, 0.1 * car.values["cog_height"]])
    assert not Coordinates.of(spec, names, np.ones(len(car.measurement_noise))).weight[:2].any()


def test_a_model_that_cannot_be_driven_is_no_candidate():
    search = Search(problem_of(15, duration=5.0), QUICK)
    spinning = search.coordinates.centre.copy()
    spinning[1] = np.log(0.2 * np.exp(spinning[1]))  # the rear axle
    assert np.isneginf(search.objective.values(spinning[:, None])[0])
    search.objective.driveable = None
    assert np.isfinite(search.objective.values(spinning[:, None])[0])
    unstable = {**WRONG, STIFFNESS[1]: 0.2 * WRONG[STIFFNESS[1]]}
    assert Search(problem_of(15, duration=5.0, **unstable), QUICK).objective.driveable is None


def test_forcing_the_process_noise_down_leaves_a_search_that_began_with_too_much():
    problem = problem_of(12)
    search = Search(problem, QUICK)
    hot = search.coordinates.centre.copy()
    hot[search.coordinates.kind("process")] = 12.0
    from_hot = search.anneal(search.together(hot), 3, lambda _: None)
    assert from_hot.value == pytest.approx(search.climb(search.coordinates.centre).value, abs=0.5)


def test_fourth_differences_show_the_noise_of_a_smooth_signal():
    problem = problem_of(13)
    truth = [model_of(CAR).measurement_noise[n] for n in problem.innovations.model.outputs]
    found = first_noise(problem)
    # The states are driven by process noise as large as the measurement noise, which fourth differences see as well.
    assert np.all(found > 0.8 * np.array(truth))
    assert np.all(found < 2.5 * np.array(truth))


def test_nothing_free_and_unknown_names_are_refused():
    problem = problem_of(14, duration=5.0)
    with pytest.raises(UserError, match="no parameter is free"):
        identify(dataclasses.replace(problem, free=()), QUICK)
    with pytest.raises(UserError, match="closest: mass_over_inertia"):
        identify(dataclasses.replace(problem, free=("mass_over_inerta",)), QUICK)
