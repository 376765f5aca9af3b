"""Detection limits of a trace to be lowered: what the drives so far could not have shown, and what further ones would.

The detection limit of an effect is three standard errors of its amplitude where there is none of it, with all that the
likeliest model was fitted with open. A trace states it for each hypothesis. To its information comes that of planned
drives, of which half are fitted, from the exact derivatives of the same filter, with all else open in these too: both
together tell at least as much (a Schur complement of a sum is no less than the sum of both).
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from harness.common.arrays import Floats
from harness.common.errors import UserError
from harness.common.registry import closest
from harness.diagnosis.criteria import BLOCK
from harness.experiment.contract import Evidence, ExpectedOutcome
from harness.experiment.information import log_error, open_covariance
from harness.experiment.rehearsal import Rehearsed
from harness.experiment.separation import OpenTrace, SeparationGoal
from harness.identification.measured_file import SHORTEST
from harness.identification.uncertainty import marginal
from harness.models.quantities import listed, print_unit, words
from harness.reporting.style import with_unit

LIMIT = 3.0
"""Standard errors of an amplitude that can be told from none."""


class DetectionGoal:
    """Effects that the drives of a trace could not have shown, or only where they are large.

    Args:
        trace: What it left.
        wanted: Names of hypotheses of the trace, such as ``roll_steer@front``.

    Raises:
        UserError: If a name is none of them, or the likeliest model has it already.
    """

    criterion = "D"
    recorded, turns = 1, 2
    shortest, lead_in = SHORTEST, BLOCK
    enough = -math.inf
    measure = "the detection limit, of several amplitudes their geometric mean in SI units"

    def __init__(self, trace: OpenTrace, wanted: Sequence[str]) -> None:
        self.trace, self.wanted = trace, tuple(wanted)
        for name in wanted:
            if name not in trace.detectable:
                raise UserError(f"for: the trace tried no '{name}'{closest(name, list(trace.detectable))}")
        self.limits = {p: limit for name in wanted for p, limit in trace.detectable[name].items()}
        if there := [p for p in self.limits if p in trace.rivals[0].values]:
            raise UserError(f"for: the likeliest model has '{there[0]}' already; it is no longer to be detected")
        self._set = SeparationGoal(trace, also=self.limits)
        self.model, self.versions = self._set.model, self._set.versions
        likeliest = self._set.filters[0]
        self._level = int(np.argmin(likeliest.cost))
        self._point = likeliest.points[self._level]
        self._scales = [c.slope(c.centre) for c in likeliest.coordinates] + [1.0 / LIMIT] * len(self.limits)
        self._names = [*(c.name for c in likeliest.coordinates), *self.limits]
        self.rows = range(len(likeliest.coordinates), len(self._names))
        known = np.array([0.0 if not math.isfinite(v) else v**-2.0 for v in self.limits.values()])
        self.before = np.diag(known)

    def measured_by(self, sensors: str) -> DetectionGoal:
        """Return the same goal before drives with other sensors; what the drives so far say stays.

        Raises:
            UserError: If the noise of one is not known, or an effect is that of a sensor that is not there.
        """
        return DetectionGoal(self._set.measured_by(sensors).trace, self.wanted)

    def evidence(self, drive: Rehearsed) -> Evidence:
        """Return the Fisher information of a drive on parameters and amplitudes ``(n, n)``; none of a calm one."""
        n, data = len(self._names), drive.data[0]
        run = self.model.run(data, self._point)
        if self._set.is_calm(data) or not math.isfinite(run.log_likelihood):
            return (np.zeros((n, n)),)
        directions = self.model.along(self._names) * self._scales
        tangent = self.model.sensitivities(data, self._point.values, directions, run).reshape(-1, n)
        return (tangent.T @ tangent,)

    def covariance(self, evidence: Evidence | None) -> Floats:
        """Return the covariance of the amplitudes over their share in a limit ``(amplitudes, amplitudes)``."""
        more = 0.0 if evidence is None else 0.5 * marginal(evidence[0], self.rows)
        return open_covariance(self.before + more, range(len(self.limits)))

    def value(self, evidence: Evidence | None) -> float:
        """Return the logarithm of the detection limit; infinite where nothing could be seen."""
        return log_error(self.covariance(evidence), "D", np.ones(len(self.limits)))

    def expectation(self, evidence: Evidence | None) -> ExpectedOutcome:
        """Return the detection limits to be expected."""
        before, after = (np.sqrt(np.diagonal(self.covariance(t))) for t in (None, evidence))
        rows, record, improved = [], {}, []
        for name, was, now in zip(self.limits, before, after, strict=True):
            unit = self.model.model.parameters[self.model.row(name)].unit
            pair = [_size(v, unit) for v in (was, now)]
            rows.append([words(name), *pair])
            record[name] = {"unit": unit, "before": float(was), "after": float(now)}
            improved.append(f"{words(name)} from {pair[1]} on, in place of {pair[0]}")
        still = [f"{words(n)}: no drive shows it" for n, now in zip(self.limits, after, strict=True) if np.isinf(now)]
        return ExpectedOutcome(
            words=f"shown would be {listed(improved)}",
            open=tuple(still),
            record={"limits": record},
            header=["amplitude", "detection limit now", "expected"],
            rows=rows,
        )


def _size(value: float, unit: str) -> str:
    return with_unit(float(value), print_unit(unit)) if math.isfinite(value) else "∞"
