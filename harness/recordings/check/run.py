"""``harness check``: read a recording, examine it, and prove the lines that mend its map."""

from __future__ import annotations

import os
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import xarray as xr

from harness.common.errors import UserError
from harness.config.parameter_set import load_set
from harness.recordings import readers
from harness.recordings.check import remedy
from harness.recordings.check.axle_curves import AxleCurve, axles_of
from harness.recordings.check.causes import DELAY, DRIFT
from harness.recordings.check.examine import Examination, Finding, examine
from harness.recordings.check.mounting import mounted
from harness.recordings.check.remedy import FitError, spoils
from harness.recordings.motion.consistency import DISAGREES, DelayUnknown, verdicts
from harness.recordings.motion.pair_fit import Agreement
from harness.recordings.read.channel_map import ESTIMATE, load_map, located, map_content
from harness.recordings.read.channels import plain_map
from harness.recordings.read.file_units import content_with_file_units
from harness.recordings.read.in_memory import name_of, tables_of
from harness.recordings.read.load import recording_of
from harness.recordings.read.span import Span, named_parts, part_of
from harness.recordings.readers import Table

__all__ = ["CheckResult", "MapRemedy", "check_recording", "check_tables"]

_ROUNDS = 3
"""Times that a mended map is examined again: a large fault hides a small one."""

_ABSURD = 30.0
"""Factor between the step that a map wants and that of the samples beyond which one of them is in a wrong unit."""


_Examined = tuple[xr.Dataset, Examination, frozenset[str]]
"""A recording by some map, its examination, and the signals whose delay the map asked to estimate."""


@dataclass(frozen=True)
class MapRemedy:
    """A channel map that mends what was found, and what it comes to.

    Attributes:
        content: The whole map.
        lines: Its lines that are others than before.
        fits: Comparisons of the recording as the mended map reads it.
    """

    content: dict[str, Any]
    lines: tuple[str, ...]
    fits: tuple[Agreement, ...]

    @property
    def passes(self) -> bool:
        """Whether nothing disagrees any more."""
        return all(f.verdict != DISAGREES for f in self.fits)


@dataclass(frozen=True)
class CheckResult:
    """Result of a check.

    Attributes:
        recording: As ``load_recording`` returns it.
        examination: Comparisons of its signals, and what explains them.
        findings: What is wrong, the largest first.
        remedy: The lines that mend the map; None if there is nothing to mend.
        axles: Lateral force over load against slip angle, if the parameters of the car were given.
    """

    recording: xr.Dataset
    examination: Examination
    findings: tuple[Finding, ...]
    remedy: MapRemedy | None = None
    axles: list[AxleCurve] = field(default_factory=list)

    @property
    def fits(self) -> tuple[Agreement, ...]:
        """Comparisons of signals with what the others make of them."""
        return self.examination.fits

    @property
    def summary(self) -> str:
        """How many comparisons agree, do not, or could not be judged."""
        return verdicts(self.fits)

    @property
    def sentences(self) -> list[str]:
        """The answer: what was compared, and what the mended map comes to."""
        sentences = [f"{self.summary}."]
        if self.remedy is not None:
            after = self.remedy.fits
            wrong = sum(f.verdict == DISAGREES for f in after)
            before = any(f.verdict == DISAGREES for f in self.fits)
            rest = "nothing disagrees any more" if before else "nothing disagrees either"
            if wrong:
                rest = f"{wrong} {'still ' if before else ''}do{'es' if wrong == 1 else ''} not agree"
            sentences.append(f"With the lines below {rest}: {verdicts(after)}.")
        return sentences

    @property
    def warnings(self) -> list[str]:
        """All irregularities, with the evidence."""
        return [*self.recording.attrs["warnings"], *(str(f) for f in self.findings)]


