"""What has changed since a baseline, and the discrepancy that a model is allowed."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.signal import butter, lfilter

from harness.common.errors import UserError
from harness.config import resolve_single
from harness.diagnosis import run
from harness.diagnosis.criteria import PRIORS
from harness.diagnosis.fitting import Fitting, KeptFits, ParameterPoint, block_sums
from harness.diagnosis.model.augmented_model import HeldParameters
from harness.diagnosis.model.hypotheses import (
    ALL_PARAMETERS,
    Hypothesis,
    coordinates,
    hypotheses,
    random_processes,
)
from harness.diagnosis.result.answer import Change
from harness.diagnosis.result.changes import _answer, _instead, _phrase, since
from harness.diagnosis.result.outcome import outcome_of, with_effects
from harness.diagnosis.run import TraceTask, run_trace
from harness.diagnosis.selection.acceptance import strayed
from harness.diagnosis.selection.baseline import about, learnt, of_roads
from harness.diagnosis.selection.earlier_models import EarlierDrives
from harness.diagnosis.selection.forward_selection import first_variances, trace
from harness.diagnosis.selection.model_comparison import log_held
from support.driven_car import CAR, FREE, driven


@pytest.fixture(scope="module")
def baseline(augmented):
    drives = [augmented.drive(driven(i + 40, ["steering_offset"], steering_offset=2e-3), f"day {i}") for i in range(2)]
    return learnt(augmented, drives, FREE, False, lambda _: None, KeptFits())


def searched(augmented, baseline, recordings):
    later = baseline.augmented
    drives = [later.drive(r, f"now {i}") for i, r in enumerate(recordings)]
    known = EarlierDrives(random_processes(augmented))
    found = trace(later, drives[:-1], drives[-1:], of_roads(augmented), earlier=known)
    return since(outcome_of(found), baseline)


def test_what_earlier_drives_showed_is_no_change(augmented, baseline):
    """An offset of the steering that was there before is learnt, and nothing has changed."""
    assert {h.name for h in baseline.added} & {"steering_offset", "tyre_force_offset"}  # the same, straight ahead
    recordings = [driven(i + 50, ["steering_offset"], steering_offset=2e-3) for i in range(2)]
    outcome = searched(augmented, baseline, recordings)
    assert outcome.verdict == "adequate"
    assert outcome.changes == ()


def test_a_change_is_the_difference_with_an_interval_that_holds_it(augmented, baseline):
    """The offset grows by a milliradian; the answer is that, and not the three milliradians that there are."""
    recordings = [driven(i + 60, ["steering_offset"], steering_offset=3e-3) for i in range(2)]
    outcome = searched(augmented, baseline, recordings)
    assert outcome.verdict == "amended"
    (change,) = [c for c in outcome.changes if c.name == "steering_offset"]
    low, high = change.interval
    assert low < 1e-3 < high
    assert high - low < 1e-3
    assert change.std > PRIORS.likeness * abs(change.now - change.before)  # the model is only like the vehicle
    assert "since the baseline" in outcome.answer.lower()
    # The filter whose noise was fitted holds the disturbance, so the written model does.
    for spec in (outcome.nominal, outcome.amended):
        assert "unmodelled_force" in spec.effects
        assert set(spec.model().states) == set(spec.process_noise)
        assert spec.process_noise["unmodelled_force_walk"] > 0


def test_a_baseline_that_predicts_with_values_that_no_vehicle_has_is_cautioned_against(augmented, baseline):
    """Four standard deviations of a fifth are a factor of 2.2; what the fit itself has is believed."""
    names = {c.name for c in baseline.fitted.coordinates}
    assert strayed(baseline.fitted, names) == ""
    at = next(c for c in baseline.fitted.coordinates if c.name == "yaw_inertia")
    values = baseline.fitted.point.values.copy()
    values[list(at.rows)] = at.value(at.centre + 4.0 * at.stated_std)
    far = replace(baseline.fitted, point=replace(baseline.fitted.point, values=values))
    assert strayed(far, names) == "yaw inertia 2.2"
    assert strayed(far, {"mass"}) == ""
    outcome = searched(
        augmented, baseline, [driven(i + 50, ["steering_offset"], steering_offset=2e-3) for i in range(2)]
    )
    assert not any("of the vehicle" in text for text in outcome.cautions)
    doubtful = replace(outcome, baseline=replace(baseline, fitted=far))
    assert any("yaw inertia 2.2" in text for text in doubtful.cautions)


def test_what_happens_in_a_drive_and_stays_may_have_happened_before_it(augmented, baseline):
    """A load that has slid lies elsewhere from the first sample on; the moments of a gust are none of a change."""
    now, at_all = (hypotheses(each, FREE) for each in (baseline.augmented, augmented))
    assert {h.name for h in at_all if h.change_times} >= {"payload_shift", "friction_change", "crosswind"}
    assert not any(h.change_times for h in now)
    assert {h.name for h in now} & {"payload_shift", "friction_change", "crosswind"} == {"payload_shift"}
    row = augmented.row("payload_shift_time")
    assert augmented.stated()[row] == 1e5
    assert baseline.augmented.stated()[row] == 0.0


def test_rivals_of_a_change_are_named_in_words():
    """The model in which many parameters changed is no model of *parameters*."""
    rivals = [Hypothesis(name, "effect", ()) for name in (ALL_PARAMETERS, "axle_compliance_steer@rear")]
    models = [SimpleNamespace(added=[SimpleNamespace(hypotheses=[h])]) for h in rivals]
    posterior = SimpleNamespace(confusable=lambda: models)
    said = _instead(SimpleNamespace(posterior=posterior, trace=SimpleNamespace(added=())))
    assert said.endswith("from many parameters at once and axle compliance steer of rear.")


@pytest.mark.parametrize("conditional", [False, True])
def test_that_nothing_changed_is_not_said_where_it_is_improbable(conditional):
    h, days = Hypothesis("wheel_radius_error", "effect", ()), SimpleNamespace(names=("monday", "tuesday"))
    trace = SimpleNamespace(added=(), cut_short="")
    p, factor = (0.18, 5.0) if conditional else (0.9, 1.0)
    changed = SimpleNamespace(added=[SimpleNamespace(hypotheses=[h])], probability=p)
    same = SimpleNamespace(added=[], probability=0.01)
    claims = SimpleNamespace(given_right=factor, conditional=conditional)

    def said(*confusable, verdict="adequate"):
        posterior = SimpleNamespace(models=[changed, same], confusable=lambda: confusable)
        return _answer(SimpleNamespace(posterior=posterior, trace=trace, claims=claims), days, (), verdict)

    since_then = "since the baseline (monday and tuesday)"
    nothing = f"Nothing has changed {since_then} that these drives can show."
    sure = "9 in 10, if one of these explanations is right" if conditional else "9 in 10"
    assert said(same) == nothing
    assert said(same, changed) == f"{nothing} They do not exclude wheel radius error."
    assert said(changed) == (
        f"{since_then.capitalize()} wheel radius error ({sure}) may have changed, "
        "but less plainly than is asked for a name."
    )
    unnamed = f"Something has changed {since_then} that no hypothesis of the library explains."
    assert said(same, changed, verdict="unresolved") == unnamed
    nearest = f"{unnamed} Nearest comes wheel radius error ({sure}), less plainly than is asked for a name."
    assert said(changed, verdict="unresolved") == nearest


def test_a_change_at_a_bound_of_what_is_possible_is_no_answer():
    h = Hypothesis("lateral_load_transfer@front", "effect", ("lateral_transfer_loss_front",))
    change = Change(h, "lateral_transfer_loss_front", "dimensionless", 0.0, 10.0, 3.0, True)
    outcome = SimpleNamespace(posterior=None, trace=SimpleNamespace(added=(h,), cut_short=""))
    days = SimpleNamespace(names=("monday", "tuesday"))
    said = _answer(outcome, days, (change,), "unresolved")
    assert said.startswith("Something has changed since the baseline (monday and tuesday) that no hypothesis")
    assert "lateral load transfer of front" in said
    assert _answer(outcome, days, (change,), "amended").startswith("Since the baseline (monday and tuesday): lateral")


@pytest.mark.parametrize(
    ("hypothesis", "name", "said"),
    [
        ("tyre_relaxation@front", "tyre_relaxation_front", "tyre relaxation of front 0.30 ± 0.10 m"),
        ("payload_shift", "payload_shift", "payload shift 0.30 ± 0.10 m"),
        ("sensor_gain@speed", "sensor_gain_error_speed", "sensor gain error of speed 0.30 ± 0.10 m"),
        ("steering_lag", "steering_time", "steering lag steering time 0.30 ± 0.10 m"),
    ],
)
def test_a_parameter_that_is_called_like_its_change_is_not_named_twice(hypothesis, name, said):
    h = Hypothesis(hypothesis, "effect", (name,))
    change = Change(h, name, "m", 0.0, 0.3, 0.1, True)
    assert _phrase(h, [change], SimpleNamespace(posterior=None)) == said


def test_one_earlier_drive_is_refused(tmp_path):
    recording = driven(1, duration=25.0)
    task = TraceTask(resolve_single(CAR, "test"), [recording], [recording], FREE, (), baseline=(recording,))
    with pytest.raises(UserError, match="baseline: one recording"):
        run_trace(task, tmp_path, None)


def test_a_vibrating_accelerometer_is_sampled_where_its_noise_is_white_on_all_days(augmented, monkeypatch):
    """The earlier drives choose the spacing, and the later ones are taken at the same; other outputs are whole."""
    vibration = lfilter(*butter(1, (8.0, 13.0), "bandpass", fs=100.0), np.random.default_rng(5).standard_normal(6001))

    def shaken(seed):
        recording = driven(seed)
        shaking = recording.assign(lateral_acceleration=recording["lateral_acceleration"] + vibration)
        return shaking.assign_attrs(name=f"day {seed}")

    seen = {}

    def learnt_from(_, earlier, *rest):
        seen["earlier"] = earlier
        return SimpleNamespace(augmented=augmented)

    def traced(_, fitted, held_out, *rest, **options):
        seen["later"] = [*fitted, *held_out]
        raise UserError("seen")

    monkeypatch.setattr(run, "learnt", learnt_from)
    monkeypatch.setattr(run, "trace", traced)
    days = [shaken(seed) for seed in (1, 2, 3, 4)]
    task = TraceTask(augmented.spec, days[2:3], days[3:], FREE, (), baseline=tuple(days[:2]))
    said = []
    with pytest.raises(UserError, match="seen"):
        run._since(task, augmented, said.append, None, KeptFits())
    column = list(augmented.nominal.outputs).index("lateral_acceleration")
    for drive in (*seen["earlier"], *seen["later"]):
        there = np.isfinite(drive.measurements)
        assert set(np.diff(np.flatnonzero(there[:, column]))) == {np.diff(np.flatnonzero(there[:, column]))[0]}
        assert there[:, column].mean() < 0.5
        assert np.delete(there, column, axis=1).all()
    assert any("lateral acceleration" in text for text in said)


def test_held_parameters_have_the_covariance_of_the_rest_where_one_is_released():
    """Of two estimates with a correlation of 0.8 one alone is known to its own variance, not to the conditional."""
    held = HeldParameters(("a", "b"), np.array([[4.0, 1.6], [1.6, 1.0]]))
    assert held.precision(["a"]) == pytest.approx(np.array([[0.25]]))
    assert held.precision(["a", "b"]) == pytest.approx(np.linalg.inv(held.covariance), rel=1e-6)


def test_the_joint_prior_pulls_a_fit_and_counts_in_its_information(augmented, baseline):
    """Far from what was learnt the penalty is that of the normal density, by its own formula."""
    later = baseline.augmented
    moved = [c for c in coordinates(later, (), (), 1) if c.held]
    assert {c.name for c in moved} == set(later.held.names)
    joint = later.joint_prior(moved)
    stated = later.stated()
    slopes = np.array([c.slope(c.coordinate(stated[c.rows[0]])) for c in moved])
    order = [later.held.names.index(c.name) for c in moved]
    expected = later.held.covariance[np.ix_(order, order)] / np.outer(slopes, slopes)
    deviations = np.sqrt(np.diagonal(np.linalg.pinv(joint, 1e-13, hermitian=True)))
    assert deviations == pytest.approx(np.sqrt(np.diagonal(expected)), rel=0.05)


def test_a_model_that_moves_what_earlier_drives_showed_is_less_likely_beforehand(augmented, baseline):
    """By the normal density of their fit, with the correlations of all; without earlier drives nothing is held."""
    later = baseline.augmented
    moved = coordinates(later, (), (), 1)
    held = [c for c in moved if c.held]
    values = np.repeat(later.stated()[:, None], 1, axis=1)
    point = ParameterPoint(values, np.zeros(0), np.zeros(0))
    fitted = SimpleNamespace(coordinates=moved, point=point)
    assert log_held(later, fitted) == pytest.approx(0.0, abs=1e-9)
    step = np.linspace(-1.0, 1.0, len(held)) * 1e-3
    for c, by in zip(held, step, strict=True):
        values[c.rows[0]] = c.value(c.centre + by)
    expected = -0.5 * step @ later.joint_prior(held) @ step
    assert expected < -1e-6
    assert log_held(later, fitted) == pytest.approx(expected)
    plain = SimpleNamespace(coordinates=coordinates(augmented, FREE, (), 1), point=point)
    assert log_held(augmented, plain) == 0.0


def test_block_sums_put_a_short_rest_into_the_last_block():
    time = np.arange(0.0, 12.0, 1.0)
    assert block_sums(np.ones((12, 1)), time)[:, 0].tolist() == [5.0, 7.0]


def test_what_the_drives_say_nothing_of_is_not_held(augmented):
    """The lag of an effect that is absent has no slope; its prior would be no number."""
    drives = [augmented.drive(driven(i + 80), f"day {i}") for i in range(2)]
    fitting = Fitting(augmented, drives, first_variances(augmented, drives))
    name = "bank_memory"
    moved = (*coordinates(augmented, FREE, (), 2), *coordinates(augmented, (name,), (), 2))
    fitted = fitting.fit(moved, fitting.first(), 4, turns=1)
    held = about(fitting, fitted).held
    assert name not in held.names
    assert set(held.names) == set(FREE)
    assert np.isfinite(held.covariance).all()


def test_an_effect_that_acts_everywhere_stands_for_itself_at_some_places(augmented, baseline):
    """Learnt at the front axle and changed at both: the model has it once."""
    front, both = (Hypothesis(n, "effect", ()) for n in ("tyre_relaxation@front", "tyre_relaxation"))
    trace_of = SimpleNamespace(fitting=baseline.fitting, known=(front,), discrepancy=())
    assert with_effects(trace_of, (both,)).effects == ("tyre_relaxation",)
    assert with_effects(trace_of, ()).effects == ("tyre_relaxation@front",)
    trace_of.known = (both,)
    assert with_effects(trace_of, (front,)).effects == ("tyre_relaxation",)
    assert with_effects(trace_of, (front,)).model()
