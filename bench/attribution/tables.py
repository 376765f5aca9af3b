"""Tables of the proof, as Markdown: against what is asked, by kind, by effect, and what was claimed instead."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Callable, Iterable, Sequence

import numpy as np
from scipy.stats import binomtest

from bench.attribution.score import MAGNITUDES, Scored
from harness.models.quantities import words

KINDS = ("none", "parameters", "effect", "pair", "unlisted")
SOUND = ("none", "parameters")
"""Kinds in which no effect is there."""

Cases = Sequence[Scored]


def wilson(right: int, total: int) -> tuple[float, float]:
    """Return the 95 % interval of a share after Wilson (1927), which holds for few cases and for shares of 0 and 1."""
    interval = binomtest(right, total).proportion_ci(0.95, method="wilson")
    return float(interval.low), float(interval.high)


def share(values: Iterable[bool]) -> str:
    """Write a share with its interval: ``19 of 20, 95 % (76 to 99)``; a dash of nothing."""
    flags = list(values)
    if not flags:
        return "–"
    low, high = wilson(sum(flags), len(flags))
    return f"{sum(flags)} of {len(flags)}, {np.mean(flags):.0%} ({100 * low:.0f} to {100 * high:.0f})".replace(
        "%", " %"
    )


def median(values: Iterable[float], digits: int = 0) -> str:
    """Write the median of shares in percent; a dash of nothing."""
    finite = [v for v in values if math.isfinite(v)]
    return f"{100 * np.median(finite):.{digits}f} %" if finite else "–"


def tables(scored: Cases) -> str:
    """Return all tables but the list of cases, and but those of kinds that are not there; each vehicle has its own."""
    parts = ["## Against what is asked", f"{len(scored)} cases.", numbers(scored)] if cases_of(scored, *KINDS) else []
    for vehicle in vehicles(scored):
        own = [s for s in scored if s.vehicle == vehicle]
        parts += [f"## {words(vehicle).capitalize()}", "### By kind", kinds(own)]
        parts += ["### False alarms", alarms(own)] if any(s.kind in SOUND for s in own) else []
        parts += ["### By effect", effects(own), "### Confusion", confusion(own)]
    return "\n\n".join(parts) + "\n"


def vehicles(scored: Cases) -> list[str]:
    """Return the vehicles of the cases, in order."""
    return list(dict.fromkeys(s.vehicle for s in sorted(scored, key=lambda s: s.vehicle, reverse=True)))


def effects_in(scored: Cases) -> list[str]:
    """Return the effects of cases with one effect, those of the library first."""
    kinds = {s.true[0]: s.kind for s in scored if s.kind in ("effect", "unlisted")}
    return sorted(kinds, key=lambda name: (kinds[name], name))


def numbers(scored: Cases) -> str:
    """Return the table of what is asked of medium magnitudes, and of what was measured, by vehicle and of all."""
    own = {v: [s for s in scored if s.vehicle == v] for v in vehicles(scored)}
    own |= {"both": list(scored)} if len(own) > 1 else {}
    quality = scored[0].quality if scored else "clean"
    lines = header(["at medium magnitude", "asked", *own], 1)
    for what, asked, measured in _ASKED:
        lines.append(
            line(
                [
                    what,
                    asked.get("clean" if quality == "clean" else "field", "–"),
                    *(measured(cases) for cases in own.values()),
                ]
            )
        )
    return "\n".join(lines)


def _first(cases: Cases) -> str:
    return share(s.first == s.true[0] for s in cases_of(cases, "effect"))


def _errors(cases: Cases) -> str:
    return median((e for s in cases_of(cases, "effect") for e in s.errors.values()), 1)


def _sizes(cases: Cases) -> str:
    sizes = [s.in_set for s in cases if s.in_set]
    return f"{np.median(sizes):g}" if sizes else "–"


def _wrong(cases: Cases) -> list[float]:
    return [s.wrong for s in cases_of(cases, "unlisted") if math.isfinite(s.wrong)]


def _seconds(cases: Cases) -> str:
    """Write median and maximum of the times that were taken, and how many."""
    seconds = [s.seconds for s in cases_of(cases, *KINDS) if math.isfinite(s.seconds)]
    return f"{np.median(seconds):.0f} s, {max(seconds):.0f} s ({len(seconds)})" if seconds else "–"


def _nearly(cases: Cases) -> str:
    return share(s.closed >= 0.9 for s in cases_of(cases, "effect", "pair") if math.isfinite(s.closed))


_ASKED: tuple[tuple[str, dict[str, str], Callable[[Cases], str]], ...] = (
    ("no effect claimed where none is", {"clean": "96 %", "field": "93 %"}, lambda c: _right(c, *SOUND)),
    ("true effect named first", {"clean": "95 %", "field": "85 %"}, lambda c: _first(c)),
    ("true effect added, or in the confusable set", {}, lambda c: _right(c, "effect")),
    (
        "true effect in the 90 % set",
        {"clean": "90 %", "field": "90 %"},
        lambda c: share(s.covered for s in cases_of(c, "effect") if s.in_set),
    ),
    ("models in that set, median", {"clean": "2", "field": "3"}, lambda c: _sizes(cases_of(c, "effect"))),
    ("both of two effects found", {"clean": "85 %", "field": "70 %"}, lambda c: _right(c, "pair")),
    (
        "unlisted effect: no wrong name with probability 0.9",
        {"clean": "90 %", "field": "90 %"},
        lambda c: share(w < 0.9 for w in _wrong(c)),
    ),
    ("unlisted effect: `unresolved`", {}, lambda c: _right(c, "unlisted")),
    (
        "gap closed, median",
        {"clean": "97 %", "field": "90 %"},
        lambda c: median(s.closed for s in cases_of(c, "effect")),
    ),
    (
        "time of a trace on all cores, median and longest",
        {"clean": "30 s, 90 s", "field": "30 s, 90 s"},
        _seconds,
    ),
    ("parameter error, median", {}, _errors),
    ("at least 90 % of the gap closed", {}, _nearly),
    ("unlisted effect: gap closed, median", {}, lambda c: median(s.closed for s in cases_of(c, "unlisted"))),
)
"""What is measured, what is asked of it in clean recordings and in those that a bus carried as well, and how."""


def _right(cases: Cases, *kinds: str) -> str:
    return share(s.right for s in cases_of(cases, *kinds))


def cases_of(scored: Cases, *kinds: str) -> list[Scored]:
    """Return the cases of some kinds, at medium magnitude where there are several."""
    return [s for s in scored if s.kind in kinds and s.magnitude in ("", "medium")]


def kinds(scored: Cases) -> str:
    """Return shares right, of expected verdicts and of wrong additions, and gaps closed, by kind and magnitude."""
    groups = {name: cases for name, cases in by_kind(scored).items() if cases}
    lines = header(
        ["cases", "right (95 %)", "expected verdict", "with an effect that is not there", "gap closed, median"], 1
    )
    for name, cases in groups.items():
        row = [share(s.right for s in cases), share(s.verdict == s.expected for s in cases)]
        row += [str(sum(bool(s.extra) for s in cases)), median(s.closed for s in cases)]
        lines.append(line([name, *row]))
    return "\n".join(lines)


def by_kind(scored: Cases) -> dict[str, list[Scored]]:
    """Return the cases by kind and magnitude."""
    groups: dict[str, list[Scored]] = {}
    for kind in KINDS:
        for magnitude in ("", *MAGNITUDES):
            cases = [s for s in scored if (s.kind, s.magnitude) == (kind, magnitude)]
            if cases:
                groups[" ".join(filter(None, (kind, magnitude)))] = cases
    return groups


def alarms(scored: Cases) -> str:
    """Return how often an effect is claimed where none is, and which."""
    lines = header(["cases", "false alarms (95 %)", "verdict `adequate`", "claimed"], 1)
    for name, kinds_ in (("none", ("none",)), ("parameters", ("parameters",)), ("both", SOUND)):
        cases = [s for s in scored if s.kind in kinds_]
        claims = Counter(s.first for s in cases if not s.right)
        row = [share(not s.right for s in cases), share(s.verdict == s.expected for s in cases)]
        lines.append(line([name, *row, counted(claims)]))
    return "\n".join(lines)


def effects(scored: Cases) -> str:
    """Return, of every effect alone, how often it is found at each magnitude, how well, and from which size on."""
    columns = [*MAGNITUDES, "at another place", "parameter error", "gap closed", "smallest found", "of the limit"]
    lines = header(["effect", *columns], 1)
    for name in effects_in(scored):
        own = [s for s in scored if s.true == (name,)]
        shares = []
        for m in MAGNITUDES:
            flags = [s.right for s in own if s.magnitude == m]
            shares.append(f"{sum(flags)} of {len(flags)}" if flags else "–")
        least = smallest(own)
        row = [
            str(sum(bool(s.misplaced) for s in own)),
            median((e for s in own for e in s.errors.values()), 1),
            median(s.closed for s in own),
            least[0].size if least else "–",
            ratio([s.reach for s in least]),
        ]
        unlisted = " (unlisted)" if own[0].kind == "unlisted" else ""
        lines.append(line([words(name) + unlisted, *shares, *row]))
    return "\n".join(lines)


def smallest(cases: Cases) -> list[Scored]:
    """Return the cases of the smallest magnitude from which on at least half of the cases are right."""
    cases_there: list[Scored] = []
    for magnitude in reversed(MAGNITUDES):
        own = [s for s in cases if s.magnitude == magnitude]
        if own and np.mean([s.right for s in own]) < 0.5:
            break
        cases_there = own or cases_there
    return cases_there


def ratio(values: Sequence[float]) -> str:
    """Write the median size over the predicted limit."""
    finite = [v for v in values if math.isfinite(v)]
    return f"{float(f'{np.median(finite):.2g}'):g} ×" if finite else "–"


def confusion(scored: Cases) -> str:
    """Return what was claimed first of each true effect, without the zeros of the matrix."""
    lines = header(["true", "cases", "claimed first"], 1)
    for name, row in matrix(scored).items():
        lines.append(line([words(name), str(sum(row.values())), counted(row)]))
    return "\n".join(lines)


def matrix(scored: Cases) -> dict[str, Counter[str]]:
    """Return how often which first claim was made, by what is true; cases with two effects are left out."""
    rows = {name: [s for s in scored if s.true == (name,)] for name in effects_in(scored)}
    sound = {kind: [s for s in scored if s.kind == kind] for kind in SOUND}
    return {name: Counter(s.first for s in cases) for name, cases in (rows | sound).items() if cases}


def counted(claims: Counter[str]) -> str:
    """Write counts, the most frequent first."""
    return ", ".join(f"{words(name)} {n}" for name, n in claims.most_common()) or "–"


def case_table(scored: Cases) -> str:
    """Return the list of all cases."""
    lines = header(["case", "verdict", "claimed", "right", "gap closed", "size over limit"], 4)
    for s in scored:
        gap = median([s.closed])
        claims = ", ".join(map(words, s.claimed)) or "–"
        lines.append(
            line([f"{s.case}, {s.repeat}", s.verdict, claims, "yes" if s.right else "no", gap, ratio([s.reach])])
        )
    return "\n## Cases\n\n" + "\n".join(lines) + "\n"


def header(names: Sequence[str], text_columns: int) -> list[str]:
    """Return the head of a table of which the first columns stand left."""
    return [line(names), "|" + "|".join("---" if i < text_columns else "--:" for i in range(len(names))) + "|"]


def line(cells: Sequence[str]) -> str:
    """Return a line of a table."""
    return f"| {' | '.join(cells)} |"
