"""Derivatives of a filter's log-likelihood to the variances of its noise, along a pass that is finished.

Along the pass the model that the filter knows is linearised, so that along a direction of the variances covariance,
gains and mean are moved by recursions without a tyre in them: sixteen directions cost half a run of the filter.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from harness.common.arrays import Floats
from harness.diagnosis.model import covariance_loops
from harness.engine.compile import SINGLES, CompiledModel, load_source, over_singles, paste
from harness.engine.simd.lanes import LANES
from harness.identification.candidates import Candidates
from harness.identification.data import DriveData
from harness.identification.filtered_model import FilterRun

Singles = NDArray[np.float32]


class NoiseSlopes:
    """The compiled loops of a filter.

    Args:
        compiled: The model that the filter knows.
        inputs: Its inputs among those of the recordings.
    """

    def __init__(self, compiled: CompiledModel, inputs: NDArray[np.int_]) -> None:
        self._compiled, self._inputs = compiled, inputs
        self._linearise = load_source("linearise", paste(compiled, "linearise", [covariance_loops.linearise])).linearise
        vary = over_singles(paste(compiled, "vary_noise", [covariance_loops.vary_noise]))
        self._vary = load_source("vary_noise", vary).vary_noise

    @np.errstate(over="ignore", invalid="ignore")
    def along(
        self, drive: DriveData, constants: Floats, kept: FilterRun, directions: Candidates, first: Floats
    ) -> tuple[Floats, Floats]:
        """Return gradient ``(n,)`` and Fisher information ``(n, n)`` of a recording's log-likelihood.

        Where the filter diverges they are not finite.

        Args:
            drive: The recording.
            constants: Of the filter's model ``(nc, LANES)``.
            kept: The pass, with the state in which it begins.
            directions: Derivatives of the variances by which it was made ``(..., n)``; parameters are not regarded.
            first: Derivatives of the variances of the first state ``(nx, n)``.
        """
        nx, n = len(first), directions.count
        there = np.isfinite(kept.whitened)
        r = np.where(there, kept.whitened, 0.0)
        whitening = kept.whitening * there[:, :, None] * there[:, None, :]
        jacobians = self._linear(drive, constants, kept.state[:, :nx])
        columns, linear = (tuple(map(part, jacobians)) for part in (nonzero_columns, _singles))
        passed = tuple(_singles(part) for part in (kept.gain[:, :nx], whitening, r))
        rows, ny = [], r.shape[1]
        for s in range(0, n, SINGLES):
            lanes = [min(j, n - 1) for j in range(s, s + SINGLES)]
            moved = tuple(_singles(part[:, lanes]) for part in (directions.process, directions.measurement, first))
            changes = np.zeros((len(r), ny + ny * (ny + 1) // 2, SINGLES), np.float32)
            self._vary(linear, columns, *passed, moved, changes)
            rows.append(changes.reshape(-1, SINGLES))
        pull = _singles(_pull(r)).reshape(-1)
        gradient = np.concatenate([part.T @ pull for part in rows]).astype(float)
        information = np.block([[row.T @ column for column in rows] for row in rows]).astype(float)
        return gradient[:n], information[:n, :n]

    def _linear(self, drive: DriveData, constants: Floats, states: Floats) -> tuple[Floats, Floats]:
        """Return the Jacobians of the next state and of the outputs at every sample ``(samples, ..., nx)``."""
        nx, ny, blocks = states.shape[1], self._compiled.ny, -(-len(states) // LANES)
        ahead, outputs = np.zeros((blocks, nx, nx, LANES)), np.zeros((blocks, ny, nx, LANES))
        u, between = (_in_blocks(part[:, self._inputs]) for part in (drive.inputs, drive.between))
        self._linearise(u, between, constants, _in_blocks(states), ahead, outputs)
        A, H = (np.moveaxis(part, -1, 1).reshape(-1, *part.shape[1:-1])[: len(states)] for part in (ahead, outputs))
        return A, H


def _pull(r: Floats) -> Floats:
    """Return what the rows of ``vary_noise`` are multiplied by for the gradient ``(samples, rows)``."""
    a, b = np.tril_indices(r.shape[1])
    seen = r[:, a] * r[:, b] - (a == b)
    return np.concatenate([-r, np.where(a == b, np.sqrt(0.5), 1.0) * seen], axis=1)


def _singles(values: Floats) -> Singles:
    """Return numbers in single precision, row by row."""
    return np.ascontiguousarray(values, dtype=np.float32)


def _in_blocks(values: Floats) -> Floats:
    """Return samples ``(samples, n)`` as lanes ``(blocks, n, LANES)``, the last one repeated."""
    filled = np.concatenate([values, np.repeat(values[-1:], -len(values) % LANES, axis=0)])
    return np.ascontiguousarray(filled.reshape(-1, LANES, values.shape[1]).transpose(0, 2, 1))


def nonzero_columns(matrices: Floats) -> NDArray[np.int_]:
    """Return the columns of matrices ``(samples, rows, n)`` that are not always zero, then -1 ``(rows, n + 1)``."""
    rows, n = matrices.shape[1:]
    columns = np.full((rows, n + 1), -1)
    for row, there in zip(columns, (matrices != 0.0).any(axis=0), strict=True):
        row[: there.sum()] = np.flatnonzero(there)
    return columns
