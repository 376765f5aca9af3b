"""``harness.Diagnosis``: which physical effect a model lacks, and which parameter is wrong."""

from __future__ import annotations

import tempfile
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, Self

from harness.api._show import IN_PYTHON, Shown
from harness.api.model import Model, model_of
from harness.api.recordings import recordings_of

if TYPE_CHECKING:
    import pandas as pd

    from harness.config import ModelSpec
    from harness.diagnosis.model.hypotheses import Hypothesis
    from harness.diagnosis.result.answer import Value
    from harness.diagnosis.result.outcome import Outcome


@dataclass(frozen=True)
class TraceNumbers:
    """What of the outcome of a trace is pickled."""

    verdict: str
    answer: str
    added: tuple[Hypothesis, ...]
    values: dict[str, tuple[Value, ...]]
    nominal: ModelSpec
    amended: ModelSpec
    record: dict[str, Any]


def _numbers(outcome: Any) -> TraceNumbers | None:
    """Return what is pickled of the outcome of a trace."""
    if outcome is None or isinstance(outcome, TraceNumbers):
        return outcome
    from harness.diagnosis.result.record import record

    names = ("verdict", "answer", "added", "values", "nominal", "amended")
    return TraceNumbers(**{name: getattr(outcome, name) for name in names}, record=record(outcome))


