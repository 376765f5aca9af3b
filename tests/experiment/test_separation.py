"""Models told apart: closed forms of T-optimality, and what drives tell of effects of a car."""

import json
import math
from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import spearmanr

from harness.common.errors import UserError
from harness.config import resolve_single
from harness.config.parameter_set import set_text
from harness.experiment import rival_filter, separation
from harness.experiment.contract import total
from harness.experiment.files import contents
from harness.experiment.limits import Limits
from harness.experiment.open_trace import AtLevel, DrivesSoFar, OpenTrace, RivalModel, read_trace
from harness.experiment.rival_filter import Parabolas
from harness.experiment.run import DesignTask, design_drives
from harness.experiment.separation import SeparationGoal
from support.rehearsed import evidence_of, rehearsed

CAR = {"vehicle": "car", "parameters": "blanco_2021", "tyre": "linear", "sensors": "car_series", "integrator": "rk4"}
FREE = ("stiffness_peak_front", "stiffness_peak_rear")


def left_by_a_line(places, weights):
    """Return what a line leaves of the parabola x^2 measured at some places with unit noise."""
    root = np.sqrt(weights)
    tangent = np.column_stack([np.ones_like(places), places]) * root[:, None]
    residual = places**2 * root
    return unexplained(float(residual @ residual), tangent.T @ residual, tangent.T @ tangent)


def unexplained(squares, slope, information):
    """Return the squares that are left when the parameters have taken up what they can."""
    parabolas = Parabolas(np.array([squares]), slope[None], information[None])
    return parabolas.at(*parabolas.best())


def test_a_parabola_is_told_from_a_line_at_the_ends_and_in_the_middle():
    """No line comes nearer to ``x^2`` than 1/2; the weights are 1/4, 1/2, 1/4 (Atkinson and Fedorov 1975)."""
    best = left_by_a_line(np.array([-1.0, 0.0, 1.0]), np.array([0.25, 0.5, 0.25]))
    assert best == pytest.approx(0.25)
    random = np.random.default_rng(1)
    for _ in range(100):
        assert left_by_a_line(random.uniform(-1.0, 1.0, 5), random.dirichlet(np.ones(5))) <= best + 1e-12


def test_what_is_known_of_a_parameter_it_does_not_take_up():
    residual = np.array([2.0])
    free, held = (unexplained(4.0, residual, np.array([[1.0 + p]])) for p in (0.0, 1e9))
    assert free == pytest.approx(0.0)
    assert held == pytest.approx(4.0)


def parabolas(random, levels=6, n=3):
    """Return random squares of innovations at some levels."""
    tangents, residuals = random.standard_normal((levels, 8, n)), 3.0 * random.standard_normal((levels, 8))
    slopes = np.einsum("kin,ki->kn", tangents, residuals)
    return Parabolas((residuals**2).sum(axis=1), slopes, np.einsum("kin,kim->knm", tangents, tangents))


def test_levels_that_the_drives_so_far_rule_out_need_not_be_looked_at():
    random = np.random.default_rng(2)
    for _ in range(50):
        so_far, fitted = parabolas(random), parabolas(random)
        (level, place), (same, there) = ((so_far + fitted).best(f) for f in (None, so_far.floors()))
        assert level == same == np.argmin((so_far + fitted).floors())
        np.testing.assert_array_equal(place, there)


def rival(spec, name, share, error=0.3, costs=(0.0,), **added):
    values = {**{n: spec.values[n] for n in FREE}, **added}
    errors = np.array([0.02 * spec.values[n] for n in FREE] + [error * v for v in added.values()])
    says = [AtLevel(-cost, np.zeros(len(values)), np.diag(errors**-2.0)) for cost in costs]
    return RivalModel(name, (), share, values, errors, np.eye(len(values)), dict(spec.measurement_noise), tuple(says))


def opened(costs=(0.0,), spacing=1):
    """Return a trace that left three models, at levels of the process noise a hundredfold each, with what they cost."""
    spec = resolve_single(CAR, "test")
    rivals = (
        rival(spec, "lag", 0.5, costs=costs, steering_lag=0.05),
        rival(spec, "inertia", 0.3, costs=costs, yaw_inertia=1.1 * spec.values["yaw_inertia"]),
        rival(spec, "nothing", 0.2, costs=costs),
    )
    levels = tuple({s: 100.0**k * v for s, v in spec.process_noise.items()} for k in range(len(costs)))
    every = dict.fromkeys(spec.model().outputs, spacing)
    return OpenTrace(spec, rivals, DrivesSoFar(levels, 80.0, 40.0, every), 0.1)


