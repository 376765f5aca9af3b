"""The part of a trace's report that says what the amendment gains in a study."""

from __future__ import annotations

import numpy as np
import xarray as xr

from harness.diagnosis.result.study_gain import StudyGain
from harness.models.quantities import listed, words
from harness.reporting import style
from harness.reporting.document import Block, Prose, Sheet, plain, strong
from harness.study.report.analysis import Analysis
from harness.study.report.sections import boxes
from harness.study.results import Design, StudyResults

BELIEFS = ("nominal", "amended")


def blocks(study_gain: StudyGain | str | None) -> list[Block]:
    """Return the section: in a sentence, as box plots and as a table; nothing where no study was asked for."""
    if study_gain is None:
        return []
    if isinstance(study_gain, str):
        return [Prose(plain(study_gain))]
    analysis = _analysis(study_gain)
    return [
        Prose(strong(answer(study_gain))),
        Prose(plain(_explain(study_gain))),
        *boxes.pictures(analysis, analysis.main),
        _table(study_gain),
    ]


def answer(study_gain: StudyGain) -> str:
    """Return what believing the amended model does to the median errors, in a sentence."""
    matched = study_gain.amended.matched
    parts = [] if matched is None else [f"{_shares(study_gain, matched)}{_at(study_gain, matched)}"]
    if len(study_gain.amended.bands) > 1:
        parts.append(f"{_shares(study_gain, None)} over all levels")
    elif matched is None:
        parts.append(_shares(study_gain, None))
    return f"Of the median error with the nominal model believed, the amended one leaves {'; '.join(parts)}."


def _at(study_gain: StudyGain, band: int) -> str:
    design = study_gain.amended
    names = listed([f.words for f in design.factors]) if design.factors else ""
    return f" with the {names} {design.matched_is} ({design.bands[band]})" if names else ""


def _shares(study_gain: StudyGain, band: int | None) -> str:
    """Return the ratios of all targets at a level as shares, each from the best to the worst estimator."""
    phrases = []
    for t, target in enumerate(study_gain.nominal.targets):
        ratios = [study_gain.gain(e, t, band).ratio for e in range(len(study_gain.nominal.estimators))]
        finite = sorted(r.value for r in ratios if np.isfinite(r.value))
        if not finite:
            phrases.append(f"nothing to compare in {target.words}")
            continue
        low, high = (style.percent(share) for share in (finite[0], finite[-1]))
        shown = any(r.upper < 1.0 or r.lower > 1.0 for r in ratios)
        share = low if low == high else f"{low.removesuffix(' %')} to {high}"
        phrases.append(f"{share} in {target.words}{'' if shown else ' (no difference shown)'}")
    return listed(phrases)


def _explain(study_gain: StudyGain) -> str:
    design = study_gain.nominal
    text = (
        f"“{study_gain.title}” ({study_gain.study}, design “{design.name}”), "
        "run again with the amended model as the plant: "
        f"{len(design.drives)} drives, {design.planned} runs per level and estimator. Both beliefs are run on the same "
        "drives and noise, each with the noise variances that were fitted with it."
    )
    if study_gain.change_times:
        begins = listed([f"{words(n)} {t:g} s" for n, t in study_gain.change_times.items()])
        text += f" Changes begin at the same time in every drive, known to the amended belief: {begins}."
    return text


def _analysis(study_gain: StudyGain) -> Analysis:
    """Return both runs of the study as one whose estimators are pairs of estimator and belief."""
    names = [f"{e}, {belief}" for e in study_gain.nominal.estimators for belief in BELIEFS]
    parts = [
        design.data[["rmse", "status"]].isel(estimator=[e])
        for e in range(len(study_gain.nominal.estimators))
        for design in (study_gain.nominal, study_gain.amended)
    ]
    like = study_gain.amended
    both = Design(
        name=like.name,
        data=xr.concat(parts, dim="estimator").assign_coords(estimator=names),
        estimators=names,
        targets=like.targets,
        drives=like.drives,
        bands=like.bands,
        factors=like.factors,
        state_dimension=like.state_dimension,
        output_dimension=like.output_dimension,
    )
    analysis = Analysis(StudyResults(study_gain.study, {"seed": study_gain.seed}, [both], []))
    own = style.looks(study_gain.nominal.estimators)
    for name, belief in ((n, b) for n in own for b in BELIEFS):
        look = own[name]
        colour = style.MEASURED if belief == "nominal" else look.colour
        analysis.looks[f"{name}, {belief}"] = style.Look(colour, look.hatch, look.marker, look.dashes)
    return analysis


def _table(study_gain: StudyGain) -> Sheet:
    levels: list[int | None] = [None]
    if study_gain.amended.matched is not None and len(study_gain.amended.bands) > 1:
        levels.insert(0, study_gain.amended.matched)
    rows = []
    for t, target in enumerate(study_gain.nominal.targets):
        for e in range(len(study_gain.nominal.estimators)):
            for g in (study_gain.gain(e, t, band) for band in levels):
                level = "all" if g.band is None else study_gain.amended.bands[g.band]
                numbers = map(style.number, (g.before, g.after, *g.ratio))
                rows.append([target.words, g.estimator, level, target.unit, *numbers, f"{g.lost[0]}, {g.lost[1]}"])
    header = ["target", "estimator", "level", "unit", "nominal", "amended", "ratio", "from", "to", "lost"]
    caption = (
        "Median RMSE with the nominal and with the amended belief, over the runs that both finished; ratio of the two "
        "with its 95 % bootstrap interval, runs resampled in pairs and by drive; lost: runs without a score with "
        "the nominal and with the amended belief."
    )
    return Sheet(header, rows, caption, left=4)
