"""Sections of a trace's report: where something is missing, what is unmodelled, and what the innovations depend on."""

from __future__ import annotations

from functools import partial

import numpy as np

from harness.diagnosis.report import residual_figures
from harness.diagnosis.residuals.dependence import regressors_of
from harness.diagnosis.residuals.innovation_tests import LARGEST_LAG, consistency, cross_correlation
from harness.diagnosis.residuals.localisation import Localisation
from harness.diagnosis.residuals.unmodelled import UnmodelledDisturbance
from harness.diagnosis.result.answer import amount, entry, unmodelled_words
from harness.diagnosis.result.outcome import Outcome
from harness.diagnosis.result.record import equation
from harness.models.assembly.plan import planner
from harness.models.quantities import capital, words
from harness.models.roles import VEHICLES
from harness.reporting import style
from harness.reporting.document import (
    Block,
    Bullets,
    Drawing,
    Prose,
    Section,
    Sheet,
    plain,
    strong,
)


def where(outcome: Outcome) -> list[Block]:
    """Return where an unknown disturbance would explain most, and its smoothed course."""
    localisation = outcome.localisation
    if localisation.nominal is None or localisation.final is None:
        return [Prose(plain("It could not be computed."))]
    if not localisation.shown:
        sentence = "Nowhere: no slowly varying disturbance raises the likelihood of the drives."
        return [Prose(strong(sentence))]
    first = localisation.shown[0]
    size = (
        f"with a standard deviation of {amount(first.deviation, first.disturbance_input)} and a time constant of "
        f"{style.number(first.time_constant)} s."
    )
    place = entry(first.disturbance_input)
    sentence = strong(f"A disturbance of the {place} would explain most, {size}")
    if outcome.verdict == "adequate":
        nothing = "" if outcome.baseline else "Nothing is missing that these drives can show. "
        sentence = plain(f"{nothing}A disturbance would absorb something all the same, one of the {place} most, {size}")
    caveat = (
        "An unknown Gauss-Markov disturbance is put into each equation, each published force, moment or angle and each "
        "sensor in turn. The ranking is a hint: inputs of similar effect share the gain, and a disturbance absorbs "
        "whatever the model does not explain, random errors included."
    )
    title = "Gain in log-likelihood by an unknown disturbance at each input, nominal model and final one."
    return [
        Prose(sentence),
        Prose(plain(caveat)),
        Drawing(
            partial(residual_figures.ranking, localisation.nominal.ranked_inputs, localisation.final.ranked_inputs),
            title,
            title,
        ),
        Section(lambda: _histories(localisation), "How would the disturbance look?", headed=False),
    ]


def from_above(outcome: Outcome) -> list[Block]:
    """Return the vehicle from above, for the first page; nothing if its equations do not say where its axles stand."""
    localisation, augmented = outcome.localisation, outcome.trace.fitting.augmented
    if localisation.nominal is None or not localisation.shown:
        return []
    plan = planner(augmented.nominal, VEHICLES.load(augmented.spec.vehicle)).plan(augmented.spec.values)
    if plan is None:
        return []
    caption = (
        "The vehicle from above, not to scale across. The area of a mark is the gain in log-likelihood of the "
        "nominal model by a disturbance there; numbers are ranks. Inputs at the same place are drawn side by side."
    )
    effects = [h for h in outcome.added if h.kind == "effect"]
    added = {words(h.name.replace("@", " of ")): list(equation(h, outcome)) for h in effects}
    draw = partial(residual_figures.picture, plan, localisation.nominal.ranked_inputs, added)
    return [Drawing(draw, caption, "Top view of the vehicle with marks where a disturbance may act.")]


def _histories(localisation: Localisation) -> list[Block]:
    """Return the disturbances over the drive in which they stand out most from their errors."""
    assert localisation.nominal is not None
    clarity = [np.mean([np.mean((h[i].mean / h[i].error.mean()) ** 2) for h in localisation.histories])
               for i in range(len(localisation.nominal.drives))]  # fmt: skip
    i = int(np.argmax(clarity))
    drive = localisation.nominal.drives[i]
    caption = f"Smoothed disturbance of the nominal model over {drive.name}, with its 95 % band, one input at a time."
    draw = partial(residual_figures.histories, drive, localisation.shown, [h[i] for h in localisation.histories])
    return [Drawing(draw, caption, f"Disturbances over time in {drive.name} with bands.")]


