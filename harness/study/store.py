"""The store of a study's scores: Zarr through xarray, resumable, and the same bits however it was filled.

One group per design, with the plain dimensions ``band, sample, drive, repeat, estimator, target``. Every unit has
chunks of its own, so threads and processes write without knowing of each other. ``status`` is written after
the scores of a unit, so a unit whose status is pending counts as not done, and the checksums of all its chunks last
(``harness.study.checksums``). Nothing that depends on the number of workers or on the clock is in the store;
``run.json`` next to it tells that. When a study ends, ``consolidate`` copies the metadata of all groups into the root,
so that ``xarray.open_datatree`` reads the whole store without looking for its groups; checksums cover the groups' own
metadata, which everything here reads.
"""

from __future__ import annotations

import contextlib
import json
import tempfile
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numcodecs.zstd import Zstd
from numpy.typing import NDArray

from harness.common import places, stores
from harness.common.errors import UserError
from harness.config import StudySpec
from harness.study import checksums, sealed_root
from harness.study.checksums import HISTORY, Fault
from harness.study.design import Unit, unit_counts, unit_shape
from harness.study.layout import as_text, create, root_attributes, words
from harness.study.provenance import differences
from harness.study.score_names import LOST, OVER_TIME, PENDING, STATUS

if TYPE_CHECKING:
    import xarray as xr

    from harness.study.evaluate import StudyEvaluator

STORE = "scores.zarr"


