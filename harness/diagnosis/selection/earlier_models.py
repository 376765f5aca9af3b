"""Models of an earlier trace's confusable set, fitted to all drives, where they compete with what the search finds."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

from harness.diagnosis.fitting import FittedHypothesis, ParameterPoint
from harness.diagnosis.model.hypotheses import ALL_PARAMETERS, Hypothesis, still_open
from harness.diagnosis.selection.candidate_fits import Added, CandidateFits

_Named = tuple[str, str]
"""Kind and name of a hypothesis."""


@dataclass(frozen=True)
class EarlierModel:
    """A model of the confusable set of an earlier trace.

    Attributes:
        added: Kinds and names of what it has; those of an entry that drives could not tell apart stand together, the
            one that was fitted first.
        estimates: Parameters that all drives share, as they were fitted.
    """

    added: tuple[tuple[_Named, ...], ...]
    estimates: Mapping[str, float]

    @property
    def variants(self) -> list[tuple[_Named, ...]]:
        """What was fitted, and the same with each of what was like it then: further drives may tell it apart."""
        fitted = tuple(alike[0] for alike in self.added)
        others = ((*fitted[:i], other, *fitted[i + 1 :]) for i, alike in enumerate(self.added) for other in alike[1:])
        return [fitted, *others]


@dataclass(frozen=True)
class EarlierDrives:
    """What a search knows from earlier drives of the vehicle.

    Attributes:
        always: Random processes that every model has.
        models: Confusable set of an earlier trace, which is fitted besides.
    """

    always: Added = ()
    models: Sequence[EarlierModel] = ()


NO_DRIVES = EarlierDrives()


def fit_earlier(
    fits: CandidateFits, models: Sequence[EarlierModel], nominal: FittedHypothesis
) -> list[tuple[Added, FittedHypothesis]]:
    """Return models of an earlier trace with additions, each fitted to the end; without those that are not tried.

    All stay among what is compared, those too that are out of the question: users know them.

    Args:
        fits: Of the drives.
        models: Of the earlier trace.
        nominal: The nominal model, whose noise is where the fits begin.
    """
    starts: dict[frozenset[Hypothesis], tuple[Added, EarlierModel]] = {}
    for model in models:
        for variant in model.variants:
            added = _added(fits, variant)
            if added:
                starts.setdefault(frozenset(added), (added, model))
    fits.stay = tuple(starts)
    if not starts:
        return []
    fits.say("fitting the models that the earlier trace left")

    def fitted(start: tuple[Added, EarlierModel]) -> tuple[Added, FittedHypothesis]:
        return start[0], fits.fit(start[0], _start(fits, *start, nominal.point))

    return fits.augmented.share(fitted, list(starts.values()))


def _added(fits: CandidateFits, variant: Sequence[_Named]) -> Added | None:
    """Return the hypotheses of a model that are not in every model; ``None`` where one is not tried."""
    tried: dict[_Named, Hypothesis] = {(h.kind, h.name): h for h in (*fits.always, *fits.hypotheses)}
    if not tried.keys() >= set(variant):
        return None
    added = [tried[named] for named in variant if tried[named] not in fits.always]
    single = {a for h in added if h.name != ALL_PARAMETERS for a in h.amplitudes}
    opened = (still_open(h, single) if h.name == ALL_PARAMETERS else h for h in added)
    return tuple(h for h in opened if h is not None)


def _start(fits: CandidateFits, added: Added, model: EarlierModel, point: ParameterPoint) -> ParameterPoint:
    """Return where the fit of a model begins: at its estimates; what has none is at the best value of its grid."""
    moved = {*fits.free, *(n for h in added for n in h.shared)}
    values = point.values.copy()
    for name in moved & model.estimates.keys():
        values[fits.augmented.row(name)] = model.estimates[name]
    unknown = [n for h in added for n in h.amplitudes if n not in model.estimates]
    points = fits.on_grids(replace(point, values=values), unknown)
    return fits.fitting.best(points) if len(points) > 1 else points[0]


def finite(estimates: Sequence[Mapping[str, float | None]]) -> dict[str, float]:
    """Return estimates of ``trace.json`` by name."""
    each = ((str(e["name"]), e["value"]) for e in estimates)
    return {name: value for name, value in each if value is not None and math.isfinite(value)}
