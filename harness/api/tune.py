"""``harness.tune`` and ``harness.tune_noise``: the noise that estimators believe, of a study or from recordings."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

from harness.api._show import IN_PYTHON, Shown
from harness.api.model import Model, model_of
from harness.api.study import Study
from harness.common.errors import UserError

if TYPE_CHECKING:
    import pandas as pd

    from harness.config import DesignSpec, StudySpec
    from harness.recorded.tuning import NoiseTuning
    from harness.study.tune import Tuning as Factors
    from harness.study.worst_case import WorstCase


def tune(
    study: Study | str | Path,
    drives: str | Path,
    *,
    estimators: Sequence[str] = (),
    budget: int = 240,
    repeats: int = 1,
    objective: Literal["likelihood", "worst-case"] = "likelihood",
    design: str | None = None,
    points: int = 32,
    jobs: int | None = None,
) -> TunedStudy:
    """Tune the noise that the estimators of a study believe, by factors on groups of variances.

    Args:
        study: The study, or its file, which may name the tuning that is still to be written.
        drives: Training drives: a name in ``studies/drives`` or a TOML file.
        estimators: Names of those that are tuned; all that state a covariance by default.
        budget: Candidates per estimator.
        repeats: Noise realisations of each drive, of the likelihood.
        objective: The likelihood of the innovations at the nominal plant, or the mean error of the worst twentieth of
            the runs in the box of a design.
        design: Design whose box that is; the first one by default.
        points: Points of that box; powers of two fill it best.
        jobs: Threads of the worst case; all cores by default.

    Returns:
        The factors, and what they change.

    Raises:
        UserError: If there are no such drives, design or estimators, none states a likelihood, or the budget is too
            small.

    Example:
        >>> import tempfile, pathlib, harness as h
        >>> drives = pathlib.Path(tempfile.mkdtemp()) / "training.toml"
        >>> _ = drives.write_text('''[[drive]]
        ... name = "sine"
        ... kind = "sine"
        ... amplitude = "20 deg"
        ... duration = "5 s"
        ... ''')
        >>> car, sine = h.model("car", "govindarajan_2018", sensors="car_series"), h.drive("sine", amplitude="20 deg")
        >>> study = h.Study(
        ...     car, targets=["yaw_rate"], drives=sine, estimators=["ekf"], designs=[h.design("nominal")]
        ... )
        >>> tuned = h.tune(study, drives, budget=48)
        >>> sorted(tuned.factors.columns)
        ['after', 'before', 'measurement', 'process', 'unknown_inputs']
    """
    from rich.console import Console

    from harness.common.stages import showing
    from harness.config import load_drives, load_study
    from harness.study import tune as likelihood
    from harness.study import worst_case

    spec = load_study(study, tuned=False) if not isinstance(study, Study) else _untuned(study.spec)
    training = replace(spec, drives=load_drives(str(drives), spec.path.parent))
    with showing(Console(stderr=True), "tuning") as show:
        if objective == "likelihood":
            if design is not None:
                raise UserError("a design is for the worst case: the likelihood is that of the nominal plant")
            factors = likelihood.tune(training, budget, repeats, lambda name: show(f"tuning {name}"), estimators)
            return TunedStudy(training, factors, budget, repeats)
        box = _box(spec, design)
        worst = worst_case.tune_for_worst_case(
            training, box, budget, points, estimators, jobs=jobs, progress=lambda name: show(f"tuning {name}")
        )
    return TunedStudy(training, worst, budget, points, box)


def _untuned(spec: StudySpec) -> StudySpec:
    return replace(spec, tuning="", estimators=tuple(replace(e, noise={}) for e in spec.estimators))


def _box(spec: StudySpec, design: str | None) -> DesignSpec:
    from harness.common.registry import closest

    names = [d.name for d in spec.designs]
    if design is not None and design not in names:
        raise UserError(f"design {design}: study '{spec.name}' has no such design{closest(design, names)}")
    return spec.design(design or names[0])


class TunedStudy(Shown):
    """Tuned noise of the estimators of a study; made by ``harness.tune``."""

    def __init__(
        self,
        training: StudySpec,
        tuned: Mapping[str, Factors] | Mapping[str, WorstCase],
        budget: int,
        runs: int,
        box: DesignSpec | None = None,
    ) -> None:
        self._training, self._budget, self._runs, self._box = training, budget, runs, box
        self._tuned: dict[str, Any] = dict(tuned)

    @property
    def factors(self) -> pd.DataFrame:
        """Factors on the variances, a row per estimator.

        Columns ``process``, ``unknown_inputs``, ``measurement``; ``before`` and ``after``, the log-likelihood of the
        training drives, or the error of the worst case over that with the noise as it is.
        """
        import pandas as pd

        from harness.config import NOISE_GROUPS

        rows = {}
        for name, tuned in self._tuned.items():
            after: Any = tuned.after
            factors = tuned.factors if self._box is None else after.factors
            ends = (tuned.before, after) if self._box is None else (tuned.before.worst, after.worst)
            rows[name] = [*(factors.get(group, 1.0) for group in NOISE_GROUPS), *ends]
        columns = [*NOISE_GROUPS, "before", "after"]
        return pd.DataFrame.from_dict(rows, orient="index", columns=columns).rename_axis("estimator")

    @property
    def answer(self) -> str:
        """The result in sentences."""
        if self._box is not None:
            from harness.study.worst_case_report import answer

            return answer(self._tuned)
        gains = (f"{name} from {row.before:.1f} to {row.after:.1f}" for name, row in self.factors.iterrows())
        return f"Log-likelihood of the training drives: {', '.join(gains)}."

    @property
    def notes(self) -> list[str]:
        """Factors that lie at an end of the search."""
        return [
            f"{name}: the factor on {group} lies at the end of the search; state that noise anew"
            for name, tuned in self._tuned.items()
            for group in getattr(tuned, "at_the_edge", [])
        ]

    def write(self, path: str | Path, command: str = IN_PYTHON) -> list[Path]:
        """Write the file that a study names by ``tuning``, with a report of the worst case; return the paths.

        Raises:
            UserError: If it cannot be written.
        """
        from harness.study import worst_case, worst_case_report
        from harness.study.tune import write_tuning

        training, box, budget, runs = self._training, self._box, self._budget, self._runs
        path = Path(path) if box is None else toml_file(path)
        if box is None:
            write_tuning(path, training, budget, runs, self._tuned, command)
            return [path]
        worst_case.write_worst_case(path, training, box, budget, runs, self._tuned, command)
        report = worst_case_report.report(training, box, self._tuned, command)
        return [path, *report.write(path.parent, path.stem)]

    def _facts(self) -> dict[str, Any]:
        return {"study": self._training.name, "answer": self.answer}

    def _table(self) -> tuple[pd.DataFrame, str]:
        return self.factors, "factors on the variances"


def tune_noise(
    model: Model,
    recordings: Any,
    *,
    by: Literal["state", "unit"] = "state",
    inputs: Literal["joined", "held"] = "joined",
    jobs: int | None = None,
) -> TunedNoise:
    """Tune the noise of a model from recordings, without a truth: that which makes the innovations most likely.

    Args:
        model: What an estimator believes; its variances are where the search begins.
        recordings: Recording or list of them, see ``harness.read_recording``.
        by: Every state its own process noise, or one factor for all states of a unit.
        inputs: How recorded inputs run between samples, see ``harness.Estimator.run``.
        jobs: Threads; all cores by default.

    Returns:
        The variances with their intervals; those that the recordings do not determine stay as stated.

    Raises:
        UserError: If a recording does not fit the model, there is no variance to find, or the filter diverges.

    Example:
        >>> import harness as h
        >>> car = h.model("car", "govindarajan_2018", sensors="car_series")
        >>> run = h.simulate(car, h.drive("sine", duration="10 s", amplitude="20 deg"), seed=1)
        >>> tuned = h.tune_noise(car, run)
        >>> list(tuned.variances.columns)[:4], tuned.model.vehicle
        (['value', 'lower', 'upper', 'stated'], 'car')
    """
    from rich.console import Console

    from harness.api.estimates import named_apart
    from harness.api.estimator import believed_on
    from harness.api.recordings import recordings_of
    from harness.common.stages import showing
    from harness.recorded.tuning import tune_noise as search

    given = named_apart(recordings_of(recordings, "recordings"))
    with showing(Console(stderr=True), "compiling") as show:
        return TunedNoise(search(believed_on(model, given, inputs=inputs, jobs=jobs), given, by, show))


class TunedNoise(Shown):
    """Noise as recordings tell it; made by ``harness.tune_noise``."""

    def __init__(self, tuning: NoiseTuning) -> None:
        self._tuning = tuning

    @property
    def model(self) -> Model:
        """The model with this noise."""
        return model_of(self._tuning.spec)

    @property
    def variances(self) -> pd.DataFrame:
        """Variances by ``(kind, name)``: process noise per step, measurement noise per sample.

        Columns ``value``, ``lower`` and ``upper`` end of the 95 % interval, ``stated``, ``unit`` (SI), ``verdict``.
        """
        import pandas as pd

        rows = {
            (v.kind, name): (v.value[i], v.lower[i], v.upper[i], v.stated[i], v.unit, v.verdict)
            for v in self._tuning.variances
            for i, name in enumerate(v.names)
        }
        index = pd.MultiIndex.from_tuples(list(rows), names=["kind", "name"])
        columns = ["value", "lower", "upper", "stated", "unit", "verdict"]
        return pd.DataFrame(list(rows.values()), index=index, columns=columns)

    @property
    def answer(self) -> str:
        """The result in sentences."""
        return self._tuning.answer

    def write(self, path: str | Path, command: str = IN_PYTHON) -> list[Path]:
        """Write a parameter file with the noise, its numbers as JSON and a report next to it; return the paths.

        Raises:
            UserError: If they cannot be written.
        """
        from harness.recorded.tuning_report import report, write_tuning

        path = toml_file(path)
        return [*write_tuning(path, self._tuning), *report(self._tuning, command).write(path.parent, path.stem)]

    def _facts(self) -> dict[str, Any]:
        return {"model": self._tuning.spec.model().name, "answer": self.answer}

    def _table(self) -> tuple[pd.DataFrame, str]:
        return self.variances, f"{len(self.variances)} variances"


def toml_file(path: str | Path) -> Path:
    """Return a file to write to (internal).

    Raises:
        UserError: If its name is none of a TOML file.
    """
    if Path(path).suffix != ".toml":
        raise UserError(f"{path}: name a TOML file to write, such as tuned.toml")
    return Path(path)
