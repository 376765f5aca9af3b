"""Models of a trace for ``trace.json``: how likely each is, and what the drives say of those that are confusable.

A model that is wrong takes up misfit by larger variances of its own, and its filter then says less of its parameters.
That is far from a parabola in the variances, so it is stated at some levels of the process noise that all models share;
at each of them it is a parabola in the parameters.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from harness.common.arrays import Floats
from harness.diagnosis.criteria import HORIZONS, MASS
from harness.diagnosis.fitting import FittedHypothesis, Fitting
from harness.diagnosis.model.augmented_model import AugmentedModel
from harness.diagnosis.selection.posterior import ComparedModel, Posterior, judging
from harness.identification.data import DriveData

ESTIMATE = ("name", "value", "standard_error")

_TOGETHER = (1.0, 2.0, 3.5, 5.0, 7.0)
"""Steps of the logarithm of all variances from the least that a model was fitted with."""

_ALONE = (2.0, 4.0)
"""The same of the variances of one unit."""


def record_of_posterior(posterior: Posterior | None) -> dict[str, Any] | None:
    """Return how likely every model and every hypothesis is; horizons in s."""
    if posterior is None:
        return None

    def by_horizon(values: Floats) -> dict[str, float]:
        return {f"{h:g}": float(v) for h, v in zip(HORIZONS, values, strict=True)}

    return {
        "none_of_these": posterior.none,
        "hypotheses": [{"name": h.name, "kind": h.kind, "probability": v} for h, v in posterior.inclusion().items()],
        "models": [
            {
                **_model(m),
                "probability": m.probability,
                "log_prior": m.log_prior,
                "log_predictive_density": by_horizon(m.densities),
                "difference": dict(zip(("value", "lower", "upper"), m.difference, strict=True)),
            }
            for m in posterior.models
        ],
        "coverage_95": by_horizon(posterior.coverage),
    }


def record_of_confusable(
    posterior: Posterior | None, fitting: Fitting, held_out: Sequence[DriveData]
) -> dict[str, Any] | None:
    """Return the smallest set of models that holds the right one, if one is right, with its mass, each as fitted."""
    if posterior is None:
        return None
    chosen = posterior.confusable()
    fits = [m.fitted for m in chosen]
    levels = _noise_levels(fitting, fits)
    models = [
        {
            **_model(m),
            "alike": _alike(m, fitting.augmented),
            "share": m.share,
            **_estimated(m.fitted, fitting),
            **_at_levels(fitting, m.fitted, levels),
        }
        for m in chosen
    ]
    return {
        "asked": MASS,
        "mass": sum(m.share for m in chosen),
        "models": models,
        "noise": _record_of_levels(fitting, held_out, fits[0], levels),
    }


def _estimated(fitted: FittedHypothesis, fitting: Fitting) -> dict[str, Any]:
    """Return what a fit moved that all drives share: values with standard errors, and their correlation."""
    errors, correlation = fitting.uncertainty(fitted)
    shared = [i for i, c in enumerate(fitted.coordinates) if not c.drives]
    rows = [(c.name, fitted.point.value(c), float(errors[i])) for i in shared for c in [fitted.coordinates[i]]]
    return {
        "estimates": [dict(zip(ESTIMATE, row, strict=True)) for row in rows],
        "correlation": correlation[np.ix_(shared, shared)].tolist(),
    }


def _model(m: ComparedModel) -> dict[str, Any]:
    """Return what a model has; names that stand together are what the drives cannot tell apart at all."""
    return {"added": [[{"name": h.name, "kind": h.kind} for h in alike.hypotheses] for alike in m.added]}


def _alike(m: ComparedModel, augmented: AugmentedModel) -> list[dict[str, Any]]:
    """Return what may stand in the place of an addition, with the amplitude that does the same and its share."""
    values = {c.name: m.fitted.point.value(c) for c in m.fitted.coordinates}
    nominal = dict(zip(augmented.names, augmented.stated(), strict=True))
    instead = []
    for alike in m.added:
        first, *others = alike.hypotheses
        for h, share, ratio in zip(others, alike.shares[1:], alike.ratios[1:], strict=False):
            p, moved = augmented.model.parameters[augmented.row(h.amplitudes[0])], first.amplitudes[0]
            change = ratio * (values.get(moved, math.nan) - nominal[moved])
            value = values.get(p.name, nominal[p.name]) + change
            if change and p.lower <= value <= p.upper:
                instead.append({
                    "instead_of": first.name, "parameters": [*first.amplitudes, *first.shapes], "name": h.name,
                    "kind": h.kind, "amplitude": p.name, "value": value, "ratio": ratio, "share": share,
                })  # fmt: skip
    return instead


def _noise_levels(fitting: Fitting, models: Sequence[FittedHypothesis]) -> Floats:
    """Return levels of the process noise, as logarithms of factors by unit ``(levels, groups)``, the least first.

    Args:
        fitting: Of the drives.
        models: Whose least noise is the first level; noise that is held has no other.
    """
    least = np.min([m.point.process for m in models], axis=0)
    groups = len(least)
    if fitting.noise_held or not groups:
        return np.zeros((1, groups)) + least
    together = [step * np.ones(groups) for step in _TOGETHER]
    alone = [step * row for step in _ALONE for row in np.eye(groups)] if groups > 1 else []
    return np.array([least, *(least + step for step in (*together, *alone))])


def _record_of_levels(fitting: Fitting, held_out: Sequence[DriveData], fitted: FittedHypothesis, levels: Floats) -> Any:
    """Return the levels as variances per step by state, for how long was driven and judged, in s, and the sampling."""
    states = fitting.augmented.spec.model().states
    variances = fitting.noise([replace(fitted.point, process=level) for level in levels]).process
    return {
        "spacing": dict(zip(fitting.augmented.model.outputs, _spacing(fitting.drives), strict=True)),
        "levels": [dict(zip(states, column.tolist(), strict=True)) for column in variances.T],
        "fitted_seconds": sum(float(d.time[-1]) for d in fitting.drives),
        "held_out_seconds": sum(judging(float(d.time[-1])) for d in held_out),
    }


def _spacing(drives: Sequence[DriveData]) -> list[int]:
    """Return how many steps apart samples of each output are, as a rule ``(ny,)``."""
    there = np.isfinite(np.vstack([d.measurements for d in drives]))
    return [int(np.median(np.diff(np.flatnonzero(column)))) if np.sum(column) > 1 else 1 for column in there.T]


def _at_levels(fitting: Fitting, fitted: FittedHypothesis, levels: Floats) -> dict[str, Any]:
    """Return the measurement noise of a fit, and its log posterior at each level with gradient and information.

    Of the parameters that all drives share, in SI units; those of single drives are open.
    """
    outputs = fitting.augmented.spec.model().outputs
    measurement = fitting.noise([fitted.point]).measurement[:, 0]
    each = [fitting.at_process_noise(fitted, level) for level in levels]
    return {
        "measurement_noise": dict(zip(outputs, measurement.tolist(), strict=True)),
        "at_levels": [
            {"log_posterior": value, "gradient": gradient.tolist(), "information": information.tolist()}
            for value, gradient, information in each
        ],
    }
