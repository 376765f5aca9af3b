"""A study from file to store: same bits with any number of workers, resuming, refusals, and what scores mean."""

import errno
import io
import json
import shutil
import warnings
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import xarray as xr
import zarr
from rich.console import Console

from harness.common.errors import UserError, WorkError
from harness.reporting.document import Sheet
from harness.runner.contract import Held, InputSeries, Signals
from harness.runner.scores import Scoring
from harness.study.design import Unit
from harness.study.evaluate import StudyEvaluator
from harness.study.report.analysis import Analysis
from harness.study.report.sections import made
from harness.study.results import read
from harness.study.run import histories, run_study
from harness.study.run_noise import Case
from harness.study.score_names import (
    FLAGS,
    OK,
    PENDING,
    PER_RUN,
    PER_TARGET,
)
from harness.study.store import STORE, Store
from support.probe_study import STUDY, bits

pytestmark = pytest.mark.usefixtures("same_checkout")


def test_store_has_the_contracts_dimensions_units_and_provenance(study, finished):
    level = xr.open_zarr(finished / STORE, group="level", consolidated=False)
    assert dict(level.sizes) == {"band": 2, "sample": 1, "drive": 2, "repeat": 5, "estimator": 1, "target": 2}
    assert level.rmse.dims == ("band", "sample", "drive", "repeat", "estimator", "target")
    assert level.target_unit.values.tolist() == ["N", "rad"]
    assert level.band_label.values.tolist() == ["8 t", "24 t"]
    assert (level.status == OK).all()
    for name in (*PER_TARGET, *PER_RUN):
        assert name == "time_of_divergence" or np.isfinite(level[name]).all()
    root = zarr.open_group(str(finished / STORE), mode="r").attrs
    assert root["study"] == STUDY
    assert root["seed"] == 0
    assert root["study_hash"] == study.hash
    assert {"numba", "numpy"} <= json.loads(root["versions"]).keys()
    assert json.loads((finished / "run.json").read_text())["runs"] == 2 * 2 * 5 + 2 * 4


def test_sobol_points_of_a_band_are_salibs(finished):
    from SALib.sample import sobol_sequence

    band = xr.open_zarr(finished / STORE, group="band", consolidated=False)
    expected = 24000 * (0.95 + 0.1 * sobol_sequence.sample(4, 1)[:, 0])
    np.testing.assert_allclose(band.factor_trailer_mass.values[0], expected, rtol=1e-14)


def test_two_workers_write_the_same_bits(study, finished, tmp_path):
    assert bits(run_study(study, tmp_path / "two", jobs=2)) == bits(finished)


def test_an_interrupted_run_is_continued_to_the_same_bits(study, finished, tmp_path, monkeypatch):
    real, seen = StudyEvaluator.evaluate, []

    def interrupted(self, unit):
        if len(seen) == 3:
            raise KeyboardInterrupt
        seen.append(unit)
        return real(self, unit)

    monkeypatch.setattr(StudyEvaluator, "evaluate", interrupted)
    with pytest.raises(KeyboardInterrupt):
        run_study(study, tmp_path / "cut", jobs=1)
    level = xr.open_zarr(tmp_path / "cut" / STORE, group="level", consolidated=False)
    assert (level.status == PENDING).any()
    assert (level.status == OK).any()
    done_before = list(seen)
    seen.clear()
    monkeypatch.setattr(StudyEvaluator, "evaluate", lambda self, unit: seen.append(unit) or real(self, unit))
    run_study(study, tmp_path / "cut", jobs=2)
    assert bits(tmp_path / "cut") == bits(finished)
    assert not set(seen) & set(done_before)


def test_xarray_opens_a_finished_store_whole_and_without_a_warning(finished, copy, study):
    (copy / STORE / "level" / "status" / "c.0.0.1.0.0").unlink()
    shutil.rmtree(copy / STORE / "history")
    run_study(study, copy, jobs=1)
    for folder in (finished, copy):
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            tree = xr.open_datatree(folder / STORE)
        assert {"level", "band", "history"} <= set(tree.children)
        assert set(tree["history"].children) == {"0", "1"}
        assert tree["history"].attrs["runs"] == 2
        assert tree["level/rmse"].dims == ("band", "sample", "drive", "repeat", "estimator", "target")
    status = tree["level/status"]
    assert dict(zip(status.attrs["flag_meanings"].split(), status.attrs["flag_values"], strict=True)) == FLAGS
    inside = json.loads((finished / STORE / "zarr.json").read_text())["consolidated_metadata"]["metadata"]
    for name, metadata in inside.items():
        own = json.loads((finished / STORE / name / "zarr.json").read_text())
        assert {k: v for k, v in metadata.items() if k != "consolidated_metadata"} == own


