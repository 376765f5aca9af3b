"""``harness.identify``: parameters from recordings, with their uncertainty."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from harness.api._show import IN_PYTHON, Shown
from harness.api.model import Model, model_of
from harness.api.recordings import recordings_of
from harness.common.errors import UserError

if TYPE_CHECKING:
    import pandas as pd
    import xarray as xr

    from harness.identification.earlier_result import EarlierResult
    from harness.identification.fit_recordings import Fitted
    from harness.identification.measured_file import MeasuredStudy
    from harness.identification.plant_fit import FittedPlant


def identify(
    model: Model | None,
    train: Any,
    free: Sequence[str] = (),
    *,
    test: Any = (),
    method: str | None = None,
    settings: Mapping[str, Any] | None = None,
    seed: int | None = None,
    jobs: int | None = None,
    after: str | Path | None = None,
) -> Identification:
    """Fit parameters of a model to recordings.

    The search begins at the values of the model. All measured outputs of its sensors are fitted.

    Args:
        model: The model. Sensors and step are those of the recordings where they are not stated. ``None`` is that of
            the identification ``after``.
        train: Recording or list of recordings to fit: paths, DataFrames or Datasets, see ``harness.read_recording``.
        free: Names of the parameters to find.
        test: Held-out recordings, on which the fit is judged.
        method: ``likelihood`` (default), ``swarm`` or ``em`` (docs/identification).
        settings: Of the method.
        seed: Of the method's random numbers; 0 by default.
        jobs: Threads; all cores by default.
        after: Folder of an earlier identification behind which drives were planned (``harness.next_drive``), or of a
            study of its posterior. Its recordings are added to those that are stated, what else is not stated is its
            own, and the answer says whether the errors are as expected.

    Returns:
        What was found.

    Raises:
        UserError: If a parameter, setting or signal is unknown or missing, or a held-out recording is fitted as well.
        ModelError: If there is no such method.

    Example:
        >>> import harness as h
        >>> car = h.model("car", "govindarajan_2018", sensors="car_series")
        >>> run = h.simulate(car, h.drive("sine", duration="20 s", amplitude="20 deg"), seed=1)
        >>> fit = h.identify(car.replace(values={"yaw_inertia": "3000 kg*m^2"}), run, free=["yaw_inertia"])
        >>> list(fit.estimates.columns)[:4], fit.estimates.index.tolist()[0]
        (['value', 'standard_error', 'lower', 'upper'], 'yaw_inertia')
    """
    from rich.console import Console

    from harness.common.stages import showing
    from harness.identification.data import step_of
    from harness.identification.earlier_result import EarlierResult, with_absolute_paths
    from harness.identification.fit_recordings import FitTask, fit_recordings

    before = None if after is None else EarlierResult.read(Path(after))
    fitted, held_out = _recordings(train, test, before)
    names = (free,) if isinstance(free, str) else tuple(free)
    if before is not None:
        asked = before.content["asked"]
        model, names = Model(before.model) if model is None else model, names or before.free
        seed = asked["seed"] if seed is None else seed
        settings = {**(asked["settings"] if method in (None, asked["method"]) else {}), **(settings or {})}
        method = method or asked["method"]
    if model is None:
        raise UserError("model: give the model; only with after it is that of the earlier identification")
    spec = model.resolved_for([*fitted, *held_out], step=step_of(fitted[0]))
    task = FitTask(spec, fitted, names, held_out, method or "likelihood", dict(settings or {}), seed or 0, jobs)
    table, _ = model.completed([*fitted, *held_out])
    task = replace(task, stated=with_absolute_paths(table), after=before)
    with showing(Console(stderr=True), "compiling") as show:
        return Identification(fit_recordings(task, show))


def identified_file(study: MeasuredStudy, jobs: int | None = None) -> Identification:
    """Return a fit to the drives of a file of measured drives, as that states it (internal).

    Raises:
        UserError, ModelError: As ``identify``.
    """
    from rich.console import Console

    from harness.common.stages import showing
    from harness.identification.earlier_result import with_absolute_paths
    from harness.identification.fit_recordings import FitTask, fit_recordings

    with showing(Console(stderr=True), "reading the recordings") as show:
        drives, raw = study.drives(), study.raw
        free = study.fitted_parameters()
        task = FitTask(study.nominal(), drives["train"], free, drives["test"], raw.method, raw.settings, jobs=jobs)
        task = replace(task, stated=with_absolute_paths(study.stated))
        show("compiling")
        return Identification(fit_recordings(task, show))


def identified_plant(
    plant: Mapping[str, Any],
    train: Any,
    free: Sequence[str],
    *,
    test: Any = (),
    method: str = "least-squares",
    settings: Mapping[str, Any] | None = None,
    seed: int = 0,
    jobs: int | None = None,
) -> Identification:
    """Return parameters of a plant of somebody else, fitted to recordings by its simulation error (internal).

    Args:
        plant: Keys of ``[plant]``: ``fmu`` with its ``map``, or ``python``, ``values`` and so on.
        train: Recordings to fit, as of ``identify``.
        free: Parameters to find: names, or ``NAME=LOWER:UPPER``, the range of the search.
        test: Held-out recordings.
        method: ``least-squares`` or ``swarm``.
        settings: Of the swarm.
        seed: Of the swarm.
        jobs: Processes; all cores by default.

    Raises:
        UserError: As ``identify``, or if the plant publishes nothing that is recorded.
    """
    from rich.console import Console

    from harness.common.stages import showing
    from harness.config.external import plant_alone
    from harness.identification.data import step_of
    from harness.identification.plant_fit import PlantTask, fit_plant

    fitted, held_out = _recordings(train, test)
    recorded = set.intersection(*({str(n) for n in r.data_vars} for r in [*fitted, *held_out]))
    spec = plant_alone(plant, recorded, step_of(fitted[0]))
    names: list[str] = []
    bounds: dict[str, tuple[Any, Any]] = {}
    for name, equals, ends in ((text.partition("=")) for text in ([free] if isinstance(free, str) else free)):
        names.append(name.strip())
        if equals:
            lower, colon, upper = ends.partition(":")
            if not colon:
                raise UserError(f"free '{name}={ends}': write NAME=LOWER:UPPER, such as 'mass=1 t:2 t'")
            bounds[name.strip()] = _number(lower), _number(upper)
    task = PlantTask(spec, fitted, tuple(names), bounds, held_out, method, dict(settings or {}), seed, jobs)
    with showing(Console(stderr=True), "starting the plant") as show:
        return Identification(fit_plant(task, show))


def _number(text: str) -> float | str:
    """Return the end of a range: a number in SI, or text with its unit."""
    from harness.common.units import plain_number

    number = plain_number(text)
    return text.strip() if number is None else number


def _recordings(
    train: Any, test: Any, before: EarlierResult | None = None
) -> tuple[list[xr.Dataset], list[xr.Dataset]]:
    """Return the recordings to fit and those held out, if any, behind those of an earlier result, at one step."""
    from harness.identification.common_step import at_common_step

    fitted, none = recordings_of(train, "train"), test is None or (isinstance(test, list | tuple) and not test)
    held_out = [] if none else recordings_of(test, "test")
    if before is not None:
        fitted, held_out = before.joined(fitted, held_out)
    together = at_common_step([*fitted, *held_out])
    return together[: len(fitted)], together[len(fitted) :]


class Identification(Shown):
    """Parameters as found; made by ``harness.identify``."""

    def __init__(self, fitted: Fitted | FittedPlant) -> None:
        self._fitted = fitted

    @property
    def model(self) -> Model:
        """The model with what was found."""
        return model_of(self._fitted.fit.spec)

    @property
    def answer(self) -> str:
        """The result in sentences; the first says so if the fit failed (``failed``)."""
        return self._fitted.answer

    @property
    def free(self) -> tuple[str, ...]:
        """Names of the parameters that were to be found."""
        return self._fitted.free

    @property
    def failed(self) -> bool:
        """Whether the simulation error of the held-out recordings, or of the fitted ones without any, grew."""
        from harness.identification.result import failure

        return bool(failure(self._fitted.judged))

    @property
    def notes(self) -> tuple[str, ...]:
        """Irregularities of the recordings, as ``harness check`` finds them."""
        return self._fitted.notes

    @property
    def converged(self) -> bool:
        """Whether the method's convergence criterion was met."""
        return self._fitted.fit.converged

    @property
    def estimates(self) -> pd.DataFrame:
        """What was found by name, parameters first, then variances.

        Columns ``value``, ``standard_error`` (infinite if the recordings say nothing), ``lower`` and ``upper`` end of
        the 95 % interval, ``start``, all in SI units, ``unit``, ``verdict`` (``determined``, ``weakly determined``,
        ``confounded``, ``not determined``, ``at its bound``) and ``reason``.
        """
        import pandas as pd

        rows = {
            e.name: (e.value, e.error, e.lower, e.upper, e.start, e.unit, e.verdict, e.reason)
            for e in self._fitted.fit.estimates
        }
        columns = ["value", "standard_error", "lower", "upper", "start", "unit", "verdict", "reason"]
        return pd.DataFrame.from_dict(rows, orient="index", columns=columns).rename_axis("name")

    @property
    def correlation(self) -> pd.DataFrame:
        """Correlation of the estimates ``(n, n)``; empty if the method states none."""
        import pandas as pd

        names = [e.name for e in self._fitted.fit.estimates] if self._fitted.fit.correlation.size else []
        return pd.DataFrame(self._fitted.fit.correlation, index=names, columns=names)

    @property
    def errors(self) -> pd.DataFrame:
        """Root mean square errors by ``(drive, output)`` before and after the fit, SI units.

        Columns ``held_out``, ``simulation_before``, ``simulation_after`` (model driven by the inputs only),
        ``one_step_before``, ``one_step_after`` (innovations), ``unit``.
        """
        import pandas as pd

        from harness.models.signals import SIGNALS

        outputs = list(self._fitted.fit.spec.model().outputs)
        rows = {
            (j.drive.name, name): (
                j.held_out,
                *j.free_error[:, a].tolist(),
                *j.one_step_error[:, a].tolist(),
                SIGNALS[name].unit if name in SIGNALS else "",
            )
            for j in self._fitted.judged
            for a, name in enumerate(outputs)
        }
        columns = ["held_out", "simulation_before", "simulation_after", "one_step_before", "one_step_after", "unit"]
        index = pd.MultiIndex.from_tuples(list(rows), names=["drive", "output"])
        return pd.DataFrame(list(rows.values()), index=index, columns=columns)

    def report(self, folder: str | Path, command: str = IN_PYTHON) -> list[Path]:
        """Write ``parameters.toml``, ``identify.json``, ``report.html`` and ``report.pdf`` and return their paths.

        Args:
            folder: Where to.
            command: How it was made, as the report says.

        Raises:
            UserError: If the folder cannot be written to.
        """
        return self._fitted.write(Path(folder), command)

    def _facts(self) -> dict[str, Any]:
        fit = self._fitted.fit
        return {
            "answer": self.answer,
            "model": fit.spec.model().name,
            "method": fit.method,
            "fitted": ", ".join(d.name for d in self._fitted.drives),
            "held out": ", ".join(d.name for d in self._fitted.tests),
            "converged": "yes" if fit.converged else "no",
            **{e.name: f"{e.value:.6g} ± {e.error:.2g} {e.unit}" for e in fit.estimates},
        }

    def _table(self) -> tuple[pd.DataFrame, str]:
        return self.estimates.drop(columns="reason"), f"{len(self.estimates)} estimates"
