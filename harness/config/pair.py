"""What plant and belief must share."""

from __future__ import annotations

from harness.common import registry
from harness.common.errors import ModelError
from harness.config.problems import Problems
from harness.config.schema import StudyFile
from harness.config.specs import ModelSpec
from harness.models.contracts import DRIVE_INPUTS


def check_pair(plant: ModelSpec, belief: ModelSpec, raw: StudyFile, problems: Problems) -> None:
    """Note where plant and belief do not share sample time, measured outputs, known inputs and targets."""
    if plant.step != belief.step:
        problems.add(
            "belief.step",
            f"{belief.step:g} s differs from the plant's {plant.step:g} s; both run on the same samples. "
            "Use belief.substeps for finer integration",
        )
    truth, held = plant.model(), belief.model()
    for output in held.outputs:
        if output not in truth.outputs:
            problems.add(
                "belief.sensors",
                f"the belief measures '{output}', which the plant's sensors do not give"
                f"{registry.closest(output, list(truth.outputs))}",
            )
    for name in held.inputs:
        given = {*truth.inputs, *truth.outputs, *truth.states, *truth.ports, *DRIVE_INPUTS, *held.rates, "time"}
        given |= set(held.otherwise)
        if name not in given:
            problems.add(
                "belief.vehicle",
                f"the belief needs input '{name}', which the plant does not have; add it to belief.unknown_inputs",
            )
    _check_input_noise(plant, belief, problems)
    for i, target in enumerate(raw.targets):
        if target in raw.targets[:i]:
            problems.add(f"targets[{i}]", f"'{target}' is named twice; remove one")
        for side, model in (("plant", truth), ("belief", held)):
            if target in held.estimated:
                continue  # scored where the plant has such a parameter
            try:
                model.resolve(target)
            except ModelError as error:
                problems.add(f"targets[{i}]", f"the {side} cannot give it: {error}")
                break


def _check_input_noise(plant: ModelSpec, belief: ModelSpec, problems: Problems) -> None:
    """What is read with noise must be known to be; what the vehicle itself supplies has the noise of its sensors."""
    for name in plant.input_noise:
        key = f"plant.noise.input.{name}"
        if name not in belief.model().inputs:
            problems.add(key, f"no estimator reads '{name}' as an input; remove the key")
        elif name not in plant.model().inputs and name not in DRIVE_INPUTS:
            problems.add(
                key, f"'{name}' is what a sensor gives, whose noise is noise.measurement.{name}; remove the key"
            )
        elif name not in belief.input_noise:
            problems.add(
                f"belief.noise.input.{name}",
                f"estimators read '{name}' with noise; state the variance that they believe it to have",
            )
