"""The store of a study's scores: Zarr through xarray, resumable, and the same bits however it was filled.

One group per design, with the plain dimensions ``band, sample, drive, repeat, estimator, target``. Every unit has
chunks of its own, so threads and processes write without knowing of each other. ``status`` is written after
the scores of a unit, so a unit whose status is pending counts as not done, and the checksums of all its chunks last
(``harness.study.checksums``). Nothing that depends on the number of workers or on the clock is in the store;
``run.json`` beside it tells that. When a study ends, ``consolidate`` copies the metadata of all groups into the root,
so that ``xarray.open_datatree`` reads the whole store without looking for its groups; checksums cover the groups' own
metadata, which everything here reads.
"""

from __future__ import annotations

import json
import platform
import shutil
import warnings
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr
import zarr
from numpy.typing import NDArray

from harness.common.errors import UserError
from harness.config import DesignSpec, Study
from harness.models.signals import SIGNALS
from harness.study import checksums
from harness.study.checksums import HISTORY, Fault
from harness.study.design import Unit, points, samples_per_unit
from harness.study.evaluate import StudyEvaluator
from harness.study.provenance import code_state, commit, processor
from harness.study.scores import FLAGS, MEANINGS, OVER_TIME, PENDING, PER_RUN, PER_TARGET, STATUS

STORE = "scores.zarr"