def test_a_finished_study_computes_nothing_again(study, finished, monkeypatch):
    monkeypatch.setattr(StudyEvaluator, "evaluate", lambda *_: pytest.fail("evaluated again"))
    before = bits(finished)
    run_study(study, finished, jobs=1)
    assert bits(finished) == before


def _overwrite(file):
    file.write_bytes(file.read_bytes()[:-3] + b"xyz")


DAMAGES = {
    "level/rmse/c.1.0.0.0.0.0": (Path.unlink, "is missing", 1),
    "level/nees/c.0.0.1.0.0": (_overwrite, "is damaged", 1),
    "band/status/c.0.0.1.0.0": (_overwrite, "is damaged", 1),
    "checksums/level/c/0/0/0/0": (Path.unlink, "is missing", 1),
    "checksums/band/c/0/0/0/0": (lambda file: file.write_bytes(b"x"), "is damaged", 1),
    "level/bias": (shutil.rmtree, "level/bias/zarr.json is missing (and 4 more)", 4),
    "band": (shutil.rmtree, "is missing", 2),
    "checksums": (shutil.rmtree, "checksums/level is missing", 6),
    "band/rmse/zarr.json": (Path.unlink, "is missing", 0),
    "level/zarr.json": (Path.unlink, "is missing", 0),
    "level/factor_trailer_mass/c/0/0": (Path.unlink, "is missing", 0),
    "level/drive/c/0": (_overwrite, "is damaged", 0),
    "history/1/truth/c/0/0": (Path.unlink, "is missing", 0),
    "history": (shutil.rmtree, "history is missing", 0),
}
"""What may happen to a file of the store of six units, what is told, and how many units it takes to mend it."""


@pytest.mark.parametrize("place", DAMAGES)
def test_a_store_that_has_lost_something_is_refused_in_one_line(copy, place):
    damage, told, _ = DAMAGES[place]
    damage(copy / STORE / place)
    with pytest.raises(UserError) as caught:
        read(copy)
    message = str(caught.value)
    assert len(message.splitlines()) == 1
    assert place in message
    assert told in message
    assert f"'harness run' with the study 'probe' and '--out {copy}' computes what is lost again" in message


@pytest.mark.parametrize(
    "places", [list(DAMAGES)[:5], ["level/bias"], ["band"], ["checksums"], list(DAMAGES)[8:13], ["history"]]
)
def test_what_is_lost_is_computed_again_and_nothing_else(study, finished, copy, monkeypatch, places):
    for place in places:
        DAMAGES[place][0](copy / STORE / place)
    real, seen, console = StudyEvaluator.evaluate, [], Console(file=io.StringIO(), width=400)
    monkeypatch.setattr(StudyEvaluator, "evaluate", lambda self, unit: seen.append(unit) or real(self, unit))
    run_study(study, copy, jobs=1, console=console)
    assert len(seen) == sum(DAMAGES[place][2] for place in places)
    assert "; what is lost is computed again" in console.file.getvalue()
    assert bits(copy) == bits(finished)
    read(copy)


def test_a_lost_status_is_noticed_and_its_unit_computed_again(study, finished, copy, monkeypatch):
    status = "level/status/c.0.0.1.0.0"
    (copy / STORE / status).unlink()
    with pytest.raises(UserError, match=f"{status} is missing"):
        read(copy)
    run_study(study, copy, jobs=1)
    assert bits(copy) == bits(finished)


def test_a_unit_without_status_and_checksums_is_to_come(study, finished, copy):
    for file in ("level/status/c.0.0.1.0.0", "checksums/level/c/0/0/1/0"):
        (copy / STORE / file).unlink()
    assert read(copy).designs[0].count(PENDING) == 5
    run_study(study, copy, jobs=1)
    assert bits(copy) == bits(finished)


def test_a_store_without_checksums_is_read_and_said_to_have_none(finished, copy):
    root = zarr.open_group(copy / STORE, mode="r+")
    old = {key: value for key, value in dict(root.attrs).items() if key != "checksums"}
    root.attrs.clear()
    root.attrs.update(old)
    shutil.rmtree(copy / STORE / "checksums")
    assert read(finished).is_verifiable
    assert not read(copy).is_verifiable
    sheets = [block for block in made.blocks(Analysis(read(copy))) if isinstance(block, Sheet)]
    assert any(row[0] == "checksums" and row[1] == made.NOT_VERIFIABLE for row in sheets[0].rows)
    assert not any(row[0] == "checksums" for row in made.blocks(Analysis(read(finished)))[1].rows)


