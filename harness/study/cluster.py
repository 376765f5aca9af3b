"""Run a study's units on the workers of a Dask cluster.

Each worker opens study and store for itself, once, and writes the chunks of its units; only the unit comes back.
So the cluster needs a file system or a URL that all machines see, and every worker the same code and packages.

Units are submitted as Dask futures. joblib's Dask backend would do the same call, but waits forever for a task
whose workers all died (joblib 1.6: ``DaskDistributedBackend._collect`` calls nobody back when a future has failed).
"""

from __future__ import annotations

import contextlib
import json
import logging
import os
import platform
import threading
import time
from collections import Counter
from collections.abc import Collection, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from rich.console import Console
from rich.text import Text

from harness.common import components, lock, places
from harness.common.errors import ModelError, UserError, WorkError
from harness.common.process import keep_freed_memory
from harness.common.sources import has_file
from harness.config import StudySpec
from harness.external.losses import Losses
from harness.study import sealed_root
from harness.study.design import Unit
from harness.study.evaluate import StudyEvaluator
from harness.study.provenance import code_state, parts, processor
from harness.study.store import STORE, Store

if TYPE_CHECKING:
    from distributed import Client

CONNECT = 10.0
"""s to wait for a scheduler, and then for its first worker."""

_LOOK = 2.0
"""s between two looks at which workers are there."""

_PAUSE = 0.1
"""s between two looks at what is finished."""

_TASK = 1.0
"""s that a task takes at most where it has several units."""

_OF_UNKNOWN_LENGTH = 8
"""Units of a task where nobody knows how long they take."""

_TASKS_EACH = 8
"""Tasks that each worker has at least, so that all of them end at about the same time."""

_QUIET = {
    "distributed.worker.profile.enabled": False,
    "distributed.admin.system-monitor.gil.enabled": False,
    "distributed.admin.system-monitor.interval": "5s",
}
"""Of our own processes nobody looks at the dashboard, for which each would be sampled a hundred times a second."""

_OPENED_AT_ONCE = 4
"""Studies that a worker keeps open."""

_opened: dict[tuple[str, Path], tuple[StudyEvaluator, Store]] = {}
_opening = threading.Lock()


class ClusterFailure(WorkError):
    """The cluster failed; what is finished is in the store."""


@contextlib.contextmanager
def connected(scheduler: str | None, workers: int | None = None) -> Iterator[Client]:
    """Give a client of a scheduler, or of a cluster of processes on this machine that ends with the block.

    Args:
        scheduler: Address such as ``tcp://host:8786``; ``None`` starts the local cluster.
        workers: Processes of the local cluster, by default one per core.

    Raises:
        UserError: If Dask is not installed, no scheduler answers or it has no worker.
    """
    try:
        import distributed
    except ImportError:
        raise UserError(
            "a cluster needs Dask, which is not installed: pip install 'robustness-harness[cluster]'"
        ) from None
    with contextlib.ExitStack() as stack:
        if scheduler is None:
            import dask

            processes = workers or os.cpu_count()
            stack.enter_context(dask.config.set(_QUIET))
            stack.enter_context(_not_from_here())
            cluster = stack.enter_context(
                distributed.LocalCluster(
                    n_workers=processes,
                    threads_per_worker=1,
                    dashboard_address="127.0.0.1:0",
                    silence_logs=logging.CRITICAL,
                )
            )
            yield stack.enter_context(distributed.Client(cluster, set_as_default=False))
            return
        try:
            client = stack.enter_context(distributed.Client(scheduler, timeout=CONNECT, set_as_default=False))
        except (OSError, ValueError) as error:
            raise UserError(
                f"--scheduler {scheduler}: no Dask scheduler answers there ({str(error).splitlines()[0]}); write "
                "tcp://HOST:PORT as 'dask scheduler' prints it"
            ) from None
        try:
            client.wait_for_workers(1, timeout=CONNECT)
        except TimeoutError:
            raise UserError(
                f"--scheduler {scheduler}: it has no worker after {CONNECT:g} s; start some: dask worker {scheduler}"
            ) from None
        yield client


