"""Report and files of ``harness estimate``: consistency and errors of estimators on recordings, estimates over time."""

from __future__ import annotations

import math
import re
from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Literal

import numpy as np
import xarray as xr

from harness.common.errors import UserError
from harness.common.files import json_text, write_files
from harness.identification.report import WHITENESS, whiteness_cells
from harness.models.quantities import listed, quantity, words
from harness.recorded import figures
from harness.recorded.run import certain_in_words, inputs_in_words
from harness.recorded.summary import RunSummary, is_coloured, outputs_of, record, references_of, signals_of, verdicts
from harness.recordings.read.write import write_recording
from harness.reporting import style
from harness.reporting.document import (
    Block,
    Bullets,
    Drawing,
    Listing,
    Prose,
    Report,
    Section,
    Sheet,
    plain,
    strong,
)

BAND = 1.96
"""Half the width of a 95 % band over the standard deviation."""


@dataclass(frozen=True)
class Estimated:
    """Estimators on recordings.

    Attributes:
        model: Name of the vehicle.
        runs: By recording, and within it in the order of the estimators.
        summaries: Of the runs, in the same order.
        warnings: What is odd about the recordings, in sentences.
    """

    model: str
    runs: Sequence[xr.Dataset]
    summaries: Sequence[RunSummary]
    warnings: Sequence[str] = ()

    @property
    def answer(self) -> str:
        """Whether model and noise fit, and which estimator is nearest to each reference, in sentences."""
        return f"{verdicts(self.summaries)}{_best(self)}"

    def by_recording(self) -> dict[str, list[xr.Dataset]]:
        """Return the runs by recording."""
        runs: dict[str, list[xr.Dataset]] = {}
        for run in self.runs:
            runs.setdefault(run.attrs["recording"], []).append(run)
        return runs


def report(estimated: Estimated, command: str) -> Report:
    """Return the report.

    Args:
        estimated: The runs.
        command: How it was made, for the last section.
    """
    sections = [
        Section(lambda: _answer(estimated), "Which estimator fits these recordings?"),
        Section(lambda: _comparison(estimated), "How do the estimators compare?"),
        Section(lambda: _parameters(estimated), "What are the unknown parameters?"),
        Section(lambda: _errors(estimated), "How large are the errors?"),
        Section(lambda: _over_time(estimated), "What is estimated?"),
        Section(lambda: _innovations(estimated), "Do the innovations fit what is stated of them?"),
        Section(lambda: _made(estimated, command), "How was it made?"),
    ]
    return Report(f"What do estimators say of {words(estimated.model)} on these recordings?", sections)


def _parameters(estimated: Estimated) -> list[Block]:
    """Return what was found of parameters that the estimators do not know; nothing where there are none."""
    rows = []
    for s in estimated.summaries:
        for name, (value, std) in s.parameters.items():
            q = quantity(name)
            sizes = [style.number(q.scale * v) for v in (value, BAND * std)]
            rows.append([s.recording, s.estimator, q.words, q.unit, *sizes])
    if not rows:
        return []
    caption = (
        "Last estimate on each recording, and half the width of its 95 % band as the estimator states it. A drive that "
        "does not excite a parameter leaves it where it was believed to be."
    )
    header = ["recording", "estimator", "parameter", "unit", "estimate", "± 95 %"]
    return [Sheet(header, rows, caption, left=4)]


def _best(estimated: Estimated) -> str:
    """Say which estimator is nearest to each reference, of those that diverge nowhere: others end where it is hard."""
    phrases = []
    lost = {s.estimator for s in estimated.summaries if math.isfinite(s.diverged_at)}
    for name in dict.fromkeys(n for s in estimated.summaries for n in s.errors):
        errors = {
            e: _pooled([s.errors[name].rmse for s in estimated.summaries if s.estimator == e and name in s.errors])
            for e in dict.fromkeys(s.estimator for s in estimated.summaries if s.estimator not in lost)
        }
        finite = {e: v for e, v in errors.items() if math.isfinite(v)}
        if finite:
            q, best = quantity(name), min(finite, key=lambda e: finite[e])
            phrases.append(f"{q.words} {style.with_unit(q.scale * finite[best], q.unit)} ({best})")
    return f" Smallest RMSE against the reference: {', '.join(phrases[:4])}." if phrases else ""


