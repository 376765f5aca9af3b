"""Simulated recordings with hidden parameters."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from harness.config import ModelSpec
from harness.identification.data import Drive, drive_from
from harness.models.contracts import Profile
from harness.simulation.simulate import simulate_drive, variances


def record(spec: ModelSpec, profile: Profile, name: str, seed: int) -> Drive:
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
    return replace(drive, first_mean=np.array([float(dataset[s][0]) for s in model.states]), first_variance=spread)