@pytest.fixture(scope="module")
def goal():
    return SeparationGoal(opened())


def test_a_step_tells_a_lag_from_inertia_and_a_ramp_does_not(goal):
    step, ramp = evidence_of(goal, "step", [0.5, 0.5, 0.2]), evidence_of(goal, "ramp", [0.5, 0.5])
    assert goal.value(None) > goal.value(ramp) > goal.value(step)
    before, after = goal.posterior(None), goal.posterior(step)
    np.testing.assert_allclose(before[0], goal.shares)
    assert after[0][0] > before[0][0]
    distance, _ = goal.distances(step)
    assert distance[0, 1] > 4.0 * goal.distances(ramp)[0][0, 1]
    np.testing.assert_allclose(np.diagonal(distance), 0.0)


def test_planned_drives_have_samples_as_far_apart_as_those_so_far(goal):
    seldom = SeparationGoal(opened(spacing=4))
    every, fourth = (g.distances(evidence_of(g, "step", [0.5, 0.5, 0.2]))[0] for g in (goal, seldom))
    assert 0.1 * every[0, 1] < fourth[0, 1] < 0.5 * every[0, 1]


def test_a_rival_takes_up_misfit_by_larger_variances_as_far_as_the_drives_so_far_allow_it(goal):
    held, dear, free = (
        goal.distances(evidence_of(goal, "step", [0.5, 0.5, 0.2]))[0]
        for goal in (goal, SeparationGoal(opened((0.0, 1e6))), SeparationGoal(opened((0.0, 1.0))))
    )
    np.testing.assert_allclose(dear, held)
    others = ~np.eye(3, dtype=bool)
    assert (free[others] <= held[others] + 2.0 + 1e-9).all()  # no more than another level costs over the drives so far
    assert free[0, 1] < 0.5 * held[0, 1]


def test_a_surrogate_is_what_a_linearisation_says_and_sees_no_larger_variances(goal):
    free = SeparationGoal(opened((0.0, 1.0)))
    held, full, surrogate = (
        g.distances(evidence_of(g, "step", [0.5, 0.5, 0.2], surrogate=s))[0]
        for g, s in ((goal, False), (free, False), (free, True))
    )
    assert full[0, 1] < 0.5 * held[0, 1]
    np.testing.assert_allclose(surrogate[0, 1], held[0, 1], rtol=0.25)
    assert [a.shape[3] for a in free.surrogate(rehearsed(free, "step", [0.5, 0.5, 0.2]))[:3]] == [1, 1, 1]


def test_a_surrogate_is_what_is_known_before_parameters_are_refitted(goal, monkeypatch):
    """Of one level; derivatives of a rival are those over what the first of the others leaves."""
    monkeypatch.setattr(rival_filter, "_REFITS", 0)
    drive, others = rehearsed(goal, "step", [0.5, 0.5, 0.2]), ~np.eye(3, dtype=bool)
    in_full, surrogate = goal.evidence(drive), goal.surrogate(drive)
    np.testing.assert_allclose(surrogate[0][:, others], in_full[0][:, others], rtol=1e-9)
    assert len(np.unique(in_full[0][0, others])) == 6
    for first, rival_ in ((1, 0), (0, 1), (0, 2)):
        np.testing.assert_allclose(surrogate[2][:, first, rival_], in_full[2][:, first, rival_], rtol=1e-9)


def test_of_more_levels_than_lanes_each_is_run():
    trace = opened((0.0,) * 10)
    levels = tuple({s: 1.5**k * v for s, v in trace.drives.levels[0].items()} for k in range(10))
    many = SeparationGoal(replace(trace, drives=replace(trace.drives, levels=levels)))
    squares = evidence_of(many, "step", [0.5, 0.5, 0.2])[0][0, 0, 1]
    assert (np.diff(squares) < 0.0).all()


