"""Timing of single steps: the timed code estimates what the scored code does, and what the numbers say."""

import json
import time
from pathlib import Path

import numpy as np
import pytest
import xarray as xr
from typer.testing import CliRunner

from harness.cli import main as cli
from harness.common.errors import UserError
from harness.config import load_study
from harness.engine.compile import in_one_lane, load_source
from harness.engine.simd.lanes import LANES
from harness.engine.simd.random import generator_words
from harness.estimation.compiled_estimator import CompiledEstimator
from harness.realtime.measure import Contestant, contestants, measure
from harness.realtime.outcome import PACES, QUANTILES, _ratios, judge, published_ratio, read, write
from harness.realtime.report import answer, report
from harness.simulation.simulate import in_lanes
from harness.testing.small_models import compiled_linear

ROOT = Path(__file__).parents[2]
SPIN = """
from numba import njit
from harness.engine.clock import nanoseconds
@njit
def spin(duration):
    begin = nanoseconds()
    while nanoseconds() - begin < duration:
        pass
    return nanoseconds() - begin
"""

DRAW = """
from numba import njit
from harness.engine.simd.lanes import LANES, get, put
from harness.engine.simd.random import gather
from harness.engine.simd.random import next_words, normal_pair
@njit(error_model="numpy")
def draw(memory, table, drawn):
    s0, s1 = get(memory, 0), get(memory, 1)
    for k in range(drawn.shape[0]):
        word, s0, s1 = next_words(s0, s1)
        first, _ = normal_pair(word)
        put(first + gather(table, get(table, 0, 0), 1), drawn, k)
"""


@pytest.fixture(scope="module")
def study():
    return load_study(ROOT / "studies" / "kalman-lecture.toml")


@pytest.fixture(scope="module")
def outcome(study):
    field = contestants(study, "step", 40.0)
    return judge(measure(field, 41, 0.01), study, "step")  # faster than the study's second per step


@pytest.mark.parametrize("kind", ["ekf", "ukf"])
def test_one_lane_estimates_what_eight_do(kind):
    compiled, samples = compiled_linear(), 30
    estimator, rng = CompiledEstimator(kind, compiled), np.random.default_rng(3)
    u, y = rng.normal(size=(samples, 1, LANES)), rng.normal(size=(samples, 2, LANES))
    y[7] = np.nan
    belief = estimator.belief(
        compiled.constants(in_lanes(np.array([1.5]))), in_lanes(np.full(3, 1e-2)), in_lanes(np.full(2, 0.1))
    )
    seeds = np.random.SeedSequence(4).spawn(LANES)
    state = first = estimator.init(np.zeros(3), np.ones(3), seeds)
    contestant = Contestant(kind, compiled, belief, first, u, y)
    assert np.all(contestant.run(1, 5) > 0)
    assert contestant.run(5, 6).shape == (1,)  # one step and several, an odd and an even number of them
    contestant.run(6, samples)
    for k in range(1, samples):
        state, _ = estimator.step(state, u[k - 1], u[k], y[k], belief)
    np.testing.assert_allclose(contestant.mean, state.mean[:, 0], rtol=1e-9, atol=1e-12)
    contestant.restart()
    np.testing.assert_array_equal(contestant.mean, first.mean[:, 0])


def test_kernels_for_one_lane_are_as_narrow():
    source = in_one_lane(
        "import numpy as np\nfrom harness.engine.simd.lanes import LANES\n"
        "from harness.engine.simd.functions import sin\n"
    )
    assert "harness.engine" not in source
    assert load_source("test_narrow", source).LANES == 1


def test_random_numbers_and_gathered_ones_are_the_same_in_one_lane():
    memory = generator_words(np.random.SeedSequence(4).spawn(LANES))
    table = np.random.default_rng(2).normal(size=(5, 2, LANES))
    table[0, 0] = np.arange(LANES) % 5
    wide, narrow = np.empty((50, LANES)), np.empty((50, 1))
    load_source("test_draw", DRAW).draw(memory, table, wide)
    one = [np.ascontiguousarray(a[..., 3:4]) for a in (memory, table)]
    load_source("test_draw_one", in_one_lane(DRAW)).draw(*one, narrow)
    np.testing.assert_allclose(narrow[:, 0], wide[:, 3], rtol=1e-6, atol=1e-7)  # normal numbers are made in float32


