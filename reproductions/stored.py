"""Results of the long reproductions, kept with their date and a digest of the code that decided them.

The digest is that of ``harness.common.sources`` over what a reproduction imports, without what only writes the result
down, with the files of the registries that it finds by name and the file of its drives. A result whose digest is not
that of today's code is older than the code that decides it.
"""

from __future__ import annotations

import hashlib
import importlib
import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
from numpy.typing import NDArray

from harness.common import places, sources
from harness.common.errors import UserError
from harness.common.files import refuse_damaged
from harness.models.roles import DRIVES, PARAMETERS, SENSORS, TYRES, VEHICLES
from harness.simulation.drives import read_drives
from harness.study.provenance import commit

STAMP = "stamp"
"""Name of the array that holds where a result comes from."""

WRITING = (
    "harness.cli",
    "harness.reporting",
    "reproductions.kept",
    "reproductions.narx_figures",
    "reproductions.stored",
    "reproductions.sun_em_report",
    "reproductions.ziaukas_swarm_report",
)
"""What writes results down: its wording may change without making a result old."""


@dataclass(frozen=True)
class Long:
    """A reproduction that takes long.

    Attributes:
        command: How to make its result.
        file: File of the result in its folder.
        module: Where it is computed.
        names: Files of the registries that it uses, by registry.
        methods: Modules that it finds by name.
        drives: File of drives that it simulates; none if it states them itself.
    """

    command: str
    file: str
    module: str
    names: Mapping[str, Sequence[str]]
    methods: tuple[str, ...] = ()
    drives: str = ""

    def code(self) -> str:
        """Return the digest of what decides the result."""
        registries = {"vehicle": VEHICLES, "tyre": TYRES, "sensors": SENSORS, "parameters": PARAMETERS}
        kinds = list(dict.fromkeys(kind for kind, _ in read_drives(self.drives).values())) if self.drives else []
        roots: list[ModuleType] = [importlib.import_module(name) for name in (self.module, *self.methods)]
        roots += [
            registries[role].load(name) for role, names in self.names.items() if role != "drives" for name in names
        ]
        roots += [DRIVES.load(kind) for kind in (*self.names.get("drives", ()), *kinds)]
        total = hashlib.sha256(sources.digest(roots, WRITING).encode())
        if self.drives:
            total.update(Path(self.drives).read_bytes())
        return total.hexdigest()


_SEMITRAILER = {"vehicle": ("semitrailer",), "tyre": ("magic_formula",), "parameters": ("ziaukas_2023",)}

LONG = {
    "identify-swarm": Long(
        "make study-identify-swarm",
        "identify.npz",
        "reproductions.ziaukas_swarm",
        {**_SEMITRAILER, "sensors": ("test_vehicle",)},
        drives="studies/drives/identification.toml",
    ),
    "identify-em": Long(
        "make study-identify-em",
        "identify.npz",
        "reproductions.sun_em",
        {
            "vehicle": ("car_reference_point",),
            "parameters": ("sun_2015",),
            "sensors": ("car_reference",),
            "drives": ("sine",),
        },
        methods=("harness.identification.methods.em", "harness.identification.methods.likelihood"),
    ),
    "narx-architecture": Long(
        "make study-narx-architecture",
        "architecture.npz",
        "reproductions.narx_architecture",
        {**_SEMITRAILER, "sensors": ("series",)},
        drives="studies/drives/narx-training.toml",
    ),
}
"""By the name of the folder of the result."""


def save(folder: Path, name: str, command: str, arrays: Mapping[str, Any]) -> Path:
    """Write the arrays of a reproduction with a stamp of their origin, and return the path.

    Args:
        folder: Where to; it exists.
        name: Of the reproduction in ``LONG``.
        command: With which it was made.
        arrays: By name.

    Raises:
        UserError: If the file cannot be written.
    """
    stamp = {
        "code": LONG[name].code(),
        "made": datetime.now(UTC).isoformat(timespec="seconds"),
        "commit": commit(),
        "command": command,
    }
    path = folder / LONG[name].file
    try:
        with places.unfinished(path) as stream:
            np.savez(stream, allow_pickle=False, **{STAMP: np.array(json.dumps(stamp))}, **arrays)
    except OSError as error:
        raise UserError(f"{path}: cannot be written: {error.strerror or error}") from None
    return path


def load(folder: Path, name: str) -> tuple[dict[str, NDArray[Any]], dict[str, str]]:
    """Return the arrays of a reproduction and their stamp, empty where the file is older than stamps are.

    Raises:
        UserError: If the file is not there or cannot be read.
    """
    path = folder / LONG[name].file
    if not path.is_file():
        raise UserError(f"{path}: there is no such result; make it with '{LONG[name].command}'")
    with refuse_damaged(path, "result", f"make it again with '{LONG[name].command}'"):
        with np.load(path, allow_pickle=False) as kept:
            arrays = {key: kept[key] for key in kept.files}
        stamp = arrays.pop(STAMP, None)
        return arrays, {} if stamp is None else json.loads(str(stamp))
