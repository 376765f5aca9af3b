"""A study file is read, inherited and converted as docs/studies.md says."""

from __future__ import annotations

import dataclasses
import tomllib
from pathlib import Path

import numpy as np
import pytest

from harness.common.errors import UserError
from harness.config import StudyFile, build_study, load_study
from harness.models.roles import PARAMETERS
from support.small_study import STUDY

SET = PARAMETERS.load("ziaukas_2023")


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


def test_estimators_by_their_kinds_alone(load, tmp_path):
    text = STUDY.replace('[[estimator]]\nname = "EKF"\nkind = "ekf"\n', "")
    assert "estimator" not in tomllib.loads(text)
    path = tmp_path / "kinds.toml"
    path.write_text(f'estimator = ["ekf", {{ kind = "ukf", name = "mine" }}]\n{text}')
    kinds, tables = load_study(path), load(append='[[estimator]]\nkind = "ukf"\nname = "mine"\n')
    assert [(e.name, e.kind) for e in kinds.estimators] == [("ekf", "ekf"), ("mine", "ukf")]
    assert kinds.estimators[1] == tables.estimators[1]


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


def test_a_band_of_nothing_is_the_believed_value_beside_its_bands(load):
    banded = ('levels = ["8 t", "24 t", "32 t"]', 'bands = ["0 %", "10 %"]'), ("repeats = 2", "samples = 4")
    (factor,) = load(*banded).designs[0].factors
    assert (factor.lower, factor.upper) == ((24000.0, 21600.0), (24000.0, 26400.0))
    assert factor.labels == ("±0 %", "±10 %")


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


def test_sobol_any_n_allows_the_thesis_20_points(load):
    study = load(("levels =", 'band = "5 %"\nlevels ='), ("repeats = 2", "samples = 20\nsobol_any_n = true"))
    assert study.designs[0].samples == 20


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
    says = (
        r"plant\.parameters: parameter set 'mine\.toml' gives no value for friction; add them to "
        r"\[values\] of mine\.toml, or as \[plant\.values\]"
    )
    with pytest.raises(UserError, match=says):
        load(("ziaukas_2023", "mine.toml"))
    assert (
        load(("ziaukas_2023", "mine.toml"), append="[plant.values]\nfriction = 0.7\n").plant.values["friction"] == 0.7
    )


def test_specs_are_frozen(load):
    study = load()
    with pytest.raises(dataclasses.FrozenInstanceError):
        study.plant.step = 1.0


EFFECT = '''"""A constant push at the trailer, for tests."""
from harness.models.contracts import Parameter
PORT = "external_lateral_force_trailer"
READS = ()
STATES = ("push_memory",)
PARAMETERS = (Parameter("push", "F", "N", -1e5, 1e5, "constant lateral force", neutral=0.0),)
def apply(e, value):
    e.derivative("push_memory", e.p("push") * 0)
    return value + e.p("push")
'''


def test_effects_are_neutral_unless_stated_and_the_belief_may_lack_them(load, tmp_path, monkeypatch):
    import harness.models.effects

    folder = tmp_path / "effects"
    folder.mkdir()
    (folder / "test_push.py").write_text(EFFECT)
    monkeypatch.setattr(harness.models.effects, "__path__", [*harness.models.effects.__path__, str(folder)])
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


def test_a_study_built_in_python_is_the_one_of_its_file(load):
    from_file = load()
    content = tomllib.loads(STUDY)
    built = build_study(content, from_file.path)
    assert dataclasses.replace(built, text="") == dataclasses.replace(from_file, text="")
    assert load(text=built.text).hash == from_file.hash
    assert build_study(StudyFile.model_validate(content)).text == built.text
    assert content == tomllib.loads(STUDY)


def test_a_study_built_in_python_takes_numbers_of_numpy_and_says_only_what_was_stated():
    content = tomllib.loads(STUDY)
    content["design"][0]["factor"][0]["levels"] = list(np.linspace(8e3, 32e3, 3))
    built = build_study(content)
    assert built.designs[0].factors[0].levels == (8e3, 20e3, 32e3)
    assert "levels = [8000.0, 20000.0, 32000.0]" in built.text
    assert "limits" not in built.text


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"sed": 1}, "my study: sed: unknown key 'sed'; closest: seed"),
        ({"targets": ["speeed"]}, r"my study: targets\[0\]: .*'speeed'"),
        (
            {"drive": [{"name": "a", "kind": "sine", "speed": object()}]},
            "my study: contains what a study file cannot represent",
        ),
    ],
)
def test_a_study_built_in_python_is_refused_like_a_file(change, message):
    with pytest.raises(UserError, match=message):
        build_study(tomllib.loads(STUDY) | change, "my study")


def test_a_study_may_begin_with_a_byte_order_mark(load):
    assert load(text="\ufeff" + STUDY).hash == load().hash


def test_a_byte_order_mark_is_no_part_of_a_study(tmp_path):
    for encoding in ("utf-8", "utf-8-sig"):
        (tmp_path / f"{encoding}.toml").write_text(STUDY, encoding=encoding)
    plain, marked = (load_study(tmp_path / f"{encoding}.toml") for encoding in ("utf-8", "utf-8-sig"))
    assert marked.hash == plain.hash
    assert marked.text == plain.text


def test_control_characters_are_refused_in_studies_made_in_python():
    with pytest.raises(UserError, match=r"study: title: holds the control character U\+0001"):
        build_study({**tomllib.loads(STUDY), "title": "a\x01"})


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ("repeats = 2", "repeats = 1_000_000_000_000_000_000", "3e+18 runs, at most 1e+09 can be planned; the design"),
        ('repeats = 2\n[[design.factor]]\nparameter = "trailer_mass"\nlevels = ["8 t", "24 t", "32 t"]',
         'samples = 0x10000000000\n[[design.factor]]\nparameter = "trailer_mass"\nrange = ["8 t", "24 t"]',
         "1.1e+12 runs, at most 1e+09 can be planned"),
        ('["8 t", "24 t", "32 t"]', str([20_000 + i for i in range(1001)]), "levels: list should have at most 1000"),
    ],
)  # fmt: skip
def test_sizes_are_counted_from_the_file(tmp_path, old, new, said):
    assert old in STUDY
    (tmp_path / "a.toml").write_text(STUDY.replace(old, new))
    with pytest.raises(UserError) as error:
        load_study(tmp_path / "a.toml")
    assert said in str(error.value)
