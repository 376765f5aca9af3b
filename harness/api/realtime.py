"""``harness.time_steps``: how long a step of each estimator takes on one core."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

from harness.api._show import Shown
from harness.api.study import Study

if TYPE_CHECKING:
    import pandas as pd
    import xarray as xr


def time_steps(study: Study, *, drive: str | None = None, duration: float | str = "30 s") -> RealTime:
    """Time single steps of every estimator of a study on one core, back to back and one in every cycle.

    Args:
        study: The study; its designs do not matter.
        drive: Name of one of its drives; the first by default.
        duration: How much of it is timed, in s or text with a unit.

    Returns:
        The times.

    Raises:
        UserError: If there is no such drive, it is shorter, the system lacks the clock, or an estimator diverges.

    Example:
        >>> import harness as h
        >>> study = h.Study(
        ...     plant=h.model("car", "govindarajan_2018", sensors="car_series"),
        ...     targets=["lateral_velocity"],
        ...     drives=[h.drive("sine", duration="10 s", amplitude="20 deg")],
        ...     estimators=["ekf"],
        ...     designs=[h.design("nominal")],
        ... )
        >>> times = h.time_steps(study, duration="2 s")
        >>> times.times.step_time.dims, times.quantiles.columns.tolist()
        (('pace', 'estimator', 'time'), ['median', 'one_in_a_thousand', 'longest', 'mean'])
    """
    from rich.console import Console

    from harness.common.stages import showing
    from harness.common.units import to_si
    from harness.realtime.measure import contestants, measure
    from harness.realtime.outcome import judge

    spec, seconds = study.spec, to_si(duration, "s", "duration")
    chosen, cycle = drive if drive is not None else spec.drives[0].name, spec.belief.step
    with showing(Console(stderr=True), "building models and drives") as show:
        field = contestants(spec, chosen, seconds)
        return RealTime(judge(measure(field, round(seconds / cycle) + 1, cycle, show), spec, chosen))


class RealTime(Shown):
    """Times of steps; made by ``harness.time_steps``.

    Attributes:
        times: ``step_time (pace, estimator, time)`` in s, ``interrupted``, ``quantile``, ``mean`` and ``ratio`` to the
            reference estimator with its 95 % interval.
    """

    def __init__(self, times: xr.Dataset) -> None:
        self.times = times

    @property
    def quantiles(self) -> pd.DataFrame:
        """Times in s by ``(pace, estimator)``: ``median``, ``one_in_a_thousand``, ``longest``, ``mean``."""
        import pandas as pd

        paces, estimators = (self.times[name].values.tolist() for name in ("pace", "estimator"))
        index = pd.MultiIndex.from_product([paces, estimators], names=["pace", "estimator"])
        shares = self.times["quantile"].values.reshape(len(index), -1)
        table = pd.DataFrame(shares, index=index, columns=["median", "one_in_a_thousand", "longest"])
        return table.assign(mean=self.times["mean"].values.ravel())

    @property
    def answer(self) -> str:
        """The result in sentences."""
        from harness.realtime.report import answer

        return answer(self.times)

    def report(self, folder: str | Path | None = None) -> list[Path]:
        """Write ``times.zarr``, ``report.html`` and ``report.pdf``; return the paths of the report.

        Args:
            folder: Where to; ``results/realtime-<name of the study>`` by default.

        Raises:
            UserError: If the folder cannot be written to.
        """
        from harness.realtime.outcome import write
        from harness.realtime.report import report
        from harness.reporting.hooks import first_page

        folder = Path("results") / f"realtime-{self.times.attrs['study_name']}" if folder is None else Path(folder)
        write(self.times, folder)
        return report(self.times, first_page("times", self.times, folder)).write(folder)

    def _facts(self) -> dict[str, Any]:
        return {"answer": self.answer}

    def _table(self) -> tuple[pd.DataFrame, str]:
        return self.quantiles, "times of a step in s"
