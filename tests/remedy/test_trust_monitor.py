"""The trust monitor on known answers: a known bias, white noise, missing measurements, an envelope."""

import numpy as np
import pytest
from scipy.linalg import solve_discrete_are
from scipy.stats import norm

from harness.engine.simd.lanes import LANES
from harness.estimation.compiled_estimator import CompiledEstimator
from harness.remedy.monitor.bounds import calibrated, independent, peaks
from harness.remedy.monitor.counts import area, counted, per_hour, roc
from harness.remedy.monitor.report import per_second
from harness.remedy.monitor.runs import WatchedRun
from harness.runner.contract import Held, InputSeries
from harness.runner.monitor import Watching, bounds_of
from harness.testing.small_models import P0, STEP, Q, R, compiled_linear, drive_linear

WINDOW, SAMPLES, BEGUN = 100, 1500, 500
WEIGHT = 2.0 / (WINDOW + 1.0)
SPREAD = np.sqrt((2.0 - WEIGHT) / WEIGHT)
WIDE = np.full(2 + 2 + 1, np.inf)


@pytest.fixture(scope="module")
def kf():
    return CompiledEstimator("kf", compiled_linear())


def drives(seed, bias=0.0):
    """Return inputs and measurements of eight runs, the second measurement off by a bias from a sample on."""
    rng = np.random.default_rng(seed)
    _, _, A, B, C = drive_linear(2)
    u = np.repeat(np.sin(0.7 * STEP * np.arange(SAMPLES))[:, None, None], LANES, axis=2)
    x, y = np.zeros((3, LANES)), np.empty((SAMPLES, 2, LANES))
    for k in range(SAMPLES):
        y[k] = C @ x + rng.normal(size=(2, LANES)) * np.sqrt(R)[:, None]
        x = A @ x + B @ u[k] + rng.normal(size=(3, LANES)) * np.sqrt(Q)[:, None]
    y[BEGUN:, 1] += bias
    return u, y


def watched(kf, u, y, bounds=None):
    held = Held(*(np.repeat(v[:, None], LANES, axis=1) for v in (np.array([1.5]), Q, R, np.zeros(3), P0)))
    default = bounds_of(WINDOW, (-4.0, 4.0), [4.0, 4.0], 0.4, -WIDE, WIDE)
    return kf.run(InputSeries(u), y, held, Watching(bounds or default))


def mean_behind(bias, samples):
    """Return the mean of the statistics of both innovations behind a bias of the second, of the stationary filter."""
    _, _, A, _, C = drive_linear(2)
    P = solve_discrete_are(A.T, C.T, np.diag(Q), np.diag(R))
    S = C @ P @ C.T + np.diag(R)
    K = P @ C.T @ np.linalg.inv(S)
    error, average, rows = np.zeros(3), np.zeros(2), []
    for _ in range(samples):
        innovation = np.array([0.0, bias]) - C @ error
        average = average + WEIGHT * (innovation / np.sqrt(np.diag(S)) - average)
        error = A @ (error + K @ innovation)
        rows.append(SPREAD * average)
    return np.array(rows)


def test_where_the_filter_is_right_the_averages_have_their_size(kf):
    runs = [watched(kf, *drives(seed)) for seed in range(6)]
    statistics = np.stack([run.statistics[BEGUN:] for run in runs])
    assert statistics.std(axis=(0, 1, 3)) == pytest.approx([1.0, 1.0, 1.0], abs=0.25)
    assert statistics.mean(axis=(0, 1, 3)) == pytest.approx([0.0, 0.0, 0.0], abs=0.15)


def test_a_known_bias_is_seen_as_late_as_its_size_says(kf):
    bias, bound = 0.8, 4.0
    expected = mean_behind(bias, SAMPLES - BEGUN)
    runs = [watched(kf, *drives(seed, bias)) for seed in range(20, 28)]
    statistics = np.stack([run.statistics[BEGUN:, 1:] for run in runs])
    apart = statistics.mean(axis=(0, 3)) - expected
    assert np.abs(apart).max() < 5.0 / np.sqrt(len(runs) * LANES)
    assert expected[:, 1].max() > bound + 1.0
    late = np.argmax(expected[:, 1] > bound)  # without noise
    soon = np.argmax(expected[:, 1] > bound - 2.0)
    crossed = np.argmax(np.abs(statistics[:, :, 1]) > bound, axis=1)
    assert soon < np.median(crossed) < 1.2 * late
    alarms = np.stack([run.verdicts[:, 1].astype(int) & 4 > 0 for run in runs])
    assert (alarms[:, BEGUN:].argmax(axis=1) <= crossed).all()
    assert alarms[:, BEGUN - 100 : BEGUN].mean() < 0.01


def test_missing_measurements_are_said_and_do_not_move_the_averages(kf):
    u, y = drives(3)
    y[700:] = np.nan
    run = watched(kf, u, y)
    assert (run.verdicts[1, :2] == [[1.0] * LANES, [32.0] * LANES]).all()
    assert (run.verdicts[100:700, 0] == 0.0).mean() > 0.99
    assert (run.statistics[700:] == run.statistics[699]).all()
    late = 700 + int(np.log(0.4) / np.log(1.0 - WEIGHT)) + 1  # the share of samples with measurements falls below 0.4
    assert (run.verdicts[late + 5 :, 1] == 32.0).all()
    assert (run.verdicts[700 : late - 5, 1] == 0.0).all()