def unmodelled(outcome: Outcome) -> list[Block]:
    """Return the disturbance that no effect of the library explains, if one was found."""
    disturbance = outcome.localisation.unmodelled
    if disturbance is None:
        return []
    blocks: list[Block] = [
        Bullets([strong(_sentence(text)) for text in unmodelled_words(disturbance)]),
        Prose(plain(_study_gain(outcome, disturbance))),
    ]
    return [*blocks, *_periodic(disturbance), *_curves(outcome, disturbance)]


def _periodic(disturbance: UnmodelledDisturbance) -> list[Block]:
    if not disturbance.periodic:
        return []
    caption = (
        "Gain in log-likelihood of the fitted drives by a disturbance that is periodic in the distance driven, at "
        "the input where it gains most; each drive has its own phase. Mark: what was taken. A wheel turns once per "
        "circumference; a half or a third of that is one of its orders."
    )
    draw = partial(residual_figures.spectra, disturbance.periodic)
    return [Drawing(draw, caption, "Gain over the wavelength.")]


def _curves(outcome: Outcome, disturbance: UnmodelledDisturbance) -> list[Block]:
    if not disturbance.curves or outcome.localisation.final is None:
        return []
    return [
        Drawing(
            partial(residual_figures.curves, outcome.localisation.final, disturbance.curves),
            "Curves fitted to the innovations of the fitted drives. Points: mean of the disturbance that the smoother "
            "estimates without the signal; it shrinks towards zero where the drives carry little information.",
            "Disturbance over the signal that it depends on, with its band.",
        ),
        Sheet(
            ["input", "depends on", "stability", "predicted gain"],
            [
                [entry(c.disturbance_input), c.regressor.words, style.percent(c.stability), style.number(c.predicted)]
                for c in disturbance.curves
            ],
            "Stability: share of the halves of the fitted drives in which the lasso selected the pair. "
            "Predicted gain: in log-likelihood of each fitted drive, from the curve fitted to the others.",
            left=2,
        ),
    ]


def _sentence(text: str) -> str:
    return f"{capital(text)}."


def _study_gain(outcome: Outcome, disturbance: UnmodelledDisturbance) -> str:
    before, after = outcome.trace.after.normalised_excess_mse, disturbance.judgement.normalised_excess_mse
    moved = f"The log-likelihood of the held-out drives rises by {style.number(disturbance.held_out_gain)}."
    parts = []
    if disturbance.curves:
        parts.append("the curves are functions of the simulated motion and the recorded inputs, not of the measured "
                     "motion")  # fmt: skip
    if disturbance.periodic:
        parts.append("what is periodic has the phase that fits the drive best")
    fed = f"In the simulation, {', and '.join(parts)}."
    if after < before:
        return f"{moved} Their excess falls from {style.number(before)} to {style.number(after)}. {fed}"
    return f"{moved} Their simulation error does not fall, so the final model is the one without it. {fed}"


def innovations(outcome: Outcome) -> list[Block]:
    """Return whether the innovations are as large as the filter states, and which signals they depend on."""
    if outcome.localisation.final is None:
        return []
    augmented, linear = outcome.trace.fitting.augmented, outcome.localisation.final.linear
    regressors = regressors_of(augmented)
    whitened = [p.whitened for p in linear]
    checks = [consistency(p.drive.time[1:], w[1:]) for p, w in zip(linear, whitened, strict=True)]
    signals = [np.column_stack([d.over(p.states, p.drive) for d in regressors]) for p in linear]
    correlation = cross_correlation([w[1:] for w in whitened], [s[1:] for s in signals], augmented.spec.step)
    outputs = list(augmented.model.outputs)
    share = np.abs(correlation.values / correlation.band[:, None])
    _, a, j = np.unravel_index(int(np.argmax(share)), share.shape)
    sentence = (
        f"The largest correlation is that of the innovation of the {words(outputs[a])} with the past of the "
        f"{regressors[j].words}: {style.number(share.max())} times the 95 % band of white innovations."
        if share.max() > 2.0
        else "No innovation is correlated with the past of a signal by more than twice the band of white innovations."
    )
    return [
        Prose(plain(sentence)),
        Drawing(
            partial(residual_figures.nis, [p.drive.name for p in linear], checks),
            "Normalised innovation squared of the final model over the number of measured values, mean of a second, "
            "with its 95 % band for a consistent filter.",
            "Normalised innovation squared over time with its band.",
        ),
        Drawing(
            partial(residual_figures.correlations, correlation, outputs, regressors),
            f"Correlation of the whitened innovations of the final model with signals up to {LARGEST_LAG:g} s before, "
            "all fitted drives; grey: the 95 % band of white innovations. Drawn are the signals with the largest "
            "correlations.",
            "Cross-correlations of innovations and earlier signals.",
        ),
    ]
