"""Designs over all factors at once: what a study file may ask, what points it gets, what a run keeps."""

from __future__ import annotations

import shutil

import numpy as np
import pytest
import xarray as xr
import zarr

from harness.common.errors import UserError
from harness.config import load_study
from harness.engine.simd.lanes import LANES
from harness.simulation.drives import profile_of
from harness.study.compiled_study import held_by
from harness.study.design import Unit, points, saltelli_points
from harness.study.evaluate import StudyEvaluator
from harness.study.run import run_study
from harness.study.run_noise import Case
from harness.study.score_names import OVER_TIME
from harness.study.store import STORE
from support.joint_study import HEAD, JOINT, LIMITS, NESTED, OVER
from support.probe_study import STUDY, bits

LOAD = """
[[design]]
name = "load"
sampling = "saltelli"
samples = 16
factor = [
  { parameter = "payload_mass", range = ["0.5 t", "24.5 t"] },
  { parameter = "payload_from_rear", range = ["5 m", "10 m"] },
]
"""
HISTORY = STUDY[STUDY.index("[[history]]") :].replace('design = "level"', 'design = "joint"')


@pytest.fixture
def load(tmp_path):
    def _load(*parts: str):
        path = tmp_path / "joint.toml"
        path.write_text(HEAD + "".join(parts))
        return load_study(path)

    return _load


def test_saltelli_points_are_salibs_on_the_scale_of_each_factor(load):
    study = load(JOINT)
    found = points(study, study.designs[0])
    unit = saltelli_points(4, 3, seed=5)
    assert found.values.shape == (1, 20, 3)
    np.testing.assert_allclose(found.values[0, :, 0], 8e3 + 24e3 * unit[:, 0])
    np.testing.assert_allclose(found.values[0, :, 1], 0.72 + 0.36 * unit[:, 1])
    np.testing.assert_allclose(np.log10(found.values[0, :, 2]), -2.0 + 2.0 * unit[:, 2])
    assert (load(JOINT.replace("samples = 4", "samples = 8")).designs[0].samples) == 40
    assert study.hash != load(JOINT.replace("0.01, 1]", "0.02, 1]")).hash
    assert study.hash != load(JOINT.replace(', scale = "log"', "")).hash


def test_boxes_are_nested_about_the_nominal_point(load):
    study = load(NESTED, LIMITS)
    design = study.designs[0]
    found = points(study, design)
    assert found.values.shape == (4, 1 + 4 + 8, 2)
    assert found.band_labels == ("25 % of the box", "50 % of the box", "75 % of the box", "whole box")
    np.testing.assert_allclose(found.lower[:, 0], [20e3, 16e3, 12e3, 8e3])
    np.testing.assert_allclose(found.upper[:, 0], [26e3, 28e3, 30e3, 32e3])
    np.testing.assert_allclose(found.upper[:, 1], np.sqrt(10.0) ** np.arange(1, 5))
    np.testing.assert_allclose(found.values[:, 0], [[24e3, 1.0]] * 4)
    np.testing.assert_allclose(found.values[3, 1:5], [[8e3, 1.0], [32e3, 1.0], [24e3, 0.01], [24e3, 100.0]])
    rays = found.values[:, 5:, 0] - 24e3
    np.testing.assert_allclose(rays[1] / rays[3], 0.5)  # the same relative points in every box
    logs = np.log(found.values[:, 5:, 1])
    np.testing.assert_allclose(logs[1] / logs[3], 0.5)