def test_the_clock_counts_nanoseconds():
    spin = load_source("test_spin", SPIN).spin
    spin(1)
    begin = time.perf_counter_ns()
    inside = spin(20_000_000)
    assert 20_000_000 <= inside <= time.perf_counter_ns() - begin


def test_every_step_is_timed_once_per_pace(outcome):
    assert dict(outcome.sizes) == {"pace": 2, "estimator": 1, "time": 40, "share": 3, "end": 3}
    assert outcome.pace.values.tolist() == list(PACES)
    # A step does more than nothing; a clock that was read out of order would say less.
    assert (outcome.step_time.median("time") > 0).all()
    assert (outcome.clock > 0).all()
    assert outcome.interrupted.dtype == bool


def test_statistics_are_those_of_the_times(outcome):
    times = outcome.step_time.sel(pace="every cycle", estimator="KF").values
    quantile = outcome["quantile"].sel(pace="every cycle", estimator="KF").values
    np.testing.assert_array_equal(quantile, np.quantile(times, QUANTILES))
    assert quantile[2] == times.max()
    assert float(outcome["mean"].sel(pace="every cycle", estimator="KF")) == times.mean()
    assert outcome.attrs["reference"] == "KF"
    np.testing.assert_array_equal(outcome.ratio.sel(estimator="KF"), 1.0)


def test_ratios_are_found_within_their_intervals():
    rng = np.random.default_rng(1)
    machine = np.repeat(rng.uniform(1.0, 1.5, 30), 100)  # what all estimators feel alike
    true = np.array([1.0, 3.4, 0.4])
    values = (true[:, None] * machine * rng.uniform(0.95, 1.05, (3, 3000)))[None]
    values[0, 1, ::500] *= 100  # spikes
    median, low, high = np.moveaxis(_ratios(values, 0, 100, seed=0), -1, 0)[:, 0]
    np.testing.assert_allclose(median, true, rtol=0.02)
    assert np.all((low <= true) & (true <= high))
    assert np.all(high - low < 0.1 * true)


def test_ratios_of_the_dissertation():
    assert published_ratio("ukf", "ekf") == pytest.approx(3.4)
    assert published_ratio("narx", "ekf") == pytest.approx(0.406, abs=5e-4)
    assert published_ratio("particle", "ekf") is None
    assert published_ratio("ekf", "kf") is None


def test_outcome_comes_back_from_its_store(outcome, tmp_path):
    write(outcome, tmp_path)
    write(outcome, tmp_path)  # in place of the older one
    xr.testing.assert_identical(read(tmp_path), outcome)
    next((tmp_path / "times.zarr" / "step_time" / "c").rglob("0")).rename(tmp_path / "lost")
    with pytest.raises(UserError, match=r"times.zarr: step_time/c.* is missing; measure again: 'harness realtime'"):
        read(tmp_path)
    (tmp_path / "file").write_text("")
    with pytest.raises(UserError, match="cannot be written"):
        write(outcome, tmp_path / "file" / "deeper")


