"""A study file is read, inherited, converted and refused as docs/studies.md says."""

from __future__ import annotations

import copy
import dataclasses
import json
import shutil
import tomllib
from pathlib import Path

import pytest

from harness.configure import load_study, study_schema, write_schema
from harness.errors import UserError
from models import registry

ROOT = Path(__file__).parents[2]
SET = registry.load("models.parameters", "ziaukas_2023")

STUDY = """\
name = "small"
title = "A question?"
seed = 0
targets = ["lateral_force_axle_21", "articulation_angle"]

[plant]
vehicle = "semitrailer"
parameters = "ziaukas_2023"
tyre = "magic_formula"
sensors = "series"

[belief]
unknown_inputs = ["steering_wheel_angle"]

[[drive]]
name = "sine"
kind = "sine"

[[estimator]]
name = "EKF"
kind = "ekf"

[[design]]
name = "level"
repeats = 2
[[design.factor]]
parameter = "trailer_mass"
levels = ["8 t", "24 t", "32 t"]
"""


@pytest.fixture
def load(tmp_path):
    """Write a study with replacements (which must apply) and load it."""

    def _load(*replacements: tuple[str, str], append: str = "", text: str = STUDY):
        for old, new in replacements:
            assert old in text, old
            text = text.replace(old, new)
        path = tmp_path / "small.toml"
        path.write_text(text + append, encoding="utf-8")
        return load_study(path)

    return _load


@pytest.fixture
def refused(load):
    """Load a study that must be refused; return the lines of the message, each checked to name the file."""

    def _refused(*replacements: tuple[str, str], append: str = "") -> list[str]:
        with pytest.raises(UserError) as caught:
            load(*replacements, append=append)
        lines = str(caught.value).splitlines()
        for line in lines:
            assert "small.toml: " in line
        return [line.split("small.toml: ", 1)[1] for line in lines]

    return _refused


def test_values_come_from_the_set_and_si_units(load):
    study = load(append='[plant.values]\ntrailer_mass = "8 t"\nfriction = 0.5\n')
    assert study.plant.values == {**SET.VALUES, "trailer_mass": 8000.0, "friction": 0.5}
    assert set(study.plant.values) == set(study.plant.model().parameter_names)
    assert study.plant.process_noise["lateral_force_axle_21"] == SET.PROCESS_NOISE["lateral_force_axle_21"]
    assert study.plant.measurement_noise == {"yaw_rate_trailer": 1e-4}
    assert (study.plant.integrator, study.plant.step, study.plant.substeps) == ("euler", 0.01, 1)
    assert study.seed == 0
    assert study.designs[0].factors[0].levels == (8000.0, 24000.0, 32000.0)
    assert study.designs[0].band_labels == ("8 t", "24 t", "32 t")
    assert study.designs[0].factors[0].nominal == 8000.0


def test_belief_inherits_what_it_does_not_state(load):
    study = load(
        append="""
[plant.values]
trailer_mass = "8 t"
friction = 0.5
[plant.noise]
process_scale = 10.0
measurement = { yaw_rate_trailer = "4 deg^2/s^2" }
[belief.values]
trailer_mass = "24 t"
[belief.noise]
process = { articulation_angle = 1e-9 }
"""
    )
    belief, plant = study.belief, study.plant
    assert belief.values == {**plant.values, "trailer_mass": 24000.0}
    assert belief.values["friction"] == 0.5
    assert belief.measurement_noise == plant.measurement_noise
    assert plant.measurement_noise["yaw_rate_trailer"] == pytest.approx(4 * (3.141592653589793 / 180) ** 2)
    assert belief.process_noise["articulation_angle"] == pytest.approx(1e-8)  # its own, times the inherited scale
    assert plant.process_noise["articulation_angle"] == pytest.approx(1e-9)
    assert "steering_wheel_angle" in belief.process_noise
    assert "steering_wheel_angle" not in plant.process_noise
    assert belief.model().states[-1] == "steering_wheel_angle"
    assert belief.model() is study.belief.model()


def test_belief_scale_replaces_the_plants(load):
    study = load(append="[plant.noise]\nprocess_scale = 10\n[belief.noise]\nprocess_scale = 1\n")
    assert study.plant.process_noise["yaw_rate_trailer"] == pytest.approx(1e-8)
    assert study.belief.process_noise["yaw_rate_trailer"] == pytest.approx(1e-9)


def test_belief_with_its_own_set_starts_from_that_set(load):
    study = load(
        ("[belief]\n", '[belief]\nparameters = "ziaukas_2023"\n'),
        append='[plant.values]\ntrailer_mass = "8 t"\n',
    )
    assert study.plant.values["trailer_mass"] == 8000.0
    assert study.belief.values["trailer_mass"] == 24000.0


