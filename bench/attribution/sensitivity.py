"""Sensitivity of traces to the criteria: the same cases with every number of them halved and doubled.

``python -m bench.attribution.sensitivity`` traces the cases once as stated and once with each change
(``bench.attribution.changed_criteria``), scores every trace by the numbers as stated, and writes a line of each to
``sensitivity.jsonl``; it continues where it stopped, and what other code has traced is traced anew. ``sensitivity.md``
holds the tables; ``--page`` puts them into ``docs/tables/attribution.md``.
"""

from __future__ import annotations

import argparse
import hashlib
import json
import math
import subprocess
import sys
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

from bench.attribution import changed_criteria
from bench.attribution.changed_criteria import FOLDER, HOW, STATED, WAYS, Change, changes
from bench.attribution.oracle import FILE, write_oracle
from bench.attribution.renew import PAGE
from bench.attribution.run import QUALITIES, Case, Tracer, listed, written
from bench.attribution.score import Scored, as_plain, of_plain, score
from bench.attribution.tables import header, line, median
from harness.cli.options import answers_errors
from harness.common import sources
from harness.common.arguments import Parser
from harness.common.errors import UserError
from harness.common.files import renewed, write_files
from harness.models.quantities import words

CASES = (
    "car-none", "car-none", "car-parameters-several",
    "car-steering_offset-medium", "car-road_bank_varying-medium", "car-crosswind-small", "car-tyre_relaxation-medium",
    "car-tyre_saturation+steering_offset",
)  # fmt: skip
"""Of every kind; an effect that resembles another, a random one, one near the limit of what the drives show."""

MARKS = ("<!-- written by python -m bench.attribution.sensitivity -->", "<!-- end of sensitivity -->")

Key = tuple[str, str]
"""Label of the change, and folder of the case."""


class Traced(NamedTuple):
    """A trace with one number changed: scored, and a digest of its ``trace.json``."""

    scored: Scored
    digest: str


Found = Mapping[Key, Traced]


