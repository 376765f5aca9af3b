"""Estimators and plants as FMUs: FMPy validates and runs them, and the harness takes them back."""

import dataclasses
import subprocess
import tomllib
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from harness.cli.main import app
from harness.common.errors import UserError
from harness.common.files import write_files
from harness.config import build_study
from harness.external.fmu.model import platform_of, read_model
from harness.models.roles import VEHICLES
from harness.realtime.export import run
from harness.realtime.export.fmi.archive import binary_place, fmu, sources
from harness.realtime.export.fmi.component import of_a_plant, of_estimator
from harness.realtime.export.fmi.description import compiled_files
from harness.realtime.export.monitor import Monitor
from harness.realtime.export.plant import printed_plant
from harness.realtime.export.steps import WARNINGS
from harness.simulation.drives import profile_of
from harness.simulation.simulate import simulate_drive
from harness.study.design import units
from harness.study.evaluate import StudyEvaluator
from support.exports import COMPILER, made
from support.fmu_instance import Slave
from support.observers import CONTENT, needs_compiler

fmpy = pytest.importorskip("fmpy", reason="FMPy is not installed")

pytestmark = needs_compiler

EKF = {"name": "EKF", "kind": "ekf"}
STEP = 0.01
VERSIONS = pytest.mark.parametrize("version", [2, 3])


def study_of(folder, **changes):
    return build_study({**CONTENT, "estimator": [EKF], **changes}, folder / "study.toml")


@pytest.fixture(scope="module")
def exported(tmp_path_factory):
    return run.export(study_of(tmp_path_factory.mktemp("study")), None, "double", None, (None, 3.0))


@pytest.fixture(scope="module")
def estimator(exported):
    return of_estimator(exported.export, True, exported.inputs[0].tolist())


@pytest.fixture(scope="module")
def plant(tmp_path_factory):
    return of_a_plant(printed_plant(study_of(tmp_path_factory.mktemp("plant"))))


def written(component, version, folder):
    content, has_binary = fmu(component, version)
    assert has_binary
    path = folder / f"{component.name}.fmu"
    path.write_bytes(content)
    return path


INPUTS = {"steering_wheel_angle": 0.1, "speed": 15.0}
ESTIMATES = ("estimate_lateral_velocity", "estimate_yaw_rate", "deviation_lateral_velocity", "nis")


@VERSIONS
def test_the_c_compiles_without_a_word_and_beside_the_headers_of_the_standard(version, tmp_path, estimator, plant):
    headers = Path(fmpy.__file__).parent / "c-code"
    for component in (estimator, plant):
        folder = tmp_path / component.name
        write_files(folder, sources(component, version))
        for name in compiled_files(component, version):
            subprocess.run([COMPILER, *WARNINGS, "-c", name], cwd=folder, check=True)
        standard = ["-std=c11", "-Werror", f"-I{headers}", "-include", f"fmi{version}Functions.h"]
        subprocess.run([COMPILER, *standard, "-c", f"fmi{version}.c"], cwd=folder, check=True)


LIFE = """#include "fmi@.c"

int main(void) {
    callbacks importer = {0};
    instance *c;
    void *state = NULL, *again = NULL;
    static char octets[sizeof(memory)];
    if (instantiated(importer, "other") != NULL || (c = instantiated(importer, MODEL_TOKEN)) == NULL) {
        return 1;
    }
    if (enter_initialization(c, 5.0) || exit_initialization(c) || enter_initialization(c, 0.0) != IS_ERROR) {
        return 2;
    }
    for (int k = 0; k < 500; k++) {
        if (advance(c, 5.0 + k * MODEL_STEP, MODEL_STEP) != IS_OK) {
            return 3;
        }
    }
    if (place(c, VARIABLES, 'r') || place(c, TIME, 'b') || room(c, TIME, 'r') || *place(c, TIME, 'r') < 9.99) {
        return 4;
    }
    if (kept(c, &c->now, sizeof c->now, &state) || written(c, state, octets, sizeof octets)) {
        return 5;
    }
    if (kept(c, octets, sizeof octets, &again) || restored(c, again) || !kept(c, octets, 3, &again)) {
        return 6;
    }
    free(state);
    free(again);
    restart(c);
    free(c);
    return 0;
}
"""


@VERSIONS
def test_sanitizers_are_silent_over_a_life(version, tmp_path, estimator, plant):
    flags = ["-std=c99", "-g", "-fsanitize=address,undefined", "-fno-sanitize-recover=all"]
    for component in (estimator, plant):
        folder = tmp_path / component.name
        write_files(folder, {**sources(component, version), "life.c": LIFE.replace("@", str(version))})
        files = [name for name in component.files if name.endswith(".c")]
        subprocess.run([COMPILER, *flags, "life.c", *files, "-o", "life", "-lm"], cwd=folder, check=True)
        assert subprocess.run(["./life"], cwd=folder, check=False).returncode == 0


