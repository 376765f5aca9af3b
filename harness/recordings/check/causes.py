"""Catalogue of faults of a recording or its channel map, and causes of small deviations.

A fault is stated by what mends it: a factor, a reversed sign, two channels exchanged, another convention of the
heading, another unit of time, with its prior probability. Several of them make up a hypothesis; ``explain`` finds
the most probable one. A cause is a scale, an offset, a delay or a drift; ``calibration`` estimates them.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np

from harness.models.signals import SIGNALS
from harness.recordings.motion.consistency import SmoothedSignals

UNIT, SIGN, EXCHANGED, HEADING, TIME = "unit", "sign", "exchanged", "heading", "time"

_DEGREES = float(np.degrees(1.0))


@dataclass(frozen=True)
class RecordingFault:
    """A fault of the catalogue.

    Attributes:
        kind: ``UNIT``, ``SIGN``, ``EXCHANGED``, ``HEADING`` or ``TIME``.
        signals: The signals concerned; two for ``EXCHANGED``.
        factor: What the signals have to be multiplied by (for ``EXCHANGED``: the first one, the second divided).
        offset: What has to be added after that, rad.
        log_prior: Logarithm of its prior probability.
        words: The fault in words.
    """

    kind: str
    signals: tuple[str, ...]
    factor: float
    offset: float
    log_prior: float
    words: str


_COMMON, _SELDOM, _RARE = np.log(0.02), np.log(0.004), np.log(0.001)

_UNITS: dict[str, tuple[tuple[float, float, str], ...]] = {
    "angle": (
        (1 / _DEGREES, _COMMON, "degrees where the map says radians"),
        (_DEGREES, _COMMON, "radians where the map says degrees"),
        (_DEGREES**2, _SELDOM, "degrees converted to radians twice"),
        (1 / _DEGREES**2, _SELDOM, "radians converted to degrees twice"),
    ),
    "m/s": (
        (1 / 3.6, _COMMON, "km/h where the map says m/s"),
        (3.6, _COMMON, "m/s where the map says km/h"),
        (0.44704, _SELDOM, "mph where the map says m/s"),
        (1 / 0.44704, _SELDOM, "m/s where the map says mph"),
        (1852 / 3600, _RARE, "knots where the map says m/s"),
    ),
    "m/s^2": (
        (9.80665, _COMMON, "g where the map says m/s²"),
        (1 / 9.80665, _COMMON, "m/s² where the map says g"),
    ),
    "any": (
        (1000.0, _SELDOM, "a unit a thousand times larger than the map says"),
        (0.001, _SELDOM, "a unit a thousand times smaller than the map says"),
    ),
}
"""Factor, logarithm of the prior, and words, by the kind of unit."""

_CONVENTIONS: tuple[tuple[int, float, float, str], ...] = (
    (-1, 90.0, _COMMON, "a compass heading: clockwise from north"),
    (1, 90.0, _SELDOM, "counted from north instead of from east"),
    (-1, 0.0, _SELDOM, "counted clockwise"),
    (1, 180.0, _RARE, "that of the rear: turned by 180°"),
    (1, -90.0, _RARE, "turned by 90° to the left"),
    (-1, -90.0, _RARE, "clockwise from south"),
    (-1, 180.0, _RARE, "clockwise from west"),
)
"""Sign, degrees to be added, logarithm of the prior, and words of a convention of the heading."""

_TIMES: tuple[tuple[float, float, str], ...] = (
    (1e-3, _COMMON, "ms where the map says s"),
    (1e-6, _COMMON, "us where the map says s"),
    (1e-9, _SELDOM, "ns where the map says s"),
    (1e3, _COMMON, "s where the map says ms"),
    (1e6, _SELDOM, "s where the map says us"),
)

_EXCHANGE_LIKE, _EXCHANGE_ANY = _SELDOM, _RARE
_NEVER_REVERSED = {"speed", "speed_tractor"}


def family(signal: str) -> str:
    """Return the kind of unit of a signal, ``angle`` for angles and their rates."""
    unit = SIGNALS[signal].unit
    return "angle" if unit.startswith("rad") else unit


def catalogue(
    signals: Collection[str], scales: Mapping[str, float], twins: Mapping[str, tuple[str, ...]]
) -> list[RecordingFault]:
    """Return the possible faults of a recording of such signals.

    Args:
        signals: The signals that anything can be said about.
        scales: SI units per unit of the channel as the map has it, by signal.
        twins: All signals that are read from the channel of a signal; they are wrong together.
    """
    faults: list[RecordingFault] = []
    placed = {"latitude", "longitude"} <= set(signals)
    single = [s for s in signals if not (placed and s.startswith("position"))]
    seen: set[tuple[str, ...]] = set()
    for signal in single:
        together = twins.get(signal, (signal,))
        if together in seen or signal in ("latitude", "longitude"):
            continue
        seen.add(together)
        faults += _faults_of_channel(signal, together)
    if placed:
        place = ("latitude", "longitude")
        faults.append(RecordingFault(UNIT, place, _DEGREES, 0.0, _COMMON, "radians where the map says degrees"))
        faults.append(RecordingFault(UNIT, place, 1 / _DEGREES, 0.0, _COMMON, "degrees where the map says radians"))
        faults.append(RecordingFault(SIGN, ("longitude",), -1.0, 0.0, _SELDOM, "counted the other way"))
    elif {"position_x", "position_y"} <= set(signals):
        place = ("position_x", "position_y")
        faults += [RecordingFault(UNIT, place, factor, 0.0, prior, words) for factor, prior, words in _UNITS["any"]]
    return faults + _exchanges(single, scales, twins)


def _faults_of_channel(signal: str, together: tuple[str, ...]) -> list[RecordingFault]:
    """Return the possible faults of one channel."""
    kind = family(signal)
    faults = []
    if not signal.startswith("position"):
        units = (*_UNITS.get(kind, ()), *(_UNITS["any"] if kind != "angle" else ()))
        faults += [RecordingFault(UNIT, together, factor, 0.0, prior, words) for factor, prior, words in units]
    if signal == "heading":
        faults += [
            RecordingFault(HEADING, together, float(sign), float(np.radians(turn)), prior, words)
            for sign, turn, prior, words in _CONVENTIONS
        ]
    elif signal not in _NEVER_REVERSED:
        faults.append(
            RecordingFault(
                SIGN, together, -1.0, 0.0, _SELDOM if signal.startswith("position") else _COMMON, "wrong sign"
            )
        )
    return faults


def _exchanges(
    signals: Sequence[str], scales: Mapping[str, float], twins: Mapping[str, tuple[str, ...]]
) -> list[RecordingFault]:
    """Return the pairs of channels that may be exchanged, with their units or without."""
    faults = []
    for first, second in combinations(sorted(signals), 2):
        if second in twins.get(first, (first,)) or ("latitude" in (first, second)) != ("longitude" in (first, second)):
            continue
        like = SIGNALS[first].unit == SIGNALS[second].unit
        prior = _EXCHANGE_LIKE if like else _EXCHANGE_ANY
        faults.append(RecordingFault(EXCHANGED, (first, second), 1.0, 0.0, prior, "exchanged"))
        ratio = scales.get(first, 1.0) / scales.get(second, 1.0)
        if not like or abs(np.log(abs(ratio))) > 1e-6:
            faults.append(
                RecordingFault(
                    EXCHANGED, (first, second), ratio, 0.0, prior - 1.0, "exchanged, their units in the right place"
                )
            )
    return faults


def times() -> list[RecordingFault]:
    """Return the units of time that may be meant."""
    return [RecordingFault(TIME, (), factor, 0.0, prior, words) for factor, prior, words in _TIMES]


SCALE, OFFSET, DELAY, DRIFT = "scale", "offset", "delay", "drift"


@dataclass(frozen=True)
class Cause:
    """A small deviation of one channel, of a device or of a clock.

    Attributes:
        kind: ``SCALE``, ``OFFSET``, ``DELAY`` or ``DRIFT``.
        signals: The signals concerned: those of one channel, of several of one device, or of one clock.
        value, std: Factor minus 1, SI units, s, or s over the recording, with the standard error.
        doubt: Standard deviation of the value with what every channel may be off without a fault.
        posterior: Its probability among the candidate causes.
        clock: Which clock drifts or is late as a whole; -1 for a channel.
        rivals: What may be in its place, the most probable first; nothing at all is an empty one.
    """

    kind: str
    signals: tuple[str, ...]
    value: float
    std: float
    doubt: float
    posterior: float
    clock: int = -1
    rivals: tuple[tuple[Cause, ...], ...] = ()


def corrected(causes: Sequence[Cause], smoothed: SmoothedSignals) -> SmoothedSignals:
    """Return signals without the causes."""
    signals = dict(smoothed.signals)
    for cause in causes:
        for name in cause.signals:
            if cause.kind == SCALE:
                signals[name] = signals[name] / (1 + cause.value)
            elif cause.kind == OFFSET:
                signals[name] = signals[name] - cause.value
            else:
                place = np.arange(len(signals[name]))
                drifted = 1.0 if cause.kind == DELAY else (place - place.mean()) / np.ptp(place)
                signals[name] = np.interp(
                    place + cause.value * drifted / smoothed.step, place, signals[name], left=np.nan, right=np.nan
                )
    return SmoothedSignals(signals, smoothed.step, smoothed.origins)
