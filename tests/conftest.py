"""Study files written and loaded; finished studies for the tests of the report, written without running any."""

from __future__ import annotations

import gc
import os

import pytest
from threadpoolctl import threadpool_limits

from harness.common.errors import UserError
from harness.common.failures import FILE, Failures
from harness.common.process import collect_rarely
from harness.config import load_study
from harness.study.report.analysis import Analysis
from harness.study.results import read
from support import synthetic
from support.report_parts import ANGLE, lose_some
from support.small_study import STUDY

collect_rarely()  # as a command does
# Threads of linear algebra spin while they wait for a core: beside other workers that is ten times the processor time.
threadpool_limits(1, "blas")
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # of the processes that tests begin


@pytest.fixture(autouse=True)
def nothing_fails_quietly(request, monkeypatch):
    """Fail a test in which a part of a result could not be made, unless it is marked ``fails_in_part``."""
    noted, note = [], Failures._note

    def _note(self, sentence, trail):
        noted.append(f"{sentence}\n{trail}")
        note(self, sentence, trail)

    monkeypatch.setattr(Failures, "_note", _note)
    meant = request.node.get_closest_marker("fails_in_part") is not None
    folder = request.getfixturevalue("tmp_path") if meant else None
    yield
    for path in folder.rglob(FILE) if folder else ():
        path.unlink()
    assert meant or not noted, "\n".join(noted)


def pytest_collection_finish():
    gc.collect()
    gc.freeze()


@pytest.fixture(autouse=True, scope="module")
def what_stays_is_looked_through_once():
    """Spare later searches for garbage what a module leaves: modules, equations and kernels, of which none goes."""
    yield
    gc.collect()
    gc.freeze()


@pytest.fixture(autouse=True, scope="session")
def no_process_fails_quietly(tmp_path_factory):
    """Fail where a process that a test began could not make a part of a result, which is written beside that."""
    yield
    lost = [*tmp_path_factory.getbasetemp().rglob(FILE)]
    assert not lost, "\n".join(f"{path}\n{path.read_text(encoding='utf-8')}" for path in lost)


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


@pytest.fixture(scope="module")
def mass_designs():
    """The designs of the mass study, with lost runs."""
    return {
        "level": synthetic.design(status=lose_some),
        "band": synthetic.design(levels=(8.0, 24.0, 32.0), band=0.05, samples=8, repeats=1, seed=2),
    }


@pytest.fixture(scope="module")
def mass(tmp_path_factory, mass_designs):
    """Folder of the mass study with a history; without a report."""
    return synthetic.write(tmp_path_factory.mktemp("mass"), mass_designs, runs=[synthetic.history()])


@pytest.fixture(scope="module")
def small(tmp_path_factory):
    """Folder of a small study with a history in which one signal has no truth; without a report."""
    level = synthetic.design(levels=(16.0, 24.0), drives=synthetic.DRIVES[:1], repeats=4, targets=ANGLE)
    run = synthetic.history(extra="stiffness_factor").isel(target=[1, 3])
    return synthetic.write(tmp_path_factory.mktemp("small"), {"level": level}, runs=[run])


@pytest.fixture
def one_design(tmp_path):
    """Write a study of one small design and return its analysis."""

    def make(**options) -> Analysis:
        folder = synthetic.write(
            tmp_path / "study", {"level": synthetic.design(**{"repeats": 3, "drives": synthetic.DRIVES[:2], **options})}
        )
        return Analysis(read(folder))

    return make
