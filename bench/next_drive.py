"""Planned drives against what they then tell: expected and reached standard errors of five identifications.

``python -m bench.next_drive`` fits a vehicle to a calm drive, plans the next ones, simulates them on the true vehicle
with fresh noise, fits both together, and compares the standard errors with those that the plan expected.
"""

from __future__ import annotations

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


def main() -> None:
    """Measure and print."""
    parser = Parser(description=__doc__)
    parser.add_argument("--cases", type=int, default=len(CASES), metavar="N", help="only the first cases")
    parser.add_argument("--effort", type=int, default=40, metavar="N", help="drives tried of each manoeuvre")
    parser.add_argument("--seed", type=int, default=0, help="of the noise")
    chosen = parser.parse_args()
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
