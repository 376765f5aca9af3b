"""Units that the file of a recording states: taken where the map states none, compared with those of the map."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

from harness.common.errors import UserError
from harness.common.unit_spellings import unit_of
from harness.common.units import scale
from harness.models.signals import SIGNALS
from harness.recordings.read.channel_map import Channel, ChannelMap
from harness.recordings.readers import Table

_SAME = 1e-6
"""Relative difference within which two units are one."""


def by_file(tables: Sequence[Table], column: str) -> str:
    """Return the unit that a file states for a column, as pint reads it; empty if it states none."""
    text = next((t.units.get(column, "") for t in tables if column in t.columns), "").strip()
    unit = unit_of(text)
    return text if unit is None else unit.text


def with_file_units(channels: ChannelMap, tables: Sequence[Table], file: str) -> tuple[ChannelMap, list[str]]:
    """Return a map in which every channel has a unit, and sentences with the units on which map and file disagree.

    Raises:
        UserError: If neither of them states one, or that of the file does not fit the signal.
    """
    resolved, sentences = [], []
    for channel in channels.channels:
        if channel.unit is None:
            channel = replace(channel, scale=channel.scale * _scale(channel, by_file(tables, channel.channel), file))
        elif channel.unit and channel.curve is None:
            sentences += _disagreement(channel, tables)
        resolved.append(channel)
    return replace(channels, channels=tuple(resolved)), sentences


def content_with_file_units(content: Mapping[str, Any], tables: Sequence[Table]) -> dict[str, Any]:
    """Return the content of a map with the units of the file where it states none."""

    def filled(entry: Any) -> Any:
        if not isinstance(entry, dict) or "unit" in entry or "channel" not in entry:
            return entry
        unit = by_file(tables, entry["channel"])
        return {**entry, "unit": unit} if unit else entry

    return {key: filled(entry) if key in SIGNALS else entry for key, entry in content.items()}


def _scale(channel: Channel, unit: str, file: str) -> float:
    signal = SIGNALS[channel.signal]
    if not unit:
        raise UserError(
            f"{channel.where}.unit: {file} states none for '{channel.channel}'; state what the channel is in, e.g. "
            f"'{signal.report_unit}' ('1' for a plain number)"
        )
    return scale(unit, signal.unit, f"{channel.where}.unit (of {file})")


def _disagreement(channel: Channel, tables: Sequence[Table]) -> list[str]:
    stated = next((t.units.get(channel.channel, "") for t in tables if channel.channel in t.columns), "")
    unit, si = unit_of(stated) if stated else None, SIGNALS[channel.signal].unit
    if unit is None or not unit.si:
        return []
    if unit.si == si and abs(scale(unit.text, si, "") / scale(channel.unit or "", si, "") - 1.0) < _SAME:
        return []
    return [
        f"{channel.signal}: '{channel.channel}' is in {stated} by the file, in {channel.unit} by the map, which holds"
    ]
