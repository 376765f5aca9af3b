"""The stored results that records are read from: where they are, when they were made, and whether by today's code."""

from __future__ import annotations

import json
import re
import shutil
import tomllib
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from datetime import UTC, datetime
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from harness import estimation
from harness.common import stores
from harness.common.errors import UserError
from harness.config import StudySpec, build_study, load_study
from harness.estimation.narx_network import load as load_network
from harness.realtime import outcome
from harness.study.provenance import code_state, engine_hash
from harness.study.results import StudyResults, read
from harness.study.run import run_study
from harness.study.score_names import PENDING
from harness.study.store import STORE
from reproductions.campaign.box import Box
from reproductions.campaign.box import read as read_box
from reproductions.campaign.results import REALTIME, Results
from reproductions.narx import data as training_data
from reproductions.narx.training import Plan, Trainer
from reproductions.stored import LONG, load

STUDIES = Path("studies")
NETWORK_FILE = Path(estimation.__file__).parent / "networks" / "semitrailer_24t.npz"


class Missing(UserError):
    """A stored result is not there, or not finished."""


@dataclass(frozen=True)
class Origin:
    """Where a stored result comes from.

    Attributes:
        name: Of its folder.
        command: That makes it.
        made: Day and time, or nothing where that was not kept.
        state: ``current``, or what is wrong with it.
    """

    name: str
    command: str
    made: str
    state: str

    @property
    def current(self) -> bool:
        """Whether it is there and of today's code."""
        return self.state == "current"


class _Stores(dict[str, StudyResults]):
    """Stores of studies by name, read when they are asked for."""

    def __init__(self, folder: Path) -> None:
        super().__init__()
        self._folder = folder

    def __missing__(self, name: str) -> StudyResults:
        if not (self._folder / name / STORE).is_dir():
            raise Missing(f"no finished study {name}; make it with 'make study-{name}'")
        results = read(self._folder / name)
        pending = sum(d.count(PENDING) for d in results.designs)
        if pending:
            raise Missing(f"study {name}: {pending} runs are still to come; finish them with 'make study-{name}'")
        self[name] = results
        return results


class Stored(Results):
    """The results below a folder, of which any may be missing.

    Args:
        folder: Holds one folder per result, named like its command.
        out: Where the small studies go that the records are computed from on the spot.
        studies: Folder of the study files, whose text decides whether a result is current.
    """

    def __init__(self, folder: Path, out: Path, studies: Path = STUDIES) -> None:
        self.folder, self.out, self.studies = folder, out, studies
        self._origins: dict[str, Origin] = {}
        self._arrays: dict[str, dict[str, NDArray[Any]]] = {}
        self._small: dict[str, StudyResults] = {}

    @cached_property
    def stores(self) -> dict[str, StudyResults]:
        """The stores of the studies, by name; asking for one that is not there raises ``Missing``."""
        return _Stores(self.folder)

    @cached_property
    def times(self) -> xr.Dataset:
        """What ``harness realtime`` measured."""
        if not (self.folder / REALTIME / outcome.STORE).is_dir():
            raise Missing("no times per step; make them with 'make study-realtime'")
        return outcome.read(self.folder / REALTIME)

    @cached_property
    def box(self) -> Box:
        """In how much of the box of what is not published the findings hold."""
        return read_box(self.folder)

    def arrays(self, name: str) -> dict[str, NDArray[Any]]:
        """Return what a long reproduction found.

        Raises:
            Missing: If it was not made.
        """
        if name not in self._arrays:
            if not (self.folder / name / LONG[name].file).is_file():
                raise Missing(f"no result {name}; make it with '{LONG[name].command}'")
            self._arrays[name] = load(self.folder / name, name)[0]
        return self._arrays[name]

    def small(self, name: str, build: Callable[[dict[str, Any]], None], other: str) -> StudyResults:
        """Return the result of a small study made of another, run if it is not there by today's code.

        Args:
            name: Of the small study.
            build: Changes the table of the other study into that of the small one.
            other: The other study.
        """
        if name not in self._small:
            table = tomllib.loads((self.studies / f"{other}.toml").read_text(encoding="utf-8")) | {"name": name}
            build(table)
            self._small[name] = _run(build_study(table, self.studies / f"{other}.toml"), self.out / name)
        return self._small[name]

    def origin(self, name: str) -> Origin:
        """Return where a result comes from, by the name of its folder."""
        if name not in self._origins:
            self._origins[name] = self._long(name) if name in LONG else self._study(name)
        return self._origins[name]

    def _long(self, name: str) -> Origin:
        long = LONG[name]
        if not (self.folder / name / long.file).is_file():
            return Origin(name, long.command, "", "missing")
        stamp = load(self.folder / name, name)[1]
        if not stamp:
            return Origin(name, long.command, _day(self.folder / name / long.file), "its code was not kept")
        state = "current" if stamp["code"] == long.code() else "older than the code that decides it"
        return Origin(name, _in_place(stamp.get("command", long.command), name), stamp["made"][:10], state)

    def _study(self, name: str) -> Origin:
        command = f"make study-{name}"
        folder = self.folder / name
        path = folder / (outcome.STORE if name == REALTIME else STORE)
        if not path.is_dir():
            return Origin(name, command, "", "missing")
        attributes = dict(stores.group(path).attrs)
        file = str(attributes.get("study_name", name)) if name == REALTIME else name
        state = state_of(attributes, load_study(self.studies / f"{file}.toml"))
        if name != REALTIME:
            try:
                self.stores[name]  # the runs that are still to come
            except Missing:
                state = "not finished"
        return Origin(name, command, _made(folder, path), state)


