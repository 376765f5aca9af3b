"""The answer of a trace in sentences."""

from __future__ import annotations

import math

from harness.diagnosis.residuals.localisation import Where
from harness.diagnosis.residuals.random_process import RandomProcess
from harness.diagnosis.result.verdict import Verdict, final_judgement
from harness.diagnosis.result.wording import unmodelled_words
from harness.diagnosis.selection.acceptance import beyond_belief
from harness.diagnosis.selection.forward_selection import Trace
from harness.diagnosis.selection.validation import Judgement
from harness.models.quantities import listed, words


def answer(trace: Trace, verdict: Verdict, found: Where) -> str:
    """Return what was found, in sentences."""
    parameters = [h for h in trace.added if h.kind == "parameter"]
    process = found.random_process
    effects = trace.effects if process is None else (*trace.effects, *process.hypotheses)
    names = [words(h.name.replace("@", " of ")) for h in effects]
    named = listed(names) if names else ""
    wrong = ", ".join(words(h.name) for h in parameters)
    also = f" The stated values of {wrong} were wrong." if parameters else ""
    if far := beyond_belief(trace.final, trace.added):
        rest = "the rest" if effects else "it"
        also = f" Many stated values would explain {rest}, but only with implausible factors: {far}."
    after = final_judgement(trace, found)
    change = gap(trace.before, after)
    if process is not None:
        change = (change if trace.added else "") + _of_a_process(process)
    curves = [] if found.unmodelled is None else unmodelled_words(found.unmodelled)
    unmodelled = f" What is missing acts as {'; '.join(curves)}." if curves else ""
    if verdict == "adequate":
        return f"The model is adequate: nothing is missing that these drives can show.{also}{change if also else ''}"
    if verdict == "amended":
        lacking = f"The model lacks {named}." if named else "The model lacks something outside the library."
        return f"{lacking}{unmodelled}{also}{change}"
    if trace.cut_short:
        so_far = f" Until then {named} {'were' if len(names) > 1 else 'was'} found." if named else ""
        return f"The search broke off before everything was tried, so there is no verdict.{so_far}{also}"
    part = f" {named[:1].upper()}{named[1:]} explain{'' if len(names) > 1 else 's'} part of it." if named else ""
    closed = change if named or curves else ""
    return f"Something is missing that no effect of the library explains.{part}{unmodelled}{closed}{also}"


def _of_a_process(process: RandomProcess) -> str:
    names = listed([words(h.name.replace("@", " of ")) for h in process.hypotheses])
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