def test_belief_with_another_tyre_drops_parameters_it_does_not_have(load):
    study = load(("[belief]\n", '[belief]\ntyre = "linear"\n'), append="[plant.values]\nshape_factor_2 = 1.5\n")
    assert study.plant.values["shape_factor_2"] == 1.5
    assert "shape_factor_2" not in study.belief.values


def test_process_noise_grows_with_the_step_but_measurement_noise_does_not(load):
    slow = load(('sensors = "series"\n', 'sensors = "series"\nstep = "20 ms"\n'))
    assert slow.plant.step == 0.02
    assert slow.plant.process_noise["yaw_rate_trailer"] == pytest.approx(2e-9)
    assert slow.plant.measurement_noise["yaw_rate_trailer"] == 1e-4


def test_hash_ignores_form_and_sees_content(load):
    first = load().hash
    assert len(first) == 64
    assert load(('"8 t",', "8000.0,  # kg\n"), ("seed = 0", "seed   =   0")).hash == first
    assert load(("A question?", "Another question?")).hash == first
    assert load(append="# a comment\n").hash == first
    moved = STUDY.replace('[belief]\nunknown_inputs = ["steering_wheel_angle"]\n\n', "")
    assert load(text=moved, append='[belief]\nunknown_inputs = ["steering_wheel_angle"]\n').hash == first
    for old, new in (
        ("seed = 0", "seed = 1"),
        ('"8 t"', '"8.1 t"'),
        ("repeats = 2", "repeats = 3"),
        ('kind = "sine"', 'kind = "sine"\nspeed = 12'),
        ('sensors = "series"', 'sensors = "series"\nsubsteps = 2'),
    ):
        assert load((old, new)).hash != first, new


def test_hash_sees_drive_files_and_recordings(load, tmp_path):
    (tmp_path / "drives").mkdir()
    file = tmp_path / "drives" / "mine.toml"
    file.write_text('[[drive]]\nname = "road"\nkind = "sine"\n')
    replaced = ("seed = 0", 'seed = 0\ndrives = "mine"')
    first = load(replaced)
    assert [d.name for d in first.drives] == ["road", "sine"]
    assert first.drives[0].where.endswith("mine.toml: drive[0]")
    file.write_text('[[drive]]\nname = "road"\nkind = "sine"\nspeed = 12.0\n')
    assert load(replaced).hash != first.hash
    recording = tmp_path / "a.csv"
    recording.write_text("time,x\n0,1\n")
    from_file = ('kind = "sine"', 'kind = "from_file"\nfile = "a.csv"')
    second = load(from_file)
    assert second.drives[0].base == tmp_path
    recording.write_text("time,x\n0,2\n")
    assert load(from_file).hash != second.hash


def test_recording_is_looked_for_in_the_study_folder_then_in_the_working_directory(load, tmp_path, monkeypatch):
    elsewhere = tmp_path / "elsewhere"
    elsewhere.mkdir()
    (elsewhere / "a.csv").write_text("time\n")
    monkeypatch.chdir(elsewhere)
    from_file = ('kind = "sine"', 'kind = "from_file"\nfile = "a.csv"')
    assert load(from_file).drives[0].base == Path()
    (tmp_path / "a.csv").write_text("time\n")
    assert load(from_file).drives[0].base == tmp_path


def test_factor_forms(load):
    study = load(
        append="""
[[design]]
name = "bands"
samples = 8
[[design.factor]]
parameter = "shape_factor_2"
bands = ["10 %", "20 %"]
[[design.factor]]
parameter = "relaxation_length_2"
bands = ["±10 %", "+-20 %"]

[[design]]
name = "shift"
[[design.factor]]
parameter = "trailer_cog_from_rear"
shift = ["-2 m", 0, "50 cm"]

[[design]]
name = "around"
samples = 4
[[design.factor]]
parameter = "trailer_mass"
unit = "t"
levels = [8, 24]
band = "500 kg"

[[design]]
name = "noise"
[[design.factor]]
parameter = "process_noise_scale"
of = "both"
levels = [0.1, 10]

[[design]]
name = "nominal"
"""
    )
    bands, shift, around, noise, nominal = study.designs[1:]
    assert bands.factors[0].upper == pytest.approx((1.375, 1.5))
    assert bands.factors[1].lower == pytest.approx((0.45, 0.4))
    assert bands.band_labels == ("±10 %", "±20 %")
    assert shift.factors[0].levels == pytest.approx((5.8, 7.8, 8.3))
    assert shift.band_labels == ("-2 m", "0 m", "+0.5 m")
    assert around.factors[0].lower == (7500.0, 23500.0)
    assert around.band_labels == ("8 t ±0.5 t", "24 t ±0.5 t")
    assert noise.band_labels == ("×0.1", "×10")
    assert (nominal.bands, nominal.band_labels) == (1, ("nominal",))