class Store:
    """The scores of a study in a folder.

    Args:
        study: The study.
        evaluator: Returns its compiled models; asked for what an empty store says of them, if there is need of it.
        folder: Result folder; created if need be.
        mend: Whether to look for files that are missing or damaged, and to forget the units that they belong to. Not
            while others write.

    Attributes:
        mended: What was found to be missing or damaged; none of it is any more, but its units are pending.

    Raises:
        UserError: If the folder holds another study's result, or this study's computed by other code.
    """

    def __init__(
        self, study: StudySpec, evaluator: Callable[[], StudyEvaluator], folder: Path, mend: bool = False
    ) -> None:
        self.study, self.folder, self.path = study, folder, folder / STORE
        self._attributes = root_attributes(study)
        self.mended: list[Fault] = []
        if sealed_root.is_there(self.path):
            with sealed_root.told_as_no_store(self.path):
                mended = sealed_root.restore(self.path) if mend else None
                self._check_same_study()
                self._renew_words()
                if mend:
                    self._mend(evaluator)
                    self.mended += [mended] if mended else []
        else:
            try:
                if not places.is_url(folder):
                    folder.mkdir(parents=True, exist_ok=True)
            except OSError as error:
                raise UserError(f"cannot create the result folder {folder}: {error.strerror}") from error
            with places.whole(self.path, sealed_root.LAST) as unfinished:  # half of a store would look like a whole one
                self._create(evaluator(), unfinished)
        groups: list[Any] = [stores.group(self.path, d.name, "r+") for d in study.designs]
        sums: Any = stores.group(self.path, checksums.GROUP, "r+")
        self._sums: list[dict[str, Any]] = [dict(sums[d.name].attrs) for d in study.designs]
        self._encoders = [
            {name: ChunkEncoder(group[name]) for name in about["arrays"]}
            for group, about in zip(groups, self._sums, strict=True)
        ]
        self._pending = [np.isin(np.asarray(group[STATUS][...]), (PENDING, LOST)) for group in groups]

    def was_done(self, unit: Unit) -> bool:
        """Return whether a unit's scores were in the store when it was opened; what was lost is tried again."""
        return not np.any(self._pending[unit.design][unit.band, unit.samples, unit.drive, unit.repeats])

    def write(self, unit: Unit, result: dict[str, NDArray[np.generic]]) -> None:
        """Write a unit's scores, from any thread or process; the status comes after them, the checksums last."""
        place, written = place_of(self.study, unit), {}
        files = checksums.chunk_files(self._sums[unit.design], place)
        for name in sorted(result, key=lambda name: name == STATUS):
            written[name] = self._encoders[unit.design][name].encode(result[name])
            places.write(self.path / files[name], written[name])
        places.write(self.path / checksums.row_file(place), checksums.row(files, written))

    @property
    def has_histories(self) -> bool:
        """Whether every run to be drawn over time is there."""
        root = stores.group(self.path)
        return HISTORY in root and root[HISTORY].attrs.get("runs") == len(self.study.history)

    def write_histories(self, histories: Sequence[xr.Dataset]) -> None:
        """Write the runs to be drawn over time, each to a group ``history/<index>``; their number comes last."""
        root = stores.group(self.path, mode="r+")
        group = root.create_group(HISTORY, overwrite=True)
        for index, history in enumerate(histories):
            history = history.assign_coords({n: as_text(history[n].values) for n in ("estimator", "target")})
            history.attrs["rmse"] = json.dumps(history.attrs["rmse"])
            stores.write(history, self.path, f"{HISTORY}/{index}")
        group.attrs.update({"files": checksums.of_files(self.path, HISTORY), "runs": len(histories)})

    def consolidate(self) -> None:
        """Copy the metadata of all groups into those of the root; the same bits however often it is done."""
        stores.consolidate(self.path)

    def _mend(self, evaluator: Callable[[], StudyEvaluator]) -> None:
        """Put back what an empty store has, and make the units pending that have lost something else."""
        places.remove_unfinished(self.path)
        self.mended = sealed_root.faults(self.path)
        if not self.mended:
            return
        try:
            self._restore_skeleton(evaluator())
            lost = checksums.faults(self.path)
            for unit in dict.fromkeys(fault.unit for fault in lost if fault.unit is not None):
                self._forget(evaluator(), unit)
            if any(fault.unit is None for fault in lost):
                with contextlib.suppress(FileNotFoundError):
                    places.remove(self.path / HISTORY)
        except OSError as error:
            raise UserError(
                f"{self.path}: {checksums.described(self.mended)}, and it cannot be mended: {error.strerror or error}"
            ) from error

    def _restore_skeleton(self, evaluator: StudyEvaluator) -> None:
        """Put back what an empty store has."""
        with tempfile.TemporaryDirectory() as folder:
            empty = Path(folder) / STORE
            self._create(evaluator, empty)
            own = [name for name in places.names(empty) if name != "zarr.json"]
            there = places.contents(self.path, own)
            for name, content, wanted in zip(own, there, places.contents(empty, own), strict=True):
                if content != wanted:
                    places.write(self.path / name, wanted)

    def _forget(self, evaluator: StudyEvaluator, place: checksums.Place) -> None:
        """Delete the chunks of a unit: its checksums first, then its status."""
        sums: Any = stores.group(self.path, checksums.GROUP)
        files = checksums.chunk_files(sums[place[0]].attrs, place)
        names = [d.name for d in self.study.designs]
        if evaluator.windows.count(names.index(place[0]), place[3]) is None:
            files.pop(OVER_TIME, None)  # another drive's
        for file in [checksums.row_file(place), *sorted(files.values(), key=lambda file: file != files[STATUS])]:
            (self.path / file).unlink(missing_ok=True)

    def _check_same_study(self) -> None:
        try:
            attributes = dict(stores.group(self.path).attrs)
        except UserError:
            raise
        except (FileNotFoundError, ValueError, KeyError) as error:
            raise UserError(f"{self.path} is not a result of this harness; choose another folder with --out") from error
        if wrong := differences(attributes, self._attributes, self.study):
            raise UserError(
                f"{self.folder} {wrong}; choose another folder with --out, or throw that result away with --restart"
            )
        self._attributes = {str(k): v for k, v in attributes.items()}

    def _renew_words(self) -> None:
        """Take over what the study now says that decides no score: title, comments, limits."""
        new = {key: value for key, value in words(self.study).items() if self._attributes.get(key) != value}
        if new:
            stores.group(self.path, mode="r+").attrs.update(new)
            self._attributes |= new
            sealed_root.seal(self.path)

    def _create(self, evaluator: StudyEvaluator, path: Path) -> None:
        create(self.study, evaluator, path, self._attributes)
        sealed_root.seal(path)


