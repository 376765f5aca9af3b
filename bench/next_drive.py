"""Planned drives against what they then tell: standard errors of five identifications, and traces that they settle.

``python -m bench.next_drive`` fits a vehicle to a calm drive, plans the next ones, simulates them on the true vehicle
with fresh noise, fits both together, and compares the standard errors with those that the plan expected.
``--traces 3`` traces vehicles with an effect over calm drives, and where models stay confusable again with the planned
drives, and with drives as before that last as long.
"""

from __future__ import annotations

import json
import math
import tempfile
import time
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr
from rich.console import Console
from rich.table import Table

import harness as h
from harness.common.arguments import Parser
from harness.models.quantities import words


@dataclass(frozen=True)
class Case:
    """An identification.

    Attributes:
        name: Of the case.
        model: Arguments of ``harness.model``, the true vehicle.
        free: Parameters to find.
        first: Kind and options of the drive before the plan.
        limits: Of the planned drives.
        values: True values that differ from the parameter set, in which the fit begins.
    """

    name: str
    model: dict[str, Any]
    free: tuple[str, ...]
    first: tuple[str, dict[str, Any]]
    limits: dict[str, float]
    values: dict[str, float] = field(default_factory=dict)


_TRUCK = {"vehicle": "semitrailer", "parameters": "ziaukas_2023", "tyre": "magic_formula"}
_CAR = {"vehicle": "car", "parameters": "govindarajan_2018", "sensors": "car_series"}
CASES = (
    Case("car, stiffnesses", _CAR, ("stiffness_peak_front", "stiffness_peak_rear"),
         ("sine", {"speed": 12.0, "amplitude": 0.3, "frequency": 0.2, "duration": 20.0}),
         {"lateral_acceleration": 4.0}),
    Case("car, inertia", _CAR, ("yaw_inertia", "stiffness_peak_front", "stiffness_peak_rear"),
         ("steady_circle", {"speed": 12.0, "radius": 80.0, "duration": 30.0}),
         {"lateral_acceleration": 4.0, "highest_speed": 25.0}),
    Case("car of Sun", {"vehicle": "car_reference_point", "parameters": "sun_2015", "sensors": "car_reference",
                        "noise": {"process_scale": 0.01}},
         ("stiffness_over_load_front", "stiffness_over_load_rear", "mass_over_inertia"),
         ("ramp", {"speed": 12.0, "amplitude": 0.5, "duration": 20.0}), {"lateral_acceleration": 4.0}),
    Case("trailer, mass", {**_TRUCK, "sensors": "test_vehicle"}, ("trailer_mass", "stiffness_peak_2"),
         ("sine", {"speed": 10.0, "amplitude": 0.5, "frequency": 0.1, "duration": 20.0}),
         {"lateral_acceleration": 2.0}, {"trailer_mass": 18e3}),
    Case("trailer, stability control", {**_TRUCK, "sensors": "stability_control"},
         ("trailer_mass", "stiffness_peak_11", "stiffness_peak_2"),
         ("sine", {"speed": 10.0, "amplitude": 0.5, "frequency": 0.1, "duration": 20.0}),
         {"lateral_acceleration": 2.0}, {"trailer_mass": 18e3}),
)  # fmt: skip
WITHIN = 0.15
"""Largest deviation of a reached standard error from the expected one."""


@dataclass(frozen=True)
class Reached:
    """A parameter before and behind the planned drives.

    Attributes:
        case: Name of the case.
        parameter: Its name.
        before: Standard error of the first fit.
        expected: By the plan.
        reached: Of the joint fit.
        off: Estimate of the joint fit less the true value, over its standard error.
        seconds: Of the design.
    """

    case: str
    parameter: str
    before: float
    expected: float
    reached: float
    off: float
    seconds: float

    @property
    def ratio(self) -> float:
        """Reached over expected standard error."""
        return self.reached / self.expected


