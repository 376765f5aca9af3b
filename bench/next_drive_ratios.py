"""Log likelihood ratios that planned drives were expected to give, against those of fits of the simulated drives.

``python -m bench.next_drive_ratios`` traces cars with an effect over calm drives, and where the right model is among
several judges a gentle drive of each manoeuvre. The car drives it, to fit and to judge, and the models of the set are
fitted to all drives: of the drives that judge, old and new, the growth of the ratio is compared with its expectation,
one sample ahead and in the mean over the horizons of a trace.
"""

from __future__ import annotations

import math
import tempfile
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr
from rich.console import Console
from rich.table import Table

import harness as h
from bench.next_drive import CALM, EFFECTS, simulated
from harness.common.arguments import Parser
from harness.common.arrays import Floats
from harness.diagnosis.criteria import BLOCK, HORIZONS
from harness.diagnosis.fitting import FittedHypothesis, Fitting, ParameterPoint
from harness.diagnosis.innovations.prediction import Prediction
from harness.experiment.contract import total
from harness.experiment.limits import Limits
from harness.experiment.manoeuvres import SearchRange, chosen
from harness.experiment.open_trace import read_trace
from harness.experiment.rehearsal import Rehearsal
from harness.experiment.separation import SeparationGoal
from harness.models.quantities import words

_CAR: dict[str, Any] = {"parameters": "govindarajan_2018", "sensors": "car_series", "integrator": "rk4"}
_GENTLE = 0.3
"""Each free quantity of a manoeuvre, as a share of its range."""

_DOUBTFUL = 100.0
"""Expected ratio above which a rival is out of the question in any case."""

_REPEATS = 2
_ITERATIONS = 12


@dataclass(frozen=True)
class Ratio:
    """A log likelihood ratio of the right model to a rival.

    Attributes:
        manoeuvre: What was driven.
        rival: Name of the rival.
        expected: Half of ``d^2``.
        one_step: Realised one sample ahead, in the mean of the repeats.
        weighed: Realised in the mean over the horizons.
    """

    manoeuvre: str
    rival: str
    expected: float
    one_step: float
    weighed: float


class Refits:
    """Fits of the models of a set to recordings, and what they say of others.

    Args:
        goal: The set.
    """

    def __init__(self, goal: SeparationGoal) -> None:
        self.goal, self._prediction = goal, Prediction(goal.model)
        spec = goal.model.spec
        self._samples = [max(1.0, t if math.isinf(t) else round(t / spec.step)) for t in HORIZONS]
        self._variances = np.array([spec.measurement_noise[o] for o in spec.model().outputs])

    def _fitting(self, recordings: Sequence[xr.Dataset]) -> Fitting:
        model = self.goal.model
        return Fitting(model, [model.drive(r, r.attrs["name"], "joined") for r in recordings], self._variances)

    def fitted(self, recordings: Sequence[xr.Dataset]) -> list[FittedHypothesis]:
        """Return the fit of each model."""
        fitting = self._fitting(recordings)
        first = fitting.first()
        starts = [
            ParameterPoint(np.repeat(f.values[:, None], len(recordings), axis=1), first.process, first.measurement)
            for f in self.goal.filters
        ]
        each = zip(self.goal.filters, starts, strict=True)
        return [fitting.fit(f.coordinates, start, _ITERATIONS) for f, start in each]

    def densities(self, fits: Sequence[FittedHypothesis], recording: xr.Dataset) -> Floats:
        """Return the log density of a recording by model and horizon ``(models, horizons)``, as far as it judges."""
        fitting, rows = self._fitting([recording]), []
        for fit in fits:
            (point,) = fitting.candidates([replace(fit.point, values=fit.point.values[:, :1])])
            ahead = self._prediction.of(fitting.drives[0], point, self._samples)
            rows.append(ahead.densities[fitting.drives[0].time[1:] > BLOCK].sum(axis=0))
        return np.array(rows)