@contextlib.contextmanager
def _not_from_here() -> Iterator[None]:
    """Let processes that are started meanwhile import nothing from the working directory."""
    before = os.environ.get("PYTHONSAFEPATH")
    os.environ["PYTHONSAFEPATH"] = "1"
    try:
        yield
    finally:
        del os.environ["PYTHONSAFEPATH"]
        if before is not None:
            os.environ["PYTHONSAFEPATH"] = before


def refuse_objects(study: StudySpec) -> None:
    """Refuse a study that workers cannot have; asked before there are any.

    Raises:
        UserError: If a component of it was registered without a file.
    """
    for module in parts(study):
        if components.is_component(module) and not has_file(module):
            raise UserError(
                f"'{components.name_of(module)}' was registered without a file, so that workers cannot have it; write "
                "it into a file of a project folder (docs/plugins.md)"
            )


def check_workers(client: Client, study: StudySpec, folder: Path, console: Console) -> None:
    """Refuse workers that could not write the same bits into the same store; point out other processors.

    Args:
        client: Of the cluster.
        study: The study.
        folder: Result folder, with the store or the lock of this process.
        console: Where a warning is shown.

    Raises:
        UserError: If a worker does not see the folder, lacks the harness, or runs other code or packages.
    """
    expected = code_state(study)
    try:
        answers = client.run(_about, study, folder.resolve(), components.carried())
    except ImportError as error:
        raise UserError(f"a worker cannot import the harness ({error}); install it there as here") from None
    except (ModelError, UserError) as error:
        raise UserError(
            f"a worker does not have what the study is made of ({error}); install the same packages there, and let all "
            "machines see the project folder and registered files under the same path"
        ) from None
    others = set()
    for address, answer in answers.items():
        if not answer["sees_store"]:
            raise UserError(
                f"worker {address} on {answer['host']} does not see {folder.resolve()}; choose a folder that all "
                "machines share with --out"
            )
        _refuse_other_code(f"worker {address} on {answer['host']}", expected, answer)
        others |= {answer["processor"]} - {processor()}
    if others:
        console.print(
            Text(f"warning: workers have other processors ({', '.join(sorted(others))}); last bits may differ"),
            style="yellow",
            soft_wrap=True,
        )


def _about(study: StudySpec, folder: Path, carried: components.Carried) -> dict[str, Any]:
    """Return what a worker is; runs there."""
    components.take_over(carried)
    sees = sealed_root.is_there(folder / STORE) or places.contents(folder, [lock.FILE]) != [None]
    return {**code_state(study), "sees_store": sees, "host": platform.node(), "processor": processor()}


def _refuse_other_code(who: str, expected: dict[str, str], reported: dict[str, str]) -> None:
    there, here = (json.loads(state["versions"]) for state in (reported, expected))
    differing = [f"{name} {there.get(name)} instead of {version}" for name, version in here.items()
                 if there.get(name) != version]  # fmt: skip
    if differing:
        raise UserError(f"{who} has {', '.join(differing)}; install the same lock file on all machines")
    if reported["engine"] != expected["engine"]:
        raise UserError(
            f"{who} runs other code of this project or of a component from outside; bring it to the same commit and "
            "the same files and restart it"
        )


