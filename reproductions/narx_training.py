"""Train the network of the main job from simulated drives of the semitrailer (Ziaukas 2023, 5.2.2).

``python -m reproductions.narx_training --out harness/estimation/networks/semitrailer_24t.npz`` makes the
network that the project comes with.
"""

from __future__ import annotations

import argparse
import logging
import shlex
import sys
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import joblib
import numpy as np

from harness.cli.options import answers_errors
from harness.common.arguments import Parser
from harness.common.errors import UserError
from harness.estimation.narx_network import Network, save
from reproductions.narx import data as training_data
from reproductions.narx.data import Data
from reproductions.narx.training import Candidate, Errors, Plan, Trainer, candidates


def described(errors: Errors) -> dict[str, Any]:
    """Return errors as plain numbers for a JSON text, rounded to four digits."""
    return {
        kind: {part: [float(f"{v:.3e}") for v in values] for part, values in getattr(errors, kind).items()}
        for kind in ("one_step", "free")
    }


def table(trained: Sequence[Candidate], outputs: Sequence[str]) -> str:
    """Return the candidates as text, one line each, NRMSE of the test drives summed over the outputs."""
    lines = [
        f"NRMSE on the test drives, summed over {', '.join(outputs)}",
        "  no  epochs  gamma  one-step  free-running  tuned: one-step  free-running   LM s  BPTT s  LM ended",
    ]
    for i, c in enumerate(trained):
        a, b = c.open_loop, c.tuned
        lines.append(
            f"{i:4d}  {c.epochs:6d}  {c.gamma:5.0f}  {a.one_step['test'].sum():8.1e}  {a.free['test'].sum():12.1e}"
            f"  {b.one_step['test'].sum():15.1e}  {b.free['test'].sum():12.2e}  {c.seconds[0]:5.0f}"
            f"  {c.seconds[1]:6.0f}  {c.stopped}"
        )
    return "\n".join(lines)


def _arguments() -> argparse.ArgumentParser:
    parser = Parser(prog="python -m reproductions.narx_training", description="Train a NARX network.")
    parser.add_argument("--out", type=Path, required=True, help="network file to write (.npz)")
    parser.add_argument("--drives", type=Path, default=training_data.DRIVES, help="file of drives")
    parser.add_argument("--parameters", default="ziaukas_2023", help="set of the semitrailer, or a TOML file")
    parser.add_argument("--trailer-mass", default="24 t", help="of the simulated semitrailer")
    parser.add_argument("--neurons", type=int, nargs="+", default=[32], help="neurons of each hidden layer")
    parser.add_argument("--delays", type=int, nargs=2, default=[2, 2], help="past samples of inputs and outputs")
    parser.add_argument("--epochs", type=int, default=500, help="largest number of steps of Levenberg-Marquardt")
    parser.add_argument("--iterations", type=int, default=600, help="steps of the free-running tuning")
    parser.add_argument("--polish", type=int, default=2000, help="further such steps for the chosen candidate")
    parser.add_argument("--restarts", type=int, default=10, help="first weights to train from")
    parser.add_argument("--seed", type=int, default=1, help="of noise and first weights")
    parser.add_argument("--jobs", type=int, default=joblib.cpu_count(), help="candidates trained at once")
    return parser


@answers_errors
def main(arguments: Sequence[str]) -> None:
    """Train as the arguments say, print the candidates and write the best."""
    chosen = _arguments().parse_args(arguments)
    logging.basicConfig(level=logging.INFO, format="%(message)s")
    if chosen.out.suffix != ".npz":
        raise UserError(f"--out {chosen.out}: a network file ends in .npz")
    if min(*chosen.neurons, *chosen.delays, chosen.restarts, chosen.jobs) < 1:
        raise UserError("neurons, delays, restarts and jobs must be at least 1")
    data = training_data.make(
        training_data.semitrailer(chosen.trailer_mass, chosen.parameters), chosen.drives, chosen.seed
    )
    plan = Plan(tuple(chosen.neurons), chosen.delays[0], chosen.delays[1], chosen.epochs, 1e-2, chosen.iterations)
    trained = candidates(data, plan, chosen.restarts, chosen.seed, chosen.jobs)
    print(table(trained, training_data.OUTPUTS))
    best = min(range(len(trained)), key=lambda i: trained[i].score)
    if not np.isfinite(trained[best].score):
        raise UserError("every candidate diverges in free run; raise --iterations or --restarts")
    network, errors = _polished(data, plan, trained[best], chosen)
    made = {
        "command": f"python -m reproductions.narx_training {shlex.join(arguments)}",
        "drives": chosen.drives.as_posix(),
        "parameters": chosen.parameters,
        "trailer_mass": chosen.trailer_mass,
        "seed": chosen.seed,
        "restarts": chosen.restarts,
        "chosen": best,
        "nrmse_open_loop": described(trained[best].open_loop),
        "nrmse": described(errors),
    }
    save(replace(network, made=made), chosen.out)
    print(f"candidate {best} chosen; free-running NRMSE {made['nrmse']['free']}; wrote {chosen.out}")


def _polished(data: Data, plan: Plan, best: Candidate, chosen: argparse.Namespace) -> tuple[Network, Errors]:
    """Tune the chosen candidate further and return it with its errors."""
    trainer = Trainer(data, replace(plan, iterations=chosen.polish), threads=chosen.jobs)
    p = trainer.polish(best.parameters)
    return trainer.blank.with_parameters(p), trainer.errors(p)


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
