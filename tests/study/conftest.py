"""A finished study of a few short runs, once for each module that asks for it."""

import io
import shutil

import pytest
from rich.console import Console

from harness.config import load_study
from harness.study.evaluate import StudyEvaluator
from harness.study.run import run_study
from support.probe_study import STUDY


@pytest.fixture(scope="module")
def study_file(tmp_path_factory):
    path = tmp_path_factory.mktemp("study") / "probe.toml"
    path.write_text(STUDY)
    return path


@pytest.fixture(scope="module")
def study(study_file):
    return load_study(study_file)


@pytest.fixture(scope="module")
def evaluator(study):
    return StudyEvaluator(study)


@pytest.fixture(scope="module")
def same_checkout():
    """A checkout that holds still while somebody works in it."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("harness.study.layout.commit", lambda: "this one")
        patch.setattr("harness.study.provenance.engine_hash", lambda study: "this one")
        yield


@pytest.fixture(scope="module")
def finished(study, tmp_path_factory, same_checkout):
    return run_study(study, tmp_path_factory.mktemp("one"), jobs=1)


@pytest.fixture
def copy(finished, tmp_path):
    """A copy of the finished study, to be damaged."""
    return shutil.copytree(finished, tmp_path / "copy")


@pytest.fixture
def console():
    return Console(file=io.StringIO(), width=400)