def test_bands_lie_around_the_belief(load):
    study = load(
        (
            'levels = ["8 t", "24 t", "32 t"]',
            'bands = ["5 %"]',
        ),
        ("repeats = 2", "samples = 4"),
        append='[plant.values]\ntrailer_mass = "8 t"\n[belief.values]\ntrailer_mass = "20 t"\n',
    )
    assert (study.designs[0].factors[0].lower, study.designs[0].factors[0].upper) == ((19000.0,), (21000.0,))


def test_history_names_a_run_of_the_design(load):
    study = load(append='[history]\ndesign = "level"\nlevels = { trailer_mass = 24000 }\ndrive = "sine"\nrepeat = 1\n')
    (history,) = study.history
    assert (history.band, history.repeat) == (1, 1)
    assert history.levels == {"trailer_mass": 24000.0}
    assert (history.name, history.signals) == ("", ())


def test_several_histories_with_signals_of_their_own(load):
    study = load(
        append='[[history]]\nname = "light"\ndesign = "level"\nlevels = { trailer_mass = 8000 }\ndrive = "sine"\n'
        '[[history]]\ndesign = "level"\nlevels = { trailer_mass = 32000 }\ndrive = "sine"\n'
        'signals = ["yaw_rate_tractor"]\n'
    )
    assert [(h.name, h.band, h.signals) for h in study.history] == [("light", 0, ()), ("", 2, ("yaw_rate_tractor",))]
    assert load().history == ()
    assert load().hash != study.hash


