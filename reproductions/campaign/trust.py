"""Trust monitors of the campaign: what innovations say of errors, by factor and size."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

from harness.models.quantities import words
from harness.reporting.document import Block, Drawing, Linked, Prose, Sheet, plain
from harness.reporting.style import number
from harness.study.report.sections.trust import area, beyond, delay, figures, share
from harness.study.trust_file import EstimatorTrust, LevelTrust, StudyTrust, TargetTrust
from reproductions.campaign import on_study
from reproductions.campaign.results import Results


def _counted(campaign: Results) -> Iterator[tuple[str, StudyTrust, EstimatorTrust, TargetTrust]]:
    """Go through what was counted, by study, estimator and target."""
    for study, store in campaign.stores.items():
        if store.trust is not None:
            for each in store.trust.estimators:
                for target in each.targets:
                    yield study, store.trust, each, target


def in_short(campaign: Results) -> str:
    """Say for each estimator that is watched what its monitor says at the worst level of each study."""
    of_estimators: dict[tuple[str, str], list[tuple[LevelTrust, StudyTrust]]] = {}
    for _, trust, each, target in _counted(campaign):
        if target.drawn:
            worst = max(target.drawn, key=lambda level: level.wrong)
            key = each.estimator, beyond(target.target, target.limit)
            of_estimators.setdefault(key, []).append((worst, trust))
    sentences = []
    for (estimator, error), levels in of_estimators.items():
        parts = [f"{level.label} {share(level.wrong)}, of these {share(level.said)}" for level, _ in levels]
        sentences.append(
            f"{estimator}: samples in which {error}, and share of these that its monitor says within "
            f"{levels[0][1].within:g} s: {'; '.join(parts)}."
        )
    return " ".join(sentences)


def blocks(campaign: Results, out: Path) -> list[Block]:
    """Return the table of all levels and the curves of detection of each study; nothing where none was counted."""
    rows: list[list[str | Linked]] = []
    times = set()
    for study, trust, each, target in _counted(campaign):
        times.add(f"{trust.within:g} s")
        report = on_study.linked(words(study), campaign.folder / study / "report.html", out)
        alarms = f"{number(each.alarms.value, 2)} ({number(each.alarms.lower, 2)} to {number(each.alarms.upper, 2)})"
        for i, level in enumerate(target.drawn):
            numbers = [share(level.wrong), share(level.said), delay(level.delay), area(level), share(level.false)]
            first: list[str | Linked] = ["", "", ""] if i else [report, each.estimator, alarms]
            rows.append([*first, level.label, *numbers])
    if not rows:
        return []
    text = (
        "A trust monitor watches the innovations of a filter; its bounds are set by the false alarms allowed in an "
        "hour as believed, and what it says is counted at every level of a study (docs/monitor.md)."
    )
    header = ["study", "estimator", "false alarms/h", "level", "in error", "said", "delay", "area", "alarm, no error"]
    caption = (
        "False alarms in an hour where all is as believed and the limits are kept, with their 95 % interval; at each "
        "level with errors the share of the samples in error, the share of these at which an alarm stands or begins "
        f"within {', '.join(sorted(times))}, the median delay of the first alarm, the area under the curve of "
        "detection over false alarms with its 95 % interval (0.5 is guessing), and the share of right samples in an "
        "alarm."
    )
    content: list[Block] = [Prose(plain(text)), Sheet(header, rows, caption, left=4)]
    for study, store in campaign.stores.items():
        for figure in figures(store.trust) if store.trust is not None else ():
            if isinstance(figure, Drawing):
                content.append(replace(figure, caption=f"{words(study).capitalize()}. {figure.caption}"))
    return content
