"""Planned drives, simulated with every version of the vehicle that is still possible before anyone drives them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import xarray as xr

from harness.common.arrays import Floats
from harness.common.errors import ModelError, UserError
from harness.config import DriveSpec, ModelSpec
from harness.experiment.limits import Limits, PlannedMotion, motion_of, passed_by_driver, passed_by_vehicle
from harness.identification.data import DriveData
from harness.identification.filtered_model import FilteredModel
from harness.models.assembly.assemble import StateSpaceModel
from harness.models.contracts import Profile
from harness.models.signals import signal_attributes
from harness.simulation.drives import profile_of


@dataclass(frozen=True)
class Rehearsed:
    """A drive that keeps to the limits with every version of the vehicle.

    Attributes:
        drive: As a study states it.
        profile: What is driven.
        data: The recording that each version would leave without noise; those that were asked for.
        motion: Of the first version.
    """

    drive: DriveSpec
    profile: Profile
    data: tuple[DriveData, ...]
    motion: PlannedMotion

    @property
    def seconds(self) -> float:
        """Duration in s."""
        return float(self.profile.time[-1])


class Rehearsal:
    """Simulation of planned drives.

    Args:
        model: The filter, compiled.
        plant: The vehicle, whose wheelbase and steering ratio decide the drives.
        versions: Parameters of every version of the vehicle that is still possible ``(np,)``, the likeliest first.
        recorded: How many of them, from the first on, leave recordings.
        limits: Of every drive.
    """

    def __init__(
        self, model: FilteredModel, plant: ModelSpec, versions: Sequence[Floats], recorded: int, limits: Limits
    ) -> None:
        self.model, self.plant, self.limits = model, plant, limits
        self.versions, self.recorded = tuple(versions), recorded

    def of(self, drive: DriveSpec) -> Rehearsed | str:
        """Return a drive rehearsed, or which limit it passes."""
        try:
            profile = profile_of(self.plant, drive)
        except (ModelError, UserError) as error:
            return str(error)
        if passed := passed_by_driver(profile, self.limits):
            return passed
        planned = self.model.drive(without_outputs(profile, self.model.model), drive.name, "joined")
        data: list[DriveData] = []
        first: PlannedMotion | None = None
        for number, values in enumerate(self.versions):
            run = self.model.free_run(planned, values)
            if len(run.states) < len(planned.time) or not np.isfinite(run.outputs[-1]).all():
                return "the range in which the equations hold"
            motion = motion_of(self.model.model, self._signals(planned, values, run.states), planned.time)
            if passed := passed_by_vehicle(motion, self.limits):
                return passed
            first = motion if first is None else first
            if number < self.recorded:
                data.append(replace(planned, measurements=run.outputs))
        assert first is not None
        return Rehearsed(drive, profile, tuple(data), first)

    def again(self, drive: DriveSpec) -> Rehearsed:
        """Return a drive that keeps to the limits, as ``of`` has said of it before."""
        rehearsed = self.of(drive)
        assert isinstance(rehearsed, Rehearsed), rehearsed
        return rehearsed

    def _signals(self, planned: DriveData, values: Floats, states: Floats) -> dict[str, Floats]:
        model = self.model.model
        return {
            **dict(zip(self.model.names, values, strict=True)),
            **{name: planned.inputs[:, i] for i, name in enumerate(model.inputs)},
            **{name: states[:, i] for i, name in enumerate(model.states)},
        }


def without_outputs(profile: Profile, model: StateSpaceModel) -> xr.Dataset:
    """Return a drive as a recording of the inputs of a model, the outputs zero."""
    samples = len(profile.time)
    columns: dict[str, Floats] = {name: np.full(samples, value) for name, value in model.otherwise.items()}
    columns |= {"steering_wheel_angle": profile.steering_wheel_angle, "speed": profile.speed, **profile.further}
    columns |= dict.fromkeys(model.outputs, np.zeros(samples))
    return xr.Dataset(
        {name: ("time", values, signal_attributes(name)) for name, values in columns.items()},
        coords={"time": ("time", profile.time, {"units": "s"})},
    )