REFUSALS = {
    "unknown key": ([("seed = 0", "sed = 0")], "sed: unknown key 'sed'; closest: seed"),
    "unknown nested key": (
        [("repeats = 2", "repeat = 2")],
        "design[0].repeat: unknown key 'repeat'; closest: repeats",
    ),
    "unknown factor key": (
        [("levels =", "level =")],
        "design[0].factor[0].level: unknown key 'level'; closest: levels",
    ),
    "missing name": ([('name = "small"\n', "")], "name: this key is required; add 'name'"),
    "no targets": ([('["lateral_force_axle_21", "articulation_angle"]', "[]")], "targets: "),
    "unknown target": (
        [("articulation_angle", "articulation_angel")],
        "targets[1]: the plant cannot give it: model 'semitrailer+magic_formula' has no quantity "
        "'articulation_angel'; closest: articulation_angle",
    ),
    "target twice": (
        [("articulation_angle", "lateral_force_axle_21")],
        "targets[1]: 'lateral_force_axle_21' is named twice",
    ),
    "target of the plant alone": (
        [
            ("articulation_angle", "lateral_force_capacity_axle_21"),
            ("[belief]\n", '[belief]\ntyre = "linear"\n'),
        ],
        "targets[1]: the belief cannot give it",
    ),
    "negative seed": (
        [("seed = 0", "seed = -1")],
        "seed: input should be greater than or equal to 0, got -1",
    ),
    "boolean seed": ([("seed = 0", "seed = true")], "seed: "),
    "unknown vehicle": (
        [('"semitrailer"', '"semitrailor"')],
        "plant.vehicle: unknown vehicle 'semitrailor'; closest: semitrailer",
    ),
    "missing vehicle": (
        [('vehicle = "semitrailer"\n', "")],
        "plant.vehicle: this key is required; choose one of: ",
    ),
    "unknown tyre": (
        [('"magic_formula"', '"magic_formul"')],
        "plant.tyre: unknown tyre 'magic_formul'; closest: magic_formula",
    ),
    "no tyre": ([('tyre = "magic_formula"\n', "")], "plant: vehicle 'semitrailer' needs a tyre"),
    "unknown sensors": ([('"series"', '"serie"')], "plant.sensors: unknown sensor 'serie'; closest: series"),
    "unknown effect": (
        [('sensors = "series"', 'sensors = "series"\neffects = ["no_such_effect"]')],
        "plant.effects[0]: unknown effect 'no_such_effect'",
    ),
    "unknown set": (
        [('"ziaukas_2023"', '"ziaukas_2032"')],
        "plant.parameters: unknown parameter 'ziaukas_2032'; closest: ziaukas_2023",
    ),
    "missing parameter file": (
        [('"ziaukas_2023"', '"mine.toml"')],
        "plant.parameters: there is no parameter file 'mine.toml'",
    ),
    "unknown input": (
        [('["steering_wheel_angle"]', '["steering_angle"]')],
        "belief.unknown_inputs[0]: 'steering_angle' is no input; closest: steering_wheel_angle",
    ),
    "speed as unknown input": (
        [('["steering_wheel_angle"]', '["speed"]')],
        "belief.unknown_inputs[0]: 'speed' must be known, because its time derivative is an input",
    ),
    "unknown input of the plant": (
        [('sensors = "series"', 'sensors = "series"\nunknown_inputs = ["steering_wheel_angle"]')],
        "plant.unknown_inputs: only the belief has unknown inputs",
    ),
    "steps differ": (
        [("[belief]\n", '[belief]\nstep = "20 ms"\n')],
        "belief.step: 0.02 s differs from the plant's 0.01 s",
    ),
    "belief measures more": (
        [("[belief]\n", '[belief]\nsensors = "test_vehicle"\n')],
        "belief.sensors: the belief measures 'yaw_rate_tractor', which the plant's sensors do not give",
    ),
    "unknown drive kind": (
        [('kind = "sine"', 'kind = "sin"')],
        "drive[0].kind: unknown drive 'sin'; closest: sine",
    ),
    "unknown drive option": (
        [('kind = "sine"', 'kind = "sine"\namplitud = 1')],
        "drive[0].amplitud: drive 'sine' has no option 'amplitud'; closest: amplitude",
    ),
    "missing drive option": (
        [('kind = "sine"', 'kind = "from_file"')],
        "drive[0].file: drive 'from_file' needs this option",
    ),
    "no drive file": (
        [("seed = 0", 'seed = 0\ndrives = "robust"')],
        "drives: there is no file ",
    ),
    "no drives": ([('[[drive]]\nname = "sine"\nkind = "sine"\n', "")], "drives: a study needs a drive"),
    "unknown estimator": (
        [('kind = "ekf"', 'kind = "ekv"')],
        "estimator[0].kind: unknown estimator 'ekv'; closest: ekf",
    ),
    "unknown setting": (
        [('kind = "ekf"', 'kind = "ekf"\nalphabet = 1')],
        "estimator[0].alphabet: estimator 'ekf' has no setting 'alphabet'",
    ),
    "level below bound": (
        [('"8 t"', '"-8 t"')],
        "design[0].factor[0].levels[0]: trailer_mass = -8000 kg lies below 1000 kg",
    ),
    "wrong unit": ([('"8 t"', '"8 m"')], "design[0].factor[0].levels[0]: '8 m' does not fit"),
    "text without unit": ([('"8 t"', '"8"')], "design[0].factor[0].levels[0]: '8' has no unit"),
    "nan": ([('"8 t"', "nan")], "design[0].factor[0].levels[0]: expected a finite number"),
    "table as number": ([('"8 t"', "{ a = 1 }")], "design[0].factor[0].levels[0]: expected a number"),
    "unknown parameter": (
        [('"trailer_mass"', '"trailer_mas"')],
        "design[0].factor[0].parameter: the plant has no parameter 'trailer_mas'; closest: trailer_mass",
    ),
    "levels and bands": (
        [("levels =", 'bands = ["5 %"]\nlevels =')],
        "design[0].factor[0]: a factor needs exactly one of levels, shift, bands and range; this one has levels and bands",
    ),
    "band beyond bound": (
        [("levels =", 'band = "90 %"\nlevels =')],
        "design[0].factor[0].levels[0]: the band 8 t ±90 % reaches too far: trailer_mass = 800 kg",
    ),
    "band needs samples": (
        [("levels =", 'band = "5 %"\nlevels =')],
        "design[0].samples: a band is sampled by a Sobol sequence",
    ),
    "samples no power of two": (
        [("levels =", 'band = "5 %"\nlevels ='), ("repeats = 2", "samples = 20")],
        "design[0].samples: 20 is no power of two: the first N points of a Sobol sequence",
    ),
    "samples without a band": (
        [("repeats = 2", "samples = 16")],
        "design[0].samples: 16 samples of the same point",
    ),
    "zero band": (
        [("levels =", 'band = "0 %"\nlevels =')],
        "design[0].factor[0].band: a half-width must be positive",
    ),
    "labels": (
        [("levels =", 'labels = ["a"]\nlevels =')],
        "design[0].factor[0].labels: 1 labels for 3 levels",
    ),
    "label unit": (
        [("levels =", 'unit = "m"\nlevels =')],
        "design[0].factor[0].unit: ",
    ),
    "belief noise of zero": (
        [
            ("levels = ", 'of = "belief"\nlevels = '),
            ("trailer_mass", "measurement_noise_scale"),
            ('["8 t", "24 t", "32 t"]', "[0, 1]"),
        ],
        "design[0].factor[0].levels[0]: an estimator cannot work with variances of zero",
    ),
}


