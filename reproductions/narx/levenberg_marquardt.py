"""Levenberg-Marquardt with Bayesian regularisation, open loop (Foresee and Hagan 1997; Ziaukas 2023, 3.2).

The objective is ``F = beta E_D + alpha E_W`` with the sum of squared errors ``E_D`` over all samples and outputs and
the sum of squared weights ``E_W``. A step solves ``(beta J'J + (mu + alpha) I) dp = beta J'e - alpha p``; after it
``gamma = P - alpha tr (beta J'J + alpha I)^-1``, the effective number of parameters, renews
``alpha = gamma / 2 E_W`` and ``beta = (N - gamma) / 2 E_D``. ``J`` is exact and never held as a whole: ``J'J`` and
``J'e`` are summed over chunks.
"""

from __future__ import annotations

import logging
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import NamedTuple, Protocol

import numpy as np
from scipy import linalg

from harness.common.arrays import Floats
from harness.estimation.narx_network import forward, unpack

CHUNK = 4096
"""Samples per chunk: 10 MB of Jacobian for 321 parameters, about what stays in the cache of a core."""

_log = logging.getLogger(__name__)


class Normal(NamedTuple):
    """Normal equations at a parameter vector: ``J'J (P, P)``, ``J'e (P,)``, sum of squares, number of errors."""

    JJ: Floats
    Je: Floats
    squares: float
    errors: int


class Problem(Protocol):
    """A least-squares problem."""

    def normal(self, p: Floats) -> Normal:
        """Return the normal equations; ``J`` is the derivative of the model, ``e`` is target minus model."""

    def squares(self, p: Floats) -> float:
        """Return the sum of squared errors."""


@dataclass(frozen=True)
class Pairs:
    """The one-step problem of a layered network: regressors, targets, sizes of the layers.

    Attributes:
        x: ``(samples, regressor)``.
        t: ``(samples, outputs)``.
        sizes: Lengths of regressor, hidden layers and output.
    """

    x: Floats
    t: Floats
    sizes: tuple[int, ...]

    def squares(self, p: Floats) -> float:
        """Return the sum of squared errors over all samples and outputs."""
        return float(self.squares_of_outputs(p).sum())

    def squares_of_outputs(self, p: Floats) -> Floats:
        """Return the sum of squared errors of each output, ``(outputs,)``."""
        layers, total = unpack(p, self.sizes), np.zeros(self.t.shape[1])
        for part in self.parts():
            e = self.t[part] - forward(layers, self.x[part])[-1]
            total += np.einsum("ko,ko->o", e, e)
        return total

    def normal(self, p: Floats) -> Normal:
        """Return the normal equations."""
        layers = unpack(p, self.sizes)
        if len(layers) == 2:
            return _normal_of_one_layer(self, layers)
        JJ, Je, total = np.zeros((len(p), len(p))), np.zeros(len(p)), 0.0
        for part in self.parts():
            e = self.t[part] - forward(layers, self.x[part])[-1]
            total += float(np.vdot(e, e))
            for o in range(self.t.shape[1]):
                J = jacobian(layers, self.x[part], o)
                JJ += J.T @ J
                Je += J.T @ e[:, o]
        return Normal(JJ, Je, total, self.t.size)

    def parts(self) -> list[slice]:
        """Return the chunks."""
        return [slice(k, k + CHUNK) for k in range(0, len(self.x), CHUNK)]


def with_one(a: Floats) -> Floats:
    """Append a column of ones, the input of the biases."""
    return np.column_stack([a, np.ones(len(a))])


def jacobian(layers: Sequence[Floats], x: Floats, output: int) -> Floats:
    """Return the derivatives of one output to all parameters, ``(samples, P)``, by backpropagation."""
    activations = [x, *forward(layers, x)]
    blocks: list[Floats] = []
    last = np.zeros((len(x), *layers[-1].shape))
    last[:, output] = with_one(activations[-2])
    blocks.append(last.reshape(len(x), -1))
    delta = np.broadcast_to(layers[-1][output, :-1], activations[-2].shape)
    for index in range(len(layers) - 2, -1, -1):
        delta = delta * (1.0 - activations[index + 1] ** 2)
        blocks.append((delta[:, :, None] * with_one(activations[index])[:, None, :]).reshape(len(x), -1))
        delta = delta @ layers[index][:, :-1]
    return np.concatenate(blocks[::-1], axis=1)


