"""Model of a vehicle as earlier drives showed it: the nominal model of a search for what has changed since.

Nothing of the earlier drives has to be named, only predicted. So all stated parameters move within their priors, the
random processes of vehicle, road and gyroscopes are there, and an effect is added as soon as the drives show it: by
evidence that is strong and no more, and a higher likelihood of the last of them, which is not fitted until then; and
then by evidence of all of them. This is the nominal model of the later drives. Its parameters move there as far as the
earlier drives leave them open, by their joint covariance (Laplace's approximation), and a hypothesis takes its own
parameters out of that prior: a change.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from harness.common.arrays import Floats
from harness.diagnosis.fitting import FittedHypothesis, Fitting, KeptFits
from harness.diagnosis.model.augmented_model import AugmentedModel, HeldParameters
from harness.diagnosis.model.hypotheses import OF_ROADS, Hypothesis, coordinates, random_processes
from harness.diagnosis.selection.candidate_fits import Added, CandidateFits, Say
from harness.diagnosis.selection.discrepancy import likeliest_memory
from harness.diagnosis.selection.forward_selection import first_variances
from harness.diagnosis.selection.growth import all_parameters, grown
from harness.diagnosis.selection.validation import HeldOut, Judgement
from harness.identification.data import DriveData
from harness.identification.uncertainty import covariance_of


@dataclass(frozen=True)
class Baseline:
    """A vehicle as earlier drives showed it.

    Attributes:
        added: What it has beyond the nominal model.
        fitting: All of the drives.
        fitted: The fit to them.
        judged: On the last of them, which was not fitted.
        augmented: The augmented model about the fit to all of them.
        names: Of the drives.
    """

    added: Added
    fitting: Fitting
    fitted: FittedHypothesis
    judged: Judgement
    augmented: AugmentedModel
    names: tuple[str, ...]

    def error_of(self, name: str) -> float:
        """Return the standard error of a parameter, in its unit; zero of what was not fitted."""
        held = self.augmented.held
        rows = [i for i, n in enumerate(held.names) if n == name]
        return float(np.sqrt(held.covariance[rows[0], rows[0]])) if rows else 0.0

    def scatter_of(self, h: Hypothesis, name: str, values: Floats) -> float:
        """Return by how much a parameter seems to change between drives in which it does not, in its unit.

        Every drive is asked alone, one step of a fit from that to all, with everything else as open as all drives
        leave it. What the standard errors do not explain is of the day: a road, a bias, tyres that were warmer.

        Args:
            h: Of which it is an amplitude.
            name: Of the parameter.
            values: Parameters of the later drives, for the shapes ``(np,)``.
        """
        augmented, point = self.fitting.augmented, self.fitted.point
        (own,) = (c for c in coordinates(augmented, (), (h,), len(self.names)) if c.name == name)
        at = point.values.copy()
        rows = [augmented.row(n) for n in h.shapes if n not in self.augmented.held.names]
        at[rows] = values[rows, None]
        others = [c for c in self.fitted.coordinates if c.kind == "parameter" and c.name != name]
        asked = replace(point, values=at)
        columns = self.fitting.columns([*others, own], asked)
        every = np.sum([X.T @ X for X in columns], axis=0)
        total = every[:-1, :-1] + np.diag([c.prior**-2 for c in others])
        changes = []
        for X, run in zip(columns, self.fitting.runs(point), strict=True):
            information = X.T @ X
            information[:-1, :-1] += total - X[:, :-1].T @ X[:, :-1]  # what the other drives say of the rest
            covariance = covariance_of(information).matrix
            step = -(covariance @ (X.T @ np.nan_to_num(run.whitened).reshape(-1)))[-1]
            changes.append(step**2 - covariance[-1, -1])
        excess = max(0.0, float(np.mean(changes)) * len(changes) / max(1, len(changes) - 1))
        here = float(asked.values[own.rows[0], 0])
        return math.sqrt(excess) * abs(own.slope(own.coordinate(here)))


def of_roads(augmented: AugmentedModel) -> tuple[str, ...]:
    """Return the parameters that are of the road, whatever becomes of the vehicle."""
    return tuple(n for n in OF_ROADS if n in augmented.names)


def learnt(
    augmented: AugmentedModel,
    drives: Sequence[DriveData],
    free: Sequence[str],
    stated_noise: bool,
    say: Say,
    kept: KeptFits,
) -> Baseline:
    """Return a vehicle as drives showed it.

    Args:
        augmented: The nominal model with everything it may lack.
        drives: Two or more.
        free: Parameters of the nominal model that are fitted in any case.
        stated_noise: As in ``trace``.
        say: Receives what is being done, in words.
        kept: Fits of an interrupted trace.
    """
    variances = first_variances(augmented, drives, stated_noise)
    moved = tuple(dict.fromkeys((*free, *all_parameters(augmented).amplitudes, *of_roads(augmented))))
    always, held_out = random_processes(augmented), HeldOut(augmented, drives[-1:], variances)

    def fits_of(fitted: Sequence[DriveData]) -> CandidateFits:
        fitting = Fitting(augmented, fitted, variances, stated_noise, drives)
        return CandidateFits(fitting, held_out, moved, say, kept, always)

    fits = fits_of(drives[:-1])
    say("baseline: fitting the nominal model")
    best = likeliest_memory(fits, (), fits.fitting.first())
    added, best, _ = grown(fits, (), best, "baseline")
    say("baseline: fitting all of its drives")
    judged, whole = fits.judge(added, best.point), fits_of(drives)
    values = np.repeat(best.point.values[:, [0]], len(drives), axis=1)
    fitted = whole.fit(added, replace(best.point, values=values), afresh=False)
    added, fitted, _ = grown(whole, added, fitted, "baseline")
    return Baseline(added, whole.fitting, fitted, judged, about(whole.fitting, fitted), tuple(d.name for d in drives))


def about(fitting: Fitting, fitted: FittedHypothesis) -> AugmentedModel:
    """Return the augmented model about a fit, with what that leaves open of its parameters."""
    augmented, spec = fitting.augmented, fitting.augmented.spec
    # What the drives say nothing of, as of a shape of what is absent, stays as it is.
    every, errors = [c for c in fitted.coordinates if c.kind == "parameter"], fitting.standard_errors(fitted)
    moved = [c for c, e in zip(every, errors, strict=False) if not c.drives and math.isfinite(e)]
    slopes = np.array([c.slope(c.coordinate(fitted.point.value(c))) for c in moved])
    rows = [i for i, c in enumerate(every) if c in moved]
    covariance = covariance_of(fitting.information(fitted)).matrix[np.ix_(rows, rows)] * np.outer(slopes, slopes)
    noise, values = fitting.noise([fitted.point]), fitted.point.values[:, 0]
    stated = dict(zip(augmented.names, map(float, values), strict=True))
    spec = replace(
        spec,
        values={n: stated[n] for n in spec.values},
        process_noise=dict(zip(augmented.nominal.states, map(float, noise.process[:, 0]), strict=True)),
        measurement_noise=dict(zip(augmented.model.outputs, map(float, noise.measurement[:, 0]), strict=True)),
    )
    return augmented.restated(spec, values, HeldParameters(tuple(c.name for c in moved), covariance))