@pytest.mark.parametrize("case", REFUSALS, ids=lambda c: c.replace(" ", "-"))
def test_refusal_names_file_key_and_remedy(refused, case):
    replacements, expected = REFUSALS[case]
    assert any(line.startswith(expected) for line in refused(*replacements)), refused(*replacements)


APPENDED = {
    "negative mass": (
        '[plant.values]\ntrailer_mass = "-8 t"\n',
        "plant.values.trailer_mass: trailer_mass = -8000 kg lies below 1000 kg",
    ),
    "unit of a value": (
        '[plant.values]\ntrailer_mass = "8 m"\n',
        "plant.values.trailer_mass: '8 m' does not fit",
    ),
    "unknown value": (
        "[belief.values]\ntrailr_mass = 1\n",
        "belief.values.trailr_mass: the belief has no parameter 'trailr_mass'; closest: trailer_mass",
    ),
    "cog outside": (
        '[plant.values]\ntrailer_cog_from_rear = "13.5 m"\n',
        "plant.values.trailer_cog_from_rear: 13.5 m must lie between",
    ),
    "cog shifted outside": (
        '[[design]]\nname = "cog"\n[[design.factor]]\nparameter = "trailer_cog_from_rear"\nshift = ["0 m", "5 m"]\n',
        "design[1].factor[0].shift[1]: +5 m of the plant: trailer_cog_from_rear: 12.8 m must lie between",
    ),
    "cog band outside at a corner alone": (
        '[[design]]\nname = "cog"\nsamples = 4\n[[design.factor]]\nparameter = "trailer_cog_from_rear"\n'
        'bands = ["3.3 m"]\n[[design.factor]]\nparameter = "kingpin_from_rear"\nbands = ["1 m"]\n',
        "design[1].factor[0].bands[0]: trailer_cog_from_rear ±3.3 m, kingpin_from_rear ±1 m of the plant: "
        "trailer_cog_from_rear: 11.1 m must lie between the middle axle (4.32 m) and the kingpin (11 m)",
    ),
    "variance": (
        "[plant.noise]\nprocess = { yaw_rate_trailer = -1.0 }\n",
        "plant.noise.process.yaw_rate_trailer: a variance cannot be negative",
    ),
    "noise of no state": (
        "[plant.noise]\nprocess = { yaw_rate_trialer = 1.0 }\n",
        "plant.noise.process.yaw_rate_trialer: the plant has no state 'yaw_rate_trialer'; closest: yaw_rate_trailer",
    ),
    "no noise in the belief": (
        "[belief.noise]\nmeasurement_scale = 0\n",
        "belief.noise.measurement.yaw_rate_trailer: an estimator cannot divide by a measurement without noise",
    ),
    "constant unknown input": (
        "[belief.noise]\nprocess = { steering_wheel_angle = 0 }\n",
        "belief.noise.process.steering_wheel_angle: an unknown input without process noise",
    ),
    "factor varied twice": (
        '[[design]]\nname = "twice"\n[[design.factor]]\nparameter = "friction"\nlevels = [0.5]\n'
        '[[design.factor]]\nparameter = "friction"\nof = "both"\nlevels = [0.6]\n',
        "design[1].factor[1].parameter: 'friction' of the plant is varied by design[1].factor[0] already",
    ),
    "different numbers of bands": (
        '[[design]]\nname = "two"\n[[design.factor]]\nparameter = "friction"\nlevels = [0.5]\n'
        '[[design.factor]]\nparameter = "trailer_mass"\nlevels = [8e3, 9e3]\n',
        "design[1].factor: the i-th bands of all factors belong together, but their numbers differ "
        "(friction 1, trailer_mass 2)",
    ),
    "design twice": (
        '[[design]]\nname = "level"\n',
        "design[1].name: 'level' is the name of design[0] already",
    ),
    "estimator twice": (
        '[[estimator]]\nname = "EKF"\nkind = "ekf"\n',
        "estimator[1].name: 'EKF' is the name of estimator[0] already",
    ),
    "drive twice": ('[[drive]]\nname = "sine"\nkind = "step"\n', "drive[1].name: 'sine' is the name of "),
    "history drive": (
        '[history]\ndesign = "level"\ndrive = "sinus"\nlevels = { trailer_mass = "8 t" }\n',
        "history.drive: there is no drive 'sinus'; closest: sine",
    ),
    "history among several": (
        '[[history]]\ndesign = "level"\ndrive = "sine"\nband = "8 t"\n'
        '[[history]]\ndesign = "level"\ndrive = "sine"\nband = "9 t"\n',
        "history[1].band: no band is labelled '9 t'",
    ),
    "history key": (
        '[history]\ndesing = "level"\ndrive = "sine"\n',
        "history.desing: unknown key 'desing'; closest: design",
    ),
    "history key among several": (
        '[[history]]\ndesing = "level"\ndrive = "sine"\n',
        "history[0].desing: unknown key 'desing'; closest: design",
    ),
    "history twice": (
        2 * '[[history]]\nname = "a"\ndesign = "level"\ndrive = "sine"\nband = "8 t"\n',
        "history[1].name: 'a' is the name of history[0] already",
    ),
    "history signal": (
        '[history]\ndesign = "level"\ndrive = "sine"\nband = "8 t"\nsignals = ["yaw_rate_tracto"]\n',
        "history.signals[0]: model 'semitrailer+magic_formula' has no quantity 'yaw_rate_tracto'; "
        "closest: yaw_rate_tractor",
    ),
    "design of the name of the histories": (
        '[[design]]\nname = "history"\n',
        "design[1].name: 'history' is where the store keeps the runs over time",
    ),
    "history design": (
        '[history]\ndesign = "levels"\ndrive = "sine"\n',
        "history.design: there is no design 'levels'; closest: level",
    ),
    "history level": (
        '[history]\ndesign = "level"\ndrive = "sine"\nlevels = { trailer_mass = "9 t" }\n',
        "history.levels.trailer_mass: '9 t' is no level of design 'level'; its bands: 8 t, 24 t, 32 t",
    ),
    "history ambiguous": (
        '[history]\ndesign = "level"\ndrive = "sine"\n',
        "history: 3 bands of design 'level' fit",
    ),
    "history repeat": (
        '[history]\ndesign = "level"\ndrive = "sine"\nrepeat = 2\nlevels = { trailer_mass = "8 t" }\n',
        "history.repeat: design 'level' has 2, counted from 0",
    ),
}


