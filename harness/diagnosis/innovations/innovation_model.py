"""The response of the innovations of a finished run to an unknown disturbance, and the disturbance given them.

The innovations of a filter hold all that its recording says, so what is missing can be looked for in them without
running the filter again (Friedland 1969 for a constant; ``time_loops`` states the equations). On a linear
model the answers are those of a Kalman filter and smoother whose state holds the disturbance as well.
"""

from __future__ import annotations

import functools
from collections.abc import Sequence
from dataclasses import dataclass, replace
from types import ModuleType

import numpy as np
from numpy.typing import NDArray

from harness.common.arrays import Floats
from harness.diagnosis.innovations import time_loops as kernels
from harness.diagnosis.innovations.disturbance_inputs import DisturbanceInput
from harness.diagnosis.model.augmented_model import AugmentedModel
from harness.engine.compile import load_source, paste
from harness.engine.kernel_source import kernel_source
from harness.engine.simd.lanes import LANES
from harness.identification.data import DriveData
from harness.identification.filtered_model import FilterRun

_PROBED = 200
"""Samples at which the states of effects that matter are determined."""


@dataclass(frozen=True)
class InputDirection:
    """How a disturbance enters the innovations.

    Attributes:
        entry: ``g``, per sample ``(samples, n)``.
        direct: ``c``, whitened ``(samples, ny)``.
        through: Part of the entry that comes through the outputs and the gain, ``-A K D`` ``(samples, n)``.
    """

    entry: Floats
    direct: Floats
    through: Floats | float = 0.0


@dataclass(frozen=True)
class InnovationModel:
    """The whitened innovations of one pass as a linear model.

    Attributes:
        transition: ``F`` ``(samples, n, n)``.
        output: ``C`` ``(samples, ny, n)``.
        residual: ``r``, zero where missing ``(samples, ny)``.
        step: s.
    """

    transition: Floats
    output: Floats
    residual: Floats
    step: float

    def responses(self, input_direction: InputDirection, disturbances: Floats) -> Floats:
        """Return how disturbances ``(samples, n)`` move the whitened innovations ``(samples, ny, n)``."""
        responses = np.empty((*self.residual.shape, disturbances.shape[1]))
        self.write_responses(input_direction, disturbances, responses)
        return responses

    def write_responses(
        self, input_direction: InputDirection, disturbances: Floats, responses: Floats | NDArray[np.float32]
    ) -> None:
        """Write what ``responses`` returns, in the precision of what is written to."""
        samples, n = disturbances.shape
        parts = self.transition, self.output, input_direction.entry, input_direction.direct
        part, moved = np.zeros((samples, LANES)), np.empty((*self.residual.shape, LANES))
        for s in range(0, n, LANES):
            width = min(LANES, n - s)
            part[:, :width] = disturbances[:, s : s + width]
            begin = max(int(part.any(axis=1).argmax()), 1)
            moved[:begin] = 0.0
            _loops().respond(*parts, part, begin, moved)
            responses[:, :, s : s + width] = moved[:, :, :width]

    def adjoint(self, residual: Floats) -> Floats:
        """Return the derivative of the log-likelihood to the state before every sample ``(samples, n)``.

        Args:
            residual: Whitened innovations ``(samples, ny)``.
        """
        adjoint = np.zeros(self.transition.shape[:2])
        _loops().pull_back(self.transition, self.output, residual, adjoint)
        return adjoint

    def gains(self, input_direction: InputDirection, time_constant: float, deviations: Floats) -> Floats:
        """Return what a Gauss-Markov disturbance gains in log-likelihood for standard deviations ``(LANES,)``."""
        ny, n = self.output.shape[1:]
        nothing = _notes(0, ny, n)
        return self._track(input_direction, self._decay(time_constant), deviations**2, nothing)

    def smoothed(
        self, input_direction: InputDirection, time_constant: float, deviation: float
    ) -> tuple[Floats, Floats]:
        """Return such a disturbance given all samples, and its standard error, each ``(samples,)``."""
        samples, ny = self.residual.shape
        notes = _notes(samples, ny, self.output.shape[2])
        decay = self._decay(time_constant)
        self._track(input_direction, decay, np.full(LANES, deviation**2), notes)
        mean, error = np.empty(samples), np.empty(samples)
        parts = (self.transition, self.output, input_direction.entry, input_direction.direct)
        _loops().smooth(*parts, decay, notes, mean, error)
        return mean, error

    def _decay(self, time_constant: float) -> float:
        return float(np.exp(-self.step / time_constant))

    def _track(
        self, input_direction: InputDirection, decay: float, variances: Floats, notes: tuple[Floats, ...]
    ) -> Floats:
        gain = np.empty((1, LANES))
        parts = (self.transition, self.output, input_direction.entry, input_direction.direct, self.residual)
        _loops().track(*parts, decay, variances.reshape(1, LANES), gain, notes)
        return gain[0]


