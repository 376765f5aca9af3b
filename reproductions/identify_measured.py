"""Identify a measured car and write data and report: table 3.3, figures 3.16 and 3.21 of Sun 2015.

``python -m reproductions.identify_measured studies/identify/genesis.toml --out results/identify-genesis`` identifies
the car of a file (``reproductions.measured_car``) and writes what ``harness identify`` does. Where the folder of the
recordings is absent it says so and exits with status 0.
"""

from __future__ import annotations

import argparse
import shlex
import sys
from collections.abc import Sequence
from pathlib import Path

from rich.console import Console

from harness.cli.options import answers_errors
from harness.common.stages import showing
from harness.identification.result import write_outcome
from harness.reporting.document import write
from reproductions.measured_car import IdentifyStudy, identified
from reproductions.measured_car_report import document


def _arguments() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(prog="python -m reproductions.identify_measured", description=__doc__)
    parser.add_argument("file", type=Path, help="such as studies/identify/genesis.toml")
    parser.add_argument("--out", type=Path, required=True, help="folder to write to")
    parser.add_argument("--jobs", type=int, default=None, help="threads; all cores if absent")
    return parser


@answers_errors
def main(arguments: Sequence[str]) -> None:
    """Identify as the file says and write data and report."""
    chosen = _arguments().parse_args(arguments)
    study = IdentifyStudy.read(chosen.file)
    if study.absent:
        print(study.absent)
        return
    with showing(Console(stderr=True), "starting") as show:
        found = identified(study, chosen.jobs, show)
    command = f"python -m reproductions.identify_measured {shlex.join(arguments)}"
    names = ", ".join(j.drive.name for j in found.judged if not j.held_out)
    source = f"{study.path}, method {found.fit.method}, on {names}"
    write_outcome(chosen.out, found.fit, list(found.judged), source)
    write(document(found, study.raw.title, study.spans(), command), chosen.out)
    print(f"wrote {chosen.out}/report.html")


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
