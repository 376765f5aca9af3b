"""Examination of a recording: comparisons of its signals, the faults that explain them, and small deviations.

``recording_warnings`` states it in sentences, before a fit or a trace attributes it to the vehicle.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
import xarray as xr

from harness.common.arrays import Floats
from harness.common.units import scale
from harness.models.effects._gravity import GRAVITY
from harness.models.quantities import listed, print_unit
from harness.models.signals import SIGNALS
from harness.recordings.check.axle_curves import signals_of
from harness.recordings.check.calibration import causes
from harness.recordings.check.causes import DELAY, DRIFT, EXCHANGED, SCALE, TIME, Cause, RecordingFault
from harness.recordings.check.explain import FaultHypothesis, FaultSearch
from harness.recordings.check.remedy import SURE, worth_mending
from harness.recordings.motion.consistency import AGREES, DISAGREES, Origin, SmoothedSignals, check, compare
from harness.recordings.motion.pair_fit import Agreement
from harness.recordings.motion.pose import unsigned_stretches

_PLACE = ("position_x", "position_y")
_WHEEL = 0.1
"""Largest share by which a wheel radius is off."""
_SINGLE = {"sign": "a wrong sign", "scale": "one factor", "offset": "one offset", "delay": "one delay"}
_SHOWN = 3
"""Stretches of a recording that are stated."""
_NEAR = 1.0
"""m/s^2; difference from gravity up to which an acceleration contains it."""
_HORIZONTAL = ("lateral_acceleration", "longitudinal_acceleration")
_LIKELY = 0.8
"""Probability up to which a fault or cause is neither stated nor mended that nothing at all may be in place of."""
_CERTAIN = 0.95
"""Probability from which a cause is stated without it."""


@dataclass(frozen=True)
class Finding:
    """A fault or deviation of a recording.

    Attributes:
        kind: Of fault or cause: ``unit``, ``sign``, ``exchanged``, ``heading``, ``time``, ``scale``, ``offset``,
            ``delay``, ``drift``, ``still``, ``reverse``, ``mounting`` or ``unexplained``.
        signals: The signals concerned.
        words: What is wrong, with the probability where there are others.
        evidence: The comparisons that say so.
        mends: Whether lines of the map mend it: not what is unsure, or changes nothing for the better.
        rivals: The signals of what may be in its place; empty: nothing.
        value, std: Of a scale (factor minus 1), offset (SI units), delay or drift (s), with its standard error; NaN for
            all else.
    """

    kind: str
    signals: tuple[str, ...]
    words: str
    evidence: str
    mends: bool = True
    rivals: tuple[tuple[str, ...], ...] = ()
    value: float = np.nan
    std: float = np.nan

    def __str__(self) -> str:
        return f"{self.words} ({self.evidence})" if self.evidence else self.words


@dataclass(frozen=True)
class Examination:
    """Comparisons of the signals of a recording and their explanation.

    Attributes:
        fits: Comparisons of its signals as the map reads them.
        hypotheses: Sets of faults of the catalogue, the most probable first.
        causes: Small deviations once the faults of the first hypothesis are mended, as far as they are sure and the
            comparisons agree better without them.
        mended: Comparisons without those faults.
        findings: All of it in words.
    """

    fits: tuple[Agreement, ...]
    hypotheses: tuple[FaultHypothesis, ...]
    causes: tuple[Cause, ...]
    mended: tuple[Agreement, ...]
    findings: tuple[Finding, ...]

    @property
    def faults(self) -> tuple[RecordingFault, ...]:
        """The most probable faults of the catalogue, those that are sure: of two that explain alike none is mended."""
        return tuple(f for f in self.hypotheses[0].faults if _probability(f, self.hypotheses) > SURE)


def examine(
    recording: xr.Dataset, scales: Mapping[str, float] | None = None, clocks: Mapping[str, int] | None = None
) -> Examination:
    """Compare the signals of a recording with each other, and explain what does not agree.

    Args:
        recording: As ``load_recording`` returns it.
        scales: SI units per unit of the channel by signal, as the map has it; to tell exchanged channels from units.
        clocks: Number of the clock by signal, where there are several.
    """
    signals = signals_of(recording)
    time = recording["time"].to_numpy()
    step = float(time[1] - time[0])
    derived = [n for n in signals if recording[n].attrs.get("derived") and not ("latitude" in signals and n in _PLACE)]
    origins = _origins(recording, clocks or {})
    fits = check(signals, step, derived, origins)
    if backwards := _backwards(signals, step):  # what else there is shows once the speed has its sign
        return Examination(tuple(fits), (FaultHypothesis((), 1.0),), (), tuple(fits), tuple(backwards))
    dead = [*_dead(signals, fits), *_upright(signals)]
    measured = {n: v for n, v in signals.items() if n in SIGNALS and n not in derived and n not in dead}
    twins = _twins(recording, measured)
    search = FaultSearch(measured, step, scales or {}, twins)
    hypotheses = sorted(search.best(), key=lambda h: bool(h.faults) or h.posterior < 1 - _LIKELY)  # nothing first
    faults = hypotheses[0].faults
    forms, factor = search.mended.forms(faults)
    smoothed = SmoothedSignals({n: search.mended.values(form) for n, form in forms.items()}, step * factor, origins)
    after = fits
    if faults:
        after = [compare(relation, smoothed) for relation in search.relations]
    elif dead:
        after = [f for f in fits if not set(dead) & set(f.relation.signals)]
    small = [c for c in causes(after, smoothed, twins) if c.posterior > _LIKELY or () not in c.rivals[:1]]
    doubtful = any(_probability(f, hypotheses) <= SURE for f in faults)  # what is small depends on them
    worth = [] if doubtful else worth_mending(small, after, smoothed)
    if 0 < len(worth) < len(small):  # what is not mended must not shift what is
        alone = {(c.kind, c.signals): c for c in causes(after, smoothed, twins, worth)}
        own = {c: alone.get((c.kind, c.signals), c) for c in worth}
        own = {c: replace(c, value=a.value, std=a.std, doubt=a.doubt) for c, a in own.items()}
        small, worth = [own.get(c, c) for c in small], list(own.values())
    findings = [
        _mounted(n, signals[n])
        if n in _upright(signals)
        else Finding("still", (n,), f"{n}: never changes", _evidence(fits, (n,)), mends=False)
        for n in dead
    ]
    findings += _findings(fits, hypotheses, small, worth, after)
    return Examination(tuple(fits), tuple(hypotheses), tuple(worth), tuple(after), tuple(findings))


def _dead(signals: Mapping[str, Floats], fits: list[Agreement]) -> list[str]:
    """Return the signals that never change although they should."""
    names = []
    for fit in fits:
        if "still" in fit.off:
            names += [
                n for n in fit.relation.signals if n not in names and np.ptp(signals[n][np.isfinite(signals[n])]) == 0
            ]
    return names


def _upright(signals: Mapping[str, Floats]) -> list[str]:
    """Return the horizontal accelerations that hold all of gravity."""
    names = []
    for name, values in signals.items():
        finite = values[np.isfinite(values)]
        if name.startswith(_HORIZONTAL) and finite.size:
            middle = float(np.median(finite))
            steady = float(np.median(np.abs(finite - middle))) < GRAVITY / 3
            names += [name] if steady and abs(abs(middle) - GRAVITY) < _NEAR else []
    return names


def _mounted(name: str, values: Floats) -> Finding:
    """Return the finding that a sensor is mounted with a horizontal axis upright, with its axes then."""
    mean, axis = float(np.nanmedian(values)), "xy"[name.startswith("lateral")]
    way, other = "up" if mean > 0 else "down", "yx"[name.startswith("lateral")]
    words = (
        f"{name}: holds gravity, {mean:.2f} m/s² in the middle of its values: that axis of the sensor points {way}, so "
        f"that it is the z axis of the vehicle; {axis} is the sensor's z axis, or {other} where it is turned as well: "
        "map the column of that"
    )
    return Finding("mounting", (name,), words, "", mends=False)


def _backwards(signals: Mapping[str, Floats], step: float) -> list[Finding]:
    """Return findings of speeds that have no sign although the vehicle drives backwards."""
    findings = []
    for name, parts in unsigned_stretches(signals, step).items():
        times = [f"{a:.0f} to {b:.0f} s" for a, b in parts]
        more = f" and {len(times) - _SHOWN} times more" if len(times) > _SHOWN else ""
        words = (
            f"{name}: has no sign, and the vehicle drives backwards at {', '.join(times[:_SHOWN])}{more}: the course "
            "over ground is against the heading"
        )
        findings.append(Finding("reverse", (name,), words, ""))
    return findings


def _twins(recording: xr.Dataset, signals: Mapping[str, Floats]) -> dict[str, tuple[str, ...]]:
    """Return all signals of the same channel, by signal."""
    channel = {n: recording[n].attrs.get("channel", n) for n in signals}
    return {n: tuple(o for o in signals if channel[o] == channel[n]) for n in signals}


def _origins(recording: xr.Dataset, clocks: Mapping[str, int]) -> dict[str, Origin]:
    """Return where each signal comes from; positions come from where latitude and longitude do."""
    origins = {}
    for name in map(str, recording.data_vars):
        source = recording["latitude"] if name in _PLACE and "latitude" in recording else recording[name]
        about = source.attrs
        origins[name] = Origin(
            str(about.get("channel", name)), float(about.get("rate", np.nan)), clocks.get(name, 0),
            float(about.get("delay", 0.0)),
        )  # fmt: skip
    return origins


def _probability(fault: RecordingFault, hypotheses: Sequence[FaultHypothesis]) -> float:
    """Return how probable a fault of the catalogue is, by all hypotheses that have it."""
    return sum(h.posterior for h in hypotheses if fault in h.faults)


def _findings(
    fits: list[Agreement],
    hypotheses: list[FaultHypothesis],
    small: list[Cause],
    worth: list[Cause],
    after: list[Agreement],
) -> list[Finding]:
    """Return the findings of an examination in words."""
    best, others = hypotheses[0], hypotheses[1:]
    findings = []
    for fault in best.faults:
        sure = _probability(fault, hypotheses)
        explanations = [h.faults for h in others if fault not in h.faults][:2]
        rivals = [" with ".join(map(described, faults)) or "nothing of the catalogue" for faults in explanations]
        words = described(fault) + (f", {sure:.0%} sure; or {' or '.join(rivals)}" if rivals else "")
        words += "" if sure > SURE else "; not mended"
        findings.append(Finding(fault.kind, fault.signals, words, _evidence(fits, fault.signals), sure > SURE))
    for cause in small:
        words = _off(cause) + _doubt(cause) + ("" if cause in worth else "; not mended")
        evidence = _evidence(after, cause.signals)
        instead = tuple(tuple(n for c in rival for n in c.signals) for rival in cause.rivals)
        findings.append(
            Finding(cause.kind, cause.signals, words, evidence, cause in worth, instead, cause.value, cause.std)
        )
    explained = {n for f in findings for n in f.signals}
    for fit in after:
        if fit.verdict == DISAGREES and not explained & set(fit.relation.signals):
            words = f"{fit.name}: {', '.join(fit.reasons)}; {_open(fit)}"
            evidence = fit.evidence if np.isfinite(fit.slope) else ""
            findings.append(Finding("unexplained", fit.relation.signals, words, evidence, mends=False))
    return findings


def _open(fit: Agreement) -> str:
    """Return the single fault that explains a comparison alone, where none explains it together with the others."""
    single = [name for kind, name in _SINGLE.items() if fit.off == {kind}]
    if single:
        return f"{single[0]} of either side explains it, and the other comparisons do not say of which"
    return "no single wrong unit, sign, scale or delay explains it"


def described(fault: RecordingFault) -> str:
    """Return a fault of the catalogue in words."""
    if fault.kind == TIME:
        return f"time: in {fault.words}"
    if fault.kind == EXCHANGED:
        return f"{' and '.join(fault.signals)}: {fault.words}"
    verb = "" if fault.kind in ("sign", "heading") else "in "
    return f"{listed(fault.signals)}: {verb}{fault.words}"


def _evidence(fits: list[Agreement], signals: tuple[str, ...]) -> str:
    """Return the comparisons in which some signals show, those that disagree first; of the time all count."""
    concerned = [f for f in fits if not signals or set(signals) & set(f.relation.signals)]
    ranked = sorted(concerned, key=lambda f: (f.verdict != DISAGREES, not f.relation.exact))
    shown = [f for f in ranked[:2] if f.verdict != AGREES or len(concerned) < 2]
    return "; ".join(f"{f.name}: {', '.join(f.reasons) or f.evidence}" for f in shown)


def _doubt(cause: Cause) -> str:
    """Return the probability of a cause and its rivals in words."""
    if cause.posterior >= _CERTAIN:
        return ""
    rivals = [" with ".join(map(_off, rival)) or "nothing" for rival in cause.rivals[:2]]
    return f", {cause.posterior:.0%} sure" + (f"; or {', or '.join(rivals)}" if rivals else "")


def _off(cause: Cause) -> str:
    """Return a small deviation in words."""
    names = listed(cause.signals)
    if cause.clock >= 0:
        names = f"the clock of {names}, against the other"
    size = abs(cause.value)
    if cause.kind == SCALE:
        wheel = ", such as by the wheel radius" if cause.signals[0].startswith("speed") and size < _WHEEL else ""
        way = "much" if cause.value > 0 else "little"
        return f"{names}: reads {100 * size:.2f} ± {100 * cause.std:.2f} % too {way}{wheel}"
    if cause.kind == DELAY:
        return f"{names}: {size * 1e3:.1f} ± {cause.std * 1e3:.1f} ms {'late' if cause.value > 0 else 'early'}"
    if cause.kind == DRIFT:
        gained = f"{cause.value * 1e3:.1f} ± {cause.std * 1e3:.1f} ms"
        return f"{names}: drifts, {gained} later at the end than at the beginning"
    signal = SIGNALS[cause.signals[0]]
    shown = 1 / scale(signal.report_unit, signal.unit, signal.name)
    value = f"{cause.value * shown:.3g} ± {cause.std * shown:.2g} {print_unit(signal.report_unit)}"
    return f"{names}: offset of {value}; a bias, the mounting, or the road"


SLOW = 1.5
"""m/s; below it slip angles lose their meaning, and the equations of the vehicles go on as if it were no less."""

_BACKWARDS = -0.2
"""m/s; anything slower is reversing and not the noise of a sensor at standstill."""


def recording_warnings(recordings: Sequence[xr.Dataset]) -> tuple[str, ...]:
    """Return the irregularities found in reading and comparing the signals of recordings, each with the evidence.

    What is the same of several recordings is said once, of all of them.
    """
    recordings_by_warning: dict[str, list[str]] = {}
    for recording in recordings:
        findings = [str(f) for f in examine(recording).findings]
        for warning in (*recording.attrs.get("warnings", ()), *findings, *_slow(recording)):
            names = recordings_by_warning.setdefault(warning, [])
            names += [recording.attrs["name"]] if recording.attrs["name"] not in names else []
    return tuple(f"{listed(names)}: {warning}" for warning, names in recordings_by_warning.items())


def _slow(recording: xr.Dataset) -> list[str]:
    """Return for how long the vehicle stands, crawls or reverses, where the equations of no vehicle hold."""
    speeds = [n for n in ("speed", "longitudinal_velocity") if n in recording]
    if not speeds:
        return []
    time, speed = recording["time"].to_numpy(), recording[speeds[0]].to_numpy()
    sentences = []
    for limit, does in ((SLOW, f"is slower than {SLOW:g} m/s"), (_BACKWARDS, "drives backwards")):
        there = np.flatnonzero(speed < limit)
        if there.size:
            share, first = 100 * there.size / speed.size, time[there[0]] - time[0]
            rounded = f"{share:.0f}" if share >= 10 else f"{share:.2g}"
            sentences.append(
                f"'{speeds[0]}': the vehicle {does} at {rounded} % of the samples, first {first:.2f} s after the "
                f"start; no equations of slip hold there, so leave that part out"
            )
    return sentences
