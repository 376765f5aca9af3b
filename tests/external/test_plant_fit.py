"""Parameters of a plant of somebody else from recordings: known answers, verdicts, lost runs, refusals."""

import json
import subprocess
import sys
import tomllib

import numpy as np
import pandas as pd
import pytest

from harness.api.identification import identified_plant
from harness.common.errors import UserError
from support import fmus
from support.single_track import PLANT

TRUE = {"mass": 1.2, "yaw_inertia": 1900.0, "front_stiffness": 95.0, "rear_stiffness": 110.0}
STEP = 0.01


def recording(folder, name, seed, noise=1.0):
    """Write what the class records with the true values; steering in rad, speed in m/s."""
    rng, t = np.random.default_rng(seed), np.arange(0, 30, STEP)
    angle = 30 * np.sin((0.5 + 0.1 * seed) * t) * np.clip((t - 1) / 2, 0, 1)
    speed = 60 + 10 * np.sin(0.1 * t)
    there: dict = {}
    exec(PLANT, there)
    plant = there["Plant"]()
    plant.reset(TRUE)
    rows = [
        plant.step({"steering_wheel_angle": a, "speed": v, "side_force": 0.0}, STEP)
        for a, v in zip(angle, speed, strict=True)
    ]
    columns = {"time": t, "steering_wheel_angle": np.radians(angle), "speed": speed / 3.6}
    columns["yaw_rate"] = np.radians([r["yaw_rate"] for r in rows]) + noise * 2e-3 * rng.standard_normal(len(t))
    columns["lateral_acceleration"] = [r["lateral_acceleration"] for r in rows] + noise * 0.05 * rng.standard_normal(
        len(t)
    )
    pd.DataFrame(columns).to_csv(folder / name, index=False)
    return folder / name


@pytest.fixture
def drives(tmp_path, monkeypatch):
    (tmp_path / "my_plant.py").write_text(PLANT)
    monkeypatch.chdir(tmp_path)
    return [recording(tmp_path, f"{name}.csv", seed) for name, seed in (("a", 1), ("b", 2))]


PLANTS = {"python": "my_plant:Plant"}
FREE = ["yaw_inertia", "front_stiffness", "rear_stiffness"]


def test_least_squares_recover_values_within_their_intervals(drives, tmp_path):
    fit = identified_plant(PLANTS, drives[0], FREE, test=drives[1], jobs=2)
    wanted = {"yaw_inertia": 1900.0, "front_stiffness": 95e3, "rear_stiffness": 110e3}
    for name, value in wanted.items():
        row = fit.estimates.loc[name]
        assert row.verdict == "determined"
        assert abs(row.value - value) < 3.0 * row.standard_error
        assert row.standard_error < 0.02 * value
    after = fit.errors.loc[("b", "yaw_rate")]
    assert after.held_out
    assert after.simulation_after < 1.02 * 2e-3 < after.simulation_before
    assert not fit.failed
    written = {p.name for p in fit.report(tmp_path / "fit", "the command")}
    assert {"plant.toml", "identify.json", "report.html", "report.pdf"} <= written
    assert json.loads((tmp_path / "fit" / "identify.json").read_text())["method"] == "least-squares"


def test_standard_errors_are_the_scatter_of_fits_to_fresh_noise(drives, tmp_path):
    """Twelve fits of the inertia with noise of their own, all else as it is."""
    source = PLANT.replace('"80 kN/rad"', '"95 kN/rad"').replace('"90 kN/rad"', '"110 kN/rad"')
    (tmp_path / "my_plant.py").write_text(source)
    values, errors = [], []
    for seed in range(3, 15):
        fit = identified_plant(PLANTS, recording(tmp_path, f"{seed}.csv", seed), ["yaw_inertia"], jobs=1).estimates
        values.append(fit.value["yaw_inertia"])
        errors.append(fit.standard_error["yaw_inertia"])
    off = (np.array(values) - 1900.0) / errors
    assert np.abs(off).max() < 3.5
    assert 0.5 < np.sqrt(np.mean(off**2)) < 1.8  # 12 draws of a normal distribution: 0.6 to 1.4 in 98 of 100 cases