def test_a_full_disk_is_one_message_and_the_run_goes_on(study, finished, tmp_path, monkeypatch):
    real, written = Store.write, []

    def write(self, unit, result):
        if len(written) == 2:
            raise OSError(errno.ENOSPC, "No space left on device")
        written.append(unit)
        real(self, unit, result)

    monkeypatch.setattr(Store, "write", write)
    with pytest.raises(WorkError, match="No space left on device; finished runs are kept: make room"):
        run_study(study, tmp_path / "full", jobs=1)
    monkeypatch.setattr(Store, "write", real)
    run_study(study, tmp_path / "full", jobs=1)
    assert bits(tmp_path / "full") == bits(finished)


def test_repeats_that_are_cut_give_the_scores_of_repeats_that_are_not(study, finished, tmp_path, monkeypatch):
    monkeypatch.setattr("harness.study.design.RUNS_PER_UNIT", 2)
    cut = run_study(study, tmp_path / "cut", jobs=2)
    for design in ("level", "band"):
        one, other = (xr.open_zarr(f / STORE, group=design, consolidated=False).load() for f in (finished, cut))
        xr.testing.assert_identical(one, other)
    file = "level/rmse/c.1.0.0.1.0.0"
    (cut / STORE / file).unlink()
    with pytest.raises(UserError, match=file):
        read(cut)
    real, seen = StudyEvaluator.evaluate, []
    monkeypatch.setattr(StudyEvaluator, "evaluate", lambda self, unit: seen.append(unit) or real(self, unit))
    run_study(study, cut, jobs=1)
    assert [(u.first_repeat, u.stop_repeat) for u in seen] == [(2, 4)]
    read(cut)


def test_levels_share_their_noise_and_runs_do_not(evaluator, study):
    cases = [Case(0, r) for r in range(study.designs[0].repeats)]
    place = evaluator.compiled.plant.signal_names.index("yaw_rate_trailer")
    light = evaluator.simulate(Unit(0, 0, 0, 0, 1), cases)
    heavy = evaluator.simulate(Unit(0, 1, 0, 0, 1), cases)
    light_noise = light.measurements[:, 0] - light.truth[:, place]
    heavy_noise = heavy.measurements[:, 0] - heavy.truth[:, place]
    np.testing.assert_allclose(light_noise, heavy_noise, atol=1e-12)
    assert np.abs(np.corrcoef(light_noise[:, :5].T) - np.eye(5)).max() < 0.1


def test_batches_in_one_call_have_the_bits_of_each_alone(study, monkeypatch):
    """Two batches and a part of one, which differ in parameters, noise and, at the end, in lanes without a run."""
    designs = (replace(study.designs[0], repeats=21), replace(study.designs[1], base_samples=21))
    evaluator = StudyEvaluator(replace(study, designs=designs))
    every = [Unit(0, 1, 1, 0, 1), Unit(1, 0, 0, 0, 21)]
    calls = []
    simulator, record = evaluator.compiled.simulator, evaluator.compiled.recorded
    real = simulator.loop(record)
    simulator.loops[record.names] = lambda *given: calls.append(len(given[7])) or real(*given)
    monkeypatch.setattr("harness.study.evaluate._SIMULATED_AT_ONCE", 2**30)
    together = [evaluator.evaluate(unit) for unit in every]
    assert calls == [3, 3]
    monkeypatch.setattr("harness.study.evaluate._SIMULATED_AT_ONCE", 1)
    alone = [evaluator.evaluate(unit) for unit in every]
    assert calls[2:] == [1] * 6
    for one, other in zip(together, alone, strict=True):
        for name, values in one.items():
            assert values.tobytes() == other[name].tobytes(), name
        assert np.all(one["status"] == OK)


def test_scores_are_what_the_kept_estimates_say(evaluator, study, finished):
    """RMSE, bias and maximum error of the store, recomputed from the history of the same run."""
    history = histories(evaluator)[0]
    level = xr.open_zarr(finished / STORE, group="level", consolidated=False)
    for target in study.targets:
        error = (history.estimate.sel(target=target, estimator="EKF") - history.truth.sel(target=target)).values[1:]
        stored = level.sel(target=target, estimator="EKF", drive="weave").isel(band=0, sample=0, repeat=0)
        np.testing.assert_allclose(stored.rmse, np.sqrt(np.mean(error**2)), rtol=1e-12)
        np.testing.assert_allclose(stored.bias, np.mean(error), rtol=1e-9, atol=1e-12 * np.abs(error).max())
        np.testing.assert_allclose(stored.max_error, np.abs(error).max(), rtol=1e-12)