class Diagnosis(Shown):
    """A search for what a model lacks that recordings can show (docs/trace.md).

    Args:
        free: Parameters of the nominal model that are fitted in any case; cornering stiffnesses by default.
        estimators: Kinds of estimators run on the held-out recordings with the nominal and the amended model; by
            default those that say so in their files (``IN_TRACE``): EKF, UKF and CDKF.
        study: Study file of the same vehicle that measures what the amendment gains.
        repeats: Noise realisations of each level of that study.
        jobs: Threads; all cores by default.

    What was found is in ``verdict_``, ``answer_``, ``effects_``, ``amended_``, ``nominal_`` and ``record_``.

    Raises:
        ModelError: If there is no such estimator.

    Example:
        >>> import harness as h
        >>> h.Diagnosis(estimators=["ekf"])
        Diagnosis
          estimators: ekf
          verdict: not fitted yet
    """

    def __init__(
        self,
        free: Sequence[str] = (),
        estimators: Sequence[str] | None = None,
        study: str | Path | None = None,
        repeats: int = 8,
        jobs: int | None = None,
    ) -> None:
        from harness.config.roles import ESTIMATORS

        self._stated_estimators = estimators is not None
        if estimators is None:
            from harness.estimation.contract import traced

            estimators = traced()
        self.free = (free,) if isinstance(free, str) else tuple(free)
        self.estimators = (estimators,) if isinstance(estimators, str) else tuple(estimators)
        for kind in self.estimators:
            ESTIMATORS.load(kind, ())
        self.study = None if study is None else Path(study)
        self.repeats, self.jobs = repeats, jobs
        self._outcome: Outcome | TraceNumbers | None = None

    def fit(
        self,
        model: Model | None,
        train: Any,
        test: Any,
        folder: str | Path | None = None,
        baseline: Any = (),
        after: str | Path | None = None,
    ) -> Self:
        """Find what the model lacks, or what has changed since earlier recordings of the vehicle.

        Args:
            model: The nominal model. Sensors and step are those of the recordings where they are not stated, and it is
                integrated finely. ``None`` is that of the trace ``after``.
            train: Recordings to fit: paths, DataFrames or Datasets, see ``harness.read_recording``.
            test: Held-out recordings, on which every addition has to prove itself. With ``after`` there may be none:
                then those of that trace judge alone, and what was expected of planned drives is not compared.
            baseline: Earlier recordings of the vehicle, two or more: the model and its discrepancy are learnt from
                them, and what is sought is the difference.
            after: Folder of an earlier trace behind which drives were planned (``harness.next_drive``). Its recordings
                are added to those that are stated, and the answer says whether what was expected came true.
            folder: Where ``trace.json`` and both models are written as soon as there is a verdict; nowhere by default.

        Returns:
            Itself, with ``verdict_`` and the other attributes.

        Raises:
            UserError: If recordings and model do not fit each other, or the recordings are too short or too calm.
            ModelError: If there is no such estimator.
        """
        from rich.console import Console

        from harness.common.errors import UserError
        from harness.diagnosis.earlier_trace import EarlierTrace
        from harness.diagnosis.run import TraceTask, run_trace
        from harness.identification.common_step import at_common_step
        from harness.identification.data import refuse_the_same, step_of
        from harness.identification.earlier_result import with_absolute_paths
        from harness.identification.measured_file import finely, fitted_parameters

        before = None if after is None else EarlierTrace.read(Path(after))
        fitted = recordings_of(train, "train")
        none = test is None or (isinstance(test, list | tuple) and not test)
        held_out = [] if before is not None and none else recordings_of(test, "test")
        estimators = self.estimators
        if before is not None:
            if folder is not None:
                before.refuse_folder(Path(folder))
            if not self._stated_estimators:
                estimators = tuple(before.content["asked"].get("estimators", estimators))
            if len(baseline):
                raise UserError("after: planned drives cannot be evaluated together with changes since a baseline")
            fitted, held_out = before.joined(fitted, held_out)
            model = Model(before.model) if model is None else model
        if model is None:
            raise UserError("model: give the nominal model; only with after it is that of the earlier trace")
        earlier = recordings_of(baseline, "baseline") if len(baseline) else []
        of_train, of_test = len(fitted), len(fitted) + len(held_out)
        together = at_common_step([*fitted, *held_out, *earlier])
        fitted, held_out, earlier = together[:of_train], together[of_train:of_test], together[of_test:]
        refuse_the_same([*fitted, *earlier], held_out)
        refuse_the_same(earlier, fitted, "train", "in the baseline")
        for i, recording in enumerate(earlier):
            refuse_the_same(earlier[:i], [recording], "baseline", "in the baseline")
        table, notes = model.completed([*fitted, *held_out, *earlier])
        spec = finely(table, step_of(fitted[0]), f"model '{model.vehicle}'")
        free = fitted_parameters(spec, self.free or (before.free if before else ()), "free")
        task = TraceTask(
            spec, fitted, held_out, free, estimators, self.study, self.repeats, jobs=self.jobs, notes=notes
        )
        task = replace(task, baseline=tuple(earlier), stated=with_absolute_paths(table), after=before)
        task = task if before is None else replace(task, **before.search)
        if folder is None:
            self._scratch = tempfile.TemporaryDirectory(prefix="diagnosis-")  # tracebacks, and scores of the study
        where = Path(self._scratch.name if folder is None else folder)
        self._outcome = run_trace(task, where, Console(stderr=True))
        return self

    @property
    def verdict_(self) -> str:
        """``adequate``, ``amended`` or ``unresolved``."""
        return str(self._fitted_outcome.verdict)

    @property
    def answer_(self) -> str:
        """The result in sentences."""
        return self._fitted_outcome.answer

    @property
    def effects_(self) -> pd.DataFrame:
        """What was added, a row per parameter.

        Index ``(addition, parameter)``; columns ``kind`` (``effect`` or ``parameter``), ``value``, ``standard_error``,
        ``unit`` (SI).
        """
        import pandas as pd

        outcome = self._fitted_outcome
        rows = {
            (h.name, v.name): (h.kind, v.value, v.std, v.unit) for h in outcome.added for v in outcome.values[h.name]
        }
        index = pd.MultiIndex.from_tuples(list(rows), names=["addition", "parameter"])
        return pd.DataFrame(list(rows.values()), index=index, columns=["kind", "value", "standard_error", "unit"])

    @property
    def amended_(self) -> Model:
        """The amended model."""
        return model_of(self._fitted_outcome.amended)

    @property
    def nominal_(self) -> Model:
        """The nominal model, refitted."""
        return model_of(self._fitted_outcome.nominal)

    @property
    def record_(self) -> dict[str, Any]:
        """Everything as ``trace.json`` has it, SI units."""
        outcome = _numbers(self._fitted_outcome)
        assert outcome is not None
        return outcome.record

    @property
    def _fitted_outcome(self) -> Outcome | TraceNumbers:
        if self._outcome is None:
            raise AttributeError("nothing was fitted yet; call fit(model, train, test) first")
        return self._outcome

    def __getstate__(self) -> dict[str, Any]:
        """Return what is pickled: of the outcome its numbers, without the kernels that figures are made with."""
        return {**vars(self), "_outcome": _numbers(self._outcome), "_scratch": None}

    def _state(self) -> Any:
        return self.__getstate__()

    def report(self, folder: str | Path, command: str = IN_PYTHON) -> list[Path]:
        """Write ``report.html``, ``report.pdf``, ``trace.json``, ``nominal.toml`` and ``amended.toml``.

        There is no ``amended.toml`` where what was added is worse than nothing on the held-out drives.

        Args:
            folder: Where to.
            command: How it was made, as the report says.

        Returns:
            Their paths.

        Raises:
            UserError: If the folder cannot be written to, or nothing was fitted yet.
        """
        from harness.common.errors import UserError
        from harness.diagnosis.report.report import report
        from harness.diagnosis.result.record import write_outcome

        if self._outcome is None:
            raise UserError("the diagnosis has nothing to report yet; call fit(model, train, test) first")
        if isinstance(self._outcome, TraceNumbers):
            raise UserError("the diagnosis comes from a pickle, which holds no figures; report before it is pickled")
        outcome = self._outcome
        written = report(outcome, command).write(Path(folder), failures=outcome.failures)
        return [*written, *write_outcome(outcome, Path(folder))]

    def _facts(self) -> dict[str, Any]:
        return {
            "free": ", ".join(self.free),
            "estimators": ", ".join(self.estimators),
            "study": self.study,
            "verdict": getattr(self, "verdict_", "not fitted yet"),
            "answer": getattr(self, "answer_", ""),
        }

    def _table(self) -> tuple[pd.DataFrame, str] | None:
        return None if self._outcome is None else (self.effects_, f"{len(self.effects_)} parameters of additions")