def test_mass_cog_and_inertia_follow_from_the_load(load):
    study = load(LOAD)
    design = study.designs[0]
    values = points(study, design).values[0]
    profile = profile_of(study.plant, study.drives[0])

    def rows(spec, side, values):
        filled = np.repeat(values, LANES, axis=0)  # a batch for each point
        return np.atleast_3d(held_by(spec, design, side, filled, profile).values)[..., 0]

    held = rows(study.plant, "plant", values)
    names = study.plant.model().parameter_names
    mass, cog, scale = (
        held[:, names.index(n)] for n in ("trailer_mass", "trailer_cog_from_rear", "trailer_inertia_scale")
    )
    np.testing.assert_allclose(mass, 7500.0 + values[:, 0])
    np.testing.assert_allclose(mass * cog, 7500.0 * 6.2 + values[:, 0] * values[:, 1])  # moments about the rear wall
    assert np.ptp(scale) > 0.05
    forward = values[:, 1] > 6.2
    assert np.corrcoef(mass[forward], cog[forward])[0, 1] > 0.3
    nominal = {f.parameter: f.nominal for f in design.factors}
    one = np.array([[nominal["payload_mass"], nominal["payload_from_rear"]]] * 2)
    np.testing.assert_allclose(rows(study.plant, "plant", one)[0], [study.plant.values[n] for n in names], rtol=1e-12)
    assert (np.ptp(rows(study.belief, "belief", values), axis=0) == 0.0).all()


REFUSALS = {
    "not a power of two": (JOINT.replace("samples = 4", "samples = 6"), "design[0].samples: 6 is no power of two"),
    "any n": (JOINT.replace("samples = 4", "samples = 4\nsobol_any_n = true"), "design[0].sobol_any_n: sampling"),
    "one point": (JOINT.replace("samples = 4", "samples = 1"), "design[0].samples: one point does not sample a box"),
    "levels": (JOINT.replace('bands = ["20 %"]', "levels = [0.5, 0.7]"), "design[0].factor[1]: sampling = 'saltelli'"),
    "twice": (
        JOINT.replace('"friction"', '"trailer_mass"'),
        "design[0].factor[1].parameter: 'trailer_mass' of the plant",
    ),
    "beyond bounds": (JOINT.replace('"32 t"]', '"90 t"]'), "design[0].factor[0].range: the band 8 t to 90 t reaches"),
    "turned round": (JOINT.replace('["8 t", "32 t"]', '["32 t", "8 t"]'), "design[0].factor[0].range: the lower edge"),
    "log of zero": (JOINT.replace("[0.01, 1]", "[0, 1]"), "design[0].factor[2].scale: a logarithm needs values above"),
    "boxes elsewhere": (JOINT.replace("samples = 4", "samples = 4\nboxes = 3"), "design[0].boxes: nested boxes belong"),
    "nominal outside": (
        NESTED.replace('"8 t"', '"25 t"') + LIMITS,
        "design[0].factor[0].range: the boxes of a tolerance",
    ),
    "no limits": (NESTED, "design[0].sampling: a tolerance map needs the error that counts as tolerable"),
    "limit of no target": (JOINT + LIMITS.replace("angle", "angel"), "limits.articulation_angel: a limit belongs"),
    "limit below zero": (
        JOINT + LIMITS.replace("2 deg", "-2 deg"),
        "limits.articulation_angle: an RMSE is never below",
    ),
    "unit of a limit": (JOINT + LIMITS.replace("2 deg", "2 kN"), "limits.articulation_angle: "),
    "follows": (
        LOAD.rstrip()[:-1] + '  { parameter = "trailer_mass", range = ["8 t", "32 t"] },\n]\n',
        "design[0].factor[2].parameter: 'trailer_mass' of the plant follows from 'payload_mass'",
    ),
    "load beyond the kingpin": (
        LOAD.replace('"10 m"', '"20 m"'),
        "design[0].factor: payload_mass 0.5 t to 24.5 t, payload_from_rear 5 m to 20 m of the plant: trailer_cog",
    ),
    "over time of another design": (
        JOINT + OVER.replace('"joint"', '"other"'),
        "report.sensitivity_over_time.design: ",
    ),
    "over time of another drive": (JOINT + OVER.replace('"weave"', '"weaves"'), "report.sensitivity_over_time.drive: "),
    "window of nothing": (JOINT + OVER.replace("5 s", "0 s"), "report.sensitivity_over_time.window: give a positive"),
}


