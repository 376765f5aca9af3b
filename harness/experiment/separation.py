"""Models to be told apart: T-optimality over the confusable set of a trace, and the posterior to be expected.

If one model is right, a rival's filter errs over a planned drive by the whitened innovations that it would have on what
the right one leaves without noise. What the rival's own parameters can take up, as far as the drives so far leave them
open, is taken off by Gauss-Newton steps (their tangent space). The rest, squared and summed, is ``d^2``: the log
likelihood ratio is normal about ``d^2 / 2`` with variance ``d^2`` (Atkinson and Fedorov 1975, for the least squares).
The probability of a wrong choice is bounded by ``sum sqrt(p_i p_j) exp(-d_ij^2 / 8)`` (Bhattacharyya).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import replace

import numpy as np

from harness.common.arrays import Floats
from harness.common.errors import UserError
from harness.diagnosis.criteria import BLOCK, CALM
from harness.diagnosis.model.augmented_model import AugmentedModel, HeldParameters
from harness.diagnosis.result.expectation import STANDS
from harness.experiment.contract import Evidence, ExpectedOutcome
from harness.experiment.open_trace import OpenTrace, RivalModel
from harness.experiment.rehearsal import Rehearsed
from harness.experiment.rival_filter import LinearisedFilter, OverADrive, Parabolas, RivalFilter, over_a_drive
from harness.identification.candidates import Candidates
from harness.identification.coordinates import Coordinate, parameter_coordinate
from harness.identification.data import DriveData
from harness.identification.measured_file import SHORTEST
from harness.identification.uncertainty import covariance_of
from harness.models.assembly.candidates import assembled, placements
from harness.models.assembly.placement import load_effect, parameter_at, split
from harness.reporting.style import number, probability

_APART = 4.0
"""``d^2`` below which two models stay confusable: their likelihoods differ by a factor of seven in the mean."""

_LIVELY = 1.2
"""Factor on the lateral acceleration below which a trace refuses a recording, for what the vehicle does less."""

_DRAWS = 2000
_SCALE = 0.1
"""Coordinate of a parameter that may be negative: its value over this share of its bounds, as in a trace."""


class SeparationGoal:
    """The confusable set of a trace, to be told apart.

    Args:
        trace: What it left.
        jobs: Threads of one evaluation.
        also: Parameters of the library that the model has besides those of the set, where it has their signals.
    """

    criterion = "T"
    turns = 2
    shortest, lead_in = SHORTEST, BLOCK
    enough = math.log(1e-3)
    measure = "a bound on the probability that a wrong model of the set is named"

    def __init__(self, trace: OpenTrace, jobs: int = 1, also: Iterable[str] = ()) -> None:
        self.trace, spec, rivals = trace, trace.spec, trace.rivals
        self.rivals, self.drives, self.none, self.recorded = rivals, trace.drives, trace.none, len(rivals)
        moved = {*also, *(name for r in rivals for name in r.values)}
        available = {*spec.model().inputs, *spec.model().outputs}
        self.model = _augmented(trace, available, jobs, moved)
        self.refuse_lacking(name for r in rivals for name in r.values)
        self.shares = np.array([r.share for r in rivals]) / sum(r.share for r in rivals)
        self._coordinates = [[self._coordinate(name, value) for name, value in r.values.items()] for r in rivals]
        self._precisions = [self._precision(*pair) for pair in zip(rivals, self._coordinates, strict=True)]
        self.filters = tuple(self._filter(*pair) for pair in zip(rivals, self._coordinates, strict=True))
        self.versions = tuple(f.values for f in self.filters)
        m = range(len(self.rivals))
        self._emulations = np.array([[self._emulation(i, j) for j in m] for i in m])

    def measured_by(self, sensors: str) -> SeparationGoal:
        """Return the same goal before drives with other sensors; what the drives so far say stays.

        Raises:
            UserError: If the noise of one is not known, or a model of the set is one of a sensor that is not there.
        """
        return SeparationGoal(self.trace.measured_by(sensors))

    def refuse_lacking(self, names: Iterable[str]) -> None:
        """Refuse parameters that the model has not.

        Raises:
            UserError: If there is one, with its name.
        """
        if lost := sorted(set(names) - set(self.model.names)):
            raise UserError(
                f"without the signals that were recorded the model of the trace has no parameter '{lost[0]}'"
            )

    def _filter(self, rival: RivalModel, coordinates: Sequence[Coordinate]) -> RivalFilter:
        """Return the filter of a model at each level of its noise, with what the drives so far say there."""
        spec, slopes = self.model.spec, np.array([c.slope(c.centre) for c in coordinates])
        stated = Candidates.of(replace(spec, measurement_noise={**spec.measurement_noise, **rival.measurement_noise}))
        values = self._values(rival)[:, None]
        own = dict(zip(self.model.nominal.states, stated.process[:, 0], strict=True))  # of random processes it stays
        points = [
            replace(stated, values=values, process=np.array([[level.get(s, v)] for s, v in own.items()]))
            for level in self.drives.levels
        ]
        so_far = Parabolas(
            -2.0 * np.array([parts.log_posterior for parts in rival.at_levels]),
            np.array([-parts.gradient * slopes for parts in rival.at_levels]),
            np.array([parts.information * np.outer(slopes, slopes) for parts in rival.at_levels]),
        )
        return RivalFilter(tuple(points), tuple(coordinates), so_far)

    def _values(self, rival: RivalModel) -> Floats:
        """Return all parameters of a model; what happened in a drive has happened before the next one."""
        values = self.model.stated()
        for name, value in rival.values.items():
            values[self.model.row(name)] = value
        for p in self.model.model.parameters:
            if p.per_drive:
                values[self.model.row(p.name)] = p.lower
        return values

    def _precision(self, rival: RivalModel, coordinates: Sequence[Coordinate]) -> Floats:
        """Return what the drives so far say of a model's coordinates ``(n, n)``."""
        errors = rival.errors / np.array([c.slope(c.centre) for c in coordinates])
        known = np.flatnonzero(np.isfinite(errors) & (errors > 0))
        precision = np.zeros((len(errors), len(errors)))
        covariance = rival.correlation[np.ix_(known, known)] * np.outer(errors[known], errors[known])
        precision[np.ix_(known, known)] = covariance_of(covariance).matrix
        return precision

    def range_of(self, name: str) -> float:
        """Return the share of its bounds in which a parameter is sought at first."""
        p = self.model.model.parameters[self.model.row(name)]
        return _SCALE * max(abs(p.lower), abs(p.upper))

    def _coordinate(self, name: str, value: float) -> Coordinate:
        row = self.model.row(name)
        return parameter_coordinate(self.model.model.parameters[row], row, value, scale=self.range_of(name))

    def _emulation(self, i: int, j: int) -> float:
        """Return what the drives so far hold against a model with the values of another; infinite if it cannot."""
        coordinates = self._coordinates[j]
        rows = [c.rows[0] for c in coordinates]
        if np.any(np.delete(self.versions[i] - self.versions[j], rows)):
            return math.inf
        targets = (max(self.versions[i][row], math.exp(c.lower) if c.logarithmic else -math.inf)
                   for row, c in zip(rows, coordinates, strict=True))  # fmt: skip
        moved = np.array([c.coordinate(v) - c.centre for v, c in zip(targets, coordinates, strict=True)])
        return float(moved @ self._precisions[j] @ moved)

    def evidence(self, drive: Rehearsed) -> Evidence:
        """Return, of each model over what each leaves, the parabolas of its squared innovations, and the seconds.

        Shapes ``(2, m, m, levels)``, ``(2, m, m, levels, n)``, ``(2, m, m, levels, n, n)`` and ``(2,)``: of the whole
        drive, and of what counts where it judges; the right model first. A trace refuses a calm drive, which so tells
        nothing.
        """

        def over(data: DriveData, rivals: Sequence[int]) -> list[OverADrive]:
            return [self.filters[j].over(self.model, data, BLOCK) for j in rivals]

        return self._evidence(drive, over, len(self.filters[0].points))

    def surrogate(self, drive: Rehearsed) -> Evidence:
        """Return about the same, of one level, by one linearisation of each rival for what all the others leave."""
        linearised: dict[int, LinearisedFilter] = {}

        def over(data: DriveData, rivals: Sequence[int]) -> list[OverADrive]:
            if not rivals:
                return []
            filters = {j: self.filters[j] for j in rivals}
            runs = self.model.runs_of(data, Candidates.together([f.point(f.cheapest) for f in filters.values()]))
            for (j, rival), run in zip(filters.items(), runs, strict=True):
                linearised[j] = rival.as_fitted(self.model, data, run, linearised.get(j))
            return [over_a_drive([linearised[j]], linearised[j], data, BLOCK) for j in rivals]

        return self._evidence(drive, over, 1)

    def _evidence(
        self, drive: Rehearsed, over: Callable[[DriveData, Sequence[int]], list[OverADrive]], levels: int
    ) -> Evidence:
        m, n = len(self.rivals), max(len(f.coordinates) for f in self.filters)
        shape = 2, m, m, levels
        squares, slopes, information = np.zeros(shape), np.zeros((*shape, n)), np.zeros((*shape, n, n))
        calm = any(map(self.is_calm, drive.data))
        for i, data in enumerate(() if calm else drive.data):
            recorded = self.drives.as_recorded(data, self.model.model.outputs)
            others = [j for j in range(m) if j != i]
            for j, (*both, own) in zip(others, over(recorded, others), strict=True):
                k = len(self.filters[j].coordinates)
                for part, parts in enumerate(both):
                    squares[part, i, j] = parts.squares
                    slopes[part, i, j, :, :k] = parts.slope
                    information[part, i, j, :, :k, :k] = parts.information
                # of what a model leaves itself nothing is left, and it says as much of its parameters as fitted
                information[:, j, j, :, :k, :k] = own[:, None]
        seconds = np.zeros(2) if calm else np.array([drive.seconds, drive.seconds - BLOCK])
        return squares, slopes, information, seconds

    def is_calm(self, data: DriveData) -> bool:
        """Whether a trace refuses a recording, or one of a vehicle that turns a little less."""
        rates = [i for i, name in enumerate(self.model.nominal.outputs) if name.startswith("yaw_rate")]
        speed = data.inputs[:, self.model.model.inputs.index("speed")]
        turning = np.abs(data.measurements[:, rates[:1]] * speed[:, None])
        return bool(rates) and float(np.quantile(turning, 0.95)) < _LIVELY * CALM

    def distances(self, evidence: Evidence | None) -> tuple[Floats, Floats]:
        """Return ``d^2`` of each right model against each rival, and what the rival's width costs it ``(m, m)``.

        Half of the drives judge; with the others, and those so far, the rival is fitted. The latter is the logarithm by
        which the parameters are known better behind the drives (Laplace).
        """
        m = len(self.rivals)
        distance, width = np.zeros((m, m)), np.zeros((m, m))
        if evidence is None:
            return distance, width
        squares, slopes, information, seconds = (0.5 * part for part in evidence[:4])
        for i, right in enumerate(self.filters):
            noise = np.outer(seconds / self.drives.fitted, right.cost)
            for j, rival in enumerate(self.filters):
                n, levels = len(rival.coordinates), len(rival.points)
                fitted, judged = (
                    Parabolas(
                        squares[part, i, j] + noise[part],
                        np.broadcast_to(slopes[part, i, j, :, :n], (levels, n)),
                        np.broadcast_to(information[part, i, j, :, :n, :n], (levels, n, n)),
                    )
                    for part in (0, 1)
                )
                level, z = (rival.so_far + fitted).best(rival.floors)
                before = rival.so_far.at(level, z) - float(rival.floors.min())
                distance[i, j] = judged.at(level, z) + self.drives.held_out / self.drives.fitted * before
                width[i, j] = 0.5 * _growth(fitted.information[level], rival.so_far.information[level])
        distance = np.maximum(distance - np.diagonal(distance)[:, None], 0.0)
        return np.minimum(distance, self._emulations), width

    def value(self, evidence: Evidence | None) -> float:
        """Return the logarithm of the bound on the probability of a wrong name."""
        distance, _ = self.distances(evidence)
        both = 0.5 * (distance + distance.T)
        pairs = np.triu_indices(len(both), 1)
        weights = np.sqrt(np.outer(self.shares, self.shares))[pairs]
        return float(np.log(np.sum(weights * np.exp(-both[pairs] / 8.0)) + 1e-300))

    def preference(self, evidence: Evidence | None) -> float:
        """Return the value."""
        return self.value(evidence)

    def posterior(self, evidence: Evidence | None) -> tuple[Floats, Floats]:
        """Return, by right model, its expected probability, and the probability that it stands ``(m,)``."""
        distance, width = self.distances(evidence)
        random = np.random.default_rng(0).standard_normal((_DRAWS, len(self.rivals)))
        expected, stands = np.zeros(len(self.rivals)), np.zeros(len(self.rivals))
        for i in range(len(self.rivals)):
            ratio = 0.5 * distance[i] + np.sqrt(distance[i]) * random + (width[i] - width[i, i])
            ratio[:, i] = 0.0
            odds = self.shares * np.exp(-np.clip(ratio, -500.0, 500.0))
            own = odds[:, i] / odds.sum(axis=1)
            expected[i], stands[i] = own.mean(), np.mean(own >= STANDS)
        return expected, stands

    def expectation(self, evidence: Evidence | None) -> ExpectedOutcome:
        """Return the posterior to be expected."""
        distance, _ = self.distances(evidence)
        expected, stands = self.posterior(evidence)
        rows = [
            [r.name, probability(share), probability(e), probability(s), number(float(_least(d, i)))]
            for i, (r, share, e, s, d) in enumerate(
                zip(self.rivals, self.shares, expected, stands, distance, strict=True)
            )
        ]
        standing = float(self.shares @ stands)
        names = [r.name for r in self.rivals]
        still = [
            f"{names[i]} and {names[j]} stay confusable: their log likelihood ratio is expected to be "
            f"{number(0.5 * max(distance[i, j], distance[j, i]))}"
            for i in range(len(names))
            for j in range(i)
            if max(distance[i, j], distance[j, i]) < _APART
        ]
        if self.none >= 1.0 - STANDS:
            still.append(f"with probability {probability(self.none)} none of these is right, and no drive settles that")
        models = {
            r.name: {
                "added": list(r.added),
                "share": float(p),
                "expected": float(e),
                "stands": float(s),
                "d2": d.tolist(),
            }
            for r, p, e, s, d in zip(self.rivals, self.shares, expected, stands, distance, strict=True)
        }
        return ExpectedOutcome(
            words=f"one name stands with {STANDS:.0%} in {probability(standing)} of the cases, if {' or '.join(names)} "
            "is right",
            open=tuple(still),
            record={"models": models, "stands": standing},
            header=["if this is right", "probability now", "expected", "it stands", "least d²"],
            rows=rows,
        )


