"""Estimators that are Python classes.

A class is made with the table ``settings`` as keywords and has ``step(inputs, measurements, dt)``, which gets rows of
arrays in the order that the study states and returns estimates in theirs: numbers, or a tuple of them with the
variances and, where it gives one, the NIS. ``reset(values, step)`` begins a run; a class without it is made anew.
"""

from __future__ import annotations

import math
import time
from collections.abc import Mapping
from typing import Any

import numpy as np

from harness.common.arrays import Floats
from harness.common.errors import UserError
from harness.external.bodies import RunEstimates, Timed
from harness.external.in_words import in_words
from harness.external.references import imported

DECLARED = ("inputs", "measurements", "estimates", "variances", "nis")


class PythonEstimator:
    """A class of somebody else as an estimator.

    Args:
        made: The class, or a function that returns an estimator.
        loader: See ``harness.external.estimators``.
    """

    def __init__(self, made: Any, loader: Mapping[str, Any]) -> None:
        self._made, self._settings, self._names = made, loader.get("settings", {}), loader.get("values", [])
        self._estimator = made(**self._settings)
        if not callable(getattr(self._estimator, "step", None)):
            raise UserError(f"'{loader['module']}:{loader['name']}' has no step(inputs, measurements, dt)")
        variances, nis = (
            bool(getattr(self._estimator, name, False) if loader.get(name) is None else loader[name])
            for name in ("variances", "nis")
        )
        self._parts = 1 + (variances or nis) + nis

    def declared(self) -> dict[str, Any]:
        """Return what the class says of itself, in plain values."""
        there = {n: getattr(self._estimator, n) for n in DECLARED if hasattr(self._estimator, n)}
        return {
            n: v if isinstance(v, bool) else dict(v) if isinstance(v, Mapping) else list(v) for n, v in there.items()
        }

    def estimate(self, step: float, inputs: Floats, measurements: Floats, values: Floats, seed: int) -> RunEstimates:
        """Run over what was measured, see ``harness.external.bodies.EstimatorBody``."""
        self._begin(step, values)
        samples, k = len(inputs), 0
        try:
            first = self._estimator.step(inputs[0], measurements[0], 0.0)
            rows = [np.full((samples, *np.shape(part)), math.nan) for part in self._split(first)]
            self._fill(rows, 0, first)
            advance, (estimates, *further) = self._estimator.step, rows
            k = 1
            if further:
                for k in range(1, samples):
                    self._fill(rows, k, advance(inputs[k], measurements[k], step))
            else:
                for u, y in zip(inputs[1:], measurements[1:], strict=True):
                    estimates[k] = advance(u, y, step)
                    k += 1
        except BaseException as error:
            if k == 0:
                raise
            return self._of(rows, k, in_words(error))
        return self._of(rows, samples, "")

    def timed(self, step: float, inputs: Floats, measurements: Floats, values: Floats, begins: bool) -> Timed:
        """Take samples, of a new run if it begins; return how long each took and an empty one does, in ns."""
        if begins:
            self._begin(step, values)
        clock, ticks, answer, empty = time.perf_counter_ns, [], None, []
        for k, (u, y) in enumerate(zip(inputs, measurements, strict=True)):
            begin = clock()
            answer = self._estimator.step(u, y, 0.0 if begins and k == 0 else step)
            end = clock()
            ticks.append(end - begin)
            empty.append(clock() - end)
        return np.array(ticks, dtype=float), float(np.median(empty)), np.ravel(self._split(answer)[0]).astype(float)

    def _begin(self, step: float, values: Floats) -> None:
        if hasattr(self._estimator, "reset"):
            self._estimator.reset(dict(zip(self._names, values.tolist(), strict=True)), step)
        else:
            self._estimator = self._made(**self._settings)

    def _split(self, answer: Any) -> tuple[Any, ...]:
        """Return estimates and what is with them."""
        if answer is None:
            raise UserError("step returned nothing; return the estimates")
        if self._parts == 1:
            return (answer,)
        if not isinstance(answer, tuple) or len(answer) != self._parts:
            wanted = "(estimates, variances)" if self._parts == 2 else "(estimates, variances, nis)"
            returned = f"one of {len(answer)}" if isinstance(answer, tuple) else f"{type(answer).__name__}"
            raise UserError(f"step must return the tuple {wanted}, it returned {returned}")
        return answer

    def _fill(self, rows: list[Floats], k: int, answer: Any) -> None:
        for row, part in zip(rows, self._split(answer), strict=True):
            row[k] = part

    def _of(self, rows: list[Floats], reached: int, reason: str) -> RunEstimates:
        samples = len(rows[0])
        estimates, variances, nis = (*(row.reshape(samples, -1) for row in rows), None, None)[:3]
        assert estimates is not None
        return RunEstimates(estimates, variances, None if nis is None else nis[:, 0], reached, reason)


def load(loader: Mapping[str, Any]) -> PythonEstimator:
    """Return the estimator that a loader makes, see ``harness.external.bodies.load``.

    Args:
        loader: ``module`` and ``name`` of the class.

    Raises:
        UserError: If it cannot be imported or is no estimator.
    """
    return PythonEstimator(imported(loader), loader)
