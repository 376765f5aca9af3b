"""Print filter steps per second on a graphics card, and how far its scores are from the processor's.

``make bench DEVICE=cuda``; of the joint study (11 states) on one of its drives. ``--jax`` measures the same
written for JAX on the same card (``bench.card_jax``). Beside the differences stands how far the processor's scores move
by rounding alone, which decides where a filter diverges.
"""

from __future__ import annotations

import dataclasses
import importlib.util
import time
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numba import cuda
from numpy.typing import NDArray
from rich.console import Console
from rich.table import Table

from bench.engine import ROOT, tiled
from harness.common.arguments import Parser
from harness.config import StudySpec, load_study
from harness.cuda.kernels import CardKernel, name_of_card
from harness.cuda.on_card import Begun, CardEvaluator, Loaded
from harness.engine.kernel_names import Belief, State
from harness.estimation.contract import load_estimator
from harness.study.design import Unit
from harness.study.evaluate import StudyEvaluator

RUNS = (100, 1_000, 10_000, 100_000)

Scores = Mapping[str, NDArray[Any]]


def joint_study(path: Path = ROOT / "studies" / "joint.toml", kinds: Sequence[str] = ()) -> StudySpec:
    """Return the joint study with what a card runs of it, or with estimators of some kinds as they are by default."""
    study = load_study(path)
    estimators = tuple(each for each in study.estimators if "cuda" in load_estimator(each.kind).DEVICES)
    if kinds:
        plain = next(each for each in estimators if each.kind == "ekf")
        chosen = [(kind, load_estimator(kind).Settings().model_dump()) for kind in kinds]
        estimators = tuple(dataclasses.replace(plain, name=kind, kind=kind, settings=s) for kind, s in chosen)
    return dataclasses.replace(study, estimators=estimators, history=(), over_time=None)


def seconds_of(work: Callable[[], object], rounds: int) -> float:
    """Return how long work on the card takes, the quickest of some rounds."""
    work()
    cuda.synchronize()
    result = []
    for _ in range(rounds):
        begin = time.perf_counter()
        work()
        cuda.synchronize()
        result.append(time.perf_counter() - begin)
    return min(result)


class Measurement:
    """Kernels of a study on one drive, for any number of runs.

    Args:
        study: The study.
        drive: Index of the drive.
        samples: Of the drive that are run.
    """

    def __init__(self, study: StudySpec, drive: int = 0, samples: int | None = None) -> None:
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
        return Loaded(tiled(self._loaded.words, runs, 0), *(tiled(each, runs) for each in self._loaded[1:]))

    def begun(self, e: int, runs: int) -> Begun:
        """Return what an estimator believes in so many runs."""
        belief, first = self._begun[e]
        told = Belief(*(tiled(each, runs) for each in belief[:3]), belief.tuning)
        return Begun(told, State(*(tiled(each, runs) for each in first)))

    def rates(self, runs: int, rounds: int) -> dict[str, float]:
        """Return steps per second of the simulation and of each estimator, with their transfers."""
        loaded = self.loaded(runs)
        steps = runs * self.samples
        result = {
            "simulation with noise": steps / seconds_of(lambda: self.card.simulate(self.drive, loaded), rounds),
        }
        simulated = self.card.simulate(self.drive, loaded)
        for e, spec in enumerate(self.evaluator.study.estimators):
            begun = self.begun(e, runs)
            result[spec.name] = steps / seconds_of(lambda e=e, b=begun: self.card.estimate(e, simulated, b), rounds)
        return result

    def differences(self) -> dict[str, dict[str, float]]:
        """Return by estimator how far scores are from the processor's; see ``apart``."""
        unit = self.parts[0].unit
        ((_, got),) = self.card.evaluate([unit])
        return apart(self.evaluator.study, self.evaluator.evaluate(unit), got)


def apart(study: StudySpec, wanted: Scores, got: Scores) -> dict[str, dict[str, float]]:
    """Return by estimator the largest relative difference of each score, and how many runs have an RMSE off by 1e-6."""
    result: dict[str, dict[str, float]] = {}
    for e, spec in enumerate(study.estimators):
        result[spec.name] = {}
        for name in ("rmse", "nees", "nis", "log_likelihood"):
            a, b = np.asarray(wanted[name])[:, :, e], np.asarray(got[name])[:, :, e]
            with np.errstate(invalid="ignore", divide="ignore"):
                off = np.abs(b - a) / np.abs(a)
            result[spec.name][name] = float(np.nanmax(off)) if np.isfinite(off).any() else float("nan")
            if name == "rmse":
                result[spec.name]["runs over 1e-6"] = float(np.count_nonzero(np.any(off > 1e-6, axis=-1)))
        result[spec.name]["status"] = float(np.mean(wanted["status"][:, :, e] != got["status"][:, :, e]))
    return result


