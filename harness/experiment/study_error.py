"""Error of the estimators of a study as the goal of drives: L-optimality, with the weights from the study's own runs.

The squared error of each estimator and target is regressed on how far the parameters of each vehicle are from what is
believed (``harness.experiment.error_model``). Behind drives the estimators believe what these leave, and their error is
``a + tr(M C)`` with the covariance ``C`` of the parameters, ``(P^-1 + sum F)^-1``: ``P`` that of the design's vehicles,
``F`` the Fisher information of the drives with all noise open. Minimised is the trace, a linear criterion of the
covariance (Atkinson, Donev and Tobias 2007, ch. 10.5), and no parameter counts that no error hangs on.

A parameter that no estimator believes anything of, such as that of an effect, is open along the drives; its share of
the error stays whatever is known of it.
"""

from __future__ import annotations

import contextlib
import itertools
import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from harness.common.arrays import Floats, Mask
from harness.common.errors import UserError
from harness.common.files import parse_toml
from harness.common.registry import closest
from harness.config import DesignSpec, ModelSpec, StudySpec, resolve_single
from harness.config.derived import settled
from harness.config.factors import is_believed
from harness.config.posterior import read_posterior
from harness.config.specs import NOISE_SCALES
from harness.experiment.contract import Evidence, ExpectedOutcome
from harness.experiment.error_model import SquaredErrorModel, squared_error_model
from harness.experiment.information import open_covariance
from harness.experiment.manoeuvres import LEAD_IN
from harness.experiment.rehearsal import Rehearsed
from harness.identification.candidates import Candidates
from harness.identification.coordinates import Coordinates
from harness.identification.earlier_result import EarlierResult
from harness.identification.innovations import Innovations
from harness.identification.uncertainty import covariance_of
from harness.models.quantities import Quantity, listed, words
from harness.reporting.style import percent, with_unit
from harness.study.design import points
from harness.study.results import Design, read
from harness.study.stored import attributes_of, places_near, study_of

SCORES = "scores.zarr"

_STEP = 0.01
"""Difference of a factor, in standard deviations, over which the parameters that follow from it are derived."""

_VERSIONS = 7
"""Vehicles of the design that every drive is rehearsed with, in addition to its mean one."""

_AS_KNOWN = 0.01
"""Excess of the error over that of known parameters at which nothing is left to be driven for."""

_ROUGH = 0.5
"""Explained share of the squared errors' variance below which the expectation is rough."""

_MOST_LOST = 0.05
"""Share of the vehicles with a lost run from which the answer says that they are left out."""

_COUNTS = 0.1
"""Share of the expected squared error from which a parameter is named that stays open."""


@dataclass(frozen=True)
class EstimatorError:
    """Error of one estimator in one target.

    Attributes:
        estimator: Its name.
        target: What it estimates.
        weight: In the criterion.
        now: Root of the mean square error over the vehicles of the design, SI.
        model: Of its square, SI, over the deviations in standard deviations of the design.
        lost: Share of the vehicles of which a run was lost, or the estimator diverged.
    """

    estimator: str
    target: Quantity
    weight: float
    now: float
    model: SquaredErrorModel
    lost: float

    @property
    def name(self) -> str:
        """Estimator and target in words."""
        return f"{self.target.words} with {self.estimator}"


@dataclass(frozen=True)
class StudiedErrors:
    """A study whose vehicles differ in what is not known.

    Attributes:
        spec: The vehicle with the mean values of the design.
        design: Its design.
        others: Names of further populations of the study, which were not asked for.
        fit: Folder of the identification whose posterior the design is, if it is one.
        errors: Of estimators and targets that count.
        spread: Standard deviation of each factor, SI ``(n,)``.
        means: Of each factor, SI ``(n,)``.
        values: Of some vehicles of the design ``(vehicles, n)``.
        correlation: Of the factors ``(n, n)``.
        believed: Which of them the estimators believe a value of ``(n,)``.
    """

    spec: ModelSpec
    design: DesignSpec
    errors: tuple[EstimatorError, ...]
    spread: Floats
    means: Floats
    values: Floats
    correlation: Floats
    believed: Mask
    others: tuple[str, ...] = ()
    fit: Path | None = None

    @property
    def names(self) -> list[str]:
        """Names of the factors."""
        return [f.parameter for f in self.design.factors]


