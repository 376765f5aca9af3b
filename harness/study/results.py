"""Read a finished result folder into arrays in report units, ready to be drawn."""

from __future__ import annotations

import json
from collections.abc import Iterator
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from harness.common import stores
from harness.common.errors import MissingFileError, UserError
from harness.common.places import reached
from harness.common.units import registry
from harness.models.quantities import Quantity, capital, print_unit, quantity, words
from harness.study import bound_file, rare_file, run_file, sealed_root, trust_file
from harness.study.checksums import HISTORY, described, is_verifiable
from harness.study.score_names import ESTIMATOR_DIVERGED, LOST, LOST_CONTROL, OK, PENDING, PLANT_DIVERGED

_RUN_DIMS = ("band", "estimator", "drive", "sample", "repeat")

_HELD = 256e6
"""Bytes of a design's scores up to which all are read at once; of a larger one each array when it is asked for."""

_SMALL = 1e6
"""Bytes of an array up to which its samples are read at once."""

_CHUNKS_AT_ONCE = 256
"""Chunks of a larger one that are read at once, over all drives."""

_KEPT = 2
"""Scores without target that a design of more than ``_HELD`` keeps in memory: those asked for last."""


@dataclass(frozen=True)
class Factor:
    """A factor of a design; all numbers in its report unit.

    Attributes:
        name: Parameter name.
        words: The name in words.
        unit: Unit as printed.
        of: ``plant``, ``belief`` or ``both``.
        lower: Lower end per band, ``(band,)``.
        upper: Upper end per band, ``(band,)``.
        nominal: Value the estimators believe, or of the plant where they know nothing of it; NaN where there is none.
        values: Value used, ``(band, sample)``.
        log: Whether bands are filled evenly in the logarithm.
        is_believed: Whether the estimators believe anything of it; else ``nominal`` is the plant's, as stated.
    """

    name: str
    words: str
    unit: str
    of: str
    lower: NDArray[np.float64]
    upper: NDArray[np.float64]
    nominal: float
    values: NDArray[np.float64]
    log: bool = False
    is_believed: bool = True


def _decode(value: Any) -> Any:
    """Read an attribute that may have been stored as JSON text."""
    if isinstance(value, str):
        try:
            return json.loads(value)
        except json.JSONDecodeError:
            return value
    return value


def _factor(row: dict[str, Any], data: xr.Dataset) -> Factor:
    """Build a factor from its attributes and the values that were used."""
    unit = str(row.get("unit") or "")
    base = float(registry().Quantity(1.0, unit or "dimensionless").to_base_units().magnitude)
    si = data[f"factor_{row['name']}"].transpose("band", "sample").values.astype(float)
    nominal = row.get("nominal")
    return Factor(
        name=row["name"],
        words=words(str(row.get("parameter") or row["name"])),
        unit=print_unit(unit),
        of=str(row.get("of", "plant")),
        lower=np.asarray(row.get("lower", si.min(axis=1)), dtype=float) / base,
        upper=np.asarray(row.get("upper", si.max(axis=1)), dtype=float) / base,
        nominal=np.nan if nominal is None else float(nominal) / base,
        values=si / base,
        log=row.get("scale") == "log",
        is_believed=bool(row.get("believed", True)),
    )


