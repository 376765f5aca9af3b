"""Points of a design agree with SALib, do not depend on anything but the study, and are cut into units once."""

from __future__ import annotations

import dataclasses
import itertools

import numpy as np
import pytest
from SALib.sample import sobol_sequence
from SALib.util import scale_samples
from scipy.stats import qmc

from harness.config import load_study
from harness.engine.simd.lanes import LANES
from harness.simulation.drives import profile_of
from harness.study.compiled_study import held_by
from harness.study.design import (
    Unit,
    points,
    saltelli_points,
    scrambled_points,
    unit_box,
    unit_shape,
    units,
)
from support.small_study import EKF, SEMITRAILER

STUDY = f"""\
name = "designs"
targets = ["articulation_angle"]
{SEMITRAILER}{EKF}[[drive]]
name = "sine"
kind = "sine"
[[drive]]
name = "step"
kind = "step"

[[design]]
name = "levels"
repeats = 20
[[design.factor]]
parameter = "trailer_mass"
levels = ["8 t", "24 t", "32 t"]

[[design]]
name = "tyres"
samples = 32
repeats = 5
[[design.factor]]
parameter = "shape_factor_2"
bands = ["10 %", "20 %", "30 %"]
[[design.factor]]
parameter = "trailer_mass"
levels = ["20 t", "24 t", "28 t"]
[[design.factor]]
parameter = "stiffness_peak_2"
bands = ["10 %", "20 %", "30 %"]
[[design.factor]]
parameter = "relaxation_length_2"
bands = ["10 %", "20 %", "30 %"]

[[design]]
name = "sides"
[[design.factor]]
parameter = "process_noise_scale"
levels = [0.1, 10]
[[design.factor]]
parameter = "measurement_noise_scale"
of = "belief"
levels = [1, 4]
[[design.factor]]
parameter = "friction"
of = "both"
levels = [0.5, 0.8]
[[design.factor]]
parameter = "trailer_mass"
of = "belief"
levels = ["8 t", "9 t"]

[[design]]
name = "nominal"
"""


def _study(folder, text=STUDY):
    path = folder / "designs.toml"
    path.write_text(text)
    return load_study(path)


@pytest.fixture(scope="module")
def study(tmp_path_factory):
    return _study(tmp_path_factory.mktemp("design"))


def test_levels_are_themselves(study):
    found = points(study, study.design("levels"))
    assert found.factors == ("trailer_mass",)
    assert found.values.shape == (3, 1, 1)
    np.testing.assert_array_equal(found.values[:, 0, 0], [8000.0, 24000.0, 32000.0])
    np.testing.assert_array_equal(found.lower, found.upper)
    assert found.band_labels == ("8 t", "24 t", "32 t")


def test_bands_are_salibs_points_bit_for_bit(study):
    found = points(study, study.design("tyres"))
    assert found.values.shape == (3, 32, 4)
    names = ["shape_factor_2", "stiffness_peak_2", "relaxation_length_2"]
    columns = [found.factors.index(n) for n in names]
    for band, half_width in enumerate((0.1, 0.2, 0.3)):
        nominal = [study.belief.values[n] for n in names]
        bounds = [[v - half_width * v, v + half_width * v] for v in nominal]
        expected = sobol_sequence.sample(32, 3)
        scale_samples(expected, {"num_vars": 3, "names": names, "bounds": bounds})
        assert found.values[band][:, columns].tobytes() == np.ascontiguousarray(expected).tobytes()
        np.testing.assert_array_equal(found.values[band, 0, columns], found.lower[band, columns])
    mass = found.values[:, :, found.factors.index("trailer_mass")]
    np.testing.assert_array_equal(mass, np.repeat([[20000.0], [24000.0], [28000.0]], 32, axis=1))


def test_sequence_is_the_unscrambled_sobol_sequence_of_scipy_too():
    np.testing.assert_array_equal(unit_box(64, 5), qmc.Sobol(5, scramble=False).random(64))


@pytest.mark.parametrize("n", [2, 16, 64])
def test_a_power_of_two_of_points_fills_every_slice_equally(n):
    unit = unit_box(n, 4)
    for column in unit.T:
        np.testing.assert_array_equal(np.sort(np.floor(column * n)), np.arange(n))


def test_points_stay_inside_their_band(study):
    found = points(study, study.design("tyres"))
    assert (found.values >= found.lower[:, None]).all()
    assert (found.values <= found.upper[:, None]).all()


def test_points_do_not_depend_on_estimators_or_seed(study, tmp_path):
    text = STUDY.replace('name = "designs"', 'name = "designs"\nseed = 7')
    other = _study(tmp_path, text + EKF.replace("EKF", "other"))
    assert len(other.estimators) == 2
    for design in study.designs:
        mine, theirs = points(study, design), points(other, other.design(design.name))
        assert mine.values.tobytes() == theirs.values.tobytes()
        assert units(study, design) == units(other, other.design(design.name))


