"""Inputs of a model from a recording: exact where a simulation wrote them, else smoothed, with their covariance.

A recorded input is the true one and noise. What drives the model is the input given all its samples and its rate given
them (``harness.recordings.smooth.kinematic_smoother``), never a difference of samples. What an estimator in a vehicle
has is the input given the samples so far (by the same module), or each sample as it was measured; of the whole
recording it knows the noise alone.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
import xarray as xr

from harness import recordings
from harness.common.arrays import Floats, Mask
from harness.config import InputSignal
from harness.models.assembly.assemble import StateSpaceModel
from harness.recordings.smooth.kinematic_smoother import filtered, smoothed
from harness.simulation.simulate import forward_difference, halfway, joined

Between = Literal["held", "joined"]
"""How an input goes on behind a sample: held as in a simulation, or straight to the next one, as what was measured.

Held inputs would come half a sample late, which a fit takes for a lag of the steering.
"""


@dataclass(frozen=True)
class InputErrors:
    """What is not known of the inputs of a recording.

    Attributes:
        rows: Inputs of the model that are not exact, signals and, as inputs of their own, their rates ``(m,)``; -1 for
            a rate that is no input, by which the errors of the signal last.
        covariance: Of their errors at each sample ``(samples, m, m)``.
        lagged: Covariance of the errors at a sample with those at the one before ``(samples, m, m)``.
        of_samples: Whether the signals' errors are the noise of single samples, so that those of a step are not those
            of the outputs at its end.
    """

    rows: tuple[int, ...]
    covariance: Floats
    lagged: Floats
    of_samples: bool = False

    @property
    def visible(self) -> list[int]:
        """Return the numbers of the errors that are those of inputs."""
        return [a for a, row in enumerate(self.rows) if row >= 0]

    @property
    def roots(self) -> Floats:
        """Return a root ``L`` with ``L L' = P`` of the covariance of the visible errors ``(samples, v, v)``."""
        values, vectors = np.linalg.eigh(self.covariance[:, self.visible][:, :, self.visible])
        return np.asarray(vectors * np.sqrt(np.maximum(values, 0.0))[:, None, :])

    @property
    def transition(self) -> Floats:
        """Return what is left at each sample of the errors one sample before, on average ``(samples, m, m)``."""
        matrices = np.zeros_like(self.covariance)
        matrices[1:] = self.lagged[1:] @ np.linalg.pinv(self.covariance[:-1], hermitian=True)
        return matrices


EXACT = InputErrors((), np.zeros((0, 0, 0)), np.zeros((0, 0, 0)))
"""Nothing is unknown."""


@dataclass(frozen=True)
class Inputs:
    """The inputs of a model over a recording.

    Attributes:
        at: At the samples ``(samples, nu)``.
        between: During the step behind each sample ``(samples, nu)``.
        errors: What is not known of them.
    """

    at: Floats
    between: Floats
    errors: InputErrors


def inputs_of(
    recording: xr.Dataset, model: StateSpaceModel, step: float, between: Between, signal: InputSignal | None = None
) -> Inputs:
    """Return the inputs of a model over a recording.

    A rate of an exact input is its forward difference, as in a simulation.

    Args:
        recording: From ``harness.recordings.load_recording`` or ``harness.simulation.simulate.simulate_drive``.
        model: Its inputs are looked for.
        step: s between samples.
        between: How they go on behind a sample.
        signal: ``filtered`` over the past of each sample, or as ``measured``; by default smoothed, given all samples.

    Raises:
        UserError: If a signal is missing, or a sample of it.
    """
    time = recording["time"].to_numpy().astype(float)
    at, behind = np.empty((len(time), len(model.inputs))), np.empty((len(time), len(model.inputs)))
    smoothed: dict[str, _Smoothed] = {}
    for i, name in enumerate(model.inputs):
        source = model.rates.get(name, name)
        values = time - time[0] if name == "time" else recordings.inputs(recording, [source])[:, 0]
        if name != "time" and measured(recording, source):
            if source not in smoothed:
                smoothed[source] = _smoothed(values, step, recordings.updated(recording, source), signal)
            values = smoothed[source].rate if name in model.rates else smoothed[source].value
            at[:, i], behind[:, i] = values, halfway(values)
            if between == "held":
                at[:, i] = behind[:, i] = behind[:, i] if name in model.rates else values
            continue
        rate = name in model.rates
        values = forward_difference(values, step) if rate else values
        at[:, i], behind[:, i] = joined(values, rate) if between == "joined" else (values, values)
    return Inputs(at, behind, _errors(model, smoothed, signal == "measured"))


def measured(recording: xr.Dataset, signal: str) -> bool:
    """Whether a signal was measured, or computed from what was, and not written by a simulation, which knows it."""
    return "derived" in recording[signal].attrs


@dataclass(frozen=True)
class _Smoothed:
    """What is known of an input: value and rate, the covariance of their errors, and that with those one sample before.

    ``noise`` is the standard deviation of a sample.
    """

    value: Floats
    rate: Floats
    covariance: Floats
    lagged: Floats
    noise: float


def _smoothed(values: Floats, step: float, new: Mask | None, signal: InputSignal | None) -> _Smoothed:
    """Return a measured input as it is wanted."""
    whole = smoothed(values, step, new)
    if signal is None or whole.noise == 0:
        return _Smoothed(whole.value, whole.rate, whole.covariance, whole.lagged, whole.noise)
    past = filtered(values, step, whole.noise, new)
    if signal == "filtered":
        return _Smoothed(past.value, past.rate, past.covariance, past.lagged, past.noise)
    there = np.isfinite(values) if new is None else new & np.isfinite(values)
    covariance = np.where(there[:, None, None], past.of_the_sample, past.covariance)
    lagged = past.lagged.copy()
    lagged[there, 0] = 0.0
    return _Smoothed(np.where(there, values, past.value), past.rate, covariance, lagged, past.noise)


def _errors(model: StateSpaceModel, smoothed: dict[str, _Smoothed], of_samples: bool) -> InputErrors:
    """Return the joint covariance of all inputs that are not exact; different signals err independently."""
    uncertain = {n: f for n, f in smoothed.items() if f.noise > 0}
    if not uncertain:
        return EXACT
    rates = {source: rate for rate, source in model.rates.items() if rate in model.inputs}
    samples, sizes = len(next(iter(smoothed.values())).value), [f.covariance.shape[1] for f in uncertain.values()]
    covariance, lagged = (np.zeros((samples, sum(sizes), sum(sizes))) for _ in range(2))
    rows: list[int] = []
    for (name, signal), size in zip(uncertain.items(), sizes, strict=True):
        here = slice(len(rows), len(rows) + size)
        covariance[:, here, here], lagged[:, here, here] = signal.covariance, signal.lagged
        inputs = [name, rates.get(name, ""), ""][:size]
        rows += [model.inputs.index(n) if n in model.inputs else -1 for n in inputs]
    return InputErrors(tuple(rows), covariance, lagged, of_samples)
