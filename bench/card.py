"""Print filter steps per second on a graphics card, and how far its scores are from the processor's.

``make bench DEVICE=cuda``; of the joint study (11 states) on one of its drives.
"""

from __future__ import annotations

import argparse
import dataclasses
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from numba import cuda
from rich.console import Console
from rich.table import Table

from bench.engine import ROOT
from harness.config import Study, load_study
from harness.engine.cuda.kernels import CardKernel, name_of_card
from harness.study.design import Unit
from harness.study.evaluate import InBatches, StudyEvaluator
from harness.study.on_card import COMPARED, Begun, CardEvaluator, Loaded

RUNS = (100, 1_000, 10_000, 100_000)


def joint_study(path: Path = ROOT / "studies" / "joint.toml") -> Study:
    """Return the joint study with what a card runs of it."""
    study = load_study(path)
    estimators = tuple(each for each in study.estimators if each.kind in COMPARED)
    return dataclasses.replace(study, estimators=estimators, history=(), over_time=None)


def tiled(array: Any, runs: int, axis: int = -1) -> Any:
    """Return an array with its runs repeated up to so many."""
    return np.take(array, np.arange(runs) % array.shape[axis], axis=axis)


def seconds_of(work: Callable[[], object], rounds: int) -> float:
    """Return how long work on the card takes, the quickest of some rounds."""
    work()
    cuda.synchronize()
    found = []
    for _ in range(rounds):
        begin = time.perf_counter()
        work()
        cuda.synchronize()
        found.append(time.perf_counter() - begin)
    return min(found)


class Measurement:
    """Kernels of a study on one drive, for any number of runs.

    Args:
        study: The study.
        drive: Index of the drive.
        samples: Of the drive that are run.
    """

    def __init__(self, study: Study, drive: int = 0, samples: int | None = None) -> None:
        self.evaluator = StudyEvaluator(study)
        whole = self.evaluator.compiled.drives[drive]
        if samples is not None:
            cut = {name: getattr(whole, name)[:samples] for name in ("plant", "belief")}
            self.evaluator.compiled.drives[drive] = dataclasses.replace(whole, **cut)
        self.samples = len(self.evaluator.compiled.drives[drive].plant)
        self.card, self.drive = CardEvaluator(self.evaluator), drive
        self.parts = [self.card.part(Unit(0, 0, drive, 0, min(1024, study.designs[0].samples)))]
        self._loaded = self.card.loaded(self.parts)
        self._begun = [self.card.believed(e, self.parts) for e in range(len(study.estimators))]

    def loaded(self, runs: int) -> Loaded:
        """Return what the plants of so many runs hold."""
        held = InBatches(*(tiled(each, runs) for each in self._loaded.held))
        return Loaded(tiled(self._loaded.words, runs, 0), held, tiled(self._loaded.parameters, runs))

    def begun(self, e: int, runs: int) -> Begun:
        """Return what an estimator believes in so many runs."""
        return Begun(*(tiled(each, runs) for each in self._begun[e]))

    def rates(self, runs: int, rounds: int) -> dict[str, float]:
        """Return steps per second of the simulation and of each estimator, with their transfers."""
        loaded = self.loaded(runs)
        steps = runs * self.samples
        found = {
            "simulation with noise": steps / seconds_of(lambda: self.card.simulate(self.drive, loaded), rounds),
        }
        simulated = self.card.simulate(self.drive, loaded)
        for e, spec in enumerate(self.evaluator.study.estimators):
            begun = self.begun(e, runs)
            found[spec.name] = steps / seconds_of(lambda e=e, b=begun: self.card.estimate(e, simulated, b), rounds)
        return found

    def differences(self) -> dict[str, dict[str, float]]:
        """Return by estimator the largest relative difference of each score from the processor's."""
        unit = self.parts[0].unit
        wanted = self.evaluator.evaluate(unit)
        ((_, got),) = self.card.evaluate([unit])
        found: dict[str, dict[str, float]] = {}
        for e, spec in enumerate(self.evaluator.study.estimators):
            found[spec.name] = {}
            for name in ("rmse", "nees", "nis", "log_likelihood"):
                a, b = np.asarray(wanted[name])[:, :, e], np.asarray(got[name])[:, :, e]
                with np.errstate(invalid="ignore", divide="ignore"):
                    off = np.abs(b - a) / np.abs(a)
                found[spec.name][name] = float(np.nanmax(off)) if np.isfinite(off).any() else float("nan")
            found[spec.name]["status"] = float(np.mean(wanted["status"][:, :, e] != got["status"][:, :, e]))
        return found


def main(arguments: list[str] | None = None) -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--runs", type=int, nargs="+", default=RUNS)
    parser.add_argument("--samples", type=int, default=2000)
    parser.add_argument("--rounds", type=int, default=3)
    given = parser.parse_args(arguments)
    console = Console(width=140)
    begin = time.perf_counter()
    measured = Measurement(joint_study(), samples=given.samples)
    rates = {runs: measured.rates(runs, given.rounds) for runs in given.runs}
    console.print(f"models, kernels and measurements: {time.perf_counter() - begin:.0f} s")
    table = Table(title=f"million steps per second, {name_of_card()}, float64")
    for name in ("what", *(f"{runs:,} runs" for runs in given.runs), "registers", "bytes of its own"):
        table.add_column(name, justify="left" if name == "what" else "right")
    for name in rates[given.runs[0]]:
        row = [f"{rates[runs][name] / 1e6:,.1f}" for runs in given.runs]
        table.add_row(name, *row, *map(str, resources(kernel_of(measured, name))))
    console.print(table)
    table = Table(title=f"largest relative difference of scores from the processor's, {given.samples} samples")
    for name in ("what", "rmse", "nees", "nis", "log_likelihood", "status"):
        table.add_column(name)
    for name, row in measured.differences().items():
        table.add_row(name, *(f"{value:.1e}" for value in row.values()))
    console.print(table)


def kernel_of(measured: Measurement, name: str) -> CardKernel:
    """Return the kernel of an estimator by its name, or that of the simulation."""
    names = [each.name for each in measured.evaluator.study.estimators]
    return measured.card.estimate_kernels[names.index(name)] if name in names else measured.card.simulate_kernel


def resources(kernel: CardKernel) -> tuple[int, int]:
    """Return registers and bytes of memory of its own that a thread of a kernel takes."""
    (registers,) = set(kernel.function.get_regs_per_thread().values())
    (own,) = set(kernel.function.get_local_mem_per_thread().values())
    return registers, own


if __name__ == "__main__":
    main()