def _normal_of_one_layer(problem: Pairs, layers: Sequence[Floats]) -> Normal:
    """Return the normal equations of a network with one hidden layer, from one product for all outputs.

    The derivative of output o to a hidden weight is ``V[o, j] d[j] x[i]``: the outputs differ by ``V`` alone, so
    the sum over them scales the entries of one Gram matrix of ``[d x, d, h, 1]``.
    """
    W, V = layers[0], layers[1][:, :-1]
    inner, outer, n_x = W.size, layers[1].shape[1], W.shape[1]
    buffer = np.empty((CHUNK, inner + outer))  # one for all chunks: fresh memory costs more than the arithmetic
    G, r, total = np.zeros((inner + outer, inner + outer)), np.zeros((inner + outer, len(V))), 0.0
    for part in problem.parts():
        xb = with_one(problem.x[part])
        M = buffer[: len(xb)]
        h = np.tanh(xb @ W.T)
        M[:, inner:-1], M[:, -1] = h, 1.0
        np.multiply((1.0 - h * h)[:, :, None], xb[:, None, :], out=M[:, :inner].reshape(len(xb), -1, n_x))
        e = problem.t[part] - M[:, inner:] @ layers[1].T
        G += M.T @ M
        r += M.T @ e
        total += float(np.vdot(e, e))
    count = inner + len(V) * outer
    JJ, Je = np.zeros((count, count)), np.zeros(count)
    by = np.repeat(V, n_x, axis=1)  # V of the neuron of each hidden weight, (outputs, inner)
    JJ[:inner, :inner] = G[:inner, :inner] * (by.T @ by)
    Je[:inner] = np.einsum("io,oi->i", r[:inner], by)
    for o in range(len(V)):
        rows = slice(inner + o * outer, inner + (o + 1) * outer)
        JJ[:inner, rows] = by[o][:, None] * G[:inner, inner:]
        JJ[rows, :inner] = JJ[:inner, rows].T
        JJ[rows, rows] = G[inner:, inner:]
        Je[rows] = r[inner:, o]
    return Normal(JJ, Je, total, problem.t.size)


@dataclass(frozen=True)
class TrainedParameters:
    """The end of a training.

    Attributes:
        parameters: Those of the least validation error (the last ones without validation), ``(P,)``.
        epochs: Steps taken.
        gamma: Effective number of parameters at the end.
        alpha, beta: Weights of the two sums at the end.
        squares: Sum of squared errors of ``parameters``.
        stopped: Why it ended.
    """

    parameters: Floats
    epochs: int
    gamma: float
    alpha: float
    beta: float
    squares: float
    stopped: str


def train(
    problem: Problem,
    first: Floats,
    *,
    epochs: int = 500,
    validate: Callable[[Floats], float] | None = None,
    patience: int = 6,
    tolerance: float = 1e-5,
    regularise: bool = True,
) -> TrainedParameters:
    """Minimise a least-squares problem.

    Args:
        problem: Gives the normal equations.
        first: First parameters ``(P,)``.
        epochs: Largest number of steps.
        validate: Error on data that are not trained on; training stops when it has not fallen ``patience`` times.
        patience: See ``validate``.
        tolerance: Training stops when the sum of squares falls by a smaller share in ten steps.
        regularise: Whether alpha and beta follow Foresee and Hagan; otherwise alpha = 0, beta = 1.
    """
    p, mu, best, best_error, failures = first.copy(), 0.005, first, np.inf, 0
    at = problem.normal(p)
    P, N = len(p), at.errors
    gamma = float(P)
    alpha, beta = _weights(gamma, N, p, at.squares) if regularise else (0.0, 1.0)
    history, stopped, epoch = [at.squares], "epochs", 0
    for epoch in range(1, epochs + 1):
        accepted = None
        while accepted is None and mu <= 1e10:
            accepted = _step(problem, p, at, alpha, beta, mu)
            mu = mu * 10 if accepted is None else max(0.1 * mu, 1e-20)
        if accepted is None:
            stopped, epoch = "no step lowers the objective", epoch - 1
            break
        p = accepted
        at = problem.normal(p)
        history.append(at.squares)
        if regularise:
            gamma = effective_parameters(at.JJ, alpha, beta)
            alpha, beta = _weights(gamma, N, p, at.squares)
        if validate is not None:
            error = validate(p)
            _log.debug("epoch %d: %.6e, validation %.6e, gamma %.1f, mu %.0e", epoch, at.squares, error, gamma, mu)
            best, failures = (p, 0) if error < best_error else (best, failures + 1)
            best_error = min(error, best_error)
            if failures >= patience:
                stopped = "validation error rises"
                break
        if at.squares <= 1e-28 * N or (len(history) > 10 and history[-11] - at.squares < tolerance * at.squares):
            stopped = "converged"
            break
    chosen = p if validate is None else best
    return TrainedParameters(chosen, epoch, gamma, alpha, beta, problem.squares(chosen), stopped)


def _step(problem: Problem, p: Floats, at: Normal, alpha: float, beta: float, mu: float) -> Floats | None:
    """Return the parameters one step ahead if the objective falls there."""
    matrix = beta * at.JJ
    matrix[np.diag_indices_from(matrix)] += mu + alpha
    try:
        ahead = p + linalg.solve(matrix, beta * at.Je - alpha * p, assume_a="pos")
    except linalg.LinAlgError:
        return None
    before = beta * at.squares + alpha * float(p @ p)
    with np.errstate(over="ignore", invalid="ignore"):
        after = beta * problem.squares(ahead) + alpha * float(ahead @ ahead)
    return ahead if after < before else None


def effective_parameters(JJ: Floats, alpha: float, beta: float) -> float:
    """Return ``gamma = P - alpha tr (beta J'J + alpha I)^-1 = sum beta l / (beta l + alpha)`` over the eigenvalues."""
    values = np.maximum(linalg.eigvalsh(JJ), 0.0)
    return float(np.sum(beta * values / (beta * values + alpha)))


def _weights(gamma: float, count: int, p: Floats, squares: float) -> tuple[float, float]:
    tiny = np.finfo(float).tiny
    return gamma / max(2.0 * float(p @ p), tiny), max(count - gamma, 1.0) / max(2.0 * squares, 1e-30)
