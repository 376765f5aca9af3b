"""Several studies side by side: what they share, where their boxes stand, and which runs of theirs pair."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from harness.common.errors import UserError
from harness.models.quantities import Quantity, listed, words
from harness.study.report.analysis import Analysis
from harness.study.report.sections.boxes import factors_of
from harness.study.results import Design
from harness.view.boxes import scores_of


@dataclass(frozen=True)
class Slot:
    """Where boxes stand in a figure: one level of one study.

    Attributes:
        study: Index of the study.
        band: Index of the level in its design.
    """

    study: int
    band: int


@dataclass(frozen=True)
class Beside:
    """Studies and what they share.

    Attributes:
        names: Of the result folders, no two alike.
        analyses: Of each study.
        designs: Names of the designs that any of them has, in the order of the studies.
        targets: What all of them score.
        estimators: Names of the estimators that any of them has.
    """

    names: tuple[str, ...]
    analyses: tuple[Analysis, ...]
    designs: tuple[str, ...]
    targets: tuple[Quantity, ...]
    estimators: tuple[str, ...]

    def number(self, study: int, name: str) -> int:
        """Return the index of a study's design of a name; that of its first one if it has none such."""
        names = [d.name for d in self.analyses[study].store.designs]
        return names.index(name) if name in names else 0

    def design(self, study: int, name: str) -> Design:
        """Return a study's design of a name; its first one if it has none such."""
        return self.analyses[study].store.designs[self.number(study, name)]

    def scores(self, study: int, name: str, score: str, target: int) -> NDArray[np.float64]:
        """Return a score of all runs, ``(band, estimator, drive, sample, repeat)`` as in the design."""
        design = self.design(study, name)
        return scores_of(design, score, list(map(_key, design.targets)).index(_key(self.targets[target])))

    def slots(self, studies: Sequence[int], name: str) -> list[Slot]:
        """Return the levels of some studies, study by study."""
        return [Slot(k, band) for k in studies for band in range(len(self.design(k, name).bands))]

    def level(self, slot: Slot, name: str) -> tuple[str, str]:
        """Return the level of a slot: what varies, and the label. Two slots of one level stand side by side."""
        design = self.design(slot.study, name)
        return factors_of(design), design.bands[slot.band]

    def unpaired(self, study: int, name: str) -> str:
        """Return why the runs of a study are not those of the first one, in words; nothing where they are.

        Runs pair where the studies draw the same random numbers for them: seed, design, levels, drives, points and
        repeats agree.
        """
        first, other = self.design(0, name), self.design(study, name)
        seeds = [self.analyses[k].store.seed for k in (0, study)]
        if seeds[0] != seeds[1]:
            return f"seed {seeds[1]} instead of {seeds[0]}"
        if first.name != other.name:
            return f"no design of the same name ('{words(other.name)}' instead of '{words(first.name)}')"
        if first.bands != other.bands or _varied(first) != _varied(other):
            return f"the design '{words(first.name)}' has other factors or levels"
        if first.drives != other.drives:
            return f"the design '{words(first.name)}' has other drives"
        if first.status.shape[2:] != other.status.shape[2:]:
            return f"the design '{words(first.name)}' has another number of points or repeats"
        if not all(np.array_equal(a.values, b.values) for a, b in zip(first.factors, other.factors, strict=True)):
            return f"the design '{words(first.name)}' has other points"
        if not set(first.estimators) & set(other.estimators):
            return "no estimator of the same name"
        return ""


def beside(folders: Sequence[Path], analyses: Sequence[Analysis]) -> Beside:
    """Return studies with what they share.

    Raises:
        UserError: If one has no target in common with those before it.
    """
    full = [f.resolve() for f in folders]
    names = [f.name for f in full]
    if len(set(names)) < len(names):
        names = [str(f) for f in full]
    targets = list(analyses[0].store.designs[0].targets)
    for folder, analysis in zip(folders, analyses, strict=True):
        for design in analysis.store.designs:
            own = {_key(t) for t in design.targets}
            both = [t for t in targets if _key(t) in own]
            if not both:
                raise UserError(
                    f"{folder}: scores {_listed(design.targets)}, and not {_listed(targets)} as {folders[0]}; "
                    "side by side are shown studies that have a target in common"
                )
            targets = both
    designs = dict.fromkeys(d.name for a in analyses for d in a.store.designs)
    estimators = dict.fromkeys(e for a in analyses for d in a.store.designs for e in d.estimators)
    return Beside(tuple(names), tuple(analyses), tuple(designs), tuple(targets), tuple(estimators))


def arranged(slots: Sequence[Slot], levels: Sequence[tuple[str, str]], by_level: bool) -> list[int]:
    """Return the order in which slots stand: level by level with the studies side by side, or study by study."""
    if not by_level:
        return list(range(len(slots)))
    first = {level: i for i, level in reversed(list(enumerate(levels)))}
    return sorted(range(len(slots)), key=lambda i: (first[levels[i]], i))


def _key(target: Quantity) -> tuple[str, str]:
    return target.name, target.unit


def _varied(design: Design) -> list[tuple[str, str]]:
    return [(f.name, f.of) for f in design.factors]


def _listed(targets: Sequence[Quantity]) -> str:
    return listed([t.words for t in targets])
