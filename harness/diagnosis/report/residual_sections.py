"""Sections of a trace's report: where something is missing, what has no name, and what the innovations hang on."""

from __future__ import annotations

from functools import partial

import numpy as np

from harness.diagnosis.model.augmented_model import Whole
from harness.diagnosis.report import residual_figures, vehicle_picture
from harness.diagnosis.residuals.innovation_tests import LARGEST_LAG, consistency, cross_correlation
from harness.diagnosis.residuals.localisation import Where
from harness.diagnosis.residuals.regressors import drivers_of
from harness.diagnosis.residuals.unmodelled import Unnamed
from harness.diagnosis.result.outcome import Outcome
from harness.diagnosis.result.wording import amount, entry, unnamed_words
from harness.models.quantities import words
from harness.reporting import style
from harness.reporting.document import (
    Block,
    Bullets,
    Drawing,
    Heading,
    Prose,
    Section,
    Sheet,
    plain,
    strong,
)


def where(outcome: Outcome) -> list[Block]:
    """Return where an unknown disturbance would explain most, and how it would look."""
    found, whole = outcome.where, outcome.trace.fitting.whole
    blocks: list[Block] = [Heading("Where is something missing?")]
    if found.nominal is None or found.final is None:
        return [*blocks, Prose(plain("It could not be looked for."))]
    if not found.shown:
        said = "Nowhere: no slowly varying disturbance makes the drives likelier."
        return [*blocks, Prose(strong(said))]
    first = found.shown[0]
    said = (
        f"Most would be explained by a disturbance of the {entry(first.channel)} of some "
        f"{amount(first.deviation, first.channel)} that changes within {style.number(first.time_constant)} s."
    )
    caveat = (
        "An unknown Gauss-Markov disturbance is put into each equation, each published force, moment or angle and each "
        "sensor in turn. It is a hint: entries that act alike take from each other, and a disturbance follows whatever "
        "the model does not explain, also what is random."
    )
    title = "Gain in log-likelihood by an unknown disturbance at each entry, nominal model and final one."
    blocks += [
        Prose(strong(said)),
        Prose(plain(caveat)),
        Drawing(partial(residual_figures.ranking, found.nominal.suspects, found.final.suspects), title, title),
        Section(lambda: _from_above(whole, found), "Where on the vehicle?"),
        Section(lambda: _histories(found), "How would the disturbance look?"),
    ]
    return blocks


def _from_above(whole: Whole, found: Where) -> list[Block]:
    """Return the vehicle from above; nothing if its equations do not say where its axles stand."""
    assert found.nominal is not None
    plan = vehicle_picture.plan_of(whole)
    if plan is None:
        return []
    caption = (
        "The vehicle from above, not to scale across. The area of a mark is the gain in log-likelihood of the "
        "nominal model; numbers are ranks. Entries at the same place stand beside each other."
    )
    draw = partial(vehicle_picture.picture, plan, found.nominal.suspects)
    return [Drawing(draw, caption, "Top view of the vehicle with marks where a disturbance may act.")]


def _histories(found: Where) -> list[Block]:
    """Return the disturbances over the drive in which they stand out most from their errors."""
    assert found.nominal is not None
    clarity = [np.mean([np.mean((h[i].mean / h[i].error.mean()) ** 2) for h in found.histories])
               for i in range(len(found.nominal.drives))]  # fmt: skip
    i = int(np.argmax(clarity))
    drive = found.nominal.drives[i]
    caption = f"Smoothed disturbance of the nominal model over {drive.name}, with its 95 % band, one entry at a time."
    draw = partial(residual_figures.histories, drive, found.shown, [h[i] for h in found.histories])
    return [Drawing(draw, caption, f"Disturbances over time in {drive.name} with bands.")]


def unnamed(outcome: Outcome) -> list[Block]:
    """Return what is missing without a name, if anything was found."""
    found = outcome.where.unnamed
    if found is None:
        return []
    blocks: list[Block] = [
        Heading("What is missing without a name?"),
        Bullets([strong(_sentence(text)) for text in unnamed_words(found)]),
        Prose(plain(_worth(outcome, found))),
    ]
    return [*blocks, *_turning(found), *_curves(outcome, found)]


