"""Studies on a graphics card, which numba's simulator stands in for: kernels run as Python, a thread for each run."""

import dataclasses
import importlib.util
import json
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
import xarray as xr
from typer.testing import CliRunner

from harness.cli.main import app
from harness.common.errors import UserError
from harness.config import load_study
from harness.study import devices
from harness.study.design import Unit
from harness.study.evaluate import StudyEvaluator

STUDY = """
name = "tiny"
title = "Is a card as good as a processor?"
seed = 5
targets = ["lateral_velocity"]
drive = [{ name = "sine", kind = "sine", amplitude = "40 deg", duration = "1 s", lead_in = "0 s", speed = "18 m/s" }]
estimator = [
  { name = "KF", kind = "kf" }, { name = "EKF", kind = "ekf" }, { name = "UKF", kind = "ukf" },
  { name = "CDKF", kind = "cdkf" },
]
[plant]
vehicle = "car"
parameters = "govindarajan_2018"
tyre = "magic_formula"
sensors = "car_series"
step = "0.05 s"
[[design]]
name = "mass"
sampling = "sobol"
samples = 2
repeats = 2
factor = [
  { parameter = "mass", range = ["1.2 t", "2 t"] },
  { parameter = "measurement_noise_scale", range = [0.1, 10], scale = "log" },
]
"""


def simulated(*arguments: str) -> subprocess.CompletedProcess[str]:
    """Run the command line where numba simulates a card."""
    return subprocess.run(
        [sys.executable, "-W", "ignore", "-m", "harness", *arguments],
        capture_output=True, text=True, env={**os.environ, "NUMBA_ENABLE_CUDASIM": "1"}, check=False,
    )  # fmt: skip


def simulated_script(*arguments: str, script: str) -> None:
    """Run Python where numba simulates a card; ``card`` is the study's there."""
    begin = """
import dataclasses, sys, threading
import numpy as np
from harness.config import load_study
from harness.engine import further_processes
from harness.study.design import Unit
from harness.study.evaluate import StudyEvaluator
from harness.study.run import compile_kernels
from harness.cuda.on_card import CardEvaluator

study = dataclasses.replace(load_study(sys.argv[1]), device="cuda")
card = CardEvaluator(StudyEvaluator(study))
"""
    run = subprocess.run(
        [sys.executable, "-W", "ignore", "-c", begin + script, *arguments],
        capture_output=True, text=True, env={**os.environ, "NUMBA_ENABLE_CUDASIM": "1"}, check=False,
    )  # fmt: skip
    assert run.returncode == 0, run.stderr


@pytest.fixture(scope="module")
def finished(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Path, subprocess.CompletedProcess[str]]:
    folder = tmp_path_factory.mktemp("card")
    study = folder / "tiny.toml"
    study.write_text(STUDY)
    return study, folder / "out", simulated("run", str(study), "--device", "cuda", "--out", str(folder / "out"))


def test_a_card_gives_the_scores_of_the_processor(finished) -> None:
    study, out, run = finished
    assert run.returncode == 0, run.stderr
    assert (out / "report.html").exists()
    found = xr.open_datatree(out / "scores.zarr", engine="zarr")["mass"]
    wanted = StudyEvaluator(load_study(study)).evaluate(Unit(0, 0, 0, 0, 2))
    for name, values in wanted.items():
        got = np.asarray(found[name])[0].squeeze(axis=1)
        np.testing.assert_allclose(got, values, rtol=1e-9, err_msg=name)
    assert np.isfinite(wanted["rmse"]).all()
    assert (wanted["updates"] == 20).all()
    assert json.loads((out / "run.json").read_text())["device"]


def test_what_is_there_is_not_computed_again_and_verified_on_a_card(finished) -> None:
    study, out, _ = finished
    again = simulated("run", str(study), "--device", "cuda", "--out", str(out))
    assert again.returncode == 0
    assert "4 of 4 runs are in" in again.stderr
    verified = simulated("verify", str(out), "--study", str(study))
    assert verified.returncode == 0
    assert "the same bits" in verified.stdout + verified.stderr


