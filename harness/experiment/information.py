"""Parameters to be determined: expected standard errors behind drives, and D-, A- or c-optimality.

The information on all coordinates of a fit is what it left, the inverse of its covariance, and the Fisher information
of the same likelihood along each planned drive (``Innovations.slopes``), in which noise is estimated too. Of the chosen
parameters counts what is left of it with all others open (Schur complement; Atkinson, Donev and Tobias 2007, ch. 10).
"""

from __future__ import annotations

import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from types import MappingProxyType
from typing import Any, Literal

import numpy as np

from harness.common.arrays import Floats
from harness.common.errors import UserError
from harness.common.files import read_text
from harness.common.registry import closest
from harness.config import ModelSpec
from harness.config.parameter_set import load_set
from harness.config.posterior import read_posterior
from harness.experiment.contract import Evidence, ExpectedOutcome
from harness.experiment.manoeuvres import LEAD_IN
from harness.experiment.rehearsal import Rehearsed
from harness.identification.coordinates import Coordinates
from harness.identification.innovations import Innovations
from harness.identification.measured_file import finely
from harness.identification.uncertainty import BARELY, CONFOUNDED, NORMAL, WELL, covariance_of, marginal
from harness.models.quantities import listed, print_unit, words
from harness.reporting.style import number

Criterion = Literal["D", "A", "c"]

_DRAWN = 7
"""Versions of the vehicle that are drawn from what the fit left open."""

_WIDEST = 0.3
"""Standard deviation of a logarithm, or share of the range, to which a parameter of which nothing is known is drawn."""


@dataclass(frozen=True)
class KeptFit:
    """A fit as a folder of ``harness identify`` holds it.

    Attributes:
        spec: The model with what was found.
        estimates: By name, of parameters and variances: value, standard error (infinite if unknown), verdict.
        correlation: Of them, in the order of their names ``(n, n)``.
        coloured: Outputs whose innovations are coloured.
    """

    spec: ModelSpec
    estimates: Mapping[str, tuple[float, float, str]]
    correlation: Floats
    coloured: tuple[str, ...] = ()

    def measured_by(self, sensors: str) -> KeptFit:
        """Return the same fit before drives with other sensors.

        Raises:
            UserError: If the noise of one is not known.
        """
        return replace(self, spec=fitted_spec(Path(self.spec.parameters), sensors))


def read_fit(folder: Path) -> KeptFit:
    """Return the fit of a folder.

    Raises:
        UserError: If there is none, it failed, or its method states no uncertainty.
    """
    if folder.is_file():
        raise UserError(f"{folder}: is a file; name the folder that harness identify, trace or run wrote")
    posterior = read_posterior(str(folder), Path(), "next-drive")  # which refuses what no fit writes
    content: dict[str, Any] = json.loads(read_text(posterior.file))
    if not (folder / "parameters.toml").is_file():
        raise UserError(f"{folder}: holds no parameters.toml; drives are planned for models of the library alone")
    if not content["correlation"]:
        raise UserError(
            f"{posterior.file}: the method '{content.get('method')}' states no uncertainty; fit by likelihood"
        )
    spec = fitted_spec(folder / "parameters.toml", ", ".join(content["drives"][0]["outputs"]))
    estimates = {
        e["name"]: (e["value"], math.inf if e["standard_error"] is None else e["standard_error"], e["verdict"])
        for e in content["estimates"]
    }
    return KeptFit(
        spec, estimates, np.array(content["correlation"], dtype=float), tuple(content.get("coloured_outputs", ()))
    )


def fitted_spec(file: Path, sensors: str) -> ModelSpec:
    """Return the model of a parameter file with sensors."""
    kept = load_set(str(file), Path(), "next-drive")
    table = {"vehicle": kept.vehicle, "parameters": str(file), "sensors": sensors}
    return finely(table if kept.tyre is None else {**table, "tyre": kept.tyre}, kept.noise_step, str(file))


def open_covariance(information: Floats, rows: Sequence[int]) -> Floats:
    """Return the covariance of some coordinates with all others open ``(rows, rows)``; infinite if nothing is known.

    Args:
        information: Fisher information, with that of the priors ``(n, n)``.
        rows: The coordinates.
    """
    inverse = covariance_of(marginal(information, rows))
    with np.errstate(over="ignore"):
        matrix = inverse.matrix.copy()
    matrix[np.diag_indices_from(matrix)] = inverse.errors**2
    return matrix