def test_a_surrogate_orders_drives_as_what_they_tell():
    free = SeparationGoal(opened((0.0, 30.0)))
    points = {
        "step": ([0.1, 0.5, 0.2], [0.5, 0.5, 0.2], [0.5, 0.5, 0.9]), "ramp": ([0.0, 0.0], [0.5, 0.5]),
        "sweep": ([0.0, 0.2, 0.3, 0.5], [0.1, 0.3, 0.3, 0.5], [0.3, 0.3, 0.3, 0.5]), "weave": ([0.3, 0.3, 0.3],),
    }  # fmt: skip
    drives = [rehearsed(free, name, point) for name, of_name in points.items() for point in of_name]
    in_full, surrogate = ([free.value(tell(d)) for d in drives] for tell in (free.evidence, free.surrogate))
    assert np.argmin(in_full) == np.argmin(surrogate)
    assert spearmanr(in_full, surrogate)[0] > 0.9


def test_a_model_that_holds_the_right_one_is_told_from_it_only_by_the_drives_so_far(goal):
    distance, _ = goal.distances(total([(evidence_of(goal, "step", [0.5, 0.5, 0.2]), 100)]))
    assert distance[2, 0] <= (1.0 / 0.3) ** 2 + 1e-6  # a lag of nothing is that many standard errors off
    assert distance[0, 2] > 100.0
    assert math.isinf(goal._emulations[0, 1])


def test_derivatives_are_taken_anew_where_a_step_misses_what_it_promised(goal, monkeypatch):
    counted, derivatives = [], goal.model.sensitivities
    monkeypatch.setattr(goal.model, "sensitivities", lambda *given: counted.append(0) or derivatives(*given))
    distances, counts = [], []
    for enough, renewed in ((rival_filter._ENOUGH, rival_filter._RENEWED), (0.0, 0.0)):
        monkeypatch.setattr(rival_filter, "_ENOUGH", enough)
        monkeypatch.setattr(rival_filter, "_RENEWED", renewed)
        counted.clear()
        distances.append(goal.distances(evidence_of(goal, "sweep", [0.0, 0.2, 0.3, 0.5]))[0])
        counts.append(len(counted))
    np.testing.assert_allclose(*distances, rtol=0.02, atol=0.1)
    assert 6 <= counts[0] < counts[1] <= 18


def test_a_model_says_as_much_of_its_parameters_over_what_it_leaves_itself(goal):
    drive = rehearsed(goal, "ramp", [0.5, 0.5])
    evidence = goal.evidence(drive)
    for j, own in enumerate(goal.filters):
        n = len(own.coordinates)
        whole, *_ = own.over(goal.model, drive.data[j])
        assert whole.squares[0] == pytest.approx(0.0, abs=1e-6)
        growths = (separation._growth(f, own.so_far.information[0]) for f in (
            evidence[2][0, j, j, 0, :n, :n], whole.information[0]))  # fmt: skip
        assert next(growths) == pytest.approx(next(growths), rel=0.01)


def test_fewer_sensors_tell_less_of_the_same_drive(goal, tmp_path):
    drive = [0.5, 0.5, 0.2]
    (tmp_path / "nominal.toml").write_text(set_text(goal.model.spec, "test", {}))
    fewer = replace(goal.model.spec, parameters=str(tmp_path / "nominal.toml"))
    fewer = SeparationGoal(replace(goal.trace, spec=fewer)).measured_by("yaw_rate")
    less, more = (g.distances(evidence_of(g, "step", drive))[0] for g in (fewer, goal))
    assert tuple(fewer.model.spec.model().outputs) == ("yaw_rate",)
    assert 0.0 < less[0, 1] < more[0, 1]


def test_what_stays_open_is_said(goal):
    expectation = goal.expectation(evidence_of(goal, "ramp", [0.0, 0.0]))
    assert any("inertia" in text and "confusable" in text for text in expectation.open)
    assert any("none of these" in text for text in expectation.open)
    assert expectation.record["models"]["lag"]["share"] == pytest.approx(0.5)


