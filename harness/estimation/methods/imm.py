"""Interacting multiple models: a bank of extended Kalman filters over values of uncertain parameters.

Each hypothesis states a value of every parameter of ``unknown_parameters``, and which of them holds is a Markov chain
(Blom and Bar-Shalom 1988; Bar-Shalom, Li and Kirubarajan 2001, 11.6.6). A step mixes the estimates of the filters by
the probability that one hypothesis has taken over from another, runs each filter, weighs the hypotheses by its
likelihood, and gives mean and covariance of the mixture. What it says of the sample is the mixture's as well.

A hypothesis stands for all values that are nearer to it than to another one: when it begins to hold, the parameter is
distributed evenly over them. While it holds, its filter estimates the parameter from there on, or considers it (Schmidt
1966; Jazwinski 1970, chapter 8): then it enters gain and covariance and is left alone. One hypothesis alone stands for
the prior. At first the hypotheses have the probability that the prior gives to what they stand for.

Memory, in rows of lanes, with M hypotheses: their probabilities (0 before the first step), means ``(M, nx)`` and
covariances ``(M, nx, nx)``, then what is believed of every parameter, or its logarithm.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import product
from math import prod
from pathlib import Path

import numpy as np
from pydantic import BaseModel, ConfigDict, Field

from harness.common.errors import UserError
from harness.common.registry import closest
from harness.common.units import to_si
from harness.engine.compile import CompiledModel
from harness.engine.kernel_names import (
    LANES,
    NS,
    NX,
    NY,
    State,
    any_of,
    exp,
    get,
    log,
    maximum,
    put,
    select,
    signals,
    splat,
)
from harness.estimation.methods._input_errors import correct
from harness.estimation.methods._linearised import linear_workspace, predict, spare_info
from harness.estimation.methods._mixture import conclude, moments, normalise, tell
from harness.estimation.methods._weighing import finite
from harness.models.signals import SIGNALS

MOST = 64
HEAD = 4  # numbers of the tuning before those of parameters and hypotheses


class Settings(BaseModel):
    """The hypotheses, and how long one holds."""

    model_config = ConfigDict(extra="forbid")

    hypotheses: dict[str, list[str | float]] = Field(
        {},
        description='values of every unknown parameter: { trailer_mass = ["8 t", "16 t", "24 t", "32 t"] }; of several '
        "parameters, each value with each",
    )
    estimated: bool = Field(
        True, description="whether each filter estimates the parameters from its hypothesis on, or considers them"
    )
    dwell: str | float = Field("100 s", description="mean time for which one hypothesis holds before another does")


# no KALMAN_TYPE: which hypothesis holds depends on the measurements


def fit(settings: Settings, compiled: CompiledModel, folder: Path) -> list[float]:
    """Return what the kernel reads.

    That is: probability to stay, numbers of parameters and of hypotheses, whether parameters are estimated; of each
    parameter its row among the signals, whether its state is a logarithm and the variance of its prior; of each
    hypothesis and parameter the value (or its logarithm), the variance of what it stands for, and the logarithm of how
    wide that is.
    """
    uncertain = compiled.model.within
    names = {s: s.removeprefix("log_" if s in compiled.model.relative else "shift_") for s in uncertain}
    _check(settings, list(names.values()))
    rows: list[float] = []
    cells = []
    for state, name in names.items():
        if name not in compiled.signal_names:
            raise UserError(f"estimator 'imm' reads '{name}' among the signals; make it a target")
        is_log, prior = state in compiled.model.relative, compiled.model.start_variance[state]
        rows += [float(compiled.signal_names.index(name)), float(is_log), prior]
        cells.append(_cells(sorted(_number(v, name, is_log) for v in settings.hypotheses[name]), prior, name))
    count = prod(len(c) for c in cells)
    if count > MOST:
        raise UserError(f"settings of estimator 'imm': {count} hypotheses are more than {MOST}; state fewer values")
    dwell = to_si(settings.dwell, "s", "settings of estimator 'imm': dwell")
    if dwell <= 0:
        raise UserError(f"settings of estimator 'imm': dwell: a time must be positive, got {settings.dwell!r}")
    modes = [number for pick in product(*cells) for cell in pick for number in cell]
    return [
        float(np.exp(-compiled.step_size / dwell)),
        float(len(cells)),
        float(count),
        float(settings.estimated),
        *rows,
        *modes,
    ]


def _check(settings: Settings, uncertain: Sequence[str]) -> None:
    """Refuse hypotheses of parameters that are not uncertain, and uncertain parameters without any."""
    where = "settings of estimator 'imm': hypotheses"
    for name, values in settings.hypotheses.items():
        if name not in uncertain:
            near = closest(name, list(uncertain))
            raise UserError(f"{where}: '{name}' is none of the belief's unknown_parameters{near}; name it there too")
        if not values:
            raise UserError(f"{where}: '{name}' has no value")
    for name in uncertain:
        if name not in settings.hypotheses:
            raise UserError(f"{where}: state values of '{name}', which the belief has in unknown_parameters")


def _number(value: str | float, name: str, is_log: bool) -> float:
    where = f"settings of estimator 'imm': hypotheses: '{name}'"
    number = to_si(value, SIGNALS[name].unit, where)
    if is_log and number <= 0:
        raise UserError(f"{where}: a quantity that cannot be negative needs positive values, got {value!r}")
    return float(np.log(number)) if is_log else number


def _cells(values: Sequence[float], prior: float, name: str) -> list[tuple[float, float, float]]:
    """Return of each value, in order, what it stands for: itself, mean square distance, logarithm of the width.

    It reaches half-way to the neighbours, and as far beyond the first and the last. One value stands for the prior.
    """
    if len(values) == 1:
        return [(values[0], prior, 0.0)]
    gaps = np.diff(values) / 2
    if gaps.min() <= 0:
        raise UserError(f"settings of estimator 'imm': hypotheses: '{name}' has a value twice; remove one")
    below, above = np.append(gaps[:1], gaps), np.append(gaps, gaps[-1:])
    squares = (below**2 - below * above + above**2) / 3
    widths = np.log(below + above)
    return [(float(v), float(q), float(w)) for v, q, w in zip(values, squares, widths, strict=True)]


def memory_size(settings: Settings, compiled: CompiledModel) -> int:
    """Return the number of rows of memory, all zero at first: hypotheses without a probability yet."""
    count = prod(len(v) for v in settings.hypotheses.values())
    return count * (1 + compiled.nx + compiled.nx**2) + len(settings.hypotheses)


def workspace():
    """Return the scratch arrays of a run."""
    return (
        linear_workspace(),
        spare_info(),
        State(np.zeros((NX, LANES)), np.zeros((NX, NX, LANES)), np.zeros((1, LANES))),
        np.zeros((2, NY, NY, LANES)),
        np.zeros((2, NY, LANES)),
        np.zeros((NS, LANES)),
    )


def parts(memory):
    """Return probabilities ``(M, LANES)``, means ``(M, nx, LANES)``, covariances and beliefs as views of the memory."""
    count = memory.shape[0] // (1 + NX + NX * NX)  # there are fewer parameters than one hypothesis has rows
    end = count * (1 + NX)
    behind = end + count * NX * NX
    covariances = memory[end:behind].reshape((count, NX, NX, LANES))
    return memory[:count], memory[count:end].reshape((count, NX, LANES)), covariances, memory[behind:]


def step(before, u_before, u, y, belief, work, after, info):
    """Mix, run the filter of every hypothesis, weigh the hypotheses and sum them up."""
    linear, said, mixed, factor, rows, s = work
    _, x_prior, P_prior, predicted, H, scratch = linear
    weights, means, covariances, believed = parts(before.memory)
    new_weights, new_means, new_covariances, new_believed = parts(after.memory)
    count, parameters = weights.shape[0], int(belief.tuning[1])
    shares = np.empty((count, LANES))
    fresh = is_fresh(weights)
    if fresh:
        as_believed(before, NX - parameters, mixed)
        signals(mixed.mean, u_before, belief.constants, s)
    for p in range(parameters):
        at_start = believed_value(p, belief.tuning, s) if fresh else get(believed, p)
        put(at_start, new_believed, p)
    for j in range(count):
        chance = arrival(j, weights, belief.tuning[0], shares)
        if fresh:
            chance = at_first(j, belief.tuning, new_believed, mixed)
        put(chance, new_weights, j)
    normalise(new_weights)
    for j in range(count):
        at_first(j, belief.tuning, new_believed, mixed)
        if not fresh:
            arrival(j, weights, belief.tuning[0], shares)
            mix(j, shares, means, covariances, NX - parameters, mixed)
        predict(mixed, u_before, u, belief, linear)
        here = State(new_means[j], new_covariances[j], after.memory)
        correct(x_prior, P_prior, predicted, H, y, belief, here, scratch, said)
        if belief.tuning[3] < 0.5:
            leave_alone(mixed, NX - parameters, here)
        chance = get(new_weights, j)
        tell(j == 0, chance, predicted, said, rows, info)
        likelihood = get(said.log_likelihood, 0)
        sound = finite(here.mean) & (likelihood == likelihood)
        put(select(sound, log(chance) + likelihood, -np.inf), new_weights, j)
    best, total = splat(-np.inf), splat(0.0)
    for j in range(count):
        best = maximum(best, get(new_weights, j))
    for j in range(count):
        put(exp(get(new_weights, j) - best), new_weights, j)
        total = total + get(new_weights, j)
    normalise(new_weights)
    conclude(y, best + log(total), rows, factor, info)
    moments(new_weights, new_means, new_covariances, NX, after.mean, after.covariance)
    put(splat(0.0), info.repairs, 0)


def is_fresh(weights):
    """Return whether there are no probabilities yet; the runs of a batch begin together."""
    total = splat(0.0)
    for j in range(weights.shape[0]):
        total = total + get(weights, j)
    return any_of(total == 0.0)


def as_believed(before, n, mixed):
    """Write the state that a run begins with, its parameters as they are believed and not tied to the other states."""
    for a in range(NX):
        put(get(before.mean, a) if a < n else splat(0.0), mixed.mean, a)
        for b in range(NX):
            put(get(before.covariance, a, b) if max(a, b) < n else splat(0.0), mixed.covariance, a, b)


def believed_value(p, tuning, s):
    """Return what is believed of parameter ``p``, or its logarithm, from the signals ``(ns, LANES)``."""
    value = get(s, int(tuning[HEAD + 3 * p]))
    return log(value) if tuning[HEAD + 3 * p + 1] > 0.5 else value


def at_first(j, tuning, believed, mixed):
    """Write the parameters with which hypothesis ``j`` begins to hold; return its probability over that of others.

    Args:
        j: Number of the hypothesis.
        tuning: From ``fit``.
        believed: What is believed of every parameter, or its logarithm ``(parameters, LANES)``.
        mixed: Its parameters and their covariances are written.
    """
    parameters = int(tuning[1])
    chance = splat(0.0)
    for p in range(parameters):
        own = HEAD + 3 * parameters + 3 * (j * parameters + p)
        z = tuning[own] - get(believed, p)
        chance = chance + (tuning[own + 2] - z * z * (0.5 / tuning[HEAD + 3 * p + 2]))
        row = NX - parameters + p
        put(z, mixed.mean, row)
        for b in range(NX):
            put(splat(tuning[own + 1] if b == row else 0.0), mixed.covariance, row, b)
            put(splat(tuning[own + 1] if b == row else 0.0), mixed.covariance, b, row)
    return exp(chance)


def arrival(j, weights, stay, shares):
    """Write the probability of every hypothesis at the sample before if ``j`` holds now; return that of ``j``."""
    count = weights.shape[0]
    leave = (1.0 - stay) / max(1, count - 1)
    total = splat(0.0)
    for i in range(count):
        put((stay if i == j else leave) * get(weights, i), shares, i)
        total = total + get(shares, i)
    for i in range(count):
        put(get(shares, i) / total, shares, i)
    return total


def mix(j, shares, means, covariances, n, mixed):
    """Write the state that the filter of hypothesis ``j`` goes on with.

    Where another hypothesis held before, its parameters begin anew, not tied to the other states.

    Args:
        j: Number of the hypothesis.
        shares: From ``arrival``.
        means: ``(M, nx, LANES)``.
        covariances: ``(M, nx, nx, LANES)``.
        n: Number of states that are no parameters.
        mixed: Written; its parameters are those of ``at_first``.
    """
    moments(shares, means, covariances, n, mixed.mean, mixed.covariance)
    share = get(shares, j)
    held = share > 0.0
    for a in range(n, NX):
        moved = select(held, get(means, j, a) - get(mixed.mean, a), 0.0)  # since it began to hold
        for b in range(n):
            value = get(covariances, j, a, b) + moved * (get(means, j, b) - get(mixed.mean, b))
            value = select(held, share * value, 0.0)
            put(value, mixed.covariance, a, b)
            put(value, mixed.covariance, b, a)
        for b in range(n, a + 1):
            other = select(held, get(means, j, b) - get(mixed.mean, b), 0.0)
            anew = (1.0 - share) * (get(mixed.covariance, a, b) + share * moved * other)
            value = select(held, share * get(covariances, j, a, b), 0.0) + anew
            put(value, mixed.covariance, a, b)
            put(value, mixed.covariance, b, a)
    for a in range(n, NX):
        moved = select(held, get(means, j, a) - get(mixed.mean, a), 0.0)
        put(get(mixed.mean, a) + share * moved, mixed.mean, a)


def leave_alone(mixed, n, here):
    """Put mean and covariance of the parameters back: they are considered (Schmidt 1966)."""
    for a in range(n, NX):
        put(get(mixed.mean, a), here.mean, a)
        for b in range(n, NX):
            put(get(mixed.covariance, a, b), here.covariance, a, b)
