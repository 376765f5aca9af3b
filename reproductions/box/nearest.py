"""The point nearest to the dissertation, run with its factors as printed and with a network that was trained there.

``python -m reproductions.box.nearest --out results/reproduce-nearest --page docs/tables/unpublished.md`` runs the
studies of chapter 5 at the point of ``reproductions/campaign/box.json`` twice, with the network that comes with the
project and with ``semitrailer_24t_nearest``, and writes report and page. The point is kept as the set
``ziaukas_2023_nearest`` and the drives ``nearest``.
"""

from __future__ import annotations

import argparse
import shlex
import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import joblib

from harness.cli.options import answers_errors
from harness.common.arguments import Parser
from harness.common.files import read_text, renewed, toml_text, write_files
from harness.models.quantities import listed
from harness.reporting.document import Block, Drawing, Listing, Prose, Report, Section, Sheet, plain
from harness.reporting.style import number
from reproductions.box import figures, studies
from reproductions.box.evidence import IN_BOX, PUBLISHED, PointEvidence, evidence_of
from reproductions.box.factors import as_printed
from reproductions.box.plausibility import AXLES, Plausibility, plausibility
from reproductions.box.points import Point, evaluate
from reproductions.box.tables import FACTOR_HEADER, NUMBER_HEADER, factor_rows, number_rows
from reproductions.campaign import box
from reproductions.published.page import table

TRAINED = "semitrailer_24t_nearest"
"""Network trained with the set ``ziaukas_2023_nearest``."""

BEGIN, END = "<!-- written by make reproduce-nearest -->", "<!-- end of the nearest point -->"
NETWORKS = ("network of the project", "network trained there")


@dataclass(frozen=True)
class Nearest:
    """The studies of chapter 5 at a point.

    Attributes:
        at: Values by factor, as printed.
        points: With the network of the project and with the one trained there.
        evidence: Of these points.
    """

    at: dict[str, float]
    points: tuple[Point, Point]
    evidence: tuple[PointEvidence, PointEvidence]


def at_printed_point(number: int, at: Mapping[str, float], jobs: int, trained: str = TRAINED) -> Nearest:
    """Run the studies at a point of the box, its factors as printed.

    Args:
        number: Of the point.
        at: Values by factor.
        jobs: Threads.
        trained: Name or file of the network that was trained there.
    """
    values = as_printed(at)
    first, second = (evaluate(number, values, jobs, network) for network in (studies.NETWORK, trained))
    return Nearest(values, (first, second), (evidence_of(first), evidence_of(second)))


def as_toml(at: Mapping[str, float], command: str) -> dict[str, str]:
    """Return a set of parameters and drives by file name, which a study can name."""
    spec = studies.study_at(at).plant
    process, measurement = studies.noise(at)
    heading = f"The point of the box nearest to Ziaukas 2023, chapter 5. Written by: {command}"
    values = {
        "vehicle": spec.vehicle,
        "tyre": spec.tyre,
        "sensors": spec.sensors,
        "values": spec.values,
        "process_noise": process,
        "measurement_noise": spec.measurement_noise | measurement,
    }
    title = "Drives of the described kinds at the point nearest to Ziaukas 2023"
    return {
        "nearest.toml": toml_text(values, heading),
        "nearest_drives.toml": toml_text({"title": title, "drive": studies.drives(at)}, heading),
    }


def in_words(nearest: Nearest) -> str:
    """Say how many findings hold and how far the numbers are off, with either network."""
    parts = []
    for name, evidence in zip(NETWORKS, nearest.evidence, strict=True):
        failing = [str(k) for k, held in enumerate(evidence.holds(), 1) if not held]
        parts.append(
            f"With the {name} {len(IN_BOX) - len(failing)} of {len(IN_BOX)} findings hold"
            f"{' (not ' + listed(failing) + ')' if failing else ''}, {sum(evidence.distances() <= 1.0)} of "
            f"{len(PUBLISHED)} numbers are within a factor of two, the root mean square distance is a factor of "
            f"{number(2 ** evidence.off(), 3)}."
        )
    return " ".join(parts)


