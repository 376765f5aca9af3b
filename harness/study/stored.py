"""The study of a stored result, from the text that the store keeps, and whether a replayed run is the stored one."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from harness.common import locations, stores
from harness.common.errors import UserError
from harness.common.files import BUNDLED_STUDIES, parse_toml
from harness.common.places import is_url
from harness.config import StudySpec, build_study
from harness.models.drive_options import options_of
from harness.models.quantities import listed
from harness.study.layout import root_attributes
from harness.study.provenance import differences
from harness.study.replay import Place, Replayed, Replayer
from harness.study.score_names import OVER_TIME, PENDING, STATUS
from harness.study.sealed_root import told_as_no_store
from harness.study.verify import store_of

TOLERANCE = 1e-6
"""Largest difference over the score by which a run of other code or another machine counts as the same."""

_REFERENCE = re.compile(r"[A-Za-z_][\w.]*:[A-Za-z_]\w*")
"""``module:Name``."""


def study_of(folder: Path, beside: Path | None = None) -> StudySpec:
    """Return the study that a result is of.

    The store says all of it but recordings and networks, which are looked for near the result and here. Stores of
    before keep the study as it was written: what that names is looked for in the same places.

    Args:
        folder: Result folder.
        beside: Folder of the study file; files that the study names are looked for there first.

    Raises:
        UserError: If there is no store, or what the study names is not here or not what it was.
    """
    attributes = attributes_of(folder)
    name, text = str(attributes.get("study_name", "study")), attributes.get("self_contained_study")
    content = parse_toml(str(text or attributes.get("study", "")), f"{folder}: the study")
    said = ""
    for place in places_near(folder, beside):
        path = place / f"{name}.toml"
        try:
            study = build_study(content, path)
        except UserError as error:
            said = said or str(error).replace(f"{path}: ", "")
            continue
        if study.hash == attributes.get("study_hash"):
            return study
        if text and (files := _files(study)):
            said = f"it needs {listed(files)} as {'it was' if len(files) == 1 else 'they were'}"
        elif text:
            said = "this version of the harness makes another study of what the result says of its own"
        else:
            said = f"it {differences(attributes, root_attributes(study), study)}"
    raise UserError(
        f"{folder}: no run can be computed again: {said}; work in the project that has what it needs, or name its "
        "study file with --study"
    )


def places_near(folder: Path, beside: Path | None = None) -> list[Path]:
    """Return the folders in which files that a study names are looked for: its own, near the result, and here."""
    project = locations.project()
    near = [] if is_url(folder) else [p for above in folder.absolute().parents[:2] for p in (above, above / "studies")]
    places_tried = [beside, project and project / "studies", Path("studies"), *near, Path(), BUNDLED_STUDIES]
    return list(dict.fromkeys(p for p in places_tried if p is not None))


def _files(study: StudySpec) -> list[str]:
    """Return the files that drives and estimators of a study name."""
    of_drives = [
        str(drive.options[option.name])
        for drive in study.drives
        for option in options_of(drive.kind)
        if option.unit == "text" and option.name in drive.options
    ]
    settings = [text for e in study.estimators for text in _texts(e.settings)]
    named = [n for n in of_drives + settings if Path(n).suffix[1:].isalnum() or _REFERENCE.fullmatch(n)]
    return list(dict.fromkeys(named))


def _texts(options: Any) -> list[str]:
    """Return the texts in settings, at any depth."""
    if isinstance(options, Mapping):
        options = list(options.values())
    if isinstance(options, list):
        return [text for each in options for text in _texts(each)]
    return [options] if isinstance(options, str) else []


def attributes_of(folder: Path) -> dict[str, Any]:
    """Return the attributes of a store's root.

    Raises:
        UserError: If there is no store.
    """
    path = store_of(folder)
    with told_as_no_store(path):
        return dict(stores.group(path).attrs)


@dataclass(frozen=True)
class Comparison:
    """Whether the scores of a replayed run are those of the store.

    Attributes:
        same: To the last bit.
        largest: Largest difference over the score; 0 where all bits are the same, NaN where one has none.
        words: The same in a sentence.
    """

    same: bool
    largest: float
    words: str


def stored_scores(folder: Path, study: StudySpec, run: Replayed) -> dict[str, np.ndarray]:
    """Return the stored scores of a run by name, ``(estimator,)`` or ``(estimator, target)``.

    Raises:
        UserError: If they cannot be read.
    """
    place: Place = run.place
    at, chosen = (place.band, place.sample, place.drive, place.repeat), list(run.estimators)
    try:
        group: Any = stores.group(store_of(folder), study.designs[place.design].name)
        return {name: np.asarray(group[name][at])[chosen] for name in run.scores if name != OVER_TIME}
    except (KeyError, ValueError, OSError, RuntimeError) as error:  # the last where a chunk cannot be unpacked
        why = f"{type(error).__name__}: {error}"
        raise UserError(
            f"{folder}: its scores cannot be read ({why}); 'harness verify' says what is damaged"
        ) from error


def compare(
    run: Replayed,
    stored: Mapping[str, np.ndarray],
    attributes: Mapping[str, Any],
    now: Mapping[str, Any],
    study: StudySpec,
) -> Comparison:
    """Compare a run with what is stored of it.

    Args:
        run: Without changes.
        stored: From ``stored_scores``.
        attributes: Of the store.
        now: What they would be now (``root_attributes``).
        study: The study.
    """
    if np.all(stored[STATUS] == PENDING):
        return Comparison(False, np.nan, "This run is not in the store yet.")
    if all(np.array_equal(values, stored[name], equal_nan=True) for name, values in run.scores.items()):
        return Comparison(True, 0.0, "The scores are those of the store, to the last bit.")
    largest = max(_difference(values, stored[name]) for name, values in run.scores.items())
    why = differences(attributes, now, study)
    if attributes.get("machine") != now["machine"]:
        other = f"was computed on {attributes.get('machine')}, here it is {now['machine']}"
        why = f"{why}; it {other}" if why else other
    size = f"differ from those of the store by up to {largest:.2g} of the score"
    if largest <= TOLERANCE:
        return Comparison(False, largest, f"The scores {size}, within the tolerance of {TOLERANCE:g}. {_because(why)}")
    return Comparison(False, largest, f"The scores {size}: this is not the stored run. {_because(why)}")


def _because(why: str) -> str:
    return f"The store {why}." if why else "Code, packages and processor are the same: let harness verify look at it."


def _difference(values: np.ndarray, stored: np.ndarray) -> float:
    """Return the largest difference over the larger of both; infinite where only one is a number."""
    computed, other = values.astype(float), stored.astype(float)
    if not np.array_equal(np.isnan(computed), np.isnan(other)):
        return np.inf
    size = np.maximum(np.abs(computed), np.abs(other))
    with np.errstate(invalid="ignore"):
        shares = np.abs(computed - other) / np.where(size > 0, size, 1.0)
    return float(np.nanmax(shares, initial=0.0))


class StoredRuns:
    """The runs of a result folder, which can be computed again.

    Args:
        folder: Result folder.
        beside: Folder of the study file; files that the study names are looked for there first.

    Attributes:
        folder: The same.
        study: That the result is of.

    Raises:
        UserError: If there is no store, or what the study names is not what it was.
    """

    def __init__(self, folder: Path, beside: Path | None = None) -> None:
        self.folder, self.study = folder, study_of(folder, beside)
        self._stored, self._now = attributes_of(folder), root_attributes(self.study)

    @cached_property
    def replayer(self) -> Replayer:
        """What computes its runs; recordings, plants and estimators that it needs are looked for only now.

        Raises:
            UserError, ModelError: If one is not there, or not what it was.
        """
        return Replayer(self.study)

    def stored(self, run: Replayed) -> dict[str, np.ndarray]:
        """Return what the store has of a run, see ``stored_scores``."""
        return stored_scores(self.folder, self.study, run)

    def comparison(self, run: Replayed, stored: Mapping[str, np.ndarray]) -> Comparison:
        """Return whether the scores of a run are those that are ``stored``."""
        return compare(run, stored, self._stored, self._now, self.study)