def read_study(folder: Path, wanted: Mapping[str, float]) -> StudiedErrors:
    """Return what a finished study says of its estimators' errors.

    Args:
        folder: Result folder.
        wanted: Weights of estimators and targets, all of one kind where none is named; and a design by its name, the
            first population where none is named.

    Raises:
        UserError: If there is no such design, its plant has no equations here, or something is wanted that it has not.
    """
    study, results = study_of(folder), read(folder)
    populations = _populations(study, folder)
    chosen = populations[next((name for name in wanted if name in populations), next(iter(populations)))]
    table = points(study, chosen).values[0]
    spread = table.std(axis=0)
    moved = [i for i in range(len(chosen.factors)) if spread[i] > 0]
    chosen_factors = tuple(chosen.factors[i] for i in moved)
    values, spread = table[:, moved], spread[moved]
    believed = np.array([f.of == "plant" and is_believed(f.parameter, study.belief) for f in chosen_factors])
    if not believed.any():
        raise UserError(
            f"{folder}: the estimators believe nothing of what design '{chosen.name}' varies, so that no drive lowers "
            "their errors"
        )
    means = values.mean(axis=0)
    centre = np.where(believed, [f.nominal for f in chosen_factors], means)
    stored = next(d for d in results.designs if d.name == chosen.name)
    errors = tuple(
        _errors(
            stored,
            (values - centre) / spread,
            _weights(stored, {n: w for n, w in wanted.items() if n != chosen.name}),
            folder,
        )
    )
    slim = replace(chosen, factors=chosen_factors)
    vehicles = np.linspace(0, len(values) - 1, _VERSIONS).round().astype(int)
    spec = _with(study.plant, slim, means)
    correlation = np.corrcoef(values.T).reshape(len(spread), len(spread))
    others = tuple(name for name in populations if name != chosen.name)
    fit = _fit_behind(folder, chosen)
    return StudiedErrors(spec, slim, errors, spread, means, values[vehicles], correlation, believed, others, fit)


def _fit_behind(folder: Path, design: DesignSpec) -> Path | None:
    """Return the folder of the identification whose estimates a design has; none of tolerances, samples and traces."""
    content = parse_toml(str(attributes_of(folder).get("study", "")), f"{folder}: the study")
    names = [d["posterior"] for d in content.get("design", ()) if d.get("name") == design.name and "posterior" in d]
    nominal = {f.parameter: f.nominal for f in design.factors}
    for name, place in itertools.product(names, places_near(folder)):
        with contextlib.suppress(UserError):
            posterior = read_posterior(name, place, str(folder))
            values = dict(zip(posterior.names, posterior.values, strict=True))
            same = nominal.keys() & values and all(values.get(n, v) == v for n, v in nominal.items())
            if posterior.file.name == EarlierResult.FILE and same:
                return posterior.file.parent
    return None


def _populations(study: StudySpec, folder: Path) -> dict[str, DesignSpec]:
    """Return the designs whose distributions say what is not known, by name."""
    if study.plant.external is not None:
        raise UserError(f"{folder}: drives are planned for models of the library; the plant is of somebody else")
    fit = {d.name: d for d in study.designs if d.sampling == "population" and d.factors}
    if not fit:
        raise UserError(
            f"{folder}: no design says what is not known of the vehicle; run a study with a design of sampling = "
            "'population', of a posterior or of distributions of its factors"
        )
    return fit


def _weights(design: Design, wanted: Mapping[str, float]) -> dict[tuple[int, int], float]:
    """Return the weight of each estimator and target that count, by their numbers."""
    targets = [q.name for q in design.targets]
    every = [*targets, *design.estimators]
    if unknown := [name for name in wanted if name not in every]:
        raise UserError(
            f"for: '{unknown[0]}' is no target, estimator or population of the study{closest(unknown[0], every)}: "
            f"{', '.join(every)}"
        )
    if any(not weight > 0 for weight in wanted.values()):
        raise UserError("for: a weight is above zero; leave out what does not count")
    sides = []
    for names in (design.estimators, targets):
        stated = [n for n in names if n in wanted]
        sides.append({names.index(n): wanted.get(n, 1.0) for n in stated or names})
    return {(e, t): u * v for e, u in sides[0].items() for t, v in sides[1].items()}


def _errors(
    design: Design, away: Floats, weights: Mapping[tuple[int, int], float], folder: Path
) -> list[EstimatorError]:
    """Return the errors that count, with the regression of each."""
    errors = []
    for (e, t), weight in weights.items():
        target = design.targets[t]
        runs = np.square(design.rmse[t, 0, e] / target.scale)  # (drive, sample, repeat), NaN of a lost run
        squares = runs.mean(axis=(0, 2))
        finished = np.isfinite(squares)
        if not np.isfinite(runs).any():
            continue
        where = f"{folder}: {target.words} with {design.estimators[e]}"
        model = squared_error_model(away[finished], squares[finished], where)
        now, lost = math.sqrt(squares[finished].mean()), 1.0 - float(finished.mean())
        errors.append(EstimatorError(design.estimators[e], target, weight, now, model, lost))
    if not errors:
        raise UserError(f"{folder}: no run of design '{design.name}' has an error that counts")
    return errors