def place_of(study: StudySpec, unit: Unit) -> checksums.Place:
    """Return the place of a unit in the store."""
    design = study.designs[unit.design]
    samples, repeats = unit_shape(study, design)
    chunk = unit.first // samples * unit_counts(study, design)[1] + unit.first_repeat // repeats
    return design.name, unit.band, chunk, unit.drive


def discardable(folder: Path) -> dict[str, Any] | None:
    """Return the attributes of the result in a folder, ``None`` where there is none.

    Raises:
        UserError: If what is there is not a result of a study.
    """
    path = folder / STORE
    if not sealed_root.is_there(path):
        return None
    try:
        attributes = dict(stores.group(path).attrs)
        attributes["study_name"]
    except UserError:
        raise
    except (FileNotFoundError, ValueError, KeyError) as error:
        raise UserError(f"{path} is not a result of this harness, so that --restart leaves it alone") from error
    return attributes


def discard(folder: Path) -> str:
    """Delete the result in a folder, its scores, record and report, and say what it was.

    Raises:
        UserError: If what is there is not a result of a study, or cannot be deleted.
    """
    path, attributes = folder / STORE, discardable(folder)
    if attributes is None:
        return f"{folder} holds no result to throw away"
    name = str(attributes["study_name"])
    done = 0
    for design in checksums.names(attributes["designs"]):
        done += len(checksums.finished(path, design))
    try:
        (folder / "run.json").unlink(missing_ok=True)
        for report in ("report.html", "report.pdf", "errors.txt"):
            (folder / report).unlink(missing_ok=True)
        places.remove(path)
    except OSError as error:
        raise UserError(f"{folder}: cannot be thrown away: {error.strerror or error}") from error
    commit = str(attributes.get("commit", "unknown"))[:10]
    return f"thrown away: the result of study '{name}' in {folder}, {done} finished units, computed by commit {commit}"


class ChunkEncoder:
    """Encodes the chunks of one array bit for bit as Zarr does, without its machinery.

    There may be millions of units, each one chunk of every array. Zarr plans each write and hands it to another thread,
    which for runs of a few seconds takes longer than to compute them.

    Args:
        array: The array, opened by Zarr.

    Raises:
        ValueError: If its metadata ask for something that ``harness.study.layout`` does not.
    """

    def __init__(self, array: Any) -> None:
        metadata = array.metadata.to_dict()
        self._dims = [str(d) for d in metadata["dimension_names"]]
        self._shape = tuple(array.chunks)
        self._fill = array.fill_value
        first, *packed = metadata["codecs"]
        endian = (first.get("configuration") or {}).get("endian", "little")
        if first["name"] != "bytes" or str(getattr(endian, "value", endian)) != "little":
            raise ValueError(f"{array.path}: cannot encode {first}")
        self._type = array.dtype.newbyteorder("<")
        self._pack: list[Callable[[bytes], bytes]] = []
        for codec in packed:
            if codec["name"] != "zstd":
                raise ValueError(f"{array.path}: cannot encode {codec}")
            self._pack.append(Zstd(**codec["configuration"]).encode)

    def encode(self, values: NDArray[Any]) -> bytes | None:
        """Return a chunk as it lies in its file; ``None`` if it holds nothing but the fill value, which takes none.

        Args:
            values: Of one unit: along every dimension of the array but band and drive.
        """
        places = iter(values.shape)
        within = tuple(1 if d in ("band", "drive") else next(places) for d in self._dims)
        values = values.reshape(within)
        if within != self._shape:  # the last along samples or repeats
            whole = np.full(self._shape, self._fill, dtype=self._type)
            whole[tuple(slice(n) for n in within)] = values
            values = whole
        if bool(np.all(np.isnan(values)) if self._fill != self._fill else np.all(values == self._fill)):
            return None
        content = np.ascontiguousarray(values, dtype=self._type).tobytes()
        for pack in self._pack:
            content = bytes(pack(content))
        return content
