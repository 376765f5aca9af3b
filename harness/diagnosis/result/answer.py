"""Answer of a trace in sentences: what the model lacks, what the recordings have, which stated values were wrong."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from harness.diagnosis.innovations.disturbance_inputs import DisturbanceInput
from harness.diagnosis.model.hypotheses import ALL_PARAMETERS, Hypothesis
from harness.diagnosis.residuals.dependence import Curve
from harness.diagnosis.residuals.localisation import Localisation
from harness.diagnosis.residuals.order_analysis import PeriodicDisturbance
from harness.diagnosis.residuals.random_process import RandomProcess
from harness.diagnosis.residuals.unmodelled import UnmodelledDisturbance
from harness.diagnosis.result.claims import Claims, Refused, final_judgement
from harness.diagnosis.selection.acceptance import beyond_belief
from harness.diagnosis.selection.forward_selection import Trace
from harness.diagnosis.selection.validation import Judgement
from harness.models.assembly.placement import split
from harness.models.quantities import capital, listed, print_unit, quantity, words
from harness.models.signals import SIGNALS
from harness.reporting import style


@dataclass(frozen=True)
class Value:
    """Value and standard error of a parameter in SI units; the error is NaN where there is none."""

    name: str
    unit: str
    value: float
    std: float


_NORMAL_95 = 1.959963984540054


@dataclass(frozen=True)
class Change:
    """A parameter that is another one since the baseline, in SI units.

    Attributes:
        hypothesis: Of which it is an amplitude.
        name: Of the parameter.
        unit: Its unit.
        before: In the baseline; the neutral value of an effect that was not there.
        now: In the drives since.
        std: Standard error of the difference: of both values, and of what differs between drives anyway.
        new: Whether it is of an effect that the baseline does not have.
    """

    hypothesis: Hypothesis
    name: str
    unit: str
    before: float
    now: float
    std: float
    new: bool

    @property
    def interval(self) -> tuple[float, float]:
        """The 95 % interval of the difference; it allows for the discrepancy of the model and the baseline's error."""
        reach = _NORMAL_95 * self.std
        return self.now - self.before - reach, self.now - self.before + reach


_PURE = 0.8
"""Share of a curve's power from which it counts as odd or even."""

_SURE = 0.95
"""Probability from which a claim is made without a word of doubt."""

_LIKELY = 2 / 3
"""Probability from which what is claimed is called probable, as the IPCC does (Mastrandrea et al. 2010)."""

_CLAIMS = {
    "lacks": ("probably lacks", "may lack"),
    "have": ("probably have", "may have"),
    "was wrong": ("was probably wrong", "may have been wrong"),
    "were wrong": ("were probably wrong", "may have been wrong"),
    "is": ("is probably", "may be"),
}
"""What is claimed of something probable, and of something that may as well not be so."""

_FLAT = 0.3
"""Slope at the end of a curve over its steepest one, below which it saturates."""


def unmodelled_words(disturbance: UnmodelledDisturbance) -> list[str]:
    """Return what each part of an unmodelled disturbance looks like."""
    return [*map(described, disturbance.periodic), *map(described, disturbance.curves)]


def described(disturbance: Curve | PeriodicDisturbance) -> str:
    """Say what a disturbance looks like."""
    return _periodic(disturbance) if isinstance(disturbance, PeriodicDisturbance) else _curve(disturbance)


def _periodic(d: PeriodicDisturbance) -> str:
    grows = f" at {style.number(d.speed)} m/s and growing with the square of the speed" if d.growth else ""
    size = amount(d.amplitude, d.disturbance_input)
    return f"{entry(d.disturbance_input)}, once per {style.number(d.wavelength)} m driven, reaching {size}{grows}"


def _curve(curve: Curve) -> str:
    """Say what a curve looks like: ``coupling moment, odd in the articulation angle, reaching 16 kN·m``."""
    low, high = curve.basis.ends
    reach = min(-low, high)
    kind = "a function of"
    if reach > 0.3 * max(-low, high):
        grid = np.linspace(0.0, reach, 100)
        negative, positive = curve.at(-grid), curve.at(grid)
        odd, even = 0.5 * (positive - negative), 0.5 * (positive + negative)
        total = np.sum(odd**2) + np.sum(even**2)
        kind = "odd in" if np.sum(odd**2) > _PURE * total else "even in" if np.sum(even**2) > _PURE * total else kind
    grid = np.linspace(low, high, 200)
    values = curve.at(grid)
    slopes = np.abs(np.gradient(values, grid))
    ends = max(slopes[2], slopes[-3])
    largest = float(np.abs(values).max())
    verb = "saturating at" if ends < _FLAT * slopes.max() and np.argmax(slopes) not in (0, 199) else "reaching"
    return f"{entry(curve.disturbance_input)}, {kind} the {curve.regressor.words}, {verb} " + amount(
        largest, curve.disturbance_input
    )


