"""Studies of designs over all factors at once: their text, and designs as a run leaves them."""

from __future__ import annotations

import tempfile
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import xarray as xr

from harness.config import load_study
from harness.study.design import points
from harness.study.layout import create
from support.probe_study import STUDY

HEAD = STUDY.split("[[design]]")[0].replace("seed = 0", "seed = 5")


JOINT = """
[[design]]
name = "joint"
sampling = "saltelli"
samples = 4
factor = [
  { parameter = "trailer_mass", range = ["8 t", "32 t"] },
  { parameter = "friction", bands = ["20 %"] },
  { parameter = "process_noise_scale", range = [0.01, 1], scale = "log" },
]
"""


NESTED = """
[[design]]
name = "nested"
sampling = "tolerance"
samples = 8
boxes = 4
factor = [
  { parameter = "trailer_mass", range = ["8 t", "32 t"] },
  { parameter = "measurement_noise_scale", range = [0.01, 100], scale = "log" },
]
"""


LIMITS = '[limits]\narticulation_angle = "2 deg"\n'


OVER = '[report]\nsensitivity_over_time = { design = "joint", drive = "weave", window = "5 s" }\n'


WINDOWS = 4


def study_of(tmp_path, samples=128):
    path = tmp_path / "joint.toml"
    estimators = '[[estimator]]\nname = "UKF"\nkind = "ukf"\n'
    path.write_text(HEAD + estimators + JOINT.replace("samples = 4", f"samples = {samples}") + NESTED + LIMITS + OVER)
    return load_study(path)


def _pending(study, evaluator):
    with tempfile.TemporaryDirectory() as folder:
        create(study, evaluator, Path(folder) / "empty", {})
        groups = [(Path(folder) / "empty", d.name) for d in study.designs]
        return [xr.open_zarr(path, group=name, consolidated=False).load().drop_encoding() for path, name in groups]


def scores(study):
    """Designs as a run leaves them: mass makes 80 % of the variance, friction 20 %; heavy trailers lose the UKF.

    In the nested boxes the error grows with the mass from 1 deg to 3 deg at the heavy edge.
    """
    drive = SimpleNamespace(profile=SimpleNamespace(time=np.arange(0.0, 20.01, 0.01)))
    windows = SimpleNamespace(count=lambda design, drive: WINDOWS if (design, drive) == (0, 0) else None)
    compiled = SimpleNamespace(belief=SimpleNamespace(nx=11, ny=1), drives=[drive, drive])
    evaluator = SimpleNamespace(compiled=compiled, windows=windows)
    joint, nested = _pending(study, evaluator)
    shape = (1, 1, 1, 1, 1)
    mass, friction, _ = (
        (v - v.mean()) / (12**-0.5 * (v.max() - v.min())) for v in points(study, study.designs[0]).values[0].T
    )
    error = 10.0 + 2.0 * mass + friction
    joint["rmse"][:] = error.reshape(1, -1, *shape[2:], 1) * np.deg2rad(0.1) * np.ones((1, 1, 2, 1, 2, 2))
    joint["status"][:] = 0
    joint["status"][0, mass > 1.5, :, :, 1] = 1
    early = 10.0 + 2.0 * mass
    late = 10.0 + 2.0 * friction
    for k in range(WINDOWS):
        joint["rmse_over_time"][..., k] = (early if k < 2 else late).reshape(1, -1, 1, 1, 1)
    share = (points(study, study.designs[1]).values[:, :, 0] - 24e3) / 8e3
    nested["status"][:] = 0
    nested["rmse"][:] = np.deg2rad(1.0 + 2.0 * np.maximum(share, 0.0))[:, :, None, None, None, None]
    for data in (joint, nested):
        for name in ("nees", "nis", "nees_inside", "nis_inside", "log_likelihood", "repairs", "updates"):
            data[name][:] = 1.0
    return {"joint": joint, "nested": nested}


POPULATION = """
[[design]]
name = "fleet"
sampling = "population"
samples = 64
correlation = [["trailer_mass", "friction", 0.5]]
groups = { noise = ["process_noise_scale", "measurement_noise_scale"] }
factor = [
  { parameter = "trailer_mass", distribution = { kind = "normal", std = "1 t" } },
  { parameter = "friction", distribution = { kind = "normal", mean = 0.8, std = 0.02 } },
  { parameter = "process_noise_scale", range = [0.1, 10], scale = "log" },
  { parameter = "measurement_noise_scale", range = [0.1, 10], scale = "log" },
]
"""


def population_of(tmp_path, limits=LIMITS):
    path = tmp_path / "fleet.toml"
    path.write_text(limits.replace("[limits]\n", "limits = { ").replace('"\n', '" }\n') + HEAD + POPULATION)
    return load_study(path)


def population_scores(study):
    """A population as a run leaves it: the error in degrees is 1.5 + 0.2 (mass + friction) in normal scores.

    The largest error is twice the RMSE.
    """
    drive = SimpleNamespace(profile=SimpleNamespace(time=np.arange(0.0, 20.01, 0.01)))
    windows = SimpleNamespace(count=lambda design, drive: None)
    compiled = SimpleNamespace(belief=SimpleNamespace(nx=11, ny=1), drives=[drive, drive])
    (fleet,) = _pending(study, SimpleNamespace(compiled=compiled, windows=windows))
    scores = points(study, study.designs[0]).scores
    error = np.deg2rad(1.5 + 0.2 * (scores[:, 0] + scores[:, 1]))
    fleet["rmse"][:] = error.reshape(1, -1, 1, 1, 1, 1)
    fleet["max_error"][:] = 2.0 * error.reshape(1, -1, 1, 1, 1, 1)
    fleet["status"][:] = 0
    for name in ("nees", "nis", "nees_inside", "nis_inside", "log_likelihood", "repairs", "updates"):
        fleet[name][:] = 1.0
    return {"fleet": fleet}
