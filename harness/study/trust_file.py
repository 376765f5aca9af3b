"""Trust monitors as they stand next to the scores of a study; ``harness.remedy.monitor`` calibrates and counts them."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np

from harness.common.files import json_table, write_files
from harness.common.statistics import Interval
from harness.config import StudySpec

FILE = "monitor.json"

OFTEN = 0.01
"""Share of the samples in error from which a level is spoken of."""

BLIND = 0.7
"""Area under the curve below which the innovations do not show an error."""

_DIGITS = 6


@dataclass(frozen=True)
class LevelTrust:
    """What a monitor says of the errors of a target at a level.

    Attributes:
        design, label: Of the level; no design of one that is as believed.
        wrong: Share of the samples in error.
        said: Of these, share at which an alarm stands or begins in time; NaN without any, as the next.
        distrusted: Of these, share at which the estimate is not trusted for any reason.
        delay: Of the first alarm behind the first error in s, median over runs; infinite where none follows.
        false: Share of the samples without error that are in an alarm.
        area: Under the curve of detection, against right samples as believed.
        detected: Share of the samples in error with more evidence than each bound; of none, nothing.
    """

    design: str
    label: str
    wrong: float
    said: float
    distrusted: float
    delay: float
    false: float
    area: Interval
    detected: tuple[float, ...]

    @property
    def speaks(self) -> bool:
        """Whether there are errors that are worth a word."""
        return self.wrong >= OFTEN


@dataclass(frozen=True)
class TargetTrust:
    """How often a monitor is right about a target.

    Attributes:
        target: Its name.
        limit: Error that matters, SI.
        believed: All as believed, in runs within all limits if there are any, and in all runs.
        levels: Of the designs.
        false: Share of right samples as believed with more evidence than each bound, falling.
    """

    target: str
    limit: float
    believed: tuple[LevelTrust, ...]
    levels: tuple[LevelTrust, ...]
    false: tuple[float, ...]

    @property
    def drawn(self) -> tuple[LevelTrust, ...]:
        """The levels of a figure: those with errors of the first design that has any."""
        speaking = [level for level in self.levels if level.speaks]
        return tuple(level for level in speaking if level.design == speaking[0].design)


@dataclass(frozen=True)
class EstimatorTrust:
    """How often the monitor of an estimator is right.

    Attributes:
        estimator: Its name.
        says: The result in sentences, or why there is none.
        alarms: False ones in an hour within all limits, with their interval at 95 %.
        targets: Those with a limit; none where it could not be calibrated.
    """

    estimator: str
    says: tuple[str, ...]
    alarms: Interval
    targets: tuple[TargetTrust, ...]


@dataclass(frozen=True)
class StudyTrust:
    """What was counted of trust monitors in a study.

    Attributes:
        within: Time in which an error has to be said, in s.
        estimators: Those that were watched.
    """

    within: float
    estimators: tuple[EstimatorTrust, ...]


def asked_of(study: StudySpec) -> dict[str, Any]:
    """Return what a study asks of trust monitors, as it stands in the file."""
    assert study.monitor is not None
    asked: dict[str, Any] = json.loads(json.dumps({"study_hash": study.hash, "asked": asdict(study.monitor)}))
    return asked


def write(folder: Path, study: StudySpec, trust: StudyTrust) -> None:
    """Write what was counted next to the scores of a study.

    Raises:
        UserError: If the folder cannot be written to.
    """
    estimators = [_plain(asdict(each)) for each in trust.estimators]
    content = {**asked_of(study), "within": trust.within, "estimators": estimators}
    write_files(folder, {FILE: json.dumps(content, indent=1) + "\n"})


def read(folder: Path, study_hash: str) -> StudyTrust | None:
    """Return what stands in the file of a result folder; ``None`` if none was written of this study.

    Raises:
        UserError: If the file is damaged.
    """
    content = content_of(folder)
    return _trust(content) if content.get("study_hash") == study_hash else None


def content_of(folder: Path) -> dict[str, Any]:
    """Return all that stands in the file of a result folder; nothing if there is none.

    Raises:
        UserError: If the file is damaged.
    """
    return json_table(folder / FILE, "delete it: 'harness run' counts again", _wrong)


def _wrong(content: dict[str, Any]) -> str | None:
    try:
        _trust(content)
    except (KeyError, TypeError, ValueError) as error:
        return f"holds no counts of monitors ({type(error).__name__}: {error})"
    return None


def _plain(value: Any) -> Any:
    """Return a value as JSON has it: no number as nothing, infinity as a word, others with six digits."""
    if isinstance(value, dict):
        return {key: _plain(each) for key, each in value.items()}
    if isinstance(value, list | tuple):
        return [_plain(each) for each in value]
    if not isinstance(value, float):
        return value
    return float(f"{value:.{_DIGITS}g}") if np.isfinite(value) else None if np.isnan(value) else str(value)


def _number(value: Any) -> float:
    return float("nan") if value is None else float(value)


def _trust(content: Mapping[str, Any]) -> StudyTrust:
    return StudyTrust(_number(content["within"]), tuple(map(_estimator, content["estimators"])))


def _estimator(table: Mapping[str, Any]) -> EstimatorTrust:
    alarms = Interval(*map(_number, table["alarms"]))
    return EstimatorTrust(
        str(table["estimator"]), tuple(map(str, table["says"])), alarms, tuple(map(_target, table["targets"]))
    )


def _target(table: Mapping[str, Any]) -> TargetTrust:
    believed, levels = (tuple(map(_level, table[key])) for key in ("believed", "levels"))
    false = tuple(map(_number, table["false"]))
    return TargetTrust(str(table["target"]), _number(table["limit"]), believed, levels, false)


def _level(table: Mapping[str, Any]) -> LevelTrust:
    numbers = {key: _number(table[key]) for key in ("wrong", "said", "distrusted", "delay", "false")}
    return LevelTrust(
        design=str(table["design"]),
        label=str(table["label"]),
        area=Interval(*map(_number, table["area"])),
        detected=tuple(map(_number, table["detected"])),
        **numbers,
    )
