"""``harness loop``: a loop file, traced, with the published model beside the fitted ones."""

from __future__ import annotations

import json
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer
from rich.console import Console
from rich.text import Text

from harness.folder import write_files

if TYPE_CHECKING:
    import xarray as xr

    from harness.configure import ModelSpec
    from harness.loop.outcome import Outcome
    from harness.loop.study import LoopStudy
    from harness.report.document import Block


def loop(
    file: Annotated[Path, typer.Argument(help="Loop file, such as studies/loops/genesis.toml.")],
    out: Annotated[
        Path | None, typer.Option("--out", "-o", help="Folder of the results; results/loop-<name> if absent.")
    ] = None,
    jobs: Annotated[int | None, typer.Option("--jobs", "-j", min=1, help="Threads; all cores if absent.")] = None,
) -> None:
    """Trace what a model lacks in the drives that a loop file names.

    Writes what harness trace does, and loop.json: each held-out drive with the published, the refitted and the
    amended model. Where the folder of the recordings is absent the loop is skipped.
    """
    from harness.command_line import RESULTS
    from harness.loop.study import load_loop

    study = load_loop(file)
    if study.absent:
        Console().print(Text(study.absent), soft_wrap=True)
        return
    folder, console = out if out is not None else RESULTS / f"loop-{file.stem}", Console(stderr=True)
    with console.status("reading the recordings"):
        drives = study.drives()
    found = _trace(study, study.nominal(), drives, "", folder, jobs, console)
    answers = [found.answer]
    if study.raw.changed is not None:
        changed = _trace(study, found.amended, drives, "changed.", folder / "changed", jobs, console)
        answers += [study.raw.changed.question, changes(changed)]
    for answer in answers:
        Console().print(Text(answer, style="bold"), soft_wrap=True)
    Console().print(Text(str(folder / "report.html")), soft_wrap=True)


def _trace(
    study: LoopStudy,
    spec: ModelSpec,
    drives: dict[str, list[xr.Dataset]],
    part: str,
    folder: Path,
    jobs: int | None,
    console: Console,
) -> Outcome:
    """Trace the drives of one part and write its results; of changed drives nothing is refitted beforehand."""
    from harness.loop.run import Task, run_trace
    from harness.loop.worth import REPEATS
    from harness.report.document import Document, write

    raw, worth = study.raw, None if part else study.raw.worth
    task = Task(
        spec,
        drives[f"{part}train"],
        drives[f"{part}test"],
        () if part else study.fitted_parameters(),
        tuple(raw.estimators),
        study.path.parent / worth.study if worth else None,
        worth.repeats if worth else REPEATS,
        study.excluded,
        raw.rounds,
        raw.stated_noise,
        jobs,
    )
    outcome = run_trace(task, folder, console)
    title = raw.changed.question if part and raw.changed else raw.title
    with console.status("writing the report"):
        write_files(folder, {"loop.json": json.dumps(held_out(outcome), indent=2) + "\n"})
        write(Document(title, _blocks(study, outcome, part)), folder)
    return outcome


def held_out(outcome: Outcome) -> dict[str, Any]:
    """Return the error of the model alone on each held-out drive, in SI units.

    ``published`` is the model as it was stated, ``refitted`` with its own parameters fitted, ``amended`` with all that
    was added. ``rmse`` counts a constant error, ``std`` does not.
    """
    import numpy as np

    trace = outcome.trace
    whole = trace.fitting.whole
    found: dict[str, Any] = {}
    for i, drive in enumerate(trace.held_out.drives):
        points = {
            "published": whole.neutral(),
            "refitted": trace.before.point.values[:, i],
            "amended": trace.after.point.values[:, i],
        }
        errors = {k: drive.measurements - whole.free_run(drive, v).outputs for k, v in points.items()}
        found[drive.name] = {
            name: {
                k: {"rmse": float(np.sqrt(np.nanmean(e[:, a] ** 2))), "std": float(np.nanstd(e[:, a]))}
                for k, e in errors.items()
            }
            for a, name in enumerate(whole.model.outputs)
        }
    return found


def changes(outcome: Outcome) -> str:
    """Return what is different in drives that were traced from an amended model, in a sentence per addition."""
    from harness.loop.hypotheses import ALL_PARAMETERS
    from harness.report import style
    from harness.report.store import words

    if not outcome.trace.added:
        return outcome.answer
    stated, sentences = outcome.trace.fitting.whole.spec.values, []
    for h in outcome.trace.added:
        name = words(h.name.replace("@", " of "))
        if h.name == ALL_PARAMETERS or h.kind == "effect":
            sentences.append(f"{name[:1].upper()}{name[1:]} came in.")
            continue
        v = outcome.values[h.name][0]
        unit = "" if v.unit == "dimensionless" else f" {v.unit}"
        was, now, spread = (style.number(n) for n in (stated[h.name], v.value, v.std))
        sentences.append(f"{name[:1].upper()}{name[1:]} changed from {was} to {now} ± {spread}{unit}.")
    return " ".join(sentences)


def _blocks(study: LoopStudy, outcome: Outcome, part: str) -> list[Block]:
    from harness.loop.report import document
    from harness.measured.study import spans_sheet
    from harness.report.document import Heading, Prose, Sheet, plain, strong

    blocks = list(document(outcome, f"harness loop {study.path}").blocks)
    _, first, *_ = (i for i, b in enumerate(blocks) if isinstance(b, Heading))  # the end of what was found
    spans = study.spans()
    further: list[Block] = [
        _errors(outcome),
        spans_sheet({"fitted": spans[f"{part}train"], "held out": spans[f"{part}test"]}),
    ]
    if part:
        further.insert(0, Prose(strong(changes(outcome))))
    if study.raw.bank_map:
        text = (
            "The bank of the road is a map over the path, from accelerometer and velocities of the fitted drives. No "
            "drive was given the bank that it felt itself. Whether the map is believed is one of the hypotheses."
        )
        further.append(Prose(plain(text)))
    if study.raw.exclude:
        rows = [[e.effect.replace("_", " "), e.reason] for e in study.raw.exclude]
        further.append(Sheet(["effect", "why it was not tried"], rows, "Effects left out.", left=2))
    return [*blocks[:first], *further, *blocks[first:]]


def _errors(outcome: Outcome) -> Block:
    from harness.report import style
    from harness.report.document import Sheet
    from harness.report.store import quantity

    rows = []
    for drive, outputs in held_out(outcome).items():
        for name, models in outputs.items():
            q = quantity(name)
            numbers = [q.scale * models[m][kind] for kind in ("rmse", "std") for m in models]
            rows.append([drive, q.words, q.unit, *map(style.number, numbers)])
    models = ("published", "refitted", "amended")
    header = ["drive", "output", "unit", *models, *(f"{m}, std." for m in models)]
    caption = (
        "Each held-out drive: root mean square error of the model alone, and the standard deviation of that error, "
        "which does not count a constant. Published: as stated, nothing fitted."
    )
    return Sheet(header, rows, caption, left=3)
