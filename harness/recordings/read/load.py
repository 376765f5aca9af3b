"""Measured drives, from a file or in memory, and their channel map onto one time base."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import xarray as xr
from numpy.typing import NDArray

from harness.common.arrays import Floats, Mask
from harness.common.errors import UserError
from harness.common.registry import closest
from harness.models.signals import SIGNALS, TRUTH, signal_attributes
from harness.recordings import readers
from harness.recordings.motion.consistency import find_delay
from harness.recordings.motion.kinematics import DERIVED, Sources
from harness.recordings.motion.pose import COURSE, NEEDS, backwards, continued, tangent_plane
from harness.recordings.read.axes import in_vehicle_axes
from harness.recordings.read.channel_map import ChannelMap, load_map
from harness.recordings.read.channels import Raw, collect, plain_map, to_reference_point, validity
from harness.recordings.read.clock import Clock
from harness.recordings.read.file_units import with_file_units
from harness.recordings.read.in_memory import name_of, tables_of
from harness.recordings.read.origin import origin_of
from harness.recordings.read.resample import first_order_lag, onto_grid, updated_on_grid
from harness.recordings.read.span import named_parts, part_of

_END = 1.0
"""s that may be cut from either end where not every signal is there yet, or still."""
_COARSER = 10.0
"""Samples of another signal that one of the first is worth, from which on that is said."""
_LONGEST = 20_000_000
"""Samples; a time base beyond it comes from a stamp that jumped."""


def load_recording(
    source: str | os.PathLike[str] | pd.DataFrame | xr.Dataset,
    channels: str | Path | Mapping[str, Any] | None = None,
    step: float | None = None,
    name: str | None = None,
    databases: Sequence[str] = (),
) -> xr.Dataset:
    """Bring a measured drive onto one time base.

    Args:
        source: A file of a known format, or a folder with one signal per file. ``lap.csv@20s:200s`` is that part of it,
            from the first sample; an end that is left out is that of the file. ``lap.csv@map.toml`` is read by a map of
            its own. Or data in memory, see ``in_memory.tables_of``.
        channels: Channel map: a file or its content. Without one the columns must carry the names of
            ``models/signals.py``, in SI units, and the clock the name ``time``.
        step: Step of the common time base in s, in place of that of the channel map.
        name: In reports; by default that of the file.
        databases: Of the messages of a bus log, each as ``[BUS=]FILE``; those of the channel map by default.

    Returns:
        Dataset over ``time`` (s, equidistant, from 0) with a variable per signal, NaN in gaps. Attributes of a
        variable: ``units``, ``long_name``, ``frame``, ``derived`` (1 if computed from others), ``rate`` (Hz at which
        new samples came), ``channel``, ``held``, ``gaps``, ``longest_gap`` (s), ``missing`` (rows),
        ``missing_share``, ``spikes``, ``delay`` and ``delay_std`` (s), ``point``, ``includes_gravity``. Where not every
        sample was measured, the coordinate ``updated_<signal>`` says which were; the others are joined. Attributes of
        the dataset: ``title``, ``source``, ``file``, ``origin`` (how it was read, as JSON text), ``reference``,
        ``start`` (first stamp in s), ``warnings`` (list of sentences), ``name``, of a part ``span`` (begin and end in
        s), and where the format says when its clock was zero ``begun`` (s since 1970).

    Raises:
        UserError: If source or map cannot be read, or do not fit each other; with file, key or column, and remedy.
    """
    mapping = None if channels is None else load_map(channels)
    if not isinstance(source, str | os.PathLike):
        tables, name = tables_of(source, mapping is not None), name or name_of(source)
        return recording_of(tables, name, mapping, step).assign_attrs(name=name)
    file, own_map, span = named_parts(source)
    mapping = mapping if own_map is None else load_map(own_map)
    recording = recording_of(_tables(file, mapping, databases), os.fspath(file), mapping, step)
    if span is not None:
        recording = part_of(recording, span, os.fspath(source))
    origin = origin_of(source, file, channels, step, databases)
    return recording.assign_attrs(name=name or Path(source).name.split(".")[0], **origin)


def _tables(file: Path, mapping: ChannelMap | None, databases: Sequence[str]) -> list[readers.Table]:
    """Return the columns that a map names, or signals are named after; all where one is missing, which errors list."""
    if mapping is None:
        return readers.read_tables(file, lambda name: name.removeprefix(TRUTH) in SIGNALS, databases)
    databases = databases or (mapping.databases if readers.takes_databases(file) else ())  # a map serves several files
    named = {c.channel for c in mapping.channels}
    gears = {c.reverse for c in mapping.channels if c.reverse not in ("", COURSE)}
    flags = {validity(c)[0] for c in mapping.channels if c.valid}
    clocks = set(mapping.clocks) | {column for column, _ in mapping.added.values()}
    clocks |= {name for unit in mapping.mounting for name in (*unit.acceleration, *unit.angular_velocity)}
    tables = readers.read_tables(file, (named | gears | flags | clocks).__contains__, databases)
    complete = named <= {n for t in tables for n in t.columns}
    return tables if complete else readers.read_tables(file, databases=databases)


def recording_of(
    tables: list[readers.Table],
    file: str,
    channels: str | Path | Mapping[str, Any] | ChannelMap | None = None,
    step: float | None = None,
) -> xr.Dataset:
    """Return what a reader returned as a recording, see ``load_recording``.

    Args:
        tables: One per clock.
        file: Where they come from, for errors and reports.
        channels: Channel map: a file or its content.
        step: Step of the common time base in s, in place of that of the channel map.
    """
    if channels is None:
        mapping = plain_map(tables, file)
    else:
        mapping = channels if isinstance(channels, ChannelMap) else load_map(channels)
    if step is not None:
        mapping = replace(mapping, step=step)
    tables = [replace(t, columns=dict(t.columns)) for t in tables]  # their columns are given up
    tables = in_vehicle_axes(tables, mapping, file)
    mapping, disagreements = with_file_units(mapping, tables, file)
    raws, clock = collect(tables, mapping, file)
    raws, turns = _with_turns(raws)
    grid = _grid(raws, clock, mapping, file)
    _refuse_delays(raws, grid, file)
    signals = _onto_grid(raws, grid)
    add_positions(signals)
    step = float(grid[1] - grid[0])
    delays = _estimated_delays(raws, signals, mapping, grid, file)
    to_reference_point(signals, mapping, step)
    _sign_by_course(signals, mapping, step)
    _derive(signals, mapping, step, file)
    covered = _covered(signals, step)
    start = float(grid[covered][0])
    recording = xr.Dataset(
        coords={"time": ("time", grid - start, {"units": "s", "long_name": "time since the first sample"})}
    )
    raw_of = {r.channel.signal: r for r in raws}
    for name, values in signals.items():
        attributes = {**signal_attributes(name.removeprefix(TRUTH)), "rate": 1 / step, "derived": 1}
        if name in raw_of:
            raw = raw_of[name]
            delay, spread = delays.get(name, (raw.channel.delay, 0.0))
            attributes |= _about(raw, delay, spread, mapping)
            new = updated_on_grid(raw.time - delay, grid)
            if not raw.channel.hold and not new[np.isfinite(values)].all():
                recording.coords[f"updated_{name}"] = ("time", new)
        recording[name] = ("time", values, attributes)
    recording.attrs = {
        "title": mapping.title,
        "source": mapping.source,
        "file": file,
        "reference": mapping.reference,
        "start": start,
        "warnings": [
            *(note for table in tables for note in table.notes),
            *clock.warnings,
            *disagreements,
            *(_unknown_turns(gap, start) for gap in turns),
            *_coarse(raws, step, mapping),
            *(w for r in raws for w in _warnings(r, start)),
            *_removed_spikes(raws, start),
            *_unknown_points(mapping),
        ],
    }
    if (begun := next((t.begun for t in tables if t.begun is not None), None)) is not None:
        recording.attrs["begun"] = begun
    return recording.isel(time=covered)


def measurements(recording: xr.Dataset, names: Sequence[str]) -> Floats:
    """Return what an estimator may use as measured: shape ``(samples, signals)``, NaN where nothing new was measured.

    Raises:
        UserError: If the recording lacks a signal.
    """
    columns = []
    for name in names:
        values, new = _signal(recording, name), updated(recording, name)
        columns.append(values if new is None else np.where(new, values, np.nan))
    return np.stack(columns, axis=1)


def inputs(recording: xr.Dataset, names: Sequence[str]) -> Floats:
    """Return what drives a model: shape ``(samples, signals)``, without gaps.

    Raises:
        UserError: If the recording lacks a signal, or a sample of it.
    """
    columns = []
    for name in names:
        values = _signal(recording, name)
        missing = np.flatnonzero(~np.isfinite(values))
        if missing.size:
            raise UserError(
                f"{_file(recording)}: '{name}' drives the model and is missing at {missing.size} of {len(values)} "
                f"samples, first at t = {float(recording['time'][missing[0]]):.2f} s; take a part without a gap, the "
                f"longest is {_longest_part(recording, missing)}, or bridge the gap with a longer largest_gap in the "
                "channel map"
            )
        columns.append(values)
    return np.stack(columns, axis=1)


def _longest_part(recording: xr.Dataset, missing: NDArray[np.intp]) -> str:
    """Return the longest part of a recording without missing samples, as commands take it."""
    edges = np.concatenate(([-1], missing, [recording.sizes["time"]]))
    i = int(np.diff(edges).argmax())
    time = recording["time"].to_numpy() + recording.attrs.get("span", (0.0,))[0]
    begin = f"{time[edges[i] + 1]:g}s"
    return f"{_file(recording)}@{begin}:{f'{time[edges[i + 1]]:g}s' if edges[i + 1] < len(time) else ''}"


def updated(recording: xr.Dataset, name: str) -> Mask | None:
    """Return which samples of a signal were measured ``(samples,)``, where not all were."""
    coordinate = recording.coords.get(f"updated_{name}")
    return None if coordinate is None else np.asarray(coordinate.values, dtype=bool)


def _signal(recording: xr.Dataset, name: str) -> Floats:
    if name not in recording:
        raise UserError(f"{_file(recording)}: the recording lacks '{name}'{closest(name, [str(v) for v in recording])}")
    return np.asarray(recording[name].values, dtype=float)


def _file(recording: xr.Dataset) -> str:
    return str(recording.attrs.get("file", "recording"))


def _grid(raws: list[Raw], clock: Clock, mapping: ChannelMap, file: str) -> Floats:
    """Return the common time base: the stated step or that of the clock, over all that any channel holds."""
    step = mapping.step if np.isfinite(mapping.step) else float(f"{clock.step:.3g}")
    spans = [(r.time[0], r.time[-1]) for r in raws if len(r.time)]
    first, last = min(clock.time[0], *(a for a, _ in spans)), max(b for _, b in spans)
    count = int((last - first) / step + 1e-6) + 1
    if count > _LONGEST:
        jump = int(np.diff(clock.time).argmax())
        before, after = clock.time[jump : jump + 2]
        why = (
            f"take one nearer to that of the file, {clock.step:g} s"
            if after - before < 0.5 * (last - first)
            else f"the clock jumps from {before:.6g} to {after:.6g} s at row {clock.rows[jump] + 1}: cut with start "
            "and stop"
        )
        raise UserError(f"{file}: {last - first:.6g} s at a step of {step:g} s are {float(count):.6g} samples; {why}")
    if count < 2:
        raise UserError(f"{file}: lasts {last - first:.3g} s, less than one step of {step:g} s")
    return first + step * np.arange(count)


def _coarse(raws: list[Raw], step: float, mapping: ChannelMap) -> list[str]:
    """Return the warning that the time base is that of a slow signal, which happens to be the first one."""
    fine = min((float(np.median(np.diff(r.time))) for r in raws if len(r.time) > 1), default=step)
    if np.isfinite(mapping.step) or step < _COARSER * fine:
        return []
    return [
        f"the common time base has the step of the first signal, '{raws[0].channel.signal}', {step:g} s; another one "
        f"comes every {fine:.3g} s: state [recording] step to keep what it holds"
    ]


def _refuse_delays(raws: list[Raw], grid: Floats, file: str) -> None:
    """Refuse delays that leave nothing of a channel; one to be estimated is NaN."""
    length = float(grid[-1] - grid[0])
    for raw in raws:
        if abs(raw.channel.delay) >= length:
            raise UserError(
                f"{raw.channel.where}.delay: {raw.channel.delay:g} s is as long as {file} ({length:g} s) or longer, so "
                "that nothing of the channel is left; write by how much it comes late"
            )


def _onto_grid(raws: list[Raw], grid: Floats) -> dict[str, Floats]:
    """Return all channels on the common time base; what is not resampled again gives up its values, in place."""
    signals = {}
    for i, raw in enumerate(raws):
        signals[raw.channel.signal] = _resampled(raw, raw.channel.delay, grid)
        if not np.isnan(raw.channel.delay):
            raws[i] = replace(raw, values=np.empty(0))
    return signals


def _resampled(raw: Raw, delay: float, grid: Floats) -> Floats:
    """Return a channel on the common time base, freed of its delay, behind its lag."""
    time = raw.time if np.isnan(delay) or delay == 0.0 else raw.time - delay
    values = onto_grid(time, raw.values, grid, raw.largest_gap, raw.channel.hold)
    return first_order_lag(values, float(grid[1] - grid[0]), raw.channel.lag)


def _covered(signals: dict[str, Floats], step: float) -> slice:
    """Return the recording without its ends, up to 1 s each, in which delays and windows leave some signal missing."""
    whole = np.flatnonzero(np.logical_and.reduce([np.isfinite(values) for values in signals.values()]))
    count = len(next(iter(signals.values())))
    if not whole.size:
        return slice(0, count)
    first, last = int(whole[0]), int(whole[-1])
    return slice(first if first * step <= _END else 0, last + 1 if (count - 1 - last) * step <= _END else count)


def _estimated_delays(
    raws: list[Raw], signals: dict[str, Floats], mapping: ChannelMap, grid: Floats, file: str
) -> dict[str, tuple[float, float]]:
    """Return delay and standard error of the signals whose map asks for it, and free them of it, in place.

    One late signal makes others look early, so each is found with the delays of the others taken out, twice over.
    """
    wanted = [r for r in raws if np.isnan(r.channel.delay)]
    step = float(grid[1] - grid[0])
    delays: dict[str, tuple[float, float]] = {}
    for _ in range(2 if len(wanted) > 1 else 1):
        for raw in wanted:
            name = raw.channel.signal
            undelayed = {**signals, name: _resampled(raw, 0.0, grid)}
            to_reference_point(undelayed, mapping, step)
            delays[name] = find_delay(name, undelayed, step, f"{raw.channel.where}.delay (of {file})")
            signals[name] = _resampled(raw, delays[name][0], grid)
    return delays


def add_positions(signals: dict[str, Floats]) -> None:
    """Add positions east and north where latitude and longitude are recorded and positions are not, in place."""
    if {"latitude", "longitude"} <= set(signals) and "position_x" not in signals and "position_y" not in signals:
        signals["position_x"], signals["position_y"] = tangent_plane(signals["latitude"], signals["longitude"])


def _with_turns(raws: list[Raw]) -> tuple[list[Raw], list[tuple[float, float]]]:
    """Return channels with the heading continued across gaps, and those across which its turns are unknown."""
    rate = next(((r.time, r.values) for r in raws if r.channel.signal in ("yaw_rate", "yaw_rate_tractor")), None)
    result, unknown = [], []
    for raw in raws:
        if raw.channel.signal == "heading" and raw.gaps:
            values, gaps = continued(raw.time, raw.values, raw.gaps, rate)
            raw, unknown = replace(raw, values=values), gaps
        result.append(raw)
    return result, unknown


def _unknown_turns(gap: tuple[float, float], start: float) -> str:
    begin, end = gap
    return (
        f"heading: the vehicle may turn by more than half a turn in the gap of {end - begin:.3g} s from t = "
        f"{begin - start:.2f} s; from there on it is unknown by multiples of a turn: take the parts apart "
        f"(@{end - start:.1f}s:), or map a yaw rate"
    )


def _sign_by_course(signals: dict[str, Floats], mapping: ChannelMap, step: float) -> None:
    """Give a speed the sign of the course against the heading where the map wants it, in place.

    Raises:
        UserError: If positions or heading are not mapped.
    """
    for channel in mapping.channels:
        if channel.reverse == COURSE:
            if missing := [n for n in NEEDS if n not in signals]:
                raise UserError(f"{channel.where}.reverse: the course takes {', '.join(missing)}; map them")
            values = signals[channel.signal]
            signals[channel.signal] = np.where(backwards(signals, step), -np.abs(values), values)


def _derive(signals: dict[str, Floats], mapping: ChannelMap, step: float, file: str) -> None:
    """Add the signals that the map wants derived, each from what is known by then."""
    for name in mapping.derive:
        needs, compute = DERIVED[name]
        if not any(all(n in signals for n in each) for each in needs):
            choices = " or ".join(" and ".join(each) for each in needs)
            raise UserError(f"{file}: derive.signals: '{name}' takes {choices}; map them or name them before it")
        signals[name] = compute(Sources(signals, step, mapping.window))


def _about(raw: Raw, delay: float, spread: float, mapping: ChannelMap) -> dict[str, float | int | str]:
    """Return the attributes of a measured channel."""
    spacing = float(np.median(np.diff(raw.time))) if len(raw.time) > 1 else np.nan
    return {
        "derived": 0,
        "rate": 1 / spacing,
        "channel": raw.channel.channel,
        "held": raw.held,
        "gaps": len(raw.gaps),
        "longest_gap": max((b - a for a, b in raw.gaps), default=0.0),
        "missing": raw.missing,
        "missing_share": raw.missing_share,
        "spikes": len(raw.spikes),
        "delay": delay,
        "delay_std": spread,
        "point": raw.channel.point or mapping.reference,
        "includes_gravity": int(raw.channel.includes_gravity),
    }


def _warnings(raw: Raw, start: float) -> list[str]:
    """Return the irregularities of a channel, with the evidence."""
    channel, sentences = raw.channel, []
    where = channel.signal
    if raw.impossible:
        sentences.append(
            f"{where}: {raw.impossible} samples are infinite or beyond any measurement; treated as missing"
        )
    if raw.gaps:
        a, b = max(raw.gaps, key=lambda gap: gap[1] - gap[0])
        sentences.append(
            f"{where}: gaps longer than {raw.largest_gap:.3g} s: {len(raw.gaps)}, the longest of {b - a:.3g} s from "
            f"t = {a - start:.2f} s; they stay missing"
        )
    if len(raw.spikes) and not channel.remove_spikes:
        sentences.append(
            f"{where}: single-sample spikes: {_spikes(raw, start)}; kept; remove_spikes = true treats them as missing"
        )
    if raw.held > 1:
        sentences.append(f"{where}: {raw.held} rows repeat each sample; only the first of them counts as measured")
    return sentences


def _removed_spikes(raws: Sequence[Raw], start: float) -> list[str]:
    """Return one sentence with the samples of all channels that are treated as missing because the map wants it."""
    each = [f"{r.channel.signal} {_spikes(r, start)}" for r in raws if len(r.spikes) and r.channel.remove_spikes]
    return [f"single-sample spikes, treated as missing: {'; '.join(each)}"] if each else []


def _spikes(raw: Raw, start: float) -> str:
    """Return the number of the spikes of a channel and when the first of them are."""
    times = ", ".join(f"{t - start:.2f}" for t in raw.spikes[:3])
    return f"{len(raw.spikes)} (t = {times}{', ...' if len(raw.spikes) > 3 else ''} s)"


def _unknown_points(mapping: ChannelMap) -> list[str]:
    """Return sentences with the signals that could not be moved because their lever arm is unknown."""
    sentences = []
    for name, point in mapping.points.items():
        here = [c.signal for c in mapping.channels if c.point == name]
        if here and not point.has_lever_arm:
            sentences.append(
                f"{', '.join(here)}: measured at '{name}', whose lever arm is unknown; not moved to the "
                f"{mapping.reference}"
            )
    return sentences
