"""State of a page as the query of its address: whoever opens the address sees the same."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any
from urllib.parse import urlencode

from harness.study.replay import Place
from harness.study.results import StudyResults
from harness.view.boxes import SCORES
from harness.view.factors import Brush
from harness.view.frame import index_of, indices_of

OFFERED = ("signals", "parameters")
"""What a reader chooses from lists of names; names that there are not are left out by who shows them."""


@dataclass(frozen=True)
class PageState:
    """Indices from 0.

    Attributes:
        design, target: What the boxes are of.
        score: One of ``harness.view.boxes.SCORES``.
        drive: The boxes are of this drive alone; ``None`` for all.
        level: Boxes of this level by drive; ``None`` for boxes by level.
        log: Whether the axis is logarithmic.
        estimators: Those with boxes.
        run: The run that is drawn, if any.
        compared: Estimators that are drawn in it.
        brush: Points of the design that are selected.
        changes: Other values in the run, by parameter of the plant, SI.
        signals: Those that are drawn over time; ``None`` for the targets.
        parameters: Of the plant, that have a slider; ``None`` for those that the page offers first.
    """

    design: int = 0
    target: int = 0
    score: str = "rmse"
    drive: int | None = None
    level: int | None = None
    log: bool = True
    estimators: tuple[int, ...] = ()
    run: Place | None = None
    compared: tuple[int, ...] = ()
    brush: Brush | None = None
    changes: Mapping[str, float] = field(default_factory=dict)
    signals: tuple[str, ...] | None = None
    parameters: tuple[str, ...] | None = None

    @property
    def query(self) -> str:
        """The query that says this."""
        entries: dict[str, Any] = {"design": self.design, "target": self.target, "score": self.score}
        entries |= {k: v for k, v in (("drive", self.drive), ("level", self.level)) if v is not None}
        entries |= {"log": int(self.log), "estimators": ".".join(map(str, self.estimators))}
        if self.brush is not None:
            entries["brush"] = self.brush.text
        entries |= {k: ",".join(v) for k in OFFERED if (v := getattr(self, k)) is not None}
        if self.run is not None:
            run = self.run
            entries["run"] = f"{run.design}.{run.band}.{run.drive}.{run.sample}.{run.repeat}"
            entries["compared"] = ".".join(map(str, self.compared))
            entries |= {f"plant.{name}": repr(value) for name, value in self.changes.items()}
        return "?" + urlencode(entries)


def read(arguments: Mapping[str, Sequence[bytes]], results: StudyResults) -> PageState:
    """Return what an address asks for; what it asks for that is not there is as if it were not asked for."""
    given = {name: values[-1].decode("utf-8", "replace") for name, values in arguments.items() if values}
    design = index_of(given.get("design"), len(results.designs)) or 0
    chosen = results.designs[design]
    every = tuple(range(len(chosen.estimators)))
    state = PageState(
        design=design,
        target=index_of(given.get("target"), len(chosen.targets)) or 0,
        score=given["score"] if given.get("score") in SCORES else "rmse",
        drive=index_of(given.get("drive"), len(chosen.drives)),
        level=index_of(given.get("level"), len(chosen.bands)),
        log=given.get("log", "1") != "0",
        estimators=indices_of(given.get("estimators"), len(every)) or every,
        brush=Brush.read(given.get("brush", ""), len(chosen.factors)),
        signals=_names(given.get("signals")),
        parameters=_names(given.get("parameters")),
    )
    run = _place(given.get("run", ""), results)
    if run is None:
        return state
    changes = {}
    for name, value in given.items():
        if name.startswith("plant."):
            try:
                changes[name.removeprefix("plant.")] = float(value)
            except ValueError:
                continue
    compared = indices_of(given.get("compared"), len(every)) or state.estimators[:3]
    return replace(state, run=run, compared=compared, changes=changes)


def _names(given: str | None) -> tuple[str, ...] | None:
    return None if given is None else tuple(filter(None, given.split(",")))


def _place(given: str, results: StudyResults) -> Place | None:
    parts = given.split(".")
    if len(parts) != 5 or index_of(parts[0], len(results.designs)) is None:
        return None
    sizes = results.designs[int(parts[0])].data.sizes
    counts = [sizes[d] for d in ("band", "drive", "sample", "repeat")]
    rest = [index_of(part, count) for part, count in zip(parts[1:], counts, strict=True)]
    band, drive, sample, repeat = rest
    if band is None or drive is None or sample is None or repeat is None:
        return None
    return Place(int(parts[0]), band, drive, sample, repeat)
