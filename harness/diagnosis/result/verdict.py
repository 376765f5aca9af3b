"""The verdict on a trace: whether the model is adequate, was amended, or lacks something that stays unexplained."""

from __future__ import annotations

from typing import Literal

from harness.diagnosis.criteria import BIC_NEEDED, EXCESS
from harness.diagnosis.residuals.localisation import Where
from harness.diagnosis.selection.acceptance import beyond_belief
from harness.diagnosis.selection.forward_selection import Trace
from harness.diagnosis.selection.posterior import Posterior
from harness.diagnosis.selection.validation import Judgement, leaves_nothing

Verdict = Literal["adequate", "amended", "unresolved"]


def verdict_of(trace: Trace, found: Where, coloured: bool) -> Verdict:
    """Return whether the model is adequate, amended, or lacks something that has no name here.

    Something is still missing if the innovations of the final model on the held-out drives are coloured, whatever was
    added: then an effect may have been mistaken for another. So it is if the simulation error there, with the
    unmodelled disturbance if one was found, exceeds the sensor noise and what random processes may do, and either one
    was found or the last round held a hypothesis that gained enough but was not accepted. A random process is accepted
    where it leaves white innovations, or almost. Many wrong parameters explain nothing if one would be wrong by an
    implausible factor. A search that was cut short has not tried everything.
    """
    if trace.cut_short or beyond_belief(trace.final, trace.added):
        return "unresolved"
    if found.random_process is not None:
        return "amended" if found.random_process.white else "unresolved"
    if coloured and (trace.effects or found.unmodelled is None):
        return "unresolved"
    if found.unmodelled is not None and final_judgement(trace, found).unexplained > EXCESS:
        return "unresolved"
    if found.unmodelled is None and _failed(trace) and not leaves_nothing(trace.after, trace.before):
        return "unresolved"
    return "amended" if trace.effects or found.unmodelled is not None else "adequate"


def final_judgement(trace: Trace, found: Where) -> Judgement:
    """Return the final model on the held-out drives, with the unmodelled disturbance if that lowers its error."""
    if (
        found.unmodelled is not None
        and found.unmodelled.judgement.normalised_excess_mse < trace.after.normalised_excess_mse
    ):
        return found.unmodelled.judgement
    return trace.after


def final_posterior(trace: Trace, found: Where) -> Posterior | None:
    """Return how likely each model is; what has no name, where that was found, makes it likelier that none is right."""
    if trace.posterior is None or found.unmodelled is None:
        return trace.posterior
    return trace.posterior.beside(trace.final, found.unmodelled.held_out_gain)


def strays(trace: Trace) -> bool:
    """Whether something is left that the named effects do not explain."""
    return not leaves_nothing(trace.after, trace.before) and (_failed(trace) or not trace.effects)


def _failed(trace: Trace) -> bool:
    """Whether the last round held a hypothesis that gained enough on the fitted drives but was not accepted."""
    last = trace.rounds[-1]
    return last.added is None and any(c.fitted is not None and c.bic >= BIC_NEEDED for c in last.candidates)
