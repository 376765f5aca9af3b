"""``harness.next_drive``: the drives that tell most of what an identification, a trace or a study left open."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from copy import deepcopy
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

from harness.api._show import IN_PYTHON, Shown

if TYPE_CHECKING:
    import pandas as pd

    from harness.experiment.run import Designed


def next_drive(
    result: str | Path,
    *,
    wanted: Sequence[str] | Mapping[str, float] | None = None,
    criterion: Literal["D", "A", "c"] = "D",
    limits: str | Path | Mapping[str, float | str] | None = None,
    budget: float | str = 60.0,
    manoeuvres: Sequence[str] | None = None,
    effort: int = 24,
    sensors: bool = False,
    seed: int = 0,
    jobs: int | None = None,
) -> NextDrive:
    """Plan the drives that tell most of what a result left open.

    Args:
        result: Folder of ``harness identify``, ``trace`` or ``run``; of a trace its confusable models are told apart,
            of a study the errors of its estimators become small.
        wanted: Parameters that count, or their weights in a combination; those that are not determined by default. Of
            a trace effects whose detection limits are to be lowered. Of a study targets and estimators, all by default,
            and a design, the first population by default.
        criterion: ``D``, the volume of their confidence ellipsoid; ``A``, the sum of their variances; ``c``, the
            variance of their combination.
        limits: TOML file, or limits by name: numbers in SI units, or text with a unit (docs/next-drive.md).
        budget: Driving time, in s or with a unit.
        manoeuvres: Names; all by default.
        effort: Drives that are tried of each manoeuvre.
        sensors: Also judge the planned drives with every set of sensors of the vehicle.
        seed: Of the drives tried.
        jobs: Threads; all cores by default.

    Returns:
        The drives, and what is expected behind them.

    Raises:
        UserError: If the folder holds no such result, something stated is unknown, or no drive keeps to the limits.

    Example:
        >>> import harness as h
        >>> plan = h.next_drive("results/fit", limits={"road_width": "12 m"})  # doctest: +SKIP
        >>> print(plan.answer)  # doctest: +SKIP
    """
    from rich.console import Console

    from harness.common.stages import showing
    from harness.common.units import to_si
    from harness.experiment.limits import limits_of
    from harness.experiment.run import DesignTask, design_drives

    file, single = (None, limits or {}) if isinstance(limits, Mapping | None) else (Path(limits), {})
    task = DesignTask(
        Path(result),
        dict(wanted) if isinstance(wanted, Mapping) else dict.fromkeys(wanted or (), 1.0),
        criterion,
        limits_of(file, single),
        to_si(budget, "s", "budget"),
        tuple(manoeuvres or ()),
        effort,
        sensors,
        seed,
        jobs,
    )
    with showing(Console(stderr=True), "reading the result") as show:
        return NextDrive(design_drives(task, show))


class NextDrive(Shown):
    """Drives as planned; made by ``harness.next_drive``."""

    def __init__(self, designed: Designed) -> None:
        self._designed = designed

    @property
    def answer(self) -> str:
        """The drives, and what is expected behind them."""
        from harness.experiment.report import answer

        return answer(self._designed)

    @property
    def open(self) -> tuple[str, ...]:
        """What stays open, in sentences."""
        return self._designed.expectation.open

    @property
    def drives(self) -> dict[str, tuple[dict[str, Any], int]]:
        """The drives in their order: by name the keys of ``[[drive]]``, and how often each is driven."""
        from harness.experiment.files import names_of, table

        sequence = self._designed.plan.sequence
        return {n: (table(t.rehearsed.drive, n), times) for n, (t, times) in zip(names_of(self._designed), sequence,
                strict=True)}  # fmt: skip

    @property
    def expected(self) -> dict[str, Any]:
        """What is expected behind the drives, as ``expected`` of ``next_drive.json``."""
        return deepcopy(dict(self._designed.expectation.record))

    @property
    def ranked(self) -> pd.DataFrame:
        """The best drive of each manoeuvre, repeated alone for the budget: ``times``, ``seconds``, ``value``."""
        import pandas as pd

        rows = {t.manoeuvre.name: (t.times, t.seconds, t.value) for t in self._designed.plan.ranked}
        columns = ["times", "seconds", "value"]
        return pd.DataFrame.from_dict(rows, orient="index", columns=columns).rename_axis("manoeuvre")

    def report(self, folder: str | Path, command: str = IN_PYTHON) -> list[Path]:
        """Write the drives, ``next_drive.json`` and the report into a folder and return their paths.

        Args:
            folder: Where to.
            command: How it was made, as the report says.

        Raises:
            UserError: If the folder cannot be written to.
        """
        from harness.experiment.report import write_design

        return write_design(self._designed, Path(folder), command)

    def _facts(self) -> dict[str, Any]:
        return {"answer": self.answer, "open": "; ".join(self.open)}

    def _table(self) -> tuple[pd.DataFrame, str]:
        return self.ranked, f"{len(self.ranked)} manoeuvres"
