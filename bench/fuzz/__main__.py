"""``python -m bench.fuzz --inputs 100000 --out results/fuzz``: read broken files and say what was found.

Every kind of file has its share of the inputs. The first input of each finding is kept beside its
description. Exit status 1 if there is any.
"""

from __future__ import annotations

import functools
import resource
import sys
import time
from collections.abc import Sequence
from pathlib import Path

from bench.fuzz.run import fuzz
from harness.common.arguments import Parser


def main(arguments: Sequence[str]) -> int:
    """Read broken files and say what was found."""
    parser = Parser(prog="python -m bench.fuzz", description="Broken input by the hundred thousand.")
    parser.add_argument("--inputs", type=int, default=100_000, help="over all kinds")
    parser.add_argument("--seed", type=int, default=0, help="other inputs for each")
    parser.add_argument("--kind", action="append", help="only this kind; repeatable")
    parser.add_argument("--out", type=Path, default=Path("results/fuzz"), help="folder of the findings")
    chosen = parser.parse_args(arguments)
    started = time.perf_counter()
    watch = fuzz(chosen.out, chosen.inputs, chosen.seed, chosen.kind, functools.partial(print, flush=True))
    memory = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 2**20
    print(
        f"{watch.inputs} inputs in {time.perf_counter() - started:.0f} s: {watch.results} read, "
        f"{watch.refused} refused, {len(watch.findings)} findings; at most {memory:.2f} GiB"
    )
    for name, sentence in watch.findings.items():
        print(f"  {name.partition(':')[0]}: {sentence}")
    return 1 if watch.findings else 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
