"""Study of what an identification leaves open: how wrong estimates may still be, and because of which parameter."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from harness.common.files import toml_text
from harness.config import ModelSpec
from harness.config.design_tables import DesignTable
from harness.config.designs import resolve_design
from harness.config.factors import Models
from harness.config.parameter_set import stated_std
from harness.config.problems import Problems
from harness.identification.data import DriveData
from harness.models.roles import VEHICLES

STUDY = "posterior.toml"

_HEADING = "Vehicles are drawn from what the fit leaves open; estimators believe its estimates. Run it: harness run {}"

_LACKING = "\n{}: the model lacks something,\nso that the vehicle errs by more than this study says (harness trace)."

_MIXED = (
    "Vehicles are drawn from the models that these recordings do not tell apart, each with its share; estimators\n"
    "believe the amended one. Run it: harness run {}"
)

_LEFT_OUT = "\nNot drawn, as their shares are small or the error of a parameter is not known: {}."

POINTS = 64


@dataclass(frozen=True)
class Mixture:
    """Models that recordings do not tell apart.

    Attributes:
        effects: Of the plant that can be any of them.
        values: Of that plant, for whatever one of them moved: where nothing is added.
        models: Of each the name of its design, its number in the confusable set, from 1, and its share.
        left_out: The others of that set in words.
    """

    effects: tuple[str, ...]
    values: Mapping[str, float]
    models: tuple[tuple[str, int, float], ...]
    left_out: tuple[str, ...] = ()


def posterior_study(
    spec: ModelSpec,
    file: str,
    errors: Sequence[tuple[str, float]],
    drives: Sequence[DriveData],
    lacks: str = "",
    mixture: Mixture | None = None,
) -> str:
    """Return the text of a study next to the result of an identification or a trace; empty where none can be made.

    The drive is a sine at the mean speed of the recordings, with as much steering. There is none of a vehicle that is
    not driven by steering wheel and speed, and none where a parameter has no standard error.

    Args:
        spec: The model as fitted.
        file: Its parameter file in the folder of the result.
        errors: Parameters that were fitted, and their standard errors.
        drives: Recordings that were fitted.
        lacks: What shows that the model lacks something, which no parameter of it stands for; empty for nothing.
        mixture: Models that are drawn in place of the parameters of this one, which estimators believe.
    """
    model = spec.model()
    driven = {"steering_wheel_angle", "speed"} <= set(model.inputs)
    known = errors and all(np.isfinite(error) and error > 0 for _, error in errors)
    if spec.external is not None or not (drives and driven and (known or mixture)):
        return ""
    speed, steering = (
        np.concatenate([d.inputs[:, model.inputs.index(n)] for d in drives]) for n in ("speed", "steering_wheel_angle")
    )
    own = VEHICLES.load(spec.vehicle).STATES
    hidden = [s for s in own if s not in model.outputs]
    content: dict[str, Any] = {
        "name": "posterior",
        "title": "How wrong may estimates still be after these recordings, and because of what?",
        "seed": 1,
        "targets": [*hidden, *(s for s in own if s not in hidden)][:2],
        "plant": {
            "vehicle": spec.vehicle,
            "parameters": file,
            "sensors": spec.sensors,
            "integrator": spec.integrator,
            "step": spec.step,
            "substeps": spec.substeps,
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
        "design": [
            {"name": "posterior", "sampling": "population", "samples": POINTS, "posterior": "."},
            *_tolerances(spec, [name for name, _ in errors]),
        ],
    }
    heading = _HEADING
    if mixture is not None:
        heading = _MIXED + (_LEFT_OUT.format(", ".join(mixture.left_out)) if mixture.left_out else "")
        content["plant"] |= {"effects": list(mixture.effects), "values": dict(mixture.values)}
        content["belief"] = {"parameters": file, "effects": list(spec.effects)}
        like = content["design"].pop(0)
        each = [{**like, "name": name, "model": number, "share": share} for name, number, share in mixture.models]
        content["design"] = [*each, *content["design"]]
    return toml_text(content, heading.format(STUDY) + (_LACKING.format(lacks) if lacks else ""))


def _tolerances(spec: ModelSpec, names: Sequence[str]) -> list[dict[str, Any]]:
    """Return a design of the same parameters as well as they are known without recordings; none if it is impossible."""
    std = stated_std(spec)
    design = {
        "name": "tolerances",
        "sampling": "population",
        "samples": POINTS,
        "factor": [
            {
                "parameter": name,
                "distribution": {"kind": "truncated_normal", "mean": spec.values[name], "std": std[name]},
            }
            for name in names
        ],
    }
    problems = Problems("")
    table = DesignTable.model_validate(design)
    return [design] if resolve_design(table, "design", Models(spec, spec), problems) is not None else []