def _turning(found: Unnamed) -> list[Block]:
    if not found.turning:
        return []
    caption = (
        "Gain in log-likelihood of the fitted drives by a disturbance that comes back with the distance driven, at the "
        "entry where it gains most; each drive has its own phase. Mark: what was taken. A wheel turns once per "
        "circumference; a half or a third of that is an order of it."
    )
    draw = partial(residual_figures.spectra, found.turning)
    return [Drawing(draw, caption, "Gain over the distance after which it comes back.")]


def _curves(outcome: Outcome, found: Unnamed) -> list[Block]:
    if not found.curves or outcome.where.final is None:
        return []
    return [
        Drawing(
            partial(residual_figures.curves, outcome.where.final, found.curves),
            "Curves fitted to the innovations of the fitted drives. Points: mean of the disturbance that the smoother "
            "finds without knowing the signal; it is drawn towards zero where the drives say little.",
            "Disturbance over the signal that drives it, with a band.",
        ),
        Sheet(
            ["entry", "driver", "stability", "predicted gain"],
            [
                [entry(c.channel), c.driver.words, style.percent(c.stability), style.number(c.predicted)]
                for c in found.curves
            ],
            "Stability: share of the halves of the fitted drives in which a sparse dictionary chose the pair. "
            "Predicted gain: in log-likelihood of each fitted drive, from the curve fitted to the others.",
            left=2,
        ),
    ]


def _sentence(text: str) -> str:
    return f"{text[:1].upper()}{text[1:]}."


def _worth(outcome: Outcome, found: Unnamed) -> str:
    before, after = outcome.trace.after.excess, found.judgement.excess
    moved = f"The held-out drives become likelier by {style.number(found.held_out_gain)} in log-likelihood."
    parts = []
    if found.curves:
        parts.append("the curves are fed by the motion of the model itself and by the recorded inputs, not by the "
                     "measured motion")  # fmt: skip
    if found.turning:
        parts.append("what turns has the phase that suits the drive")
    fed = f"Free running, {', and '.join(parts)}."
    if after < before:
        return f"{moved} Their excess falls from {style.number(before)} to {style.number(after)}. {fed}"
    return f"{moved} Their free-running error does not fall, so the final model is the one without. {fed}"


def innovations(outcome: Outcome) -> list[Block]:
    """Return whether the innovations are as large as the filter says, and what they hang on."""
    if outcome.where.final is None:
        return []
    whole, linear = outcome.trace.fitting.whole, outcome.where.final.linear
    drivers = drivers_of(whole)
    whitened = [p.whitened for p in linear]
    checks = [consistency(p.drive.time[1:], w[1:]) for p, w in zip(linear, whitened, strict=True)]
    signals = [np.column_stack([d.over(p.states, p.drive) for d in drivers]) for p in linear]
    found = cross_correlation([w[1:] for w in whitened], [s[1:] for s in signals], whole.spec.step)
    outputs = list(whole.model.outputs)
    share = np.abs(found.values / found.band[:, None])
    _, a, j = np.unravel_index(int(np.argmax(share)), share.shape)
    said = (
        f"Most of all, the innovation of the {words(outputs[a])} hangs on the {drivers[j].words}, "
        f"{style.number(share.max())} times the band of white noise."
        if share.max() > 2.0
        else "No innovation hangs on the past of a signal."
    )
    return [
        Prose(plain(said)),
        Drawing(
            partial(residual_figures.nis, [p.drive.name for p in linear], checks),
            "Normalised innovation squared of the final model over the number of measured values, mean of a second, "
            "with the band in which it stays 95 times of 100 if the filter states its uncertainty rightly.",
            "Normalised innovation squared over time with its band.",
        ),
        Drawing(
            partial(residual_figures.correlations, found, outputs, drivers),
            f"Correlation of the whitened innovations of the final model with signals up to {LARGEST_LAG:g} s before, "
            "all fitted drives; grey: where that of white innovations stays 95 times of 100. Drawn are the signals on "
            "which any innovation hangs most.",
            "Cross-correlations of innovations and earlier signals.",
        ),
    ]
