"""Coverage of the 95 % intervals of ``harness tune --data``, on recordings whose noise is known.

``python -m bench.tuning --sets 18`` draws so many recordings of every case with fresh noise and fresh true variances,
tunes from the stated ones, and counts how often the interval of a variance that the recordings determine holds the true
one. The command says which those are; it knows nothing of the truth.
"""

from __future__ import annotations

import dataclasses
import json
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr
from rich.console import Console
from rich.progress import track
from scipy import stats

from harness.common.arguments import Parser
from harness.config import DriveSpec, ModelSpec, resolve_single
from harness.models.quantities import words
from harness.recorded.run import RecordedModel
from harness.recorded.tuning import By, tune_noise
from harness.simulation.drives import profile_of
from harness.simulation.simulate import simulate_drive

SPREAD = 1.5
"""True variances lie within so much of the stated ones, in logarithms: a factor of 4.5 to both sides."""


@dataclass(frozen=True)
class Case:
    """One vehicle at one rate.

    Attributes:
        name: In the table.
        table: The model as ``[belief]`` states one.
        options: Of the drive of random steering.
        by: What shares a factor, as ``tune_noise`` takes it.
        missing: Share of samples that every output lacks, each its own.
        share: Of the recordings that are asked for; a fit of the semitrailer takes ten times as long.
    """

    name: str
    table: dict[str, Any]
    options: dict[str, float]
    by: By = "state"
    missing: float = 0.0
    share: float = 1.0


_CAR = {"vehicle": "car", "parameters": "govindarajan_2018", "tyre": "linear", "sensors": "car_navigation"}
_SERIES = {"vehicle": "car", "parameters": "blanco_2021", "tyre": "magic_formula", "sensors": "car_series"}
_TRUCK = {
    "vehicle": "semitrailer",
    "parameters": "ziaukas_2023",
    "tyre": "magic_formula",
    "sensors": "test_vehicle",
}
_CURVES = {"speed": 20.0, "speed_variation": 3.0, "amplitude": 0.4}
CASES = (
    Case("car, navigation, 100 Hz, 20 s", {**_CAR, "step": 0.01}, {**_CURVES, "duration": 20.0}),
    Case("car, navigation, 50 Hz, 40 s", {**_CAR, "step": 0.02}, {**_CURVES, "duration": 40.0}),
    Case("car, navigation, 200 Hz, 20 s", {**_CAR, "step": 0.005}, {**_CURVES, "duration": 20.0}),
    Case(
        "another car, series sensors, 100 Hz, 30 s", {**_SERIES, "step": 0.01},
        {**_CURVES, "amplitude": 0.015, "duration": 30.0},
    ),
    Case(
        "car, navigation, 100 Hz, 20 s, a tenth missing", {**_CAR, "step": 0.01}, {**_CURVES, "duration": 20.0},
        missing=0.1,
    ),
    Case("semitrailer, 100 Hz, 30 s", {**_TRUCK, "step": 0.01}, {**_CURVES, "duration": 30.0}, share=0.25),
    Case(
        "semitrailer, 100 Hz, 30 s, by unit", {**_TRUCK, "step": 0.01}, {**_CURVES, "duration": 30.0},
        by="unit", share=0.5,
    ),
    Case(
        "semitrailer, 200 Hz, 15 s, by unit", {**_TRUCK, "step": 0.005}, {**_CURVES, "duration": 15.0},
        by="unit", share=0.5,
    ),
)  # fmt: skip


@dataclass(frozen=True)
class Found:
    """One variance that a recording determines.

    Attributes:
        case: Its case.
        seed: Of the recording.
        name: What it is the noise of.
        kind: ``process`` or ``measurement``.
        share: Estimate over truth.
        inside: Whether the 95 % interval holds the truth.
        width: Length of the interval in logarithms.
    """

    case: str
    seed: int
    name: str
    kind: str
    share: float
    inside: bool
    width: float


def drawn(spec: ModelSpec, by: By, rng: np.random.Generator) -> ModelSpec:
    """Return the model with true variances drawn about the stated ones."""
    units: dict[str, float] = {}

    def factor(name: str, kind: str) -> float:
        from harness.models.signals import SIGNALS

        group = SIGNALS[name].unit if by == "unit" and kind == "process" else f"{kind} {name}"
        return units.setdefault(group, float(np.exp(rng.uniform(-SPREAD, SPREAD))))

    return dataclasses.replace(
        spec,
        process_noise={n: v * factor(n, "process") for n, v in spec.process_noise.items()},
        measurement_noise={n: v * factor(n, "measurement") for n, v in spec.measurement_noise.items()},
    )


def recording_of(spec: ModelSpec, case: Case, seed: int) -> xr.Dataset:
    """Return a simulated drive with process and measurement noise, and with gaps where the case has them."""
    options = {**case.options, "seed": seed + 1, "lateral_acceleration_limit": 9.0}
    drive = DriveSpec("random", "random_sequence", options, "bench", Path())
    recording = simulate_drive(spec, profile_of(spec, drive), [], seed)
    rng = np.random.default_rng([seed, 7])
    for name in spec.model().outputs if case.missing else ():
        lost = rng.random(recording.sizes["time"]) < case.missing
        recording[name] = recording[name].where(~lost)
    return recording