class Store:
    """The scores of a study in a folder.

    Args:
        study: The study.
        evaluator: Its compiled models (for the dimensions of state and output).
        folder: Result folder; created if need be.
        mend: Whether to look for files that are missing or damaged, and to forget the units that they belong to. Not
            while others write.

    Attributes:
        mended: What was found to be missing or damaged; none of it is any more, but its units are pending.

    Raises:
        UserError: If the folder holds another study's result, or this study's computed by other code.
    """

    def __init__(self, study: Study, evaluator: StudyEvaluator, folder: Path, mend: bool = False) -> None:
        self.study, self.folder, self.path = study, folder, folder / STORE
        self._attributes = _root_attributes(study)
        self.mended: list[Fault] = []
        if self.path.exists():
            self._check_same_study()
            self._renew_words()
            if mend:
                self._mend(evaluator)
        else:
            try:
                folder.mkdir(parents=True, exist_ok=True)
            except OSError as error:
                raise UserError(f"cannot create the result folder {folder}: {error.strerror}") from error
            self._create(evaluator, self.path)
        groups: list[Any] = [zarr.open_group(str(self.path), path=d.name, mode="r+") for d in study.designs]
        self._arrays: list[dict[str, Any]] = [dict(group.arrays()) for group in groups]
        sums: Any = zarr.open_group(str(self.path), path=checksums.GROUP, mode="r+")
        self._sums: list[Any] = [sums[d.name] for d in study.designs]
        self._pending = [np.asarray(arrays[STATUS][...]) == PENDING for arrays in self._arrays]

    def was_done(self, unit: Unit) -> bool:
        """Return whether a unit's scores were in the store when it was opened."""
        return not np.any(self._pending[unit.design][unit.band, unit.samples, unit.drive])

    def write(self, unit: Unit, result: dict[str, NDArray[np.generic]]) -> None:
        """Write a unit's scores, from any thread or process; the status comes after them, the checksums last."""
        for name in sorted(result, key=lambda name: name == STATUS):
            drive = () if name == OVER_TIME else (unit.drive,)  # kept along one drive only
            self._arrays[unit.design][name][unit.band, unit.samples, *drive] = result[name]
        design = self.study.designs[unit.design]
        place = design.name, unit.band, unit.first // samples_per_unit(design), unit.drive
        checksums.write(self.path, self._sums[unit.design], place, list(result))

    @property
    def has_histories(self) -> bool:
        """Whether every run to be drawn over time is there."""
        root = zarr.open_group(str(self.path), mode="r", use_consolidated=False)
        return HISTORY in root and root[HISTORY].attrs.get("runs") == len(self.study.history)

    def write_histories(self, histories: Sequence[xr.Dataset]) -> None:
        """Write the runs to be drawn over time, each to a group ``history/<index>``; their number comes last."""
        root = zarr.open_group(str(self.path), mode="r+", use_consolidated=False)
        group = root.create_group(HISTORY, overwrite=True)
        for index, history in enumerate(histories):
            history = history.assign_coords({n: _text(history[n].values) for n in ("estimator", "target")})
            history.attrs["rmse"] = json.dumps(history.attrs["rmse"])
            name = f"{HISTORY}/{index}"
            history.to_zarr(self.path, group=name, mode="w", consolidated=False, zarr_format=3)
        group.attrs.update({"files": checksums.of_files(self.path, HISTORY), "runs": len(histories)})

    def consolidate(self) -> None:
        """Copy the metadata of all groups into those of the root; the same bits however often it is done."""
        with warnings.catch_warnings():
            # Version 3 of the format leaves these copies to the libraries; whoever ignores them reads the same.
            warnings.simplefilter("ignore", zarr.errors.ZarrUserWarning)
            zarr.consolidate_metadata(str(self.path), zarr_format=3)

    def _mend(self, evaluator: StudyEvaluator) -> None:
        """Put back what an empty store has, and make the units pending that have lost something else."""
        self.mended = checksums.faults(self.path)
        if not self.mended:
            return
        empty = self.folder / (STORE + ".empty")
        shutil.rmtree(empty, ignore_errors=True)
        try:
            self._create(evaluator, empty)
            for file in (p for p in empty.rglob("*") if p.is_file() and p.parent != empty):
                there = self.path / file.relative_to(empty)
                if checksums.digest(there) != checksums.digest(file):
                    there.parent.mkdir(parents=True, exist_ok=True)
                    shutil.copyfile(file, there)
            shutil.rmtree(empty)
            lost = checksums.faults(self.path)
            for unit in dict.fromkeys(fault.unit for fault in lost if fault.unit is not None):
                self._forget(evaluator, unit)
            if any(fault.unit is None for fault in lost):
                shutil.rmtree(self.path / HISTORY, ignore_errors=True)
        except OSError as error:
            raise UserError(
                f"{self.path}: {checksums.described(self.mended)}, and it cannot be mended: {error.strerror or error}"
            ) from error

    def _forget(self, evaluator: StudyEvaluator, place: checksums.Place) -> None:
        """Delete the chunks of a unit, that of the status first."""
        sums: Any = zarr.open_group(str(self.path), path=checksums.GROUP, mode="r")
        dims = dict(sums[place[0]].attrs["arrays"])
        names = [d.name for d in self.study.designs]
        if evaluator.windows.count(names.index(place[0]), place[3]) is None:
            dims.pop(OVER_TIME, None)  # another drive's
        files = checksums.chunk_files(dims, place)
        for name in sorted(files, key=lambda name: name != STATUS):
            (self.path / files[name]).unlink(missing_ok=True)

    def _check_same_study(self) -> None:
        try:
            found = dict(zarr.open_group(str(self.path), mode="r").attrs)
        except (FileNotFoundError, ValueError, KeyError) as error:
            raise UserError(f"{self.path} is not a result of this harness; choose another folder with --out") from error
        way_out = f"remove {self.folder} or choose another folder with --out"
        if found.get("study_name") != self.study.name:
            raise UserError(f"{self.folder} holds the result of study '{found.get('study_name')}'; {way_out}")
        if found.get("study_hash") != self.study.hash:
            raise UserError(f"{self.folder} was computed from an earlier text of {self.study.path}; {way_out}")
        for key, what in (
            ("engine", "by other code of this project"),
            ("versions", "with other package versions"),
        ):
            if found.get(key) != self._attributes[key]:
                raise UserError(f"{self.folder} was computed {what}; {way_out}")
        self._attributes = {str(k): v for k, v in found.items()}

    def _renew_words(self) -> None:
        """Take over what the study now says that decides no score: title, comments, limits."""
        words = {key: value for key, value in _words(self.study).items() if self._attributes.get(key) != value}
        if words:
            zarr.open_group(str(self.path), mode="r+").attrs.update(words)

    def _create(self, evaluator: StudyEvaluator, path: Path) -> None:
        # A half-created store would look like a whole one, so it is made elsewhere and moved into place.
        temporary = path.with_name(path.name + ".new")
        if temporary.exists():
            shutil.rmtree(temporary)
        root = zarr.open_group(str(temporary), mode="w", zarr_format=3)
        root.attrs.update(self._attributes)
        for design in self.study.designs:
            dataset = _empty(self.study, design, evaluator)
            scores = {name: array for name, array in dataset.data_vars.items() if array.ndim > 2}
            encoding = {
                name: {"chunks": _chunks(design, array), "fill_value": PENDING if name == STATUS else np.nan}
                for name, array in scores.items()
            }  # a chunk that holds nothing but the fill value takes no file
            dataset.to_zarr(
                temporary, group=design.name, mode="w", consolidated=False, zarr_format=3, encoding=encoding
            )
            dims = {str(name): [str(d) for d in array.dims] for name, array in scores.items()}
            chunks = -(-design.samples // samples_per_unit(design))
            checksums.declare(temporary, design.name, dims, (design.bands, chunks, len(self.study.drives)))
        temporary.rename(path)


def _chunks(design: DesignSpec, array: xr.DataArray) -> tuple[int, ...]:
    """Return the shape of the chunks of an array of scores: those of one unit."""
    own = {"band": 1, "sample": samples_per_unit(design), "drive": 1}
    return tuple(min(own.get(str(dim), size), size) for dim, size in array.sizes.items())


def _empty(study: Study, design: DesignSpec, evaluator: StudyEvaluator) -> xr.Dataset:
    """Return a design's dataset with every score pending."""
    table = points(study, design)
    sizes = (design.bands, design.samples, len(study.drives), design.repeats, len(study.estimators))
    dims = ("band", "sample", "drive", "repeat", "estimator")
    targets = list(study.targets)
    variables: dict[str, Any] = {}
    for name in PER_TARGET:
        values = np.full((*sizes, len(targets)), np.nan)
        variables[name] = (
            (*dims, "target"),
            values,
            {"long_name": MEANINGS[name], "units": "unit of the target"},
        )
    for name in PER_RUN:
        unit = "s" if name == "time_of_divergence" else "1"
        variables[name] = (dims, np.full(sizes, np.nan), {"long_name": MEANINGS[name], "units": unit})
    status = np.full(sizes, PENDING, dtype=np.int8)
    index, drives = study.designs.index(design), range(len(study.drives))
    kept = [w for d in drives if (w := evaluator.windows.count(index, d)) is not None]
    if kept:
        without_drive = (*sizes[:2], *sizes[3:], len(targets), kept[0])
        variables[OVER_TIME] = (
            (*dims[:2], *dims[3:], "target", "window"),
            np.full(without_drive, np.nan, dtype=np.float32),
            {"long_name": MEANINGS[OVER_TIME], "units": "unit of the target"},
        )
    for i, factor in enumerate(table.factors):
        unit = design.factors[i].unit
        variables[f"factor_{factor}"] = (("band", "sample"), table.values[:, :, i], {"units": unit})
    flags = {"flag_values": list(FLAGS.values()), "flag_meanings": " ".join(FLAGS)}  # as CF has them
    variables[STATUS] = (dims, status, {"long_name": MEANINGS[STATUS], **flags})
    factors = [
        {
            "name": name,
            "parameter": f.parameter,
            "of": f.of,
            "unit": f.report_unit,
            "si_unit": f.unit,
            "nominal": f.nominal,
            "scale": "log" if f.log else "linear",
            "lower": list(f.lower),
            "upper": list(f.upper),
        }
        for name, f in zip(table.factors, design.factors, strict=True)
    ]
    coordinates = {
        "drive": _text([d.name for d in study.drives]),
        "estimator": _text([e.name for e in study.estimators]),
        "target": _text(targets),
        "band_label": ("band", _text(table.band_labels)),
        "target_unit": ("target", _text([SIGNALS[t].unit for t in targets])),
        "duration": ("drive", [float(d.profile.time[-1]) for d in evaluator.compiled.drives], {"units": "s"}),
    }
    attributes = {
        "factors": json.dumps(factors),
        "state_dimension": evaluator.compiled.belief.nx,
        "output_dimension": evaluator.compiled.belief.ny,
        "sampling": design.sampling,
        "base_samples": design.base_samples,
        "samples": design.samples,
        "repeats": design.repeats,
    }
    if kept and study.over_time is not None:
        attributes |= {"over_time_drive": study.over_time.drive, "over_time_window": study.over_time.window}
    return xr.Dataset(variables, coords=coordinates, attrs=attributes)


def _text(words: Iterable[Any]) -> NDArray[Any]:
    """Return text of any length, which Zarr's format specifies; text of fixed length it does not."""
    return np.array([str(w) for w in words], dtype=object)


def _root_attributes(study: Study) -> dict[str, Any]:
    sides = {"plant": study.plant, "belief": study.belief}
    description: dict[str, Any] = {
        side: {
            "model": spec.model().name,
            "parameters": spec.parameters,
            "tyre": spec.tyre,
            "effects": list(spec.effects),
            "sensors": spec.sensors,
            "integrator": spec.integrator,
            "substeps": spec.substeps,
            "unknown_inputs": list(spec.unknown_inputs),
            "process_noise": spec.process_noise,
            "measurement_noise": spec.measurement_noise,
        }
        for side, spec in sides.items()
    }
    plant, belief = study.plant.values, study.belief.values
    units = {p.name: p.unit for spec in sides.values() for p in spec.model().parameters}
    description["tuning"] = study.tuning or "every estimator believes the noise of the belief"
    description["noise_factors"] = {e.name: e.noise for e in study.estimators if e.noise}
    description["differing"] = {
        name: {"plant": plant.get(name), "belief": belief.get(name), "unit": units.get(name, "")}
        for name in sorted(plant.keys() | belief.keys())
        if plant.get(name) != belief.get(name)
    }
    return {
        **_words(study),
        checksums.GROUP: {"histories": len(study.history)},
        "study_name": study.name,
        "study_hash": study.hash,
        "seed": study.seed,
        "step": study.plant.step,
        "designs": json.dumps([d.name for d in study.designs]),
        "description": json.dumps(description, sort_keys=True),
        **code_state(study),
        "commit": commit(),
        "machine": f"{platform.system()} {platform.machine()}, {processor()}",
    }


def _words(study: Study) -> dict[str, Any]:
    """Return what the report tells of a study and no score depends on."""
    return {"study": study.text, "title": study.title, "limits": json.dumps(study.limits)}
