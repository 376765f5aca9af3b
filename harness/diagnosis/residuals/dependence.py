"""Signals on which a disturbance depends: the candidates, sparse regression on them, and the curve over one of them.

Candidates are inputs, measured motion, and what follows from both at once. Tyre forces are not among them: the forces
of a filter without the disturbance absorb it, and would explain whatever is missing. Inputs are measured, and a
measured angle or rate is hardly filtered. What has memory (rubber that is stiffer at first, a load that gives way)
depends on the high-pass part of a signal: the signal less its low-pass of first order. That is taken a sample earlier,
because the high-pass part of a filtered signal contains the noise of its own sample, which would explain itself.

The terms of the regression are a few functions of every regressor at the inputs of the largest gain. Each is filtered
as the innovations are, so that the innovations themselves are explained and not a smoothed disturbance. The lasso
selects terms on halves of the drives, cut into pieces and drawn in complementary pairs; a term that is selected often
is kept (Meinshausen and Buehlmann 2010; Shah and Samworth 2013).

The curve is a penalised cubic B-spline; beyond the values that were fitted it stays at its end (Eilers and Marx 1996
for the penalty on differences).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from scipy import signal
from scipy.interpolate import BSpline

from harness.common.arrays import Floats
from harness.diagnosis.innovations.disturbance_inputs import DisturbanceInput
from harness.diagnosis.innovations.innovation_model import lasso
from harness.diagnosis.model.augmented_model import AugmentedModel
from harness.diagnosis.residuals.disturbance_ranking import DisturbanceRanking
from harness.identification.data import DriveData
from harness.models.assembly.assemble import StateSpaceModel, symbol
from harness.models.signals import SIGNALS

_LOWEST_SPEED = 1.0
"""m/s; a curvature is taken at this speed at least."""

WITHIN = (0.2, 0.6)
"""s; how old the quick part of a signal may be."""

_WINDOW = 0.1
"""s over which the rate of an input is taken."""


@dataclass(frozen=True)
class Regressor:
    """A signal that a disturbance may depend on.

    Attributes:
        name: As a signal of the project where it is one.
        words: In reports.
        unit: SI.
        signal: From states ``(samples, nx)``, inputs ``(samples, nu)`` and rates of those ``(samples, nu)``.
        within: Time constant in s of the low-pass that is taken off, infinite if it is the signal itself.
    """

    name: str
    words: str
    unit: str
    signal: Callable[[Floats, Floats, Floats], Floats] = field(compare=False)
    within: float = math.inf

    def over(self, states: Floats, drive: DriveData) -> Floats:
        """Return its value over a drive ``(samples,)`` of states ``(samples, nx)``."""
        s = self.signal(states, drive.inputs, rates(drive))
        share = self.renewed(float(drive.time[1] - drive.time[0]))
        if share == 0.0:
            return s
        slow, _ = signal.lfilter([share], [1.0, share - 1.0], s, zi=[(1.0 - share) * s[0]])
        return np.concatenate([[0.0], (s - slow)[:-1]])

    def renewed(self, step: float) -> float:
        """Return the share of the low-pass that a step in s renews; none of it where nothing is taken off."""
        return -math.expm1(-step / self.within)


def regressors_of(augmented: AugmentedModel) -> tuple[Regressor, ...]:
    """Return the regressors that a nominal model has, as functions of states and inputs of the augmented one."""
    model, column = augmented.nominal, augmented.model.inputs.index
    inputs = [n for n in model.inputs if n != "time"]
    measured = [s for s in model.states if _measured(model, s) and SIGNALS[s].unit != "N"]
    regressors = [_column(n, column(n), 1) for n in inputs]
    regressors += [_column(n, model.states.index(n), 0) for n in measured]
    for n in inputs:
        if n not in model.rates and f"{n}_rate" not in inputs and n != "speed":
            regressors.append(_rate_of_input(n, column(n)))
    regressors += [d for s in measured if (d := _rate_of_state(model, s, measured)) is not None]
    if "speed" in inputs:
        speed = column("speed")
        for s in measured:
            if SIGNALS[s].unit == "rad/s":
                regressors += _cornering(s, model.states.index(s), speed)
    return tuple(regressors)


def with_quick(regressors: Sequence[Regressor]) -> tuple[Regressor, ...]:
    """Return regressors and the quick parts of those that are angles or rates of turn."""
    extended = list(regressors)
    for d in regressors:
        if d.name in SIGNALS and d.unit in ("rad", "rad/s"):
            for within in WITHIN:
                extended.append(replace(d, words=f"quick part of the {d.words} (within {within:g} s)", within=within))
    return tuple(extended)


def rates(drive: DriveData) -> Floats:
    """Return the time derivative of every input over a short window ``(samples, nu)``."""
    step = float(drive.time[1] - drive.time[0])
    reach = max(1, round(0.5 * _WINDOW / step))
    padded = np.pad(drive.inputs, ((reach, reach), (0, 0)), mode="edge")
    return (padded[2 * reach :] - padded[: -2 * reach]) / (2 * reach * step)


def _measured(model: StateSpaceModel, state: str) -> bool:
    return any(
        model.ports.get(f"sensor_{output}", expr) == symbol(state) or expr == symbol(state)
        for output, expr in model.outputs.items()
    )


def _column(name: str, i: int, source: int) -> Regressor:
    return Regressor(name, name.replace("_", " "), SIGNALS[name].unit, lambda *tables: tables[source][:, i])


def _rate_of_input(name: str, i: int) -> Regressor:
    words = f"rate of the {name.replace('_', ' ')}"
    return Regressor(f"{name}_rate", words, f"{SIGNALS[name].unit}/s", lambda x, u, du: du[:, i])


def _rate_of_state(model: StateSpaceModel, state: str, measured: list[str]) -> Regressor | None:
    """Return the rate of a state that follows from measured ones alone."""
    rate = model.derivatives[model.states.index(state)]
    reads = {s.name for s in rate.free_symbols}
    if model.discrete or not reads or not reads <= set(measured):
        return None
    slopes = np.zeros(len(model.states))
    for name in reads:
        slope = rate.diff(symbol(name))
        if not slope.is_number:
            return None
        slopes[model.states.index(name)] = float(slope)
    words = f"rate of the {state.replace('_', ' ')}"
    return Regressor(f"{state}_rate", words, f"{SIGNALS[state].unit}/s", lambda x, u, du: x[:, : len(slopes)] @ slopes)


def _cornering(state: str, i: int, speed: int) -> list[Regressor]:
    suffix = state.removeprefix("yaw_rate").replace("_", " ")
    return [
        Regressor(
            f"{state}*speed",
            f"yaw rate{suffix} times speed",
            "m/s^2",
            lambda x, u, du: x[:, i] * u[:, speed],
        ),
        Regressor(
            f"{state}/speed",
            f"curvature{' suffix the path suffix the' + suffix if suffix else ''}",
            "1/m",
            lambda x, u, du: x[:, i] / np.maximum(u[:, speed], _LOWEST_SPEED),
        ),
    ]


PIECE = 10.0
"""s; pieces of a drive that are drawn together."""

PAIRS = 20
"""Complementary halves that are drawn."""

TAKEN = 6
"""Terms that the lasso takes of each half."""

_SHAPES = (
    lambda s: s,
    lambda s: s**3,
    lambda s: np.tanh(3.0 * s),
    lambda s: np.abs(s),
    lambda s: s**2,
)
"""Of a signal over twice its standard deviation: linear, hardening, saturating, and two even functions."""


@dataclass(frozen=True)
class Dependence:
    """A pair of input and regressor with the share of halves in which one of its terms was selected."""

    disturbance_input: DisturbanceInput
    regressor: Regressor
    stability: float


def proposals(
    ranking: DisturbanceRanking,
    disturbance_inputs: Sequence[DisturbanceInput],
    regressors: Sequence[Regressor],
    signals: Sequence[Floats],
    moved: Sequence[Floats],
    residuals: Sequence[Floats],
) -> list[Dependence]:
    """Return pairs of input and regressor, the most stable first.

    Args:
        ranking: At the fit.
        disturbance_inputs: Inputs to be tried.
        regressors: Signals to be tried.
        signals: Their values by drive ``(samples, regressors)``.
        moved: What the fitted parameters do to the innovations, by drive ``(samples * ny, parameters)``.
        residuals: Whitened innovations that are to be explained, by drive ``(samples, ny)``.
    """
    scale = 2.0 * np.std(np.concatenate(signals), axis=0)
    pieces = ranking.augmented.share(
        lambda i: _pieces(
            ranking, disturbance_inputs, signals[i] / np.where(scale > 0, scale, 1.0), moved[i], residuals[i], i
        ),
        range(len(signals)),
    )
    gram, pull = (np.concatenate(parts) for parts in zip(*pieces, strict=True))
    rng = np.random.default_rng(0)
    count, fixed = len(gram), moved[0].shape[1]
    taken = np.zeros(len(disturbance_inputs) * len(regressors))
    for _ in range(PAIRS):
        order = rng.permutation(count)
        for half in (order[: count // 2], order[count // 2 :]):
            weights = _sparse(gram[half].sum(axis=0), pull[half].sum(axis=0), fixed)
            taken += np.any(weights.reshape(len(taken), len(_SHAPES)) != 0.0, axis=1)
    stability = taken / (2 * PAIRS)
    pairs = [
        Dependence(disturbance_inputs[j // len(regressors)], regressors[j % len(regressors)], float(stability[j]))
        for j in np.argsort(-stability, kind="stable")
    ]
    return [p for p in pairs if p.stability > 0]


def _pieces(
    ranking: DisturbanceRanking,
    disturbance_inputs: Sequence[DisturbanceInput],
    signals: Floats,
    moved: Floats,
    residual: Floats,
    drive: int,
) -> tuple[Floats, Floats]:
    """Return Gram matrix and pull of all terms, behind those of the parameters, for each piece of a drive."""
    shapes = np.stack([shape(signals) for shape in _SHAPES], axis=2)
    shapes -= shapes.mean(axis=0)
    terms = shapes.reshape(len(signals), -1)
    model = ranking.linear[drive].innovations
    ny = residual.shape[1]
    columns = [moved.astype(np.float32)]
    for disturbance_input in disturbance_inputs:
        response = model.responses(ranking.input_directions(disturbance_input)[drive], terms)
        columns.append(response.reshape(len(signals) * ny, -1).astype(np.float32))
    X, r = np.concatenate(columns, axis=1), residual.reshape(-1)
    length = round(PIECE / model.step) * ny
    pieces = []
    for begin in range(0, len(r), length):
        x = X[begin : begin + length].astype(float)  # where a linearised model grows its squares need the range
        pieces.append((x.T @ x, x.T @ r[begin : begin + length]))
    gram, pull = zip(*pieces, strict=True)
    return np.array(gram), np.array(pull)


def _sparse(gram: Floats, pull: Floats, fixed: int) -> Floats:
    """Return the lasso's weights of the terms, with the first ``fixed`` columns projected out."""
    cross = np.linalg.pinv(gram[:fixed, :fixed], rcond=1e-9, hermitian=True) @ gram[:fixed, fixed:]
    G, b = gram[fixed:, fixed:] - cross.T @ gram[:fixed, fixed:], pull[fixed:] - cross.T @ pull[:fixed]
    power, raw = np.diagonal(G), np.diagonal(gram)[fixed:]
    seen = power > 1e-4 * np.maximum(raw, 1e-300)
    scale = np.sqrt(np.where(seen, power, 1.0))
    weights = np.zeros(len(b))
    if seen.any():
        unit = G[np.ix_(seen, seen)] / np.outer(scale[seen], scale[seen])
        floor = np.sqrt(2.0 * np.log(seen.sum() + 1.0))  # the largest of as many pulls by chance (Donoho and Johnstone)
        weights[seen] = lasso(unit, b[seen] / scale[seen], float(floor), TAKEN)
    return weights


