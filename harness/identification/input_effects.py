"""Effect of the errors of recorded inputs on the state and the outputs of a model, by exact derivatives.

With an error ``e`` of the inputs, of covariance ``P``, the next state is off by ``G e`` and the outputs by ``D e``.
So a filter has the process noise ``G P G'`` more, the measurement noise ``D P D'``, and both are correlated by
``G P D'`` (the errors of a smoothed input hardly change from one sample to the next). A free run sums them up.
"""

from __future__ import annotations

import numpy as np

from harness.common.arrays import Floats
from harness.engine.compile import CompiledModel, load_source, paste
from harness.engine.kernel_names import LANES, NW, NX, NY, get, next_state, output, put
from harness.engine.simd import lanes as plain
from harness.engine.simd.dual import tangent_of, with_tangent
from harness.identification.data import DriveData


def input_tangents(u, between, constants, states, moved, ahead, outputs):
    """Write derivatives of the next state and the outputs along eight directions of state and inputs; over duals only.

    Args:
        u: Inputs ``(samples, nu)``.
        between: Inputs during the step behind each sample ``(samples, nu)``.
        constants: ``(nc, LANES)``.
        states: ``(samples, nx)``.
        moved: Directions of the state and behind it of the inputs ``(nx + nu, lanes)``.
        ahead: Of the next state, written ``(samples, rows, lanes)``; its first rows are.
        outputs: Written ``(samples, ny, lanes)``.
    """
    samples, nu = u.shape
    x, xn, y, w = np.empty((NX, LANES)), np.empty((NX, LANES)), np.empty((NY, LANES)), np.empty((NW, LANES))
    at, behind = np.empty((nu, LANES)), np.empty((nu, LANES))
    for k in range(samples):
        for i in range(NX):
            put(with_tangent(plain.splat(states[k, i]), plain.get(moved, i)), x, i)
        for i in range(nu):
            put(with_tangent(plain.splat(u[k, i]), plain.get(moved, NX + i)), at, i)
            put(with_tangent(plain.splat(between[k, i]), plain.get(moved, NX + i)), behind, i)
        output(x, at, constants, y)
        next_state(x, behind, constants, xn, w)
        for a in range(NY):
            plain.put(tangent_of(get(y, a)), outputs, k, a)
        for i in range(ahead.shape[1]):
            plain.put(tangent_of(get(xn, i)), ahead, k, i)


class InputEffects:
    """The derivatives of a model to its inputs, compiled when they are first asked for.

    Args:
        duals: Its kernels over dual numbers.
    """

    def __init__(self, duals: CompiledModel) -> None:
        self._duals = duals

    def along(self, drive: DriveData, states: Floats, values: Floats, nx: int) -> tuple[Floats, Floats]:
        """Return what the errors of a drive's inputs do, as ``DriveData`` has it in ``effects`` and ``spread``.

        Args:
            drive: The recording.
            states: Where it is linearised ``(samples, states of the model)``.
            values: Parameters ``(np,)``.
            nx: Number of states, the first ones, that are wanted.
        """
        errors, count = drive.input_errors, len(self._duals.model.states)
        rows = [errors.rows[a] for a in errors.visible]
        unit = np.eye(count + drive.inputs.shape[1])
        moved = unit[:, [*range(nx), *(count + i for i in rows)]]
        ahead, outputs = self._tangents(drive, states, values, moved, nx)
        A, H = ahead[:, :, :nx], outputs[:, :, :nx]
        G, D = ahead[:, :, nx:], outputs[:, :, nx:]
        roots = errors.roots
        before = np.concatenate([G[:1], G[:-1]])  # the step that leads to a sample
        if errors.of_samples:  # those of the step that leads to a sample are others than those at the sample
            moved, seen = before @ np.concatenate([roots[:1], roots[:-1]]), D @ roots
            columns = [(moved, np.zeros_like(moved)), (np.zeros_like(seen), seen)]
            effects = np.concatenate([np.concatenate(pair, axis=2) for pair in columns], axis=1)
        else:
            effects = np.concatenate([before @ roots, D @ roots], axis=1)
        return np.ascontiguousarray(effects), self._spread(drive, A, H, G, D)

    def _tangents(
        self, drive: DriveData, states: Floats, values: Floats, moved: Floats, rows: int
    ) -> tuple[Floats, Floats]:
        source = paste(self._duals, "input_tangents", [input_tangents])
        kernel = load_source("input_tangents", source).input_tangents
        samples, n = len(states), moved.shape[1]
        held = np.zeros((len(values), self._duals.lanes))
        held[:, : plain.LANES] = values[:, None]
        constants = self._duals.constants(held)
        derivatives = np.empty((samples, rows, n)), np.empty((samples, drive.measurements.shape[1], n))
        for s in range(0, n, plain.LANES):
            columns = [min(j, n - 1) for j in range(s, s + plain.LANES)]
            parts = [np.empty((samples, f.shape[1], plain.LANES)) for f in derivatives]
            directions = np.ascontiguousarray(moved[:, columns])
            kernel(drive.inputs, drive.between, constants, states, directions, *parts)
            for f, part in zip(derivatives, parts, strict=True):
                f[:, :, s : s + plain.LANES] = part[:, :, : n - s]
        return derivatives

    def _spread(self, drive: DriveData, A: Floats, H: Floats, G: Floats, D: Floats) -> Floats:
        """Return the variances of the outputs of a free run: the linear model driven by the errors of the inputs.

        The errors of a smoothed input are a Markov process, whose transition the smoother knows.
        """
        errors = drive.input_errors
        G, D = (_among(part, errors.visible, len(errors.rows)) for part in (G, D))
        lasting, P = errors.transition, errors.covariance
        n, m = A.shape[1], P.shape[1]
        joint, M = np.zeros((len(A), n + m, n + m)), np.zeros((n + m, n + m))
        joint[0, n:, n:] = P[0]
        for k in range(1, len(A)):
            M[:n, :n], M[:n, n:], M[n:, n:] = A[k - 1], G[k - 1], lasting[k]
            joint[k] = M @ joint[k - 1] @ M.T
            joint[k, n:, n:] = P[k]
        seen = np.concatenate([H, D], axis=2)
        return np.einsum("kai,kai->ka", seen @ joint, seen)


def _among(columns: Floats, places: list[int], count: int) -> Floats:
    """Return columns ``(samples, rows, n)`` at their places among others that are zero ``(samples, rows, count)``."""
    placed = np.zeros((*columns.shape[:2], count))
    placed[:, :, places] = columns
    return placed
