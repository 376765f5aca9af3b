"""Degraded sensors: what each degradation does to readings, against numbers worked out otherwise."""

import numpy as np
import pytest
from scipy import stats

from harness.common.errors import ModelError, UserError
from harness.config import build_study, resolve_single
from harness.engine.compile import compile_model
from harness.engine.simd.lanes import LANES
from harness.estimation.compiled_estimator import CompiledEstimator
from harness.models.assembly.assemble import assemble
from harness.models.roles import DEGRADATIONS
from harness.models.signals import MAGNITUDE
from harness.runner.contract import Held
from harness.simulation.degraded_sensors import degrade

STEP, SAMPLES, DEVIATION = 0.01, 4000, 0.05
OUTPUTS = ("yaw_rate", "lateral_acceleration")


def read(effects, values=None, batches=2, seed=1, signal=None):
    """Return readings ``(batches, samples, ny, LANES)`` of degraded sensors, and what they were before."""
    effects = [effects] if isinstance(effects, str) else effects
    model = assemble("car", "linear", effects, ", ".join(OUTPUTS))
    neutral = {p.name: 0.0 if p.neutral is None else p.neutral for p in model.parameters} | (values or {})
    table = np.array([neutral[n] for n in model.parameter_names])
    rng = np.random.default_rng(seed)
    noise = rng.standard_normal((batches, SAMPLES, len(model.states) + len(OUTPUTS), LANES))
    truth = np.zeros(SAMPLES) if signal is None else signal
    measured = truth[:, None, None] + DEVIATION * noise[..., len(model.states) :, :]
    before, variance = measured.copy(), np.full((len(OUTPUTS), LANES), DEVIATION**2)
    held = Held(np.repeat(table[:, None], LANES, axis=1), variance, variance, np.zeros((len(model.states), LANES)))
    degrade(model, measured, held, noise, STEP)
    return measured, before


def runs(readings):
    """Return the readings of the first output, a row per run."""
    return np.moveaxis(readings[:, :, 0], 1, -1).reshape(-1, SAMPLES)


@pytest.mark.parametrize(("share", "length"), [(0.3, 0.0), (0.9, 0.0), (0.2, 0.5)])
def test_the_share_of_missing_readings(share, length):
    degraded, before = read("dropout", {"dropout_share": share, "dropout_length": length}, batches=6)
    missing = np.isnan(runs(degraded))
    burst = max(round(length / STEP), 1)
    deviation = np.sqrt(share * (1 - share) * burst / missing[:, burst:].size)
    assert abs(missing[:, burst:].mean() - share) < 4 * deviation
    begins = missing[:, burst:-burst] & ~missing[:, burst - 1 : -burst - 1]
    rows, columns = np.nonzero(begins)
    assert all(
        missing[row, burst + column : 2 * burst + column].all() for row, column in zip(rows, columns, strict=True)
    )
    assert np.array_equal(runs(degraded)[~missing], runs(before)[~missing])


def test_more_drop_outs_contain_the_fewer():
    few, many = (np.isnan(read("dropout", {"dropout_share": share})[0]) for share in (0.1, 0.4))
    assert (many | ~few).all()


def test_a_slow_sensor_reads_at_its_period_and_phase():
    degraded, before = read("sampling", {"sampling_period": 0.1, "sampling_phase": 0.03})
    there = np.flatnonzero(np.isfinite(runs(degraded)[0]))
    np.testing.assert_array_equal(there, np.arange(3, SAMPLES, 10))
    assert np.array_equal(degraded[:, there], before[:, there])
    uneven = np.flatnonzero(np.isfinite(runs(read("sampling", {"sampling_period": 0.025})[0])[0]))
    assert set(np.diff(uneven)) == {2, 3}


def test_latency_shifts_readings_and_jitter_scatters_them():
    late, before = read("latency", {"latency_delay": 0.05})
    assert np.isnan(late[:, :5]).all()
    assert np.array_equal(late[:, 5:], before[:, :-5])
    scattered, _ = read("latency", {"latency_delay": 0.02, "latency_jitter": 0.1}, signal=1e3 * np.arange(SAMPLES))
    delays = np.arange(SAMPLES) - np.round(runs(scattered) / 1e3)
    delays = delays[np.isfinite(delays)]
    assert (delays.min(), delays.max()) == (2, 12)
    assert delays.mean() == pytest.approx(7.0, abs=0.05)


