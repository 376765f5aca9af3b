"""Recordings as identification takes them: the inputs and outputs of one model over one time base."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import xarray as xr

from harness import recordings
from harness.common.arrays import Floats
from harness.common.errors import UserError
from harness.config import InputSignal
from harness.identification.measured_inputs import Between, InputErrors, inputs_of
from harness.models.assembly.assemble import StateSpaceModel, symbol
from harness.models.signals import signal_attributes
from harness.recordings.read.span import refuse_overlaps

SHORTEST = 20
"""Samples; a shorter recording is refused."""

STEP_TOLERANCE = 1e-3
"""Of a step, up to which two are the same."""


@dataclass(frozen=True)
class DriveData:
    """One recording in terms of a model.

    Attributes:
        name: In reports.
        time: s ``(samples,)``, equidistant from 0.
        inputs: ``(samples, nu)``, finite.
        between: Inputs during the step behind each sample ``(samples, nu)``.
        measurements: ``(samples, ny)``, NaN where missing.
        first_mean: First state ``(nx,)``: a measured one as measured, others as the vehicle's ``START``, else zero.
        first_variance: Its variances ``(nx,)``; ``FilteredModel.drive`` knows them.
        input_errors: What is not known of the inputs.
        effects: What their errors do to the next state and, behind it, the outputs: of ``m`` independent ones of unit
            variance at each sample ``(samples, nx + ny, m)``, which ``FilteredModel.drive`` knows; none if exact.
        spread: Variances of the outputs of a free run that come of them ``(samples, ny)``; zero if they are exact.
    """

    name: str
    time: Floats
    inputs: Floats
    between: Floats
    measurements: Floats
    first_mean: Floats
    first_variance: Floats
    input_errors: InputErrors
    effects: Floats
    spread: Floats


def step_of(recording: xr.Dataset) -> float:
    """Return the sample time in s, rounded to a nanosecond."""
    time = recording["time"].to_numpy()
    return round(float(time[-1] - time[0]) / (len(time) - 1), 9)


def steered(recording: xr.Dataset, values: Mapping[str, float]) -> xr.Dataset:
    """Return a recording with the angle of the steering wheel where it holds only that of the road wheels.

    Args:
        recording: From ``harness.recordings.load_recording``.
        values: Of the model's parameters; without a ``steering_ratio`` nothing is made.
    """
    road, wheel = "road_wheel_angle", "steering_wheel_angle"
    if wheel in recording or road not in recording or "steering_ratio" not in values:
        return recording
    made = (values["steering_ratio"] * recording[road]).assign_attrs(
        {**recording[road].attrs, **signal_attributes(wheel)}
    )
    updated = {f"updated_{wheel}": recording[c] for c in [f"updated_{road}"] if c in recording.coords}
    return recording.assign({wheel: made}).assign_coords(updated)


def refuse_the_same(
    fitted: Sequence[xr.Dataset], held_out: Sequence[xr.Dataset], option: str = "test", use: str = "fitted"
) -> None:
    """Refuse a held-out recording that is fitted as well, by content, so that a copy is recognised, or in part.

    Args:
        fitted: Recordings of one purpose.
        held_out: Recordings of another.
        option: That names the latter, for the error.
        use: Of the former, for the error.

    Raises:
        UserError: If there is one.
    """
    refuse_overlaps(fitted, held_out, option, use)
    for i, recording in enumerate(held_out):
        same = next((j for j, other in enumerate(fitted) if recording.equals(other)), None)
        if same is not None:
            names = recording.attrs.get("file", f"number {i + 1}"), fitted[same].attrs.get("file", f"number {same + 1}")
            raise UserError(
                f"{option}: {names[0]} is {use} as well, it holds the same as {names[1]}; state another one"
            )


def measurements_of(recording: xr.Dataset, model: StateSpaceModel, name: str) -> Floats:
    """Return the outputs that a recording holds ``(samples, ny)``, NaN where missing, if it can be a drive of a model.

    Args:
        recording: As in ``drive_from``.
        model: Its inputs and outputs are looked for.
        name: Of the recording, for errors.

    Raises:
        UserError: If a signal is missing or holds no number, or the recording is too short.
    """
    samples = recording.sizes["time"]
    if samples < SHORTEST:
        raise UserError(f"{name}: has {samples} samples; a fit needs at least {SHORTEST}")
    for source in dict.fromkeys(model.rates.get(i, i) for i in model.inputs if i != "time"):
        recordings.inputs(recording, [source])
    measurements = np.ascontiguousarray(recordings.measurements(recording, list(model.outputs)), dtype=float)
    for output, column in zip(model.outputs, measurements.T, strict=True):
        if not np.isfinite(column).any():
            raise UserError(f"{name}: '{output}' holds no number; choose sensors without it")
    measurements[~np.isfinite(measurements)] = np.nan
    return measurements


def drive_from(
    recording: xr.Dataset,
    model: StateSpaceModel,
    name: str,
    between: Between = "held",
    signal: InputSignal | None = None,
) -> DriveData:
    """Return a recording in terms of a model.

    Args:
        recording: From ``harness.recordings.load_recording`` or ``harness.simulation.simulate.simulate_drive``.
        model: Its inputs and outputs are looked for.
        name: Of the recording, for errors and reports.
        between: How inputs go on behind a sample.
        signal: What of them is taken, see ``harness.identification.measured_inputs.inputs_of``.

    Raises:
        UserError: If a signal is missing or holds no number, or the recording is too short.
    """
    measurements = measurements_of(recording, model, name)
    time = recording["time"].to_numpy().astype(float)
    inputs = inputs_of(recording, model, step_of(recording), between, signal)
    first = _first_mean(model, recording, measurements)
    exact = np.zeros((len(time), len(first) + measurements.shape[1], 0)), np.zeros_like(measurements)
    return DriveData(
        name,
        time - time[0],
        inputs.at,
        inputs.between,
        measurements,
        first,
        np.zeros_like(first),
        inputs.errors,
        *exact,
    )


def started_by(model: StateSpaceModel) -> dict[int, int]:
    """Return the states that a parameter starts, each with the row of that parameter."""
    rows = {name: i for i, name in enumerate(model.parameter_names)}
    return {i: rows[str(model.start[s])] for i, s in enumerate(model.states) if model.start.get(s) in rows}


def _first_mean(model: StateSpaceModel, recording: xr.Dataset, measurements: Floats) -> Floats:
    mean = np.zeros(len(model.states))
    for i, state in enumerate(model.states):
        source = model.start.get(state, 0.0)
        if isinstance(source, str):  # a parameter comes with each candidate, an input with the recording
            source = 0.0 if source in model.parameter_names else float(recordings.inputs(recording, [source])[0, 0])
        mean[i] = source
        for a, (output, expr) in enumerate(model.outputs.items()):
            if model.ports.get(f"sensor_{output}", expr) == symbol(state) and np.isfinite(measurements[0, a]):
                mean[i] = measurements[0, a]
    return mean