@pytest.mark.parametrize(
    ("slowdown", "spike", "words"),
    [
        (1.0, 0.0, "Every estimator fits into the cycle of 10 ms with room to spare"),
        (500.0, 0.0, "Every estimator fits into the cycle of 10 ms on this core"),
        (2000.0, 0.0, "UKF, the slowest, does not fit into the cycle of 10 ms on this core"),
        (1.0, 0.02, "fits into the cycle of 10 ms, but 3 of 120 steps took longer, 1 of them interrupted"),
    ],
)
def test_the_report_answers_with_its_numbers(outcome, slowdown, spike, words, tmp_path):
    steps = outcome.step_time.isel(estimator=0, drop=True) * 0 + 5e-6
    three = {"EKF": (1.0, "ekf"), "UKF": (2.0, "ukf"), "net": (0.5, "narx")}
    times = xr.Dataset(
        {
            "step_time": xr.concat([slowdown * f * steps for f, _ in three.values()], "estimator"),
            "clock": outcome.clock,
            "interrupted": (("estimator", "time"), np.zeros((3, 40), dtype=bool)),
        }
    ).transpose("pace", "estimator", "time")
    times = times.assign_coords(estimator=np.array(list(three), dtype=object))
    times["step_time"][1, :, 7] += spike  # once per cycle, at the eighth step of all
    times["interrupted"][0, 7] = True
    study = _with_estimators(three)
    found = judge(times, study, "step")
    assert words in answer(found)
    html = report(found).write(tmp_path)[0].read_text()
    assert "UKF takes 2.00 (2.00 to 2.00) times as long as EKF without a pause" in html
    assert "where the dissertation has 3.40" in html
    assert "net takes 0.50" in html
    assert json.loads(found.attrs["kinds"]) == {name: kind for name, (_, kind) in three.items()}


def _with_estimators(three):
    import dataclasses

    from harness.config import EstimatorSpec

    study = load_study(ROOT / "studies" / "kalman-lecture.toml")
    belief = dataclasses.replace(study.belief, step=0.01)
    return dataclasses.replace(
        study, belief=belief, estimators=tuple(EstimatorSpec(name, kind, {}) for name, (_, kind) in three.items())
    )


def test_what_cannot_be_timed_is_refused(study):
    with pytest.raises(UserError, match=r"no such drive; closest: step"):
        contestants(study, "stop", 10.0)
    for duration in (0.2, 61.0):
        with pytest.raises(UserError, match=r"at least one step of 1 s and no more than the 60 s of drive 'step'"):
            contestants(study, "step", duration)


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ("nan", "--duration: nan is not a finite number"),
        ("1,5", "--duration: '1,5' may mean '1.5' or '15'"),
        ("-3 s", "--duration: '-3 s' must be above zero"),
        ("3 m", "--duration: '3 m' does not fit"),
        ("soon", "--duration: 'soon' is not a number with a unit; write e.g. '80 s'"),
    ],
)
def test_a_duration_that_is_none_is_one_line(given, message):
    result = CliRunner().invoke(cli.app, ["realtime", "kalman-lecture", f"--duration={given}"])
    assert result.exit_code == 2
    assert message in result.output


def test_an_estimator_that_diverges_is_not_timed():
    compiled = compiled_linear()
    estimator = CompiledEstimator("ekf", compiled)
    belief = estimator.belief(
        compiled.constants(in_lanes(np.array([1.5]))), in_lanes(np.full(3, 1e-2)), in_lanes(np.full(2, 0.1))
    )
    lost = estimator.init(np.full(3, np.nan), np.ones(3))
    contestant = Contestant("ekf", compiled, belief, lost, np.zeros((5, 1, LANES)), np.zeros((5, 2, LANES)))
    with pytest.raises(UserError, match="'EKF' diverges"):
        measure({"EKF": contestant}, 5, 0.001)


def test_command_writes_report_and_store(tmp_path, monkeypatch):
    monkeypatch.setattr("harness.realtime.measure.time.sleep", lambda _: None)
    study, out = ROOT / "studies" / "kalman-lecture.toml", tmp_path / "times"
    result = CliRunner().invoke(cli.app, ["realtime", str(study), "--duration", "20 s", "--out", str(out)])
    assert result.exit_code == 0, result.output
    assert "fits into the cycle of 1000 ms" in result.stdout
    assert sorted(p.name for p in out.iterdir()) == ["report.html", "report.pdf", "times.zarr"]
    assert CliRunner().invoke(cli.app, ["realtime", str(study), "--drive", "stop"]).exit_code == 2