@pytest.mark.parametrize("case", APPENDED, ids=lambda c: c.replace(" ", "-"))
def test_refusal_of_an_added_table(refused, case):
    appended, expected = APPENDED[case]
    lines = refused(append=appended)
    assert any(line.startswith(expected) for line in lines), lines


def test_sobol_any_n_allows_the_thesis_20_points(load):
    study = load(("levels =", 'band = "5 %"\nlevels ='), ("repeats = 2", "samples = 20\nsobol_any_n = true"))
    assert study.designs[0].samples == 20


def test_all_problems_are_reported_at_once(refused):
    lines = refused(
        ('kind = "ekf"', 'kind = "ekv"'),
        ('kind = "sine"', 'kind = "sin"'),
        ('"8 t"', '"8 m"'),
    )
    assert [line.split(":")[0] for line in lines] == [
        "drive[0].kind",
        "estimator[0].kind",
        "design[0].factor[0].levels[0]",
    ]


def test_all_levels_out_of_bounds_are_reported(refused):
    lines = refused(('"8 t"', '"0.8 t"'), ('"32 t"', '"320 t"'))
    assert [line.split(":")[0] for line in lines] == [f"design[0].factor[0].levels[{i}]" for i in (0, 2)]


def test_wrong_inherited_value_is_reported_once_where_it_is_written(refused):
    lines = refused(append="[plant.values]\nfriction = 9.0\n")
    assert len(lines) == 1
    assert lines[0].startswith("plant.values.friction: friction = 9 lies above 1.5")


def test_toml_errors_name_the_line(refused):
    assert "line 3" in refused(("seed = 0", "seed = "))[0]


def test_missing_file_suggests_the_closest(tmp_path):
    (tmp_path / "mass.toml").write_text(STUDY)
    with pytest.raises(UserError, match=r"mas\.toml: there is no such file; closest: mass\.toml"):
        load_study(tmp_path / "mas.toml")


def test_other_than_utf8_is_refused(tmp_path):
    path = tmp_path / "a.toml"
    path.write_bytes(b'name = "\xff"')
    with pytest.raises(UserError, match="not UTF-8 text"):
        load_study(path)


