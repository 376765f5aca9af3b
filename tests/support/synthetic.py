"""Build a finished result folder without running a study, to test the report and to look at it."""

from __future__ import annotations

import json
from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
import xarray as xr
import zarr

LEVELS = (8.0, 12.0, 16.0, 20.0, 24.0, 28.0, 32.0)
DRIVES = ("winding-road", "roundabout", "tight-turn", "lane-changes", "steady-circle", "random-sequence")
TARGETS = {"lateral_force_axle_21": ("N", 900.0), "articulation_angle": ("rad", 0.012)}
NOMINAL = 24.0
STUDY = """name = "mass"
seed = 7

[belief.values]
trailer_mass = "24 t"   # "quoted", #hash, $dollar$, *star*, \\back <tag> & [bracket] `tick` @at
"""
RUN_DIMS = ("band", "sample", "drive", "repeat", "estimator")


def _text(words: Sequence[str]) -> np.ndarray:
    """Text of any length, as the runner stores it."""
    return np.array([str(word) for word in words], dtype=object)


def design(
    *,
    estimators: Sequence[str] = ("EKF", "UKF"),
    levels: Sequence[float] = LEVELS,
    targets: dict[str, tuple[str, float]] | None = None,
    drives: Sequence[str] = DRIVES,
    band: float = 0.0,
    samples: int = 1,
    repeats: int = 20,
    without_covariance: Sequence[str] = (),
    status: Callable[[np.ndarray], None] | None = None,
    seed: int = 1,
) -> xr.Dataset:
    """One design group in which the error grows with the distance of the mass from 24 t.

    Args:
        estimators: Names; the k-th is 3 % worse than the one before it.
        levels: Trailer masses in t.
        targets: SI unit and typical RMSE of each target.
        drives: Names, up to six.
        band: Half width of the band around each level, as a share.
        samples: Points in a band.
        repeats: Repeats per point.
        without_covariance: Estimators whose NEES and NIS are NaN.
        status: Changes the status array (dims band, sample, drive, repeat, estimator) in place.
        seed: Seed of the numbers.
    """
    rng = np.random.default_rng(seed)
    targets = TARGETS if targets is None else targets
    spread = np.linspace(-band, band, samples) if samples > 1 else np.zeros(1)
    mass = 1000.0 * np.array(levels)[:, None] * (1.0 + spread[None, :])
    fates = np.zeros((len(levels), samples, len(drives), repeats, len(estimators)), dtype=np.int8)
    if status is not None:
        status(fates)
    scale = np.array([typical for _, typical in targets.values()])
    blind = np.isin(np.array(estimators), list(without_covariance))
    scores = _scores(rng, np.abs(mass / 1000.0 / NOMINAL - 1.0), fates, scale, blind)
    data = xr.Dataset(
        {name: ((*RUN_DIMS, "target")[: values.ndim], values) for name, values in scores.items()},
        coords={
            "drive": _text(drives),
            "estimator": _text(estimators),
            "target": _text(list(targets)),
            "band_label": (
                "band",
                _text([f"{m:g} t" + (f" ± {band:.0%}".replace("%", " %") if band else "") for m in levels]),
            ),
            "target_unit": ("target", _text([unit for unit, _ in targets.values()])),
            "duration": ("drive", np.full(len(drives), 90.0)),
        },
    )
    data["factor_trailer_mass"] = (("band", "sample"), mass)
    ends = {"lower": mass.min(axis=1).tolist(), "upper": mass.max(axis=1).tolist()}
    factor = {"name": "trailer_mass", "of": "plant", "unit": "t", "nominal": 1000 * NOMINAL, **ends}
    data.attrs = {
        "factors": json.dumps([factor]),
        "state_dimension": 11,
        "output_dimension": 1,
        "samples": samples,
        "repeats": repeats,
    }
    return data


def _scores(
    rng: np.random.Generator, mismatch: np.ndarray, fates: np.ndarray, scale: np.ndarray, blind: np.ndarray
) -> dict[str, np.ndarray]:
    """Every score by name, of the dims of a run, then of the target.

    Args:
        rng: Where the numbers come from.
        mismatch: Distance of the mass from what is believed, as a share of that, ``(band, sample)``.
        fates: The status of every run.
        scale: Typical RMSE of each target.
        blind: Estimators whose NEES and NIS are NaN.
    """
    shape, mismatch = fates.shape, mismatch[:, :, None, None, None]
    drive = np.array([0.5, 0.8, 1.0, 1.4, 2.0, 3.0])[: shape[2]][None, None, :, None, None]
    worse = 1.0 + 0.03 * np.arange(shape[4])
    common = np.exp(0.10 * rng.normal(size=(*shape[:-1], 1)))
    size = drive * (1.0 + 6.0 * mismatch) * common * worse * np.exp(0.02 * rng.normal(size=shape))
    rmse = size[..., None] * scale
    nees = 11 * (1.0 + 20 * mismatch**2) * (1 + 0.05 * rng.normal(size=shape))
    nis = (1.0 + 2 * mismatch**2) * (1 + 0.01 * rng.normal(size=shape))
    inside = np.broadcast_to(0.95 / (1.0 + mismatch), shape)
    return {
        "nees": np.where(blind, np.nan, nees),
        "nis": np.where(blind, np.nan, nis),
        "nees_inside": np.where(blind, np.nan, inside),
        "nis_inside": np.where(blind, np.nan, inside),
        "repairs": np.zeros(shape, dtype=np.int32),
        "log_likelihood": rng.normal(1e4, 10, shape),
        "updates": np.full(shape, 9000.0),
        "time_of_divergence": np.where((fates == 1) | (fates == 2), 12.5, np.nan),
        "status": fates,
        "rmse": rmse,
        "bias": 0.1 * rmse,
        "max_error": 3.0 * rmse,
    }


