"""Does a store hold what was written, and would this code write the same again?"""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from harness.common import places, stores
from harness.common.errors import UserError
from harness.common.places import reached
from harness.config import StudySpec
from harness.config.specs import Device
from harness.study import run_file, sealed_root
from harness.study.checksums import Fault, finished
from harness.study.design import Unit, units
from harness.study.devices import device
from harness.study.evaluate import StudyEvaluator
from harness.study.layout import root_attributes
from harness.study.provenance import differences
from harness.study.score_names import OVER_TIME
from harness.study.store import STORE, place_of


@dataclass(frozen=True)
class Verification:
    """What a check of a store has found.

    Attributes:
        files: Number of files looked at.
        lost: Those that are missing or damaged.
        finished: Number of finished units.
        recomputed: Units that were computed again.
        differing: Those whose scores are not the stored bits, in words, with the first array that differs.
        runs: Runs of the recomputed units.
        other_code: How code or packages differ from those that wrote the store; empty if they do not.
    """

    files: int
    lost: list[Fault]
    finished: int
    recomputed: list[Unit]
    differing: list[str]
    runs: int
    other_code: str

    @property
    def holds(self) -> bool:
        """Whether nothing is lost and every recomputed unit has the same bits."""
        return not self.lost and not self.differing


def store_of(folder: Path) -> Path:
    """Return the store in a result folder.

    Raises:
        UserError: If there is none.
    """
    path = folder / STORE
    if not sealed_root.is_there(path):
        raise UserError(f"{folder}: there is no result of a study here ({STORE} is missing)")
    return path


def verify(folder: Path, find: Callable[[], StudySpec], sample: int = 3, seed: int | None = None) -> Verification:
    """Check every file of a store against its checksum, and compute some of its units again.

    Args:
        folder: Result folder.
        find: Returns the study of the result; asked only if nothing is lost and units are to be computed.
        sample: How many finished units to compute again, drawn at random; fewer where there are fewer.
        seed: Of the draw; another one each time by default.

    Raises:
        UserError: If there is no store, it has no checksums, a file next to it is damaged, or ``find`` does not
            give the study that it is of.
    """
    with reached(folder):
        return _verify(folder, find, sample, seed)


def _verify(folder: Path, find: Callable[[], StudySpec], sample: int, seed: int | None) -> Verification:
    path = store_of(folder)
    with sealed_root.told_as_no_store(path):
        lost = sealed_root.faults(path)
        attributes = dict(stores.group(path).attrs) if not lost else {}
    files = len(places.names(path))
    if not lost and (record_faults := run_file.faults(folder)):
        raise UserError(record_faults[0])
    if lost or not sample:
        return Verification(files, lost, 0, [], [], 0, "")
    try:
        study = replace(find(), device=_device(attributes))
    except UserError as error:
        raise UserError(f"every file is as it was written; {error}, or compute none with --sample 0") from None
    other = differences(attributes, root_attributes(study), study)
    if study.hash != attributes.get("study_hash"):
        raise UserError(
            f"every file is as it was written, but nothing can be computed again: {folder} {other}; give the study of "
            "this result with --study, or none to compute with --sample 0"
        )
    done = {place for d in study.designs for place in finished(path, d.name)}
    in_store = [u for d in study.designs for u in units(study, d) if place_of(study, u) in done]
    drawn = np.random.default_rng(seed).permutation(len(in_store))[:sample]
    chosen = [in_store[i] for i in sorted(drawn)]
    evaluate = evaluator_of(study)
    differing = [
        f"{_in_words(study, u)}: '{array}' computed again is not what is stored"
        for u in chosen
        if (array := _first_difference(path, study, evaluate, u))
    ]
    return Verification(files, lost, len(in_store), chosen, differing, sum(u.runs(study) for u in chosen), other)


def _device(attributes: dict[str, Any]) -> Device:
    """Return what computed a store."""
    versions = json.loads(attributes.get("versions", "{}"))
    chosen: Device = versions.get("device", "cpu")
    return chosen


def evaluator_of(study: StudySpec) -> Callable[[Unit], dict[str, NDArray[np.generic]]]:
    """Return what computes the scores of a unit, on the device of the study."""
    evaluator = StudyEvaluator(study)
    if study.device == "cpu":
        return evaluator.evaluate
    elsewhere = device(study.device).evaluator(evaluator)

    def evaluate(unit: Unit) -> dict[str, NDArray[np.generic]]:
        ((_, scores),) = elsewhere.evaluate([unit])
        return dict(scores)

    return evaluate


def _first_difference(
    path: Path, study: StudySpec, evaluate: Callable[[Unit], dict[str, NDArray[np.generic]]], unit: Unit
) -> str:
    """Return the first array in which a unit computed again differs from the store; empty if none does."""
    group: Any = stores.group(path, study.designs[unit.design].name)
    for name, values in evaluate(unit).items():
        drive = () if name == OVER_TIME else (unit.drive,)
        stored = np.asarray(group[name][unit.band, unit.samples, *drive, unit.repeats])
        if not np.array_equal(stored, values, equal_nan=True):
            return name
    return ""


def _in_words(study: StudySpec, unit: Unit) -> str:
    """Return what a unit holds: design, band, drive and runs."""
    design = study.designs[unit.design]
    return (
        f"{design.name}, {design.band_labels[unit.band]}, {study.drives[unit.drive].name}, samples {unit.first} to "
        f"{unit.stop - 1}"
    )
