"""``harness.try_remedies``: what helps where a parameter is not as believed."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

from harness.api._show import IN_PYTHON, Shown
from harness.api.study import Study

if TYPE_CHECKING:
    import pandas as pd

    from harness.remedy.run import Tried


def try_remedies(
    study: Study,
    folder: str | Path | None = None,
    *,
    estimator: str | None = None,
    equipment: int = 2,
    trace: str | Path | None = None,
    jobs: int | None = None,
    agree: Callable[[str], None] | None = None,
    restart: bool = False,
) -> Remedies:
    """Try what helps where a parameter is not as believed, on the very same points, drives and noise.

    Estimate the parameters that drive the error, consider them, other noise, more sensors, and together.

    Args:
        study: The study.
        folder: Result folder, ``results/remedy-<name>`` by default; each remedy gets one in it, and what is finished is
            kept.
        estimator: Name of an estimator of the study; its EKF by default.
        equipment: How many larger sets of sensors are tried, those of most promise.
        trace: Folder that ``harness trace`` wrote: the vehicle has the named effect then, the belief not.
        jobs: Threads; all cores by default.
        agree: As of ``Study.run``.
        restart: Throw away the results that are in the folder.

    Returns:
        What each remedy gains.

    Raises:
        UserError: If there is no such estimator, or no parameter drives the error.

    Example:
        >>> import harness as h
        >>> study = h.Study(
        ...     plant=h.model("car", "govindarajan_2018", sensors="car_series"),
        ...     targets=["lateral_velocity"],
        ...     drives=[h.drive("sine", duration="10 s", amplitude="20 deg")],
        ...     estimators=["ekf"],
        ...     designs=[h.levels("mass", ["1.5 t", "1.8 t"], repeats=4)],
        ... )
        >>> remedies = h.try_remedies(study, "results/remedy-mass")  # doctest: +SKIP
        >>> print(remedies.answer)  # doctest: +SKIP
    """
    from harness.remedy.run import traced_study
    from harness.remedy.run import try_remedies as run

    spec = study.spec if trace is None else traced_study(study.spec, Path(trace))
    out = Path("results") / f"remedy-{spec.name}" if folder is None else Path(folder)
    return Remedies(run(spec, out, estimator, equipment, jobs, agree, restart), out)


class Remedies(Shown):
    """Remedies as tried; made by ``harness.try_remedies``."""

    def __init__(self, tried: Tried, folder: Path) -> None:
        self._tried, self._folder = tried, folder

    @property
    def best(self) -> str:
        """The one to take, in words."""
        return self._tried.best.remedy.words

    @property
    def answer(self) -> str:
        """The result in sentences."""
        from harness.remedy.answer import answer

        return answer(self._tried)

    @property
    def errors(self) -> pd.DataFrame:
        """Error over that of the study as it is, a row per remedy in words; column ``error``."""
        import pandas as pd

        from harness.remedy.judge import harm

        first = self._tried.outcomes[0]
        rows = {o.remedy.words: harm(o, first) for o in self._tried.outcomes}
        return pd.DataFrame({"error": rows}).rename_axis("remedy")

    def report(self, command: str = IN_PYTHON) -> list[Path]:
        """Write the report, ``belief.toml`` and ``study.toml`` into the folder and return their paths.

        Args:
            command: How it was made, as the report says.

        Raises:
            UserError: If the folder cannot be written to.
        """
        from harness.remedy.report import write_remedy

        return write_remedy(self._tried, self._folder, command)

    def _facts(self) -> dict[str, Any]:
        return {"study": self._tried.study.name, "best": self.best, "answer": self.answer}

    def _table(self) -> tuple[pd.DataFrame, str]:
        return self.errors, f"{len(self.errors)} remedies"