def check_recording(
    source: str | os.PathLike[str] | pd.DataFrame | xr.Dataset,
    channels: str | Path | Mapping[str, Any] | None = None,
    parameters: str | None = None,
    fit_error: FitError | None = None,
    databases: Sequence[str] = (),
) -> CheckResult:
    """Read a recording and compare its signals with each other.

    Args:
        source: Recording as ``load_recording`` takes it.
        channels: Channel map, if its columns are no signals in SI units.
        parameters: Parameter set or parameter file of a car, for the curves of its axles.
        fit_error: Of the nominal model, by which each line of the mended map is tried.
        databases: Of the messages of a bus log, each as ``[BUS=]FILE``; those of the channel map by default.

    Raises:
        UserError: If anything cannot be read.
        ModelError: If there is no such parameter set.
    """
    path = span = content = None
    if isinstance(source, str | os.PathLike):
        path, own_map, span = named_parts(source)
        channels = own_map or channels
    if channels is not None:
        mapping = load_map(channels)  # names the file in its messages
        stated = {"database": [located(each, Path()) for each in databases]} if databases else {}
        own = mapping.databases if path is not None and readers.takes_databases(path) else ()
        content, databases = {**map_content(channels), **stated}, databases or own
    if path is not None:
        tables, name = readers.read_tables(path, databases=databases), str(path)
    else:
        assert not isinstance(source, str | os.PathLike)
        tables, name = tables_of(source, channels is not None), name_of(source)
    return _with_axles(check_tables(tables, name, content, span, fit_error), parameters)


def _with_axles(result: CheckResult, parameters: str | None) -> CheckResult:
    """Return a result with the axle curves, if the parameters of a car are given and its motion is recorded."""
    if parameters is None:
        return result
    values = load_set(parameters, Path(), "--parameters").values
    try:
        return replace(result, axles=axles_of([result.recording], values, f"--parameters {parameters}"))
    except UserError as error:
        result.recording.attrs["warnings"].append(f"no curves of the axles: {error}")
        return result


def check_tables(
    tables: list[Table],
    file: str,
    content: Mapping[str, Any] | None = None,
    span: Span | None = None,
    fit_error: FitError | None = None,
) -> CheckResult:
    """Compare the signals of what a reader returned with each other.

    Args:
        tables: One per clock.
        file: Where they come from.
        content: Channel map.
        span: Part that is compared; all of it if None.
        fit_error: Of the nominal model, by which each line of the mended map is tried.

    Raises:
        UserError: If tables and map do not fit each other.
    """
    given = remedy.content_of(plain_map(tables, file)) if content is None else remedy.listed(content)
    given = content_with_file_units(given, tables)
    recording, examination, _ = _examined(tables, file, given, span)
    findings = list(examination.findings)
    after, last = given, examination
    mended: MapRemedy | None = None
    if content is not None and (turned := mounted(tables, given, file)) is not None:
        after, finding = turned
        _, last, _ = _examined(tables, file, after, span)
        mended = MapRemedy(after, tuple(remedy.lines(given, after)), last.fits)
        findings = [finding, *last.findings]
    for _ in range(_ROUNDS):
        better = _mended(tables, after, last, recording)
        if better == after:
            break
        after = better
        try:
            _, last, estimated = _examined(tables, file, after, span)
        except UserError:
            break
        mended = MapRemedy(after, tuple(remedy.lines(given, after)), last.fits)
        findings = [f for f in findings if f.mends and not (f.kind == DELAY and estimated & set(f.signals))]
        findings += last.findings
    first = {(f.kind, f.signals): f for f in reversed(findings)}  # of each kind and signals
    result = CheckResult(recording, examination, tuple(reversed(first.values())), mended)
    if mended is None or fit_error is None:
        return result
    return tried_by_fit(result, given, lambda c: _examined(tables, file, c, span), fit_error)


def tried_by_fit(
    result: CheckResult,
    given: Mapping[str, Any],
    examined: Callable[[dict[str, Any]], _Examined],
    fit_error: FitError,
) -> CheckResult:
    """Withdraw the lines of the mended map with which the nominal model fits worse than without them.

    Args:
        result: With a mended map.
        given: The map as it was.
        examined: Reads and examines the recording by a map.
        fit_error: Of the nominal model.
    """
    assert result.remedy is not None
    content = result.remedy.content
    warnings = result.recording.attrs["warnings"]
    try:
        reached = fit_error(examined(content)[0])
    except UserError as error:
        warnings.append(f"the mended map was not tried by a fit of the nominal model: {error}")
        return result
    judged = []
    for finding in result.findings:
        without = _without(content, given, finding) if finding.mends else content
        try:
            alone = reached if without == content else fit_error(examined(without)[0])
        except UserError:  # that map cannot even be fitted
            alone = reached
        if spoils(reached, alone):
            times = np.sqrt(np.nanmean(reached) / np.nanmean(alone))
            words = f"{finding.words}; not mended: the error of the fitted nominal model would be {times:.2g} times"
            finding = replace(finding, words=f"{words} what it is without", mends=False)
            content, reached = without, alone
        judged.append(finding)
    mended = None
    if content != given:
        mended = MapRemedy(content, tuple(remedy.lines(given, content)), examined(content)[1].fits)
    return replace(result, findings=tuple(judged), remedy=mended)


