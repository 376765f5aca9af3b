"""Files of planned drives: ``next_drive.json``, the drives for studies, and a table for a steering robot of each."""

from __future__ import annotations

import contextlib
import io
import json
import shlex
from pathlib import Path
from typing import Any

import numpy as np

from harness.common.errors import UserError
from harness.common.files import json_text, read_text, toml_text
from harness.common.places import inside, remove
from harness.config import DriveSpec
from harness.diagnosis.earlier_trace import TRACE
from harness.experiment.contract import ExpectedOutcome
from harness.experiment.design import TriedDrive
from harness.experiment.limits import stated
from harness.experiment.run import Designed
from harness.identification.earlier_result import FOLDER, PLAN, read_json

RESULT, DRIVES = PLAN, "next_drive.toml"

SCHEMA_VERSION = 1
"""Version of the keys of ``next_drive.json``: one more when a key is removed or changes its meaning."""


def names_of(designed: Designed) -> list[str]:
    """Return the name of each drive of the sequence, in the order in which it is driven."""
    return [f"{i}-{t.manoeuvre.name}" for i, (t, _) in enumerate(designed.plan.sequence, 1)]


def contents(designed: Designed) -> dict[str, str]:
    """Return the files by name."""
    names = names_of(designed)
    tables = {
        f"{name}.csv": _robot(tried, designed) for name, (tried, _) in zip(names, designed.plan.sequence, strict=True)
    }
    drives = [table(t.rehearsed.drive, name) for name, (t, _) in zip(names, designed.plan.sequence, strict=True)]
    heading = f"Drives planned by harness next-drive on {designed.task.folder.name}; a study takes them: drives = FILE"
    return {
        RESULT: json_text(record(designed)),
        DRIVES: toml_text({"drive": drives}, heading),
        **tables,
    }


def remove_earlier(folder: Path) -> None:
    """Remove the tables of a plan that is in a folder, which another sequence would leave there, and its JSON."""
    with contextlib.suppress(UserError, ValueError, KeyError, TypeError):
        for entry in json.loads(read_text(folder / RESULT))["sequence"]:
            remove(inside(folder, f"{Path(entry['name']).name}.csv"))
    remove(inside(folder, RESULT))


def table(drive: DriveSpec, name: str) -> dict[str, Any]:
    """Return a drive by the keys of ``[[drive]]`` in a study file."""
    return {"name": name, "kind": drive.kind, **drive.options}


def record(designed: Designed) -> dict[str, Any]:
    """Return the content of ``next_drive.json``, SI units."""
    plan, goal, task = designed.plan, designed.goal, designed.task
    return {
        "schema_version": SCHEMA_VERSION,
        "result": str(task.folder),
        "criterion": goal.criterion,
        "budget": task.budget,
        "limits": stated(task.limits),
        "value": {"before": _number(goal.value(None)), "after": _number(plan.value)},
        "seconds": plan.seconds,
        "expected": _expected(designed.expectation),
        "sequence": [
            {**_tried(t), "name": name, "times": times}
            for name, (t, times) in zip(names_of(designed), plan.sequence, strict=True)
        ],
        "ranked": [
            {
                **_tried(t),
                "times": t.times,
                "value": _number(t.value),
                "expected": _expected(expected),
            }
            for t, expected in zip(plan.ranked, designed.alone, strict=True)
        ],
        "refused": plan.refused,
        "tried": plan.tried,
        "sensors": [
            {
                "name": e.name,
                "outputs": list(e.outputs),
                "expected": None if isinstance(e.expectation, str) else _expected(e.expectation),
                "reason": e.expectation if isinstance(e.expectation, str) else None,
            }
            for e in designed.equipped
        ],
    }


def _tried(t: TriedDrive) -> dict[str, Any]:
    return {
        "manoeuvre": t.manoeuvre.name,
        "standard": t.manoeuvre.standard,
        "seconds": t.rehearsed.seconds,
        "drive": table(t.rehearsed.drive, t.manoeuvre.name),
    }


def _expected(e: ExpectedOutcome) -> dict[str, Any]:
    return {"words": e.words, "open": list(e.open), **e.record}


def _number(value: float) -> float | None:
    return float(value) if np.isfinite(value) else None


def _robot(tried: TriedDrive, designed: Designed) -> str:
    """Return what a steering robot takes: time, angle of steering wheel and road wheels, speed, SI units."""
    profile, stream = tried.rehearsed.profile, io.StringIO()
    columns = {
        "time": profile.time,
        "steering_wheel_angle": profile.steering_wheel_angle,
        "road_wheel_angle": profile.steering_wheel_angle / designed.plant.steering_ratio,
        "speed": profile.speed,
    }
    header, values = ",".join(columns), np.column_stack(list(columns.values()))
    np.savetxt(stream, values, fmt="%.8g", delimiter=",", header=header, comments="")
    return stream.getvalue()


def written_to(designed: Designed, folder: Path) -> list[str]:
    """Return commands that simulate the drives in a folder; none of a study, which keeps no parameter set."""
    if not designed.plant.parameters:
        return []
    model, commands = ["--model", designed.plant.vehicle, "--parameters", designed.plant.parameters], []
    for name, (tried, _) in zip(names_of(designed), designed.plan.sequence, strict=True):
        drive = tried.rehearsed.drive
        options = [word for k, v in drive.options.items() for word in ("--option", f"{k}={v}")]
        out = ["--out", str(folder / f"{name}-simulated.csv")]
        commands.append(shlex.join(["harness", "simulate", *model, "--drive", drive.kind, *options, *out]))
    return commands


def once_driven(designed: Designed, folder: Path) -> str:
    """Return the command that goes on from the drives in a folder, each of them; empty where none does.

    Behind a trace of changes since a baseline all drives are traced again, with that; a study of no identification has
    no recordings to go on from.
    """
    after = designed.task.folder if folder == designed.task.folder / FOLDER else folder
    expected = designed.expectation.record
    driven = sum(times for _, times in designed.plan.sequence)
    if "models" in expected or "limits" in expected:
        if read_json(designed.task.folder / TRACE).get("baseline"):
            return ""
        both = [option for option in ("--train", "--test") for _ in range(driven // 2)]
        return shlex.join(["harness", "trace", "--after", str(after), *(w for o in both for w in (o, "RECORDING"))])
    if "parameters" in expected and expected.get("fit", "") is not None:
        return shlex.join(["harness", "identify", "--after", str(after), *(driven * ["--train", "RECORDING"])])
    return ""
