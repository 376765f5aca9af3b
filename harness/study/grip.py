"""Drives that ask a plant for more lateral acceleration than the friction of a design can give."""

from __future__ import annotations

import numpy as np

from harness.config import Study
from harness.models.drives._shapes import lateral_acceleration
from harness.models.quantities import listed
from harness.simulation.drives import context_of
from harness.study.compiled_study import CompiledStudy

GRAVITY = 9.81
FRICTION = "friction"
"""Parameter of a vehicle that is the largest friction of its tyres."""

_OF_THE_PLANT = {(FRICTION, "plant"), (FRICTION, "both")}


def asked_too_much(study: Study, compiled: CompiledStudy) -> list[str]:
    """Return a sentence for each drive that asks for more than there is somewhere in the designs.

    A drive asks for the lateral acceleration of a vehicle that follows its wheels; friction times gravity is the most
    that tyres of equal friction give it. Nothing of a plant without such a parameter.
    """
    own = study.plant.values.get(FRICTION)
    if own is None:
        return []
    least = {
        design.name: min([min(f.lower) for f in design.factors if (f.parameter, f.of) in _OF_THE_PLANT] or [own])
        for design in study.designs
    }
    sentences = []
    for spec, drive in zip(study.drives, compiled.drives, strict=True):
        asked = float(np.abs(lateral_acceleration(drive.profile, context_of(study.plant, spec))).max())
        short = [f"{mu * GRAVITY:.2g} m/s^2 in design '{name}'" for name, mu in least.items() if mu * GRAVITY < asked]
        if short:
            sentences.append(
                f"drive '{spec.name}' asks for {asked:.2g} m/s^2 of lateral acceleration, more than friction gives: "
                f"{listed(short)}; runs in which the vehicle goes out of control are counted for no estimator"
            )
    return sentences
