"""Time per step of estimators of somebody else beside their own code: ``python -m bench.external_estimators``.

All in one process, in turns: the study's filter with its processes, over 64 runs; the same code called directly, the
library by a loop in C and the class by a loop in Python; and our EKF. Overhead is the first less the second.
"""

from __future__ import annotations

import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from importlib import resources
from pathlib import Path
from typing import Any

import numpy as np

from harness.common.arguments import Parser
from harness.config import build_study
from harness.engine.simd.lanes import LANES
from harness.external.estimators.library import HEADER
from harness.study.design import Unit
from harness.study.evaluate import StudyEvaluator
from harness.study.run_noise import Case

RUNS = 8 * LANES

NAMES: dict[str, Any] = {
    "inputs": ["steering_wheel_angle", "speed"],
    "measurements": ["yaw_rate"],
    "estimates": ["lateral_velocity", "yaw_rate"],
}
VALUES = ["mass", "yaw_inertia", "cog_to_front_axle", "cog_to_rear_axle", "steering_ratio"]

CONTENT = {
    "name": "external-estimators",
    "targets": ["lateral_velocity", "yaw_rate"],
    "plant": {"vehicle": "car", "parameters": "govindarajan_2018", "tyre": "linear", "sensors": "car_series"},
    "drive": [{"name": "sine", "kind": "sine", "duration": "20 s", "speed": "15 m/s", "amplitude": "20 deg"}],
    "design": [{"name": "nominal", "repeats": RUNS}],
    "estimator": [
        {"name": "EKF", "kind": "ekf"},
        {"name": "C", "kind": "external", "library": "libobserver.so", "values": VALUES, **NAMES},
        {"name": "Python", "kind": "external", "python": "observer:Observer"},
        {"name": "Python, empty", "kind": "external", "python": "empty:Empty", **NAMES},
    ],
}

EMPTY = "class Empty:\n    def step(self, inputs, measurements, dt):\n        return 0.0, 0.0\n"

DIRECT = r"""
#include <time.h>
double direct(const double *values, const double *inputs, const double *measurements, int samples, int runs,
              double dt) {
    static double state[1024], estimates[2], variances[2], nis;
    struct timespec a, b;
    clock_gettime(CLOCK_MONOTONIC, &a);
    for (int r = 0; r < runs; r++) {
        harness_reset(state, values, dt);
        for (int k = 0; k < samples; k++)
            harness_step(state, inputs + 2 * k, measurements + k, k ? dt : 0.0, estimates, variances, &nis);
    }
    clock_gettime(CLOCK_MONOTONIC, &b);
    return (b.tv_sec - a.tv_sec) + 1e-9 * (b.tv_nsec - a.tv_nsec);
}
"""


def template(name: str) -> str:
    """Return a template of ``harness new``."""
    text = resources.files("harness.cli").joinpath("templates", f"{name}.txt").read_text(encoding="utf-8")
    return text.replace("@NAME@", "observer")


def written(folder: Path) -> None:
    """Write and compile the observers."""
    (folder / "observer.py").write_text(template("observer.py"))
    (folder / "empty.py").write_text(EMPTY)
    (folder / HEADER.name).write_text(HEADER.read_text())
    (folder / "observer.c").write_text(template("observer.c") + DIRECT)
    command = ["cc", "-O2", "-shared", "-fPIC", "observer.c", "-o", "libobserver.so", "-lm"]
    subprocess.run(command, cwd=folder, check=True)


def direct_in_c(folder: Path, values: list[float], known: Any, measured: Any, step: float) -> float:
    """Return the seconds that the library takes for all runs, called by a loop in C."""
    import ctypes

    function = ctypes.CDLL(str(folder / "libobserver.so")).direct
    pointer = np.ctypeslib.ndpointer(dtype=float, flags="C")
    function.argtypes = [pointer, pointer, pointer, ctypes.c_int, ctypes.c_int, ctypes.c_double]
    function.restype = ctypes.c_double
    return float(function(np.array(values), known, measured, len(known), RUNS, step))


def direct_in_python(observer: Any, values: dict[str, float], known: Any, measured: Any, step: float) -> float:
    """Return the seconds that a class takes for all runs, called by a loop over rows that keeps nothing."""
    begin = time.perf_counter()
    for _ in range(RUNS):
        if hasattr(observer, "reset"):
            observer.reset(values, step)
        observer.step(known[0], measured[0], 0.0)
        for u, y in zip(known[1:], measured[1:], strict=True):
            observer.step(u, y, step)
    return time.perf_counter() - begin


def main() -> None:
    """Measure and print."""
    parser = Parser(prog="python -m bench.external_estimators", description=__doc__)
    parser.add_argument("--rounds", type=int, default=7, help="measurements of each, the median counts (%(default)s)")
    rounds = parser.parse_args().rounds
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        written(folder)
        sys.path.insert(0, name)
        from empty import Empty  # type: ignore[import-not-found]
        from observer import Observer  # type: ignore[import-not-found]

        study = build_study(CONTENT, folder / "study.toml")
        evaluator, unit = StudyEvaluator(study), Unit(0, 0, 0, 0, 1, 0, RUNS)
        cases = np.array([Case(0, r) for r in range(RUNS)])
        batch, believed = evaluator.simulate(unit, cases), evaluator.held(unit, cases, "belief")
        step, held = study.plant.step, study.belief.values
        known = np.ascontiguousarray(evaluator.inputs(0, 0, batch, believed).at[..., 0])
        measured = np.ascontiguousarray(batch.measurements[0, :, :1, 0])
        measured[0] = np.nan
        steps = RUNS * len(measured)

        def through(index: int) -> Callable[[], float]:
            inputs, own = (
                evaluator.inputs(index, 0, batch, believed),
                evaluator.believed_by(index, unit, cases, believed),
            )

            def run() -> float:
                begin = time.perf_counter()
                evaluator.sums(index, inputs, batch, own, False)
                return time.perf_counter() - begin

            return run

        timed: dict[str, Callable[[], float]] = {spec.name: through(i) for i, spec in enumerate(study.estimators)}
        timed["C, direct"] = lambda: direct_in_c(folder, [held[n] for n in VALUES], known, measured, step)
        timed["Python, direct"] = lambda: direct_in_python(Observer(), held, known, measured, step)
        timed["Python, empty, direct"] = lambda: direct_in_python(Empty(), held, known, measured, step)
        taken = {key: [run() for _ in range(2)] and [] for key, run in timed.items()}
        for _ in range(rounds):
            for key, run in timed.items():
                taken[key].append(run())
        each = {key: 1e6 * float(np.median(seconds)) / steps for key, seconds in taken.items()}
        print(f"{RUNS} runs of {len(measured)} samples, median of {rounds} rounds in turn, us per step and run")
        for key, value in each.items():
            print(f"{key:24}{value:9.3f}")
        for key in ("C", "Python", "Python, empty"):
            print(f"overhead of {key:12}{each[key] - each[f'{key}, direct']:9.3f}")


if __name__ == "__main__":
    main()