@answers_errors
def main(arguments: Sequence[str]) -> None:
    """Trace what was not traced yet, write the tables and print them."""
    parser = Parser(
        prog="python -m bench.attribution.sensitivity",
        description=__doc__,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("--cases", nargs="+", default=CASES, help="of the plant; the second of a name is its next draw")
    parser.add_argument("--numbers", nargs="+", help="only these, such as MOST or PRIORS.odds")
    parser.add_argument("--first", type=int, default=500, help="number of the first draw (%(default)s)")
    parser.add_argument("--quality", choices=QUALITIES, default=QUALITIES[0], help="of recordings (%(default)s)")
    parser.add_argument("--page", action="store_true", help=f"put the tables into {PAGE.parent.name}/{PAGE.name}")
    parser.add_argument("--out", type=Path, default=Path("results/attribution-sensitivity"), help="(%(default)s)")
    given = parser.parse_args(arguments)
    chosen = [c for c in changes() if given.numbers is None or c.number in given.numbers]
    for name in sorted({*(given.numbers or ())} - {c.number for c in changes()}):
        parser.error(f"the criteria have no number {name}")
    for name in sorted({*given.cases} - {case.name for case in listed()}):
        parser.error(f"the plant has no case {name}")
    cases = drawn(given.cases, given.first, given.quality, given.out)
    results = run(cases, chosen, given.out / "sensitivity.jsonl")
    page = tables(chosen, cases, results)
    write_files(given.out, {"sensitivity.md": page})
    if given.page:
        write_files(PAGE.parent, {PAGE.name: renewed(PAGE.read_text(encoding="utf-8"), page, *MARKS)})
    print(page)


def drawn(names: Sequence[str], first: int, quality: str, out: Path) -> list[Case]:
    """Return the cases of some names; one that is named again is its next draw."""
    repeats = [first + list(names[:i]).count(name) for i, name in enumerate(names)]
    ending = "" if quality == "clean" else f"-{quality}"
    return [Case(n, r, out / f"{n}-{r}{ending}", quality) for n, r in zip(names, repeats, strict=True)]


def run(cases: Sequence[Case], chosen: Sequence[Change], file: Path) -> dict[Key, Traced]:
    """Trace cases as stated and with each change, but for those that a file holds, and add a line of each to it.

    Raises:
        UserError: If the plant cannot write a case, or the process that traces ends.
    """
    code = sources.digest([changed_criteria])
    results = read(file, code)
    labels = [STATED, *(c.label for c in chosen)]
    open_cases = {label: [c for c in cases if (label, c.folder.name) not in results] for label in labels}
    done, total = len(cases) * len(labels) - sum(map(len, open_cases.values())), len(cases) * len(labels)
    prepare([c for c in cases if any(c in others for others in open_cases.values())])
    for label in labels:
        for folder, problem in traced(label, [c.folder for c in open_cases[label]]):
            new = results[label, folder.name] = of_folder(folder)
            append(file, code, label, folder.name, new)
            done += 1
            ending = problem.strip().rpartition("\n")[2] or ", ".join((new.scored.verdict, *new.scored.claimed))
            print(f"{done} of {total}: {label}, {folder.name}: {ending}", file=sys.stderr, flush=True)
    return results


def prepare(cases: Sequence[Case]) -> None:
    """Have the plant write cases, and fit their oracles; both are what they are whatever the criteria say.

    Raises:
        UserError: If the plant cannot write a case.
    """
    tracer = Tracer(threads=1)
    for case in cases:
        if problem := written(case):
            raise UserError(f"{case.name}, {case.repeat}: the plant cannot write it: {problem}")
        if not (case.folder / FILE).exists():
            write_oracle(case.folder, *tracer.model(case.folder))


def traced(label: str, folders: Sequence[Path]) -> Iterator[tuple[Path, str]]:
    """Trace the cases of some folders with one change, and give each with what went wrong as it ends.

    Raises:
        UserError: If the process that traces ends before that.
    """
    if not folders:
        return
    command = [sys.executable, "-m", changed_criteria.__name__, label, *map(str, folders)]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None
        for line in map(json.loads, process.stdout):
            yield Path(line["folder"]), line["problem"]
    if process.returncode:
        raise UserError(f"the traces with {label} ended with exit status {process.returncode}")


def of_folder(folder: Path) -> Traced:
    """Return the latest of these traces of a case; the numbers as stated score it."""
    file = folder / FOLDER / "trace.json"
    digest = hashlib.sha256(file.read_bytes()).hexdigest() if file.exists() else ""
    return Traced(score(folder, FOLDER), digest)


def append(file: Path, code: str, label: str, case: str, new: Traced) -> None:
    """Add a line to the results."""
    file.parent.mkdir(parents=True, exist_ok=True)
    entry = {"code": code, "change": label, "case": case, "trace": new.digest, "scored": as_plain(new.scored)}
    with file.open("a", encoding="utf-8") as lines:
        lines.write(json.dumps(entry) + "\n")


def read(file: Path, code: str) -> dict[Key, Traced]:
    """Return the results that are of this code."""
    results = {}
    for entry in map(json.loads, file.read_text(encoding="utf-8").splitlines() if file.is_file() else ()):
        if entry["code"] == code:
            results[entry["change"], entry["case"]] = Traced(of_plain(entry["scored"]), entry["trace"])
    return results


def tables(chosen: Sequence[Change], cases: Sequence[Case], results: Found) -> str:
    """Return what the traces as stated say, the table of all numbers, and every case that one of them changes."""
    names = [c.folder.name for c in cases]
    stated = [results[STATED, n] for n in names]
    lines = header(["number", "stated", *WAYS], 2 + len(WAYS))
    for number in dict.fromkeys(c.number for c in chosen):
        own = [c for c in chosen if c.number == number]
        cells = [f"{shown(c.value)}: {changed(stated, [results[c.label, n] for n in names])}" for c in own]
        lines.append(line([f"`{number}`", shown(own[0].before), *cells]))
    each = header(["number", "case", "as stated", "then"], 4)
    for change, name in ((c, n) for c in chosen for n in names):
        pair = [results[label, name].scored for label in (STATED, change.label)]
        if differences(*pair):
            each.append(line([f"`{change.number}` {change.way}", name, *map(outcome, pair)]))
    scales = "; ".join(f"{what} ({', '.join(f'`{n}`' for n in numbers)})" for what, numbers in HOW.values())
    parts = [totals([t.scored for t in stated]), "\n".join(lines), f"Halved and doubled are {scales}."]
    return "\n\n".join([*parts, *(["Case by case:", "\n".join(each)] if len(each) > 2 else [])]) + "\n"


def totals(scored: Sequence[Scored]) -> str:
    """Say in a sentence how often the traces are right with the numbers as stated."""
    there = [s for s in scored if s.kind in ("effect", "pair")]
    parts = [
        f"{sum(s.verdict == s.expected for s in scored)} have the expected verdict",
        f"{sum(bool(s.extra) for s in scored)} an effect that is not there",
        f"of {len(there)} with effects of the library {sum(is_first(s) for s in there)} name a true one first",
        f"{sum(s.covered for s in there)} have all in the set",
        f"the median of the gap closed is {median(s.closed for s in there)}",
    ]
    return f"As stated, of {len(scored)} traces {', '.join(parts)}."


def is_first(s: Scored) -> bool:
    """Whether the first claim is a true effect."""
    return s.first in s.true


def differences(stated: Scored, changed: Scored) -> list[str]:
    """Return what a changed number changes of a case; a hundredth of the gap counts."""
    pairs = {
        "verdict": (stated.verdict, changed.verdict),
        "names": (stated.claimed, changed.claimed),
        "faults of the recording": (stated.recording, changed.recording),
        "true effect first": (is_first(stated), is_first(changed)),
        "in the set": (stated.covered, changed.covered),
        "false claims": (len(stated.extra), len(changed.extra)),
        "gap closed": (0.0, 0.0 if both_nan(stated.closed, changed.closed) else abs(stated.closed - changed.closed)),
    }
    return [what for what, (a, b) in pairs.items() if (a != b if what != "gap closed" else not b < 0.01)]


def both_nan(first: float, other: float) -> bool:
    """Whether neither of two numbers is there."""
    return math.isnan(first) and math.isnan(other)


def changed(stated: Sequence[Traced], others: Sequence[Traced]) -> str:
    """Say what a changed number changes of all cases: in how many, and whether for the better where that is known."""
    pairs = [(a.scored, b.scored) for a, b in zip(stated, others, strict=True)]
    counts = Counter(what for pair in pairs for what in differences(*pair))
    parts = [f"{what} of {n}" for what, n in counts.items()]
    sizes = sum(a.in_set != b.in_set for a, b in pairs)
    parts += [f"size of the set of {sizes}"] if sizes else []
    same = sum(a.digest == b.digest for a, b in zip(stated, others, strict=True))
    return ", ".join(parts) or ("nothing, to the bit" if same == len(pairs) else "nothing")


def outcome(s: Scored) -> str:
    """Say what a trace ended with."""
    set_ = f"{s.in_set} in the set, the truth {'' if s.covered else 'not '}among them" if s.true else ""
    gap = "" if math.isnan(s.closed) else f"gap {median([s.closed])}"
    claims = ", ".join(map(words, (*s.claimed, *s.recording))) or "nothing named"
    return "; ".join(filter(None, (s.verdict, claims, set_, gap)))


def shown(value: Any) -> str:
    """Write a number, or all of a table or a list."""
    if isinstance(value, Mapping):
        return ", ".join(f"{words(key)} {shown(v)}" for key, v in value.items())
    if isinstance(value, tuple):
        return ", ".join(map(shown, value))
    return "∞" if math.isinf(value) else f"{value:.4g}".replace("e-0", "e-")


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
