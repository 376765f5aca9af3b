"""Checks of an output folder before anything is computed: that it can be filled, and holds no other's result."""

from __future__ import annotations

import os
from pathlib import Path

from harness.cli import options
from harness.common.errors import UserError
from harness.common.places import is_url

RESULTS = {
    "run": "scores.zarr",
    "estimate": "estimate.json",
    "identify": "identify.json",
    "trace": "trace.json",
    "loop": "loop.json",
    "realtime": "times.zarr",
    "remedy": "as-it-is/scores.zarr",
    "next-drive": "next_drive.json",
    "monitor": "monitor.toml",
    "campaign": "",
}
"""Commands that write ``report.html`` into their ``--out``, and what tells their result; nothing tells a campaign."""

_FOLDERS = {*RESULTS, "check", "export", "observability"}
"""Commands whose ``--out`` is a folder."""

_FILES = {"tune", "simulate"}
"""Commands that write a file after long work."""

_STORES = ("zarr.json", ".zgroup", ".zarray")
"""What tells a store of Zarr, of version 3 and 2."""

_WRITES_TOO = {"loop": ("trace",), "trace": ("loop",)}
"""What a command writes besides."""


def refuse_unfit(command: str, out: Path | None) -> None:
    """Refuse an output folder that cannot be one, or in which another command has left its result.

    Args:
        command: Name of the command; of one that writes neither a folder nor a file at its end nothing is looked at.
        out: What it writes; of a folder that nobody has named the one around it is looked at.

    Raises:
        UserError: If it is a file, a store, cannot be written to, or holds a result whose report would be written over.
    """
    if command not in _FOLDERS | _FILES or (out is not None and is_url(out)):
        return
    _refuse_place(options.RESULTS if out is None else out.parent if command in _FILES else out)
    if out is None:
        return
    if any((out / mark).exists() for mark in _STORES):
        raise UserError(
            f"{out} is a store of Zarr, in which nothing else may lie; choose the folder around it or another"
        )
    allowed = (command, "campaign", *_WRITES_TOO.get(command, ()))
    others = [name for name, file in RESULTS.items() if name not in allowed and (out / file).exists()]
    if others and command in RESULTS:
        raise UserError(
            f"{out} holds a result of 'harness {others[0]}' ({RESULTS[others[0]]}), and its report would be written "
            "over; choose another folder with --out"
        )


def _refuse_place(folder: Path) -> None:
    """Refuse what cannot be a folder to write in."""
    there = next(p for p in (folder, *folder.absolute().parents) if os.path.lexists(p))
    if not there.exists():
        raise UserError(f"{there} is a link that leads nowhere; make the folder it leads to, or choose another name")
    if not there.is_dir():
        raise UserError(f"{there} is a file, where --out names a folder; choose another name")
    if not os.access(there, os.W_OK | os.X_OK):
        raise UserError(f"{folder}: nothing may be written to {there}; choose another folder with --out")


def refuse_input(out: Path, *inputs: Path) -> None:
    """Refuse to write over a file that the command reads.

    Raises:
        UserError: If the output is one of the inputs, by whatever path.
    """
    if any(each.exists() and out.exists() and out.samefile(each) for each in inputs):
        raise UserError(
            f"--out {out}: this is a file that the command reads, and it would be written over; name another"
        )