@VERSIONS
def test_fmpy_finds_no_fault_and_simulates_what_the_harness_estimated(version, tmp_path, exported, estimator):
    from fmpy.validation import validate_fmu

    path = written(estimator, version, tmp_path)
    assert validate_fmu(str(path)) == []
    names = [q.name for q in (*exported.export.interface.inputs, *exported.export.interface.measurements)]
    lines = exported.files["replay.csv"].splitlines()
    places = [lines[0].split(",").index(name) for name in names]
    table = np.array([[float(line.split(",")[i]) for i in places] for line in lines[1:]])
    # At the end of a step are the estimates of what was set before it; FMPy sets what is of its beginning.
    series = np.zeros(len(table) - 1, dtype=[("time", float), *((n, float) for n in names)])
    series["time"] = STEP * np.arange(len(series))
    for i, name in enumerate(names):
        series[name] = table[1:, i]
    first = dict(zip(names, table[0], strict=True))
    result = fmpy.simulate_fmu(
        str(path), stop_time=STEP * len(series), output_interval=STEP, input=series, fmi_type="CoSimulation",
        start_values={n: first[n] for n in INPUTS}, output=ESTIMATES,
    )  # fmt: skip
    history = exported.history
    assert len(result) == len(table)
    # input at 0 is of sample 1 as well, which only the estimate of the first sample would show
    for i, name in enumerate(("lateral_velocity", "yaw_rate")):
        scale = np.abs(history.estimate[:, i]).max()
        np.testing.assert_allclose(
            result[f"estimate_{name}"][1:], history.estimate[1:, i], rtol=0, atol=1e-9 * scale, err_msg=name
        )


@VERSIONS
def test_a_study_has_the_scores_of_the_library_in_c_to_the_bit(version, tmp_path, exported, estimator):
    write_files(tmp_path, exported.files)
    made(tmp_path, "all")
    written(estimator, version, tmp_path)
    targets = ["lateral_velocity", "yaw_rate"]
    (tmp_path / "map.toml").write_text("[estimates]\n" + "".join(f'{n} = "estimate_{n}"\n' for n in targets))
    (library,) = tomllib.loads((tmp_path / "estimator.toml").read_text())["estimator"]
    shared = {**library, "variances": False, "nis": False}
    del shared["library"]
    own = {"name": "fmu", "fmu": f"{exported.export.name}.fmu", "settings": {"map": "map.toml"}}
    both = [{**shared, "name": "C", "library": library["library"]}, {**shared, **own}]
    gaps = {**CONTENT["plant"], "effects": ["dropout"], "values": {"dropout_share": 0.2}}
    results = scores(study_of(tmp_path, estimator=both, plant=gaps, belief=CONTENT["plant"]))
    for name in ("rmse", "max_error", "status"):
        library, own = np.moveaxis(results[name], 2, 0)
        assert np.isfinite(library).all()
        np.testing.assert_array_equal(own, library, err_msg=name)


def scores(study):
    evaluator = StudyEvaluator(study)
    results = [evaluator.evaluate(unit) for design in study.designs for unit in units(study, design)]
    assert evaluator.lost() == []
    return {name: np.concatenate([r[name] for r in results]) for name in results[0]}


@VERSIONS
def test_what_a_step_may_be(version, tmp_path, estimator):
    path = written(estimator, version, tmp_path)
    slave = Slave(path).begin(**INPUTS)
    for size, word in ((0.5 * STEP, "no multiple of 0.01"), (1.5 * STEP, "no multiple"), (0.0, "no multiple")):
        with pytest.raises(Exception, match="error"):  # FMPy repeats what is discarded for ever
            slave.step(0.0, size)
        assert word in slave.words[-1]
    with pytest.raises(Exception, match="error"):
        slave.step(5 * STEP)
    assert "begin at 0.05 s, but the instance is at 0 s" in slave.words[-1]
    slave.set(yaw_rate=0.02)
    slave.step(0.0, 3 * STEP)
    own = Slave(path).begin(**INPUTS)
    own.step(0.0)
    own.step(STEP)
    own.set(yaw_rate=0.02)
    own.step(2 * STEP)
    assert slave.get(*ESTIMATES) == own.get(*ESTIMATES)
    assert own.get("nis")[0] > 0.0
    slave.set(speed=float("nan"))
    with pytest.raises(Exception, match="error"):
        slave.step(3 * STEP)
    assert slave.words[-1] == "is no number: speed"


