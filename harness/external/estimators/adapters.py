"""Filters of filterpy, Stone Soup and CasADi in a study: ``python = "harness.external.estimators.adapters:FilterPy"``.

``settings`` names in ``make`` a function ``module:function`` of yours, which gets what the belief holds by name and the
sample time in s, and further settings as keywords. It is called before every run. ``states`` are the places of the
estimates in the state, by default all. Variances and NIS come with them.
"""

from __future__ import annotations

import inspect
from abc import ABC, abstractmethod
from collections.abc import Sequence
from datetime import datetime, timedelta
from typing import Any

import numpy as np

from harness.common.arrays import Floats
from harness.common.errors import UserError
from harness.external.references import imported


class _Adapter(ABC):
    """What adapters have in common.

    Args:
        make: ``module:function``.
        states: Places of the estimates in the state.
        settings: For the function.
    """

    variances = nis = True

    def __init__(self, make: str, states: Sequence[int] | None = None, **settings: Any) -> None:
        module, _, name = make.partition(":")
        self._make, self._settings = imported({"module": module, "name": name}), settings
        self._states = slice(None) if states is None else list(states)

    def reset(self, values: dict[str, float], step: float) -> None:
        """Begin a run."""
        self._before: Floats | None = None
        self._begin(self._make(values, step, **self._settings))

    def step(self, inputs: Floats, measurements: Floats, dt: float) -> tuple[Floats, Floats, float]:
        """Predict from the sample before with its inputs, and correct with what was measured."""
        if self._before is not None:
            self._predict(self._before, dt)
        seen, nis = ~np.isnan(measurements), np.nan
        if seen.any():
            innovation, spread = self._update(measurements, inputs, seen)
            nis = float(innovation @ np.linalg.solve(spread, innovation))
        self._before = inputs
        mean, covariance = self._state()
        return np.ravel(mean)[self._states], np.diagonal(covariance)[self._states], nis

    @abstractmethod
    def _begin(self, made: Any) -> None:
        """Begin a run with what the function returned."""

    @abstractmethod
    def _predict(self, inputs: Floats, dt: float) -> None:
        """Predict over the time since the sample before, with its inputs."""

    @abstractmethod
    def _update(self, measurements: Floats, inputs: Floats, seen: Any) -> tuple[Floats, Floats]:
        """Correct with the measurements that are ``seen``; return innovation and its covariance."""

    @abstractmethod
    def _state(self) -> tuple[Floats, Floats]:
        """Return mean and covariance of the state."""


class FilterPy(_Adapter):
    """A filter of filterpy, which the function returns with its first ``x`` and ``P``.

    ``predict(u=...)`` gets the inputs of the sample before and ``update(z)`` the measurements. One that hands further
    arguments to ``hx``, such as ``UnscentedKalmanFilter``, calls ``fx(x, dt, u)`` and ``hx(x, u)``. Of single missing
    measurements only such a one can take the others.
    """

    def _begin(self, made: Any) -> None:
        self._filter = made
        kinds = [p.kind for p in inspect.signature(made.update).parameters.values()]
        self._unscented = inspect.Parameter.VAR_KEYWORD in kinds

    def _predict(self, inputs: Floats, dt: float) -> None:
        self._filter.predict(u=inputs)

    def _update(self, measurements: Floats, inputs: Floats, seen: Any) -> tuple[Floats, Floats]:
        made = self._filter
        if self._unscented:
            further = {} if seen.all() else {"R": made.R[np.ix_(seen, seen)], "hx": lambda x, u: made.hx(x, u)[seen]}
            made.update(measurements[seen], u=inputs, **further)
        elif seen.all():
            made.update(measurements)
        else:
            raise UserError("this filter of filterpy cannot take single measurements; give it sensors of one rate")
        return np.ravel(made.y), np.atleast_2d(made.S)

    def _state(self) -> tuple[Floats, Floats]:
        return self._filter.x, self._filter.P


class StoneSoup(_Adapter):
    """A predictor and an updater of Stone Soup, which the function returns with the first state: three values.

    Transition and measurement model find the inputs in their attribute ``inputs``, if they have one.
    """

    def _begin(self, made: Any) -> None:
        self._predictor, self._updater, self._held = made
        self._models = self._predictor.transition_model, self._updater.measurement_model
        self._time = self._held.timestamp or datetime(2000, 1, 1)
        self._held.timestamp = self._time

    def _predict(self, inputs: Floats, dt: float) -> None:
        self._time += timedelta(seconds=dt)
        self._models[0].inputs = inputs
        self._held = self._predictor.predict(self._held, timestamp=self._time)

    def _update(self, measurements: Floats, inputs: Floats, seen: Any) -> tuple[Floats, Floats]:
        from stonesoup.types.detection import Detection
        from stonesoup.types.hypothesis import SingleHypothesis

        if not seen.all():
            raise UserError("this measurement model cannot take single measurements; give it sensors of one rate")
        self._models[1].inputs = inputs
        detection = Detection(measurements[:, None], timestamp=self._time, measurement_model=self._models[1])
        expected = self._updater.predict_measurement(self._held, measurement_model=self._models[1])
        hypothesis = SingleHypothesis(self._held, detection, expected)
        self._held = self._updater.update(hypothesis)
        innovation = np.asarray(detection.state_vector - expected.state_vector, dtype=float)
        return np.ravel(innovation), np.asarray(expected.covar, dtype=float)

    def _state(self) -> tuple[Floats, Floats]:
        return np.asarray(self._held.state_vector, dtype=float), np.asarray(self._held.covar, dtype=float)


class CasADi:
    """A function of CasADi, which the function of ``make`` returns with its first state: two values.

    It takes state, inputs, measurements (NaN where missing) and the time since the last sample, and gives the next
    state and the estimates, then variances and NIS as far as the study states them (``gives = 1`` or ``2`` of them).

    Args:
        make: ``module:function``.
        gives: How many of variances and NIS it gives.
        settings: For the function.
    """

    def __init__(self, make: str, gives: int = 0, **settings: Any) -> None:
        module, _, name = make.partition(":")
        self._make, self._settings = imported({"module": module, "name": name}), settings
        self.variances, self.nis, self._gives = gives > 0, gives > 1, gives

    def reset(self, values: dict[str, float], step: float) -> None:
        """Begin a run."""
        function, first = self._make(values, step, **self._settings)
        self._buffer, self._call = function.buffer()
        self._state: Any = np.array(first, dtype=float)
        self._arguments: list[Any] = [self._state, *(np.zeros(function.numel_in(i)) for i in (1, 2, 3))]
        self._results: list[Any] = [np.zeros(function.numel_out(i)) for i in range(2 + self._gives)]
        for i, argument in enumerate(self._arguments):
            if function.numel_in(i) != argument.size:
                raise UserError(
                    f"argument {i} of '{function.name()}' takes {function.numel_in(i)} numbers, not {argument.size}"
                )
            self._buffer.set_arg(i, memoryview(argument))
        for i, result in enumerate(self._results):
            self._buffer.set_res(i, memoryview(result))

    def step(self, inputs: Floats, measurements: Floats, dt: float) -> Any:
        """Call the function."""
        _, u, y, time = self._arguments
        u[:], y[:], time[0] = inputs, measurements, dt
        self._call()
        self._state[:] = self._results[0]
        return tuple(self._results[1:]) if self._gives else self._results[1]
