"""Share of the time of a plant that is an FMU that is spent inside the FMU; two workers against one.

``PYTHONPATH=tests python -m bench.external``. The semitrailer's equations in C, once with one step of Euler per sample
and once with twenty, over one drive. Inside the FMU is what a loop in C takes that calls the same functions of the same
library; the rest is the loop over time, which is measured in this process, and the way to a worker process and back.
Shares are of processor time, since on a busy machine a process waits for a core longer than it runs.
"""

from __future__ import annotations

import ctypes
import functools
import subprocess
import tempfile
import time
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import numpy as np
from rich.console import Console

import harness as h
from bench.timing import quickest
from harness.common.arguments import Parser
from harness.common.arrays import Floats
from harness.external.fmu.instance import LOOPED, Instance, Library
from harness.external.fmu.model import read_model
from harness.external.fmu.plants import load, references
from harness.external.fmu.read import describe
from harness.external.processes import Workers
from harness.simulation.drives import profile_of
from harness.simulation.simulate import input_table
from support.fmus import make, of_model

WITHIN, WORKERS = 0.8, 1.9
"""Least share of the time within the FMU; speed of two workers over that of one."""

DRIVER = """
#include <stddef.h>
typedef int (*reals)(void *, const unsigned *, size_t, double *);
typedef int (*steps)(void *, double, double, int);
int drive(reals set, reals get, steps step, void *m, int samples, double h, const unsigned *in, int nu, double *u,
          const unsigned *out, int ny, double *y) {
    for (int k = 0; k < samples; k++) {
        if (set(m, in, nu, u + k * nu) > 1 || get(m, out, ny, y + k * ny) > 1) return 1;
        if (k + 1 < samples && step(m, k * h, h, 1) > 1) return 1;
    }
    return 0;
}
"""


class Semitrailer:
    """The semitrailer as an FMU, in worker processes and, for the loop in C, in this one.

    Args:
        folder: Where it is compiled.
        substeps: Steps of Euler per sample.
        duration: Of the drive.
    """

    def __init__(self, folder: Path, substeps: int, duration: str) -> None:
        spec = h.model("semitrailer", "ziaukas_2023").spec
        model = spec.model()
        published = [*model.states, "lateral_force_axle_21"]
        self.path = make(folder / f"{substeps}", of_model(model, spec.values, published), substeps=substeps)
        content = {"inputs": {n: n for n in model.inputs}, "outputs": {n: n for n in published}}
        description = describe(self.path, content)
        self.workers = Workers({"kind": "fmu", "file": str(self.path), "description": description.as_dict()})
        self.inputs: Floats = np.ascontiguousarray(
            input_table(profile_of(spec, h.drive("sine", duration=duration, amplitude="30 deg")), model)
        )
        values = np.array([float(spec.values[p.name]) for p in description.parameters])
        self.body = load({"file": str(self.path), "description": description.as_dict()})
        self.job = spec.step, self.inputs, np.zeros((len(self.inputs), 0)), values
        fmu = read_model(self.path)
        self._library = Library(fmu, "co-simulation")
        self._instance = Instance(self._library)
        self._refs = references(fmu, description.inputs), references(fmu, description.outputs)
        source, library = folder / "driver.c", folder / "driver.so"
        source.write_text(DRIVER)
        subprocess.run(["gcc", "-O2", "-shared", "-fPIC", "-o", library, source], check=True)
        self._drive = ctypes.CDLL(str(library)).drive

    def in_worker(self, runs: int = 1) -> None:
        """Simulate in a worker process."""
        for run in self.workers.calls("simulate", [self.job] * runs):
            assert run.reached == len(self.inputs), run

    def in_process(self) -> None:
        """Simulate in this process."""
        assert self.body.simulate(*self.job).reached == len(self.inputs)

    def in_c(self) -> None:
        """Simulate by a loop in C."""
        refs_in, refs_out = self._refs
        self._instance.begin({}, {}, refs_in.tolist(), self.inputs[0])
        outputs = np.empty((len(self.inputs), len(refs_out)))
        f = {name: ctypes.c_void_p(int(a)) for name, a in zip(LOOPED, self._library.addresses, strict=True)}
        status = self._drive(
            f["SetReal"], f["GetReal"], f["DoStep"], ctypes.c_void_p(self._instance.address), len(self.inputs),
            ctypes.c_double(self.job[0]), refs_in.ctypes, len(refs_in), self.inputs.ctypes, refs_out.ctypes,
            len(refs_out), outputs.ctypes,
        )  # fmt: skip
        assert status == 0


def processor_time(worker: int) -> float:
    """Return the processor time of this process and of a worker so far, in s; of Linux only."""
    tasks = Path(f"/proc/{worker}/task").glob("*/schedstat")
    return time.process_time() + 1e-9 * sum(int(task.read_text().split()[0]) for task in tasks)


def speed_of_two(plant: Semitrailer, runs: int, rounds: int) -> float:
    """Return how much faster two workers are than one, by the best of some rounds."""
    with ThreadPoolExecutor(2) as pool:

        def two() -> None:
            list(pool.map(plant.in_worker, (runs, runs)))

        best = quickest({"one": lambda: plant.in_worker(2 * runs), "two": two}, rounds)
    return best["one"] / best["two"]


def main() -> None:
    """Measure and print."""
    parser = Parser(prog="python -m bench.external", description=__doc__)
    parser.add_argument(
        "--rounds", type=int, default=40, help="measurements of each, the quickest counts (%(default)s)"
    )
    parser.add_argument("--duration", default="20 s", help="of the drive (%(default)s)")
    given = parser.parse_args()
    console, begin = Console(), time.perf_counter()
    with tempfile.TemporaryDirectory() as folder:
        for substeps in (1, 20):
            plant = Semitrailer(Path(folder), substeps, given.duration)
            own = quickest({"loop": plant.in_process, "C": plant.in_c}, given.rounds, time.thread_time)
            plant.in_worker()
            worker, *_ = [each._process.pid for each in plant.workers._idle]
            through = quickest({"worker": plant.in_worker}, given.rounds, functools.partial(processor_time, worker))[
                "worker"
            ]
            samples = len(plant.inputs)
            console.print(
                f"{substeps} steps of Euler per sample: {1e6 * own['C'] / samples:.3f} us per sample within the FMU, "
                f"{100 * own['C'] / own['loop']:.0f} % of the time in one process, "
                f"{100 * own['C'] / through:.0f} % through a worker (target {100 * WITHIN:.0f} %)",
                soft_wrap=True,
            )
            if substeps > 1:
                ratio = speed_of_two(plant, max(1, round(0.05 / through)), given.rounds)
                console.print(f"two workers are {ratio:.2f} times as fast as one (target {WORKERS:g})")
            plant.workers.close()
    console.print(f"measured in {time.perf_counter() - begin:.0f} s")


if __name__ == "__main__":
    main()