@VERSIONS
def test_a_measurement_is_missing_where_it_is_no_number_or_said_to_be(version, tmp_path, estimator):
    path = written(estimator, version, tmp_path)
    told = {}
    for case, given in {
        "there": {"yaw_rate": 0.3, "lateral_acceleration": 1.0},
        "no number": {"yaw_rate": 0.3, "lateral_acceleration": float("nan")},
        "not valid": {"yaw_rate": 0.3, "lateral_acceleration": 1.0, "valid_lateral_acceleration": False},
    }.items():
        slave = Slave(path).begin(**INPUTS)
        slave.set(**given)
        slave.step(0.0)
        told[case] = slave.get(*ESTIMATES)
    assert told["no number"] == told["not valid"]
    assert told["there"] != told["not valid"]


@VERSIONS
def test_a_state_is_kept_and_goes_on(version, tmp_path, estimator):
    path = written(estimator, version, tmp_path)
    slave = Slave(path).begin(**INPUTS)
    slave.set(yaw_rate=0.02)
    slave.step(0.0)
    state = slave.fmu.getFMUstate() if version == 2 else slave.fmu.getFMUState()
    octets = slave.fmu.serializeFMUstate(state) if version == 2 else slave.fmu.serializeFMUState(state)
    slave.step(STEP)
    wanted = slave.get(*ESTIMATES)
    other = Slave(path)
    if version == 2:
        other.fmu.setFMUstate(other.fmu.deSerializeFMUstate(octets))
    else:
        other.fmu.setFMUState(other.fmu.deserializeFMUState(octets))
    other.step(STEP)
    assert other.get(*ESTIMATES) == wanted
    with pytest.raises(Exception, match="error"):
        (other.fmu.deSerializeFMUstate if version == 2 else other.fmu.deserializeFMUState)(octets[:-1])
    assert other.words[-1] == "is no state of this model"


@VERSIONS
def test_parameters_are_fixed_once_initialised_and_another_token_is_refused(version, tmp_path, estimator):
    path = written(estimator, version, tmp_path)
    heavy, usual = Slave(path), Slave(path).begin(**INPUTS)
    heavy.set(mass=2400.0)
    heavy.begin(**INPUTS)
    for slave in (heavy, usual):
        slave.step(0.0, 100 * STEP)
    assert heavy.get(*ESTIMATES) != usual.get(*ESTIMATES)
    with pytest.raises(Exception, match="error"):
        heavy.set(mass=1000.0)
    assert "fixed once initialised; reset, then set it: mass" in heavy.words[-1]
    heavy.fmu.reset()
    heavy.begin(**INPUTS).step(0.0, 100 * STEP)
    assert heavy.get(*ESTIMATES) == usual.get(*ESTIMATES)
    with pytest.raises(Exception, match="instantiate"):
        Slave(path, "{of another}")


@VERSIONS
@pytest.mark.parametrize("of", ["estimator", "plant"])
def test_what_a_parameter_cannot_be_is_refused(version, of, tmp_path, request):
    component = request.getfixturevalue(of)
    path = written(component, version, tmp_path)
    described = {v.name: v for v in fmpy.read_model_description(str(path)).modelVariables}
    (mass,) = (p for p in VEHICLES.load(CONTENT["plant"]["vehicle"]).PARAMETERS if p.name == "mass")
    assert (float(described["mass"].min), float(described["mass"].max)) == (mass.lower, mass.upper)
    refused = {"mass": -1.0, "cog_to_front_axle": 1e3}
    if of == "estimator":
        refused["measurement_noise.yaw_rate"] = -1e-4
        assert float(described["measurement_noise.yaw_rate"].min) == 0.0
    for name, value in refused.items():
        slave = Slave(path)
        slave.set(**{name: value})
        with pytest.raises(Exception, match="error"):
            slave.begin(**INPUTS)
        assert slave.words[-1].startswith(f"{name} = {value:g}, which may be ")
    for value in (mass.lower, mass.upper):
        slave = Slave(path)
        slave.set(mass=value)
        slave.begin(**INPUTS)


@VERSIONS
def test_a_plant_drives_as_the_harness_simulates_it(version, tmp_path, plant):
    from fmpy.validation import validate_fmu

    study = study_of(tmp_path)
    path = written(plant, version, tmp_path)
    assert validate_fmu(str(path)) == []
    profile = profile_of(study.plant, study.drives[0])
    names = ["yaw_rate", "lateral_velocity", "lateral_acceleration"]
    wanted = simulate_drive(study.plant, profile, names)
    slave, told = Slave(path), []
    steering, speed = profile.steering_wheel_angle, profile.speed
    slave.begin(steering_wheel_angle=steering[0], speed=speed[0])
    for k in range(len(profile.time)):
        slave.set(steering_wheel_angle=steering[k], speed=speed[k])
        told.append(slave.get(*names))
        slave.step(k * STEP)
    for i, name in enumerate(names):
        truth = wanted[f"true_{name}" if f"true_{name}" in wanted else name].values
        assert np.abs(truth).max() > 0.01
        np.testing.assert_allclose(np.array(told)[:, i], truth, rtol=0, atol=1e-12 * np.abs(truth).max())


