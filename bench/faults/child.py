"""The command line in a process with something wrong: a disk that is full after some files, a clock that jumps.

``python -m bench.faults.child full:5 -- run study.toml ...`` lets five files be written and refuses the next ones.
"""

from __future__ import annotations

import errno
import itertools
import random
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any, NoReturn


def full_after(files: int) -> None:
    """Let the disk be full after so many files, whoever writes them."""
    import zarr.storage._local as local

    from harness.common import places

    count = itertools.count()

    def limited(write: Callable[..., Any]) -> Callable[..., Any]:
        def wrapped(*args: Any, **kwargs: Any) -> Any:
            if next(count) >= files:
                raise OSError(errno.ENOSPC, "No space left on device")
            return write(*args, **kwargs)

        return wrapped

    local._put = limited(local._put)
    places.unfinished = limited(places.unfinished)


def jumping_clock(seed: int) -> None:
    """Let the clock jump by up to a day, back or forth, at every look."""
    draw, real, real_ns = random.Random(seed), time.time, time.time_ns
    time.time = lambda: real() + draw.uniform(-86400, 86400)
    time.time_ns = lambda: real_ns() + int(draw.uniform(-86400, 86400) * 1e9)


def main() -> None:
    """Do what the first argument says, then run the command line on the rest."""
    what, _, number = sys.argv[1].partition(":")
    if what != "nothing":
        {"full": full_after, "clock": jumping_clock}[what](int(number))
    run(sys.argv[3:])


def run(arguments: list[str]) -> NoReturn:
    """Run the command line; ``store STUDY FOLDER`` is ``harness run`` without its report."""
    if arguments[0] == "store":
        from harness.api.study import read_study
        from harness.cli.guard import guarded

        scheduler = arguments[4] if arguments[3:4] == ["scheduler"] else None
        dask: Any = "local" if arguments[3:4] == ["dask"] else None
        jobs = None if scheduler else 2
        study = read_study(Path(arguments[1]).resolve())
        sys.exit(
            guarded(lambda: _done(study.run(arguments[2], jobs, scheduler=scheduler, dask=dask)), Path(arguments[2]))
        )
    sys.argv = ["harness", *arguments]
    from harness.cli.main import main as command_line

    sys.exit(command_line())


def _done(_: object) -> None:
    """Return nothing, as a command does."""


if __name__ == "__main__":
    main()
