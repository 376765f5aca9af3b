"""Exported estimators under the tools of control units: MISRA C, a Cortex-M7 and its emulator. See docs/export.md.

    python -m bench.export_tools                      # the estimators of bench.export in single precision
    python -m bench.export_tools results/export-ukf   # folders that harness export wrote

Per estimator: messages of cppcheck with its MISRA add-on beside those of ``DEVIATIONS``, which is an error; bytes of
code and stack of the compiler for a Cortex-M7 with -Os, its floating-point unit of single precision; and the test of
the folder in an emulated Cortex-M7 (QEMU, board mps2-an500), files by semihosting. What is not installed is left out,
and said. Debian has all of it: cppcheck, gcc-arm-none-eabi, libnewlib-arm-none-eabi, qemu-system-arm.
"""

from __future__ import annotations

import shutil
import subprocess
import tempfile
from collections import Counter
from collections.abc import Iterator, Sequence
from pathlib import Path

from rich.console import Console
from rich.table import Table

from bench.export import STUDIES, study
from harness.common.arguments import Parser
from harness.common.errors import UserError, WorkError
from harness.common.files import write_files
from harness.realtime.export.run import export

DEVIATIONS = {
    "2.4": "advisory: places of states and reasons are for the reader of a header, who may need none",
    "2.5": "advisory: digests and counts are macros for whoever includes the header",
    "8.9": "advisory: tables of constants stand in front of all functions",
    "10.8": "required: a real number becomes a whole one of an exponent, within bounds that are checked before",
    "12.1": "advisory: operators have the precedence of the kernel in Python, which that of C agrees with",
    "15.5": "advisory: a kernel returns where it does in Python",
    "17.7": "required: what memset and memcpy return is their first argument",
    "18.4": "advisory: part of an array begins at a sum of a pointer and a whole number, as a slice does",
}
"""Rules of MISRA C:2012 that printed estimators deviate from, and why."""

BOARD = Path(__file__).parent / "cortex_m7"
TARGET = ("-mcpu=cortex-m7", "-mthumb", "-mfpu=fpv5-sp-d16", "-mfloat-abi=hard", "-ffp-contract=off")
COMPILER, EMULATOR = "arm-none-eabi-gcc", "qemu-system-arm"


def misra(folder: Path, name: str) -> Counter[str]:
    """Return how often an estimator deviates from each rule.

    Raises:
        WorkError: If it is something else than a rule of ``DEVIATIONS``.
    """
    words = ["cppcheck", "--addon=misra", "--std=c99", "--enable=warning,portability,performance", "--quiet"]
    words += ["--template={id}", "--template-location=", f"{name}.c"]
    done = subprocess.run(words, cwd=folder, capture_output=True, text=True, check=True)
    said = Counter(line.removeprefix("misra-c2012-") for line in done.stderr.splitlines() if line)
    if strange := said.keys() - DEVIATIONS.keys():
        raise WorkError(f"{name}: cppcheck says {', '.join(sorted(strange))}, which nobody has justified")
    return said


def sizes(folder: Path, name: str) -> tuple[int, int]:
    """Return bytes of code with its tables, and of the stack of all functions together."""
    words = [COMPILER, "-std=c99", "-Os", "-fstack-usage", *TARGET, "-c", f"{name}.c"]
    subprocess.run(words, cwd=folder, check=True)
    size = subprocess.run(["arm-none-eabi-size", f"{name}.o"], cwd=folder, check=True, capture_output=True, text=True)
    text, data, bss = map(int, size.stdout.splitlines()[1].split()[:3])
    assert bss == 0, "an estimator keeps memory that is not the caller's"
    stack = sum(int(line.split("\t")[1]) for line in (folder / f"{name}.su").read_text().splitlines())
    return text + data, stack


def emulated(folder: Path, name: str) -> str:
    """Return what the test of a folder says on an emulated Cortex-M7.

    Raises:
        CalledProcessError: If it fails.
    """
    sources = [str(BOARD / "startup.c"), "main.c", f"{name}.c"]
    script = ["--specs=rdimon.specs", "-T", str(BOARD / "layout.ld")]
    subprocess.run(
        [COMPILER, "-std=gnu99", "-O2", *TARGET, *script, *sources, "-o", "m7", "-lm"], cwd=folder, check=True
    )
    arguments = ",".join(f"arg={word}" for word in ("m7", "check", "replay.csv"))
    machine = ["-M", "mps2-an500", "-nographic", "-monitor", "none", "-serial", "none", "-kernel", "m7"]
    words = [EMULATOR, *machine, "-semihosting-config", f"enable=on,target=native,{arguments}"]
    done = subprocess.run(words, cwd=folder, check=True, capture_output=True, text=True, timeout=600)
    return done.stdout.splitlines()[-1].rpartition(": ")[2]


def folders(given: Sequence[Path], kind: str | None, place: Path) -> Iterator[tuple[str, Path, str]]:
    """Give title, folder and name of each estimator."""
    for folder in given:
        headers = [h.stem for h in folder.glob("*.h") if (folder / f"{h.stem}.c").is_file()]
        if len(headers) != 1:
            raise UserError(f"{folder}: this is no folder that harness export wrote")
        yield folder.name, folder, headers[0]
    for title in [] if given else STUDIES:
        chosen = study(title, "30 s")
        for spec in chosen.estimators:
            if kind in (None, spec.kind):
                run = export(chosen, spec.name, "float")
                folder = place / f"{title}-{spec.name}"
                write_files(folder, run.files)
                yield f"{title} {spec.name}", folder, run.export.name


def main(arguments: Sequence[str] | None = None) -> None:
    """Print a row for each estimator, then the rules."""
    parser = Parser(prog="python -m bench.export_tools", description=__doc__.splitlines()[0])
    parser.add_argument("folder", nargs="*", type=Path, help="that harness export wrote; those of bench.export if none")
    parser.add_argument("--estimator", help="kind; all if absent")
    given = parser.parse_args(arguments)
    missing = {tool: shutil.which(tool) is None for tool in ("cppcheck", COMPILER, EMULATOR)}
    table, console = Table("estimator", "MISRA", "code/B", "stack/B", "on a Cortex-M7", box=None), Console(width=120)
    together: Counter[str] = Counter()
    with tempfile.TemporaryDirectory() as place:
        for title, folder, name in folders(given.folder, given.estimator, Path(place)):
            rules = Counter() if missing["cppcheck"] else misra(folder, name)
            together += rules
            code, stack = (0, 0) if missing[COMPILER] else sizes(folder, name)
            ran = "–" if missing[COMPILER] or missing[EMULATOR] else emulated(folder, name)
            table.add_row(title, f"{rules.total()}", f"{code:,}", f"{stack:,}", ran)
    if not table.row_count:
        raise UserError(f"--estimator {given.estimator}: there is none of that kind in these studies")
    console.print(table)
    for rule, count in sorted(together.items(), key=lambda item: [int(n) for n in item[0].split(".")]):
        console.print(f"{rule:>5} {count:6,}  {DEVIATIONS[rule]}", soft_wrap=True, highlight=False)
    for tool in (t for t, absent in missing.items() if absent):
        console.print(f"not installed, and left out: {tool}")


if __name__ == "__main__":
    main()
