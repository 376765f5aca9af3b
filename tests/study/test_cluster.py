"""Studies on a Dask cluster of two processes: same bits, lost workers, and what is refused."""

import contextlib
import io
import json
import sys
import threading
from contextlib import contextmanager

import dask
import distributed  # noqa: F401  (its settings must be there before one of them is set for a while)
import pytest
import xarray as xr
from rich.console import Console

from harness.common import components
from harness.common.errors import UserError
from harness.config import build_study, load_study
from harness.study import cluster
from harness.study.design import Unit
from harness.study.provenance import code_state
from harness.study.run import run_study
from harness.study.score_names import OK, PENDING
from harness.study.store import STORE
from support.observers import CONTENT
from support.probe_study import STUDY, bits

pytestmark = pytest.mark.proof

ENDS = """
class Ends:
    inputs, measurements, estimates, k = (), ("yaw_rate",), ("yaw_rate",), 0
    def step(self, u, y, dt):
        self.k += 1
        if self.k == 101:
            raise ValueError("over")
        return 0.0 if dt == 0.0 else y[0]
"""


@pytest.fixture(scope="module")
def study(tmp_path_factory):
    path = tmp_path_factory.mktemp("study") / "probe.toml"
    path.write_text(STUDY)
    return load_study(path)


@pytest.fixture(scope="module", autouse=True)
def same_checkout():
    """A checkout that holds still while somebody works in it."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("harness.study.layout.commit", lambda: "this one")
        patch.setattr("harness.study.provenance.engine_hash", lambda study: "this one")
        yield


@pytest.fixture(scope="module")
def alone(study, tmp_path_factory, same_checkout):
    """The result of one process."""
    return run_study(study, tmp_path_factory.mktemp("alone"), jobs=1)


@pytest.fixture(scope="module")
def two_workers(tmp_path_factory, same_checkout):
    """Start clusters of two processes."""
    still = tmp_path_factory.mktemp("preload") / "still.py"
    still.write_text("from harness.study import provenance\n\nprovenance.engine_hash = lambda study: 'this one'\n")

    @contextmanager
    def start():
        with dask.config.set({"distributed.worker.preload": [str(still)]}), cluster.connected(None, workers=2) as found:
            found.wait_for_workers(2, timeout=300)
            yield found

    return start


@pytest.fixture(scope="module")
def client(two_workers):
    with two_workers() as found:
        yield found


@pytest.fixture
def mortal(two_workers):
    """A cluster of its own for a test that kills workers: how soon their successors come is the machine's affair."""
    with two_workers() as found:
        yield found


@pytest.fixture
def console():
    return Console(file=io.StringIO(), width=400)


def deadly(client, which):
    """Let a worker die of the next unit it takes and return its address; its successor lives."""

    def patch():
        import os

        from harness.study.evaluate import StudyEvaluator

        StudyEvaluator.evaluate = lambda self, unit: os._exit(9)

    victim = list(client.ncores())[which]
    client.run(patch, workers=[victim])
    return victim


def test_two_processes_write_the_bits_of_one(study, alone, client, console, tmp_path):
    out = run_study(study, tmp_path / "cluster", console=console, client=client)
    assert bits(out) == bits(alone)
    record = json.loads((out / "run.json").read_text())
    assert (record["jobs"], record["runs"]) == (2, 28)


def test_what_foreign_code_loses_on_workers_is_counted_here(client, console, tmp_path):
    (tmp_path / "ends.py").write_text(ENDS)
    foreign = {"name": "ends", "kind": "external", "python": "ends:Ends"}
    given = build_study({**CONTENT, "estimator": ["ekf", foreign]}, tmp_path / "study.toml")
    here, there = Console(file=io.StringIO(), width=400), console
    by_threads = run_study(given, tmp_path / "here", jobs=2, console=here)
    on_workers = run_study(given, tmp_path / "there", console=there, client=client)
    for each in (here, there):
        assert "ends:Ends: 22 runs lost: ValueError: over (ends.py, line 7)" in each.file.getvalue()
    assert bits(on_workers) == bits(by_threads)


def test_the_units_of_a_lost_worker_are_done_by_others(study, alone, mortal, console, tmp_path):
    victim = deadly(mortal, 0)
    assert bits(run_study(study, tmp_path / "lost", console=console, client=mortal)) == bits(alone)
    assert f"lost worker {victim}" in console.file.getvalue()


def test_a_unit_that_kills_its_workers_is_reported_and_the_run_goes_on_later(study, alone, mortal, console, tmp_path):
    scheduler = mortal.cluster.scheduler
    usual, scheduler.allowed_failures = scheduler.allowed_failures, 0
    out = tmp_path / "killed"
    try:
        deadly(mortal, 1)
        with pytest.raises(cluster.ClusterFailure, match="continues from there"):
            run_study(study, out, console=console, client=mortal)
    finally:
        scheduler.allowed_failures = usual
    level, band = (xr.open_zarr(out / STORE, group=name, consolidated=False, chunks=None) for name in ("level", "band"))
    assert (level.status == PENDING).any() or (band.status == PENDING).any()
    run_study(study, out, console=console, client=mortal)
    assert bits(out) == bits(alone)


