"""Trial of a channel map by a short fit of the nominal model: how well can its free run follow the recording?"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import xarray as xr

from harness.common.arrays import Floats
from harness.config.model_choice import complete
from harness.config.parameter_set import load_set
from harness.identification.data import steered, step_of
from harness.identification.fit_recordings import Task, fit_recordings
from harness.identification.free_run import blocks
from harness.identification.measured_file import finely, fitted_parameters

_LONGEST = 300.0
"""s; the middle of a longer recording is fitted."""

_SETTINGS = {"iterations": 15, "annealings": 0, "profiles": False}
_GEARED = ("steering_ratio",)
"""Fitted beside the stiffnesses where the model has it: a wrong map is seen in it first."""


class NominalFit:
    """Error of the model of a parameter set on a recording, fitted to it.

    Args:
        parameters: Parameter set or path of a parameter file, which names vehicle, tyre and effects.

    Raises:
        UserError: If there is no such file, or anything in it is wrong.
        ModelError: If there is no such set.
    """

    def __init__(self, parameters: str) -> None:
        self.parameters = parameters
        self._vehicle = load_set(parameters, Path(), "--parameters").vehicle

    def __call__(self, recording: xr.Dataset) -> Floats:
        """Fit stiffnesses and steering ratio, and return the squared error of the free run in each block ``(blocks,)``.

        It is the mean over the outputs, each over its variance in the recording; infinite where the free run leaves
        the range in which the equations hold.

        Args:
            recording: As ``load_recording`` returns it.

        Raises:
            UserError: If the model cannot run over the recording, or nothing that it measures is recorded.
        """
        step, samples = step_of(recording), recording.sizes["time"]
        spare = max(samples - int(_LONGEST / step), 0) // 2
        part = recording.isel(time=slice(spare, samples - spare))
        part = part.assign_coords(time=part["time"] - part["time"][0]).assign_attrs(name="the recording")
        table, _ = complete({"vehicle": self._vehicle, "parameters": self.parameters}, [part])
        spec = finely(table, step, f"--parameters {self.parameters}")
        names = spec.model().parameter_names
        free = (*fitted_parameters(spec, [], "free"), *(n for n in _GEARED if n in names))
        fitted = fit_recordings(Task(spec, [steered(part, spec.values)], free, settings=_SETTINGS))
        (judged,) = fitted.judged
        drive = judged.drive
        with np.errstate(invalid="ignore", divide="ignore"):
            error = (drive.measurements - judged.after.simulated) ** 2 / np.nanvar(drive.measurements, axis=0)
        if not judged.after.stays:
            return np.full(blocks(drive), np.inf)
        each = [p[np.isfinite(p)] for p in np.array_split(error, blocks(drive))]
        return np.array([p.mean() if p.size else np.nan for p in each])
