"""What came of a trust monitor: how it was asked for, its counts by level, and what its report is made of."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from harness.common.statistics import Interval
from harness.config import StudySpec
from harness.config.specs import MonitorSpec
from harness.realtime.export.monitor import Monitor
from harness.remedy.monitor.bounds import Calibrated
from harness.remedy.monitor.counts import Counts
from harness.remedy.monitor.sensors import ParameterInformation
from harness.study.trust_file import BLIND, OFTEN


@dataclass(frozen=True)
class Level:
    """What came of a level.

    Attributes:
        design, label: Of the level.
        counts: By target.
        areas: Under the curve by target, against right samples as believed.
    """

    design: str
    label: str
    counts: tuple[Counts, ...]
    areas: tuple[Interval, ...]

    def is_blind(self, target: int) -> bool:
        """Whether there are errors that the innovations do not show."""
        return self.counts[target].wrong_share >= OFTEN and not self.areas[target].value >= BLIND


@dataclass(frozen=True)
class Counted:
    """A monitor and how often it is right.

    Attributes:
        study: Its study, with one estimator and a first design as believed.
        asked: What it was to be.
        monitor: The monitor.
        targets: With a limit.
        calibrated: Where its bounds come from.
        kept: As believed, in runs within the limits that bounds are not from, by target.
        believed: The same in all runs.
        levels: Of the designs.
        information: What measurements tell of parameters; empty where the innovations show all errors.
        drives: That kept the limits in a run at least, and those that did not in any.
    """

    study: StudySpec
    asked: MonitorSpec
    monitor: Monitor
    targets: tuple[str, ...]
    calibrated: Calibrated
    kept: tuple[Counts, ...]
    believed: tuple[Counts, ...]
    levels: tuple[Level, ...]
    information: tuple[ParameterInformation, ...]
    drives: tuple[tuple[str, ...], tuple[str, ...]]

    def delay(self, counts: Counts) -> float:
        """Return the median time from the first error of a run to the alarm, in s; NaN where no run has an error."""
        delays = counts.delay[~np.isnan(counts.delay)]
        return float(np.median(delays)) * self.monitor.step if len(delays) else float("nan")