def history(
    estimators: Sequence[str] = ("EKF", "UKF"), without_covariance: Sequence[str] = (), name: str = "", extra: str = ""
) -> xr.Dataset:
    """A run over time: slow sines, each estimator with a bias of its own and a constant 2-sigma band.

    Args:
        estimators: Names.
        without_covariance: Estimators without a band.
        name: What the study calls the run.
        extra: A further signal, of which there is no truth.
    """
    time = np.arange(0.0, 90.0, 0.01)
    names = {"lateral_force_axle_21": 9000.0, "articulation_angle": 0.15, "steering_wheel_angle": 1.2}
    names |= {extra: 3.0} if extra else {}
    shape = np.sin(2 * np.pi * 0.05 * time) + 0.4 * np.sin(2 * np.pi * 0.17 * time)
    truth = np.stack([amplitude * shape for amplitude in names.values()], axis=1)
    bias = 1.0 + 0.12 * (1 + np.arange(len(estimators)))[None, :, None]
    estimate = truth[:, None, :] * bias
    if extra:
        truth[:, -1] = np.nan
    std = np.broadcast_to(0.05 * np.array(list(names.values())), estimate.shape).copy()
    std[:, [e in without_covariance for e in estimators], :] = np.nan
    return xr.Dataset(
        {
            "truth": (("time", "target"), truth),
            "estimate": (("time", "estimator", "target"), estimate),
            "std": (("time", "estimator", "target"), std),
            "input_speed": ("time", 15.0 + 3.0 * np.sin(0.1 * time)),
        },
        coords={"time": time, "estimator": _text(estimators), "target": _text(list(names))},
        attrs={"name": name, "design": "level", "band_label": "8 t", "drive": "winding-road", "repeat": 0},
    )


def write(
    directory: Path,
    designs: dict[str, xr.Dataset] | None = None,
    *,
    runs: Sequence[xr.Dataset] = (),
    name: str = "mass",
    title: str = "How wrong do the estimators get when the trailer is heavier or lighter than they believe?",
) -> Path:
    """Write a result folder and return it.

    Args:
        directory: Folder, made if absent.
        designs: Groups by name; by default levels and bands of the mass study.
        runs: The runs over time; none by default.
        name: Name of the study.
        title: Question of the study.
    """
    if designs is None:
        designs = {"level": design(), "band": design(band=0.05, samples=16, repeats=1, seed=2)}
    path = directory / "scores.zarr"
    directory.mkdir(parents=True, exist_ok=True)
    root = zarr.open_group(path, mode="w")
    root.attrs.update(
        {
            "study": STUDY,
            "study_hash": "0123456789abcdef",
            "study_name": name,
            "title": title,
            "seed": 7,
            "step": 0.01,
            "versions": json.dumps({"python": "3.11.9", "numpy": "2.0.0"}),
            "commit": "abcdef0",
            "machine": "2 cores",
            "designs": json.dumps(list(designs)),
            "description": json.dumps(
                {
                    "plant": {
                        "model": "semitrailer+magic_formula",
                        "parameters": "ziaukas_2023",
                        "unknown_inputs": [],
                        "process_noise": {"lateral_force_axle_21": 1000.0},
                        "measurement_noise": {"yaw_rate_trailer": 0.0025},
                    },
                    "belief": {
                        "model": "semitrailer+magic_formula",
                        "parameters": "ziaukas_2023",
                        "unknown_inputs": ["steering_wheel_angle"],
                        "measurement_noise": {"yaw_rate_trailer": 0.0025},
                    },
                    "differing": {"trailer_mass": {"plant": 8000.0, "belief": 24000.0, "unit": "kg"}},
                }
            ),
        }
    )
    groups = {**designs, **{f"history/{index}": run for index, run in enumerate(runs)}}
    for name, data in groups.items():
        data.to_zarr(path, group=name, mode="a", consolidated=False, zarr_format=3)
    facts = {
        "started": "2026-01-02T03:04:05",
        "duration_s": 41.5,
        "jobs": 2,
        "runs": 3024,
        "runs_per_s": 72.9,
    }
    (directory / "run.json").write_text(json.dumps(facts), encoding="utf-8")
    return directory