def _parameter_file(**changed: str) -> str:
    text = 'vehicle = "semitrailer"\nsource = "test"\n[values]\n'
    values = {k: str(v) for k, v in SET.VALUES.items()} | changed
    text += "".join(f"{k} = {v}\n" for k, v in values.items())
    text += "[process_noise]\n" + "".join(f"{k} = {v}\n" for k, v in SET.PROCESS_NOISE.items())
    return text + "[measurement_noise]\n" + "".join(f"{k} = {v}\n" for k, v in SET.MEASUREMENT_NOISE.items())


def test_parameter_file_equals_the_set_it_was_written_from(load, tmp_path):
    (tmp_path / "mine.toml").write_text(_parameter_file(trailer_mass='"24 t"'))
    mine = load(("ziaukas_2023", "mine.toml"))
    assert mine.plant.values == SET.VALUES
    assert mine.hash == load().hash


@pytest.mark.parametrize(
    ("changed", "expected"),
    [
        ({"trailer_mass": '"24 m"'}, "values.trailer_mass: '24 m' does not fit"),
        ({"trailer_mas": "1.0"}, "values.trailer_mas: 'semitrailer' has no parameter 'trailer_mas'"),
    ],
)
def test_parameter_file_errors_name_that_file(load, tmp_path, changed, expected):
    (tmp_path / "mine.toml").write_text(_parameter_file(**changed))
    with pytest.raises(UserError) as caught:
        load(("ziaukas_2023", "mine.toml"))
    assert f"mine.toml: {expected}" in str(caught.value)


def test_missing_value_is_named(load, tmp_path):
    text = _parameter_file().replace("friction = 0.9\n", "")
    (tmp_path / "mine.toml").write_text(text)
    with pytest.raises(UserError, match=r"plant\.parameters: parameter set 'mine\.toml' gives no value for friction"):
        load(("ziaukas_2023", "mine.toml"))
    assert (
        load(("ziaukas_2023", "mine.toml"), append="[plant.values]\nfriction = 0.7\n").plant.values["friction"] == 0.7
    )


def test_specs_are_frozen(load):
    study = load()
    with pytest.raises(dataclasses.FrozenInstanceError):
        study.plant.step = 1.0


@pytest.mark.parametrize("path", sorted((ROOT / "studies").glob("*.toml")), ids=lambda p: p.stem)
def test_studies_of_the_project_load(path):
    study = load_study(path)
    assert study.name == path.stem
    assert study.title.endswith("?")


def test_mass_study_is_that_of_the_thesis():
    study = load_study(ROOT / "studies" / "mass.toml")
    level, band = study.designs
    assert level.factors[0].levels == tuple(1000.0 * m for m in (8, 12, 16, 20, 24, 28, 32))
    assert level.repeats == 20
    assert len(study.drives) == 6
    assert study.belief.values["trailer_mass"] == 24000.0
    assert band.factors[0].lower == pytest.approx([0.95 * m for m in level.factors[0].levels])
    assert {e.kind for e in study.estimators} == set(registry.names("harness.estimators"))


def test_schema_describes_every_key_and_is_valid_json(tmp_path):
    schema = json.loads(write_schema(tmp_path / "study.schema.json").read_text())
    assert schema == study_schema()
    assert set(schema["required"]) == {"name", "targets", "plant", "estimator", "design"}
    for table in [schema, *schema["$defs"].values()]:
        for key, entry in table["properties"].items():
            assert "description" in entry, key


def test_study_copied_elsewhere_has_the_same_hash(tmp_path):
    shutil.copytree(ROOT / "studies", tmp_path / "studies")
    assert load_study(tmp_path / "studies" / "mass.toml").hash == load_study(ROOT / "studies" / "mass.toml").hash


def _documented(heading: str) -> set[str]:
    """Return the keys in the table of docs/studies.md under a heading."""
    section = (ROOT / "docs" / "studies.md").read_text().split(f"\n### {heading}\n")[1].split("\n#")[0]
    rows = [line.split("|")[1] for line in section.splitlines() if line.startswith("| `")]
    return {key.strip(" `") for row in rows for key in row.split(",")}


@pytest.mark.parametrize(
    ("heading", "table"),
    [
        ("Top level", None),
        ("`[plant]` and `[belief]`", "ModelTable"),
        ("`[[design]]`", "DesignTable"),
        ("`[[design.factor]]`", "FactorTable"),
        ("`[report]`", "ReportTable"),
        ("`[history]` or `[[history]]`", "HistoryTable"),
    ],
)
def test_documentation_has_every_key_and_no_other(heading, table):
    schema = study_schema()
    keys = set(schema["properties"] if table is None else schema["$defs"][table]["properties"])
    if table == "ModelTable":
        noise = schema["$defs"]["NoiseTable"]["properties"]
        keys = keys - {"values", "noise"} | {"values.<parameter>"}
        keys |= {f"noise.{k}{'' if 'scale' in k else {'process': '.<state>'}.get(k, '.<output>')}" for k in noise}
    documented = {key.strip("[]") for key in _documented(heading)}
    assert documented == keys