def simulated(truth: h.Model, drive: h.Drive, seed: int) -> xr.Dataset:
    """Return a drive of the true vehicle as it would be recorded."""
    return h.simulate(truth, drive, seed=seed).assign_attrs(name=f"{drive.name}-{seed}")


def reached(case: Case, folder: Path, seed: int = 0, effort: int = 20, jobs: int | None = None) -> Iterator[Reached]:
    """Yield each parameter of a case before and behind the planned drives."""
    keywords = {k: v for k, v in case.model.items() if k != "vehicle"}
    believed = h.model(case.model["vehicle"], **keywords, integrator="rk4")
    truth = believed.replace(values=case.values) if case.values else believed
    kind, options = case.first
    first = simulated(truth, h.drive(kind, **options), seed + 1)
    fit = h.identify(believed, [first], case.free, settings={"profiles": False}, jobs=jobs)
    fit.report(folder)
    begun = time.perf_counter()
    plan = h.next_drive(folder, limits=case.limits, wanted=case.free, effort=effort, seed=seed, jobs=jobs)
    seconds = time.perf_counter() - begun
    drives = [
        (h.drive(**{**table, "name": f"{name}-{turn}"}), seed + 10 * number + turn)
        for number, (name, (table, times)) in enumerate(plan.drives.items(), 1)
        for turn in range(times)
    ]
    again = [simulated(truth, drive, own) for drive, own in drives]
    joint = h.identify(believed, [first, *again], case.free, settings={"profiles": False}, jobs=jobs)
    for name, expected in plan.expected["parameters"].items():
        error = expected["standard_error"]
        row = joint.estimates.loc[name]
        off = (row["value"] - float(truth.parameters.loc[name, "value"])) / row["standard_error"]
        before = math.inf if error["before"] is None else error["before"]
        yield Reached(case.name, name, before, error["after"], row["standard_error"], off, seconds)


CALM = {"speed": 15.0, "speed_variation": 3.0, "amplitude": 0.15, "rise_time": 2.0}
"""Random steering of the drives before the plan: 0.6 m/s^2 of lateral acceleration."""

EFFECTS: tuple[tuple[str, dict[str, float]], ...] = (
    ("steering_lag", {"steering_lag": 0.05}),
    ("steering_lag", {"steering_lag": 0.08}),
    ("steering_delay", {"steering_delay": 0.05}),
    ("tyre_relaxation@rear", {"tyre_relaxation_rear": 1.0}),
    ("sensor_delay@yaw_rate", {"sensor_delay_yaw_rate": 0.04}),
    ("steering_lag", {"steering_lag": 0.03}),
)
"""What the vehicle of each trace has: the effect and its parameters."""


@dataclass(frozen=True)
class Settled:
    """A trace before and behind further drives.

    Attributes:
        right: The effect that the vehicle has.
        arm: What was driven: nothing yet, the planned drives, or calm ones that last as long.
        seconds: Of driving.
        share: Probability of the right model within the set.
        expected: That the plan expected; NaN for what was not planned.
        set_size: Models of the confusable set.
    """

    right: str
    arm: str
    seconds: float
    share: float
    expected: float
    set_size: int


