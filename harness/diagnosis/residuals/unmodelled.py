"""An unmodelled disturbance that no effect of the library explains: a function of a signal, or periodic in distance.

What is periodic in the distance driven is sought first (``order_analysis``), because no function of a signal explains
it. ``stability_selection`` proposes pairs of an input and a signal. For each pair a smooth curve is fitted to the
innovations together with the fitted parameters of the model, and assessed by cross-validation over the drives. Forward
selection takes the best, then the best with it, as long as the cross-validated likelihood rises. The likelihood of
the held-out drives must rise as well.

In the simulation, a curve over motion is a function of the simulated motion and not of the measured one, so that its
part in the simulation error is a prediction. Inputs are those of the recording, as for every model. What is periodic
has the phase that fits the drive best.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from harness.common.arrays import Floats
from harness.diagnosis.criteria import BIC_NEEDED, PRIORS, TRIED
from harness.diagnosis.fitting import FittedHypothesis, Fitting, ParameterPoint
from harness.diagnosis.innovations.disturbance_inputs import DisturbanceInput
from harness.diagnosis.model.augmented_model import AugmentedModel
from harness.diagnosis.residuals.dependence import (
    FUNCTIONS,
    Basis,
    Curve,
    Dependence,
    Regressor,
    proposals,
    rates,
    regressors_of,
    with_quick,
)
from harness.diagnosis.residuals.disturbance_ranking import DisturbanceRanking
from harness.diagnosis.residuals.order_analysis import (
    DistanceDomainDrive,
    PeriodicDisturbance,
    Waves,
    find_periodic,
    in_distance_domain,
)
from harness.diagnosis.selection.validation import HeldOut, Judgement, simulation_error
from harness.engine.compile import compile_model
from harness.engine.simd.lanes import LANES
from harness.identification.coordinates import Coordinate
from harness.identification.data import DriveData
from harness.identification.free_run import Start, found_start
from harness.identification.uncertainty import covariance_of

_NEEDED = 0.5 * BIC_NEEDED
"""Least gain in log-likelihood of the drives left out with which a curve is taken; it has no BIC."""

TURNS = 3
"""Largest number of periodic disturbances: an order and its harmonics."""

_ENTRIES = 8
_PAIRS = 12
"""Inputs in the stability selection, and pairs of which curves are fitted."""

_SPEED = ("speed", "longitudinal_velocity")
"""Signals, the integral of either of which is the distance driven."""

_STIFFNESS = (1e-4, 1e-2, 1.0)
"""Penalty on second differences, over the mean information on a weight."""


@dataclass(frozen=True)
class UnmodelledDisturbance:
    """An unmodelled disturbance.

    Attributes:
        curves: In the order they were taken.
        shift: Parameters that move with them: value by name.
        held_out_gain: In log-likelihood of the held-out drives, predicted by the linearised innovations.
        judgement: The model with the curves, simulated on the held-out drives.
        periodic: What is periodic in the distance driven, in the order it was taken.
    """

    curves: tuple[Curve, ...]
    shift: dict[str, float]
    held_out_gain: float
    judgement: Judgement
    periodic: tuple[PeriodicDisturbance, ...] = ()


@dataclass(frozen=True)
class _Term:
    """A curve that may be taken: its pair, its functions, and what they do to the innovations of each drive."""

    proposal: Dependence
    basis: Basis
    responses: list[Floats]


@dataclass(frozen=True)
class _FoldSums:
    """Gram matrix and pull of columns over one fold."""

    gram: Floats
    pull: Floats


class _Drives:
    """Drives with a localised model: signals, and the innovations' response to curves and to parameters."""

    def __init__(
        self, ranking: DisturbanceRanking, fitting: Fitting, point: ParameterPoint, moved: Sequence[Coordinate]
    ) -> None:
        self.ranking, self.drives = ranking, fitting.drives
        self.regressors = with_quick(regressors_of(fitting.augmented))
        self.moved = [-columns for columns in fitting.columns(moved, point)]
        states = [linear.states for linear in ranking.linear]
        self.signals = [
            np.column_stack([d.over(x, drive) for d in self.regressors])
            for x, drive in zip(states, self.drives, strict=True)
        ]
        self.distance_drives = in_distance_domain(ranking, self._speeds())

    @property
    def followed(self) -> bool:
        """Whether the filter followed every drive to its end; its states are NaN from where it did not."""
        return all(np.isfinite(s).all() for s in self.signals)

    def _speeds(self) -> list[Floats]:
        """Return the speed by drive; zero if the model has none, so that no distance is driven."""
        for regressor in self.regressors:
            if regressor.name in _SPEED:
                return self.signal(regressor)
        return [np.zeros(len(s)) for s in self.signals]

    def turned(self, periodic: PeriodicDisturbance) -> tuple[list[DistanceDomainDrive], float, list[Waves]]:
        """Give each drive its phase of a disturbance.

        Returns:
            The drives with what it leaves of their innovations, the gain in log-likelihood, and the disturbance by
            drive.
        """
        distance_drives, total, disturbances = [], 0.0, []
        for distance_drive, input_direction in zip(
            self.distance_drives, self.ranking.input_directions(periodic.disturbance_input), strict=True
        ):
            waves = periodic.waves(distance_drive)
            shares, gain, explained = distance_drive.phase(input_direction, waves)
            distance_drives.append(replace(distance_drive, residual=distance_drive.residual - explained))
            disturbances.append(waves.of(shares))
            total += gain
        return distance_drives, total, disturbances

    def signal(self, regressor: Regressor) -> list[Floats]:
        """Return a signal by drive."""
        j = self.regressors.index(regressor)
        return [s[:, j] for s in self.signals]

    def responses(self, proposal: Dependence, basis: Basis) -> list[Floats]:
        """Return what the functions of a curve do to the innovations, by drive ``(samples * ny, FUNCTIONS)``."""
        return [
            linear.innovations.responses(input_direction, basis.of(s)).reshape(-1, FUNCTIONS)
            for linear, input_direction, s in zip(
                self.ranking.linear,
                self.ranking.input_directions(proposal.disturbance_input),
                self.signal(proposal.regressor),
                strict=True,
            )
        ]

    def sums(self, columns: Sequence[Sequence[Floats]]) -> list[_FoldSums]:
        """Return the sums by fold: a drive each, or halves of the only one."""
        by_fold = []
        for i, r in enumerate(distance_drive.residual.reshape(-1) for distance_drive in self.distance_drives):
            X = np.concatenate([self.moved[i], *(c[i] for c in columns)], axis=1)
            cuts = (0, len(r)) if len(self.distance_drives) > 1 else (0, len(r) // 2, len(r))
            for a, b in itertools.pairwise(cuts):
                by_fold.append(_FoldSums(X[a:b].T @ X[a:b], X[a:b].T @ r[a:b]))
        return by_fold


def find_unmodelled(
    fitting: Fitting, held_out: HeldOut, final: FittedHypothesis, before: Judgement, ranking: DisturbanceRanking
) -> UnmodelledDisturbance | None:
    """Return what no effect of the library explains; ``None`` if nothing improves the held-out drives.

    Where the filter itself leaves the model's range there are no innovations to explain, and nothing is sought.

    Args:
        fitting: The fitted drives.
        held_out: The held-out drives.
        final: Where the model was fitted.
        before: The model on the held-out drives.
        ranking: At ``final``.
    """
    augmented = fitting.augmented
    moved = [c for c in final.coordinates if c.kind == "parameter" and not c.drives]
    here = _Drives(ranking, fitting, final.point, moved)
    ranked_inputs = [s.disturbance_input for s in ranking.ranked_inputs if s.gain > _NEEDED][:_ENTRIES]
    there = DisturbanceRanking(held_out.fitting, before.point, ranking.disturbance_inputs, ranked=False)
    kept_aside = _Drives(there, held_out.fitting, before.point, moved)
    if not (here.followed and kept_aside.followed):
        return None
    turnings, disturbances, gain = _periodic(here, kept_aside, held_out.fitting.samples)
    pairs: list[Dependence] = []
    if ranked_inputs:
        residuals = [r.residual for r in here.distance_drives]
        pairs = proposals(ranking, ranked_inputs, here.regressors, here.signals, here.moved, residuals)[:_PAIRS]
    prior = np.array([min(c.prior, PRIORS.beside_curves) ** -2.0 if np.isfinite(c.prior) else 0.0 for c in moved])
    alone = _solved(here.sums([]), prior, 0, _STIFFNESS[0])[0]
    curves, weights = _selected(here, pairs, prior)
    columns = [kept_aside.responses(Dependence(c.disturbance_input, c.regressor, 0.0), c.basis) for c in curves]
    by_curves = sum(_gain(s, weights) for s in kept_aside.sums(columns)) if curves else 0.0

    def judged(curves: Sequence[Curve], weights: Floats, by_curves: float) -> UnmodelledDisturbance:
        """Return the periodic disturbances with these curves, simulated on the held-out drives."""
        point = _shifted(before.point, moved, weights[: len(moved)])

        runs = augmented.runs(held_out.drives, held_out.fitting.candidates([point]))
        starts = [found_start(augmented.model, d, r.state) for d, r in zip(held_out.drives, runs, strict=True)]

        def run(i: int) -> Floats:
            turned = [(t.disturbance_input, d[i]) for t, d in zip(turnings, disturbances, strict=True)]
            drive, values = held_out.drives[i], point.values[:, i]
            return _run(augmented, drive, values, starts[i], there, i, curves, turned)

        free = tuple(augmented.share(run, range(len(held_out.drives))))
        error, normalised_excess_mses = simulation_error(held_out.drives, free, held_out.floors(point))
        likelihood = before.log_likelihood + gain + by_curves
        judgement = Judgement(likelihood, error, normalised_excess_mses, (), point, wander=before.wander)
        shift = {c.name: point.value(c) for c in moved}
        return UnmodelledDisturbance(tuple(curves), shift, gain + by_curves, judgement, tuple(turnings))

    candidates = []
    if turnings:
        candidates.append(judged((), alone, 0.0))
    if by_curves > 0:
        candidates.append(judged(curves, weights, by_curves))
    # The gains of the filter were fitted with the periodic part as noise, and curves may explain them.
    return min(candidates, key=lambda u: u.judgement.normalised_excess_mse, default=None)


def _periodic(
    here: _Drives, there: _Drives, samples: int
) -> tuple[list[PeriodicDisturbance], list[list[Waves]], float]:
    """Take one periodic disturbance after the other, as long as the likelihood of the held-out drives rises.

    Returns:
        The disturbances; each over the held-out drives, by drive; and the gain there, less the penalty of the
        phases that were fitted to them.
    """
    periodic: list[PeriodicDisturbance] = []
    disturbances: list[list[Waves]] = []
    total = 0.0
    while len(periodic) < TURNS:
        best = find_periodic(here.ranking, there.ranking.disturbance_inputs, here.distance_drives, _NEEDED)
        if best is None:
            break
        distance_drives, gain, disturbance = there.turned(best)
        gain -= 0.5 * len(distance_drives) * np.log(samples)
        if gain <= 0:
            break
        here.distance_drives, there.distance_drives = here.turned(best)[0], distance_drives
        periodic.append(best)
        disturbances.append(disturbance)
        total += gain
    return periodic, disturbances, total


def _gain(sums: _FoldSums, weights: Floats) -> float:
    return float(sums.pull @ weights - 0.5 * weights @ sums.gram @ weights)


def _selected(here: _Drives, pairs: Sequence[Dependence], prior: Floats) -> tuple[list[Curve], Floats]:
    """Return curves by forward selection with cross-validation, and the weights of parameters and curves.

    Args:
        here: The fitted drives.
        pairs: What may be taken.
        prior: Inverse variance of the prior of each parameter that moves as well ``(parameters,)``.
    """
    tried = []
    for pair in pairs:
        basis = Basis.over(np.concatenate(here.signal(pair.regressor)))
        tried.append(_Term(pair, basis, here.responses(pair, basis)))
    chosen: list[_Term] = []
    predicted: list[float] = []
    stiffness = _STIFFNESS[0]
    reached = _left_out(here.sums([]), prior, 0, stiffness)
    while len(chosen) < TRIED:
        best: tuple[float, float, _Term] | None = None
        for term in tried:
            if any(term is c for c in chosen):
                continue
            terms = [*chosen, term]
            sums = here.sums([t.responses for t in terms])
            for tension in _STIFFNESS:
                value = _left_out(sums, prior, len(terms), tension)
                if (best is None or value > best[0]) and _possible(sums, prior, terms, tension):
                    best = (value, tension, term)
        if best is None or best[0] - reached < _NEEDED:
            break
        predicted.append(best[0] - reached)
        reached, stiffness = best[0], best[1]
        chosen.append(best[2])
    weights, covariance = _solved(here.sums([t.responses for t in chosen]), prior, len(chosen), stiffness)
    curves = []
    for j, (term, gain) in enumerate(zip(chosen, predicted, strict=True)):
        rows = _rows(prior, j)
        pair, own = term.proposal, (weights[rows], covariance[rows, rows])
        curves.append(Curve(pair.disturbance_input, pair.regressor, term.basis, *own, pair.stability, gain))
    return curves, weights


def _possible(sums: Sequence[_FoldSums], prior: Floats, terms: Sequence[_Term], tension: float) -> bool:
    """Whether no curve leaves the range that the library allows at its input; B-splines lie within their weights."""
    weights, _ = _solved(sums, prior, len(terms), tension)
    sizes = np.abs(weights[len(prior) :]).reshape(len(terms), FUNCTIONS).max(axis=1)
    return all(size <= term.proposal.disturbance_input.limit for size, term in zip(sizes, terms, strict=True))


def _left_out(sums: Sequence[_FoldSums], prior: Floats, curves: int, tension: float) -> float:
    """Return the gain of every fold, predicted from the others."""
    total = 0.0
    for i, left_out in enumerate(sums):
        weights, _ = _solved([s for j, s in enumerate(sums) if j != i], prior, curves, tension)
        total += _gain(left_out, weights)
    return total


def _solved(sums: Sequence[_FoldSums], prior: Floats, curves: int, tension: float) -> tuple[Floats, Floats]:
    """Return the penalised weights of parameters and curves, and their covariance."""
    gram, pull = sum(s.gram for s in sums), sum(s.pull for s in sums)
    information = np.array(gram, dtype=float)
    information[: len(prior), : len(prior)] += np.diag(prior)  # the fit has weighed the prior: a step starts from there
    for j in range(curves):
        rows = _rows(prior, j)
        mean = np.trace(information[rows, rows]) / FUNCTIONS
        information[rows, rows] += mean * (tension * Basis.roughness() + 1e-8 * np.eye(FUNCTIONS))
    covariance = covariance_of(information, singular=1e-10, dropped=True).matrix
    return covariance @ pull, covariance


def _rows(prior: Floats, curve: int) -> slice:
    """Return the rows of a curve's weights, behind those of the parameters."""
    return slice(len(prior) + curve * FUNCTIONS, len(prior) + (curve + 1) * FUNCTIONS)


def _shifted(point: ParameterPoint, moved: Sequence[Coordinate], steps: Floats) -> ParameterPoint:
    """Return a point with its parameters moved within their bounds."""
    values = point.values.copy()
    for c, step in zip(moved, steps, strict=True):
        values[c.rows[0]] = c.value(float(np.clip(c.coordinate(point.value(c)) + step, c.lower, c.upper)))
    return replace(point, values=values)


def _run(
    augmented: AugmentedModel,
    drive: DriveData,
    values: Floats,
    start: Start,
    ranking: DisturbanceRanking,
    number: int,
    curves: Sequence[Curve],
    turned: Sequence[tuple[DisturbanceInput, Waves]],
) -> Floats:
    """Simulate the model with the disturbances that its own motion makes; return its outputs ``(samples, ny)``.

    Periodic disturbances are given at every sample. How an input moves the next state is taken along the measured
    drive; it hardly depends on the motion.
    """
    spec = augmented.spec
    compiled = compile_model(augmented.model, spec.step, spec.integrator, spec.substeps, duals=False, jacobians=False)
    ahead, direct = ranking.linear[number].raw(
        [*(c.disturbance_input for c in curves), *(disturbance_input for disturbance_input, _ in turned)]
    )
    drive, held = augmented.read_ahead(drive, np.repeat(values[:, None], LANES, axis=1))
    nothing = np.zeros((len(drive.time), 0))
    now, during = (np.column_stack([nothing, *p]) for p in ([w.now for _, w in turned], [w.during for _, w in turned]))
    grids = [np.linspace(*c.basis.ends, 400) for c in curves]
    tables = [(c.regressor, grid, c.at(grid)) for c, grid in zip(curves, grids, strict=True)]
    constants = compiled.constants(held)
    x = np.repeat(start.state[:, None], LANES, axis=1)
    y, xn, w = np.empty((compiled.ny, LANES)), np.empty_like(x), np.empty((compiled.nw, LANES))
    limits = augmented.model.limits
    outputs = np.full((len(drive.time), compiled.ny), np.nan)
    slopes, renewed = rates(drive), np.array([c.regressor.renewed(spec.step) for c in curves])
    slow, quick = None, np.zeros(len(curves))
    for k in range(start.sample, len(drive.time)):
        if not np.all(np.abs(x[:, 0]) <= limits):
            break
        read = (x[:, 0][None], drive.inputs[k : k + 1], slopes[k : k + 1])
        signals = np.array([regressor.signal(*read)[0] for regressor, _, _ in tables])
        driven = np.where(renewed > 0, quick, signals)  # what is quick, of the sample before: see ``Regressor.over``
        slow = signals if slow is None else slow + renewed * (signals - slow)
        quick = signals - slow
        d = [float(np.interp(s, grid, table)) for s, (_, grid, table) in zip(driven, tables, strict=True)]
        compiled.kernels.output(x, np.repeat(drive.inputs[k][:, None], LANES, axis=1), constants, y)
        outputs[k] = y[:, 0] + direct[k] @ [*d, *now[k]]
        compiled.kernels.next_state(x, np.repeat(drive.between[k][:, None], LANES, axis=1), constants, xn, w)
        x, xn = xn + (ahead[k] @ [*d, *during[k]])[:, None], x
    return outputs
