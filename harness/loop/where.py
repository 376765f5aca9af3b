"""Where a model lacks something, before and after what was added, and what is left without a name."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

from harness.configure import ModelSpec
from harness.loop.curves import Curve, described
from harness.loop.pinpoint import History, Pinpoint, Suspect
from harness.loop.trace import Trace
from harness.loop.turning import Turning
from harness.loop.unnamed import Unnamed, find_unnamed
from harness.loop.wandering import Wandering, find_wandering

SHOWN = 3
"""Entries whose disturbance is shown over time."""


@dataclass(frozen=True)
class Where:
    """The pinpointed model.

    Attributes:
        nominal: The nominal model, refitted.
        final: With everything added; the same if nothing was.
        histories: Disturbances at the most suspect entries of the nominal model, each over every fitted drive.
        unnamed: What is left, as curves; ``None`` if it was not looked for or nothing predicts the drives left out.
        wandering: What is left, as a random process of the library; then no curve is looked for.
    """

    nominal: Pinpoint
    final: Pinpoint
    histories: tuple[tuple[History, ...], ...]
    unnamed: Unnamed | None
    wandering: Wandering | None = None

    @property
    def shown(self) -> tuple[Suspect, ...]:
        """The most suspect entries of the nominal model, where a disturbance gains anything."""
        return tuple(s for s in self.nominal.suspects[:SHOWN] if s.gain > 0)


def where(trace: Trace, amended: ModelSpec, unexplained: bool) -> Where:
    """Pinpoint what the nominal model and the final one lack.

    Args:
        trace: What was found.
        amended: The final model.
        unexplained: Whether something is left to look for.
    """
    nominal = final = Pinpoint(trace.fitting, trace.nominal.point)
    if trace.added:
        final = Pinpoint(trace.fitting, trace.final.point, nominal.channels)
    histories = tuple(nominal.history(s) for s in nominal.suspects[:SHOWN] if s.gain > 0)
    wandering = find_wandering(trace, amended, final) if unexplained else None
    unnamed = None
    if unexplained and wandering is None:
        unnamed = find_unnamed(trace.fitting, trace.held_out, trace.final, trace.after, final)
    return Where(nominal, final, histories, unnamed, wandering)


def pinpoint_record(found: Where) -> list[dict[str, Any]]:
    """Return ``pinpoint`` of ``trace.json``: every entry, the one that explains most first."""
    left = {s.channel.name: s.gain for s in found.final.suspects}
    return [
        {
            "channel": s.channel.name,
            "kind": s.channel.kind,
            "ports": list(s.channel.ports),
            "unit": s.channel.unit,
            "log_likelihood_gain": s.gain,
            "time_constant": s.time_constant,
            "deviation": s.deviation,
            "log_likelihood_gain_after": left[s.channel.name],
        }
        for s in found.nominal.suspects
    ]


def unnamed_record(found: Unnamed | None) -> dict[str, Any] | None:
    """Return ``unnamed`` of ``trace.json``."""
    if found is None:
        return None
    return {
        "curves": [_curve(c) for c in found.curves],
        "turning": [_turning(t) for t in found.turning],
        "parameters": found.shift,
        "held_out_log_likelihood_gain": found.held_out_gain,
        "excess": found.judgement.excess if math.isfinite(found.judgement.excess) else None,
        "driven_by": "the motion of the model itself and the recorded inputs",
    }


def _turning(t: Turning) -> dict[str, Any]:
    return {
        "channel": t.channel.name,
        "ports": list(t.channel.ports),
        "unit": t.channel.unit,
        "words": described(t),
        "wavelength": t.wavelength,
        "amplitude": t.amplitude,
        "speed": t.speed,
        "grows_with_speed_to_the": t.growth,
        "log_likelihood_gain": t.gain,
    }


def _curve(c: Curve) -> dict[str, Any]:
    return {
        "channel": c.channel.name,
        "ports": list(c.channel.ports),
        "unit": c.channel.unit,
        "driver": c.driver.name,
        "driver_unit": c.driver.unit,
        "driver_within": c.driver.within if math.isfinite(c.driver.within) else None,
        "words": described(c),
        "degree": 3,
        "knots": c.basis.knots.tolist(),
        "coefficients": c.weights.tolist(),
        "stability": c.stability,
        "predicted_log_likelihood_gain": c.predicted,
    }