def test_the_drives_of_a_trace_are_planned_and_written(goal, tmp_path):
    spec = goal.model.spec
    models = [
        {
            "added": [[{"name": name, "kind": "effect"}]] if name else [],
            "share": r.share,
            "estimates": [
                {"name": n, "value": v, "standard_error": e}
                for (n, v), e in zip(r.values.items(), r.errors, strict=True)
            ],
            "correlation": r.correlation.tolist(),
            "measurement_noise": r.measurement_noise,
            "at_levels": [
                {
                    "log_posterior": v.log_posterior,
                    "gradient": v.gradient.tolist(),
                    "information": v.information.tolist(),
                }
                for v in r.at_levels
            ],
        }
        for r, name in zip(goal.rivals, ["steering_lag", "yaw_inertia", ""], strict=True)
    ]
    outputs = {name: {} for name in spec.model().outputs}
    noise = {"levels": [dict(spec.process_noise)], "fitted_seconds": 80.0, "held_out_seconds": 40.0}
    confusable = {"models": models, "noise": noise}
    content = {"confusable": confusable, "posterior": {"none_of_these": 0.0}, "error": outputs}
    (tmp_path / "trace.json").write_text(json.dumps(content))
    (tmp_path / "nominal.toml").write_text(set_text(spec, "test", {}))
    task = DesignTask(tmp_path, limits=Limits(lateral_acceleration=4.0), manoeuvres=("step", "ramp"), effort=6, jobs=1)
    designed = design_drives(task)
    assert designed.plan.ranked[0].manoeuvre.name == "step"
    ((tried, times),) = designed.plan.sequence
    assert tried.rehearsed.seconds >= 21.0  # a trace takes no recording below 20 s, and recorders begin late
    assert times % 2 == 0  # as many judge as are fitted
    record = json.loads(contents(designed)["next_drive.json"])
    assert record["criterion"] == "T"
    assert list(record["expected"]["models"]) == ["steering lag", "yaw inertia", "nothing added"]
    with pytest.raises(UserError, match="of an identification"):
        design_drives(replace(task, criterion="A"))
    with pytest.raises(UserError, match="too calm to be judged; widen lateral_acceleration"):
        design_drives(replace(task, limits=Limits(lateral_acceleration=0.01)))
    for room in ({"budget": 30.0}, {"limits": Limits(duration=10.0)}):
        with pytest.raises(UserError, match="last 21 s at least, each is driven 2 times"):
            design_drives(replace(task, **room))


BASELINE = ["road_bank_varying", "steering_lag", "sensor_bias@yaw_rate"]
LEARNT = {"bank_memory": 10.0, "bank_wander": 3e-3, "steering_lag": 0.02, "sensor_bias_yaw_rate": 0.01}


def behind_a_baseline(**process):
    """Return a goal whose nominal model holds what a baseline has learnt, and a rival with the bias of a second sensor.

    Args:
        process: Variances of its states that the trace states at each level in addition to those of the vehicle.
    """
    plain = opened((0.0, 1.0))
    spec = resolve_single({**CAR, "effects": BASELINE, "values": LEARNT}, "test")
    rivals = list(plain.rivals)
    rivals[2] = rival(plain.spec, "bias", 0.2, costs=(0.0, 1.0), sensor_bias_lateral_acceleration=0.2)
    levels = tuple({**level, **process} for level in plain.drives.levels)
    return SeparationGoal(replace(plain, spec=spec, rivals=tuple(rivals), drives=replace(plain.drives, levels=levels)))


def test_what_a_baseline_has_learnt_is_held_and_more_of_its_kind_can_come():
    goal = behind_a_baseline()
    assert goal.model.spec.effects == ()
    for rival_, values in zip(goal.rivals, goal.versions, strict=True):
        stated = dict(zip(goal.model.names, values, strict=True))
        assert {n: stated[n] for n in LEARNT} == {n: rival_.values.get(n, v) for n, v in LEARNT.items()}
    assert goal.versions[2][goal.model.row("sensor_bias_lateral_acceleration")] == 0.2


def test_an_effect_that_acts_everywhere_is_held_too_and_one_that_cannot_be_is_refused():
    lengths = {"tyre_relaxation_front": 0.5, "tyre_relaxation_rear": 0.4}
    spec = resolve_single({**CAR, "effects": ["tyre_relaxation"], "values": lengths}, "test")
    assert SeparationGoal(replace(opened(), spec=spec)).model.spec.effects == ()
    drifting = resolve_single({**CAR, "effects": ["sensor_drift@lateral_acceleration"]}, "test")
    with pytest.raises(UserError, match="drives cannot be planned with 'sensor_drift_lateral_acceleration'"):
        SeparationGoal(replace(opened(), spec=drifting))


def test_random_processes_of_the_model_keep_their_noise_at_every_level():
    """The levels are those of the process noise of the vehicle."""
    goal = behind_a_baseline()
    for points in (f.points for f in goal.filters):
        first, second = (goal.model.process_variances(p) for p in points)
        at = len(goal.model.nominal.states)
        np.testing.assert_allclose(second[:at], 100.0 * first[:at])
        np.testing.assert_array_equal(second[at:], first[at:])
        assert len(first) > at