@VERSIONS
def test_a_study_of_the_exported_plant_has_the_scores_of_the_plant(version, tmp_path, plant):
    written(plant, version, tmp_path)
    spec = study_of(tmp_path, plant={**CONTENT["plant"], "noise": {"process_scale": 0}}, belief=CONTENT["plant"])
    foreign = study_of(tmp_path, plant={"fmu": f"{plant.name}.fmu", "sensors": "car_series"}, belief=CONTENT["plant"])
    own, theirs = scores(spec), scores(foreign)
    for name in ("rmse", "max_error", "nis", "status"):
        assert np.isfinite(own[name]).all()
        np.testing.assert_allclose(theirs[name], own[name], rtol=1e-9, atol=1e-12, err_msg=name)


def test_sensors_of_an_exported_plant_are_not_degraded(tmp_path, plant):
    gaps = study_of(tmp_path, plant={**CONTENT["plant"], "effects": ["dropout"]}, belief=CONTENT["plant"])
    degraded = of_a_plant(printed_plant(gaps))
    assert degraded.variables == plant.variables
    assert degraded.files[f"{plant.name}.c"] == plant.files[f"{plant.name}.c"]


@VERSIONS
def test_a_monitor_has_its_outputs(version, tmp_path):
    study = study_of(tmp_path)
    bare = run.export(study, recorded=(None, 3.0))
    face, wide = bare.export.interface, (-1e6, 1e6)
    ranges = {
        g: dict.fromkeys((q.name for q in getattr(face, g)), wide) for g in ("inputs", "measurements", "estimates")
    }
    rates = dict.fromkeys(ranges["inputs"], wide)
    ranges["inputs"] = {**ranges["inputs"], "steering_wheel_angle": (-0.2, 0.2)}  # it goes to 0.35 rad
    bias = dict.fromkeys(ranges["measurements"], 3.0)
    monitor = Monitor(study.hash, "EKF", STEP, 50, 0.5, (-5.0, 5.0), bias, rates=rates, says=["Often."], **ranges)
    (tmp_path / "monitor.toml").write_text(monitor.text)
    watched = run.export(study, recorded=(None, 3.0), monitor=tmp_path / "monitor.toml")
    slave = Slave(written(of_estimator(watched.export, True, watched.inputs[0].tolist()), version, tmp_path))
    head, *lines = watched.files["replay.csv"].splitlines()
    rows = [dict(zip(head.split(","), map(float, line.split(",")), strict=True)) for line in lines]
    slave.begin(**{n: rows[0][n] for n in INPUTS})
    told = []
    for k, row in enumerate(rows[1:]):
        slave.set(**{n: row[n] for n in (*INPUTS, "yaw_rate", "lateral_acceleration")})
        slave.step(k * STEP)
        told.append(slave.whole("trust", "reasons"))
    assert told == [[row["trust"], row["reasons"]] for row in rows[1:]]
    assert {trust for trust, _ in told} >= {0, 1}


@VERSIONS
def test_this_machine_is_called_as_fmpy_calls_it(version, monkeypatch):
    assert binary_place(version) == platform_of(version)
    monkeypatch.setattr("platform.machine", lambda: "vax")
    with pytest.raises(UserError, match="no name for binaries of"):
        binary_place(version)


def test_without_a_compiler_there_are_the_sources(tmp_path, monkeypatch, estimator):
    monkeypatch.setattr("shutil.which", lambda name: None)
    content, has_binary = fmu(estimator, 3)
    assert not has_binary
    path = tmp_path / "sources.fmu"
    path.write_bytes(content)
    assert read_model(path).has_sources
    with pytest.raises(UserError, match="C code only"):
        read_model(path).library("co-simulation")


def test_the_same_fmu_has_the_same_description_and_another_belief_another_token(exported, estimator):
    first = exported.inputs[0].tolist()
    assert estimator.token == of_estimator(exported.export, True, first).token
    values = {**exported.export.variances, "first": [0.1, 0.0]}
    assert estimator.token != of_estimator(dataclasses.replace(exported.export, variances=values), True, first).token


def test_the_command_writes_them(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "car.toml").write_text(study_of(tmp_path).text)
    done = CliRunner().invoke(app, ["export", "car.toml", "--plant", "--fmi", "3", "--out", "plant"])
    assert done.exit_code == 0, done.output
    assert {p.name for p in (tmp_path / "plant").iterdir()} == {f"foreign_plant.{e}" for e in ("h", "c", "fmu")}
    assert read_model(tmp_path / "plant/foreign_plant.fmu").version == 3
    done = CliRunner().invoke(app, ["export", "car.toml", "--plant", "-e", "EKF"])
    assert done.exit_code == 2
    assert "--plant: has no --estimator" in done.output
