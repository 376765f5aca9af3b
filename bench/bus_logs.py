"""Time and memory to read a bus of 5,000 frames a second in each form of log: ``python -m bench.bus_logs``.

The frames of eight messages, three of them of 29 bits, two buses. Each form is read twice, each time by a process of
its own, and the quicker one counts.
"""

from __future__ import annotations

import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

import can
import numpy as np

from harness.common.arguments import Parser
from harness.recordings import readers

RATE = 5000
_IDENTIFIERS = (0x100, 0x101, 0x0CF00400, 0x102, 0x103, 0x18F00421, 0x18FEF100, 0x7AB)
_LENGTHS = (8, 8, 8, 4, 2, 8, 8, 6)
_DBC = "".join(
    f'BO_ {i | (i > 0x7FF) << 31} M{i:X}: {n} E\n SG_ a : 0|16@1+ (0.01,0) [0|0] "m/s" E\n'
    for i, n in zip(_IDENTIFIERS, _LENGTHS, strict=True)
)
_HEADS = {
    "asc": "date Sun Nov 29 19:43:23.268 2026\nbase hex  timestamps absolute\ninternal events logged\n",
    "trc": ";$FILEVERSION=2.1\n;$STARTTIME=44087.5\n;$COLUMNS=N,O,T,B,I,d,R,L,D\n",
    "log": "",
}


def _asc(i: int, t: float, identifier: int, data: str) -> str:
    name = f"{identifier:X}" + "x" * (identifier > 0x7FF)
    return f"{t:9.6f} {1 + i % 2}  {name:<15} Rx   d {len(data) // 3} {data}\n"


def _trc(i: int, t: float, identifier: int, data: str) -> str:
    return f"{i + 1:7} {1e3 * t:13.3f} DT {1 + i % 2:2} {identifier:8X} Rx -  {len(data) // 3}    {data}\n"


def _log(i: int, t: float, identifier: int, data: str) -> str:
    name = f"{identifier:0{8 if identifier > 0x7FF else 3}X}"
    return f"({1.6e9 + t:.6f}) can{i % 2} {name}#{data.replace(' ', '')}\n"


WRITERS: dict[str, Callable[[int, float, int, str], str]] = {"asc": _asc, "trc": _trc, "log": _log}
BINARY = ("blf", "mf4")
"""Forms that python-can writes."""


def write(folder: Path, frames: int) -> None:
    """Write a log in each form, and the database."""
    (folder / "bus.dbc").write_text(f'VERSION ""\nBU_: E\n{_DBC}', encoding="utf-8")
    rng = np.random.default_rng(0)
    for form, line in WRITERS.items():
        with open(folder / f"a.{form}", "w", encoding="utf-8") as file:
            file.write(_HEADS[form])
            for i in range(frames):
                data = rng.bytes(_LENGTHS[i % 8]).hex(" ").upper() + " "
                file.write(line(i, i / RATE, _IDENTIFIERS[i % 8], data))
    for form in BINARY:
        with can.Logger(str(folder / f"a.{form}")) as log:
            for i in range(frames):
                identifier, data = _IDENTIFIERS[i % 8], rng.bytes(_LENGTHS[i % 8])
                frame = can.Message(1.6e9 + i / RATE, identifier, identifier > 0x7FF, channel=i % 2, data=data)
                log(frame)


def read(path: Path) -> str:
    """Read a log, and return seconds of processor time, GiB and frames."""
    begun = time.process_time()
    tables = readers.read_tables(path, None, [str(path.parent / "bus.dbc")])
    took = time.process_time() - begun
    status = dict(line.split(":", 1) for line in Path("/proc/self/status").read_text(encoding="ascii").splitlines())
    memory = int(status["VmHWM"].split()[0]) / 2**20  # getrusage counts what the process was before it began this
    return f"{took} {memory} {sum(len(next(iter(table.columns.values()))) for table in tables)}"


def main() -> None:
    """Write, read in processes of their own, and print."""
    parser = Parser(prog="python -m bench.bus_logs", description=__doc__)
    parser.add_argument("--seconds", type=float, default=600.0, help="length of the log (%(default)s)")
    parser.add_argument("--read", type=Path, help="read this log, which is beside its database, and print its numbers")
    chosen = parser.parse_args()
    if chosen.read is not None:
        print(read(chosen.read))
        return
    with tempfile.TemporaryDirectory() as folder:
        write(Path(folder), round(RATE * chosen.seconds))
        for form in (*WRITERS, *BINARY):
            command = [sys.executable, "-m", "bench.bus_logs", "--read", f"{folder}/a.{form}"]
            done = [subprocess.run(command, capture_output=True, text=True, check=True).stdout for _ in range(2)]
            took, memory, frames = min([float(word) for word in text.split()] for text in done)
            print(f"{form}: {frames:,.0f} frames in {took:.2f} s of processor time, at most {memory:.2f} GiB")


if __name__ == "__main__":
    main()
