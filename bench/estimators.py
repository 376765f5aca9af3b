"""Cost of robust corrections where all is as believed, and their gain where the sensors are not: docs/estimators.

    python -m bench.estimators                        # every one; kinds behind it choose some
    python -m bench.estimators --steering measured

The semitrailer with the sensors of stability control, as it is believed to be; eight runs of six drives. Sensors as
believed; two samples in a hundred of each sensor off by a normal number of 20 standard deviations; all sensors four
times as noisy as believed; and the trailer a third lighter than believed. Medians of the RMSE over that of the first
filter in the same runs: force of axle 21, articulation angle; median of the NEES over its degrees of freedom; time of
the processor per step and run in lanes.
"""

from __future__ import annotations

import argparse
from typing import Any

import numpy as np

from bench.remedy import table
from harness.common.arguments import Parser
from harness.config import StudySpec, build_study
from harness.engine.simd.lanes import LANES
from harness.remedy.run import time_of_step
from harness.study.design import units
from harness.study.evaluate import StudyEvaluator

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
        "effects": ["outliers"],
        "values": {"outlier_size": 20},  # standard deviations
    },
}
STEERING: dict[str, dict[str, Any]] = {"measured": {}, "unknown": {"unknown_inputs": ["steering_wheel_angle"]}}
DESIGNS: list[dict[str, Any]] = [
    {"name": "as believed", "factor": []},
    {"name": "outliers", "factor": [{"parameter": "outlier_share", "levels": ["2 %"]}]},
    {"name": "noisier", "factor": [{"parameter": "measurement_noise_scale", "levels": [16]}]},
    {"name": "lighter", "factor": [{"parameter": "trailer_mass", "shift": ["-33.3 %"]}]},
]


def study(kinds: list[str], steering: str) -> StudySpec:
    """Return a study of these estimators."""
    content = {
        "name": "estimators",
        "seed": 20230109,
        **SEMITRAILER,
        "belief": STEERING[steering],
        "estimator": [{"name": kind, "kind": kind} for kind in kinds],
        "design": [{**design, "name": design["name"].replace(" ", "-"), "repeats": LANES} for design in DESIGNS],
    }
    return build_study(content, "estimators")


def measure(kinds: list[str], steering: str) -> None:
    """Print the table."""
    compared = study(kinds, steering)
    evaluator, targets = StudyEvaluator(compared), len(compared.targets)
    degrees = evaluator.compiled.belief.nx
    cells: list[list[str]] = [[f"`{kind}`"] for kind in kinds]
    for design in compared.designs:
        results = [evaluator.evaluate(unit) for unit in units(compared, design)]
        rmse, nees = (
            np.concatenate([result[score].reshape(-1, *result[score].shape[2:]) for result in results])
            for score in ("rmse", "nees")
        )
        rmse = np.where(np.isnan(rmse), np.inf, rmse)[..., :targets]
        for e, row in enumerate(cells):
            row.append(", ".join(f"{ratio:.3f}" for ratio in np.median(rmse[:, e] / rmse[:, 0], axis=0)))
            row.append(f"{np.median(nees[:, e]) / degrees:.2f}")
        own = np.median(rmse[:, 0], axis=0)
        print(f"{kinds[0]}, {design.name}: force {own[0]:.3g} N, angle {np.rad2deg(own[1]):.3g} deg")
    for kind, row in zip(kinds, cells, strict=True):
        row.append(f"{1e6 * time_of_step(study([kind], steering)):.2f}")
    table(["filter", *(head for design in DESIGNS for head in (design["name"], "NEES/dof")), "µs"], cells)


def main() -> None:
    """Measure the estimators named."""
    parser = Parser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("kinds", nargs="*", metavar="KIND", help="estimators; the first is what others are over")
    parser.add_argument("--steering", choices=list(STEERING), default="unknown")
    chosen = parser.parse_args()
    measure(chosen.kinds or list(KINDS), chosen.steering)


if __name__ == "__main__":
    main()