@dataclass
class Design:
    """One design of a study: the runs of all its bands, drives, repeats and estimators.

    Attributes:
        name: Name of the design.
        data: The group of the store.
        estimators: Names, in the order of the study.
        targets: What was scored.
        drives: Names of the drives.
        bands: Labels of the levels or bands.
        factors: What varies.
        state_dimension: Expectation of NEES.
        output_dimension: Expectation of NIS.
    """

    name: str
    data: xr.Dataset
    estimators: list[str]
    targets: list[Quantity]
    drives: list[str]
    bands: list[str]
    factors: list[Factor]
    state_dimension: int
    output_dimension: int
    _kept: dict[str, NDArray[np.float64]] = field(default_factory=dict, repr=False)

    @cached_property
    def status(self) -> NDArray[np.int8]:
        """Fate of each run, ``(band, estimator, drive, sample, repeat)``."""
        return self._read("status", _RUN_DIMS)

    @cached_property
    def rmse(self) -> NDArray[np.float64]:
        """RMSE in report units, ``(target, band, estimator, drive, sample, repeat)``; NaN unless ok."""
        return self.per_target("rmse")

    @cached_property
    def out_of_control(self) -> NDArray[np.bool_]:
        """Whether the vehicle went out of control, alike for all estimators, ``(band, drive, sample, repeat)``."""
        if LOST_CONTROL not in self.data:  # a store of an earlier version
            return np.asarray((self.status == PLANT_DIVERGED).any(axis=1))
        return np.isfinite(self._read(LOST_CONTROL, tuple(d for d in _RUN_DIMS if d != "estimator")))

    @cached_property
    def lost(self) -> NDArray[np.bool_]:
        """Whether the code of the plant lost the run, which then counts as out of control, as ``out_of_control``."""
        return np.asarray((self.status == LOST).any(axis=1))

    @cached_property
    def errors(self) -> NDArray[np.float64]:
        """RMSE by which estimators are compared, shape as ``rmse``.

        All have it on the same runs, those of a vehicle under control: infinite where the estimator diverged, NaN of
        the other runs, of those that are pending, and of targets that an estimator does not give.
        """
        if not self.out_of_control.any():
            return self.errors_under_control
        return np.where(self.out_of_control[:, None], np.nan, self.errors_under_control)

    @cached_property
    def errors_under_control(self) -> NDArray[np.float64]:
        """The same with the RMSE of the other runs, up to where the vehicle went out of control."""
        values = self.in_report_units("rmse")
        finished = self.status == OK
        given = (np.isfinite(values) & finished).any(axis=(1, 3, 4, 5)) | ~finished.any(axis=(0, 2, 3, 4))
        values[:, self.status == ESTIMATOR_DIVERGED] = np.inf
        values[:, self.status == PENDING] = np.nan
        return np.where(given[:, None, :, None, None, None], values, np.nan)

    def giving(self, target: int) -> list[int]:
        """Return the estimators that give a target: all but those whose finished runs have no error in it."""
        finished = (self.status == OK).any(axis=(0, 2, 3, 4))
        has_error = (~np.isnan(self.errors_under_control[target])).any(axis=(0, 2, 3, 4))
        return [e for e in range(len(self.estimators)) if has_error[e] or not finished[e]]

    def per_target(self, name: str) -> NDArray[np.float64]:
        """Return a score of targets in report units, shape as ``rmse``; NaN unless the run is ok."""
        values = self.in_report_units(name)
        values[:, self.status != OK] = np.nan
        return values

    def in_report_units(self, name: str) -> NDArray[np.float64]:
        """Return a score of targets in report units, shape as ``rmse``, of every run."""
        values = self._read(name, ("target", *_RUN_DIMS)).astype(float, copy=False)
        values *= np.array([t.scale for t in self.targets]).reshape(-1, 1, 1, 1, 1, 1)
        return values

    def per_run(self, name: str) -> NDArray[np.float64]:
        """Return a score without target, shape as ``status``; NaN unless the run is ok or if not stored."""
        if name not in self._kept:
            while len(self._kept) >= _KEPT and self.data.nbytes > _HELD:
                self._kept.pop(next(iter(self._kept)))
            self._kept[name] = self._per_run(name)
        return self._kept[name]

    @property
    def time_of_divergence(self) -> NDArray[np.float64]:
        """When each run that was not ok was lost, in s, shape as ``status``; NaN of the others."""
        return self._read("time_of_divergence", _RUN_DIMS)

    def _per_run(self, name: str) -> NDArray[np.float64]:
        if name not in self.data:
            return np.full(self.status.shape, np.nan)
        values = self._read(name, _RUN_DIMS).astype(float, copy=False)
        values[self.status != OK] = np.nan
        return values

    def _read(self, name: str, dims: tuple[str, ...]) -> NDArray[Any]:
        """Return a copy of an array of the store with its dimensions in this order.

        It is read part by part: Zarr takes a hundred times the bytes of small chunks while it reads them all at once.
        """
        data = self.data[name]
        values = np.empty([data.sizes[d] for d in dims], dtype=data.dtype)
        own = data.encoding.get("preferred_chunks", {}).get("sample", 1)
        step = max(1, _CHUNKS_AT_ONCE // data.sizes["drive"]) * own if data.nbytes > _SMALL else data.sizes["sample"]
        for band in range(data.sizes["band"]):
            for first in range(0, data.sizes["sample"], step):
                part = {"band": slice(band, band + 1), "sample": slice(first, first + step)}
                place = tuple(part.get(d, slice(None)) for d in dims)
                values[place] = data.isel(part).transpose(*dims).values
        return values

    @cached_property
    def strata(self) -> NDArray[np.int64]:
        """Number of the drive of each run, ``(drive, sample, repeat)``."""
        shape = self.status.shape[2:]
        return np.broadcast_to(np.arange(shape[0]).reshape(-1, 1, 1), shape)

    @property
    def planned(self) -> int:
        """Runs per band and estimator."""
        return int(np.prod(self.status.shape[2:]))

    @cached_property
    def matched(self) -> int | None:
        """Band in which every factor has the value the estimators believe; None if there is none."""
        if self.sampling != "sobol":
            return None  # one box around that value, or several
        inside = np.ones(len(self.bands), dtype=bool)
        distance, width = np.zeros((2, len(self.bands)))
        for factor in self.factors:
            if not np.isfinite(factor.nominal):
                return None
            slack = 1e-9 * max(abs(factor.nominal), 1e-12)
            inside &= (factor.lower - slack <= factor.nominal) & (factor.nominal <= factor.upper + slack)
            distance += np.abs((factor.lower + factor.upper) / 2 - factor.nominal)
            width += factor.upper - factor.lower
        if not self.factors or not inside.any():
            return None
        return min(np.flatnonzero(inside).tolist(), key=lambda band: (distance[band], width[band]))

    @property
    def matched_is(self) -> str:
        """What the matched band is: as believed or around that; as stated, where the belief varies or knows nothing."""
        if not all(f.of == "plant" for f in self.factors):
            return "as stated"
        wide = any(f.lower[self.matched] < f.upper[self.matched] for f in self.factors)
        return f"around what is {self.nominal_is}" if wide else f"as {self.nominal_is}"

    @property
    def nominal_is(self) -> str:
        """Whose the nominal values are: believed, or stated where the belief varies or has no such parameter."""
        believed = all(f.of == "plant" and f.is_believed for f in self.factors)
        return "believed" if believed else "stated"

    @property
    def sampling(self) -> str:
        """How the bands were filled, see ``harness.study.design``."""
        return str(self.data.attrs.get("sampling", "sobol"))

    @property
    def whole(self) -> str:
        """What the one band of a design over all factors is called; empty where bands have names of their own."""
        return {"saltelli": "whole box", "population": "population"}.get(self.sampling, "")

    @property
    def sampled(self) -> bool:
        """Whether a factor takes more than one value within a band, whatever the other factors do."""
        return self.sampling in ("sobol", "population") and any(
            bool(np.any(np.ptp(f.values, axis=1) > 0)) for f in self.factors
        )

    def count(self, fate: int, band: int | None = None, estimator: int | None = None) -> int:
        """Count the runs of a fate, in all or in one band and estimator."""
        chosen = self.status
        chosen = chosen if band is None else chosen[band : band + 1]
        chosen = chosen if estimator is None else chosen[:, estimator : estimator + 1]
        return int(np.sum(chosen == fate))

    def diverged(self, estimator: int, band: int | None = None) -> int:
        """Count the runs of a vehicle under control in which an estimator diverged, in all bands or in one."""
        chosen = slice(None) if band is None else slice(band, band + 1)
        in_control = ~self.out_of_control[chosen]
        return int(np.sum((self.status[chosen, estimator] == ESTIMATOR_DIVERGED) & in_control))

    def compared(self, band: int | None = None) -> int:
        """Count the runs of a vehicle under control that are not pending, which every estimator has."""
        chosen = slice(None) if band is None else slice(band, band + 1)
        return int(np.sum((self.status[chosen] != PENDING).all(axis=1) & ~self.out_of_control[chosen]))


def run_in_words(history: xr.Dataset, drive: bool = True) -> str:
    """Name a run that is drawn over time: its own name, its level and, if asked for, its drive."""
    attributes = [history.attrs.get("name"), words(str(history.attrs.get("band_label") or ""))]
    named = ", ".join(str(a) for a in [*attributes, drive and history.attrs.get("drive")] if a)
    return capital(named)


@dataclass
class StudyResults:
    """A finished result folder.

    Attributes:
        directory: The folder.
        attributes: Root attributes of the store.
        designs: The designs, in the order of the study.
        histories: The runs kept over time, as many as the study asked for.
        run: What ``run.json`` says about the run, possibly nothing.
        bounds: Smallest RMSE that anyone could reach, SI, by design, target and band; empty where it was not asked for.
        smoothed: What a smoother that knows the vehicle reaches, as ``bounds``.
        rare_event: What ``rare_event.json`` says, nothing where it was not asked for.
        trust: How often trust monitors are right, nothing where that was not asked for.
    """

    directory: Path
    attributes: dict[str, Any]
    designs: list[Design]
    histories: list[xr.Dataset]
    run: dict[str, Any] = field(default_factory=dict)
    bounds: bound_file.Bounds = field(default_factory=dict)
    smoothed: bound_file.Bounds = field(default_factory=dict)
    rare_event: dict[str, Any] = field(default_factory=dict)
    trust: trust_file.StudyTrust | None = None

    @property
    def is_verifiable(self) -> bool:
        """Whether the store has checksums, so that ``read`` could tell that none of its files is missing or damaged."""
        return is_verifiable(self.attributes)

    @property
    def seed(self) -> int:
        """Seed of the study, used for the bootstrap as well."""
        return int(self.attributes.get("seed", 0))

    def pairs(self) -> Iterator[tuple[Design, int, Quantity]]:
        """Go through every design and target."""
        for design in self.designs:
            for k, target in enumerate(design.targets):
                yield design, k, target


def _design(path: Path, name: str) -> Design:
    data = stores.dataset(path, name)
    if data.nbytes <= _HELD:
        data = data.load()
    units = data.get("target_unit")
    names = [str(t) for t in data["target"].values]
    labels = data["band_label"] if "band_label" in data else data["band"]
    return Design(
        name=name,
        data=data,
        estimators=[str(e) for e in data["estimator"].values],
        targets=[quantity(t, "" if units is None else str(units.values[k])) for k, t in enumerate(names)],
        drives=[str(d) for d in data["drive"].values],
        bands=[words(str(b)) for b in labels.values],
        factors=[_factor(row, data) for row in _decode(data.attrs.get("factors", "[]"))],
        state_dimension=int(data.attrs.get("state_dimension", 0)),
        output_dimension=int(data.attrs.get("output_dimension", 0)),
    )


def read(directory: Path) -> StudyResults:
    """Read ``scores.zarr`` and ``run.json`` of a result folder.

    Raises:
        UserError: If there is no store, it is not one that a study wrote, or files of it are missing or damaged.
        WorkError: If it is behind a URL that does not answer.
    """
    with reached(directory):
        return _read(directory)


def _read(directory: Path) -> StudyResults:
    path = directory / "scores.zarr"
    if not sealed_root.is_there(path) or path.is_file():
        raise MissingFileError(
            f"{directory}: no finished study here (scores.zarr is missing); "
            f"make one with 'harness run <name> --out {directory}'"
        )
    with sealed_root.told_as_no_store(path):
        lost = sealed_root.faults(path)
        if lost:
            raise UserError(
                f"{path}: {described(lost)}; 'harness run' with the study '{sealed_root.study_name(path)}' and "
                f"'--out {directory}' computes what is lost again, and nothing else"
            )
        root = stores.group(path)
        attributes = {key: _decode(value) for key, value in dict(root.attrs).items()}
        names = attributes.get("designs", [])
        if not names:
            raise KeyError("designs")
        has_runs = HISTORY in set(root.group_keys())
        designs = [_design(path, str(name)) for name in names]
        kept = sorted(stores.group(path, HISTORY).group_keys(), key=int) if has_runs else []
        histories = [stores.dataset(path, f"{HISTORY}/{index}").load() for index in kept]
    attributes["study"] = root.attrs.get("study", "")
    hashed = str(attributes.get("study_hash", ""))
    at_best = bound_file.read(directory, hashed), bound_file.read(directory, hashed, "smoothed")
    later = rare_file.read(directory, hashed), trust_file.read(directory, hashed)
    return StudyResults(directory, attributes, designs, histories, run_file.read(directory), *at_best, *later)