def ratios(effect: str, values: dict[str, float], scale: float, seed: int, folder: Path) -> Iterator[Ratio]:
    """Yield the ratios of a car with an effect; none where its trace left one name or not the right one.

    Args:
        effect: That the car has.
        values: Of its parameters.
        scale: Of the process noise of the parameter set.
        seed: Of the noise.
        folder: For the trace.
    """
    truth = h.model("car", **_CAR, effects=[effect], values=values, noise={"process_scale": scale})

    def calm(number: int) -> xr.Dataset:
        return simulated(truth, h.drive("random_sequence", seed=number, duration=40.0, **CALM), number)

    train, test = [calm(seed + 1), calm(seed + 2)], calm(seed + 3)
    h.Diagnosis(estimators=()).fit(h.model("car", **_CAR), train, [test], folder)
    trace = read_trace(folder, least=1)
    names = [r.name for r in trace.rivals]
    if len(names) < 2 or words(effect.replace("@", " ")) not in names:
        return
    right, goal = names.index(words(effect.replace("@", " "))), SeparationGoal(trace)
    refits, limits = Refits(goal), Limits(lateral_acceleration=4.0)
    before = refits.densities(refits.fitted(train), test)
    room = SearchRange.of(trace.spec, limits, goal.shortest, goal.lead_in)
    rehearsal = Rehearsal(goal.model, trace.spec, goal.versions, goal.recorded, limits)
    for manoeuvre in chosen(()):
        drive = rehearsal.of(manoeuvre.drive(np.full(manoeuvre.free, _GENTLE), room, manoeuvre.name))
        if isinstance(drive, str):
            continue
        expected = 0.5 * goal.distances(total([(goal.evidence(drive), 2)]))[0][right]
        table, grown = {"kind": drive.drive.kind, **drive.drive.options}, np.zeros((len(names), len(HORIZONS)))
        for turn in range(0, 2 * _REPEATS, 2):
            new = [simulated(truth, h.drive(**{**table, "name": manoeuvre.name}), seed + 50 + turn + k) for k in (0, 1)]
            fits = refits.fitted([*train, new[0]])
            grown += (refits.densities(fits, new[1]) + refits.densities(fits, test) - before) / _REPEATS
        gain = grown[right] - grown
        for j, name in enumerate(names):
            if j != right and np.isfinite(gain[j]).all() and expected[j] > 0.0:
                yield Ratio(manoeuvre.name, name, float(expected[j]), float(gain[j, 0]), float(gain[j].mean()))


def main() -> None:
    """Measure and print."""
    parser = Parser(description=__doc__)
    parser.add_argument("--cases", type=int, default=len(EFFECTS), metavar="N", help="only the first cases")
    parser.add_argument("--scale", type=float, default=1e-3, help="of the process noise of the parameter set")
    parser.add_argument("--seed", type=int, default=0, help="of the noise")
    options = parser.parse_args()
    table, rows = Table(title="log likelihood ratios of the right model"), []
    for column in ("right", "drive", "rival", "expected", "one sample ahead", "all horizons"):
        table.add_column(column, justify="left" if column in ("right", "drive", "rival") else "right")
    for number, (effect, values) in enumerate(EFFECTS[: options.cases]):
        with tempfile.TemporaryDirectory(prefix="next-drive-") as folder:
            for r in ratios(effect, values, options.scale, options.seed + 1000 * number, Path(folder)):
                rows.append(r)
                numbers = [f"{v:.1f}" for v in (r.expected, r.one_step, r.weighed)]
                table.add_row(effect, r.manoeuvre, r.rival, *numbers)
    console = Console()
    console.print(table)
    if not rows:
        return
    for name, kind in (("one sample ahead", "one_step"), ("all horizons", "weighed")):
        of_all, small = (
            np.mean([r.expected for r in some]) / np.mean([getattr(r, kind) for r in some])
            for some in (rows, [r for r in rows if r.expected < _DOUBTFUL])
        )
        console.print(f"{name}: mean expected over mean realised {of_all:.2f}; below {_DOUBTFUL:g} {small:.2f}")


if __name__ == "__main__":
    main()
