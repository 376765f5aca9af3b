"""What came of a trust monitor, in sentences for report, header and command line."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace

from harness.config import StudySpec
from harness.models.quantities import listed, words
from harness.remedy.monitor.counts import per_hour
from harness.remedy.monitor.outcome import Counted, Level
from harness.remedy.monitor.sensors import LITTLE, ParameterInformation
from harness.reporting.style import number, percent
from harness.study.report.sections.trust import beyond, share
from harness.study.trust_file import OFTEN


def sentences(counted: Counted) -> list[str]:
    """Return how often the monitor is right: alarms as believed, levels with errors, and what is not seen."""
    lines = [_false_alarms(counted)]
    for t in range(len(counted.targets)):
        lines += _detections(counted, t)
    return [*lines, *_blind(counted), *_unvaried(counted)]


def _false_alarms(counted: Counted) -> str:
    if not counted.kept:
        return "No run as believed that its bounds are not from keeps the limits: its false alarms are not known."
    rate, alarms, hours = per_hour(counted.kept[0], counted.monitor.step)
    return (
        f"Where all is as believed and the limits are kept the monitor gives {number(rate.value, 2)} alarms an hour "
        f"({number(rate.lower, 2)} to {number(rate.upper, 2)}; {alarms} in {number(hours)} h that its bounds are not "
        f"from), for {counted.asked.per_hour:g} allowed."
    )


def speaks(level: Level, t: int) -> bool:
    """Whether there are errors of a target at a level that are worth a word."""
    return level.counts[t].wrong_share >= OFTEN


def called(counted: Counted, level: Level) -> str:
    """Return the label of a level, with its design where there are several."""
    several = len({each.design for each in counted.levels}) > 1
    return f"{level.label} ({level.design})" if several else level.label


def valued(study: StudySpec, design: str, label: str) -> str:
    """Return the label of a level behind the name of what it is a value of; of several parameters their number."""
    factors = next(d.factors for d in study.designs if d.name == design)
    if not factors or not label.lstrip("+-−±×")[:1].isdigit():
        return label
    return f"{words(factors[0].parameter) if len(factors) == 1 else f'{len(factors)} parameters'} {label}"


def named(counted: Counted, levels: Sequence[Level]) -> list[str]:
    """Return what levels are called; the first of each design behind the name of what it is a value of."""
    first = {level.design: level for level in reversed(levels)}
    return [
        called(counted, replace(level, label=valued(counted.study, level.design, level.label)))
        if first[level.design] is level
        else called(counted, level)
        for level in levels
    ]


def wrong_by(counted: Counted, t: int) -> str:
    """Say that a target is wrong."""
    return beyond(counted.targets[t], counted.asked.limits[counted.targets[t]])


def _detections(counted: Counted, t: int) -> list[str]:
    """Say of a target what the monitor says at the worst level, and in short at the others."""
    levels = [level for level in counted.levels if speaks(level, t)]
    if not levels:
        return [f"At no level {wrong_by(counted, t)} in {percent(OFTEN)} of the samples."]
    of_first = [level for level in levels if level.design == levels[0].design]
    first = max(of_first, key=lambda level: level.counts[t].wrong_share)
    counts, within = first.counts[t], f"{counted.asked.within:g} s"
    kept = f", {share(counted.kept[t].false_share)} in runs that keep the limits" if counted.kept else ""
    text = (
        f"At {named(counted, [first])[0]} {wrong_by(counted, t)} in {percent(counts.wrong_share)} of the samples; the "
        f"monitor says so in {share(counts.said_share)} of these within {within}, and in "
        f"{share(counted.believed[t].false_share)} of those without such an error where all is as believed{kept}."
    )
    further = [level for level in levels if level is not first]
    others = [
        f"{name}: {percent(level.counts[t].wrong_share)}, {share(level.counts[t].said_share)}"
        for name, level in zip(named(counted, further), further, strict=True)
    ]
    return [text, f"Likewise wrong, and said of these: {'; '.join(others)}."] if others else [text]


def _blind(counted: Counted) -> Iterator[str]:
    """Say where the innovations do not show an error, and which sensor could."""
    for t in range(len(counted.targets)):
        levels = [level for level in counted.levels if level.is_blind(t)]
        if not levels:
            continue
        names = listed(named(counted, levels))
        largest = max(level.areas[t].value for level in levels)
        yield (
            f"At {names} the innovations hardly show that {wrong_by(counted, t)}: they tell a sample in error from one "
            f"without with an area under the curve of {number(largest, 2)} at most, where 0.5 is guessing."
        )
    yield from (_could(each) for each in counted.information)


def _unvaried(counted: Counted) -> Iterator[str]:
    """Say which inputs no run changes, so that on a vehicle, where they do change, there is no level 0."""
    names = [words(name) for name, rates in counted.monitor.rates.items() if rates == (0.0, 0.0)]
    if names:
        verbs = ("changes", "it does") if len(names) == 1 else ("change", "they do")
        yield (
            f"The {listed(names)} never {verbs[0]} within these runs: where {verbs[1]}, the level is 1 at least; "
            "drives that vary what a vehicle varies are needed for level 0 there."
        )


def _could(information: ParameterInformation) -> str:
    """Say what measurements tell of a parameter at best."""
    name, own = words(information.parameter), percent(information.own)
    others = [
        f"{what.replace(', ', ' with ')} ({percent(share)})" for what, share in list(information.others.items())[:2]
    ]
    rest = f"; measured in addition could: {listed(others)}" if others else "; no set of sensors does better"
    if information.own > LITTLE:
        return (
            f"No monitor of these innovations can tell the {name}: at the end of a drive at best {own} of its "
            f"deviation remain unknown to anything that has these measurements (Fisher information){rest}."
        )
    return (
        f"The measurements do tell the {name} (a drive leaves {own} of its deviation at best), but not by the size or "
        f"the bias of innovations: estimate it, as harness remedy tries{rest if others else ''}."
    )


def in_short(counted: Counted) -> list[str]:
    """Return the result in a few sentences: false alarms, the worst level of each target, and what is not seen."""
    worst = [_detections(counted, t)[0] for t in range(len(counted.targets))]
    return [_false_alarms(counted), *worst, *_blind(counted), *_unvaried(counted)]