def test_each_history_is_stored_with_its_own_signals(study, evaluator, finished):
    light, matched = (xr.open_zarr(finished / STORE, group=f"history/{i}", consolidated=False) for i in (0, 1))
    assert light.target.values.tolist() == [*study.targets, "steering_wheel_angle"]
    assert matched.target.values.tolist() == [*light.target.values, "yaw_rate_tractor"]
    assert (light.attrs["name"], matched.attrs["name"]) == ("", "as believed")
    drawn = matched.sel(target="yaw_rate_tractor", estimator="EKF")
    assert np.corrcoef(drawn.estimate[500:], drawn.truth[500:])[0, 1] > 0.9
    missing = Store(study, lambda: evaluator, finished)
    assert missing.has_histories
    zarr.open_group(finished / STORE, path="history").attrs["runs"] = 1  # as if the writing had been interrupted
    assert not missing.has_histories
    missing.write_histories(histories(evaluator))
    assert missing.has_histories


def test_a_signal_without_truth_is_estimated_but_not_scored():
    from harness.engine.compile import compile_model
    from harness.engine.simd.lanes import LANES
    from harness.estimation.compiled_estimator import CompiledEstimator
    from harness.simulation.simulate import in_lanes
    from harness.testing.small_models import linear

    names = ("alpha_test", "beta_test", "gamma_test")
    compiled = compile_model(linear(), 0.05, signals=names)
    estimator, rng = CompiledEstimator("ekf", compiled), np.random.default_rng(1)
    held = Held(*(in_lanes(np.array(v)) for v in ([1.5], [1.0] * 3, [1.0] * 2, [0.0] * 3, [1.0] * 3)))
    u, y, until = rng.normal(size=(50, 1, LANES)), rng.normal(size=(50, 2, LANES)), np.full(LANES, 50.0)
    whole, part = (
        estimator.run(InputSeries(u), y, held, Scoring(np.zeros((50, len(n), LANES)), n, until, keep=True)).scores()
        for n in (names, names[::2])
    )
    np.testing.assert_array_equal(part.kept, whole.kept)
    assert np.isnan(part.rmse[1]).all()
    assert np.isnan(part.max_error[1]).all()
    np.testing.assert_array_equal(part.rmse[::2], whole.rmse[::2])
    assert np.isfinite(whole.nees).all()
    assert np.isnan(part.nees).all()


def test_a_matched_filter_is_consistent():
    """100 runs of a linear plant by its own filter: NEES and NIS inside their chi-square bounds."""
    from scipy import stats

    from harness.engine.compile import compile_model
    from harness.engine.simd.lanes import LANES
    from harness.estimation.compiled_estimator import CompiledEstimator
    from harness.simulation.simulate import CompiledSimulator, in_lanes
    from harness.testing.small_models import linear

    names = ("alpha_test", "beta_test", "gamma_test")
    compiled, samples, runs = compile_model(linear(), 0.05, signals=names), 400, 104
    q, r, p0 = np.array([1e-3, 2e-3, 5e-4]), np.array([1e-2, 4e-2]), np.array([0.5, 1.0, 2.0])
    rng, simulator = np.random.default_rng(5), CompiledSimulator(compiled.model, 0.05)
    estimator, held = CompiledEstimator("ekf", compiled), [in_lanes(v) for v in (np.array([1.5]), q, r)]
    u, nees, nis = rng.normal(size=(samples, 1, LANES)), [], []
    for _ in range(runs // LANES):
        noise = rng.standard_normal((samples, 5, LANES))
        x0 = rng.standard_normal((3, LANES)) * np.sqrt(p0)[:, None]
        inputs, at_zero = InputSeries(u), Held(*held, np.zeros((3, LANES)), in_lanes(p0))
        batch = simulator.run(inputs, Held(*held, x0), noise, Signals(names))
        record = Scoring(batch.truth, names, batch.left_at)
        scores = estimator.run(inputs, batch.measurements, at_zero, record).scores()
        nees += scores.nees.tolist()
        nis += scores.nis.tolist()
    bound = lambda degrees, share: stats.chi2.ppf(share, degrees)  # noqa: E731
    # NIS is white: all samples of all runs count. NEES is not: one sample per run is the safe count.
    count = runs * (samples - 1) * 2
    assert bound(count, 0.005) < np.mean(nis) * count / 2 < bound(count, 0.995)
    assert bound(runs * 3, 0.025) < np.mean(nees) * runs < bound(runs * 3, 0.975)


def test_store_is_refused_where_the_folder_cannot_be_made(study, evaluator, tmp_path):
    (tmp_path / "file").write_text("")
    with pytest.raises(UserError, match="cannot create"):
        Store(study, lambda: evaluator, tmp_path / "file" / "deeper")
