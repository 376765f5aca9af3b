"""Simulated recordings with hidden parameters, and the problem of finding these."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from harness.common.arrays import Floats
from harness.config import ModelSpec
from harness.engine.simd.lanes import LANES
from harness.identification.data import DriveData, drive_from
from harness.identification.simulation_error import Misfit
from harness.models.contracts import Profile
from harness.models.signals import TRUTH
from harness.runner.contract import Held, InputSeries, Signals
from harness.simulation.simulate import CompiledSimulator, in_lanes, simulate_drive, variances


def record(spec: ModelSpec, profile: Profile, name: str, seed: int) -> DriveData:
    """Simulate a drive with noise and return it as a recording.

    The first state is known as well as one measurement of each output tells, or the process noise of a step.

    Args:
        spec: The plant with its noise.
        profile: The drive.
        name: Of the recording.
        seed: Of the noise.
    """
    model = spec.model()
    dataset = simulate_drive(spec, profile, seed=seed)
    drive = drive_from(dataset, model, name)
    spread = variances({**spec.process_noise, **spec.measurement_noise}, model.states)
    return replace(
        drive, first_mean=np.array([float(dataset[f"{TRUTH}{s}"][0]) for s in model.states]), first_variance=spread
    )


@dataclass(frozen=True)
class Setup:
    """The problem: costs on the drives to fit and to judge on, and what is to be found.

    Attributes:
        fit: Cost on the drives to fit.
        judge: The same on the drives to judge.
        hidden: The plant's values of the free parameters ``(free,)``.
        plants: The hidden plant by the name of the drive.
        profiles: What the driver does by the name of the drive.
    """

    fit: Misfit
    judge: Misfit
    hidden: Floats
    plants: dict[str, ModelSpec]
    profiles: dict[str, Profile]

    def free_run(self, drive: str, candidate: Floats) -> dict[str, Floats]:
        """Return the simulated outputs on a drive to judge, by name; NaN from where it diverges on."""
        number = [d.name for d in self.judge.drives].index(drive)
        drive_data, values = self.judge.drives[number], in_lanes(self.judge.parameters(number, candidate[None])[:, 0])
        spec = self.plants[drive]
        names = tuple(spec.model().outputs)
        nx, ny = len(spec.model().states), len(names)
        noise = np.zeros((len(drive_data.time), nx + ny, LANES))
        held = Held(values, np.zeros((nx, LANES)), np.zeros((ny, LANES)), in_lanes(drive_data.first_mean))
        batch = CompiledSimulator.of(spec).run(InputSeries(in_lanes(drive_data.inputs)), held, noise, Signals(names))
        batch.truth[int(batch.left_at[0]) :] = np.nan
        return {name: batch.truth[:, i, 0] for i, name in enumerate(names)}

    def judged(self, drive: str, candidate: Floats) -> dict[str, tuple[float, float]]:
        """Return RMSE and largest deviation of each output in SI units, up to where the model diverges."""
        measured = next(d for d in self.judge.drives if d.name == drive).measurements
        errors = {name: run - measured[:, i] for i, (name, run) in enumerate(self.free_run(drive, candidate).items())}
        return {n: (float(np.sqrt(np.nanmean(e**2))), float(np.nanmax(np.abs(e)))) for n, e in errors.items()}
