"""Can a model be driven as the vehicle was? Stable straight ahead at the driven speeds, and within its range.

A fit to innovations never drives the model: the measurements hold it on its path. So a wrong model may follow a drive
best with an axle so soft that the vehicle would spin at the speeds that it was driven at. Such a model is no candidate.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from harness.common.arrays import Floats
from harness.common.last_used import LastUsed
from harness.engine.simd.lanes import LANES
from harness.identification.data import Drive
from harness.identification.filtered_model import FilteredModel

_SPEED = "speed"
"""Input that holds the speed of the vehicle."""

_SPEEDS = 4
_OUTLIERS = 0.01
"""Share of the samples to either side that may be outliers of the recorded speed."""

_REMEMBERED = 64


class Driveable:
    """Whether parameters of a model leave it stable, and its free run within the range of its equations.

    A model without a speed among its inputs counts as stable.

    Args:
        model: The filter with the model.
        fitted: Recordings over which the free run must stay within the range.
        driven: Recordings at whose speeds the model must be stable; those that are fitted by default.
    """

    def __init__(self, model: FilteredModel, fitted: Sequence[Drive], driven: Sequence[Drive] = ()) -> None:
        self.model, self.drives = model, tuple(fitted)
        self.speeds = self._speeds(driven or fitted)
        self._samples = max(len(d.time) for d in driven or fitted)
        self._known = LastUsed[bool](_REMEMBERED)

    def _speeds(self, drives: Sequence[Drive]) -> Floats:
        if _SPEED not in self.model.model.inputs:
            return np.zeros(0)
        column = self.model.model.inputs.index(_SPEED)
        driven = np.concatenate([d.inputs[:, column] for d in drives])
        slowest, fastest = np.quantile(driven, [_OUTLIERS, 1.0 - _OUTLIERS])
        return np.linspace(slowest, fastest, _SPEEDS)

    def unstable_from(self, values: Floats) -> float:
        """Return the lowest of the driven speeds, in m/s, at which a disturbance of straight-ahead driving grows.

        It grows if it would be e times as large at the end of the longest drive; the linearisation is exact.

        Args:
            values: Parameters ``(np,)``.

        Returns:
            The speed; infinite if the model is stable at all of them.
        """
        held = np.zeros((len(values), self.model.duals.lanes))
        held[:, :LANES] = values[:, None]
        constants = self.model.duals.constants(held)
        for speed in self.speeds:
            transition = self._transition(values, constants, float(speed))
            radius = np.abs(np.linalg.eigvals(transition)).max() if np.isfinite(transition).all() else math.inf
            if not radius < math.exp(1.0 / self._samples):
                return float(speed)
        return math.inf

    def _transition(self, values: Floats, constants: Floats, speed: float) -> Floats:
        """Return the derivative of the next state to the state, straight ahead at a speed ``(nx, nx)``."""
        model, compiled = self.model.model, self.model.duals
        u, x = np.zeros((len(model.inputs), compiled.lanes)), np.zeros((compiled.nx, compiled.lanes))
        u[model.inputs.index(_SPEED), :LANES] = speed
        for i, state in enumerate(model.states):
            start = model.start.get(state, 0.0)
            if isinstance(start, str):
                start = (
                    speed if start == _SPEED else values[self.model.row(start)] if start in self.model.names else 0.0
                )
            x[i, :LANES] = start
        found, w = np.empty((compiled.nx, compiled.nx)), np.empty((compiled.nw, compiled.lanes))
        for first in range(0, compiled.nx, LANES):
            columns = range(first, min(first + LANES, compiled.nx))
            moved, ahead = x.copy(), np.empty_like(x)
            moved[list(columns), [LANES + j for j in range(len(columns))]] = 1.0
            compiled.kernels.next_state(moved, u, constants, ahead, w)
            found[:, list(columns)] = ahead[:, LANES : LANES + len(columns)]
        return found

    def stays(self, values: Sequence[Floats]) -> bool:
        """Whether the free run stays within the range on every fitted drive, with parameters ``(np,)`` for each."""
        runs = self.model.share(lambda i: self.model.free_run(self.drives[i], values[i]), range(len(self.drives)))
        return all(len(r.states) == len(d.time) for r, d in zip(runs, self.drives, strict=True))

    def admits(self, values: Sequence[Floats]) -> bool:
        """Whether a model with parameters ``(np,)`` for each fitted drive is a candidate."""
        key = tuple(v.tobytes() for v in values)
        (known,) = self._known.of([key])
        if known is None:
            known = math.isinf(self.unstable_from(values[0])) and self.stays(values)
            self._known.keep([key], [known])
        return known