@pytest.mark.parametrize("case", REFUSALS)
def test_refused_with_place_and_remedy(load, case):
    text, expected = REFUSALS[case]
    with pytest.raises(UserError) as caught:
        load(text)
    assert any(line.split("joint.toml: ", 1)[1].startswith(expected) for line in str(caught.value).splitlines()), str(
        caught.value
    )


@pytest.fixture(scope="module")
def joint(tmp_path_factory):
    """A run of the joint design with errors over time, on the kernels of ``test_run``."""
    folder = tmp_path_factory.mktemp("joint")
    path = folder / "joint.toml"
    path.write_text(
        HEAD + JOINT + HISTORY.split("levels")[0] + 'drive = "weave"\nsignals = ["yaw_rate_tractor"]\n' + OVER
    )
    study = load_study(path)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("harness.study.provenance.engine_hash", lambda study: "this one")
        run_study(study, folder / "out", jobs=2)
        yield study, StudyEvaluator(study), folder / "out"


def test_all_points_share_the_noise_of_a_drive(joint):
    _, evaluator, _ = joint
    unit = Unit(0, 0, 0, 0, 3)
    batch = evaluator.simulate(unit, [Case(s, 0) for s in range(3)])
    place = evaluator.compiled.plant.signal_names.index("yaw_rate_trailer")
    noise = [batch.measurements[:, 0, lane] - batch.truth[:, place, lane] for lane in range(3)]
    np.testing.assert_allclose(noise[0], noise[1], atol=1e-12)
    np.testing.assert_allclose(noise[0], noise[2], atol=1e-12)
    other = evaluator.simulate(Unit(0, 0, 1, 0, 1), [Case(0, 0)])
    assert np.abs(other.measurements - batch.measurements).max() > 1e-3


def test_errors_over_time_add_up_to_the_error_of_the_run(joint):
    _, _, folder = joint
    data = xr.open_zarr(folder / STORE, group="joint", consolidated=False).load()
    windows = data[OVER_TIME].transpose("band", "sample", "repeat", "estimator", "target", "window")
    assert windows.sizes["window"] == 4
    assert data.attrs["over_time_drive"] == "weave"
    together = np.sqrt((windows.astype(float) ** 2).mean("window"))
    # The first sample is in the first window and not in the run's score; the last of the drive is in none.
    np.testing.assert_allclose(together, data["rmse"].isel(drive=0).transpose(*together.dims), rtol=2e-3)


def test_errors_over_time_are_those_of_one_drive_when_something_is_lost(joint, tmp_path, monkeypatch):
    study, _, folder = joint
    real, seen = StudyEvaluator.evaluate, []
    monkeypatch.setattr(StudyEvaluator, "evaluate", lambda self, unit: seen.append(unit.drive) or real(self, unit))
    copy = shutil.copytree(folder, tmp_path / "copy")
    (copy / STORE / "joint" / "rmse" / "c.0.0.1.0.0.0").unlink()
    run_study(study, copy, jobs=1)
    (copy / STORE / "joint" / OVER_TIME / "c.0.0.0.0.0.0").unlink()
    run_study(study, copy, jobs=1)
    assert seen == [1, 0]
    assert bits(copy) == bits(folder)


def test_new_limits_and_title_reach_the_store_without_a_new_run(joint, monkeypatch):
    study, _, folder = joint
    path = study.path
    path.write_text(path.read_text().replace("title = ", 'title = "Renamed. " #') + LIMITS)
    renewed = load_study(path)
    assert renewed.hash == study.hash
    monkeypatch.setattr(StudyEvaluator, "evaluate", lambda self, unit: pytest.fail("a finished run was repeated"))
    run_study(renewed, folder, jobs=1)
    attributes = zarr.open_group(str(folder / STORE), mode="r").attrs
    assert attributes["title"] == "Renamed. "
    assert "articulation_angle" in str(attributes["limits"])