def state_of(attributes: Mapping[str, Any], study: StudySpec) -> str:
    """Return whether a store is what the study would give today, or why not."""
    if attributes.get("study_hash") != study.hash:
        return "of an earlier text of the study or its parameters"
    return "current" if attributes.get("engine") == engine_hash(study) else "older than the code that decides it"


def network_origin(path: Path = NETWORK_FILE) -> Origin:
    """Return where the committed network comes from; it is current if today's code finds the errors stored with it."""
    network = load_network(path)
    made = network.made
    plan = Plan(network.sizes[1:-1], network.input_delays, network.output_delays)
    data = training_data.make(training_data.semitrailer(made["trailer_mass"]), Path(made["drives"]), made["seed"])
    today = Trainer(data, plan).errors(network.parameters)
    same = all(
        np.allclose(errors[part], made["nrmse"][kind][part], rtol=1e-3)
        for kind, errors in (("one_step", today.one_step), ("free", today.free))
        for part in training_data.PARTS
    )
    command = "python -m reproductions.narx_training"
    return Origin(path.stem, command, "", "current" if same else "today's code finds other errors than stored with it")


def _made(folder: Path, path: Path) -> str:
    run = folder / "run.json"
    try:
        return str(json.loads(run.read_text())["started"])[:10]
    except (OSError, ValueError, KeyError):
        return _day(path)


def _day(path: Path) -> str:
    return datetime.fromtimestamp(path.stat().st_mtime, UTC).date().isoformat()


def _run(study: StudySpec, folder: Path) -> StudyResults:
    """Run a study into a folder and return its result; what is there by other code or of another text is removed."""
    if (folder / STORE).is_dir():
        attributes = dict(stores.group(folder / STORE).attrs)
        if state_of(attributes, study) != "current" or attributes.get("versions") != code_state(study)["versions"]:
            shutil.rmtree(folder)
    if not (folder / STORE).is_dir() or any(d.count(PENDING) for d in read(folder).designs):
        run_study(study, folder)
    return read(folder)


def _in_place(command: str, name: str) -> str:
    """Return a command as it is for a reader, whose results stand where results stand."""
    return re.sub(r"(--out[ =])('[^']*'|\S+)", rf"\1results/{name}", command)