def entry(disturbance_input: DisturbanceInput) -> str:
    """Return an input in words."""
    if disturbance_input.kind == "equation":
        return f"equation of the {words(disturbance_input.ports[0])}"
    return (
        f"sensor of the {words(disturbance_input.name)}"
        if disturbance_input.kind == "sensor"
        else words(disturbance_input.name)
    )


def amount(value: float, disturbance_input: DisturbanceInput) -> str:
    """Write a disturbance with its unit as reports do."""
    unit, scale = shown(disturbance_input)
    return style.with_unit(scale * value, unit)


def shown(disturbance_input: DisturbanceInput) -> tuple[str, float]:
    """Return the unit in which reports show a disturbance, and how many of it make an SI unit."""
    if disturbance_input.kind == "equation":
        return print_unit(disturbance_input.unit), 1.0
    q = quantity(disturbance_input.ports[0].removeprefix("sensor_"))
    signal = SIGNALS.get(q.name)
    return (
        (q.unit, q.scale)
        if signal and signal.unit == disturbance_input.unit
        else (print_unit(disturbance_input.unit), 1.0)
    )


def in_words(probability: float) -> str:
    """Write a probability as a number of cases: ``9 in 10``."""
    if probability > 0.995:
        return "more than 99 in 100"
    if probability < 0.005:
        return "less than 1 in 100"
    tenths = 0.05 <= probability < 0.95
    return f"{round(10 * probability)} in 10" if tenths else f"{round(100 * probability)} in 100"


def claim(verb: str, probability: float | None, rest: str = "", conditional: bool = False) -> str:
    """Return a claim that is as strong as its probability, which follows it where there is doubt.

    Args:
        verb: One of ``_CLAIMS``.
        probability: ``None`` where it is not known.
        rest: What follows the verb.
        conditional: Whether the probability is that if one of the models is right.
    """
    condition = ", if one of these explanations is right" if conditional and probability is not None else ""
    if probability is None or (probability >= _SURE and not conditional):
        return f"{verb} {rest}".rstrip()
    probably, may = _CLAIMS[verb]
    strength = verb if probability >= _SURE else probably if probability >= _LIKELY else may
    return f"{f'{strength} {rest}'.rstrip()} ({in_words(probability)}{condition})"


_STATED_FREE = (
    " All stated values were free within what they may be off by, so a wrong one is taken up and has no name; what "
    "changes from one day to the next has one (--baseline)."
)
"""Said of a model that grew."""

_SUREST = 3
"""Values that a sentence names of many."""


def answer(trace: Trace, claims: Claims, localisation: Localisation, values: Mapping[str, Sequence[Value]]) -> str:
    """Return what was found, in sentences: of the vehicle first, then of the recordings, then of stated values.

    Args:
        trace: What was found.
        claims: What of it is claimed.
        localisation: Where something is missing that has no name.
        values: The parameters of every addition, by its name.
    """
    verdict, process = claims.verdict, localisation.random_process
    effects = trace.effects if process is None else (*trace.effects, *process.hypotheses)
    of_vehicle, recorded = ([h for h in effects if h.of_recording == which] for which in (False, True))
    also = _rivals(claims, of_vehicle)
    if recorded:
        sure = claims.probability(recorded)
        also += f" The recordings {claim('have', sure, _named(recorded), claims.conditional)}."
        also += _rivals(claims, recorded)
    if far := beyond_belief(trace.final, trace.added):
        rest = "the rest" if effects else "it"
        also += f" Many stated values would explain {rest}, but only with implausible factors: {far}."
    else:
        also += _wrong_values(trace, values, claims)
    if claims.at_bound:
        also += (
            f" The {listed([words(n) for n in claims.at_bound])} ended at a bound of what is possible, so something "
            "else is there or more than that."
        )
    also += "".join(f" {direction}" for direction in claims.hinging)
    change = gap(trace.before, final_judgement(trace, localisation))
    if process is not None:
        change = (change if trace.added else "") + _of_a_process(process)
    curves = [] if localisation.unmodelled is None else unmodelled_words(localisation.unmodelled)
    unmodelled = f" What is missing acts as {'; '.join(curves)}." if curves else ""
    sure, named = claims.probability(of_vehicle), _named(of_vehicle)
    if verdict == "adequate":
        adequate = (
            f"The model {claim('is', claims.adequate(), 'adequate')}: nothing is missing that these drives can show."
        )
        return f"{adequate}{also}{change if trace.added else ''}"
    if verdict == "amended":
        nothing = "Of the vehicle nothing is missing that these drives can show."
        outside = nothing if localisation.unmodelled is None else "The model lacks something outside the library."
        lacks = f"The model {claim('lacks', sure, named, claims.conditional)}." if named else outside
        return f"{lacks}{unmodelled}{also}{change}"
    if trace.cut_short:
        so_far = f" Until then the model was found to lack {named}." if named else ""
        return f"The search broke off before everything was tried, so there is no verdict.{so_far}{also}"
    closed = change if effects or curves else ""
    if trace.discrepancy and named:
        lacks = f"The model {claim('lacks', sure, named, claims.conditional)}."
        force = f"What else it lacks acts as {_as_a_force(trace)}."
        return f"{lacks} {force}{unmodelled}{also}{_STATED_FREE}{closed}"
    part = f" Part of it {claim('is', sure, named, claims.conditional)}." if named else ""
    refused = "" if claims.refused is None else _refused(claims.refused)
    return f"Something is missing that no effect of the library explains.{refused}{part}{unmodelled}{also}{closed}"


