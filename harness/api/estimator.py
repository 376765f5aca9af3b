"""``harness.Estimator``: an estimator with its settings, run over recordings or compared in studies."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any, Literal

from harness.api._show import Shown
from harness.config import single_estimator

if TYPE_CHECKING:
    import os

    import pandas as pd
    import xarray as xr

    from harness.api.model import Model
    from harness.recorded.run import RecordedEstimator, RecordedModel


class Estimator(Shown):
    """An estimator.

    Args:
        kind: Kind of estimator (``harness list estimators``).
        settings: Settings of the kind (``harness list estimators <kind>``), as in ``[[estimator]]`` of a study file.
            ``input_signal`` is one of every kind: what it takes for inputs with noise, ``"filtered"`` over their past
            or as ``"measured"``. By default they are filtered in a study, and smoothed on a recording.

    Attributes:
        kind: Kind of estimator.
        settings: What was stated.
        spec: The record that all packages below take, its settings completed (internal).

    Raises:
        UserError: If there is no such estimator, it has no such setting, or a setting does not fit.

    Example:
        >>> import harness as h
        >>> h.Estimator("ukf", alpha=0.5)
        Estimator 'ukf'
          alpha: 0.5
    """

    def __init__(self, kind: str, **settings: Any) -> None:
        self.spec = single_estimator({**settings, "kind": kind}, f"estimator '{kind}'")
        self.kind, self.settings = kind, dict(settings)

    def table(self) -> dict[str, Any]:
        """Return the estimator by the keys of ``[[estimator]]`` in a study file."""
        return {"kind": self.kind, **self.settings}

    def run(
        self,
        model: Model,
        recording: str | os.PathLike[str] | pd.DataFrame | xr.Dataset,
        *,
        signals: Sequence[str] = (),
        references: Mapping[str, str] | None = None,
        inputs: Literal["joined", "held"] = "joined",
        seed: int = 0,
    ) -> xr.Dataset:
        """Run it over a recording.

        Measured inputs are smoothed, with all samples of the recording, later ones as well, unless ``input_signal``
        says otherwise; what is not known of them is in the standard deviations. Those of a simulation are exact.

        Args:
            model: What it believes, with unknown inputs if there are any. Sensors and step are those of the recording
                where they are not stated.
            recording: Measured or simulated: a path, a DataFrame or a Dataset, see ``harness.read_recording``. A
                missing measurement (NaN) is skipped; inputs may have no gaps.
            signals: Ports and inputs to estimate in addition to every state and every measured quantity.
            references: Signal of the recording by the state or port that it is the reference of; by default a signal of
                the same name that is not measured, of a simulated recording the exact one.
            inputs: ``joined`` where inputs run straight from sample to sample, as measured ones do, ``held`` where they
                stay constant behind each, as those of a study do.
            seed: Of estimators that draw random numbers.

        Returns:
            Dataset over ``time`` (s), CF attributes, SI units: ``<state>`` and ``<state>_std`` of every state and
            signal ``(time,)``, ``innovation_<output>``, ``innovation_std_<output>``,
            ``innovation_covariance (time, output, other_output)``, ``nis``, ``nis_degrees``, ``log_likelihood``; where
            the recording holds a reference ``reference_<signal>``, ``error_<signal>``, ``nees_<signal>``, ``nees``,
            ``nees_degrees``. Attributes tell ``diverged_at`` (s, NaN if it did not), ``log_likelihood`` (sum),
            ``updates``, ``repairs``.

        Raises:
            UserError: If recording and model do not fit each other.
            ModelError: If the estimator does not fit the model.

        Example:
            >>> import harness as h
            >>> car = h.model("car", "govindarajan_2018", sensors="car_series")
            >>> run = h.simulate(car, h.drive("sine", duration="10 s", amplitude="20 deg"), seed=1)
            >>> found = h.Estimator("ekf").run(car, run)
            >>> found.lateral_velocity.attrs["units"], bool(abs(found.error_lateral_velocity).max() < 0.5)
            ('m/s', True)
        """
        from harness.api.recordings import recordings_of

        given = recordings_of(recording, "recording")
        believed = believed_on(model, given, signals, references, inputs)
        return self.on(believed).run(given[0], seed)

    def on(self, model: RecordedModel, name: str = "") -> RecordedEstimator:
        """Return what runs it over recordings, under a name of its own perhaps (internal)."""
        from harness.recorded.run import RecordedEstimator

        spec = self.spec
        return RecordedEstimator(model, spec.kind, spec.settings, spec.base, name, spec.input_signal)

    def _title(self) -> str:
        return f"Estimator '{self.kind}'"

    def _facts(self) -> Mapping[str, Any]:
        return self.settings


def believed_on(
    model: Model,
    recordings: Sequence[xr.Dataset],
    signals: Sequence[str] = (),
    references: Mapping[str, str] | None = None,
    inputs: Literal["joined", "held"] = "joined",
    jobs: int | None = None,
) -> RecordedModel:
    """Return what estimators on recordings believe; measured quantities are estimated as well (internal)."""
    from harness.identification.data import step_of
    from harness.models.roles import SENSORS
    from harness.recorded.run import RecordedModel

    spec = model.resolved_for(recordings, believed=True, step=step_of(recordings[0]))
    ports = SENSORS.load(spec.sensors).OUTPUTS.values()
    return RecordedModel(spec, [*ports, *signals], inputs, references, jobs)
