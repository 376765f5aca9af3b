"""The answer in one or two sentences: how much the error grows where plant and belief differ most.

The report opens with it and ``harness run`` ends with it. It is built from names and numbers of the store alone, so it
fits any study: one level or many, any number of factors, targets and estimators.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from harness.models.quantities import Quantity, listed
from harness.reporting.style import number, with_unit
from harness.study.report.analysis import Findings
from harness.study.results import Design
from harness.study.scores import ESTIMATOR_DIVERGED, OK, PENDING, PLANT_DIVERGED

ALIKE = 0.03
"""Estimators whose medians differ by less than this share are told in one number."""

NAMED = 4
"""Factors of a design up to which each is named."""

_STEADY = 0.02
_BOUNDS = (0.1, 0.2, 0.5, 1.0, 2.0, 3.0)  # percent


def answer_in_short(findings: Findings, designs: Sequence[Design] = ()) -> str:
    """Return the answer of a design; ``headline`` of the package does the same for a result folder.

    Args:
        findings: Of the design that the answer is about.
        designs: All designs of the study, whose lost runs are counted; that one alone by default.
    """
    design = findings.design
    medians = np.where(findings.comparable, findings.medians, np.nan)
    changes = [_change(design, target, medians[k]) for k, target in enumerate(design.targets)]
    known = [c for c in changes if c is not None]
    lost = _lost(designs or [design])
    if not known:
        return " ".join(["No run has a score.", *lost])
    lost += _left_out(design, [name for change in known for name in change.names])
    clauses: list[str] = []
    for worst in dict.fromkeys((c.home, c.worst) for c in known):
        group = [c for c in known if (c.home, c.worst) == worst]
        texts = [c.text("that of the" if clauses or k else "the median error of the") for k, c in enumerate(group)]
        told = "; ".join(texts) if any("," in text for text in texts) else listed(texts)
        clauses.append(f"{_where(design, *worst, first=not clauses)} {told}")
    text = "; ".join(clauses)
    alike = [c for c in known if not c.differs and len(c.names) > 1]
    if alike:
        bound = next(b for b in (*_BOUNDS, 100.0) if 100 * max(c.spread for c in alike) < b)
        of = "" if len(alike) == len(known) else f" in the {listed([c.quantity.words for c in alike])}"
        text += f"; {_everyone(alike[0].names)} differ by less than {bound:g} %{of}"
    return " ".join([f"{text[:1].upper()}{text[1:]}.", *lost])


@dataclass(frozen=True)
class _Change:
    """How the median error of one target changes from the band that is believed to the worst one.

    Attributes:
        quantity: The target.
        names: Estimators with a score in both bands.
        among: Number of all estimators.
        home: Band compared with; None where there is only one band.
        worst: Band of the largest growth.
        before: Median per estimator in ``home``.
        after: Median per estimator in ``worst``.
    """

    quantity: Quantity
    names: tuple[str, ...]
    among: int
    home: int | None
    worst: int
    before: NDArray[np.float64]
    after: NDArray[np.float64]

    @property
    def spread(self) -> float:
        """Largest over smallest median, less one, in the worse of the two bands."""
        pairs = [self.after] if self.home is None else [self.before, self.after]
        return max(float(v.max() / v.min()) - 1.0 if v.min() > 0 else 0.0 for v in pairs)

    @property
    def differs(self) -> bool:
        """Whether the estimators have to be told apart."""
        return len(self.names) > 1 and self.spread >= ALIKE

    def text(self, subject: str) -> str:
        """Say it, e.g. ``the median error of the sideslip angle grows from 0.2 to 2.4° (12 times)``."""
        best = int(np.argmin(self.after)) if self.differs else 0
        before, after, unit = float(self.before[best]), float(self.after[best]), self.quantity.unit
        if self.home is None:
            change, other = f"is {with_unit(after, unit)}", ""
        elif before > 0 and after / before < 1 + _STEADY:
            change, other = f"stays at {with_unit(before, unit)}", "is "
        else:
            change = f"grows from {number(before)} to {with_unit(after, unit)} ({_times(before, after)})"
            other = "to "
        return f"{subject} {self.quantity.words} {change}{self._others(best, other)}"

    def _others(self, best: int, verb: str) -> str:
        """Return which estimator that was, and behind a verb the worst one if they have to be told apart."""
        if len(self.names) == 1 < self.among:
            return f" with {self.names[0]}"  # all others lost more runs
        if not self.differs:
            return ""
        last = int(np.argmax(self.after))
        other = f"{verb}{with_unit(float(self.after[last]), self.quantity.unit)} with {self.names[last]}"
        if len(self.names) == 2:
            return f" with {self.names[best]} and {other}"
        worst = "" if self.home is None else ", the worst"
        return f" with {self.names[best]}, the best of {len(self.names)}, and {other}{worst}"


def _times(before: float, after: float) -> str:
    if not before > 0:
        return "from nothing"
    growth = after / before
    return f"{100 * (growth - 1):.0f} % more" if growth < 1.5 else f"{number(growth, 2)} times"


def _change(design: Design, quantity: Quantity, medians: NDArray[np.float64]) -> _Change | None:
    """Return the largest growth of a target over ``medians[band, estimator]``; None without a score."""
    known = np.isfinite(medians)
    scored = np.asarray(known.any(axis=1))
    if not scored.any():
        return None
    home = design.matched
    if home is None or not scored[home]:
        home = int(np.argmin(_least(medians)))
    with np.errstate(invalid="ignore", divide="ignore"):
        growth = _most(medians / medians[home])
    growth[home] = -np.inf  # an estimator that scores nothing in either band has grown by nothing
    worst = int(np.argmax(growth))
    compared = bool(np.isfinite(growth[worst]))
    both = known[home] & known[worst] if compared else known[home]
    worst = worst if compared else home
    names = tuple(name for name, chosen in zip(design.estimators, both, strict=True) if chosen)
    among = len(design.estimators)
    return _Change(quantity, names, among, home if compared else None, worst, medians[home][both], medians[worst][both])


def _least(medians: NDArray[np.float64]) -> NDArray[np.float64]:
    return np.min(np.where(np.isfinite(medians), medians, np.inf), axis=1)


def _most(values: NDArray[np.float64]) -> NDArray[np.float64]:
    return np.max(np.where(np.isfinite(values), values, -np.inf), axis=1)


def _where(design: Design, home: int | None, worst: int, first: bool) -> str:
    """Say which level is meant and what it is compared with, e.g. ``with the trailer mass at 8 t``."""
    label = design.bands[worst]
    if not design.factors:
        return "in the case as stated"
    if design.sampling == "saltelli":
        return f"over the whole box of {varied(design)}"
    believed = home is not None and home == design.matched
    single = len(design.factors) == 1 or label.startswith("±")
    within = label.startswith("±")
    if not single:
        named = all(f.words in label for f in design.factors)
        text = f"with {label}" if named else f"at the level {label}"
    elif within:
        text = f"with the {varied(design)} within {label}"
    else:
        owner = "believed to be" if design.factors[0].of == "belief" else "at"
        text = f"with the {varied(design)} {owner} {label}"
    if home is None or not first:
        return text
    other = design.bands[home]
    if within:
        return f"{text} instead of {other}"
    if believed and all(f.of == "plant" for f in design.factors[: 1 if single else None]):
        return f"{text} instead of the believed {other},"
    return f"{text} instead of {other},"


def at(design: Design, band: int) -> str:
    """Say at which level, e.g. ``at 24 t``."""
    return "over the whole box" if design.sampling == "saltelli" else f"at {design.bands[band]}"


def varied(design: Design) -> str:
    """Name the factors of a design; of more than ``NAMED`` say only how many there are."""
    names = [f.words for f in design.factors]
    return listed(names) if len(names) <= NAMED else f"{len(names)} factors"


def _everyone(names: Sequence[str]) -> str:
    return listed(names) if len(names) <= 4 else f"the {len(names)} estimators"


def _left_out(design: Design, compared: Sequence[str]) -> list[str]:
    """Name the estimators that the answer says nothing of: their medians are those of the runs that they survived."""
    others = [name for name in design.estimators if name not in compared]
    if not others:
        return []
    return [f"Not compared, as more of {'its' if len(others) == 1 else 'their'} runs were lost: {listed(others)}."]


def _lost(designs: Sequence[Design]) -> list[str]:
    """Say how many runs of the designs have no score."""
    found = []
    total = sum(d.status.size for d in designs)
    runs = f"{total} runs" if len(designs) == 1 else f"{total} runs of all {len(designs)} designs"
    for fate, text in (
        (ESTIMATOR_DIVERGED, "the estimator diverged"),
        (PLANT_DIVERGED, "the plant left its range"),
    ):
        counts: dict[str, int] = {}
        for design in designs:
            for e, name in enumerate(design.estimators):
                counts[name] = counts.get(name, 0) + design.count(fate, None, e)
        some = [f"{name} {count}" for name, count in counts.items() if count]
        if some:
            who = f" ({', '.join(some)})" if fate != PLANT_DIVERGED and len(some) <= 8 else ""
            found.append(f"in {sum(counts.values())} {text}{who}")
    pending = sum(d.count(PENDING) for d in designs)
    sentences = [f"Of {runs}, {listed(found)}."] if found else []
    if pending:
        sentences.append(f"{pending} of {runs} are still to come.")
    assert found or pending or sum(d.count(OK) for d in designs) == total
    return sentences