def test_beyond_the_envelope_the_level_is_one(kf):
    u, y = drives(4)
    u[800:900] = 3.0
    high = np.array([2.0, 0.5, np.inf, np.inf, np.inf])
    run = watched(kf, u, y, bounds_of(WINDOW, (-9.0, 9.0), [9.0, 9.0], 0.4, -high, high))
    assert (run.verdicts[800:901, 1].astype(int) & 16 > 0).all()
    assert (run.verdicts[800:900, 0] >= 1.0).all()
    assert (run.verdicts[600:800, 0] == 0.0).all()
    assert (run.verdicts[900, 1].astype(int) & 16 > 0).all()  # the input is back, but came at a rate beyond
    assert (run.verdicts[901:, 1].astype(int) & 16 == 0).all()


def white(hours, seed, window, step):
    """Return averages of independent numbers over runs of 100 s."""
    rng = np.random.default_rng(seed)
    weight, count = 2.0 / (window + 1.0), round(100.0 / step)
    spread = np.sqrt((2.0 - weight) / weight)
    runs, at = round(hours * 36), np.zeros(2)
    for _ in range(runs):
        rows = np.empty((count, 2))
        noise = np.column_stack([rng.chisquare(1, count) / np.sqrt(2) - 1 / np.sqrt(2), rng.normal(size=count)])
        for k in range(count):
            at = at + weight * (noise[k] - at)
            rows[k] = spread * at
        yield rows


def run_of(rows, bounds, wrong):
    """Return a run in which statistics were held against bounds."""
    evidence = np.maximum.reduce([rows[:, 0] / bounds[1], rows[:, 0] / bounds[0], np.abs(rows[:, 1]) / bounds[2]])
    verdicts = np.column_stack([np.where(evidence > 1.0, 2.0, 0.0), np.zeros(len(rows)), evidence])
    return WatchedRun(np.full((len(rows), 1), wrong), rows, verdicts, np.empty((len(rows), 0)))


def test_false_alarms_come_as_often_as_is_allowed():
    window, step, allowed = 20, 0.1, 20.0
    limits = calibrated([peaks(rows, window) for rows in white(3.0, 1, window, step)], allowed, 3.0)
    assert limits.alarms == pytest.approx(allowed * limits.hours, rel=0.05)
    bounds = (*limits.nis, limits.bias[0])
    fresh = (run_of(rows, bounds, False) for rows in white(3.0, 2, window, step))
    rate, alarms, hours = per_hour(counted(fresh, 1, 30, window)[0], step)
    assert hours == pytest.approx(3.0)
    assert alarms == pytest.approx(rate.value * hours)
    assert rate.lower < allowed < rate.upper
    # Windows of independent samples as trials alarm more rarely than averages that go on between them.
    nis, bias = independent(window, 1, allowed, step)
    assert bias < limits.bias[0]
    assert nis[0] < 0.0 < nis[1]


def test_what_is_said_and_when_is_counted():
    wrong, alarmed = np.zeros(100, dtype=bool), np.zeros(100, dtype=bool)
    wrong[20:40] = wrong[95:] = True
    alarmed[[10, 12]] = alarmed[35:45] = True
    verdicts = np.column_stack([2.0 * alarmed, np.where(alarmed, 5, 0), np.where(alarmed, 2.0, 0.5)])
    run = WatchedRun(wrong[:, None], np.zeros((100, 2)), verdicts, np.zeros((100, 0)))
    (c,) = counted([run], 1, within=10, window=5)
    assert (c.samples[0], c.wrong[0]) == (100, 25)
    assert c.said[0] == 15  # 25 to 39
    assert c.counted[0] == 20  # of the last five it is not known
    assert c.false[0] == 7
    assert c.alarms[0] == 2
    assert c.delay[0] == 15
    assert c.warned[0] == 5
    assert c.reasons[0].tolist() == [12, 0, 12, 0, 0, 0, 0]
    false, right = roc(c, c)
    assert (false[0], right[0], false[-1], right[-1]) == (1.0, 1.0, 0.0, 0.0)
    at = len(false) // 2
    assert (false[at], right[at]) == (7 / 75, 5 / 25)


def test_the_area_of_two_normal_distributions_is_known():
    rng = np.random.default_rng(0)

    def counts_of(shift, wrong):
        runs = []
        for _ in range(40):
            evidence = np.exp(rng.normal(size=200) + shift)
            verdicts = np.column_stack([np.zeros(200), np.zeros(200), evidence])
            runs.append(WatchedRun(np.full((200, 1), wrong), np.zeros((200, 2)), verdicts, np.zeros((200, 0))))
        return counted(runs, 1, 10, 5)[0]

    seen = area(counts_of(0.0, False), counts_of(1.0, True), seed=1)
    assert seen.value == pytest.approx(norm.cdf(1.0 / np.sqrt(2.0)), abs=0.015)
    assert seen.lower < norm.cdf(1.0 / np.sqrt(2.0)) < seen.upper
    assert seen.lower > 0.5
    nothing = area(counts_of(0.0, False), counts_of(0.0, False), seed=1)
    assert np.isnan(nothing.value)


def test_rates_have_a_unit_of_their_own():
    assert [per_second(unit) for unit in ("m/s", "°/s", "m/s²", "rad", "°", "")] == [
        "m/s²", "°/s²", "m/s³", "rad/s", "°/s", "1/s",
    ]  # fmt: skip