def tuned(case: Case, model: RecordedModel, seed: int) -> tuple[list[Found], int]:
    """Return the variances that a fresh recording determines, and how many it leaves open."""
    truth = drawn(model.spec, case.by, np.random.default_rng([seed, 3]))
    answer = tune_noise(model, [recording_of(truth, case, seed)], case.by)
    determined = []
    for v in answer.variances:
        if v.held:
            continue
        name = v.names[0]
        true = (truth.process_noise if v.kind == "process" else truth.measurement_noise)[name]
        inside = bool(v.lower[0] <= true <= v.upper[0])
        width = math.log(v.upper[0] / max(v.lower[0], 1e-300))
        determined.append(Found(case.name, seed, words(name), v.kind, float(v.value[0] / true), inside, width))
    return determined, len(answer.variances) - len(determined)


def coverage(
    cases: Sequence[Case | None], sets: int, first: int = 0, each: Callable[[Any], Any] = iter, out: Path | None = None
) -> tuple[list[Found], dict[str, int]]:
    """Return the determined variances of every case, and how many were left open by case.

    Args:
        cases: Vehicles at their rates; the place of each decides its seeds, None leaves one out.
        sets: Recordings of every case, less its share.
        first: First seed.
        each: Goes over the seeds of a case, such as a progress bar.
        out: File with a line for every recording; those that it holds are not drawn again.
    """
    kept = {} if out is None or not out.is_file() else _read(out)
    determined: list[Found] = []
    left_open: dict[str, int] = {}
    for number, case in enumerate(cases):
        if case is None:
            continue
        model: RecordedModel | None = None
        for seed in each(range(first + 1000 * number, first + 1000 * number + max(1, round(case.share * sets)))):
            if (case.name, seed) not in kept:
                model = model or RecordedModel(resolve_single(case.table, "bench", "belief"), inputs="held")
                kept[case.name, seed] = tuned(case, model, seed)
                if out is not None:
                    _append(out, case.name, seed, *kept[case.name, seed])
            some, rest = kept[case.name, seed]
            determined += some
            left_open[case.name] = left_open.get(case.name, 0) + rest
    return determined, left_open


def _read(path: Path) -> dict[tuple[str, int], tuple[list[Found], int]]:
    lines = [json.loads(line) for line in path.read_text(encoding="utf-8").splitlines()]
    return {(line["case"], line["seed"]): ([Found(**f) for f in line["found"]], line["open"]) for line in lines}


def _append(path: Path, case: str, seed: int, determined: Sequence[Found], left_open: int) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    line = {"case": case, "seed": seed, "open": left_open, "found": [dataclasses.asdict(f) for f in determined]}
    with path.open("a", encoding="utf-8") as file:
        file.write(json.dumps(line) + "\n")


def table(determined: Sequence[Found], left_open: dict[str, int]) -> str:
    """Return the counts as a table in Markdown."""
    rows = ["| case | determined | left open | inside the 95 % interval |", "|---|---|---|---|"]
    for name, rest in left_open.items():
        some = [f.inside for f in determined if f.case == name]
        rows.append(f"| {name} | {len(some)} | {rest} | {_share(some)} |")
    for kind in ("process", "measurement"):
        some = [f.inside for f in determined if f.kind == kind]
        rows.append(f"| all {kind} noise | {len(some)} |  | {_share(some)} |")
    everything = [f.inside for f in determined]
    rows.append(f"| **all** | {len(everything)} | {sum(left_open.values())} | **{_share(everything)}** |")
    return "\n".join(rows)


def _share(inside: Sequence[bool]) -> str:
    if not inside:
        return "–"
    interval = stats.binomtest(sum(inside), len(inside)).proportion_ci()
    return f"{100 * sum(inside) / len(inside):.1f} % ({100 * interval.low:.0f} to {100 * interval.high:.0f})"


def main() -> None:
    """Count and print."""
    parser = Parser(description=__doc__)
    parser.add_argument("--sets", type=int, default=18, help="recordings of every case")
    parser.add_argument("--first", type=int, default=0, help="first seed; another one draws everything anew")
    parser.add_argument("--cases", default="", help="only those whose name begins so, such as semitrailer")
    parser.add_argument("--out", type=Path, help="file of every variance; a run that was interrupted goes on from it")
    chosen = parser.parse_args()
    console = Console(stderr=True)
    cases = [case if case.name.startswith(chosen.cases) else None for case in CASES]
    determined, left_open = coverage(
        cases, chosen.sets, chosen.first, lambda seeds: track(seeds, console=console), chosen.out
    )
    print(table(determined, left_open))


if __name__ == "__main__":
    main()
