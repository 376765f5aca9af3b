"""Hypotheses in words, their gains in a figure, their probability, and how large what each holds would be."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from harness.diagnosis.criteria import BIC_NEEDED
from harness.diagnosis.model.hypotheses import ALL_PARAMETERS, Hypothesis, called
from harness.diagnosis.result.answer import Value, in_words
from harness.diagnosis.result.outcome import Outcome
from harness.diagnosis.selection.acceptance import Round
from harness.diagnosis.selection.forward_selection import Trace
from harness.diagnosis.selection.posterior import Alike, ComparedModel
from harness.models.quantities import listed, print_unit, words
from harness.reporting import style

SHOWN = 15
"""Hypotheses drawn per round."""


def ranking(selection_round: Round, number: int, needed: float = BIC_NEEDED) -> bytes:
    """Return the gain of each of the best hypotheses of a round, and the one needed: by the score test, or fitted."""
    shown = sorted(selection_round.candidates, key=lambda c: c.bic, reverse=True)[:SHOWN]
    # Compared with a model that leaves its range every gain is infinite: drawn to the edge.
    end = 2.0 * max([needed, *(c.bic for c in shown if math.isfinite(c.bic))])
    predicted, fitted = style.looks(["predicted", "fitted"]).values()
    with style.drawing():
        fig = style.figure(1.2 + 0.24 * len(shown))
        axes = fig.subplots()
        at = np.arange(len(shown))[::-1]
        for y, c in zip(at, shown, strict=True):
            look = predicted if c.fitted is None else fitted
            width = min(max(c.bic, 1.0), end)
            axes.barh(y, width, height=0.7, facecolor=look.tint, edgecolor=look.line, hatch=look.hatch)
        axes.axvline(needed, color=style.TRUTH, ls=":", lw=0.9)
        axes.set_xscale("log")
        axes.set_xlim(1.0, end)
        axes.xaxis.set_major_formatter(lambda value, _: f"{value:g}")
        axes.set_yticks(at, [called(c.hypothesis.name) for c in shown])
        axes.set_xlabel("gain in BIC (dotted: least gain of an addition)")
        axes.grid(True, axis="x")
        handles = style.patches(["predicted", "fitted"], {"predicted": predicted, "fitted": fitted})
        style.head(fig, f"Round {number}: what explains the fitted drives?", handles)
        return style.svg(fig)


_SHOWN = 3
"""Explanations that are named, or one more where that is the last; ``trace.json`` has all."""

_LEAST = 0.01
"""Probability from which one is named."""


def likely(outcome: Outcome) -> list[str]:
    """Return the likeliest explanations with their probabilities, if one of them is right, and that of none of them."""
    claims, posterior = outcome.claims, outcome.posterior
    if posterior is None:
        return []
    chosen = [m for m in posterior.models if m.share >= _LEAST]
    shown, others = (chosen[:_SHOWN], chosen[_SHOWN:]) if len(chosen) > _SHOWN + 1 else (chosen, [])
    given_right = claims.given_right
    lines = [f"{in_words(given_right * m.probability)}: {_explained(outcome.trace, m, shown[0])}" for m in shown]
    if others:
        rest = given_right * sum(m.probability for m in others)
        lines.append(f"{in_words(rest)}: one of {len(others)} others")
    own = posterior.model_with(outcome.trace.added)
    if own is not None and own not in shown:
        lines.append(f"{in_words(given_right * own.probability)}: what the search added; its criteria differ")
    otherwise = "something else is there, in place of them or in addition"
    if posterior.none > 0.5:
        return [
            f"{in_words(posterior.none)}: none of the following; {otherwise}",
            *(f"if one is right, {s}" for s in lines),
        ]
    return [*lines, f"{in_words(posterior.none)}: none of these; {otherwise}"] if posterior.none >= _LEAST else lines


def _explained(trace: Trace, m: ComparedModel, first: ComparedModel) -> str:
    """Return what a model has, with sizes; how it differs from the likeliest one, where that is less to say."""
    if not m.added:
        return "nothing has changed" if trace.fitting.augmented.held.names else "nothing is missing"
    moved = m.fitted.coordinates
    errors = dict(zip((c.name for c in moved), trace.fitting.standard_errors(m.fitted), strict=True))

    def sized(added: Sequence[Alike]) -> str:
        return listed([_alternatives(trace, m, alike, errors) for alike in added])

    (more, less) = ([a for a in these.added if a not in those.added] for these, those in ((m, first), (first, m)))
    if m is first or len(more) + len(less) >= len(m.added):
        return sized(m.added)
    if not less:
        return f"the same, and besides: {sized(more)}"
    without = listed([_name(a.hypotheses[0]) for a in less])
    return f"the same, but in place of {without}: {sized(more)}" if more else f"the same without {without}"


def _alternatives(trace: Trace, m: ComparedModel, alike: Alike, errors: dict[str, float]) -> str:
    first = alike.hypotheses[0]
    others = [_name(h) for h in alike.hypotheses[1:]]
    return f"{_sized(trace, m, first, errors)}{f', or {listed(others)}, which acts the same' if others else ''}"


def _sized(trace: Trace, m: ComparedModel, h: Hypothesis, errors: dict[str, float]) -> str:
    """Return a hypothesis with its one amplitude; several are too many for a line."""
    if len(h.amplitudes) != 1:
        return _name(h)
    (name,) = h.amplitudes
    augmented = trace.fitting.augmented
    row = augmented.row(name)
    value, std = float(m.fitted.point.values[row, 0]), errors.get(name, math.inf)
    prefix = "found " if h.kind == "parameter" else ""
    return f"{_name(h)} ({prefix}{_measured(name, value, std, augmented.model.parameters[row].unit)})"


def _name(h: Hypothesis) -> str:
    if h.kind == "parameter" and h.name != ALL_PARAMETERS:
        return f"the stated {words(h.name)} is wrong"
    return called(h.name)


def size(v: Value) -> str:
    """Return a parameter with value, standard error and unit."""
    return f"{words(v.name.replace('@', ' in '))} {_measured(v.name, v.value, v.std, v.unit)}"


def _measured(name: str, value: float, std: float, unit: str) -> str:
    (shown, printed), (spread, _) = (scaled(name, number, unit) for number in (value, std))
    return f"{style.uncertain(shown, spread)} {printed}".rstrip()


def scaled(name: str, value: float, unit: str) -> tuple[float, str]:
    """Return a parameter in SI units as reports show it: angles in degrees, frequencies in Hz, lags in ms."""
    if "frequency" in name and unit == "rad/s":
        return value / (2 * math.pi), "Hz"
    if unit == "s" and ("lag" in name or "delay" in name):
        return 1e3 * value, "ms"
    angle = unit == "rad" or unit.startswith("rad/")
    return (math.degrees(value) if angle else value), print_unit(unit.replace("rad", "deg", 1) if angle else unit)