def test_an_interrupted_run_goes_on_with_other_workers(study, alone, client, console, tmp_path, monkeypatch):
    real = cluster.evaluate

    def interrupted(*args):
        yield next(real(*args))
        raise KeyboardInterrupt

    out = tmp_path / "cut"
    with monkeypatch.context() as patch:
        patch.setattr(cluster, "evaluate", interrupted)
        with pytest.raises(KeyboardInterrupt):
            run_study(study, out, console=console, client=client)
    found = [
        xr.open_zarr(out / STORE, group=name, consolidated=False, chunks=None).status.values
        for name in ("level", "band")
    ]
    assert any((status == OK).any() for status in found)
    run_study(study, out, jobs=1, console=console)
    assert bits(out) == bits(alone)


def test_workers_that_would_not_write_the_same_are_refused(study, alone, client, console, tmp_path, monkeypatch):
    cluster.check_workers(client, study, alone, console)
    with pytest.raises(UserError, match=r"worker tcp://.* does not see .*nowhere; choose a folder that all machines"):
        cluster.check_workers(client, study, tmp_path / "nowhere", console)
    mine = code_state(study)
    versions = json.loads(mine["versions"]) | {"numba": "0.1"}
    for here, message in (
        (mine | {"engine": "other"}, "other code of this project"),
        (mine | {"versions": json.dumps(versions)}, r"has numba .* instead of 0\.1; install the same lock file"),
    ):
        monkeypatch.setattr(cluster, "code_state", lambda study, here=here: here)
        with pytest.raises(UserError, match=message):
            cluster.check_workers(client, study, alone, console)


def test_refused_workers_leave_no_store(study, client, console, tmp_path, monkeypatch):
    monkeypatch.setattr(cluster, "code_state", lambda study: code_state(study) | {"engine": "other"})
    with pytest.raises(UserError, match="other code of this project"):
        run_study(study, tmp_path / "new", console=console, client=client)
    assert list(tmp_path.iterdir()) == []


def test_other_processors_are_pointed_out(study, alone, client, console, monkeypatch):
    monkeypatch.setattr(cluster, "processor", lambda: "abacus")
    cluster.check_workers(client, study, alone, console)
    assert "last bits may differ" in console.file.getvalue()


def test_a_worker_that_comes_late_is_checked_as_well(study, alone, monkeypatch):
    def there(folder, expected):
        return cluster._There(folder, expected, components.carried())

    unit = Unit(0, 0, 0, 0, 1)
    monkeypatch.setattr(cluster, "_opened", {})
    with pytest.raises(UserError, match="runs other code"):
        cluster._evaluate_there(study, [unit], there(alone, code_state(study) | {"engine": "other"}))
    with pytest.raises(UserError, match="does not see"):
        cluster._evaluate_there(study, [unit], there(alone / "nowhere", code_state(study)))


@pytest.mark.parametrize("address", ["tcp://127.0.0.1:1", "nonsense://here"])
def test_a_scheduler_that_does_not_answer(address, monkeypatch):
    monkeypatch.setattr(cluster, "CONNECT", 0.5)
    with (
        pytest.raises(UserError, match=f"--scheduler {address}: no Dask scheduler answers"),
        cluster.connected(address),
    ):
        pass


@pytest.fixture
def empty():
    """A scheduler without workers."""
    from distributed import LocalCluster

    with LocalCluster(n_workers=0, processes=False, dashboard_address="127.0.0.1:0") as made:
        yield made


def test_a_scheduler_without_workers(empty, monkeypatch):
    monkeypatch.setattr(cluster, "CONNECT", 0.5)
    with pytest.raises(UserError, match="it has no worker after"), cluster.connected(empty.scheduler_address):
        pass


def test_a_scheduler_that_goes_away_is_reported(study, empty, console, monkeypatch):
    from distributed import Client

    monkeypatch.setattr(cluster, "_LOOK", 0.2)
    with contextlib.suppress(OSError), Client(empty.scheduler_address) as client:
        threading.Timer(1.0, empty.close).start()
        with pytest.raises(cluster.ClusterFailure, match="the scheduler is gone"):
            list(cluster.evaluate(client, study, study.path.parent, [Unit(0, 0, 0, 0, 1)], console))


def test_a_missing_extra_is_named(monkeypatch):
    monkeypatch.setitem(sys.modules, "distributed", None)
    with pytest.raises(UserError, match=r"pip install 'robustness-harness\[cluster\]'"), cluster.connected(None):
        pass


@pytest.mark.parametrize(
    ("units", "workers", "seconds", "several"),
    [
        (1000, 2, 0.01, 62),
        (100_000, 2, 0.01, 100),
        (1000, 2, 0.6, 1),
        (1000, 2, 30.0, 1),
        (10, 4, 0.001, 1),
        (1000, 2, None, 8),
        (3, 0, 0.0, 1),
        (1, 1, 0.0, 1),
    ],
)
def test_short_units_are_handed_out_together(units, workers, seconds, several):
    assert cluster._in_a_task(units, workers, seconds) == several
