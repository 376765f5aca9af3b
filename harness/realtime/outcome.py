"""What the times say: quantiles, load of the cycle, and ratios with intervals; kept in ``times.zarr``."""

from __future__ import annotations

import json
import os
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr

from harness.common import places, stores
from harness.common.arrays import Floats
from harness.common.errors import UserError
from harness.config import StudySpec
from harness.study import checksums

STORE = "times.zarr"

PACES = ("back to back", "every cycle")
"""How the steps that are timed follow each other."""

QUANTILES = (0.5, 0.999, 1.0)
"""Median, what one step in a thousand exceeds, and the longest."""

PUBLISHED = {"ekf": 1.65, "ukf": 5.61, "narx": 0.67}
"""Mean load in percent of a cycle of 10 ms on an ETAS ES910, by kind of estimator (Ziaukas 2023, Bild 6.9)."""

_RESAMPLES = 2000
_BLOCK = 1.0  # s: neighbouring steps share the state of the machine, so blocks of them are resampled


def judge(times: xr.Dataset, study: StudySpec, drive: str) -> xr.Dataset:
    """Return the times with their statistics and where they come from.

    Args:
        times: From ``harness.realtime.measure.measure``.
        study: The study.
        drive: Name of the drive.

    Returns:
        The times, with ``quantile`` over ``(pace, estimator, share)`` and ``mean`` over ``(pace, estimator)`` in s,
        and ``ratio`` over ``(pace, estimator, end)``: median over that of the reference estimator, with its 95 %
        interval (bootstrap over blocks of a second, the same for all estimators).
    """
    from harness.study.provenance import code_state, commit, processor  # imports what runs estimators

    values, names = times["step_time"].values, [str(name) for name in times["estimator"].values]
    kinds = {e.name: e.kind for e in study.estimators if e.name in names}
    reference = next((name for name, kind in kinds.items() if kind == "ekf"), names[0])
    left_out = [e.name for e in study.estimators if e.name not in names]
    cycle = study.belief.step
    ratio = _ratios(values, names.index(reference), max(1, round(_BLOCK / cycle)), study.seed)
    judged = times.assign(
        quantile=(("pace", "estimator", "share"), np.moveaxis(np.quantile(values, QUANTILES, axis=2), 0, -1)),
        mean=(("pace", "estimator"), values.mean(axis=2)),
        ratio=(("pace", "estimator", "end"), ratio),
    ).assign_coords(share=list(QUANTILES), end=np.array(["median", "lower", "upper"], dtype=object))
    for name in ("quantile", "mean"):
        judged[name].attrs["units"] = "s"
    return judged.assign_attrs(
        study_name=study.name,
        study_hash=study.hash,
        study=study.text,
        drive=drive,
        cycle=cycle,
        reference=reference,
        kinds=json.dumps(kinds),
        **({"left_out": json.dumps(left_out)} if left_out else {}),
        load_average=os.getloadavg()[0] if hasattr(os, "getloadavg") else float("nan"),
        cores=os.cpu_count() or 1,
        machine=processor(),
        commit=commit(),
        **code_state(study),
    )


def _ratios(values: Floats, reference: int, block: int, seed: int) -> Floats:
    """Return median ratios and their 95 % intervals ``(pace, estimator, 3)`` of times ``(pace, estimator, step)``."""
    paces, estimators, steps = values.shape
    count = -(-steps // block)
    rng = np.random.default_rng(seed)
    drawn = np.empty((_RESAMPLES, paces, estimators))
    for i in range(_RESAMPLES):
        starts = rng.integers(0, max(steps - block, 0) + 1, size=count)
        rows = (starts[:, None] + np.arange(min(block, steps))).ravel()
        drawn[i] = np.median(values[..., rows], axis=2)
    drawn /= drawn[..., reference, None]
    median = np.median(values, axis=2)
    low, high = np.quantile(drawn, (0.025, 0.975), axis=0)
    return np.stack([median / median[:, reference, None], low, high], axis=-1)


def published_ratio(kind: str, reference: str) -> float | None:
    """Return the ratio of mean loads in the dissertation between two kinds; ``None`` where it has none."""
    if kind not in PUBLISHED or reference not in PUBLISHED:
        return None
    return PUBLISHED[kind] / PUBLISHED[reference]


def write(outcome: xr.Dataset, folder: Path) -> Path:
    """Write the times into a folder as ``times.zarr``, in place of older ones, and return its path.

    Raises:
        UserError: If the folder cannot be written.
    """
    path = folder / STORE
    try:
        folder.mkdir(parents=True, exist_ok=True)
        with places.whole(path, ["zarr.json"]) as filled:
            stores.write(outcome, filled)
            stores.group(filled, mode="r+").attrs[checksums.GROUP] = checksums.of_files(filled)
    except OSError as error:
        raise UserError(f"{folder}: cannot be written: {error.strerror or error}") from None
    return path


def read(folder: Path) -> xr.Dataset:
    """Return the times that ``write`` left in a folder.

    Raises:
        UserError: If files of it are missing or damaged.
    """
    path = folder / STORE
    attributes: dict[str, Any] = dict(stores.group(path).attrs)
    lost = checksums.changed_files(path, attributes.get(checksums.GROUP, {}))
    if lost:
        raise UserError(
            f"{path}: {checksums.described(lost)}; measure again: 'harness realtime' with the study "
            f"'{attributes.get('study_name')}' and '--out {folder}'"
        )
    times = stores.dataset(path).load()
    times.attrs.pop(checksums.GROUP, None)
    return times