def _pooled(values: Sequence[float]) -> float:
    return math.sqrt(sum(v * v for v in values) / len(values)) if values else math.nan


def _answer(estimated: Estimated) -> list[Block]:
    return [
        Prose(strong(estimated.answer)),
        Prose(plain(inputs_in_words(estimated.runs))),
    ]


def _comparison(estimated: Estimated) -> list[Block]:
    rows = []
    for s in estimated.summaries:
        per = s.log_likelihood / s.updates if s.updates else math.nan
        coloured = [words(n) for n, w in s.whiteness.items() if is_coloured(w)]
        rows.append(
            [
                s.recording,
                s.estimator,
                "–" if not math.isfinite(s.diverged_at) else f"at {s.diverged_at:.1f} s",
                style.number(per, 4),
                style.number(s.nis),
                _share(s.nis_inside),
                f"{len(coloured)} of {len(s.whiteness)}" if math.isfinite(s.nis) else "–",
                style.number(s.nees),
                _share(s.nees_inside),
            ]
        )
    header = [
        "recording", "estimator", "diverged", "log-likelihood per sample", "NIS/dof", "in 95 % band",
        "outputs coloured", "NEES/dof", "in 95 % band",
    ]  # fmt: skip
    caption = (
        "Every estimator on every recording. NIS and NEES over their degrees of freedom are 1 and 95 % lie in the band "
        "if the stated covariance is right; larger means that it is too small. NEES is of all signals that have a "
        "reference, which is taken for exact. A dash: not stated, or there is none."
    )
    return [Sheet(header, rows, caption, left=3)]


def _share(value: float) -> str:
    return style.percent(value) if math.isfinite(value) else "–"


def _errors(estimated: Estimated) -> list[Block]:
    rows = []
    for s in estimated.summaries:
        for name, e in s.errors.items():
            if not math.isfinite(e.rmse):
                continue
            q = quantity(name)
            sizes = [style.number(q.scale * v) for v in (e.rmse, e.bias, e.largest, e.noise)]
            rows.append([s.recording, s.estimator, q.words, q.unit, *sizes, style.number(e.nees), _share(e.inside)])
    if not rows:
        none = "The recordings hold no reference: no state or port that the estimators do not measure themselves."
        return [Prose(plain(none))]
    header = [
        "recording",
        "estimator",
        "signal",
        "unit",
        "RMSE",
        "bias",
        "largest",
        "noise of reference",
        "NEES",
        "in 95 % band",
    ]
    caption = (
        "Estimate less reference. NEES and band take that for exact; its noise is the white part that the reference "
        "shows."
    )
    blocks: list[Block] = [Sheet(header, rows, caption, left=4)]
    for name, runs in estimated.by_recording().items():
        for part in _pages(references_of(runs[0])):
            blocks.append(
                Drawing(
                    partial(figures.errors, runs, part, f"How far are the estimates from the references ({name})?"),
                    f"{name}: estimate less reference; the band is twice the stated standard deviation to either side.",
                    f"Errors of {_named(part)} over time on {name}.",
                )
            )
    return blocks


def _over_time(estimated: Estimated) -> list[Block]:
    blocks: list[Block] = []
    for name, runs in estimated.by_recording().items():
        for part in _pages(signals_of(runs[0])):
            blocks.append(
                Drawing(
                    partial(figures.estimates, runs, part, f"What is estimated on {name}?"),
                    f"{name}: estimates with twice their standard deviation to either side, over what was measured "
                    "and, where the recording holds one, the reference.",
                    f"Estimates of {_named(part)} over time on {name}.",
                )
            )
    return blocks