def test_the_next_units_are_prepared_while_the_card_computes(tmp_path) -> None:
    study = tmp_path / "tiny.toml"
    start, end = STUDY.index("estimator = ["), STUDY.index("[plant]")
    text = f'{STUDY[:start]}estimator = [{{ name = "EKF", kind = "ekf" }}]\n{STUDY[end:]}'
    study.write_text(text.replace("samples = 2", "samples = 16"))
    simulated_script(
        str(study),
        script="""
parts = [Unit(0, 0, 0, first, first + 4) for first in (0, 4, 8)]
wanted = [next(card.evaluate([unit]))[1] for unit in parts]
prepare, compute, prepared = card._prepared, card._computed, []
further = threading.Event()

def preparing(drive, units):
    prepared.append(units)
    if len(prepared) == 2:
        further.set()
    return prepare(drive, units)

def computing(batch):
    assert further.wait(60), "nothing was prepared meanwhile"
    return compute(batch)

card._prepared, card._computed, card._runs_at_once = preparing, computing, lambda drive: 8
found = list(card.evaluate(parts))
assert prepared == [[unit] for unit in parts]
assert [unit for unit, _ in found] == parts
for (_, got), each in zip(found, wanted):
    assert got.keys() == each.keys()
    for name in got:
        np.testing.assert_array_equal(got[name], each[name])
card._runs_at_once = lambda drive: 100
together = list(card.evaluate(parts))
assert len(prepared) == 4
for (_, got), each in zip(together, wanted):
    np.testing.assert_array_equal(got["rmse"], each["rmse"])
""",
    )


def test_an_error_on_the_card_ends_the_study(tmp_path) -> None:
    study = tmp_path / "tiny.toml"
    study.write_text(STUDY)
    simulated_script(
        str(study),
        script="""
def failing(batch):
    raise MemoryError("full")

card._computed = failing
try:
    list(card.evaluate([Unit(0, 0, 0, 0, 2)]))
except MemoryError:
    sys.exit(0)
sys.exit(1)
""",
    )


def test_specialised_kernels_are_kept(tmp_path) -> None:
    study = tmp_path / "tiny.toml"
    study.write_text(STUDY)
    simulated_script(
        str(study),
        script="""
from harness.cuda import specialise

specialise.specialised = lambda *_: sys.exit("specialised again")
again = CardEvaluator(StudyEvaluator(study))
assert [a.__module__ for a in again.loops] == [b.__module__ for b in card.loops]
""",
    )


def test_further_processes_compile_for_the_card(tmp_path) -> None:
    study = tmp_path / "tiny.toml"
    study.write_text(STUDY)
    simulated_script(
        str(study),
        script="""
taken, elsewhere, take = [], threading.Event(), further_processes._taken

def taking(end):
    here = threading.current_thread() is threading.main_thread()
    if here and not elsewhere.wait(300):
        sys.exit("no further process began")
    index = take(end)
    if not here:
        taken.append(index)
        elsewhere.set()
    return index

further_processes._taken = taking
further_processes.missing_kernels = lambda evaluator: list(range(evaluator.kernels))
said = []
compile_kernels(card, 2, said.append)
assert taken[0] == 4, taken
assert said[0] == "compiled simulation; 4 to go", said
assert len(said) == 5, said
""",
    )


def test_a_result_is_continued_on_what_began_it(finished) -> None:
    study, out, _ = finished
    refused = CliRunner().invoke(app, ["run", str(study), "--out", str(out)])
    assert refused.exit_code == 2
    assert "device cuda there, absent here" in " ".join(refused.output.split())


@pytest.mark.parametrize("kind", ["particle", "enkf"])
def test_an_estimator_that_nobody_compared_on_a_card_is_refused(tmp_path, kind: str) -> None:
    study = tmp_path / "refused.toml"
    start, end = STUDY.index("estimator = ["), STUDY.index("[plant]")
    study.write_text(f'{STUDY[:start]}estimator = [{{ name = "other", kind = "{kind}" }}]\n{STUDY[end:]}')
    refused = simulated("run", str(study), "--device", "cuda", "--out", str(tmp_path / "out"))
    assert refused.returncode == 2
    assert f"nobody has compared '{kind}' on a card" in " ".join(refused.stderr.split())
    assert "Traceback" not in refused.stderr


def test_without_the_package_there_is_one_line(monkeypatch) -> None:
    find = importlib.util.find_spec
    monkeypatch.setattr(importlib.util, "find_spec", lambda name, *a: None if name == "numba_cuda" else find(name, *a))
    with pytest.raises(UserError, match=r"pip install 'robustness-harness\[cuda\]'"):
        devices.device("cuda")


def test_workers_and_a_card_exclude_each_other() -> None:
    refused = CliRunner().invoke(app, ["run", "studies/mass.toml", "--device", "cuda", "--jobs", "2"])
    assert refused.exit_code == 2
    assert "leave out --scheduler, --dask and --jobs" in " ".join(refused.output.split())


def test_a_study_says_what_computes_it() -> None:
    study = load_study("studies/ideal.toml")
    assert study.device == "cpu"
    assert dataclasses.replace(study, device="cuda").hash == study.hash