def _with(plant: ModelSpec, design: DesignSpec, values: Floats) -> ModelSpec:
    """Return the plant with some values of the factors ``(n,)``."""
    varied = {
        f.parameter: float(v)
        for f, v in zip(design.factors, values, strict=True)
        if f.of != "belief" and f.parameter not in NOISE_SCALES
    }
    changed = {name: float(v) for name, v in settled(plant, varied).items()}
    return replace(plant, values={**plant.values, **changed})


class StudyGoal:
    """Errors of the estimators of a study.

    Args:
        studied: What the study says.
        jobs: Threads of one evaluation.
    """

    criterion = "L"
    recorded = turns = 1
    shortest, lead_in = 0.0, LEAD_IN
    surrogate = None
    measure = "the expected error over that of now, of several the root of the mean square"

    def __init__(self, studied: StudiedErrors, jobs: int = 1) -> None:
        self.studied = studied
        self.model = Innovations(studied.spec, jobs=jobs)
        self.names = studied.names
        spec, count = studied.spec, len(self.names)
        noise = Coordinates.of(spec, (), np.array([spec.measurement_noise[o] for o in spec.model().outputs]))
        self._directions = self._along(noise)
        self._point = Candidates.of(spec)
        self.before = np.diag(np.concatenate([np.zeros(count), noise.weight]))
        self.before[:count, :count] = covariance_of(studied.correlation).matrix
        self._weights = np.array([e.weight for e in studied.errors])
        self._now = np.array([e.now**2 for e in studied.errors])
        self.enough = self._log_ratio(self.known()) + math.log1p(_AS_KNOWN)

    @property
    def versions(self) -> tuple[Floats, ...]:
        """The mean vehicle of the design, and some of its vehicles."""
        vehicles = (_with(self.studied.spec, self.studied.design, values) for values in self.studied.values)
        return tuple(Candidates.of(spec).values[:, 0] for spec in (self.studied.spec, *vehicles))

    def measured_by(self, sensors: str) -> StudyGoal:
        """Return the same goal before drives with other sensors.

        Raises:
            UserError: If the noise of one is not known.
        """
        spec = self.studied.spec
        table = {"vehicle": spec.vehicle, "tyre": spec.tyre, "effects": list(spec.effects), "sensors": sensors,
                 "values": spec.values, "step": spec.step, "integrator": spec.integrator, "substeps": spec.substeps,
                 "noise": {"process": spec.process_noise, "measurement": spec.measurement_noise}}  # fmt: skip
        kept = {key: value for key, value in table.items() if value is not None}
        return StudyGoal(replace(self.studied, spec=resolve_single(kept, f"sensors {sensors}")))

    def _along(self, noise: Coordinates) -> Candidates:
        """Return what is held moves along each factor, per standard deviation, and along the noise."""
        studied = self.studied
        columns = []
        for i, factor in enumerate(studied.design.factors):
            ends = []
            for sign in (1.0, -1.0):
                moved = studied.means.copy()
                if factor.of == "plant":
                    moved[i] += sign * _STEP * studied.spread[i]
                ends.append(Candidates.of(_with(studied.spec, studied.design, moved)).values[:, 0])
            columns.append((ends[0] - ends[1]) / (2.0 * _STEP))
        of_noise = noise.directions(noise.centre)
        parts = (np.array(columns).T, of_noise.values), (0.0, of_noise.process), (0.0, of_noise.measurement)
        return Candidates(*(np.hstack([np.broadcast_to(a, (len(b), len(columns))), b]) for a, b in parts))

    def evidence(self, drive: Rehearsed) -> Evidence:
        """Return the Fisher information of a drive on the factors and the noise ``(n, n)``."""
        return (self.model.slopes(drive.data, self._point, self._directions).information,)

    def covariance(self, evidence: Evidence | None) -> Floats:
        """Return that of factors about what estimators then believe, in standard deviations of now ``(n, n)``."""
        information = self.before + (0.0 if evidence is None else evidence[0])
        return self._of_belief(open_covariance(information, range(len(self.names))))

    def known(self) -> Floats:
        """Return the covariance where estimators know all that they can believe ``(n, n)``."""
        return self._of_belief(np.zeros_like(self.studied.correlation))

    def _of_belief(self, covariance: Floats) -> Floats:
        """Return a covariance in which what no estimator believes scatters as before."""
        free = ~self.studied.believed
        held = covariance.copy()
        held[np.ix_(free, free)] = self.studied.correlation[np.ix_(free, free)]
        return held

    def _expected(self, covariance: Floats) -> Floats:
        """Return the mean square error of each ``(errors,)``, SI, no larger than now."""
        squares = [e.model.expected(covariance) for e in self.studied.errors]
        return np.minimum(squares, self._now)

    def _log_ratio(self, covariance: Floats) -> float:
        ratio = float(self._weights @ (self._expected(covariance) / self._now)) / float(self._weights.sum())
        return 0.5 * math.log(max(ratio, 1e-300))

    def value(self, evidence: Evidence | None) -> float:
        """Return the logarithm of the expected error over that of now."""
        return 0.0 if evidence is None else self._log_ratio(self.covariance(evidence))

    def preference(self, evidence: Evidence | None) -> float:
        """Return the value."""
        return self.value(evidence)

    def expectation(self, evidence: Evidence | None) -> ExpectedOutcome:
        """Return the errors to be expected, once the estimators believe what the drives leave."""
        studied, covariance = self.studied, self.covariance(evidence)
        after = np.sqrt(self._now if evidence is None else self._expected(covariance))
        known = np.sqrt(self._expected(self.known()))
        rows, record = [], []
        alike: dict[tuple[str, str, str], list[str]] = {}
        for e, then, least in zip(studied.errors, after, known, strict=True):
            shown = [with_unit(e.target.scale * v, e.target.unit) for v in (e.now, then, least)]
            rows.append([e.name, *shown])
            alike.setdefault((e.target.words, shown[1], shown[0]), []).append(e.estimator)
            record.append(
                {
                    "estimator": e.estimator,
                    "target": e.target.name,
                    "weight": e.weight,
                    "explained": e.model.explained,
                    "rmse": {"before": e.now, "after": float(then), "known": float(least)},
                    "square": self._square(e.model),
                }
            )
        said = [
            f"{target} off by {then} (RMSE, {listed(names)}) in place of {now}"
            for (target, then, now), names in alike.items()
        ]
        deviations = np.sqrt(np.diagonal(open_covariance(
            self.before + (0.0 if evidence is None else evidence[0]), range(len(self.names)))))  # fmt: skip
        parameters = {
            f.parameter: {"unit": f.unit, "value": float(mean), "standard_error": {
                "before": float(spread), "after": float(spread * share)}}
            for f, mean, spread, share in zip(
                studied.design.factors, studied.means, studied.spread, deviations, strict=True)
        }  # fmt: skip
        return ExpectedOutcome(
            words=f"over the vehicles of design '{studied.design.name}' {listed(said)}",
            open=(*self._open(covariance), *self._cautions()),
            record={
                "design": studied.design.name,
                "fit": None if studied.fit is None else str(studied.fit),
                "errors": record,
                "parameters": parameters,
            },
            header=["error (RMSE)", "now", "expected", "with known parameters"],
            rows=rows,
        )

    def _square(self, model: SquaredErrorModel) -> dict[str, Any]:
        """Return a mean square error, SI, over the covariance of what estimators believe, in deviations of now."""
        free = ~self.studied.believed
        fixed = model.curvature * np.outer(free, free)
        floor = model.floor + float(np.sum(fixed * self.studied.correlation))
        return {"floor": floor, "curvature": (model.curvature - fixed).tolist()}

    def _open(self, covariance: Floats) -> list[str]:
        """Return which parameters the expected errors still hang on."""
        ratios = self._weights / self._now
        shares = sum(r * np.sum(e.model.curvature * covariance, axis=1) for r, e in zip(
            ratios, self.studied.errors, strict=True)) / float(ratios @ self._expected(covariance))  # fmt: skip
        why = np.where(self.studied.believed, "", ", whatever is driven")
        return [
            f"{words(name)}: {percent(float(share))} of the expected mean square error{reason}"
            for name, share, reason in zip(self.names, np.asarray(shares), why, strict=True)
            if share >= _COUNTS
        ]

    def _cautions(self) -> list[str]:
        rough = [
            f"{e.name}: the parameters explain {percent(e.model.explained)} of the variance of the vehicles' squared "
            "errors, so that its expectation is rough"
            for e in self.studied.errors
            if e.model.explained < _ROUGH
        ]
        lost = [
            f"{e.name}: {percent(e.lost)} of the vehicles are left out, as a run was lost or the estimator diverged"
            for e in self.studied.errors
            if e.lost >= _MOST_LOST
        ]
        others = listed([f"'{name}'" for name in self.studied.others])
        unasked = f"the errors over {others}, which another plan is for: name that design (--for)"
        return [*rough, *lost, *([unasked] if others else [])]
