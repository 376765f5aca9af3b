"""A wrong study file is refused in words that name file, key and remedy."""

from __future__ import annotations

import copy
import json
import tomllib

import pytest

from harness.common.errors import UserError
from harness.config import load_study
from support.small_study import STUDY

REFUSALS = {
    "NUL in a title": (
        [("A question?", "A\\u0000 question?")],
        "title: holds the control character U+0000 as its character 2; remove it",
    ),
    "bell in a label": (
        [('"32 t"]', '"32 t"]\nlabels = ["a", "b\\u0007", "c"]')],
        "design[0].factor[0].labels[1]: holds the control character U+0007",
    ),
    "levels alike": (
        [('"32 t"', "24000")],
        "design[0].factor[0].levels[2]: the same as [1]: 24 t; remove one of the two",
    ),
    "labels alike": (
        [('"32 t"]', '"32 t"]\nlabels = ["light", "so", "light"]')],
        "design[0].factor[0].labels[2]: 'light' is the label of [0] already; give each its own by 'labels'",
    ),
    "labels alike by their digits": (
        [('"32 t"', '"24.000000001 t"')],
        "design[0].factor[0].levels[2]: '24 t' is the label of [1] already; give each its own by 'labels'",
    ),
    "bands alike": (
        [('levels = ["8 t", "24 t", "32 t"]', 'bands = ["10 %", "+-10 %"]'), ("repeats = 2", "samples = 2")],
        "design[0].factor[0].bands[1]: the same as [0]: ±10 %; remove one of the two",
    ),
    "band with a sign": (
        [('levels = ["8 t", "24 t", "32 t"]', 'bands = ["-10 %"]')],
        "design[0].factor[0].bands[0]: a half-width has no sign, got '-10 %'",
    ),
    "step with a sign": (
        [('sensors = "series"', 'sensors = "series"\nstep = "-10 ms"')],
        "plant.step: the sample time must be positive, e.g. '10 ms', got '-10 ms'",
    ),
    "decimal comma": (
        [('"8 t"', '"24,5 t"')],
        "design[0].factor[0].levels[0]: '24,5 t' may mean '24.5 t' or '245 t'; write the one that is meant",
    ),
    "thousands separator": (
        [("[belief]\n", '[belief]\nvalues = { trailer_mass = "24 000 kg" }\n')],
        "belief.values.trailer_mass: '24 000 kg' means '24000 kg'",
    ),
    "decimal comma of a setting": (
        [('kind = "ekf"', 'kind = "ukf"\nkappa = "1_5"')],
        "estimator[0].kappa: '1_5' means '15'",
    ),
    "setting without end": ([('kind = "ekf"', 'kind = "ukf"\nkappa = inf')], "estimator[0].kappa: inf is not a finite"),
    "estimator that is no table": (
        [('[[estimator]]\nname = "EKF"\nkind = "ekf"\n', ""), ('name = "small"', 'estimator = [3]\nname = "small"')],
        "estimator[0]: expected a table with input_signal, kind, name, got 3",
    ),
    "tuning of a number": ([("seed = 0", "tuning = 3")], "tuning: input should be a valid string, got 3"),
    "tuning without a factor": (
        [('name = "small"', 'tuning = { estimator = { EKF = { process = 1 } } }\nname = "small"')],
        "tuning.estimator.EKF.measurement: this key is required",
    ),
    "drive twice": (
        [("[[drive]]", '[[drive]]\nname = "sine"\nkind = "ramp"\n[[drive]]')],
        "drive[1].name: 'sine' is the name of drive[0] already",
    ),
    "unknown key": ([("seed = 0", "sed = 0")], "sed: unknown key 'sed'; closest: seed"),
    "unknown nested key": ([("repeats = 2", "repeat = 2")], "design[0].repeat: unknown key 'repeat'; closest: repeats"),
    "unknown factor key": (
        [("levels =", "level =")],
        "design[0].factor[0].level: unknown key 'level'; closest: levels",
    ),
    "name with a blank": ([('name = "small"', 'name = "a b"')], "name: 'a b' cannot be the name of a file; use"),
    "missing name": ([('name = "small"\n', "")], "name: this key is required; add 'name'"),
    "no targets": ([('["lateral_force_axle_21", "articulation_angle"]', "[]")], "targets: is empty; give at least 1"),
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
        "drives: there is no set of drives 'robust'; closest: robustness, robustness-broad (looked in ",
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
        "design[0].factor[0]: a factor needs exactly one of levels, shift, bands, range and distribution; this one has "
        "levels and bands",
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
    "negative band": (
        '[[design]]\nname = "b"\nsamples = 4\n[[design.factor]]\nparameter = "trailer_mass"\nbands = ["-10 %"]\n',
        "design[1].factor[0].bands[0]: a half-width has no sign, got '-10 %'; leave it out, or",
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


def test_a_negative_step_is_reported_once_and_not_as_negative_variances(refused):
    lines = refused(("[plant]\n", '[plant]\nstep = "-10 ms"\n'))
    assert lines == ["plant.step: the sample time must be positive, e.g. '10 ms', got '-10 ms'"]


def test_toml_errors_name_the_line(refused):
    assert "line 3" in refused(("seed = 0", "seed = "))[0]


def test_factors_that_cross_may_repeat_their_levels(tmp_path):
    crossed = STUDY.replace('["8 t", "24 t", "32 t"]', '["8 t", "8 t", "24 t"]')
    crossed += '[[design.factor]]\nparameter = "stiffness_load_2"\nlevels = [60000, 65000, 60000]\n'
    (tmp_path / "s.toml").write_text(crossed)
    assert load_study(tmp_path / "s.toml").designs[0].bands == 3


def test_missing_file_suggests_the_closest(tmp_path):
    (tmp_path / "mass.toml").write_text(STUDY)
    with pytest.raises(UserError, match=r"mas\.toml: there is no such file; closest: mass\.toml"):
        load_study(tmp_path / "mas.toml")


def test_other_than_utf8_is_refused(tmp_path):
    path = tmp_path / "a.toml"
    path.write_bytes(b'name = "\xff"')
    with pytest.raises(UserError, match="not UTF-8 text"):
        load_study(path)


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
