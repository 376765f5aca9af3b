"""Numbers of ``harness check`` of which the answer is known by hand."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
import xarray as xr

from harness.recordings.check import check_report, responses
from harness.recordings.check.calibration import _SPREADS, _CauseEvidence, _Option
from harness.recordings.check.causes import DELAY, DRIFT, OFFSET, SCALE, SIGN, Cause, RecordingFault, corrected
from harness.recordings.check.examine import _findings
from harness.recordings.check.explain import _NEAR, FaultHypothesis, _misfit, _shared
from harness.recordings.motion import pose
from harness.recordings.motion.consistency import Origin, SmoothedSignals, compare
from harness.recordings.motion.pair_fit import Agreement, _memory, long_run
from harness.recordings.motion.redundancy import RELATIONS
from support.weaving_car import STEP, TIME, drive


@pytest.mark.parametrize("step", [0.1, 0.05])
def test_the_excerpt_is_thirty_seconds_of_the_liveliest(step):
    """Stretches begin every 7.5 s; of those that hold all that moves, from 40 to 52 s, the first is taken."""
    time = np.arange(0, 100, step)
    fit = SimpleNamespace(step=step, computed=np.where((time > 40) & (time < 52), np.sin(5 * time), 0.0))
    rows = check_report._liveliest(fit)
    assert (rows.start * step, rows.stop * step) == pytest.approx((22.5, 52.5))
    assert check_report._liveliest(SimpleNamespace(step=step, computed=fit.computed[:200])) == slice(0, 200)


def test_the_last_of_several_panels_has_the_label_of_the_time(monkeypatch):
    drawn, wave = [], np.sin(TIME)
    monkeypatch.setattr(check_report.style, "svg", lambda figure: drawn.append(figure) or b"")
    signals = dict.fromkeys(("yaw_rate", "heading", "speed"), ("time", wave))
    check_report.signal_figures(xr.Dataset(signals, {"time": TIME}))
    exact = [relation for relation in RELATIONS if relation.exact][:3]
    check_report.comparison_figures([Agreement(r, "agrees", (), len(wave), wave, wave, STEP) for r in exact])
    assert [[axes.get_xlabel() for axes in figure.axes] for figure in drawn] == 2 * [["", "", "time in s"]]


@pytest.mark.parametrize("every", [1, 4])
@pytest.mark.parametrize("size", [0.1, 3.0])
def test_a_wave_of_eight_samples_leaves_its_second_difference_open(every, size):
    """The middle of its neighbours misses a wave by the share 1 - cos(2 pi / 8), whatever its size."""
    relation = next(r for r in RELATIONS if r.signal == "yaw_rate" and r.exact)
    wave = size * np.sin(np.arange(32 * 8 * every) * 2 * np.pi / (8 * every) + 0.1)
    step = 0.01
    smoothed = SmoothedSignals({"yaw_rate": wave}, step, {"yaw_rate": Origin(rate=1 / (every * step))})
    share = (1 - np.cos(2 * np.pi / 8)) ** 2
    assert smoothed.unresolved(replace(relation, bank=0.0)) == pytest.approx(share, rel=1e-2)
    assert smoothed.unresolved(replace(relation, bank=2 * size)) == pytest.approx(
        np.hypot(share, 2 * np.sqrt(2)), rel=1e-2
    )


@pytest.mark.parametrize(("independent", "factor"), [(100.0, 1.0), (25.0, 1.3)])
def test_a_slope_costs_what_noise_of_either_side_does_not_explain(independent, factor):
    """A slope of 2 with a correlation of 0.8: within ln 1/0.764 of it (Frisch 1934, error (1 - 0.8^2) / 10)."""
    relation = next(r for r in RELATIONS if r.through_zero and r.or_slope is None)
    relation = replace(relation, slope=(1.0, factor))
    computed, noise = np.tile([5.0, 5.0, -5.0, -5.0], 100), np.tile([5.0, -5.0, 5.0, -5.0], 100)
    share, cost, floor = _shared(relation, 1.6 * computed + 1.2 * noise, computed, independent)
    assert share == pytest.approx(0.2)
    open_by_noise = -np.log(0.8 - 0.36 / np.sqrt(independent))
    assert cost == pytest.approx(((np.log(2) - open_by_noise) / np.log(factor * _NEAR)) ** 2 / 2)
    assert floor > relation.misfit**2 / 2
    exact = _shared(relation, 1.2 * computed, computed, independent)
    assert exact[:2] == pytest.approx((0.0, (np.log(1.2) / np.log(factor * _NEAR)) ** 2 / 2))


def test_an_offset_tells_of_a_relation_that_is_exact_only():
    signals = drive(TIME)
    time = signals.pop("time")
    noise = np.random.default_rng(1).normal(scale=0.02, size=(len(signals), len(time)))
    smoothed = SmoothedSignals({n: v + e for (n, v), e in zip(signals.items(), noise, strict=True)}, STEP)
    kinds = set()
    for fit in (compare(r, smoothed) for r in RELATIONS if set(r.signals) <= set(signals) and not r.circular):
        if responses.tells(fit):
            relation, channels = fit.relation, [(name,) for name in fit.relation.signals]
            kinds.add((relation.exact, relation.through_zero))
            a, b = (responses.response(replace(fit, offset=o), smoothed, channels, False).value for o in (0.0, 5.0))
            moves = np.abs(a - b).max() > 1e-6 * np.abs(a).max()
            assert moves == (relation.exact and not relation.through_zero), relation.formula
            drifting = [responses.response(fit, smoothed, channels, drifts).design for drifts in (False, True)]
            assert [bool(d[:, responses.KINDS.index(DRIFT)].any()) for d in drifting] == [False, relation.exact]
    assert kinds >= {(True, False), (False, False), (True, True)}


@pytest.mark.parametrize(("turned", "unknown"), [(10.4, False), (10.6, True), (-10.4, False), (-10.6, True)])
def test_a_turn_of_which_the_rate_leaves_a_quarter_open_is_unknown(turned, unknown):
    """0.15 of it may be off: pi / 2 of 10.47 rad."""
    time = np.concatenate([np.arange(0, 10, 0.1), np.arange(20, 30, 0.1)])
    heading = np.where(time < 10, time, 0.0)
    rate = np.arange(0, 30, 0.1), np.full(300, turned / (20 - 9.9))
    values, gaps = pose.continued(time, heading, [(9.9, 20.0)], rate)
    assert gaps == ([(9.9, 20.0)] if unknown else [])
    turns = (values[time >= 20] - heading[time >= 20]) / (2 * np.pi)
    np.testing.assert_allclose(turns, np.round((turned + heading[99]) / (2 * np.pi)), atol=1e-9)


@pytest.mark.parametrize(("aside", "determined"), [(2, True), (3, False)])
def test_nine_of_ten_samples_along_the_heading_determine_the_course(monkeypatch, aside, determined):
    along = np.array([-2.0] * 6 + [0.0] * aside + [2.0] * (14 - aside))
    monkeypatch.setattr(pose, "_velocity", lambda signals, step: (along, np.where(along == 0.0, 2.0, 0.0)))
    signals = dict.fromkeys(pose.NEEDS, along) | {"speed": np.full(20, 2.0)}
    assert pose.unsigned_stretches(signals, 0.5) == ({"speed": [(0.0, 3.0)]} if determined else {})


PLANTED = {
    SCALE: lambda time: 1.1 * np.sin(time),
    OFFSET: lambda time: np.sin(time) + 0.1,
    DELAY: lambda time: np.sin(time - 0.1),
    DRIFT: lambda time: np.sin(time - 0.1 * (time - time.mean()) / np.ptp(time)),
}


@pytest.mark.parametrize("kind", PLANTED)
def test_what_a_cause_explains_is_taken_out(kind):
    time = np.arange(0, 40, STEP)
    recorded = {"yaw_rate": PLANTED[kind](time), "speed": np.sin(time)}
    without = corrected([Cause(kind, ("yaw_rate",), 0.1, 0.0, 0.0, 1.0)], SmoothedSignals(recorded, STEP)).signals
    np.testing.assert_allclose(without["yaw_rate"][50:-50], np.sin(time[50:-50]), atol=2e-4)
    assert without["speed"] is recorded["speed"]


@pytest.mark.parametrize(("sign", "value"), [(0, 0.7), (1, 0.7), (1, -0.7), (-1, 0.7)])
def test_a_single_cause_is_as_probable_as_bayes_says(sign, value):
    """One comparison of variance 0.04 with one cause of size 1: normal spreads are averaged, cut on a wrong side."""
    design = np.zeros((1, len(responses.KINDS), 1))
    design[0, responses.KINDS.index(SCALE)] = 1.0
    response = responses.Response(np.array([value]), design, np.array([[0.04]]), np.array([[0.04]]))
    evidence = _CauseEvidence([response], [_Option(SCALE, (0,), ("yaw_rate",), 0.3, 1.0, sign)])
    scores = evidence._weighed()
    step = 1e-4
    size = np.arange(-8, 8, step) + step / 2
    likely = 0.0
    for spread in _SPREADS:
        prior = np.exp(-(size**2) / 2 / spread**2) / spread / np.sqrt(2 * np.pi)
        prior = prior if sign == 0 else 2 * prior * (sign * size > 0)
        likely += step * (prior * np.exp(-((value - size) ** 2) / 2 / 0.04 + value**2 / 2 / 0.04)).sum() / len(_SPREADS)
    odds = sum(np.exp(score - scores[()]) for chosen, score in scores.items() if chosen)
    assert odds == pytest.approx(0.3 / 0.7 * likely, rel=1e-6)


@pytest.mark.parametrize(("samples", "independent"), [(100, 6), (240, 12), (900, 30)])
def test_sides_that_are_alike_are_as_likely_as_their_independent_samples_say(samples, independent):
    """Every 0.1 s; after 2 s samples are independent, and 6 to 30 of them count."""
    relation = next(r for r in RELATIONS if r.through_zero and r.or_slope is None)
    relation = replace(relation, slope=(1.0, 1.0), arm=None, late=None, compute=lambda view: view.rate("", 0))
    wave = 5.0 * np.sin(0.7 * np.arange(samples))
    view = SimpleNamespace(rate=lambda name, order: wave, spacing=lambda name: 0.1)
    found = _misfit(relation, view)
    _, _, floor = _shared(relation, wave, wave, independent)
    assert found.share == pytest.approx(0.0, abs=1e-12)
    assert found.likelihood == pytest.approx(-independent / 2 * np.log(floor / (1 + floor)))
    assert found.at_best == pytest.approx(-independent / 2 * np.log(relation.misfit**2 / 2))


@pytest.mark.parametrize("memory", [0.0, 0.5, 0.95])
@pytest.mark.parametrize("size", [0.1, 10.0])
def test_the_memory_of_samples_is_that_of_a_process_of_first_order(memory, size):
    """Bandwidth of Andrews (1991), equations 6.2 and 6.4; the variance of the sum is that of the process."""
    noise = np.random.default_rng(3).normal(size=(200_000, 1)) * size
    values = np.zeros_like(noise)
    for k in range(1, len(values)):
        values[k] = memory * values[k - 1] + noise[k]
    expected = 1.1447 * (4 * memory**2 / (1 - memory**2) ** 2 * len(values)) ** (1 / 3)
    assert _memory(values) == pytest.approx(expected, rel=0.03, abs=5)
    assert long_run(values, 0)[0, 0] == pytest.approx(len(values) * (size / (1 - memory)) ** 2, rel=0.2)


def test_a_fault_is_as_sure_as_all_hypotheses_that_have_it():
    yaw, speed = (RecordingFault(SIGN, (name,), -1.0, 0.0, 0.0, "") for name in ("yaw_rate", "speed"))
    sets = {(yaw,): 0.5, (yaw, speed): 0.1, (speed,): 0.25, (): 0.15}
    hypotheses = [FaultHypothesis(faults, posterior) for faults, posterior in sets.items()]
    (found,) = _findings([], hypotheses, [], [], [])
    assert found.signals == ("yaw_rate",)
    assert ", 60% sure; or " in found.words
    assert "speed" in found.words
    assert found.words.endswith("nothing of the catalogue; not mended")  # less than two thirds
    (alone,) = _findings([], hypotheses[:2], [], [], [])
    assert "sure" not in alone.words