def _growth(information: Floats, precision: Floats) -> float:
    """Return by how much the logarithm of the information grows; directions of which nothing was known count not."""
    known = np.flatnonzero(np.diagonal(precision) > 0.0)
    before, more = precision[np.ix_(known, known)], information[np.ix_(known, known)]
    return float(np.linalg.slogdet(np.eye(len(known)) + covariance_of(before).matrix @ more)[1])


def _least(distance: Floats, own: int) -> float:
    return float(np.delete(distance, own).min())


def _augmented(trace: OpenTrace, available: set[str], jobs: int, moved: set[str]) -> AugmentedModel:
    """Return the filter of a trace, with all that its models move.

    Effects that a baseline has given the nominal model are among these, as in the trace, so that another one of the
    same kind can come, as the bias of a second sensor. Of others the filter corrects the states, as it states levels of
    these; gains are those without effects that have none.

    Raises:
        UserError: If it cannot hold a value of the nominal model.
    """
    spec = trace.spec
    parts, corrected = (spec.vehicle, spec.tyre), set(trace.drives.levels[0])
    names, bare = placements(*parts, spec.sensors), assembled(*parts, (), spec.sensors)
    files = {split(name)[0] for name in names}
    own = [
        e for e in spec.effects
        if split(e)[0] not in files or corrected & {*assembled(*parts, (e,), spec.sensors).states} - {*bare.states}
    ]  # fmt: skip
    plain = replace(spec, effects=tuple(own))
    model = plain.model()
    plain = replace(
        plain,
        values={n: spec.values[n] for n in model.parameter_names},
        process_noise={s: spec.process_noise[s] for s in model.states},
    )
    needed = {split(e)[0] for e in spec.effects} | {
        split(name)[0]
        for name in names
        for p in load_effect(name).PARAMETERS
        if parameter_at(p, split(name)[1] or "").name in moved
    }
    augmented = AugmentedModel(plain, available, jobs, frozenset(files - needed))
    if lacking := [name for name in spec.values if name not in augmented.names]:
        raise UserError(f"{spec.parameters}: drives cannot be planned with '{lacking[0]}'; trace without its effect")
    values = augmented.stated()
    for name, value in spec.values.items():
        values[augmented.row(name)] = value
    return augmented.restated(plain, values, HeldParameters())
