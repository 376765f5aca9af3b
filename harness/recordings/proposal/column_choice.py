"""Choice among the columns of a table: which are its clock, and which is a signal, in which unit.

All evidence is counted as natural logarithms of odds: how clear the name is, how usual the values are in a unit, and
how well the column agrees with the others: ``a_y = v r``, the rate of heading or course is the yaw rate,
that of the positions the speed, that of the speed the longitudinal acceleration. An agreement gains less by each unit
that had to be chosen for it.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import NamedTuple

import numpy as np

from harness.common.arrays import Floats
from harness.common.errors import UserError
from harness.common.unit_spellings import unit_of
from harness.common.units import scale
from harness.models.signals import SIGNALS
from harness.recordings import readers
from harness.recordings.proposal.column_names import TIME, read_name
from harness.recordings.proposal.column_values import STATED, WORST, Guess, Motion, MotionPair, Witness, compared
from harness.recordings.read.channels import is_measured
from harness.recordings.read.clock import by_line
from harness.recordings.read.span import Span


class ClockColumn(NamedTuple):
    """A column of time.

    Attributes:
        column, unit: Its name, and its unit as pint reads it.
        why: Reasons, in words.
        plus: Column and unit of the rest of its stamps; None where it is alone.
    """

    column: str
    unit: str
    why: str
    plus: tuple[str, str] | None = None


def seconds_of(table: readers.Table, clocks: Sequence[ClockColumn]) -> Floats | None:
    """Return the instants of a table in s; None where it has no clock."""
    if not clocks:
        return None
    column, unit, _, plus = clocks[0]
    seconds = table.columns[column] * scale(unit, "s", "time")
    if plus is not None:
        seconds = seconds + table.columns[plus[0]] * scale(plus[1], "s", "time")
    if np.isfinite(seconds).all() and (steps := np.diff(seconds)).min(initial=1.0) == 0.0 and (steps >= 0.0).all():
        instants = by_line(seconds, np.arange(len(seconds)))
        seconds = seconds if instants is None else instants
    return seconds


def filled(table: readers.Table) -> readers.Table:
    """Return a table with values joined over the rows of other messages, so that columns can be compared row by row."""
    columns, rows = {}, np.arange(len(next(iter(table.columns.values()))))
    for name, values in table.columns.items():
        measured = np.flatnonzero(is_measured(values))
        columns[name] = np.where(is_measured(values), values, np.nan)
        if 1 < len(measured) < len(rows):
            columns[name] = np.interp(rows, measured, values[measured], left=np.nan, right=np.nan)
    return replace(table, columns=columns)


def clocks_of(table: readers.Table) -> list[ClockColumn]:
    """Return the clock of a table; where its vectors are those of several structures, that of each which has one.

    Clocks of one recording run at the same time; one of another time, such as a time of day, is none.
    """
    native = None if table.clock not in table.columns else _clock(table, [str(table.clock)])
    if native is not None:
        return [native]
    of_structures: dict[str, list[str]] = {}
    for column in sorted(table.columns, key=lambda c: not is_time(c)):
        if is_time(column) or getattr(unit_of(table.units.get(column, "")), "si", "") == "s":
            of_structures.setdefault(column.rpartition(".")[0], []).append(column)
    candidates = [c for c in (_clock(table, columns) for columns in of_structures.values()) if c is not None]
    spans = [np.nanquantile(table.columns[c.column], [0.0, 1.0]) * scale(c.unit, "s", "time") for c in candidates]
    return [c for c, (begin, end) in zip(candidates, spans, strict=True) if begin <= spans[0][1] and end >= spans[0][0]]


def is_time(column: str) -> bool:
    """Return whether the name of a column reads as that of a clock."""
    return TIME.search(read_name(column).words) is not None


def _clock(table: readers.Table, columns: Sequence[str]) -> ClockColumn | None:
    """Return the first of some columns that rises as a clock does, its unit and why."""
    for column in columns:
        steps = np.diff(table.columns[column])
        steps = steps[np.isfinite(steps)]
        if len(steps) < 2 or (steps < 0).mean() > 0.01 or not (steps > 0).any():
            continue
        if column == table.clock:
            return ClockColumn(column, "s", "the format says so")
        stated, step = read_name(column, table.units.get(column, "")).unit, float(np.median(steps))
        first = float(table.columns[column][np.isfinite(table.columns[column])][0])
        step = step if step > 0 else float(steps.mean())
        if stated is not None and stated.si == "s":
            clock = ClockColumn(column, stated.text, f"unit by the {stated.by}")
        elif step < _OF_A_DAY and any(low < first < high for low, high in _DAYS):
            clock = ClockColumn(column, "day", "its values are days since 1900 or the year 0")
        else:
            unit = next((unit for unit, largest in _LARGEST_STEPS.items() if step <= largest), None)
            if unit is None:
                continue
            why = f"rises by {step:g} from row to row, unit by that: {_rate(step, unit)}"
            clock = ClockColumn(column, unit, why)
        return _with_rest(table, clock) if (steps == 0).mean() > _REPEATED else clock
    return None


def _with_rest(table: readers.Table, clock: ClockColumn) -> ClockColumn:
    """Return a clock whose stamps repeat with the column that holds the rest of them, where there is one."""
    seconds, structure = table.columns[clock.column] * scale(clock.unit, "s", "time"), clock.column.rpartition(".")[0]
    for column, values in table.columns.items():
        if column == clock.column or column.rpartition(".")[0] != structure or not (values >= 0).all():
            continue
        stated = read_name(column, table.units.get(column, "")).unit or unit_of(read_name(column).words)
        units = [stated.text] if stated is not None and stated.si == "s" else ["ns", "us", "ms"]
        for unit in units:
            rest = values * scale(unit, "s", "time")
            steps = np.diff(seconds + rest)
            if 0.5 < rest.max() < 1.0 and (steps > 0).mean() > 1 - _REPEATED:
                why = f"{clock.why}; '{column}' in {unit} holds the rest: {_rate(float(np.median(steps)), 's')}"
                return clock._replace(why=why, plus=(column, unit))
    return clock._replace(why=f"{clock.why}; its stamps repeat, so the rows are taken as equidistant where they are")


def _rate(step: float, unit: str) -> str:
    seconds = step * {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9}[unit]
    return f"{1 / seconds:.4g} Hz" if seconds > 0 else "several rows at a time"


_LARGEST_STEPS = {"s": 1.0, "ms": 500.0, "us": 5e5, "ns": 5e8}
"""Largest step of a clock by its unit, the likeliest first."""
_REPEATED = 0.01
"""Share of the stamps that may repeat."""
_DAYS, _OF_A_DAY = ((3e4, 6e4), (7e5, 8e5)), 1e-3
"""Values of days since 1900 and since the year 0 in these decades, and the largest step of such a clock."""


def cut(table: readers.Table, seconds: Floats | None, span: Span, where: Path) -> readers.Table:
    """Return the rows of a table in a span, counted from its first stamp."""
    if seconds is None:
        raise UserError(f"{where}: there is no clock, so no part of it can be told; propose a map of the whole file")
    since = seconds - seconds[np.isfinite(seconds)][0]
    rows = (since >= span[0]) & (since < span[1])
    if rows.sum() < 2:
        raise UserError(
            f"{where}: the recording runs from 0 to {np.nanmax(since):.2f} s; there is nothing in that span"
        )
    return replace(table, columns={name: values[rows] for name, values in table.columns.items()})


_DOUBT = 0.7
"""Log odds by which the likeliest unit must lead where the values alone determine it."""
_AS_OTHERS = 2.0
"""Log odds of a unit that another column of the same kind has."""
ENOUGH = 1.6
"""Least log odds of a column that is taken for a signal: an unclear name needs the motion."""
_TURNS_ALIKE = 0.8
"""Correlation from which a steering angle and the yaw rate determine a wheelbase."""
_TURNS_APART, _CONTRADICTED = 0.3, 3.0
"""Correlation below which they contradict each other, and the log odds of that against the steering angle."""
_JOINT = ("speed", "yaw_rate", "lateral_acceleration", "longitudinal_acceleration")
WHEELBASES = {"road_wheel_angle": (3.5, 0.5), "steering_wheel_angle": (50.0, 0.6)}
"""Steering angle times speed over yaw rate, m, with the standard deviation of its logarithm."""
WHEELBASE = "times speed over yaw rate:"
"""Beginning of the reason that it gives."""


_INERTIAL = ("yaw_rate", "roll_rate", "lateral_acceleration", "longitudinal_acceleration")
_SLOWER = 0.5
"""Log odds by the logarithm of a number of samples; estimates and positions are slower than an inertial unit."""


@dataclass(frozen=True)
class Chosen:
    """Guesses that agree best with each other.

    Attributes:
        guesses: By signal.
        relations: What was compared.
        lost: Columns that another one is better than, with the reason.
    """

    guesses: dict[str, Guess]
    relations: list[MotionPair]
    lost: dict[str, str]


def choose(candidates: Sequence[Guess], motion: Motion, seen: Witness) -> Chosen:
    """Return for every signal the likeliest column and unit by all evidence together.

    Args:
        candidates: Columns in each unit that they may have.
        motion: Their series.
        seen: Motion by heading and positions.
    """
    sums = _ChoiceEvidence(motion, seen)
    kept = {g.signal: g for g in _jointly(candidates, sums)}
    settled = {s for r in sums.relations(kept) if r.agrees for s in r.signals}
    for g in [g for s, g in kept.items() if s in WHEELBASES]:
        if turns := sums.turns(kept, g):
            settled.add(g.signal)
            kept[g.signal] = replace(g, why=(*g.why, turns))
    doubtful = {s: g for s, g in kept.items() if g.free and s not in settled and _doubtful(g, candidates)}
    kept = {s: g for s, g in kept.items() if s not in doubtful}
    for signal in dict.fromkeys(g.signal for g in candidates):
        if signal not in _JOINT and signal not in WHEELBASES:
            si = SIGNALS[signal].unit
            units = {g.unit for g in kept.values() if SIGNALS[g.signal].unit == si}
            points = {g: g.points + _AS_OTHERS * (g.free and g.unit in units) for g in candidates if g.signal == signal}
            best = max(points, key=lambda g: points[g])
            if best.points >= ENOUGH and best.column not in {g.column for g in kept.values()}:
                kept[signal] = best
    lost = _lost(candidates, kept, sums) | {
        g.column: f"may be {s}, but nothing tells its unit from another one: write it with its unit"
        for s, g in doubtful.items()
    }
    return Chosen(kept, [r for r in sums.relations(kept) if np.isfinite(r.factor)], lost)


def by_samples(candidates: Sequence[Guess], tables: Sequence[readers.Table]) -> list[Guess]:
    """Return candidates with log odds by their samples: of two inertial sensors the quicker one is the rawer."""
    counts = {g: int(is_measured(tables[g.table].columns[g.column]).sum()) for g in candidates if g.signal in _INERTIAL}
    most = {signal: max(n for g, n in counts.items() if g.signal == signal) for signal in {g.signal for g in counts}}
    return [
        replace(g, rate=_SLOWER * float(np.log(max(counts[g], 1) / most[g.signal]))) if g in counts else g
        for g in candidates
    ]


def _jointly(candidates: Sequence[Guess], sums: _ChoiceEvidence) -> list[Guess]:
    """Return the columns of speed, yaw rate, accelerations and steering that together count most.

    That a steering angle or longitudinal acceleration contradicts a speed counts against itself, not against the speed.
    """
    pools = [_best(candidates, {s}) for s in _JOINT]
    wheels = _best(candidates, set(WHEELBASES))
    best: tuple[Guess | None, ...] = (None, None, None)
    most = -np.inf
    for three in itertools.product(*pools[:3]):
        speed, rate, _ = three
        points = sum(sums.alone(g) for g in three) + sums.lateral(*three).points
        points += max(0.0, *(sums.longitudinal(speed, g).points for g in pools[3]))
        points += max(0.0, *(sums.steered(speed, rate, g) for g in wheels))
        if points > most + 1e-9:
            best, most = three, points
    speed, rate, lateral = best
    apart = [g for g in pools[3] if g is None or lateral is None or g.column != lateral.column]
    along = max(apart, key=lambda g: sums.alone(g) + sums.longitudinal(speed, g).points)
    wheel = max(wheels, key=lambda g: sums.alone(g) + sums.steered(speed, rate, g))
    return [g for g in (*best, along, wheel) if g is not None]


def _best(candidates: Iterable[Guess], signals: set[str]) -> list[Guess | None]:
    """Return the likeliest guesses for signals by name and values, and that there is none."""
    return [*sorted((g for g in candidates if g.signal in signals), key=lambda g: -g.points)[:8], None]


def _doubtful(g: Guess, candidates: Sequence[Guess]) -> bool:
    """Return whether the unit of a column cannot be determined."""
    others = (o for o in candidates if o.column == g.column and o.signal == g.signal and o.unit != g.unit)
    return any(g.usual - o.usual < _DOUBT for o in others)


class _ChoiceEvidence:
    """Log odds of guesses alone and together."""

    def __init__(self, motion: Motion, seen: Witness) -> None:
        self._motion, self._seen = motion, seen
        self._kept: dict[tuple[str, ...], MotionPair] = {}

    def alone(self, guess: Guess | None) -> float:
        """Return the log odds by name, values, heading and positions; those that a column needs where there is none."""
        if guess is None:
            return ENOUGH
        return guess.points + (self.by_witness(guess).points if guess.signal in ("speed", "yaw_rate") else 0.0)

    def by_witness(self, g: Guess) -> MotionPair:
        """Compare a yaw rate or speed with heading or positions."""
        if g.signal == "speed":  # of which positions do not tell whether it is backwards
            return self._compared(
                "speed over that of the positions", (g,), lambda: (np.abs(self._motion.series(g)), self._seen.speed)
            )
        by = () if self._seen.heading is None else (self._seen.heading,)
        name = f"yaw rate over the rate of the {'heading' if by else 'course over ground'}"
        return self._compared(name, (g, *by), lambda: (self._motion.series(g), self._seen.turn))

    def lateral(self, speed: Guess | None, rate: Guess | None, across: Guess | None) -> MotionPair:
        """Compare a lateral acceleration with speed times yaw rate, or the rate of the heading where there is none."""
        by = "yaw rate" if rate is not None else "the rate of the heading"

        def sides() -> tuple[Floats, Floats]:
            assert speed is not None
            assert across is not None
            turn = self._seen.turn if rate is None else self._motion.series(rate)
            v = self._motion.series(speed)
            return self._motion.series(across), v * turn if len(v) == len(turn) else np.empty(0)

        taking = (across, speed) if rate is None else (across, speed, rate)
        return self._compared(f"lateral acceleration over speed times {by}", taking, sides)

    def longitudinal(self, speed: Guess | None, along: Guess | None) -> MotionPair:
        """Compare a longitudinal acceleration with the rate of the speed."""

        def sides() -> tuple[Floats, Floats]:
            assert speed is not None
            assert along is not None
            return self._motion.series(along), self._motion.rate(self._motion.series(speed))

        return self._compared("longitudinal acceleration over the rate of the speed", (along, speed), sides)

    def wheelbase(self, speed: Guess | None, rate: Guess | None, wheel: Guess | None) -> MotionPair:
        """Compare a steering angle with yaw rate over speed: the factor is the apparent wheelbase in m."""

        def sides() -> tuple[Floats, Floats]:
            assert speed is not None
            assert rate is not None
            assert wheel is not None
            v, r = self._motion.series(speed), self._motion.series(rate)
            if len(v) != len(r):
                return v, np.empty(0)
            v = np.where(np.abs(v) > 0.2 * np.nanmax(np.abs(v)), v, np.nan)
            return self._motion.series(wheel), r / v

        return self._compared("wheelbase", (wheel, speed, rate), sides)

    def steered(self, speed: Guess | None, rate: Guess | None, wheel: Guess | None) -> float:
        """Return the log odds of a steering angle by the apparent wheelbase."""
        base = self.wheelbase(speed, rate, wheel)
        if wheel is None or not np.isfinite(base.factor):
            return 0.0
        if abs(base.alike) < _TURNS_ALIKE:
            return -_CONTRADICTED * (abs(base.alike) < _TURNS_APART)
        middle, spread = WHEELBASES[wheel.signal]
        off = 0.5 * (np.log(abs(base.factor) / middle) / spread) ** 2
        return float(1.5 - min(off, 3.0 if wheel.stated else 6.0))

    def turns(self, kept: Mapping[str, Guess], wheel: Guess) -> str:
        """Return the wheelbase that a steering angle implies, in words; empty if it is implausible or undetermined."""
        speed, rate = kept.get("speed"), kept.get("yaw_rate")
        base = self.wheelbase(speed, rate, wheel)
        return f"{WHEELBASE} {abs(base.factor):.3g} m" if self.steered(speed, rate, wheel) > 0 else ""

    def relations(self, kept: Mapping[str, Guess]) -> list[MotionPair]:
        """Return all that can be compared among what was chosen."""
        speed, rate, across, along = (kept.get(s) for s in _JOINT)
        return [
            *(self.by_witness(g) for g in (speed, rate) if g is not None),
            self.lateral(speed, rate, across),
            self.longitudinal(speed, along),
        ]

    def _compared(
        self, name: str, guesses: tuple[Guess | None, ...], sides: Callable[[], tuple[Floats, Floats]]
    ) -> MotionPair:
        """Compare two series, once for all columns in all units; a factor of NaN where a guess is missing."""
        taking = [g for g in guesses if g is not None]
        if len(taking) < len(guesses):
            return MotionPair(name, (), np.nan, np.nan)
        key = (name, *(f"{g.column} {g.unit}" for g in taking))
        if key not in self._kept:
            signals = tuple(g.signal for g in taking)
            self._kept[key] = compared(name, signals, *sides(), sum(g.free for g in taking))
        return self._kept[key]


def _lost(candidates: Sequence[Guess], kept: Mapping[str, Guess], sums: _ChoiceEvidence) -> dict[str, str]:
    """Return why each column that is not taken is not."""
    taken, lost = {g.column for g in kept.values()}, dict[str, str]()
    by_column = itertools.groupby(sorted(candidates, key=lambda g: (g.column, -g.points)), key=lambda g: g.column)
    for column, variants in by_column:
        if column in taken:
            continue
        g = next(variants)
        steers = g.signal in WHEELBASES
        winner = next((k for k in kept.values() if k.signal == g.signal or (steers and k.signal in WHEELBASES)), None)
        if winner is None:
            lost[column] = f"may be {g.signal}, but {_lacking(g, kept, sums)}"
            continue
        parts = {
            "its unit is stated": STATED * (winner.stated - g.stated),
            "its name says more": winner.sure - g.sure,
            "it has more samples": winner.rate - g.rate,
            "its values are more usual": winner.usual - g.usual,
            "it agrees better with the others' motion": _by_motion(winner, kept, sums) - _by_motion(g, kept, sums),
        }
        most = max(parts, key=lambda p: parts[p])
        lost[column] = f"'{winner.column}' is {winner.signal}: {most if parts[most] > 0.05 else 'it comes first'}"
    return lost


def _by_motion(g: Guess, kept: Mapping[str, Guess], sums: _ChoiceEvidence) -> float:
    """Return the log odds by the motion of the others of a guess in the place of that of its signal."""
    speed, rate, across, along = ({**kept, g.signal: g}.get(s) for s in _JOINT)
    if g.signal in WHEELBASES:
        return sums.steered(speed, rate, g)
    points = sums.alone(g) - g.points
    if g.signal in _JOINT[:3]:
        points += sums.lateral(speed, rate, across).points
    return points + sums.longitudinal(speed, along).points * (g.signal in (_JOINT[0], _JOINT[3]))


def _lacking(g: Guess, kept: Mapping[str, Guess], sums: _ChoiceEvidence) -> str:
    """Return why a column is no entry although its name may mean a signal."""
    if g.sure >= ENOUGH and g.usual <= WORST / 2:
        return "its values are those of no vehicle"
    if _by_motion(g, kept, sums) < 0:
        return "it does not move as the other columns say"
    return "its name says too little, and no motion of another column confirms it"
