"""``harness loop``: a loop file, traced, with the published model beside the fitted ones."""

from __future__ import annotations

import json
import math
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer
from rich.console import Console
from rich.text import Text

from harness.errors import UserError
from harness.folder import write_files

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    import xarray as xr

    from harness.configure import ModelSpec
    from harness.loop.outcome import Outcome
    from harness.loop.study import LoopStudy
    from harness.report.document import Block


FINEST = 0.01
"""s; longest integration step. Lags of a few hundredths of a second are among the hypotheses."""


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
    if not study.folder.is_dir():
        Console().print(Text(f"{file}: skipped, there is no folder {study.folder} of recordings"), soft_wrap=True)
        return
    folder = out if out is not None else RESULTS / f"loop-{file.stem}"
    with Console(stderr=True).status("reading the recordings") as status:
        drives = study.drives()
        spec = _nominal(study, drives["train"][0])
        drives = _steered(drives, spec.values.get("steering_ratio", 1.0))
        found = _trace(study, spec, drives, "", folder, jobs, status.update)
        answers = [found.answer]
        if study.raw.changed is not None:
            changed = _trace(study, found.amended, drives, "changed.", folder / "changed", jobs, status.update)
            answers += [study.raw.changed.question, changes(changed)]
    for answer in answers:
        Console().print(Text(answer, style="bold"), soft_wrap=True)
    Console().print(Text(str(folder / "report.html")), soft_wrap=True)


def _steered(drives: dict[str, list[xr.Dataset]], ratio: float) -> dict[str, list[xr.Dataset]]:
    """Return the drives with a steering-wheel angle: where only that of the road wheels is there, times the ratio."""

    def steered(recording: xr.Dataset) -> xr.Dataset:
        if "steering_wheel_angle" in recording or "road_wheel_angle" not in recording:
            return recording
        return recording.assign(steering_wheel_angle=ratio * recording["road_wheel_angle"])

    return {key: [steered(r) for r in recordings] for key, recordings in drives.items()}


def _nominal(study: LoopStudy, recording: xr.Dataset) -> ModelSpec:
    """Return the nominal model; integrated finely, because errors of integration look like a lag of the steering."""
    from harness.configure import resolve_single
    from harness.identify.recordings import step_of

    stated = study.raw.model.model_dump(exclude_unset=True)
    step = step_of(recording)
    finely = {"integrator": "rk4", "step": step, "substeps": math.ceil(step / FINEST)}
    return resolve_single({**stated, **finely}, f"{study.path}: model")


def _free(study: LoopStudy, spec: ModelSpec) -> tuple[str, ...]:
    from models.registry import closest

    known = spec.model().parameter_names
    for i, name in enumerate(study.raw.free):
        if name not in known:
            raise UserError(f"{study.path}: free[{i}]: the model has no parameter '{name}'{closest(name, known)}")
    return tuple(study.raw.free) or tuple(p.name for p in spec.model().parameters if p.unit in ("N/rad", "1/rad"))


def _trace(
    study: LoopStudy,
    spec: ModelSpec,
    drives: dict[str, list[xr.Dataset]],
    part: str,
    folder: Path,
    jobs: int | None,
    say: Callable[[str], None],
) -> Outcome:
    """Trace the drives of one part and write its results; of changed drives nothing is refitted beforehand."""
    from harness.loop.amend import estimators_on
    from harness.loop.outcome import outcome_of, write_outcome
    from harness.loop.trace import trace
    from harness.loop.whole import Whole
    from harness.report.document import Document, write

    train, test = drives[f"{part}train"], drives[f"{part}test"]
    say("compiling the library of effects")
    available = set.intersection(*({str(v) for v in r} for r in train + test))
    whole = Whole(spec, available, jobs, study.excluded)
    named = [whole.drive(r, name) for r, name in zip(train + test, _names(train + test), strict=True)]
    free = () if part else _free(study, spec)
    found = trace(whole, named[: len(train)], named[len(train) :], free, say, study.raw.rounds, study.raw.stated_noise)
    outcome = outcome_of(found)
    tried = estimators_on(found, outcome.amended, test, study.raw.estimators, say)
    outcome = replace(outcome, estimators=tried)
    say("writing the report")
    title = study.raw.changed.question if part and study.raw.changed else study.raw.title
    write_outcome(outcome, folder)
    write_files(folder, {"loop.json": json.dumps(held_out(outcome), indent=2) + "\n"})
    write(Document(title, _blocks(study, outcome, drives, part)), folder)
    return outcome


def _names(recordings: Sequence[xr.Dataset]) -> list[str]:
    """Return the names of drives; spans of one recording are told apart by number."""
    given = [str(r.attrs["name"]) for r in recordings]
    return [f"{n} ({given[: i + 1].count(n)})" if given.count(n) > 1 else n for i, n in enumerate(given)]


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


def _blocks(study: LoopStudy, outcome: Outcome, drives: dict[str, list[xr.Dataset]], part: str) -> list[Block]:
    from harness.loop.report import document
    from harness.report.document import Prose, Sheet, plain, strong

    blocks = list(document(outcome, f"harness loop {study.path}").blocks)
    first = next(i for i, b in enumerate(blocks) if isinstance(b, Sheet)) + 1
    further: list[Block] = [_errors(outcome), _spans(study, part)]
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


def _spans(study: LoopStudy, part: str) -> Block:
    from harness.report.document import Sheet

    raw = study.raw.changed if part and study.raw.changed else study.raw
    rows = [
        [s.file, purpose, "all" if s.span is None else " to ".join(map(str, s.span))]
        for purpose, spans in (("fitted", raw.train), ("held out", raw.test))
        for s in spans
    ]
    return Sheet(["recording", "used", "span"], rows, "The drives.", left=3)
