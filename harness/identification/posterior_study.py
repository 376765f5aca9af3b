"""Study of what an identification leaves open: how wrong estimates may still be, and because of which parameter."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from harness.common.files import toml_text
from harness.identification.contract import Fit
from harness.identification.data import DriveData
from harness.models.roles import VEHICLES

STUDY = "posterior.toml"

_HEADING = "Vehicles are drawn from what the fit leaves open; estimators believe its estimates. Run it: harness run {}"

POINTS = 64


def posterior_study(fit: Fit, drives: Sequence[DriveData]) -> str:
    """Return the text of a study beside ``parameters.toml`` and ``identify.json``; empty where none can be made.

    The drive is a sine at the mean speed of the recordings, with as much steering. There is none of a vehicle that is
    not driven by steering wheel and speed, and none where a parameter has no standard error.

    Args:
        fit: The fit.
        drives: Recordings that were fitted.
    """
    model, names = fit.spec.model(), fit.spec.values.keys()
    known = [e for e in fit.estimates if e.name in names and np.isfinite(e.error) and e.error > 0]
    fitted = [e for e in fit.estimates if e.name in names]
    driven = {"steering_wheel_angle", "speed"} <= set(model.inputs)
    if fit.spec.external is not None or not (drives and driven and known) or len(known) < len(fitted):
        return ""
    speed, steering = (
        np.concatenate([d.inputs[:, model.inputs.index(n)] for d in drives]) for n in ("speed", "steering_wheel_angle")
    )
    own = VEHICLES.load(fit.spec.vehicle).STATES
    hidden = [s for s in own if s not in model.outputs]
    content: dict[str, Any] = {
        "name": "posterior",
        "title": "How wrong may estimates still be after these recordings, and because of what?",
        "seed": 1,
        "targets": [*hidden, *(s for s in own if s not in hidden)][:2],
        "plant": {
            "vehicle": fit.spec.vehicle,
            "parameters": "parameters.toml",
            "sensors": fit.spec.sensors,
            "integrator": fit.spec.integrator,
            "step": fit.spec.step,
            "substeps": fit.spec.substeps,
        },
        "drive": [
            {
                "name": "sine",
                "kind": "sine",
                "speed": round(float(speed.mean()), 2),
                "amplitude": round(float(np.sqrt(2.0) * steering.std()), 4),
                "duration": 20.0,
                "lateral_acceleration_limit": 9.0,
            }
        ],
        "estimator": [{"name": "EKF", "kind": "ekf"}, {"name": "UKF", "kind": "ukf"}],
        "design": [{"name": "posterior", "sampling": "population", "samples": POINTS, "posterior": "."}],
    }
    return toml_text(content, _HEADING.format(STUDY))