DEGREE = 3
FUNCTIONS = 9
"""Numbers that describe a curve."""

_ENDS = 0.002
"""Share of the samples to either side that lies beyond the ends of a curve."""


@dataclass(frozen=True)
class Basis:
    """The functions that a curve is made of.

    Attributes:
        knots: ``(FUNCTIONS + DEGREE + 1,)``.
    """

    knots: Floats

    @staticmethod
    def over(values: Floats) -> Basis:
        """Return a basis for samples of a signal, with evenly spaced knots."""
        low, high = np.quantile(values, [_ENDS, 1.0 - _ENDS])
        inner = np.linspace(low, max(high, low + 1e-12), FUNCTIONS - DEGREE + 1)
        return Basis(np.concatenate([np.full(DEGREE, inner[0]), inner, np.full(DEGREE, inner[-1])]))

    @property
    def ends(self) -> tuple[float, float]:
        """Where the curve becomes constant."""
        return float(self.knots[0]), float(self.knots[-1])

    def of(self, values: Floats) -> Floats:
        """Return the functions at samples of the signal ``(samples, FUNCTIONS)``."""
        return BSpline.design_matrix(np.clip(values, *self.ends), self.knots, DEGREE).toarray()

    @staticmethod
    def roughness() -> Floats:
        """Return the sum of squared second differences as a matrix ``(FUNCTIONS, FUNCTIONS)``."""
        D = np.diff(np.eye(FUNCTIONS), 2, axis=0)
        return D.T @ D


@dataclass(frozen=True)
class Curve:
    """A disturbance at an input as a function of a signal.

    Attributes:
        disturbance_input: The input.
        regressor: The signal.
        basis: Its functions.
        weights: Of the functions ``(FUNCTIONS,)``.
        covariance: Of the weights.
        stability: Share of the halves of the data in which the lasso selected the pair.
        predicted: Gain in log-likelihood of drives from which it was not fitted, in cross-validation.
    """

    disturbance_input: DisturbanceInput
    regressor: Regressor
    basis: Basis
    weights: Floats
    covariance: Floats
    stability: float
    predicted: float

    def at(self, values: Floats) -> Floats:
        """Return the disturbance at samples of the signal."""
        return self.basis.of(values) @ self.weights

    def error(self, values: Floats) -> Floats:
        """Return the standard error there."""
        functions = self.basis.of(values)
        return np.sqrt(np.maximum(np.einsum("si,ij,sj->s", functions, self.covariance, functions), 0.0))