def test_effects_whose_states_the_trace_corrects_stay_in_the_model():
    assert behind_a_baseline(steering_lagged=1e-9).model.spec.effects == ("steering_lag",)


def test_what_is_alike_in_a_model_becomes_a_rival_of_its_own(tmp_path):
    """A delay of 1.5 times the lag does the same over the drives so far, whose shape 'extra' goes with the lag."""
    model = {
        "added": [[{"name": "steering_lag", "kind": "effect"}, {"name": "steering_delay", "kind": "effect"}]],
        "alike": [{"instead_of": "steering_lag", "parameters": ["steering_lag", "extra"], "name": "steering_delay",
                   "kind": "effect", "amplitude": "steering_delay", "value": 0.03, "ratio": 1.5, "share": 0.25}],
        "share": 0.8,
        "estimates": [{"name": n, "value": v, "standard_error": e}
                      for n, v, e in (("mass", 1500.0, 10.0), ("steering_lag", 0.02, 0.001), ("extra", 3.0, 1.0))],
        "correlation": [[1.0, 0.5, 0.0], [0.5, 1.0, 0.2], [0.0, 0.2, 1.0]],
        "measurement_noise": {},
        "at_levels": [{"log_posterior": -1.0, "gradient": [0.0, 6.0, 1.0],
                       "information": [[1.0, 3.0, 0.0], [3.0, 9.0, 0.1], [0.0, 0.1, 1.0]]}],
    }  # fmt: skip
    noise = {"levels": [{}], "fitted_seconds": 80.0, "held_out_seconds": 40.0}
    confusable = {"models": [model], "noise": noise}
    content = {"confusable": confusable, "posterior": {"none_of_these": 0.0}, "error": {"yaw_rate": {}}}
    (tmp_path / "trace.json").write_text(json.dumps(content))
    (tmp_path / "nominal.toml").write_text(set_text(resolve_single(CAR, "test"), "test", {}))
    lag, delay = read_trace(tmp_path).rivals
    assert (lag.name, lag.share, delay.name, delay.share) == (
        "steering lag", pytest.approx(0.6), "steering delay", pytest.approx(0.2)
    )  # fmt: skip
    assert delay.added == [{"name": "steering_delay", "kind": "effect"}]
    assert delay.values == {"mass": 1500.0, "steering_delay": pytest.approx(0.03)}
    np.testing.assert_allclose(delay.errors, [10.0, 0.0015])
    np.testing.assert_allclose(delay.correlation, [[1.0, 0.5], [0.5, 1.0]])
    np.testing.assert_allclose(delay.at_levels[0].information, [[1.0, 2.0], [2.0, 4.0]])
    np.testing.assert_allclose(delay.at_levels[0].gradient, [0.0, 4.0])
    model["alike"][0] |= {"name": "mass", "kind": "parameter", "amplitude": "mass", "value": 1400.0, "ratio": -5e3}
    (tmp_path / "trace.json").write_text(json.dumps(content))
    mass = read_trace(tmp_path).rivals[1]  # is free already, as all stated values are behind a baseline
    assert mass.values == {"mass": pytest.approx(1400.0)}
    np.testing.assert_allclose(mass.errors, [5.0])  # kg
    model["added"].append([{"name": "roll_steer@front", "kind": "effect"}])
    (tmp_path / "trace.json").write_text(json.dumps(content))
    assert [r.name for r in read_trace(tmp_path).rivals] == ["steering lag", "mass"]  # not what both have
    assert [len(r.added) for r in read_trace(tmp_path).rivals] == [2, 2]


def test_a_trace_that_left_one_model_or_none_with_estimates_is_refused(tmp_path):
    model = {"added": [], "share": 1.0, "estimates": [], "correlation": [], "measurement_noise": {}, "at_levels": []}
    noise = {"levels": [], "fitted_seconds": 80.0, "held_out_seconds": 40.0}
    confusable = {"models": [model], "noise": noise}
    content = {"confusable": confusable, "posterior": {"none_of_these": 0.0}, "error": {"yaw_rate": {}}}
    (tmp_path / "trace.json").write_text(json.dumps(content))
    with pytest.raises(UserError, match="left one model, nothing added"):
        read_trace(tmp_path)
    del model["at_levels"]
    (tmp_path / "trace.json").write_text(json.dumps(content))
    with pytest.raises(UserError, match="run harness trace again"):
        read_trace(tmp_path)
