"""The answer of a trace in sentences."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

from harness.diagnosis.model.hypotheses import ALL_PARAMETERS, Hypothesis
from harness.diagnosis.residuals.localisation import Where
from harness.diagnosis.residuals.random_process import RandomProcess
from harness.diagnosis.result.value import Value
from harness.diagnosis.result.verdict import Verdict, final_judgement, final_posterior
from harness.diagnosis.result.wording import claim, unmodelled_words
from harness.diagnosis.selection.acceptance import beyond_belief
from harness.diagnosis.selection.forward_selection import Trace
from harness.diagnosis.selection.posterior import Posterior
from harness.diagnosis.selection.validation import Judgement
from harness.models.assembly.placement import split
from harness.models.quantities import listed, print_unit, words
from harness.reporting import style

_SUREST = 3
"""Values that a sentence names of many."""


def answer(trace: Trace, verdict: Verdict, found: Where, values: Mapping[str, Sequence[Value]]) -> str:
    """Return what was found, in sentences: of the vehicle first, then of the recordings, then of stated values.

    Args:
        trace: What was found.
        verdict: On it.
        found: Where something is missing that has no name.
        values: The parameters of every addition, by its name.
    """
    process, posterior = found.random_process, final_posterior(trace, found)
    effects = trace.effects if process is None else (*trace.effects, *process.hypotheses)
    of_vehicle, recorded = ([h for h in effects if h.of_recording == which] for which in (False, True))
    also = ""
    if recorded:
        also = f" The recordings {claim('have', _sure(trace, posterior, recorded), _named(recorded))}."
    if far := beyond_belief(trace.final, trace.added):
        rest = "the rest" if effects else "it"
        also += f" Many stated values would explain {rest}, but only with implausible factors: {far}."
    else:
        also += _wrong_values(trace, values, posterior)
    if posterior is not None and posterior.none > 0.5 and found.unmodelled is None and verdict != "unresolved":
        also += f" Something that is not listed {claim('is', posterior.none, 'there')}."
    change = gap(trace.before, final_judgement(trace, found))
    if process is not None:
        change = (change if trace.added else "") + _of_a_process(process)
    curves = [] if found.unmodelled is None else unmodelled_words(found.unmodelled)
    unmodelled = f" What is missing acts as {'; '.join(curves)}." if curves else ""
    sure, named = _sure(trace, posterior, of_vehicle), _named(of_vehicle)
    if verdict == "adequate":
        alone = None if posterior is None or trace.added else posterior.model_with(())
        sure = None if alone is None else alone.probability
        adequate = f"The model {claim('is', sure, 'adequate')}: nothing is missing that these drives can show."
        return f"{adequate}{also}{change if trace.added else ''}"
    if verdict == "amended":
        nothing = "Of the vehicle nothing is missing that these drives can show."
        outside = nothing if found.unmodelled is None else "The model lacks something outside the library."
        lacks = f"The model {claim('lacks', sure, named)}." if named else outside
        return f"{lacks}{unmodelled}{also}{change}"
    if trace.cut_short:
        so_far = f" Until then the model was found to lack {named}." if named else ""
        return f"The search broke off before everything was tried, so there is no verdict.{so_far}{also}"
    part = f" Part of it {claim('is', sure, named)}." if named else ""
    closed = change if effects or curves else ""
    return f"Something is missing that no effect of the library explains.{part}{unmodelled}{also}{closed}"


def _sure(trace: Trace, posterior: Posterior | None, hypotheses: Sequence[Hypothesis]) -> float | None:
    """Return the probability that all of some hypotheses are right; ``None`` where it was not computed."""
    if posterior is None or not set(trace.added).issuperset(hypotheses):  # a random process is none of the models
        return None
    return posterior.probability_of(hypotheses)


def _named(effects: Sequence[Hypothesis]) -> str:
    """Return effects in words, each with all its places; empty if there is none."""
    places: dict[str, list[str]] = {}
    for h in effects:
        name, place = split(h.name)
        places.setdefault(words(name), []).extend([words(place)] if place else [])
    return listed([f"{name} of {listed(at)}" if at else name for name, at in places.items()]) if effects else ""


def _wrong_values(trace: Trace, values: Mapping[str, Sequence[Value]], posterior: Posterior | None) -> str:
    """Return a sentence on the stated values that were wrong, with a space before it; of many the surest three."""
    stated = trace.fitting.augmented.spec.values
    said = ""
    for h in (h for h in trace.added if h.kind == "parameter"):
        moved = sorted(values[h.name], key=lambda v: -abs(v.value - stated[v.name]) / v.std)
        each = listed([_instead(v, stated[v.name]) for v in moved[:_SUREST]])
        sure = _sure(trace, posterior, [h])
        many = h.name == ALL_PARAMETERS
        said += (
            f" Many stated values {claim('were wrong', sure)}, most surely {each}."
            if many
            else f" A stated value {claim('was wrong', sure)}: {each}."
        )
    return said


def _instead(v: Value, stated: float) -> str:
    unit = f" {print_unit(v.unit)}".rstrip()
    return f"{words(v.name)} ({style.uncertain(v.value, v.std)}{unit} in place of {style.number(stated)})"


def _of_a_process(process: RandomProcess) -> str:
    names = _named(process.hypotheses)
    are = "are random processes" if len(process.hypotheses) > 1 else "is a random process"
    return (
        f" {names[:1].upper()}{names[1:]} {are}: no simulation predicts that. With it "
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