def held_at(spec, design, side, values, study):
    """Return what a model holds in eight runs at the first point."""
    profile = profile_of(study.plant, study.drives[0])
    return held_by(spec, design, side, np.repeat(values[:1], LANES, axis=0), profile)


def test_nominal_design_has_one_point_without_factors(study):
    found = points(study, study.design("nominal"))
    assert found.values.shape == (1, 1, 0)
    held = held_at(study.plant, study.design("nominal"), "plant", found.values[0], study)
    np.testing.assert_array_equal(held.values[:, 0], list(study.plant.values.values()))


def test_points_of_another_studys_design_are_refused(study, tmp_path):
    other = _study(tmp_path, STUDY.replace("samples = 32", "samples = 64"))
    with pytest.raises(ValueError, match="not one of study"):
        points(study, other.design("tyres"))


def test_lanes_replace_values_and_scale_noise_on_the_side_that_varies(study):
    design = study.design("sides")
    found = points(study, design)
    assert found.factors == (
        "process_noise_scale",
        "belief.measurement_noise_scale",
        "friction",
        "belief.trailer_mass",
    )
    plant = held_at(study.plant, design, "plant", found.values[1], study)
    belief = held_at(study.belief, design, "belief", found.values[1], study)

    def of(spec, held, name):
        return held.values[spec.model().parameter_names.index(name), 0]

    assert of(study.plant, plant, "friction") == of(study.belief, belief, "friction") == 0.8
    assert of(study.plant, plant, "trailer_mass") == 24000.0
    assert of(study.belief, belief, "trailer_mass") == 9000.0
    np.testing.assert_allclose(plant.process_noise[:, 0], 10 * np.array(list(study.plant.process_noise.values())))
    np.testing.assert_array_equal(belief.process_noise[:, 0], list(study.belief.process_noise.values()))
    np.testing.assert_array_equal(plant.measurement_noise[:, 0], [1e-4])
    np.testing.assert_allclose(belief.measurement_noise[:, 0], [4e-4])
    assert belief.process_noise.shape == (11, LANES)


@pytest.mark.parametrize("largest", [1, 3, 7, 64, 10_000])
def test_units_cover_every_run_once_and_in_order(study, largest, monkeypatch):
    monkeypatch.setattr("harness.study.design.RUNS_PER_UNIT", largest)
    monkeypatch.setattr("harness.study.design.MANY_UNITS", 10_000)  # else units of so few runs grow
    for index, design in enumerate(study.designs):
        found = units(study, design)
        assert found == sorted(found)
        covered = [
            (u.design, u.band, u.drive, s, r)
            for u in found
            for s in range(u.first, u.stop)
            for r in range(u.first_repeat, u.stop_repeat)
        ]
        counts = range(design.bands), range(2), range(design.samples), range(design.repeats)
        assert sorted(covered) == list(itertools.product([index], *counts))
        samples, repeats = unit_shape(study, design)
        for unit in found:
            assert unit.runs(study) <= largest
            assert unit.first % samples == unit.first_repeat % repeats == 0


def test_repeats_of_a_sample_stay_together_where_they_fit(study):
    design = study.design("tyres")
    assert all(u.repeats == slice(0, 5) for u in units(study, design))
    assert unit_shape(study, dataclasses.replace(design, repeats=100)) == (1, 50)


@pytest.mark.parametrize(
    ("repeats", "runs"), [(1_000, 50), (10_000, 64), (100_000, 512), (1_000_000, 2048), (100_000_000, 2048)]
)
def test_units_of_many_runs_are_larger(study, repeats, runs):
    samples, of_repeats = unit_shape(study, dataclasses.replace(study.design("tyres"), repeats=repeats))
    assert 0.75 * runs <= samples * of_repeats <= 2048


def test_units_are_even(study):
    found = units(study, study.design("tyres"))
    sizes = [u.stop - u.first for u in found if u.band == 0 and u.drive == 0]
    assert sizes == [11, 11, 10]  # 32 samples of 5 repeats in three pieces of at most 12


def test_unit_gives_its_samples_as_a_slice():
    assert Unit(0, 0, 0, 3, 6).samples == slice(3, 6)


@pytest.mark.parametrize(
    "points", [lambda: unit_box(8, 2), lambda: saltelli_points(4, 2, 1), lambda: scrambled_points(8, 2, 1)]
)
def test_points_that_were_kept_are_those_that_were_drawn(points, tmp_path, monkeypatch):
    monkeypatch.setenv("HARNESS_CACHE", str(tmp_path))
    drawn, kept = points(), points()
    assert [file.parent.name for file in tmp_path.rglob("*") if file.is_file()] == ["points"]
    monkeypatch.setattr("harness.study.design._MOST_KEPT", 0)
    assert drawn.tobytes() == kept.tobytes() == points().tobytes()