def settled(effect: str, values: dict[str, float], folder: Path, seed: int, effort: int) -> Iterator[Settled]:
    """Yield the trace of a vehicle with an effect, and where it left several models those with further drives."""
    nominal = h.model(**_CAR, integrator="rk4")
    noise = {"process_scale": 1e-3}  # with more of it a trace errs in effects that have states
    truth = h.model(**_CAR, effects=[effect], values=values, noise=noise, integrator="rk4")

    def calm(number: int, seconds: float) -> xr.Dataset:
        return simulated(truth, h.drive("random_sequence", seed=number, duration=seconds, **CALM), number)

    def traced(name: str, train: list[xr.Dataset], test: list[xr.Dataset]) -> tuple[float, int]:
        h.Diagnosis(estimators=()).fit(nominal, train, test, folder / name)
        models = json.loads((folder / name / "trace.json").read_text())["confusable"]["models"]
        names = {"+".join(a["name"] for alike in m["added"] for a in alike[:1]): m["share"] for m in models}
        return float(names.get(effect, 0.0)), len(models)

    train, test = [calm(seed + 1, 40.0), calm(seed + 2, 40.0)], [calm(seed + 3, 40.0)]
    share, count = traced("before", train, test)
    yield Settled(effect, "before", 120.0, share, math.nan, count)
    if count < 2:
        return
    plan = h.next_drive(folder / "before", limits={"lateral_acceleration": 4.0}, effort=effort, seed=seed)
    further = [
        simulated(truth, h.drive(**{**table, "name": f"{name}-{turn}"}), seed + 100 + 10 * number + turn)
        for number, (name, (table, times)) in enumerate(plan.drives.items())
        for turn in range(times)
    ]
    seconds = sum(float(d["time"][-1]) for d in further)
    wanted = {m: r["expected"] for m, r in plan.expected["models"].items()}
    expected = wanted.get(words(effect.replace("@", " ")), math.nan)
    arms = {
        "designed": further,
        "as before": [calm(seed + 50 + i, float(d["time"][-1])) for i, d in enumerate(further)],
    }
    for arm, drives in arms.items():
        share, count = traced(arm, [*train, *drives[::2]], [*test, *drives[1::2]])
        yield Settled(effect, arm, seconds, share, expected if arm == "designed" else math.nan, count)


def _traces(count: int, seed: int, effort: int) -> None:
    table = Table(title="probability of the right model within the confusable set")
    for column in ("right", "drives", "s", "models", "expected", "reached"):
        table.add_column(column, justify="left" if column in ("right", "drives") else "right")
    for number, (effect, values) in enumerate(EFFECTS[:count]):
        with tempfile.TemporaryDirectory(prefix="next-drive-") as folder:
            for s in settled(effect, values, Path(folder), seed + 1000 * number, effort):
                row = [s.right, s.arm, f"{s.seconds:.0f}", f"{s.set_size}", f"{s.expected:.3f}", f"{s.share:.3f}"]
                table.add_row(*row)
                Console(stderr=True).print(" ".join(row))
    Console().print(table)


def main() -> None:
    """Measure and print."""
    parser = Parser(description=__doc__)
    parser.add_argument("--cases", type=int, default=len(CASES), metavar="N", help="only the first cases")
    parser.add_argument("--effort", type=int, default=40, metavar="N", help="drives tried of each manoeuvre")
    parser.add_argument("--seed", type=int, default=0, help="of the noise")
    parser.add_argument("--traces", type=int, metavar="N", help="the first traces, in place of identifications")
    chosen = parser.parse_args()
    if chosen.traces:
        _traces(chosen.traces, chosen.seed, chosen.effort)
        return
    table = Table(title="standard errors before, expected and reached")
    for column in ("case", "parameter", "before", "expected", "reached", "ratio", "off", "design, s"):
        table.add_column(column, justify="left" if column in ("case", "parameter") else "right")
    rows = []
    with tempfile.TemporaryDirectory(prefix="next-drive-") as folder:
        for number, case in enumerate(CASES[: chosen.cases]):
            rows += list(reached(case, Path(folder) / str(number), chosen.seed, chosen.effort))
    for r in rows:
        numbers = [f"{v:.3g}" for v in (r.before, r.expected, r.reached, r.ratio, r.off, r.seconds)]
        table.add_row(r.case, r.parameter, *numbers)
    console = Console()
    console.print(table)
    inside = float(np.mean([abs(math.log(r.ratio)) <= math.log(1.0 + WITHIN) for r in rows]))
    console.print(
        f"{100 * inside:.0f} % of {len(rows)} standard errors within {100 * WITHIN:.0f} % of what was expected"
    )


if __name__ == "__main__":
    main()
