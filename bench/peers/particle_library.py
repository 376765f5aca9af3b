"""The bootstrap filter of ``particles`` on the problem, vectorised over particles with NumPy."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import particles
from particles import distributions, state_space_models

from bench.peers.problem import NUMPY, Problem, equations


class _Vehicle(state_space_models.StateSpaceModel):
    given: Problem
    ahead: Callable[[Any, Any], Any]

    def PX0(self) -> Any:
        return _independent(self.given.mean, self.given.variance)

    def PX(self, t: int, xp: Any) -> Any:
        following = self.ahead(xp.T, self.given.inputs[t - 1])
        return _independent(np.stack([np.broadcast_to(f, len(xp)) for f in following], axis=0), self.given.process)

    def PY(self, t: int, xp: Any, x: Any) -> Any:
        return distributions.Normal(
            loc=x[:, self.given.measured_state], scale=float(np.sqrt(self.given.measurement[0]))
        )


def _independent(means: Any, variances: Any) -> Any:
    scales = np.sqrt(variances)
    return distributions.IndepProd(*(distributions.Normal(m, s) for m, s in zip(means, scales, strict=True)))


def bootstrap(given: Problem, count: int) -> Callable[[], object]:
    """Return the bootstrap filter with systematic resampling below half of the particles, as ours."""
    vehicle = _Vehicle(given=given, ahead=equations(given, NUMPY).ahead)
    filtered = state_space_models.Bootstrap(ssm=vehicle, data=list(given.measurements[:, 0, 0]))
    return lambda: particles.SMC(fk=filtered, N=count, resampling="systematic", ESSrmin=0.5).run()