def _without(content: dict[str, Any], given: Mapping[str, Any], finding: Finding) -> dict[str, Any]:
    """Return a map with the given lines in place of those that mend a finding: of its signals, or of the clocks."""
    keys = {n for n in finding.signals if content.get(n) != given.get(n)}
    if not keys and finding.kind in (DELAY, DRIFT):
        keys = {"time"}
    return {k: given.get(k, v) if k in keys else v for k, v in content.items()}


def _examined(tables: list[Table], file: str, content: Mapping[str, Any], span: Span | None) -> _Examined:
    """Read a recording and examine it; return the signals as well whose delay was estimated.

    What they are late by is what the map asks for, and no fault. If one cannot be estimated, as another fault hides it,
    all are taken as none, with a warning.
    """
    step, estimated = _finest(tables, content), _to_be_estimated(content)
    try:
        recording = recording_of(tables, file, content, step)
    except DelayUnknown as error:
        plain = {k: {**v, "delay": 0.0} if k in estimated else v for k, v in content.items()}
        estimated = frozenset()
        recording = recording_of(tables, file, plain, step)
        recording.attrs["warnings"].append(f"{error}; taken as 0")
    recording = recording if span is None else part_of(recording, span, file)
    place = {c: n for n, table in enumerate(tables) for c in table.columns}
    channels = {c.signal: c for c in load_map(content).channels}
    clocks = {name: place[c.channel] for name, c in channels.items()}
    clocks |= {p: clocks["latitude"] for p in ("position_x", "position_y") if "latitude" in clocks and p not in clocks}
    return recording, examine(recording, {name: c.scale for name, c in channels.items()}, clocks), estimated


def _to_be_estimated(content: Mapping[str, Any]) -> frozenset[str]:
    return frozenset(k for k, v in content.items() if isinstance(v, dict) and v.get("delay") == ESTIMATE)


def _finest(tables: list[Table], content: Mapping[str, Any]) -> float | None:
    """Return the step of the fastest of several clocks, in s; None where the map states one, or there is one clock.

    A step that is stated does not hold if no unit of time could be right with it.
    """
    mapping = load_map(content)
    used = {c.channel for c in mapping.channels}
    steps = []
    for table in tables:
        clock = next((c for c in mapping.clocks if c in table.columns), table.clock)
        if clock is not None and used & set(table.columns) and len(table.columns[clock]) > 2:
            steps.append(mapping.clocks.get(clock, (1.0,))[0] * float(np.nanmedian(np.diff(table.columns[clock]))))
    finest = min((s for s in steps if s > 0), default=0.0)
    if finest == 0.0:
        return None
    if np.isfinite(mapping.step):
        return finest if not 1 / _ABSURD < mapping.step / finest < _ABSURD else None
    return finest if len(steps) > 1 else None


def _mended(
    tables: list[Table], content: Mapping[str, Any], examination: Examination, recording: xr.Dataset
) -> dict[str, Any]:
    """Return the map without what was found wrong."""
    clocks = load_map(content).clocks
    named = {n: next((c for c in clocks if c in t.columns), "") for n, t in enumerate(tables)}
    causes = [c for c in examination.causes if not (c.kind == DELAY and _to_be_estimated(content) & set(c.signals))]
    duration = float(recording["time"][-1])
    signed = [n for f in examination.findings if f.kind == "reverse" for n in f.signals]
    return remedy.mended(content, examination.faults, causes, named, duration, signed)