def _as_a_force(trace: Trace) -> str:
    """Return in words how large the discrepancy of a model is."""
    augmented, sizes = trace.fitting.augmented, []
    for h in (h for h in trace.discrepancy if h.name in augmented.discrepancy):
        body, share = split(h.name)[1], float(trace.final.point.values[augmented.row(h.amplitudes[0]), 0])
        sizes.append(f"{style.percent(share)} of the lateral force{f' of the {words(body)}' if body else ''}")
    return f"a random force of {listed(sizes)}"


def _refused(refused: Refused) -> str:
    """Return a sentence on additions that are worse than none, with a space before it."""
    added, ratio = refused.trace.added, refused.growth.ratio
    plain = [h for h in added if h.name != ALL_PARAMETERS]
    what = listed([_named([h]) for h in plain] + ["many other stated values"] * (len(plain) < len(added)))
    grows = (
        "the free run over the held-out drives leaves the model's range"
        if math.isinf(ratio.value)
        else f"the simulation error on the held-out drives grows by a factor of {style.number(ratio.value)}, "
        f"{style.number(ratio.lower)} to {style.number(ratio.upper)}"
    )
    return f" With {what} the fitted drives are likelier, but {grows}: that is no answer, and the nominal model stays."


def _rivals(claims: Claims, added: Sequence[Hypothesis]) -> str:
    """Return a sentence for each addition that shares its probability, with a space before it; empty if none does."""
    sentences = ""
    for h in added:
        if not (rivals := claims.rivals(h)) or (claims.probability([h]) or 0.0) >= _SURE:
            continue
        each = [f"{_named([r.hypothesis]) if r.hypothesis else 'nothing'} ({in_words(r.probability)})" for r in rivals]
        sentences += f" In the place of {_named([h])} there may be {' or '.join(each)}."
    return sentences


def _named(effects: Sequence[Hypothesis]) -> str:
    """Return effects in words, each with all its places; empty if there is none."""
    places: dict[str, list[str]] = {}
    for h in effects:
        name, place = split(h.name)
        places.setdefault(words(name), []).extend([words(place)] if place else [])
    return listed([f"{name} of {listed(at)}" if at else name for name, at in places.items()]) if effects else ""


def _wrong_values(trace: Trace, values: Mapping[str, Sequence[Value]], claims: Claims) -> str:
    """Return a sentence on the stated values that were wrong, with a space before it; of many the surest three."""
    stated = trace.fitting.augmented.spec.values
    sentence = ""
    for h in (h for h in trace.added if h.kind == "parameter"):
        moved = sorted(values[h.name], key=lambda v: -abs(v.value - stated[v.name]) / v.std)
        each = listed([_instead(v, stated[v.name]) for v in moved[:_SUREST]])
        sure, many = claims.probability([h]), h.name == ALL_PARAMETERS
        sentence += (
            f" Many stated values {claim('were wrong', sure, '', claims.conditional)}, most surely {each}."
            if many
            else f" A stated value {claim('was wrong', sure, '', claims.conditional)}: {each}."
        )
        sentence += "" if many else _rivals(claims, [h])
    return sentence


def _instead(v: Value, stated: float) -> str:
    unit = f" {print_unit(v.unit)}".rstrip()
    return f"{words(v.name)} ({style.uncertain(v.value, v.std)}{unit} in place of {style.number(stated)})"


def _of_a_process(process: RandomProcess) -> str:
    names = _named(process.hypotheses)
    are = "are random processes" if len(process.hypotheses) > 1 else "is a random process"
    return (
        f" {capital(names)} {are}: no simulation predicts that. With it "
        f"in the filter, the log-likelihood of the held-out drives rises by {process.held_out_gain:.0f}."
    )


def gap(before: Judgement, after: Judgement) -> str:
    """Return a sentence on what becomes of the simulation error, with a space before it."""
    if math.isinf(before.normalised_excess_mse):
        now = "does so too" if math.isinf(after.normalised_excess_mse) else "stays within it"
        return (
            " On the held-out drives the free run of the refitted nominal model leaves the model's range; that of the "
            f"final model {now}."
        )
    if before.normalised_excess_mse <= 0 or not after.normalised_excess_mse < before.normalised_excess_mse:
        return " The simulation error on the held-out drives does not fall."
    fall = 100 * (1 - math.sqrt(after.normalised_excess_mse / before.normalised_excess_mse))
    return (
        f" The simulation error on the held-out drives, beyond the noise of sensors and inputs, falls by {fall:.0f} %."
    )
