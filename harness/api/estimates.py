"""``harness.estimate``: estimators compared on recordings, with files and a report."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor, as_completed
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

from harness.api._show import IN_PYTHON, Shown
from harness.api.estimator import Estimator, believed_on
from harness.api.model import Model
from harness.api.recordings import recordings_of

if TYPE_CHECKING:
    import pandas as pd
    import xarray as xr

    from harness.recorded.report import Estimated
    from harness.recorded.run import RecordedEstimator, RecordedModel


def estimate(
    model: Model,
    recordings: Any,
    estimators: Mapping[str, Estimator | str] | Sequence[Estimator | str] | Estimator | str,
    *,
    signals: Sequence[str] = (),
    references: Mapping[str, str] | None = None,
    inputs: Literal["joined", "held"] = "joined",
    seed: int = 0,
    jobs: int | None = None,
) -> Estimates:
    """Run estimators on recordings and compare them.

    Args:
        model: What they believe, with unknown inputs if there are any. Sensors and step are those of the recordings
            where they are not stated.
        recordings: Recording or list of them: paths, DataFrames or Datasets, see ``harness.read_recording``.
        estimators: Kind or estimator by its name in tables and figures; without names, one of them or a list.
        signals: Ports and inputs to estimate in addition to every state and every measured quantity.
        references: Signal of the recordings by the state or port that it is the reference of, see ``Estimator.run``.
        inputs: How recorded inputs run between samples, see ``Estimator.run``.
        seed: Of estimators that draw random numbers.
        jobs: Threads; all cores by default.

    Returns:
        What they say, and how well it agrees with what is known.

    Raises:
        UserError: If recordings, model and estimators do not fit each other, or two estimators have one name.
        ModelError: If there is no such estimator.

    Example:
        >>> import harness as h
        >>> car = h.model("car", "govindarajan_2018", sensors="car_series")
        >>> run = h.simulate(car, h.drive("sine", duration="10 s", amplitude="20 deg"), seed=1)
        >>> found = h.estimate(car, run, ["ekf", h.Estimator("ukf", alpha=0.5)])
        >>> list(found.runs)
        [('sine', 'EKF'), ('sine', 'UKF alpha=0.5')]
        >>> bool(found.errors.rmse[("sine", "EKF", "lateral_velocity")] < 0.1)
        True
    """
    named = _named(estimators)
    given = named_apart(recordings_of(recordings, "recordings"))
    believed = believed_on(model, given, signals, references, inputs, jobs)
    compiled = [e.on(believed, name) for name, e in named.items()]
    runs = _run(believed, compiled, given, seed, jobs)
    return Estimates(believed, given, runs, [sentence for e in compiled for sentence in e.lost()])


def _named(given: Any) -> dict[str, Estimator]:
    """Return estimators by name; what has none is called by its kind and settings."""
    from harness.common.errors import UserError

    if isinstance(given, Mapping):
        return {str(name): _made(each) for name, each in given.items()}
    named: dict[str, Estimator] = {}
    for each in map(_made, [given] if isinstance(given, str | Estimator) else given):
        name = " ".join([each.kind.upper(), *(f"{k}={_short(v)}" for k, v in each.settings.items())])
        if name in named:
            raise UserError(f"estimators: {name} is asked for twice")
        named[name] = each
    if not named:
        raise UserError("estimators: give at least one")
    return named


def _made(given: Estimator | str) -> Estimator:
    return Estimator(given) if isinstance(given, str) else given


def _short(value: Any) -> str:
    return f"{value:g}" if isinstance(value, float) else str(value)


def named_apart(recordings: list[xr.Dataset]) -> list[xr.Dataset]:
    """Return recordings each with a name of its own (internal)."""
    from harness.identification.measured_file import names_of

    return [r.assign_attrs(name=name) for r, name in zip(recordings, names_of(recordings), strict=True)]


def _run(
    model: RecordedModel,
    estimators: Sequence[RecordedEstimator],
    recordings: Sequence[xr.Dataset],
    seed: int,
    jobs: int | None,
) -> list[xr.Dataset]:
    """Return the runs by recording, then by estimator."""
    from rich.console import Console
    from rich.progress import TimeElapsedColumn

    from harness.common.stages import bar

    drives = [model.drive(r, r.attrs["name"]) for r in recordings]
    tasks = [(i, e) for i in range(len(recordings)) for e in range(len(estimators))]
    runs: dict[tuple[int, int], xr.Dataset] = {}
    shown = bar(Console(stderr=True), TimeElapsedColumn(), widest=30)
    with shown as progress, ThreadPoolExecutor(jobs) as pool:
        task_shown = progress.add_task("compiling and estimating", total=len(tasks))
        futures = {pool.submit(estimators[e].run, recordings[i], seed, drives[i]): (i, e) for i, e in tasks}
        for future in as_completed(futures):
            runs[futures[future]] = future.result()
            progress.advance(task_shown)
    return [runs[task] for task in tasks]


class Estimates(Shown):
    """What estimators say of recordings; made by ``harness.estimate``."""

    def __init__(
        self,
        model: RecordedModel,
        recordings: Sequence[xr.Dataset],
        runs: Sequence[xr.Dataset],
        lost: Sequence[str] = (),
    ) -> None:
        from harness.recorded.report import Estimated
        from harness.recorded.summary import summary
        from harness.recordings.check.examine import recording_warnings

        said = [*recording_warnings(recordings), *lost]
        self._estimated: Estimated = Estimated(model.spec.vehicle, runs, [summary(r) for r in runs], said)

    @property
    def runs(self) -> dict[tuple[str, str], xr.Dataset]:
        """The estimates over time by ``(recording, estimator)``, each as ``Estimator.run`` returns it."""
        return {(r.attrs["recording"], r.attrs["estimator"]): r for r in self._estimated.runs}

    @property
    def summary(self) -> pd.DataFrame:
        """How consistent each estimator is, a row per ``(recording, estimator)``.

        Columns ``log_likelihood``, ``nis`` and ``nees`` over their degrees of freedom (1 if the stated covariance is
        right), ``nis_inside`` and ``nees_inside`` (share in the 95 % band), ``updates`` (samples), ``diverged_at`` (s,
        NaN if it did not), ``repairs`` (samples).
        """
        import pandas as pd

        columns = [
            "log_likelihood", "nis", "nis_inside", "nees", "nees_inside", "updates", "diverged_at", "repairs",
        ]  # fmt: skip
        rows = [[getattr(s, c) for c in columns] for s in self._estimated.summaries]
        names = [(s.recording, s.estimator) for s in self._estimated.summaries]
        return pd.DataFrame(rows, pd.MultiIndex.from_tuples(names, names=["recording", "estimator"]), columns)

    @property
    def errors(self) -> pd.DataFrame:
        """Estimate less reference, a row per ``(recording, estimator, signal)`` with a reference; SI units.

        Columns ``rmse``, ``bias``, ``largest``, ``nees`` (mean of the squared error over its stated variance),
        ``inside`` (share in the 95 % band), ``unit``.
        """
        import pandas as pd

        from harness.models.signals import SIGNALS

        rows = {
            (s.recording, s.estimator, n): (e.rmse, e.bias, e.largest, e.nees, e.inside, SIGNALS[n].unit)
            for s in self._estimated.summaries
            for n, e in s.errors.items()
        }
        index = pd.MultiIndex.from_tuples(list(rows), names=["recording", "estimator", "signal"])
        return pd.DataFrame(list(rows.values()), index, ["rmse", "bias", "largest", "nees", "inside", "unit"])

    @property
    def answer(self) -> str:
        """The result in sentences."""
        return self._estimated.answer

    @property
    def notes(self) -> list[str]:
        """What is irregular about the recordings, and what the estimates leave out."""
        from harness.recorded.run import certain_in_words, inputs_in_words

        runs = self._estimated.runs
        return [*self._estimated.warnings, *certain_in_words(runs), inputs_in_words(runs)]

    def report(
        self,
        folder: str | Path,
        command: str = IN_PYTHON,
        form: Literal["csv", "parquet", "nc", "mf4", "mcap"] = "csv",
    ) -> list[Path]:
        """Write ``report.html``, ``report.pdf``, ``estimate.json`` and a file per recording and estimator.

        Args:
            folder: Where to; the estimates over time go to ``estimates`` in it.
            command: How it was made, as the report says.
            form: Of the estimates: ``nc`` keeps CF attributes, the others have a column per variable; ``mf4``, ``mcap``
                and the column ``log_time`` of ``parquet`` have the stamps of the log.

        Returns:
            Their paths.

        Raises:
            UserError: If the folder cannot be written to.
        """
        from harness.common.places import inside
        from harness.recorded.report import report, write_estimates, write_numbers
        from harness.recorded.run import inputs_in_words

        folder = Path(folder)
        files = write_estimates(inside(folder, "estimates"), self._estimated.runs, form)
        numbers = write_numbers(folder, self._estimated.summaries, self.answer, inputs_in_words(self._estimated.runs))
        return [*report(self._estimated, command).write(folder), numbers, *files]

    def _facts(self) -> dict[str, Any]:
        recordings, estimators = (dict.fromkeys(k[i] for k in self.runs) for i in (0, 1))
        return {"answer": self.answer, "recordings": ", ".join(recordings), "estimators": ", ".join(estimators)}

    def _table(self) -> tuple[pd.DataFrame, str]:
        table = self.errors if len(self.errors) else self.summary
        return table, f"{len(table)} rows"