def _notes(samples: int, ny: int, n: int) -> tuple[Floats, ...]:
    return (
        np.zeros(samples),
        np.zeros((samples, n + 1)),
        np.zeros((samples, ny, n + 1)),
        np.ones((samples, ny)),
        np.zeros((samples, ny)),
    )


@functools.cache
def _loops() -> ModuleType:
    return load_source("disturbance", kernel_source("disturbance", kernels.PLAIN))


def lasso(gram: Floats, pull: Floats, floor: float, wanted: int) -> Floats:
    """Return the weights of the first ``wanted`` terms that the lasso selects (``time_loops.lasso``)."""
    weights = np.zeros(len(pull))
    _loops().lasso(np.ascontiguousarray(gram), pull, floor, wanted, 50, weights)
    return weights


class ModelTangents:
    """The compiled derivatives of an augmented model, loaded before threads share it."""

    def __init__(self, augmented: AugmentedModel) -> None:
        self.augmented, self._compiled = augmented, augmented.duals
        source = paste(self._compiled, "tangents", [kernels.tangents])
        self._tangents = load_source("tangents", source).tangents
        _loops()

    def along(
        self,
        drive: DriveData,
        states: Floats,
        values: Sequence[Floats],
        parameters: Sequence[Floats],
        moved: Floats,
        rows: NDArray[np.intp],
    ) -> tuple[Floats, Floats]:
        """Return derivatives of the next state ``(samples, rows, n)`` and of the outputs ``(samples, ny, n)``.

        Args:
            drive: With the inputs at the samples.
            states: Where it is linearised ``(samples, nx)``.
            values: Parameters there, for each direction ``(np,)``.
            parameters: Directions in the space of parameters, ``(np,)`` each.
            moved: Directions of the state ``(nx, n)``.
            rows: States whose derivatives are wanted.
        """
        n, shape = len(values), (len(rows), len(self.augmented.model.outputs))
        ahead, outputs = (np.empty((len(states), size, n)) for size in shape)
        for s in range(0, n, LANES):
            columns = [min(j, n - 1) for j in range(s, s + LANES)]
            both = np.column_stack([*(values[j] for j in columns), *(parameters[j] for j in columns)])
            parts = [np.empty((len(states), size, LANES)) for size in shape]
            directions = np.ascontiguousarray(moved[:, columns])
            constants = self._compiled.constants(both)
            self._tangents(drive.inputs, drive.between, constants, states, directions, rows, *parts)
            for whole, part in zip((ahead, outputs), parts, strict=True):
                whole[:, :, s : s + LANES] = part[:, :, : n - s]
        return ahead, outputs


