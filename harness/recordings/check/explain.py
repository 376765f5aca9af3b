"""Search for the faults that explain disagreement between the signals of a recording, over all relations together.

A hypothesis is a set of faults of the catalogue. Mended by it, each relation has a misfit q, the share of what both
sides carry that they do not have in common; both sides count alike, so that no hypothesis wins by making a signal
small. Its log-likelihood is ``-m/2 ln(q + what the relation neglects)`` with m independent samples, less what a slope
other than 1 costs; posterior probabilities follow with the priors of the catalogue. The best hypotheses are extended
by one more fault until that no longer pays.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from harness.common.arrays import Floats
from harness.models.signals import SIGNALS
from harness.recordings.check.causes import EXCHANGED, SIGN, TIME, UNIT, RecordingFault, catalogue, times
from harness.recordings.motion.consistency import applicable, crawls, tolerance
from harness.recordings.motion.kinematics import local_polynomial
from harness.recordings.motion.pair_fit import is_slow, slow, without
from harness.recordings.motion.pose import tangent_plane
from harness.recordings.motion.redundancy import Relation

_WINDOW = 1.2
"""s over which signals are smoothed in the search: what a driver steers and brakes is slower."""
_SPACING = 0.2
_LATEST = 3
"""Samples of that spacing by which a signal may be late in the search for its unit and sign."""
_MEMORY = 2.0
"""s after which samples are independent, and the least and largest number of them that count."""
_COUNTED = (6.0, 30.0)
_FAILS = 0.12
"""Misfit beyond which a relation has to be explained by the catalogue; less may be a scale or a delay."""
_RELATED = 0.5
"""Misfit up to which two sides, or one and the other reversed, are related."""
_FAR = 4.5
"""Cost of a slope three standard deviations from the expected one."""
_WIDTH, _DEPTH = 6, 4
_LISTED = 0.03
"""Posterior from which an alternative is stated."""
_LIVELY = 2.0
"""Standard deviations of the tolerance by which a side of a relation must vary to be informative."""
_NEAR = 1.07
"""Factor by which a calibration is usually off."""
_USUAL = {"rad/s": 0.2, "m/s^2": 1.5, "m/s": 15.0}
"""Magnitude of signals by unit, within a factor of 4.5; of the time between samples in s."""
_ALSO_SMALL = "lateral_velocity"
_USUAL_STEP, _SPREAD = 0.02, 1.5


@dataclass(frozen=True)
class Form:
    """A signal as a hypothesis has it: ``factor * source + offset``, the source being what the recording calls so."""

    source: str
    factor: float = 1.0
    offset: float = 0.0
    place: tuple[Form, Form] | None = None


@dataclass(frozen=True)
class FaultHypothesis:
    """A set of faults.

    Attributes:
        faults: What is wrong, in the order in which it was found.
        posterior: Its probability among all hypotheses of the search.
    """

    faults: tuple[RecordingFault, ...]
    posterior: float


class Mended:
    """The signals of a recording as hypotheses have them, smoothed and thinned out, each computed once.

    Args:
        signals: Arrays ``(samples,)`` in SI units by name, as recorded.
        step: s between samples, as recorded.
    """

    def __init__(self, signals: Mapping[str, Floats], step: float) -> None:
        self.signals, self.step = signals, step
        self.placed = {"latitude", "longitude", "position_x"} <= set(signals)
        self._values: dict[Form, Floats] = {}
        self._smooth: dict[tuple[Form, float, int], Floats] = {}

    def forms(self, faults: Sequence[RecordingFault]) -> tuple[dict[str, Form], float]:
        """Return every signal as a set of faults has it, and the factor of the time."""
        forms = {name: Form(name) for name in self.signals}
        time = 1.0
        for fault in faults:
            if fault.kind == TIME:
                time *= fault.factor
            elif fault.kind == EXCHANGED:
                first, second = fault.signals
                exchanged = _times(forms[second], fault.factor), _times(forms[first], 1 / fault.factor)
                forms[first], forms[second] = exchanged
            else:
                for name in fault.signals:
                    changed = _times(forms[name], fault.factor)
                    forms[name] = Form(changed.source, changed.factor, changed.offset + fault.offset)
        if self.placed and (forms["latitude"] != Form("latitude") or forms["longitude"] != Form("longitude")):
            place = forms["latitude"], forms["longitude"]
            for name in ("position_x", "position_y"):
                forms[name] = Form(name, forms[name].factor, forms[name].offset, place)
        return forms, time

    def values(self, form: Form) -> Floats:
        """Return all samples of a signal."""
        if form not in self._values:
            source = self.signals[form.source]
            if form.place is not None:
                east, north = tangent_plane(*(self.values(f) for f in form.place))
                source = east if form.source == "position_x" else north
            values = form.factor * source + form.offset
            self._values[form] = _unwrapped(values) if form.source == "heading" and abs(form.factor) != 1 else values
        return self._values[form]

    def smooth(self, form: Form, step: float, order: int) -> Floats:
        """Return a signal or a derivative, smoothed and thinned out."""
        scale, offset = 1.0, 0.0
        if form.source != "heading":  # linear, so that one serves all
            scale, offset, form = form.factor, form.offset * (order == 0), Form(form.source, place=form.place)
        key = form, step, order
        if key not in self._smooth:
            smoothed = local_polynomial(self.values(form), step, _WINDOW, order)
            self._smooth[key] = smoothed[:: every(len(smoothed), step)]
        return scale * self._smooth[key] + offset


def every(samples: int, step: float) -> int:
    """Return how many samples of a recording one sample of the search stands for."""
    return max(int(_SPACING / step), samples // 3000, 1)


def _times(form: Form, factor: float) -> Form:
    return Form(form.source, factor * form.factor, factor * form.offset, form.place)


def _unwrapped(angle: Floats) -> Floats:
    finite = np.isfinite(angle)
    result = angle.copy()
    result[finite] = np.unwrap(angle[finite])
    return result


class View:
    """Signals of one hypothesis, as relations take them."""

    def __init__(self, mended: Mended, forms: Mapping[str, Form], step: float) -> None:
        self.signals, self.mended, self._step = forms, mended, step

    def __getitem__(self, name: str) -> Floats:
        return self.rate(name, 0)

    def spacing(self, name: str) -> float:
        """Return the time between the samples of a signal, in s."""
        return self._step * every(len(self.mended.signals[name]), self._step)

    def rate(self, name: str, derivative: int = 1) -> Floats:
        """Return a signal smoothed, or a derivative of it."""
        return self.mended.smooth(self.signals[name], self._step, derivative)


class FaultSearch:
    """Scores hypotheses about one recording.

    Args:
        signals: Arrays ``(samples,)`` in SI units by name, as recorded; derived ones left out.
        step: s between samples, as recorded.
        scales: SI units per unit of the channel, by signal.
        twins: All signals that are read from the channel of a signal.
    """

    def __init__(
        self,
        signals: Mapping[str, Floats],
        step: float,
        scales: Mapping[str, float],
        twins: Mapping[str, tuple[str, ...]],
    ) -> None:
        self.mended = Mended(signals, step)
        self.relations = applicable(signals)
        plain = View(self.mended, self.mended.forms(())[0], step)
        self._standing = {n for n, r in enumerate(self.relations) if crawls(r, *sides(r, plain)) is not None}
        tied = {n for r in self.relations for n in r.signals}
        if self.mended.placed:
            tied |= {"latitude", "longitude"}
        self.faults = [*catalogue([n for n in signals if n in tied], scales, twins), *times()]
        self._sizes = {n: float(np.nanpercentile(np.abs(v), 95)) for n, v in signals.items() if np.isfinite(v).any()}
        self._misfits: dict[tuple[object, ...], RelationMisfit] = {}

    def misfits(self, faults: Sequence[RecordingFault]) -> list[RelationMisfit]:
        """Return the misfit of every relation under a hypothesis."""
        forms, time = self.mended.forms(faults)
        step = self.mended.step * time
        view = View(self.mended, forms, step)
        misfits = []
        for n, relation in enumerate(self.relations):
            key = (n, step, *(forms[s] for s in relation.signals))
            if key not in self._misfits:
                self._misfits[key] = RelationMisfit() if n in self._standing else _misfit(relation, view)
            misfits.append(self._misfits[key])
        return misfits

    def score(self, faults: Sequence[RecordingFault]) -> float:
        """Return the logarithm of likelihood times prior."""
        forms, time = self.mended.forms(faults)
        total = self._likelihood(faults) + sum(f.log_prior for f in faults)
        total -= (np.log(self.mended.step * time / _USUAL_STEP) / _SPREAD) ** 2 / 2
        for name, form in forms.items():
            usual, size = _USUAL.get(SIGNALS[name].unit), abs(form.factor) * self._sizes.get(form.source, 0.0)
            if usual is not None and size > 0 and not name.startswith(_ALSO_SMALL):
                total -= (np.log(size / usual) / _SPREAD) ** 2 / 2
        return float(total)

    def _likelihood(self, faults: Sequence[RecordingFault]) -> float:
        """Return the logarithm of the likelihood; what only a hypothesis makes lively does not confirm it."""
        pairs = zip(self.misfits(faults), self.misfits(()), strict=True)
        return sum(min(m.likelihood, 0.0) if plain.calm and not m.calm else m.likelihood for m, plain in pairs)

    def best(self) -> list[FaultHypothesis]:
        """Return the probable hypotheses, the best first; no fault at all is one of them."""
        scores: dict[tuple[RecordingFault, ...], float] = {(): self.score(())}
        seen = {frozenset[RecordingFault]()}
        frontier: list[tuple[RecordingFault, ...]] = [()]
        for _ in range(_DEPTH):
            grown = []
            for faults in frontier:
                failing = [n for n, m in enumerate(self.misfits(faults)) if m.fails]
                room = sum(self.misfits(faults)[n].at_best - self.misfits(faults)[n].likelihood for n in failing)
                for fault in self._further(faults, failing):
                    longer = (*faults, fault)
                    at_most = scores[faults] + room + fault.log_prior
                    hopeless = fault.kind != TIME and at_most < max(scores.values()) + np.log(_LISTED)
                    if hopeless or frozenset(longer) in seen:
                        continue
                    seen.add(frozenset(longer))
                    scores[longer] = self.score(longer)
                    if scores[longer] > scores[faults] and not self._silenced(faults, fault):
                        grown.append(longer)
                    elif scores[longer] > scores[faults]:
                        del scores[longer]
            frontier = sorted(grown, key=lambda f: -scores[f])[:_WIDTH]
        top = max(scores.values())
        weights = {faults: np.exp(score - top) for faults, score in scores.items()}
        total = sum(weights.values())
        ranked = sorted(weights, key=lambda f: -weights[f])
        return [
            FaultHypothesis(f, float(weights[f] / total))
            for f in ranked
            if weights[f] / total > _LISTED or f == ranked[0]
        ]

    def _silenced(self, faults: Sequence[RecordingFault], fault: RecordingFault) -> bool:
        """Return whether signals in another unit or sign, or exchanged, fit hardly better than ones that are zero.

        A term that is mostly noise fits the better the smaller it is made, in whatever unit.
        """
        if fault.kind not in (UNIT, SIGN, EXCHANGED):
            return False
        zero = replace(fault, kind=UNIT, factor=0.0)
        return self._likelihood((*faults, fault)) < self._likelihood((*faults, zero)) - np.log(_LISTED)

    def _further(self, faults: Sequence[RecordingFault], failing: Sequence[int]) -> list[RecordingFault]:
        """Return the faults that bear on a relation that still fails, of which none is there yet.

        Two channels are exchanged only where one of their relations is lively: of two calm ones the livelier fits.
        """
        there = {(f.kind, f.signals) for f in faults}
        misfits = self.misfits(faults)
        touched, loud = (
            {n for r in failing if keep(misfits[r]) for n in self.relations[r].signals}
            for keep in (lambda m: True, lambda m: not m.calm)
        )
        for names in (touched, loud):
            if self.mended.placed and names & {"position_x", "position_y"}:
                names |= {"latitude", "longitude"}
        odd_step = abs(np.log(self.mended.step / _USUAL_STEP)) > 2 * _SPREAD

        def bears(fault: RecordingFault) -> bool:
            if fault.kind == TIME:
                return odd_step
            return bool(set(fault.signals) & (loud if fault.kind == EXCHANGED else touched))

        return [f for f in self.faults if (f.kind, f.signals) not in there and bears(f)]


@dataclass(frozen=True)
class RelationMisfit:
    """Misfit of both sides of a relation.

    Attributes:
        share: Of what both sides carry, what they do not have in common.
        likelihood: Its logarithm; 0 where nothing can be said.
        at_best: What it would be if all were in common.
        cost: What a slope other than the expected one costs.
        calm: Whether neither side varies by more than needs no fault.
    """

    share: float = 0.0
    likelihood: float = 0.0
    at_best: float = 0.0
    cost: float = 0.0
    calm: bool = False

    @property
    def fails(self) -> bool:
        """Whether it has to be explained by a fault of the catalogue."""
        alike = self.share < _RELATED or self.share > 2 - _RELATED  # of one sign or the other, however calm
        return (alike or not self.calm) and (self.share > _FAILS or self.cost > _FAR)


def sides(relation: Relation, view: View) -> tuple[Floats, Floats]:
    """Return measured and computed side of a relation, smoothed and thinned out."""
    with np.errstate(all="ignore"):  # a hypothesis that is wrong may divide by a speed of zero
        return view.rate(relation.signal, relation.order), relation.compute(view)  # type: ignore[arg-type]


def _misfit(relation: Relation, view: View) -> RelationMisfit:
    """Return the misfit of a relation under a hypothesis."""
    measured, computed = _without_arm(relation, view, *sides(relation, view))
    both = np.isfinite(measured) & np.isfinite(computed)
    spacing = view.spacing(relation.signal)
    if both.sum() < 20 or (relation.quasi_static and _too_quick(relation, measured, computed, spacing)):
        return RelationMisfit()
    independent = float(np.clip(both.sum() * spacing / _MEMORY, *_COUNTED))
    if relation.circular:
        q, free, floor = float(1 - np.cos(measured - computed)[both].mean()), 0.0, 0.01
    else:
        latest = min(_LATEST, int(_LATEST * _SPACING / spacing))
        pairs = [_shifted(measured, computed, lag) for lag in range(-latest, latest + 1)]
        likeness = [float((m - m.mean()) @ (c - c.mean())) if len(m) >= 20 else -np.inf for m, c in pairs]
        q, free, floor = _shared(relation, *pairs[int(np.argmax(likeness))], independent)
    at_best = -independent / 2 * float(np.log(relation.misfit**2 / 2))
    likelihood = -independent / 2 * float(np.log(min((q + floor) / (1 + floor), 2.0)))
    penalised = max(likelihood - free, 0.0) if likelihood > 0 else likelihood * float(np.exp(-free))
    return RelationMisfit(q, penalised, at_best, free, _calm(relation, measured[both], computed[both]))


def _too_quick(relation: Relation, measured: Floats, computed: Floats, step: float) -> bool:
    """Return whether little is slow of either side, by which a relation of slow steering could be judged."""
    if is_slow((measured, computed), step):
        return False
    passed = [slow(side, step) for side in (measured, computed)]
    return not is_slow((passed[0], passed[1]), step) or _calm(relation, *(v[np.isfinite(v)] for v in passed))


def _calm(relation: Relation, measured: Floats, computed: Floats) -> bool:
    """Return whether neither side of a relation varies by more than the tolerance."""
    if relation.circular:
        return False
    sizes = [float((v**2).mean()) if relation.through_zero else float(v.var()) for v in (measured, computed)]
    return max(sizes[0], relation.slope[0] ** 2 * sizes[1]) < (_LIVELY * tolerance(relation)) ** 2


def _without_arm(relation: Relation, view: View, measured: Floats, computed: Floats) -> tuple[Floats, Floats]:
    """Return both sides without what a lever arm or late positions, which nobody has stated, may make of them."""
    columns = [c(view) for c in (relation.arm, relation.late) if c is not None]  # type: ignore[arg-type]
    columns = [c for c in columns if len(c) == len(measured)]
    if not columns:
        return measured, computed
    rows = np.isfinite(np.stack([measured, computed, *columns])).all(axis=0)
    design = np.stack(columns, 1)[rows]
    sides = []
    for side in (measured, computed):
        rest = np.full(len(side), np.nan)
        rest[rows] = without(design, side[rows])
        sides.append(rest)
    return sides[0], sides[1]


def _shifted(measured: Floats, computed: Floats, lag: int) -> tuple[Floats, Floats]:
    m = measured[max(lag, 0) : len(measured) + min(lag, 0)]
    c = computed[max(-lag, 0) : len(computed) + min(-lag, 0)]
    both = np.isfinite(m) & np.isfinite(c)
    return m[both], c[both]


def _shared(relation: Relation, measured: Floats, computed: Floats, independent: float) -> tuple[float, float, float]:
    """Return the share not in common, what a slope other than the expected one costs, and the share neglected."""
    if len(measured) < 20:
        return 1.0, 0.0, 1.0
    offset = 0.0 if relation.through_zero else 3 * tolerance(relation)
    spreads = [float(np.sqrt((v**2).mean())) if relation.through_zero else float(v.std()) for v in (measured, computed)]
    slope = spreads[0] / spreads[1] if min(spreads) > 0 else relation.slope[0]
    centre, factor = relation.expected(slope)
    away = measured - slope * computed
    away -= np.clip(np.median(away), -offset, offset)
    kept = np.abs(away) <= np.percentile(np.abs(away), 96)  # without wrapped angles and spikes
    sizes = [float((v[kept] ** 2).mean()) for v in (measured, computed)]
    carried = sizes[0] + slope**2 * sizes[1]
    if min(sizes) == 0:
        return 1.0, 0.0, 1.0
    share = float((away[kept] ** 2).mean() / carried)
    # whichever side has the noise, the slope is within the correlation (Frisch 1934), less its standard error
    alike = 1 - share
    open_by_noise = -np.log(max(alike - (1 - alike**2) / np.sqrt(independent), 0.01))
    cost = (max(abs(np.log(slope / centre)) - open_by_noise, 0.0) / np.log(factor * _NEAR)) ** 2 / 2
    calmest = min(sizes[0], centre**2 * sizes[1])  # a side in another unit is no livelier for it
    floor = relation.misfit**2 / 2 + tolerance(relation) ** 2 / (2 * calmest)
    return share, float(cost), float(floor)