def rounding(evaluator: StudyEvaluator, unit: Unit) -> dict[str, dict[str, float]]:
    """Return how far the processor's scores move when the inputs that estimators know are one rounding error larger."""
    wanted, drive = evaluator.evaluate(unit), evaluator.compiled.drives[unit.drive]
    evaluator.compiled.drives[unit.drive] = dataclasses.replace(drive, belief=np.nextafter(drive.belief, np.inf))
    moved = evaluator.evaluate(unit)
    evaluator.compiled.drives[unit.drive] = drive
    return apart(evaluator.study, wanted, moved)


def main(arguments: list[str] | None = None) -> None:
    """Measure and print."""
    parser = Parser(description=__doc__)
    parser.add_argument("--runs", type=int, nargs="+", default=RUNS)
    parser.add_argument("--samples", type=int, default=2000)
    parser.add_argument("--rounds", type=int, default=3)
    parser.add_argument("--kinds", nargs="+", default=(), help="estimators in place of the study's")
    parser.add_argument("--jax", type=int, nargs="*", metavar="FORM", help="JAX as well; which of the forms it knows")
    given = parser.parse_args(arguments)
    if given.jax is not None and importlib.util.find_spec("jax") is None:
        parser.error("--jax takes JAX: pip install 'jax[cuda13]'")
    console = Console(width=140)
    begin = time.perf_counter()
    measured = Measurement(joint_study(kinds=given.kinds), samples=given.samples)
    rates = {runs: measured.rates(runs, given.rounds) for runs in given.runs}
    console.print(f"models, kernels and measurements: {time.perf_counter() - begin:.0f} s")
    table = Table(title=f"million steps per second, {name_of_card()}, float64")
    for name in ("what", *(f"{runs:,} runs" for runs in given.runs), "registers", "bytes of its own"):
        table.add_column(name, justify="left" if name == "what" else "right")
    for name in rates[given.runs[0]]:
        row = [f"{rates[runs][name] / 1e6:,.1f}" for runs in given.runs]
        table.add_row(name, *row, *map(str, resources(kernel_of(measured, name))))
    console.print(table)
    if given.jax is not None:
        console.print(beside_jax(measured, rates, given.rounds, given.jax))
    unit = measured.parts[0].unit
    runs = f"{unit.stop - unit.first:,} runs of {given.samples} samples"
    title = f"largest relative difference of scores from the processor's, {runs}"
    console.print(table_of(title, measured.differences()))
    title = "the same of the processor's from its own with inputs that are one rounding error larger"
    console.print(table_of(title, rounding(measured.evaluator, unit)))


def beside_jax(
    measured: Measurement, rates: Mapping[int, Mapping[str, float]], rounds: int, forms: Sequence[int]
) -> Table:
    """Return the same written for JAX as a table: these forms, or all."""
    from bench import card_jax

    evaluator = measured.evaluator
    names = {each.kind: each.name for each in evaluator.study.estimators if each.kind in ("ekf", "ukf")}
    names |= {card_jax.SIMULATION: "simulation with noise"}
    ours = {kind: [of_runs[name] for of_runs in rates.values()] for kind, name in names.items()}
    problem = card_jax.Problem(evaluator, measured.drive, measured.samples)
    chosen = [form for i, form in enumerate(card_jax.FORMS) if form.kind in names and (not forms or i in forms)]
    return card_jax.table_of(problem, list(rates), rounds, ours, chosen)


def table_of(title: str, rows: dict[str, dict[str, float]]) -> Table:
    """Return differences as a table."""
    table = Table(title=title)
    for name in ("what", *next(iter(rows.values()))):
        table.add_column(name, justify="left" if name == "what" else "right")
    for name, row in rows.items():
        table.add_row(name, *(f"{value:.0f}" if "runs" in key else f"{value:.1e}" for key, value in row.items()))
    return table


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
