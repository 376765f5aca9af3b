"""Choose delays and architecture: Lipschitz indices, then trainings over layers and neurons (Ziaukas 2023, 5.2.2).

``python -m reproductions.narx_architecture --out results/narx-architecture`` writes ``architecture.npz``, the
figures as SVG and the report as HTML and PDF. Layers and neurons per layer are powers of two, up to 32 neurons in all:
21 architectures. Each finished one is kept under ``architectures``; an interrupted command goes on from there.
"""

from __future__ import annotations

import argparse
import json
import shlex
import sys
import time
from collections.abc import Mapping, Sequence
from dataclasses import asdict, replace
from pathlib import Path

import joblib
import numpy as np
from rich.console import Console

from harness.cli.options import answers_errors
from harness.common.arguments import Parser
from harness.common.arrays import Floats
from harness.common.errors import UserError
from harness.common.files import write_files
from harness.reporting.document import (
    Block,
    Heading,
    Listing,
    Picture,
    Prose,
    Report,
    Sheet,
    plain,
)
from reproductions import narx_figures
from reproductions.kept import Parts, state_of
from reproductions.narx import data as training_data
from reproductions.narx import lipschitz
from reproductions.narx.data import Data
from reproductions.narx.training import Plan, candidates
from reproductions.stored import LONG, save

MOST = 32
"""Neurons in total."""

SPREAD = (2, 4)
"""Layers and neurons per layer of the architecture whose scatter is shown (Bild 5.4)."""


def architectures(most: int = MOST) -> list[tuple[int, int]]:
    """Return (layers, neurons per layer), both powers of two with at most ``most`` neurons in all."""
    powers = [2**k for k in range(most.bit_length()) if 2**k <= most]
    return [(a, b) for a in powers for b in powers if a * b <= most]


def delays(data: Data, seed: int, count: int = 3) -> list[lipschitz.Indices]:
    """Return the Lipschitz indices of every output on some training drives, chosen at random as in the thesis."""
    picked = np.sort(np.random.default_rng(seed).choice(len(data.train), count, replace=False))
    return [
        lipschitz.indices(data.train[i].inputs, data.train[i].outputs[:, o], names=(data.train[i].name, output))
        for o, output in enumerate(training_data.OUTPUTS)
        for i in picked
    ]


def search(
    data: Data, plan: Plan, counts: Mapping[tuple[int, int], int], seed: int, jobs: int, parts: Parts, code: str
) -> dict[tuple[int, int], Floats]:
    """Train every architecture from several first weights.

    Args:
        data: Drives.
        plan: Delays and budget of each training; the neurons are replaced.
        counts: Trainings by (layers, neurons per layer).
        seed: Of the first weights.
        jobs: Trainings at once; as in ``candidates``.
        parts: Where finished architectures are kept.
        code: Digest of what decides them beside plan, count and seed.

    Returns:
        Per architecture NRMSE on the test drives summed over the outputs, ``(3, trainings)``: one step ahead after
        the open-loop training, free-running after it, free-running after the tuning.
    """
    errors, console = {}, Console(stderr=True)
    for number, ((layers, neurons), count) in enumerate(counts.items(), start=1):
        begin, own = time.perf_counter(), replace(plan, neurons=(neurons,) * layers)

        def train(own: Plan = own, count: int = count) -> dict[str, Floats]:
            trained = candidates(data, own, count, seed, jobs)
            rows = [[c.open_loop.one_step["test"].sum(), c.open_loop.free["test"].sum(), c.score] for c in trained]
            return {"nrmse": np.array(rows).T}

        kept, there = parts.made(f"{layers}x{neurons}", state_of(code, asdict(own), count, seed), train)
        errors[layers, neurons] = kept["nrmse"]
        spent = "kept from before" if there else f"{time.perf_counter() - begin:.0f} s"
        console.print(
            f"{number:2d} of {len(counts)}: {layers} x {neurons}, {count} trainings, {spent}, "
            f"best free-running NRMSE {errors[layers, neurons][2].min():.2e}",
            soft_wrap=True,
        )
    return errors


def best(errors: dict[tuple[int, int], Floats], restarts: int, row: int) -> dict[tuple[int, int], float]:
    """Return the least error of the first ``restarts`` trainings of each architecture."""
    return {
        shape: float(np.min(np.where(np.isfinite(e[row]), e[row], np.inf)[:restarts])) for shape, e in errors.items()
    }