def vehicle_in_words(p: Plausibility) -> str:
    """Say whether the vehicle could be a real one."""
    loads = listed([f"{number(load / 1000 / 9.81)} t" for load in p.loads])
    return (
        f"Axles {', '.join(AXLES)} carry {loads}; the tractor {'under' if p.understeer > 0 else 'over'}steers by "
        f"{number(1000 * abs(p.understeer))} mrad per m/s²; the straight run at 80 km/h is "
        f"{'stable' if p.slowest < 0 else 'unstable'} (largest real part {number(p.slowest)} 1/s)."
    )


def _numbers(nearest: Nearest) -> list[list[str]]:
    """Return the rows of numbers, the network's once for each network."""
    rows = []
    for published, first, second in zip(PUBLISHED, *map(number_rows, nearest.evidence), strict=True):
        rows.append(first)
        if published.network:
            rows.append([second[0].replace("network", NETWORKS[1]), *second[1:]])
    return rows


HELD_HEADER = ("", "finding", *(f"holds with the {name}" for name in NETWORKS))


def _held(nearest: Nearest) -> list[list[str]]:
    holds = zip(*(evidence.holds() for evidence in nearest.evidence), strict=True)
    words = {True: "yes", False: "no"}
    return [
        [str(k), c.text, words[a], words[b]] for k, (c, (a, b)) in enumerate(zip(IN_BOX, holds, strict=True), start=1)
    ]


def blocks(nearest: Nearest) -> list[Block]:
    """Return the section of a report."""
    return [
        Prose(plain(f"{vehicle_in_words(plausibility(nearest.at))} {in_words(nearest)}")),
        Drawing(
            lambda: figures.medians(*nearest.points),
            f"Ideal case at the nearest point, six drives, {studies.REPEATS} runs each. Diamonds: medians of Bild 5.6.",
            "box plots of the ideal case beside the published medians",
        ),
        Sheet(NUMBER_HEADER, _numbers(nearest), "Numbers of chapter 5 and ours at the nearest point.", left=2),
        Sheet(HELD_HEADER, _held(nearest), "Findings of chapter 5 at the nearest point.", left=4),
        Sheet(FACTOR_HEADER, factor_rows(nearest.at), f"The nearest point, number {nearest.points[0].number}.", left=1),
    ]


def markdown(nearest: Nearest, command: str) -> str:
    """Return the tables of the page."""
    return "\n\n".join(
        [
            f"Written by `{command}`, for point {nearest.points[0].number}.",
            vehicle_in_words(plausibility(nearest.at)),
            in_words(nearest),
            table(NUMBER_HEADER, _numbers(nearest)),
            table(HELD_HEADER, _held(nearest)),
            table(FACTOR_HEADER, factor_rows(nearest.at)),
        ]
    )


def _arguments() -> argparse.ArgumentParser:
    parser = Parser(prog="python -m reproductions.box.nearest", description="Which findings hold at the nearest point?")
    parser.add_argument("--out", type=Path, required=True, help="folder to write to")
    parser.add_argument("--network", default=TRAINED, help="network trained at the point: a name or an .npz file")
    parser.add_argument("--page", type=Path, help="page to renew between its marks, such as docs/tables/unpublished.md")
    parser.add_argument("--jobs", type=int, default=joblib.cpu_count(), help="threads")
    return parser


@answers_errors
def main(arguments: Sequence[str]) -> None:
    """Run the studies at the nearest point, and write report and page."""
    chosen = _arguments().parse_args(arguments)
    page = None if chosen.page is None else renewed(read_text(chosen.page), "", BEGIN, END)
    command = f"python -m reproductions.box.nearest {shlex.join(arguments)}"
    point = box.committed().nearest
    trained = Path(chosen.network)
    nearest = at_printed_point(
        point.number, point.at, max(chosen.jobs, 1), str(trained.resolve()) if trained.suffix else chosen.network
    )
    title = "What do the studies of chapter 5 say at the point nearest to them?"
    made: list[Block] = [Section(lambda: blocks(nearest), "The point nearest to the dissertation"), Listing(command)]
    Report(title, made).write(chosen.out)
    write_files(chosen.out, as_toml(nearest.at, command))
    if page is not None:
        write_files(chosen.page.parent, {chosen.page.name: renewed(page, markdown(nearest, command), BEGIN, END)})
    print(in_words(nearest))
    print(f"wrote {chosen.out}/report.html")


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
