"""Detection limits of a trace to be lowered: what the drives so far could not have shown, and what further ones would.

The detection limit of an effect is three standard errors of its amplitude where there is none of it, with all that the
likeliest model was fitted with open. A trace states it for each hypothesis. To its information comes that of planned
drives, of which half are fitted, from the exact derivatives of the same filter, with all else open in these too: both
together tell at least as much (a Schur complement of a sum is no less than the sum of both).
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import replace

import numpy as np

from harness.common.arrays import Floats
from harness.common.errors import UserError
from harness.common.registry import closest
from harness.diagnosis.criteria import BLOCK
from harness.experiment.contract import Evidence, ExpectedOutcome
from harness.experiment.information import log_error, open_covariance
from harness.experiment.open_trace import OpenTrace
from harness.experiment.rehearsal import Rehearsed, without_outputs
from harness.experiment.separation import SeparationGoal
from harness.identification.measured_file import SHORTEST
from harness.identification.uncertainty import marginal
from harness.models.quantities import listed, print_unit, words
from harness.reporting.style import with_unit

LIMIT = 3.0
"""Standard errors of an amplitude that can be told from none."""


_FAINT = 1e-12
"""Of the information on an amplitude, in SI units, what counts where drives say nothing: one among several that no
sensor shows is no reason to plan nothing for the others."""


class LikeliestModel:
    """The likeliest model of a trace with further amplitudes of the library, and what drives tell of both.

    Args:
        goal: The confusable set, with a filter that has the amplitudes.
        amplitudes: Parameters of the library that the likeliest model has not.

    Attributes:
        own: Number of coordinates of the likeliest model; those of the amplitudes, in units of a third of the SI unit,
            come behind them.
        so_far: What the drives so far say of its own ``(own, own)``.
    """

    def __init__(self, goal: SeparationGoal, amplitudes: Iterable[str]) -> None:
        likeliest, self._goal = goal.filters[0], goal
        level = int(np.argmin(likeliest.cost))
        self._point, self.so_far = likeliest.points[level], likeliest.so_far.information[level]
        self.own = len(likeliest.coordinates)
        self._names = [*(c.name for c in likeliest.coordinates), *amplitudes]
        slopes = [c.slope(c.centre) for c in likeliest.coordinates]
        self._scales = np.array(slopes + [1.0 / LIMIT] * (len(self._names) - self.own))

    def information(self, drive: Rehearsed) -> Floats:
        """Return the Fisher information of a drive ``(n, n)``; none of a calm one."""
        n, model = len(self._names), self._goal.model
        planned = model.drive(without_outputs(drive.profile, model.model), drive.drive.name)
        data = replace(planned, measurements=drive.data[0].measurements)
        if self._goal.is_calm(data):
            return np.zeros((n, n))
        data = self._goal.drives.as_recorded(data, model.model.outputs)
        if not math.isfinite((run := model.run(data, self._point)).log_likelihood):
            return np.zeros((n, n))
        directions = model.along(self._names) * self._scales
        tangent = model.sensitivities(data, self._point.values, directions, run).reshape(-1, n)
        return np.asarray(tangent.T @ tangent)


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
    surrogate = None
    measure = "the detection limit, of several amplitudes their geometric mean in SI units"

    def __init__(self, trace: OpenTrace, wanted: Sequence[str]) -> None:
        self.trace, self.wanted = trace, tuple(wanted)
        for name in wanted:
            if name not in trace.detectable:
                raise UserError(f"for: the trace tried no '{name}'{closest(name, list(trace.detectable))}")
        self.limits = {p: limit for name in wanted for p, limit in trace.detectable[name].items()}
        self._hypotheses = {p: name for name in wanted for p in trace.detectable[name]}
        if there := [p for p in self.limits if p in trace.rivals[0].values]:
            raise UserError(f"for: the likeliest model has '{there[0]}' already; it is no longer to be detected")
        self._set = SeparationGoal(trace, also=self.limits)
        self._set.refuse_lacking(self.limits)
        self.model, self.versions = self._set.model, self._set.versions
        self._likeliest = LikeliestModel(self._set, self.limits)
        known = np.array([0.0 if not math.isfinite(v) else v**-2.0 for v in self.limits.values()])
        self.before = np.diag(known)

    def measured_by(self, sensors: str) -> DetectionGoal:
        """Return the same goal before drives with other sensors; what the drives so far say stays.

        Raises:
            UserError: If the noise of one is not known, or an effect is that of a sensor that is not there.
        """
        return DetectionGoal(self.trace.measured_by(sensors), self.wanted)

    def evidence(self, drive: Rehearsed) -> Evidence:
        """Return the Fisher information of a drive on parameters and amplitudes ``(n, n)``; none of a calm one."""
        return (self._likeliest.information(drive),)

    def preference(self, evidence: Evidence | None) -> float:
        """Return the value."""
        return self.value(evidence)

    def covariance(self, evidence: Evidence | None, least: float = 0.0) -> Floats:
        """Return the covariance of the amplitudes over their share in a limit ``(amplitudes, amplitudes)``.

        A trace tries one hypothesis at a time, so that amplitudes of others are none.

        Args:
            evidence: Of drives.
            least: Information on each amplitude besides.
        """
        covariance, own = np.zeros_like(self.before), self._likeliest.own
        for name in set(self._hypotheses.values()):
            rows = [i for i, p in enumerate(self.limits) if self._hypotheses[p] == name]
            information = self.before[np.ix_(rows, rows)] + least * np.eye(len(rows))
            if evidence is not None:
                kept = [*range(own), *(own + i for i in rows)]
                information = information + 0.5 * marginal(evidence[0][np.ix_(kept, kept)], range(own, len(kept)))
            covariance[np.ix_(rows, rows)] = open_covariance(information, range(len(rows)))
        return covariance

    def value(self, evidence: Evidence | None) -> float:
        """Return the logarithm of the detection limit; as good as infinite where nothing could be seen."""
        return log_error(self.covariance(evidence, _FAINT), "D", np.ones(len(self.limits)))

    def expectation(self, evidence: Evidence | None) -> ExpectedOutcome:
        """Return the detection limits to be expected."""
        before, after = (np.sqrt(np.diagonal(self.covariance(t))) for t in (None, evidence))
        rows, record, improved = [], {}, []
        for name, was, now in zip(self.limits, before, after, strict=True):
            unit = self.model.model.parameters[self.model.row(name)].unit
            pair = [_size(v, unit) for v in (was, now)]
            rows.append([words(name), *pair])
            record[name] = {
                "unit": unit, "before": float(was), "after": float(now), "hypothesis": self._hypotheses[name],
            }  # fmt: skip
            if math.isfinite(now):
                improved.append(f"{words(name)} from {pair[1]} on, in place of {pair[0]}")
        still = [f"{words(n)}: no drive shows it" for n, now in zip(self.limits, after, strict=True) if np.isinf(now)]
        return ExpectedOutcome(
            words=f"shown would be {listed(improved) or 'none of it'}",
            open=tuple(still),
            record={"limits": record},
            header=["amplitude", "detection limit now", "expected"],
            rows=rows,
        )


def _size(value: float, unit: str) -> str:
    return with_unit(float(value), print_unit(unit)) if math.isfinite(value) else "∞"
