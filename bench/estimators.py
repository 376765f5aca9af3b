"""Cost of robust corrections where all is as believed, and their gain where the sensors are not: docs/estimators.

    python -m bench.estimators                        # every one; kinds behind it choose some
    python -m bench.estimators --steering measured

The semitrailer with the sensors of stability control, as it is believed to be; eight runs of six drives. Sensors as
believed; two samples in a hundred of each sensor off by 20 standard deviations; all sensors four times as noisy as
believed; and the trailer a third lighter than believed. Medians of the RMSE over that of the first filter in the same
runs: force of axle 21, articulation angle; median of the NEES over its degrees of freedom; time of the processor per
step and run in lanes.
"""

from __future__ import annotations

import argparse
import dataclasses
from typing import Any

import numpy as np

from bench.remedy import table
from harness.common.arguments import Parser
from harness.common.arrays import Floats
from harness.config import StudySpec, build_study
from harness.engine.simd.lanes import LANES
from harness.remedy.run import time_of_step
from harness.runner.contract import Batch
from harness.study.design import Unit, units
from harness.study.evaluate import StudyEvaluator
from harness.study.run_noise import Case

KINDS = (
    "ekf",
    "ukf",
    "sr_ekf",
    "sr_ukf",
    "huber_ekf",
    "student_t_ekf",
    "adaptive_ekf",
    "innovation_ekf",
    "h_infinity",
    "enkf",
    "moving_horizon",
)
SEMITRAILER: dict[str, Any] = {
    "targets": ["lateral_force_axle_21", "articulation_angle"],
    "drives": "robustness-broad",
    "plant": {
        "vehicle": "semitrailer",
        "parameters": "ziaukas_2023_road_wheels",  # steering that is believed to be as fast as on the drives
        "tyre": "magic_formula",
        "sensors": "stability_control",
    },
}
STEERING: dict[str, dict[str, Any]] = {"measured": {}, "unknown": {"unknown_inputs": ["steering_wheel_angle"]}}
CASES = ("as believed", "outliers", "noisier", "lighter")
SHARE, SIZE, NOISIER, LIGHTER = 0.02, 20.0, 4.0, 2 / 3


def study(kinds: list[str], steering: str) -> StudySpec:
    """Return a study of these estimators at the believed vehicle."""
    content = {
        "name": "estimators",
        "seed": 20230109,
        **SEMITRAILER,
        "belief": STEERING[steering],
        "estimator": [{"name": kind, "kind": kind} for kind in kinds],
        "design": [{"name": "ideal", "repeats": LANES}],
    }
    return build_study(content, "estimators")


def disturbed(batch: Batch, case: str, deviation: Floats, unit: Unit) -> Batch:
    """Return a batch with other measurements.

    Args:
        batch: As simulated.
        case: One of ``CASES``.
        deviation: Standard deviation of the measurement noise ``(ny, LANES)``.
        unit: Whose drive seeds the random numbers.
    """
    rng = np.random.default_rng([unit.drive, 7])
    shape = batch.measurements.shape
    if case == "outliers":
        off = (rng.random(shape) < SHARE) * rng.choice([-1.0, 1.0], shape) * SIZE
    elif case == "noisier":
        off = np.sqrt(NOISIER**2 - 1.0) * rng.normal(size=shape)
    else:
        return batch
    return dataclasses.replace(batch, measurements=batch.measurements + off * deviation)


def lighter(evaluator: StudyEvaluator, unit: Unit, cases: list[Case]) -> Batch:
    """Return a batch of a vehicle whose trailer is lighter than believed, with the same noise."""
    plant = evaluator.held(unit, cases, "plant")
    values = plant.values.copy()
    values[evaluator.study.plant.model().parameter_names.index("trailer_mass")] *= LIGHTER
    return evaluator.simulate(unit, cases, plant=dataclasses.replace(plant, values=values))


def measure(kinds: list[str], steering: str) -> None:
    """Print the table."""
    compared = study(kinds, steering)
    evaluator, cases = StudyEvaluator(compared), [Case(0, repeat) for repeat in range(LANES)]
    rmse: dict[tuple[str, str], list[Floats]] = {}
    nees: dict[tuple[str, str], list[float]] = {}
    for unit in units(compared, compared.designs[0]):
        plain, believed = evaluator.simulate(unit, cases), evaluator.held(unit, cases, "belief")
        plant = evaluator.held(unit, cases, "plant")
        deviation = np.sqrt(plant.measurement_noise)
        for case in CASES:
            batch = lighter(evaluator, unit, cases) if case == "lighter" else disturbed(plain, case, deviation, unit)
            for index, kind in enumerate(kinds):
                scores = evaluator.estimate(index, unit, cases, batch, believed)
                lost = scores.diverged_at < len(batch.truth)
                rmse.setdefault((kind, case), []).append(np.where(lost, np.inf, scores.rmse[: len(compared.targets)]))
                nees.setdefault((kind, case), []).append(float(np.mean(scores.nees)))
    seconds = {kind: time_of_step(study([kind], steering)) for kind in kinds}
    degrees = evaluator.compiled.belief.nx
    rows = []
    for kind in kinds:
        cells = []
        for case in CASES:
            mine, first = (np.concatenate(rmse[k, case], axis=1) for k in (kind, kinds[0]))
            cells.append(", ".join(f"{ratio:.3f}" for ratio in np.median(mine / first, axis=1)))
            cells.append(f"{np.median(nees[kind, case]) / degrees:.2f}")
        rows.append([f"`{kind}`", *cells, f"{1e6 * seconds[kind]:.2f}"])
    header = [head for case in CASES for head in (case, "NEES/dof")]
    table(["filter", *header, "µs"], rows)
    for case in CASES:
        own = np.median(np.concatenate(rmse[kinds[0], case], axis=1), axis=1)
        print(f"{kinds[0]}, {case}: force {own[0]:.3g} N, angle {np.rad2deg(own[1]):.3g} deg")


def main() -> None:
    """Measure the estimators named."""
    parser = Parser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("kinds", nargs="*", metavar="KIND", help="estimators; the first is what others are over")
    parser.add_argument("--steering", choices=list(STEERING), default="unknown")
    chosen = parser.parse_args()
    measure(chosen.kinds or list(KINDS), chosen.steering)


if __name__ == "__main__":
    main()
