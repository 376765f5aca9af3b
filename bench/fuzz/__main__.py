"""``python -m bench.fuzz --inputs 100000 --out results/fuzz``: read broken files and say what was found.

Every kind of file has its share of the inputs. The first input of each finding is kept beside its
description. Exit status 1 if there is any.
"""

from __future__ import annotations

import functools
import math
import os
import resource
import sys
import time
from collections.abc import Callable, Sequence
from pathlib import Path

from hypothesis import HealthCheck, Phase, given, settings
from hypothesis import seed as seeded

from bench.fuzz.kinds import Kind, kinds
from bench.fuzz.watch import Watch
from harness.common.arguments import Parser

_AT_ONCE = 2000
"""Inputs of one round over all kinds; hypothesis varies what it has drawn before, so each begins anew."""


def fuzz(
    folder: Path,
    inputs: int,
    seed: int = 0,
    only: Sequence[str] | None = None,
    say: Callable[[str], None] = lambda _: None,
) -> Watch:
    """Read broken files.

    Args:
        folder: Of the files and findings, made if absent.
        inputs: How many, over all kinds.
        seed: Of what is drawn.
        only: Kinds; all by default.
        say: Is told after each round.

    Returns:
        What was found.
    """
    folder = folder.resolve()
    folder.mkdir(parents=True, exist_ok=True)
    chosen = {name: kind for name, kind in kinds(folder).items() if not only or name in only}
    watch, whole = Watch(folder), sum(kind.share for kind in chosen.values())
    here = Path.cwd()
    os.chdir(folder)  # relative paths in inputs stay inside
    try:
        for kind in chosen.values():
            (folder / kind.name).write_bytes(kind.good)
            kind.prepare(folder / kind.name)
            kind.read(folder / kind.name)
        for part in range(math.ceil(inputs / _AT_ONCE)):
            now = min(_AT_ONCE, inputs - part * _AT_ONCE)
            for name, kind in chosen.items():
                _search(name, kind, watch, math.ceil(now * kind.share / whole), 1000 * seed + part)
            say(f"{watch.inputs} inputs: {watch.refused} refused, {len(watch.findings)} findings")
    finally:
        os.chdir(here)
    return watch


def _search(name: str, kind: Kind, watch: Watch, inputs: int, seed: int) -> None:
    path = watch.folder / kind.name

    @seeded(seed)
    @settings(
        max_examples=inputs,
        deadline=None,
        database=None,
        phases=[Phase.generate],
        suppress_health_check=list(HealthCheck),
    )
    @given(kind.inputs)
    def judge(content: bytes) -> None:
        path.write_bytes(content)
        kind.prepare(path)
        watch.judge(name, lambda: kind.read(path), content)

    judge()


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