def report(indices, errors, plan: Plan, restarts: int, spread: int, command: str) -> tuple[Report, dict[str, bytes]]:
    """Return the report and its figures by file name."""
    one_step, open_free, tuned = (best(errors, restarts, row) for row in range(3))
    first, second = min(one_step, key=one_step.__getitem__), min(tuned, key=tuned.__getitem__)
    chosen = (plan.input_delays, plan.output_delays)
    counts = sorted({min(n, spread) for n in (10, 20, 50)})
    pictures = {
        "delays.svg": narx_figures.delays(indices, chosen),
        "architectures.svg": narx_figures.architectures({"one step ahead": one_step, "free-running, tuned": tuned}),
    }
    blocks: list[Block] = [
        Prose(
            plain(
                f"In free run, the network of {_words(second)} has the least error: NRMSE {tuned[second]:.2e}, summed "
                f"over the outputs on the test drives. One step ahead, {_words(first)} is the best with "
                f"{one_step[first]:.2e}. In free run, the same trainings reach {open_free[first]:.2g} at best before "
                f"they are tuned on their own outputs, {open_free[first] / one_step[first]:.2g} times that one-step "
                f"error; tuning lowers the free-running error of {sum(tuned[s] < open_free[s] for s in tuned)} of "
                f"{len(tuned)} architectures."
            )
        ),
        Heading("How many past samples does the network need?"),
        Picture(
            pictures["delays.svg"],
            "Lipschitz indices (He and Asada 1993) of regressors that grow by one delay at a time, on "
            f"{len({i.drive for i in indices})} training drives chosen at random. Where the index stops falling, the "
            f"regressor holds what the output depends on; dashed: the delays of the networks below, {chosen[0]} of "
            f"the inputs and {chosen[1]} of the outputs.",
            "Lipschitz indices over the delays",
        ),
    ]
    if SPREAD in errors:
        pictures["restarts.svg"] = narx_figures.restarts(errors[SPREAD][2], counts, _words(SPREAD))
        blocks += [
            Picture(
                pictures["restarts.svg"],
                f"Free-running NRMSE of {_words(SPREAD)}, summed over the outputs on the test drives: the first "
                f"{', '.join(str(n) for n in counts)} trainings. Box: quartiles; whiskers: all trainings.",
                "NRMSE over the number of trainings",
            ),
        ]
    rows = [
        [str(a), str(b), str(a * b), f"{one_step[a, b]:.2e}", f"{open_free[a, b]:.2e}", f"{tuned[a, b]:.2e}"]
        for a, b in errors
    ]
    header = ["layers", "neurons per layer", "neurons", "one step", "free, before tuning", "free, tuned"]
    blocks += [
        Picture(
            pictures["architectures.svg"],
            f"Least NRMSE of {restarts} trainings per architecture, summed over the outputs on the test drives; "
            "cross: the least of all.",
            "NRMSE over layers and neurons",
        ),
        Sheet(header, rows, f"Least NRMSE of {restarts} trainings, summed over the outputs on the test drives.", 0),
        Heading("How it was made"),
        Prose(
            plain(
                "NRMSE: root mean square error over the range of the output in the training drives. "
                f"Levenberg-Marquardt with Bayesian regularisation, at most {plan.epochs} steps, one of {plan.every} "
                f"samples; then backpropagation through time, at most {plan.iterations} steps on whole drives."
            )
        ),
        Listing(command),
    ]
    return Report("Which NARX network estimates articulation angle and tyre force best?", blocks), pictures


def _words(shape: tuple[int, int]) -> str:
    layers, neurons = shape
    return f"{layers} layer{'s' if layers > 1 else ''} of {neurons} neuron{'s' if neurons > 1 else ''}"


def _arguments() -> argparse.ArgumentParser:
    parser = Parser(prog="python -m reproductions.narx_architecture", description="Choose a network.")
    parser.add_argument("--out", type=Path, required=True, help="folder to write to")
    parser.add_argument("--drives", type=Path, default=training_data.DRIVES, help="file of drives")
    parser.add_argument("--trailer-mass", default="24 t", help="of the simulated semitrailer")
    parser.add_argument("--most", type=int, default=MOST, help="neurons in all")
    parser.add_argument("--restarts", type=int, default=10, help="trainings of each architecture")
    parser.add_argument("--spread", type=int, default=50, help="trainings of 2 layers of 4 neurons")
    parser.add_argument("--epochs", type=int, default=60, help="largest number of steps of Levenberg-Marquardt")
    parser.add_argument("--every", type=int, default=10, help="open loop, only every n-th sample is predicted")
    parser.add_argument("--iterations", type=int, default=60, help="steps of the free-running tuning")
    parser.add_argument("--seed", type=int, default=1, help="of noise and first weights")
    parser.add_argument("--jobs", type=int, default=joblib.cpu_count(), help="trainings at once")
    return parser


@answers_errors
def main(arguments: Sequence[str]) -> None:
    """Search as the arguments say and write data, figures and report."""
    chosen = _arguments().parse_args(arguments)
    least = min(chosen.most, chosen.restarts, chosen.spread, chosen.epochs, chosen.every, chosen.jobs)
    if least < 1:
        raise UserError("most, restarts, spread, epochs, every and jobs must be at least 1")
    data = training_data.make(training_data.semitrailer(chosen.trailer_mass), chosen.drives, chosen.seed)
    plan = Plan(epochs=chosen.epochs, iterations=chosen.iterations, every=chosen.every)
    spread = max(chosen.spread, chosen.restarts)
    found_delays = delays(data, chosen.seed)
    counts = {shape: spread if shape == SPREAD else chosen.restarts for shape in architectures(chosen.most)}
    code = state_of(LONG["narx-architecture"].code(), chosen.drives.read_bytes(), chosen.trailer_mass)
    errors = search(data, plan, counts, chosen.seed, chosen.jobs, Parts(chosen.out / "architectures"), code)
    command = f"python -m reproductions.narx_architecture {shlex.join(arguments)}"
    made, pictures = report(found_delays, errors, plan, chosen.restarts, spread, command)
    made.write(chosen.out)
    _write(chosen.out, pictures, errors, found_delays, command)
    print(f"wrote {chosen.out}/report.html")


def _write(folder: Path, files: dict[str, bytes], errors, found_delays: list[lipschitz.Indices], command: str) -> None:
    """Write data and figures."""
    arrays = {f"nrmse_{a}x{b}": e for (a, b), e in errors.items()}
    arrays |= {f"lipschitz_{i.drive}_{i.output}": i.values for i in found_delays}
    described = {"rows_of_nrmse": ["one step", "free-running", "free-running, tuned"]}
    write_files(folder, files)
    save(folder, "narx-architecture", command, {"description": np.array(json.dumps(described)), **arrays})


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
