"""Contracts of what runs in a worker process, and how it is made from a loader.

A loader is a table of plain values that a worker process makes a plant or an estimator from; ``kind`` names the module
that does. Everything is in SI units and in the order of the description. Samples are ``step`` seconds apart.
"""

from __future__ import annotations

import importlib
from collections.abc import Mapping
from typing import Any, NamedTuple, Protocol

from harness.common.arrays import Floats

MODULES = {
    "fmu": "harness.external.fmu.plants",
    "python": "harness.external.python_plant",
    "estimator-python": "harness.external.estimators.python",
    "estimator-library": "harness.external.estimators.library",
    "estimator-onnx": "harness.external.estimators.onnx",
    "estimator-fmu": "harness.external.fmu.estimators",
    "estimator-fmu-belief": "harness.external.fmu.belief",
}
"""Module by kind, which may be a module itself; its ``load(loader)`` returns a plant or an estimator."""


class Run(NamedTuple):
    """A simulated run.

    Attributes:
        outputs: Published signals ``(samples, no)``.
        reached: First sample from which on nothing counts, ``samples`` where the run is whole.
        reason: Why it ended there, in words.
    """

    outputs: Floats
    reached: int
    reason: str = ""


class RunEstimates(NamedTuple):
    """Estimates of a run.

    Attributes:
        estimates: ``(samples, ne)``.
        variances: Of the estimates, of the same shape; ``None`` where there are none.
        nis: Normalised innovation squared ``(samples,)``; ``None`` where there is none.
        reached, reason: As of a simulated run.
    """

    estimates: Floats
    variances: Floats | None
    nis: Floats | None
    reached: int
    reason: str = ""


Timed = tuple[Floats, float, Floats]
"""How long each step of an estimator took and a call that does nothing takes, in ns, and its last estimates."""


class PlantBody(Protocol):
    """A plant in its worker process."""

    def simulate(self, step: float, inputs: Floats, disturbances: Floats, values: Floats) -> Run:
        """Run over a drive.

        Args:
            step: Sample time in s.
            inputs: Held from each sample to the next ``(samples, nu)``.
            disturbances: Held like inputs ``(samples, nd)``.
            values: Parameters ``(np,)``.

        Returns:
            Outputs before the step behind each sample; the first are those of the initial state.
        """


class EstimatorBody(Protocol):
    """An estimator in its worker process."""

    def estimate(self, step: float, inputs: Floats, measurements: Floats, values: Floats, seed: int) -> RunEstimates:
        """Run over what was measured.

        Args:
            step: Sample time in s.
            inputs: ``(samples, nu)``.
            measurements: ``(samples, ny)``, NaN where missing, as all of the first sample are.
            values: Parameters of the belief ``(np,)``.
            seed: For one that draws random numbers.
        """

    def timed(self, step: float, inputs: Floats, measurements: Floats, values: Floats, begins: bool) -> Timed:
        """Take samples, of a new run if it begins, for ``harness realtime``; that of an FMU lacks it."""


def load(loader: Mapping[str, Any]) -> Any:
    """Return the body that a loader makes.

    Raises:
        UserError: If it cannot be made, in words.
    """
    return importlib.import_module(MODULES.get(loader["kind"], loader["kind"])).load(loader)