def test_quantised_and_saturated_readings():
    degraded, before = read("quantisation", {"quantisation_step_yaw_rate": 0.02})
    np.testing.assert_allclose(degraded[:, :, 0], 0.02 * np.round(before[:, :, 0] / 0.02), atol=1e-15)
    assert np.array_equal(degraded[:, :, 1], before[:, :, 1])
    degraded, before = read("saturation", {"saturation_limit_yaw_rate": 0.03})
    assert np.array_equal(degraded[:, :, 0], np.clip(before[:, :, 0], -0.03, 0.03))


def test_outliers_have_their_share_and_size():
    degraded, before = read("outliers", {"outlier_share": 0.05, "outlier_size": 20.0}, batches=6)
    off = (runs(degraded) - runs(before)).ravel()
    assert (off != 0).mean() == pytest.approx(0.05, abs=0.003)
    assert off[off != 0].std() == pytest.approx(20.0 * DEVIATION, rel=0.03)


def test_coloured_noise_has_its_deviation_and_time_constant():
    degraded, before = read("coloured_noise", {"coloured_noise": 2.0, "coloured_noise_time": 0.1}, batches=12)
    process = runs(degraded) - runs(before)
    assert process.std() == pytest.approx(2.0 * DEVIATION, rel=0.03)
    assert np.mean(process[:, 10:] * process[:, :-10]) / process.var() == pytest.approx(np.exp(-1.0), abs=0.03)


@pytest.mark.parametrize("tail", [0.15, 0.25, 0.8])
def test_heavy_tails_are_those_of_students_t(tail):
    degraded, _ = read("heavy_tails", {"noise_tail": tail})
    standardised = runs(degraded)[:, ::4].ravel() / DEVIATION
    assert stats.kstest(standardised, stats.t(1.0 / tail).cdf).pvalue > 1e-3
    assert stats.kstest(standardised, stats.norm.cdf).pvalue < 1e-3


def test_a_common_noise_correlates_sensors():
    degraded, _ = read("common_noise", {"common_noise": 2.0}, batches=4)
    both = np.moveaxis(degraded, 2, 0).reshape(2, -1)
    assert np.corrcoef(both)[0, 1] == pytest.approx(4.0 / 5.0, abs=0.01)
    assert abs(np.corrcoef(np.moveaxis(read([], batches=4)[0], 2, 0).reshape(2, -1))[0, 1]) < 0.01


def test_a_bias_jumps_and_a_sensor_dies():
    degraded, before = read("bias_jump", {"bias_jump_yaw_rate": 0.1, "bias_jump_time": 12.0})
    np.testing.assert_allclose((degraded - before)[:, 1200:, 0], 0.1, atol=1e-12)
    assert np.array_equal(degraded[:, :1200], before[:, :1200])
    lost, before = read("failure", {"failure_time": 12.0})
    assert np.isnan(lost[:, 1200:]).all()
    assert np.array_equal(lost[:, :1200], before[:, :1200])
    stuck, before = read("failure", {"failure_time": 12.0, "failure_sticks": 1.0})
    assert np.array_equal(stuck[:, 1200:], np.broadcast_to(before[:, 1199:1200], stuck[:, 1200:].shape))


def test_bounds_of_what_has_the_unit_of_the_signal_count_its_magnitude():
    model = assemble("car", "linear", ["saturation"], ", ".join(OUTPUTS))
    (limit,) = [p for p in model.parameters if p.name == "saturation_limit_lateral_acceleration"]
    assert limit.unit == "m/s^2"
    assert limit.neutral == limit.upper == 1e4 * MAGNITUDE["m/s^2"]


def test_one_output_alone_and_several_in_the_order_they_are_named():
    degraded, before = read("dropout@yaw_rate", {"dropout_share_yaw_rate": 0.5})
    assert np.isnan(degraded[:, :, 0]).any()
    assert np.array_equal(degraded[:, :, 1], before[:, :, 1])
    values = {"bias_jump_yaw_rate": 0.1, "saturation_limit_yaw_rate": 0.02}
    clipped, _ = read(["bias_jump", "saturation"], values)
    shifted, _ = read(["saturation", "bias_jump"], values)
    assert clipped[:, :, 0].max() == pytest.approx(0.02)
    assert shifted[:, :, 0].max() == pytest.approx(0.12)
    with pytest.raises(ModelError, match="do not measure 'roll_rate'"):
        assemble("car", "linear", ["dropout@roll_rate"], ", ".join(OUTPUTS))
    with pytest.raises(ModelError, match="'bias_jump_yaw_rate', which exists already"):
        assemble("car", "linear", ["bias_jump", "bias_jump@yaw_rate"], ", ".join(OUTPUTS))


