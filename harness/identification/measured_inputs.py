"""Inputs of a model from a recording: exact where a simulation wrote them, else smoothed, with their covariance.

A recorded input is the true one and noise. What drives the model is the input given all its samples and its rate given
them (``harness.recordings.kinematic_smoother``), never a difference of samples.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
import xarray as xr

from harness import recordings
from harness.common.arrays import Floats
from harness.models.assembly.assemble import Model
from harness.recordings.kinematic_smoother import Smoothed, smoothed

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
    """

    rows: tuple[int, ...]
    covariance: Floats
    lagged: Floats

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
        found = np.zeros_like(self.covariance)
        found[1:] = self.lagged[1:] @ np.linalg.pinv(self.covariance[:-1], hermitian=True)
        return found


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


def inputs_of(recording: xr.Dataset, model: Model, step: float, between: Between) -> Inputs:
    """Return the inputs of a model over a recording.

    A rate of an exact input is its forward difference, as in a simulation.

    Args:
        recording: From ``harness.recordings.load_recording`` or ``harness.simulation.simulate.simulate_drive``.
        model: Its inputs are looked for.
        step: s between samples.
        between: How they go on behind a sample.

    Raises:
        UserError: If a signal is missing, or a sample of it.
    """
    time = recording["time"].to_numpy().astype(float)
    at, behind = np.empty((len(time), len(model.inputs))), np.empty((len(time), len(model.inputs)))
    known: dict[str, Smoothed] = {}
    for i, name in enumerate(model.inputs):
        source = model.rates.get(name, name)
        values = time - time[0] if name == "time" else recordings.inputs(recording, [source])[:, 0]
        if name != "time" and measured(recording, source):
            if source not in known:
                known[source] = smoothed(values, step, recordings.updated(recording, source))
            values = known[source].rate if name in model.rates else known[source].value
            at[:, i], behind[:, i] = values, _halfway(values)
            if between == "held":
                at[:, i] = behind[:, i] = behind[:, i] if name in model.rates else values
            continue
        if name in model.rates:
            difference = np.diff(values) / step
            at[:, i] = behind[:, i] = np.append(difference, difference[-1:])
            if between == "joined":  # constant over the step behind a sample; at the sample the mean of both sides
                at[1:, i] = _halfway(at[:, i])[:-1]
        else:
            at[:, i] = values
            behind[:, i] = values if between == "held" else _halfway(values)
    return Inputs(at, behind, _errors(model, known))


def measured(recording: xr.Dataset, signal: str) -> bool:
    """Whether a signal was measured, or computed from what was, and not written by a simulation, which knows it."""
    return "derived" in recording[signal].attrs


def _halfway(values: Floats) -> Floats:
    """Return the mean of each sample and the next; the last one as it is."""
    found = values.copy()
    found[:-1] = 0.5 * (values[:-1] + values[1:])
    return found


def _errors(model: Model, known: dict[str, Smoothed]) -> InputErrors:
    """Return the joint covariance of all inputs that are not exact; different signals err independently."""
    uncertain = {n: f for n, f in known.items() if f.noise > 0}
    if not uncertain:
        return EXACT
    rates = {source: rate for rate, source in model.rates.items() if rate in model.inputs}
    samples, sizes = len(next(iter(known.values())).value), [f.order + 1 for f in uncertain.values()]
    covariance, lagged = (np.zeros((samples, sum(sizes), sum(sizes))) for _ in range(2))
    rows: list[int] = []
    for (name, found), size in zip(uncertain.items(), sizes, strict=True):
        here = slice(len(rows), len(rows) + size)
        covariance[:, here, here], lagged[:, here, here] = found.covariance, found.lagged
        inputs = [name, rates.get(name, ""), ""][:size]
        rows += [model.inputs.index(n) if n in model.inputs else -1 for n in inputs]
    return InputErrors(tuple(rows), covariance, lagged)
