"""A point of a fit as a model of its own, for filters, studies and parameter files."""

from __future__ import annotations

from dataclasses import replace

from harness.config import ModelSpec
from harness.diagnosis.fitting.fit import Point
from harness.diagnosis.selection.forward_selection import Trace


def fitted_model(trace: Trace, spec: ModelSpec, point: Point) -> ModelSpec:
    """Return a model with values and variances of a point.

    An effect's own states have no noise unless it is a random process, and a change begins when it does in the first
    drive.
    """
    augmented, noise = trace.fitting.augmented, trace.fitting.noise([point])
    process = dict(zip(augmented.nominal.states, map(float, noise.process[:, 0]), strict=True))
    model = spec.model()
    known = dict(zip(augmented.names, map(float, point.values[:, 0]), strict=True))
    noise_of = {s: q * spec.step for s, q in model.noise.items()} | spec.process_noise | process
    return replace(
        spec,
        values={n: known[n] if n in known else spec.values[n] for n in model.parameter_names},
        process_noise={s: noise_of.get(s, 0.0) for s in model.states},
        measurement_noise=dict(zip(model.outputs, map(float, noise.measurement[:, 0]), strict=True)),
    )
