"""Localisation of a model's error before and after the additions, and the unmodelled disturbance that remains."""

from __future__ import annotations

from dataclasses import dataclass

from harness.common.failures import RAISED, Failures
from harness.config import ModelSpec
from harness.diagnosis.residuals.disturbance_ranking import DisturbanceHistory, DisturbanceRanking, RankedInput
from harness.diagnosis.residuals.random_process import RandomProcess, find_random_process
from harness.diagnosis.residuals.unmodelled import UnmodelledDisturbance, find_unmodelled
from harness.diagnosis.selection.forward_selection import Trace

SHOWN = 3
"""Inputs whose disturbance is shown over time."""


@dataclass(frozen=True)
class Localisation:
    """Where the nominal and the final model lack something.

    Attributes:
        nominal: The nominal model, refitted; ``None`` if it could not be localised.
        final: With everything added; the same if nothing was.
        histories: Disturbances at the inputs of the largest gain of the nominal model, each over every fitted drive.
        unmodelled: What is left, as curves; ``None`` if it was not sought or nothing improves the held-out drives.
        random_process: What is left, as a random process of the library; then no curve is looked for.
    """

    nominal: DisturbanceRanking | None
    final: DisturbanceRanking | None
    histories: tuple[tuple[DisturbanceHistory, ...], ...]
    unmodelled: UnmodelledDisturbance | None
    random_process: RandomProcess | None = None

    @property
    def shown(self) -> tuple[RankedInput, ...]:
        """The inputs of the largest gain of the nominal model, where a disturbance gains anything."""
        return tuple(s for s in self.nominal.ranked_inputs[:SHOWN] if s.gain > 0) if self.nominal else ()


NOWHERE = Localisation(None, None, (), None)
"""Where it could not be looked for."""


def localised(
    trace: Trace, amended: ModelSpec, unexplained: bool, failures: Failures = RAISED, random: bool = True
) -> Localisation:
    """Rank where the nominal model and the final one lack.

    Args:
        trace: What was found.
        amended: The final model.
        unexplained: Whether anything is left to explain.
        failures: Takes what cannot be computed; by default it is raised.
        random: Whether a random process may explain it.
    """
    nominal = final = DisturbanceRanking(trace.fitting, trace.nominal.point)
    if trace.added:
        final = DisturbanceRanking(trace.fitting, trace.final.point, nominal.disturbance_inputs)
    histories = tuple(nominal.history(s) for s in nominal.ranked_inputs[:SHOWN] if s.gain > 0)
    random_process = unmodelled = None
    unexplained = unexplained and not trace.discrepancy  # which stands for it
    if unexplained and random:
        random_process = failures.attempt(
            "the search for a random process", lambda: find_random_process(trace, amended, final), lambda _: None
        )
    if unexplained and random_process is None:
        unmodelled = failures.attempt(
            "the search for an unmodelled disturbance",
            lambda: find_unmodelled(trace.fitting, trace.held_out, trace.final, trace.after, final),
            lambda _: None,
        )
    return Localisation(nominal, final, histories, unmodelled, random_process)