def test_readings_of_a_run_are_the_same_however_runs_are_grouped():
    """Random numbers follow from the noise of a run, not from its place."""
    model = assemble("car", "linear", ["dropout", "outliers"], ", ".join(OUTPUTS))
    rng = np.random.default_rng(3)
    noise = rng.standard_normal((3, 500, len(model.states) + 2, LANES))
    values = {p.name: p.neutral or 0.0 for p in model.parameters}
    values |= {"dropout_share": 0.3, "outlier_share": 0.3, "outlier_size": 9.0}
    table = np.repeat(np.array([values[n] for n in model.parameter_names])[:, None], LANES, axis=1)
    variance = np.ones((2, LANES))
    held = Held(table, variance, variance, np.zeros((len(model.states), LANES)))
    together, alone, turned = (
        np.array(part) for part in (noise[..., -2:, :], noise[1][..., -2:, :], noise[1, :, -2:, ::-1])
    )
    degrade(model, together, held, noise, STEP)
    degrade(model, alone, held, noise[1], STEP)
    degrade(model, turned, held, noise[1, ..., ::-1], STEP)
    assert np.array_equal(together[1], alone, equal_nan=True)
    assert np.array_equal(turned[..., ::-1], alone, equal_nan=True)


def test_what_is_no_reading_for_each_sample_is_refused_by_the_file_of_its_own(monkeypatch):
    file = DEGRADATIONS.load("quantisation")
    for wrong, got in ((lambda r: r.values[..., :3, :], r"the shape \(1, 3, "), (lambda r: None, "NoneType")):
        monkeypatch.setattr(file, "degrade", wrong)
        with pytest.raises(UserError, match=rf"quantisation.py: degrade\(readings\) returns {got}"):
            read("quantisation", batches=1)


def test_a_parameter_that_is_not_declared_is_named(monkeypatch):
    monkeypatch.setattr(DEGRADATIONS.load("quantisation"), "degrade", lambda r: r.values * r.p("quantisation_stap"))
    with pytest.raises(UserError, match=r"quantisation.py: reads undeclared parameter .*; closest: quantisation_step"):
        read("quantisation", batches=1)


def test_a_misspelt_degradation_is_told_the_closest_one():
    with pytest.raises(ModelError, match="unknown effect 'quantization'; closest: quantisation"):
        assemble("car", "linear", ["quantization"], ", ".join(OUTPUTS))


# --- in studies

STUDY = {
    "name": "degraded",
    "seed": 3,
    "targets": ["lateral_velocity"],
    "plant": {
        "vehicle": "car", "parameters": "govindarajan_2018", "tyre": "linear", "sensors": "car_series",
        "effects": ["steering_offset", "dropout"], "values": {"dropout_share": 0.2},
    },
    "drive": [{"name": "sine", "kind": "sine", "duration": "5 s", "speed": "15 m/s", "amplitude": "20 deg"}],
    "estimator": [{"name": "EKF", "kind": "ekf"}],
    "design": [{"name": "share", "repeats": 8, "factor": [{"parameter": "dropout_share", "levels": [0.0, 0.5]}]}],
}  # fmt: skip


def test_a_belief_inherits_no_degradation_and_may_not_state_one():
    study = build_study(STUDY, "degraded.toml")
    assert study.plant.model().degradations
    assert study.belief.effects == ("steering_offset",)
    with pytest.raises(UserError, match=r"belief.effects\[0\].*'dropout' degrades the sensors of a plant"):
        build_study(STUDY | {"belief": {"effects": ["dropout"]}}, "degraded.toml")


def test_no_estimator_and_no_identification_believes_in_degraded_sensors():
    spec = resolve_single(STUDY["plant"], "test")
    compiled = compile_model(spec.model(), spec.step)
    with pytest.raises(UserError, match="no estimator believes in it"):
        CompiledEstimator("ekf", compiled)
    with pytest.raises(UserError, match="no estimator believes in it"):
        compile_model(spec.model(), spec.step, duals=True)
