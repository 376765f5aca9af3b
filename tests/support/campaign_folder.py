"""The studies of a campaign as they lie below a folder, written without running any."""

import json
from pathlib import Path

import numpy as np
import xarray as xr
import zarr

from harness.realtime.outcome import PACES
from harness.realtime.outcome import write as write_times
from support.joint_study import scores, study_of
from support.synthetic import design, write

LABELS = {
    "ideal": ["nominal"],
    "process-noise": ["×10", "×1", "×0.001"],
    "mass": ["8 t", "24 t", "32 t"],
    "cog": ["-2 m", "0 m", "+2 m"],
    "friction": ["0.5", "0.6", "0.9", "1.1"],
    "tyre": ["±0 %", "±10 %", "±20 %", "±30 %"],
}
EVERYONE = ("EKF", "UKF", "NARX")
ANGLE = "articulation_angle"


def _write_times(folder: Path) -> None:
    """A step of the UKF takes 3 times as long as one of the EKF, one of the network half as long."""
    median = np.array([1.0, 3.0, 0.5])[None, :, None]
    ratio = np.broadcast_to(median * np.array([1.0, 0.9, 1.1]), (2, 3, 3))
    times = xr.Dataset(
        {
            "step_time": (("pace", "estimator", "time"), np.ones((2, 3, 100))),
            "ratio": (("pace", "estimator", "end"), ratio),
        },
        coords={
            "pace": np.array(PACES, dtype=object),
            "estimator": np.array(EVERYONE, dtype=object),
            "time": 0.01 * np.arange(100),
        },
        attrs={"cycle": 0.01},
    )
    write_times(times, folder)


def write_studies(folder: Path, growth=None, lost=None, further=None) -> None:
    """Write the six studies and the joint one, each level with the error and the losses one asks for.

    Further estimators, by name, have the error of the others times a factor.
    """
    folder.mkdir(parents=True, exist_ok=True)
    names = [*EVERYONE[:2], *(further or {}), *EVERYONE[2:]]
    for study, labels in LABELS.items():
        data = design(estimators=names, levels=[24.0] * len(labels), repeats=4, seed=3)
        data["rmse"] = xr.zeros_like(data["rmse"]) + data["rmse"][{"band": 0, "estimator": 0}]
        for name, factor in (further or {}).items():
            data["rmse"][{"estimator": names.index(name)}] *= factor
        data = data.assign_coords(band_label=("band", np.array(labels, dtype=object)))
        for (of, label, target), factor in (growth or {}).items():
            if of == study:
                place = {"band": labels.index(label), "target": list(data["target"].values).index(target)}
                data["rmse"][place] = data["rmse"][place] * factor
        if lost is not None and lost[0] == study:
            data["status"][{"band": labels.index(lost[1]), "repeat": slice(0, lost[2])}] = 1
        write(folder / study, {"level": data}, name=study)
    write(folder / "joint", scores(study_of(folder)), name="joint")
    zarr.open_group(folder / "joint" / "scores.zarr").attrs["limits"] = json.dumps({ANGLE: np.deg2rad(2.0)})
    _write_times(folder / "realtime")
