"""Strike, run again, compare; ``python -m bench.faults --out results/faults``."""

from __future__ import annotations

import json
import random
import shutil
import sys
import time
from collections import Counter
from dataclasses import replace
from pathlib import Path

from bench.faults.faults import PLAN, SHORT, Fault, Unexpected
from bench.faults.jobs import Job, jobs
from harness.common.arguments import Parser


def main(arguments: list[str] | None = None) -> int:
    """Strike each job as planned; return 0 if every one had the same bits afterwards."""
    parser = Parser(description=__doc__)
    parser.add_argument("--out", type=Path, default=Path("results/faults"))
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--jobs", default="", help="names, comma-separated; all if absent")
    parser.add_argument("--short", action="store_true")
    given = parser.parse_args(arguments)
    all_jobs, plan = jobs(given.out.resolve()), SHORT if given.short else PLAN
    chosen = [name for name in plan if not given.jobs or name in given.jobs.split(",")]
    survived = struck = 0
    with (given.out / "faults.jsonl").open("w", encoding="utf-8") as record:
        for name in chosen:
            reference = _reference(all_jobs[name])
            number = Counter[str]()
            for fault, count in plan[name].items():
                for _ in range(count):
                    number[fault.__name__] += 1
                    what = _struck(all_jobs[name], reference, fault, f"{given.seed} {name} {number}")
                    struck, survived = struck + 1, survived + what["same_bits"]
                    record.write(json.dumps(what) + "\n")
                    record.flush()
                    print(f"{name}: {what['fault']}: {'same bits' if what['same_bits'] else what['wrong']}", flush=True)
    print(f"{survived} of {struck} faults survived with the same bits")
    return 0 if survived == struck else 1


def _reference(job: Job) -> Path:
    """Run a job undisturbed and keep what it writes."""
    kept = job.out.with_name(f"reference-{job.name}")
    shutil.rmtree(kept, ignore_errors=True)
    job.clear()
    begin = time.perf_counter()
    if wrong := job.finish():
        raise SystemExit(f"{job.name}: the undisturbed run {wrong}")
    shutil.copytree(job.out, kept)
    (kept / "seconds").write_text(f"{time.perf_counter() - begin}")
    return kept


def _struck(job: Job, reference: Path, fault: Fault, seed: str) -> dict[str, object]:
    """Strike a job once, run it again, and say whether it has the bits of the reference."""
    job.clear()
    begin, wrong = time.perf_counter(), ""
    try:
        what = fault(job, reference, random.Random(seed))
    except Unexpected as error:
        what, wrong = fault.__name__, str(error)
    wrong = job.finish() or wrong
    same = not wrong and _same(job, reference)
    wrong = wrong or ("" if same else "other bits: " + ", ".join(_differing(job, reference)[:5]))
    seconds = round(time.perf_counter() - begin, 1)
    return {"job": job.name, "fault": what, "same_bits": bool(same), "wrong": wrong, "seconds": seconds}


def _same(job: Job, reference: Path) -> bool:
    return not _differing(job, reference)


def _differing(job: Job, reference: Path) -> list[str]:
    there = replace(job, out=reference).bits()
    there.pop("seconds")
    here = job.bits()
    return sorted(name for name in here.keys() | there.keys() if here.get(name) != there.get(name))


if __name__ == "__main__":
    sys.exit(main())