def test_what_scales_together_is_confounded(drives):
    fit = identified_plant(PLANTS, drives[0], ["mass", *FREE], jobs=2)
    assert set(fit.estimates.verdict) == {"confounded"}
    ratio = fit.estimates.value["front_stiffness"] / fit.estimates.value["mass"]
    assert ratio == pytest.approx(95e3 / 1200.0, rel=0.02)


def test_a_swarm_finds_them_in_its_ranges_and_counts_lost_candidates(drives, tmp_path):
    (tmp_path / "my_plant.py").write_text(
        PLANT.replace("self.p, self.v", "assert values['yaw_inertia'] > 1200\n        self.p, self.v", 1)
    )
    free = ["yaw_inertia=1000:3000", "front_stiffness=60 kN/rad:150 kN/rad", "rear_stiffness=6e4:1.5e5"]
    settings = {"particles": 16, "iterations": 12}
    fit = identified_plant(PLANTS, drives[0], free, method="swarm", settings=settings, seed=1, jobs=2)
    assert fit._fitted.fit.after < 0.7 * fit._fitted.fit.before
    assert 1200.0 < fit.estimates.value["yaw_inertia"] < 3000.0
    assert 0 < fit._fitted.fit.further["diverged"] < fit._fitted.fit.further["evaluated"]
    assert "AssertionError" in " ".join(fit._fitted.fit.notes)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"free": ["mas"]}, "no parameter 'mas'; closest: mass"),
        ({"free": []}, "name the parameters"),
        ({"free": ["mass=1 t"]}, "write NAME=LOWER:UPPER"),
        ({"free": ["mass=1 m:2 m"]}, "mass"),
        ({"free": ["mass=2 t:1 t"]}, "nothing between"),
        ({"free": ["mass"], "method": "swarm"}, "state it as 'mass=LOWER:UPPER'"),
        ({"free": ["mass"], "method": "likelihood"}, "least-squares or swarm, not by 'likelihood'"),
        ({"free": ["mass"], "settings": {"particles": 3}}, "least-squares has none"),
        ({"plant": {"python": "my_plant:Plant", "values": {"mas": 1}}, "free": ["mass"]}, "no parameter 'mas'"),
        ({"plant": {"python": "nobodys:Plant"}, "free": ["mass"]}, "no module 'nobodys'"),
    ],
)
def test_what_cannot_be_fitted_is_refused_in_words(drives, change, words):
    task = {"plant": PLANTS, "train": drives[0], **change}
    with pytest.raises(UserError, match=words):
        identified_plant(**task)


def test_the_command_fits_a_plant_and_writes_what_a_study_takes(drives, tmp_path):
    words = ["--python", "my_plant:Plant", "--train", str(drives[0]), "--free", "yaw_inertia=1 t*m^2:3 t*m^2"]
    done = subprocess.run(
        [sys.executable, "-m", "harness", "identify", *words, "--out", str(tmp_path / "fit")],
        capture_output=True, text=True, cwd=tmp_path, check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    assert "yaw_inertia: 1500 to" in done.stdout
    plant = tomllib.loads((tmp_path / "fit" / "plant.toml").read_text())["plant"]
    assert plant["python"] == "my_plant:Plant"
    assert 1000.0 <= plant["values"]["yaw_inertia"] <= 3000.0


@fmus.needs_compiler
def test_parameters_of_an_fmu_are_found_as_those_of_the_equations(tmp_path):
    """The car of the library as FMU, on a recording of the library's own simulation with another inertia."""
    import harness as h
    from harness.config import resolve_single

    car = {"vehicle": "car", "parameters": "govindarajan_2018", "tyre": "linear", "sensors": "car_series"}
    spec = resolve_single(car, "car", "belief")
    equations = fmus.of_model(spec.model(), spec.values, ["yaw_rate", "lateral_acceleration"])
    path = fmus.make(tmp_path, equations, 2, "me")
    true = h.model("car", "govindarajan_2018", tyre="linear", sensors="car_series").replace(
        values={"yaw_inertia": 4000.0}
    )
    run = h.simulate(true, h.drive("sine", duration="20 s", amplitude="20 deg"), seed=1)
    fit = identified_plant({"fmu": str(path)}, run, ["yaw_inertia"], jobs=1)
    row = fit.estimates.loc["yaw_inertia"]
    assert row.start == pytest.approx(spec.values["yaw_inertia"])
    assert abs(row.value - 4000.0) < 4.0 * row.standard_error
    assert row.standard_error < 400.0
