"""Trust monitors that a study asks for, counted after its run and written next to its scores."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterable
from functools import partial
from pathlib import Path

import numpy as np

from harness.common.errors import UserError
from harness.common.files import write_files
from harness.common.places import reached
from harness.common.statistics import Interval
from harness.config import StudySpec
from harness.realtime.export.interface import identifier
from harness.remedy.monitor.answer import in_short, valued
from harness.remedy.monitor.counts import Counts, per_hour, roc
from harness.remedy.monitor.outcome import Counted
from harness.remedy.monitor.run import count_monitor
from harness.remedy.monitor.sensors import Shares
from harness.study import trust_file
from harness.study.trust_file import EstimatorTrust, LevelTrust, StudyTrust, TargetTrust

_NONE = Interval(float("nan"), float("nan"), float("nan"))


def write(study: StudySpec, folder: Path, jobs: int | None, say: Callable[[str], None]) -> list[str]:
    """Count the monitors of a study where they are not there yet: ``monitor.json``, and one file to export of each.

    Files of monitors that were asked for before are removed. Returns why there is none of an estimator, in sentences.

    Args:
        study: The study.
        folder: Its result folder.
        jobs: Threads; one per core by default.
        say: Informed of what is going on.

    Raises:
        UserError: If the folder cannot be written to.
    """
    assert study.monitor is not None
    with reached(folder):
        before = trust_file.content_of(folder)
    if trust_file.asked_of(study).items() <= before.items():
        return []
    counted, missing, texts = [], [], {}
    shares: Shares = {}
    for name in study.monitor.estimators:
        try:
            monitor = count_monitor(study, study.monitor, name, jobs, partial(_of, name, say), shares)
        except UserError as error:  # which the report says as well: the study itself is done
            counted.append(EstimatorTrust(name, (str(error),), _NONE, ()))
            missing.append(f"no monitor of '{name}': {error}")
            continue
        counted.append(trust_of(monitor))
        texts[name] = monitor.monitor.text
    with reached(folder):
        for old in files_of([each["estimator"] for each in before.get("estimators", ()) if each["targets"]]):
            (folder / old).unlink(missing_ok=True)
        write_files(folder, dict(zip(files_of(texts), texts.values(), strict=True)))
        trust_file.write(folder, study, StudyTrust(study.monitor.within, tuple(counted)))
    return missing


def files_of(estimators: Iterable[str]) -> list[str]:
    """Return the file names of monitors; where estimators have the same name in C, with a number behind it."""
    files: list[str] = []
    for word in map(identifier, estimators):
        names = (
            f"monitor-{word}{number}.toml" for number in itertools.chain([""], map("_{}".format, itertools.count(2)))
        )
        files.append(next(name for name in names if name not in files))
    return files


def _of(name: str, say: Callable[[str], None], words: str) -> None:
    say(f"{name}: {words}")


def trust_of(counted: Counted) -> EstimatorTrust:
    """Return how often a monitor is right, as a report shows it."""
    rate = per_hour(counted.kept[0], counted.monitor.step)[0] if counted.kept else _NONE
    targets = tuple(_target(counted, t) for t in range(len(counted.targets)))
    return EstimatorTrust(counted.study.estimators[0].name, tuple(in_short(counted)), rate, targets)


def _target(counted: Counted, t: int) -> TargetTrust:
    believed, within = counted.believed[t], [counted.kept[t]] if counted.kept else []
    levels = []
    for level in counted.levels:
        label = valued(counted.study, level.design, level.label)
        levels.append(_level(counted, level.design, label, level.counts[t], level.areas[t], believed))
    of_believed = [_level(counted, "", "as believed, within limits", each, _NONE, None) for each in within]
    of_believed.append(_level(counted, "", "as believed", believed, _NONE, None))
    false = tuple(map(float, roc(believed, believed)[0]))
    return TargetTrust(
        counted.targets[t], counted.asked.limits[counted.targets[t]], tuple(of_believed), tuple(levels), false
    )


def _level(
    counted: Counted, design: str, label: str, counts: Counts, area: Interval, right: Counts | None
) -> LevelTrust:
    wrong = counts.wrong.sum()
    detected = () if right is None else tuple(map(float, roc(right, counts)[1]))
    return LevelTrust(
        design, label, counts.wrong_share, counts.said_share, float(counts.warned.sum() / wrong) if wrong else np.nan,
        counted.delay(counts), counts.false_share, area, detected,
    )  # fmt: skip