def test_ten_line_study_of_the_documentation_loads(tmp_path):
    text = (ROOT / "docs" / "studies.md").read_text()
    blocks = [b.split("```")[0] for b in text.split("```toml\n")[1:]]
    study, tyre, joint = blocks
    assert len(study.strip().splitlines()) == 10
    shutil.copytree(ROOT / "studies" / "drives", tmp_path / "drives")
    path = tmp_path / "friction.toml"
    limits, design = joint.split("\n\n", 1)
    path.write_text(study.replace("drives =", f"{limits}\ndrives =") + tyre + design)
    loaded = load_study(path)
    assert [d.name for d in loaded.designs] == ["level", "tyre", "joint"]
    assert loaded.limits == {"lateral_force_axle_21": 5000.0}
    assert loaded.design("tyre").band_labels == ("±10 %", "±20 %", "±30 %")
    runs = [d.bands * d.samples * d.repeats * len(loaded.drives) for d in loaded.designs]
    assert runs == [120, 3 * 32 * 5 * 6, 256 * 4 * 6]


EFFECT = '''"""A constant push at the trailer, for tests."""
from models.contracts import Parameter
PORT = "external_lateral_force_trailer"
READS = ()
STATES = ("push_memory",)
PARAMETERS = (Parameter("push", "F", "N", -1e5, 1e5, "constant lateral force", neutral=0.0),)
def apply(e, value):
    e.derivative("push_memory", e.p("push") * 0)
    return value + e.p("push")
'''


def test_effects_are_neutral_unless_stated_and_the_belief_may_lack_them(load, tmp_path, monkeypatch):
    import models.effects

    folder = tmp_path / "effects"
    folder.mkdir()
    (folder / "test_push.py").write_text(EFFECT)
    monkeypatch.setattr(models.effects, "__path__", [*models.effects.__path__, str(folder)])
    with_effect = ('sensors = "series"', 'sensors = "series"\neffects = ["test_push"]')
    neutral = load(with_effect)
    assert neutral.plant.effects == neutral.belief.effects == ("test_push",)
    assert neutral.plant.values["push"] == 0.0
    assert neutral.plant.process_noise["push_memory"] == 0.0  # no set knows the state of an effect
    missing = load(
        with_effect,
        ("[belief]\n", "[belief]\neffects = []\n"),
        append='[plant.values]\npush = "2 kN"\n',
    )
    assert missing.plant.values["push"] == 2000.0
    assert missing.belief.effects == ()
    assert "push" not in missing.belief.values
    assert "push" not in missing.belief.model().parameter_names
    with pytest.raises(UserError, match=r"plant\.effects\[1\]: effect 'test_push' is named twice"):
        load(('sensors = "series"', 'sensors = "series"\neffects = ["test_push", "test_push"]'))


def _places(table, before=()):
    """Yield the path of every entry of nested tables and lists."""
    for key, value in table.items() if isinstance(table, dict) else enumerate(table):
        yield (*before, key)
        if isinstance(value, dict | list):
            yield from _places(value, (*before, key))


def _inline(value) -> str:
    """Write a value as TOML, tables inline."""
    if isinstance(value, dict):
        return "{" + ", ".join(f"{k} = {_inline(v)}" for k, v in value.items()) + "}"
    if isinstance(value, list):
        return "[" + ", ".join(map(_inline, value)) + "]"
    return json.dumps(value)


FULL = tomllib.loads(STUDY) | {"history": {"design": "level", "drive": "sine", "levels": {"trailer_mass": "8 t"}}}


@pytest.mark.parametrize("wrong", [True, -1.5, "8 t", "±3 %", "", [], {"a": 1}], ids=repr)
def test_a_wrong_entry_anywhere_is_refused_in_words_or_harmless(tmp_path, wrong):
    path = tmp_path / "wrong.toml"
    refusals: list[str] = []
    for place in _places(FULL):
        content = copy.deepcopy(FULL)
        inner = content
        for key in place[:-1]:
            inner = inner[key]
        inner[place[-1]] = wrong
        path.write_text("\n".join(f"{k} = {_inline(v)}" for k, v in content.items()))
        try:
            load_study(path)
        except UserError as error:
            refusals += str(error).splitlines()
    assert len(refusals) > 20
    assert [line for line in refusals if "wrong.toml: " not in line] == []
