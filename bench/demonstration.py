"""``make loop``: trace an effect that nobody declared, and only then look what it was.

Draws an effect of the library and its size, has the blind plant (``tests/blind``) write drives with it in a process of
its own, traces them as ``studies/loops/semitrailer.toml`` says, and opens the sealed file when the report is there.
"""

from __future__ import annotations

import argparse
import random
import secrets
import shutil
import subprocess
import sys
from pathlib import Path

from rich.console import Console

from bench.attribution.run import PLANT, listed
from bench.attribution.score import Scored, score
from harness.common.arguments import Parser

STUDY = Path("studies/loops/semitrailer.toml")
FOLDER = Path("results/loop-semitrailer")
SIZES = ("medium", "large")
"""Small ones are what tolerances leave; many cannot be seen in four minutes of driving."""


def draw(seed: int) -> tuple[str, int]:
    """Return a case of the blind plant with an effect of the library, and its repeat."""
    cases = [case.name for case in listed() if case.kind == "effect"]
    open_to_draw = [name for name in cases if name.startswith("semitrailer") and name.endswith(SIZES)]
    chance = random.Random(seed)
    return chance.choice(open_to_draw), chance.randrange(1000)


def verdict(scored: Scored) -> str:
    """Return in a sentence or two whether the trace was right."""
    true = " and ".join(scored.true).replace("_", " ")
    if set(scored.claimed) & set(scored.true):
        sentence = f"The trace was right: it is {true} ({scored.magnitude})."
    elif scored.right:
        sentence = f"It is {true} ({scored.magnitude}). The trace named it among what these drives cannot tell apart."
    else:
        sentence = f"The trace was wrong: it is {true} ({scored.magnitude})."
    sizes = [f"{name.replace('_', ' ')} off by {error:.1%}" for name, error in scored.errors.items()]
    return " ".join([sentence, *([f"Size: {', '.join(sizes)}."] if sizes else [])])


def main(arguments: list[str] | None = None) -> int:
    """Run the command line; return the exit status: 0 if the trace was right, 1 if not, others without a trace."""
    parser = Parser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seed", type=int, help="draw this effect again; another one each time if absent")
    parser.add_argument("--study", type=Path, default=STUDY, help="loop file of these drives (%(default)s)")
    given = parser.parse_args(arguments)
    seed = secrets.randbelow(10**6) if given.seed is None else given.seed
    console = Console()
    console.print(f"seed {seed}: drawing an effect, sealed in {FOLDER / 'sealed.json'}")
    shutil.rmtree(FOLDER, ignore_errors=True)
    case, repeat = draw(seed)
    plant = [sys.executable, str(PLANT), "--case", case, "--repeat", str(repeat), "--out", str(FOLDER)]
    trace = [sys.executable, "-m", "harness", "trace", str(given.study), "--out", str(FOLDER / "trace")]
    for command, output in ((plant, subprocess.DEVNULL), (trace, None)):
        status = subprocess.run(command, stdout=output, check=False).returncode
        if status:
            return status
    if not (FOLDER / "trace" / "trace.json").exists():
        console.print("The trace wrote no trace.json, so there is nothing to open the seal for.", style="red")
        return 2
    scored = score(FOLDER)
    console.print(f"The seal is opened. {verdict(scored)}", style="bold", soft_wrap=True)
    return 0 if scored.right else 1


if __name__ == "__main__":
    sys.exit(main())