class Linearised:
    """The augmented model linearised along a pass of its filter over one recording.

    Args:
        linearisation: Of the model.
        drive: The recording.
        values: Parameters of the pass ``(np,)``.
        kept: The pass.

    Attributes:
        whitened: Innovations of the pass ``(samples, ny)``, NaN where missing.
        states: Where it is linearised: the corrected mean ``(samples, nx)``.
        active: Rows of the states that count.
        transition: Jacobian of the next state in them ``(samples, n, n)``.
        output: Jacobian of the outputs ``(samples, ny, n)``.
        gain: Of the pass ``(samples, n, ny)``.
    """

    def __init__(self, linearisation: ModelTangents, drive: DriveData, values: Floats, kept: FilterRun) -> None:
        self._linearisation, self.augmented = linearisation, linearisation.augmented
        self.drive, held = self.augmented.read_ahead(drive, values[:, None])
        self.values = held[:, 0]
        self.whitened, self.states = kept.whitened, kept.state.copy()
        self.states[0] = drive.first_mean
        self.active = self._active()
        self.transition, self.output = self._along_states(slice(None), self.active)
        self.gain = np.zeros((len(self.states), len(self.active), kept.gain.shape[2]))
        corrected = self.augmented.corrected(values)  # what the filter corrects is active, and comes first
        self.gain[:, :corrected] = kept.gain[:, :corrected]
        # A missing measurement neither corrects nor counts.
        self._whitening = kept.whitening * np.isfinite(kept.whitened)[:, :, None]

    @functools.cached_property
    def innovations(self) -> InnovationModel:
        """What it makes of the innovations."""
        return InnovationModel(
            np.ascontiguousarray(self.transition - self._correction @ self.output),
            np.ascontiguousarray(self._whitening @ self.output),
            np.nan_to_num(self.whitened),
            self.augmented.spec.step,
        )

    @functools.cached_property
    def _correction(self) -> Floats:
        """What an innovation changes of the next state ``(samples, n, ny)``."""
        correction: Floats = self.transition @ self.gain
        return correction

    def raw(self, disturbance_inputs: Sequence[DisturbanceInput]) -> tuple[Floats, Floats]:
        """Return how channels move the next state ``(samples, nx, n)`` and the outputs ``(samples, ny, n)``."""
        return self._moved(disturbance_inputs, np.arange(len(self.augmented.model.states)))

    def _moved(self, disturbance_inputs: Sequence[DisturbanceInput], rows: NDArray[np.intp]) -> tuple[Floats, Floats]:
        samples, ny = len(self.states), len(self.augmented.model.outputs)
        ahead, outputs = (
            np.zeros((samples, len(rows), len(disturbance_inputs))),
            np.zeros((samples, ny, len(disturbance_inputs))),
        )
        step = 1.0 if self.augmented.model.discrete else self.augmented.spec.step
        for j, c in enumerate(disturbance_inputs):
            if c.kind == "equation":
                ahead[:, rows == self.augmented.model.states.index(c.ports[0]), j] = step
        open_ = [j for j, c in enumerate(disturbance_inputs) if c.kind != "equation"]
        ahead[:, :, open_], outputs[:, :, open_] = self._along_parameters(
            [disturbance_inputs[j].values(self.augmented, self.values) for j in open_],
            [disturbance_inputs[j].direction(self.augmented) for j in open_],
            rows,
        )
        return ahead, outputs

    def along(self, values: Sequence[Floats], parameters: Sequence[Floats]) -> tuple[Floats, Floats]:
        """Return derivatives of the active states and of the outputs to directions of the parameters, along the pass.

        Args:
            values: Parameters, for each direction ``(np,)``.
            parameters: Directions, ``(np,)`` each.
        """
        shifted = [self.augmented.without_delays(v[:, None])[:, 0] for v in values]
        return self._along_parameters(shifted, parameters, self.active)

    def _along_parameters(
        self, values: Sequence[Floats], parameters: Sequence[Floats], rows: NDArray[np.intp]
    ) -> tuple[Floats, Floats]:
        held = np.zeros((len(self.augmented.model.states), len(values)))
        return self._linearisation.along(self.drive, self.states, values, parameters, held, rows)

    def input_directions(self, disturbance_inputs: Sequence[DisturbanceInput]) -> list[InputDirection]:
        """Return how channels enter the innovations."""
        return self.entering(*self._moved(disturbance_inputs, self.active))

    def entering(self, ahead: Floats, outputs: Floats) -> list[InputDirection]:
        """Return how what moves active states ``(samples, rows, n)`` and outputs ``(samples, ny, n)`` enters them."""
        through = -(self._correction @ outputs)
        entry = ahead + through
        direct = self._whitening @ outputs
        return [
            InputDirection(*(np.ascontiguousarray(part[:, :, j]) for part in (entry, direct, through)))
            for j in range(entry.shape[2])
        ]

    def _active(self) -> NDArray[np.intp]:
        """Return the states of the nominal model and those of effects that act on it, from some of the samples."""
        nx, count = self.augmented.corrected(self.values), len(self.augmented.model.states)
        every = slice(1, None, max(1, len(self.states) // _PROBED))
        A, H = (np.abs(m).max(axis=0) for m in self._along_states(every, np.arange(count)))
        chosen = set(range(nx)) | {j for j in range(nx, count) if H[:, j].any()}
        while more := {j for j in range(count) if j not in chosen and A[sorted(chosen), j].any()}:
            chosen |= more
        return np.array(sorted(chosen))

    def _along_states(self, samples: slice, rows: NDArray[np.intp]) -> tuple[Floats, Floats]:
        """Return the Jacobians of the next state and of the outputs in some states."""
        n, nothing = len(rows), np.zeros(len(self.augmented.names))
        drive = replace(self.drive, inputs=self.drive.inputs[samples], between=self.drive.between[samples])
        states = np.ascontiguousarray(self.states[samples])
        unit = np.eye(len(self.augmented.model.states))[:, rows]
        return self._linearisation.along(drive, states, [self.values] * n, [nothing] * n, unit, rows)
