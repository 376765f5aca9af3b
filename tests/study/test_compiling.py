"""Kernels that further processes compile."""

import hashlib
import time
from pathlib import Path

import pytest

from harness.common import components
from harness.config import build_study
from harness.engine import further_processes
from harness.engine.compile import is_on_disk
from harness.models.parameters import kit_2015a
from harness.models.vehicles import scalar_example
from harness.study import run as study_run
from harness.study.evaluate import StudyEvaluator


@pytest.fixture
def cold(tmp_path, monkeypatch):
    """Give evaluators of a small study of a vehicle that nobody else has, whose kernels begin in no cache."""
    monkeypatch.setenv("HARNESS_CACHE", str(tmp_path))
    monkeypatch.setattr(study_run, "_WORTH", 1)
    name = f"scalar_{hashlib.sha256(str(tmp_path).encode()).hexdigest()[:8]}"
    for role, module in (("vehicles", scalar_example), ("parameters", kit_2015a)):
        file = tmp_path / f"{name}.{role}.py"
        file.write_text(Path(module.__file__).read_text("utf-8").replace('"scalar_example"', f'"{name}"'), "utf-8")
        components.register(role, file, name)
    table = {
        "name": "cold",
        "seed": 0,
        "targets": ["example_state"],
        "drive": [{"name": "straight", "kind": "sine", "amplitude": "0 deg", "duration": "5 s"}],
        "plant": {"vehicle": name, "parameters": name, "sensors": "example"},
        "estimator": [{"name": name, "kind": kind} for name, kind in (("KF", "kf"), ("again", "kf"), ("EKF", "ekf"))],
        "design": [{"name": "one", "repeats": 1}],
    }
    yield lambda: StudyEvaluator(build_study(table, "cold"))
    for role in ("vehicles", "parameters"):
        components.unregister(role, name)


def test_a_further_process_compiles_from_the_far_end_and_this_one_loads_it(cold, monkeypatch):
    evaluator = cold()
    said = []

    def wait_for_the_last(words):
        end = time.monotonic() + 120
        while not said and not is_on_disk(evaluator.loops[-1]) and time.monotonic() < end:
            time.sleep(0.1)
        said.append(words)

    study_run.compile_kernels(evaluator, 2, wait_for_the_last)
    assert said[0] == "compiled simulation; 3 to go"
    assert [w.split(";")[0] for w in said[1:]] == ["compiled KF", "compiled again", "compiled EKF"]
    hits = [sum(loop.stats.cache_hits.values()) for loop in evaluator.loops]
    assert hits[0] == 0
    assert hits[-1] == 1
    assert not further_processes.missing_kernels(evaluator)
    monkeypatch.setattr(further_processes.subprocess, "Popen", lambda *a, **k: pytest.fail("started for nothing"))
    study_run.compile_kernels(evaluator, 2, said.append)
    assert len(said) == 8


def test_a_further_process_that_fails_leaves_its_kernels_to_this_one(cold, monkeypatch):
    monkeypatch.setattr(further_processes, "_START", "raise SystemExit(3)")
    evaluator, said = cold(), []
    study_run.compile_kernels(evaluator, 3, said.append)
    assert len(said) == 4
    assert all(is_on_disk(loop) for loop in evaluator.loops)
    assert not any(loop.stats.cache_hits for loop in evaluator.loops)