def log_error(covariance: Floats, criterion: Criterion, weights: Floats) -> float:
    """Return the logarithm of a criterion as a standard error; infinite where it has none.

    Args:
        covariance: Of the coordinates ``(n, n)``.
        criterion: ``D``: the geometric mean of the half-axes of the confidence ellipsoid; ``A``: the root of the mean
            variance; ``c``: the standard error of a combination.
        weights: Of the combination ``(n,)``.
    """
    if not np.isfinite(covariance).all():
        return math.inf
    if criterion == "D":
        sign, volume = np.linalg.slogdet(covariance)
        return float(volume) / (2 * len(covariance)) if sign > 0 else math.inf
    if criterion == "A":
        return 0.5 * math.log(float(np.trace(covariance)) / len(covariance))
    return 0.5 * math.log(max(float(weights @ covariance @ weights), 1e-300))


class EstimationGoal:
    """Standard errors of parameters.

    Args:
        fit: What the recordings so far say.
        wanted: Parameters that count, with their weights in the combination of ``c``; those that are not determined by
            default, and all if all are.
        criterion: ``D`` (volume of the confidence ellipsoid), ``A`` (sum of the variances), ``c`` (variance of a
            combination).
        jobs: Threads of one evaluation.
        seed: Of the versions drawn.

    Raises:
        UserError: If a parameter was not fitted or the criterion does not fit.
    """

    recorded = turns = 1
    shortest, lead_in = 0.0, LEAD_IN
    enough = -math.inf
    surrogate = None
    measure = "the relative standard error, of several parameters their mean as the criterion takes it"

    def __init__(
        self,
        fit: KeptFit,
        wanted: Mapping[str, float] = MappingProxyType({}),
        criterion: Criterion = "D",
        jobs: int = 1,
        seed: int = 0,
    ) -> None:
        self.fit, self.criterion = fit, criterion
        if criterion != "c" and any(weight != 1.0 for weight in wanted.values()):
            raise UserError(f"for: weights are those of criterion c; of {criterion} name the parameters alone")
        if wanted and not any(wanted.values()):
            raise UserError("for: every weight is zero; there is nothing to be determined")
        names = [n for n in fit.estimates if n in fit.spec.values]
        for name in wanted:
            if name not in names:
                raise UserError(f"for: '{name}' is no fitted parameter of the model{closest(name, names)}")
        held = [n for n in fit.estimates if fit.estimates[n][2] == _HELD]
        if lost := [n for n in wanted if n in held]:
            raise UserError(f"for: '{lost[0]}' ended at its bound, where it is held; fit it again from elsewhere")
        moved = [n for n in names if n not in held]
        unsettled = [n for n in moved if fit.estimates[n][2] != "determined"]
        self.wanted = dict(wanted) or dict.fromkeys(unsettled or moved, 1.0)
        if not self.wanted:
            raise UserError("for: every parameter of the fit ended at its bound; there is nothing to be determined")
        self.held = [n for n in held if n in names]
        variances = np.array([fit.spec.measurement_noise[o] for o in fit.spec.model().outputs])
        space = Coordinates.of(fit.spec, names, variances)
        kept = [c for c in space.coordinates if c.name in fit.estimates and c.name not in held]
        self.space = space.with_coordinates(kept)
        self.names = [c.name for c in kept]
        self.rows = [self.names.index(n) for n in self.wanted]
        self.weights = np.array([*self.wanted.values()])
        self.before = self._information()
        self.model = Innovations(fit.spec, jobs=jobs)
        self.versions = self._versions(seed)

    def _information(self) -> Floats:
        """Return what the fit says of the coordinates ``(n, n)``: nothing of those without an error."""
        order = list(self.fit.estimates)
        errors = np.array([
            self.fit.estimates[c.name][1] / (self.fit.estimates[c.name][0] if c.logarithmic else c.scale)
            for c in self.space.coordinates
        ])  # fmt: skip
        stated = np.flatnonzero(np.isfinite(errors) & (errors > 0))
        taken = [order.index(self.names[i]) for i in stated]
        covariance = self.fit.correlation[np.ix_(taken, taken)] * np.outer(errors[stated], errors[stated])
        information = np.zeros((len(errors), len(errors)))
        information[np.ix_(stated, stated)] = covariance_of(covariance).matrix
        return information

    def _versions(self, seed: int) -> tuple[Floats, ...]:
        """Return the parameters of the fit, and of vehicles drawn from what it leaves open."""
        space, covariance = self.space, covariance_of(self.before)
        reach = np.array([_WIDEST if c.logarithmic else _WIDEST * (c.upper - c.lower) for c in space.coordinates])
        spread = np.minimum(np.where(np.isfinite(covariance.errors), covariance.errors, np.inf), reach)
        root = np.linalg.cholesky(covariance.correlation + 1e-9 * np.eye(len(spread)))
        random, points = np.random.default_rng(seed), [space.centre]
        drawn = space.kind("parameter")
        for _ in range(50):
            z = space.centre + np.where(drawn, spread * (root @ random.standard_normal(len(spread))), 0.0)
            z = np.clip(z, space.lower, space.upper)
            if len(points) <= _DRAWN and space.possible(z):
                points.append(z)
        return tuple(space.candidates(z).values[:, 0] for z in points)

    def measured_by(self, sensors: str) -> EstimationGoal:
        """Return the same goal before drives with other sensors.

        Raises:
            UserError: If the noise of one is not known.
        """
        return EstimationGoal(self.fit.measured_by(sensors), self.wanted, self.criterion)

    def evidence(self, drive: Rehearsed) -> Evidence:
        """Return the Fisher information of a drive on all coordinates ``(n, n)``."""
        z = self.space.centre
        directions = self.space.directions(z)
        return (self.model.slopes(drive.data, self.space.candidates(z), directions).information,)

    def covariance(self, evidence: Evidence | None) -> Floats:
        """Return the covariance of the chosen coordinates ``(chosen, chosen)``; infinite where nothing is known."""
        return open_covariance(self.before + (0.0 if evidence is None else evidence[0]), self.rows)

    def value(self, evidence: Evidence | None) -> float:
        """Return the logarithm of the criterion as a standard error; infinite where it has none."""
        return log_error(self.covariance(evidence), self.criterion, self.weights)

    def preference(self, evidence: Evidence | None) -> float:
        """Return the value."""
        return self.value(evidence)

    def expectation(self, evidence: Evidence | None) -> ExpectedOutcome:
        """Return the standard errors to be expected."""
        before, after = (np.sqrt(np.diagonal(self.covariance(t))) for t in (None, evidence))
        rows, record, still, errors = [], {}, [], []
        for i, name in enumerate(self.wanted):
            c = self.space.coordinates[self.rows[i]]
            value = self.fit.spec.values[name]
            slope = abs(value) if c.logarithmic else c.scale
            pair = [float(slope * e) for e in (before[i], after[i])]
            record[name] = {"unit": c.unit, "value": value, "standard_error": {"before": pair[0], "after": pair[1]}}
            rows.append([words(name), f"{number(value)} {print_unit(c.unit)}".strip(), *map(_error, pair)])
            half = NORMAL * after[i]
            if not (half if c.logarithmic else half / (c.upper - c.lower) * 2.0 * BARELY) < WELL:
                size = _percent(half) if c.logarithmic else f"{_error(c.scale * half)} {print_unit(c.unit)}".strip()
                still.append(f"{words(name)}: 95 % interval {size} to either side")
            errors.append(f"{words(name)} to ±{_error(pair[1])} {print_unit(c.unit)}".strip())
        return ExpectedOutcome(
            words=listed(errors),
            open=(*still, *self._confounded(evidence), *self._cautions()),
            record={"parameters": record},
            header=["parameter", "estimate", "standard error now", "expected"],
            rows=rows,
        )

    def _confounded(self, evidence: Evidence | None) -> list[str]:
        correlation = covariance_of(self.before + (0.0 if evidence is None else evidence[0])).correlation
        return [
            f"{words(name)} and {words(self.names[j])}: their errors correlate by {correlation[i, j]:+.2f}"
            for i, name in zip(self.rows, self.wanted, strict=True)
            for j in range(len(self.names))
            if j != i and not (j in self.rows and j < i) and abs(correlation[i, j]) >= CONFOUNDED
        ]

    def _cautions(self) -> list[str]:
        held = [f"{words(n)}: it ended at its bound, and is held there" for n in self.held]
        if not self.fit.coloured:
            return held
        outputs = listed([words(n) for n in self.fit.coloured])
        return [
            *held,
            f"the innovations of {outputs} are coloured: the model lacks something, and errors will be larger",
        ]


_HELD = "at its bound"


def _error(value: float) -> str:
    return number(value) if math.isfinite(value) else "∞"


def _percent(half: float) -> str:
    return f"{100 * half:.2g} %" if math.isfinite(half) else "unbounded"
