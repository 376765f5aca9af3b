"""``harness.count_monitor``: a trust monitor for an estimator of a study, with its alarms counted."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

from harness.api._show import Shown
from harness.api.study import Study

if TYPE_CHECKING:
    import pandas as pd

    from harness.remedy.monitor.run import Counted


def count_monitor(
    study: Study,
    estimator: str | None = None,
    *,
    limits: Mapping[str, float | str] | None = None,
    parameters: str | Path | None = None,
    window: float | str = "2 s",
    false_alarms: float = 1.0,
    within: float | str = "3 s",
    runs: int = 40,
    jobs: int | None = None,
) -> TrustMonitor:
    """Calibrate a monitor that says when an estimator is not to be trusted, and count its alarms on a study.

    Args:
        study: The study.
        estimator: Name of one of its estimators; the first by default.
        limits: Error of a target that matters, SI or text with a unit; those of the study by default.
        parameters: Parameter file that is believed in place of the study's belief, as for ``harness.export_estimator``.
        window: Over which innovations are averaged, in s or text with a unit.
        false_alarms: An hour, where all is as believed.
        within: In which an error has to be spoken of, in s or text with a unit.
        runs: Of a level and drive that are counted, at most.
        jobs: Worker threads; by default one per core.

    Returns:
        The monitor.

    Raises:
        UserError: If there is no such estimator, no limit, or nothing that the monitor could be calibrated on.

    Example:
        >>> import harness as h
        >>> study = h.Study(
        ...     plant=h.model("car", "govindarajan_2018", sensors="car_series"),
        ...     targets=["lateral_velocity"],
        ...     drives=[h.drive("sine", duration="10 s", amplitude="20 deg")],
        ...     estimators=["ekf"],
        ...     designs=[h.design("heavy", repeats=8, factors=[h.factor("mass", levels=["1500 kg", "2500 kg"])])],
        ... )
        >>> monitor = h.count_monitor(study, limits={"lateral_velocity": "0.2 m/s"}, false_alarms=20.0, runs=8)
        >>> monitor.counts.columns.tolist()
        ['in_error', 'said', 'not_trusted', 'false', 'area', 'delay']
    """
    from rich.console import Console

    from harness.common.stages import showing
    from harness.common.units import to_si
    from harness.config.specs import MonitorSpec
    from harness.models.signals import SIGNALS
    from harness.realtime.export.run import believing
    from harness.remedy.monitor.run import check_target, count_monitor

    spec = study.spec if parameters is None else believing(study.spec, Path(parameters))
    chosen = dict(spec.limits) if limits is None else {}
    for name, value in (limits or {}).items():
        check_target(spec, name)
        chosen[name] = to_si(value, SIGNALS[name].unit if name in SIGNALS else "", f"limit of {name}")
    asked = MonitorSpec(chosen, to_si(window, "s", "window"), false_alarms, to_si(within, "s", "within"), runs)
    with showing(Console(stderr=True), "building models and drives") as show:
        return TrustMonitor(count_monitor(spec, asked, estimator, jobs, show))


class TrustMonitor(Shown):
    """A trust monitor with its alarms counted; made by ``harness.count_monitor``.

    Attributes:
        text: Of ``monitor.toml``, which ``harness.export_estimator`` takes.
    """

    def __init__(self, counted: Counted) -> None:
        self._counted, self.text = counted, counted.monitor.text

    @property
    def answer(self) -> str:
        """The result in sentences."""
        from harness.remedy.monitor.answer import in_short

        return " ".join(in_short(self._counted))

    @property
    def counts(self) -> pd.DataFrame:
        """Shares of samples by ``(target, design, level)``, area under the curve, and median delay in s."""
        import numpy as np
        import pandas as pd

        rows = {}
        for level in self._counted.levels:
            for t, target in enumerate(self._counted.targets):
                c = level.counts[t]
                wrong = c.wrong.sum()
                rows[target, level.design, level.label] = {
                    "in_error": c.wrong_share,
                    "said": c.said_share,
                    "not_trusted": c.warned.sum() / wrong if wrong else np.nan,
                    "false": c.false_share,
                    "area": level.areas[t].value,
                    "delay": self._counted.delay(c),
                }
        table = pd.DataFrame.from_dict(rows, orient="index")
        table.index = pd.MultiIndex.from_tuples(rows, names=["target", "design", "level"])
        return table

    def report(self, folder: str | Path | None = None, command: str = "h.count_monitor") -> list[Path]:
        """Write ``monitor.toml``, ``report.html`` and ``report.pdf``; return their paths.

        Args:
            folder: Where to; ``results/monitor-<study>-<estimator>`` by default.
            command: That made it, for the record.

        Raises:
            UserError: If the folder cannot be written to.
        """
        from harness.realtime.export.interface import identifier
        from harness.remedy.monitor.report import write_monitor

        name = identifier(f"{self._counted.study.name}_{self._counted.study.estimators[0].name}")
        return write_monitor(
            self._counted, Path("results") / f"monitor-{name}" if folder is None else Path(folder), command
        )

    def _facts(self) -> Mapping[str, Any]:
        return {"answer": self.answer}

    def _table(self) -> tuple[pd.DataFrame, str]:
        return self.counts, "what the monitor says of errors"