def evaluate(
    client: Client,
    study: StudySpec,
    folder: Path,
    todo: Sequence[Unit],
    console: Console,
    seconds: float | None = None,
    losses: Sequence[Losses] = (),
) -> Iterator[Unit]:
    """Evaluate units on the workers, which write the scores; return each unit when it is in the store.

    A unit whose worker is lost is given to another one. Short units are handed out several at a time.

    Args:
        client: Of the cluster, its workers checked by ``check_workers``.
        study: The study.
        folder: Result folder with the store.
        todo: What is to be evaluated.
        console: Where lost workers are reported.
        seconds: How long a unit takes, about; ``None`` where that is not known.
        losses: Those of the evaluator, to which the runs are added that foreign code lost on the workers.

    Raises:
        ClusterFailure: If one unit has lost several workers, or the scheduler is gone.
        UserError: If a worker that came later runs other code or does not see the store.
    """
    from distributed import CancelledError, KilledWorker, as_completed
    from distributed.comm import CommClosedError

    there = _There(folder.resolve(), code_state(study), components.carried())
    several = _in_a_task(len(todo), sum(client.ncores().values()), seconds)
    tasks = [todo[first : first + several] for first in range(0, len(todo), several)]
    pending = {client.submit(_evaluate_there, study, units, there, pure=False) for units in tasks}
    workers, looked = set(client.ncores()), time.monotonic()
    # Waiting for all that are left anew takes the longer the more there are.
    completed = as_completed(pending, loop=client.loop)
    try:
        while pending:
            done = completed.next_batch(block=False)
            for future in done:
                pending.discard(future)
                units, lost = future.result()
                for own, counts in zip(losses, lost, strict=False):
                    own.add_all(counts)
                yield from units
            if not done:
                time.sleep(_PAUSE)
            if time.monotonic() - looked > _LOOK:
                workers, looked = _report_lost(workers, set(client.ncores()), console), time.monotonic()
        _report_lost(workers, set(client.ncores()), console)
    except KilledWorker as error:
        raise ClusterFailure(
            f"a unit was lost with each of the workers that took it, the last {error.last_worker.address} (out of "
            "memory?); finished runs are kept and the same command continues from there"
        ) from error
    except (CancelledError, CommClosedError) as error:
        raise ClusterFailure(
            "the scheduler is gone; finished runs are kept and the same command continues from there"
        ) from error
    finally:
        if client.status == "running":
            client.cancel(list(pending))


def _report_lost(before: Collection[str], now: set[str], console: Console) -> set[str]:
    for address in sorted(set(before) - now):
        remaining = f"{len(now)} left" if now else "none is left, so this waits for one (Ctrl-C keeps what is finished)"
        lost = f"lost worker {address}: its units are done again; {remaining}"
        console.print(Text(lost), style="yellow", soft_wrap=True)
    return now


@dataclass(frozen=True)
class _There:
    """What a worker receives with study and unit: result folder, code that it must have, where components are."""

    folder: Path
    expected: dict[str, str]
    components: components.Carried


def _in_a_task(units: int, workers: int, seconds: float | None) -> int:
    """Return how many units a task has: to hand one out and take it back costs as much as a few hundred short runs.

    Args:
        units: That are left to do.
        workers: How many work at a time.
        seconds: How long a unit takes, about; ``None`` where that is not known.
    """
    wanted = _OF_UNKNOWN_LENGTH if seconds is None else int(_TASK / max(seconds, _TASK / units))
    return max(1, min(wanted, units // (_TASKS_EACH * max(workers, 1))))


def _evaluate_there(
    study: StudySpec, units: Sequence[Unit], there: _There
) -> tuple[Sequence[Unit], list[Counter[str]]]:
    """Evaluate units, write their scores, return them and what foreign code lost by reason; runs on a worker."""
    evaluator, store = _open(study, there)
    for unit in units:
        store.write(unit, evaluator.evaluate(unit))
    return units, [losses.taken_counts() for losses in evaluator.losses]


def _open(study: StudySpec, there: _There) -> tuple[StudyEvaluator, Store]:
    """Return study and store, opened once in this process."""
    folder = there.folder
    key = study.hash, folder
    with _opening:
        if key not in _opened:
            keep_freed_memory()
            components.take_over(there.components)
            _refuse_other_code(f"worker on {platform.node()}", there.expected, code_state(study))
            if not sealed_root.is_there(folder / STORE):
                raise UserError(f"the worker on {platform.node()} does not see {folder}")
            while len(_opened) >= _OPENED_AT_ONCE:
                _opened.pop(next(iter(_opened)))
            evaluator = StudyEvaluator(study)
            _opened[key] = evaluator, Store(study, lambda: evaluator, folder)
        return _opened[key]