def _innovations(estimated: Estimated) -> list[Block]:
    rows = [
        [s.recording, s.estimator, words(n), *whiteness_cells(w)]
        for s in estimated.summaries
        if math.isfinite(s.nis)
        for n, w in s.whiteness.items()
    ]
    if not rows:
        return [Prose(plain("No estimator states a covariance, so nothing can be compared."))]
    header = ["recording", "estimator", "output", *WHITENESS]
    caption = (
        "Innovations over the standard deviation stated of them; those of a correct model are white (large p) with "
        "variance 1."
    )
    blocks: list[Block] = [Sheet(header, rows, caption, left=3)]
    for name, every in estimated.by_recording().items():
        runs = [r for r in every if np.isfinite(r["nis"]).any()]
        if not runs:
            continue
        blocks.append(
            Drawing(
                partial(figures.innovations, runs, f"Are the innovations as large as stated ({name})?"),
                f"{name}: innovations, and twice the standard deviation that is stated of them to either side.",
                f"Innovations of every output over time on {name}.",
            )
        )
        names = ["nis", *(["nees"] if "nees" in runs[0] else [])]
        blocks.append(
            Drawing(
                partial(figures.normalised, runs, names, f"Is the stated covariance right ({name})?"),
                f"{name}: averages along the recording. Those of NIS of a consistent estimator lie in the band in 95 "
                "of 100 windows; neighbouring samples of NEES are alike, so its band is that of a single sample.",
                f"NIS over time on {name}, with its 95 % band.",
            )
        )
    return blocks


def _made(estimated: Estimated, command: str) -> list[Block]:
    first = estimated.runs[0]
    held = (
        "run straight from sample to sample" if first.attrs["inputs"] == "joined" else "stay constant between samples"
    )
    settings = {r.attrs["estimator"]: r.attrs["settings"] for r in estimated.runs}
    notes = [
        f"Model {first.attrs['model']} with the parameters {first.attrs['parameters']}; recorded inputs {held}.",
        *(f"{name}: settings {text}." for name, text in settings.items() if text != "none"),
        *estimated.warnings,
        *certain_in_words(estimated.runs),
    ]
    return [Bullets([plain(n) for n in notes]), Listing(command, "sh")]


def _pages(names: Sequence[str]) -> list[list[str]]:
    """Return the names in equal parts that a page takes."""
    if not names:
        return []
    count = -(-len(names) // figures.PER_FIGURE)
    return [[str(n) for n in part] for part in np.array_split(np.array(names), count)]


def _named(names: Sequence[str]) -> str:
    return listed([words(n) for n in names])


Format = Literal["csv", "parquet", "nc", "mf4", "mcap"]


def as_columns(run: xr.Dataset) -> xr.Dataset:
    """Return a run with variables over time only; each pair of outputs has its covariance as a column."""
    outputs, columns = outputs_of(run), run.drop_dims(["output", "other_output"])
    for i, output in enumerate(outputs):
        for other in outputs[i + 1 :]:
            pair = run["innovation_covariance"].sel(output=output, other_output=other, drop=True)
            columns[f"innovation_covariance_{output}_{other}"] = pair
    return columns


def write_estimates(folder: Path, runs: Sequence[xr.Dataset], form: Format) -> list[Path]:
    """Write every run into a folder and return the files.

    Args:
        folder: Made if absent.
        runs: From ``harness.recorded.run.RecordedEstimator.run``.
        form: ``nc`` keeps units and provenance as CF attributes; the others have a column for each variable, in SI
            units, see ``write_recording``.

    Raises:
        UserError: If a file cannot be written.
    """
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise UserError(f"{folder}: cannot be written: {error.strerror or error}") from None
    written = []
    for run in runs:
        path = folder / f"{file_stem(run.attrs['recording'])}-{file_stem(run.attrs['estimator'])}.{form}"
        write_recording(run if form == "nc" else as_columns(run), path)
        written.append(path)
    return written


def file_stem(name: str) -> str:
    """Return a name as part of a file's name."""
    return re.sub(r"[^\w.=+-]+", "_", name).strip("_") or "unnamed"


def write_numbers(folder: Path, summaries: Sequence[RunSummary], answer: str, comment: str) -> Path:
    """Write the answer and the numbers of all runs as ``estimate.json`` and return its path.

    Raises:
        UserError: If it cannot be written.
    """
    content = {"answer": answer, "comment": comment, "runs": [record(s) for s in summaries]}
    return write_files(folder, {"estimate.json": json_text(content)})[0]
