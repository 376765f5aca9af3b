"""From what is wrong to the lines of the channel map that mend it."""

from __future__ import annotations

import copy
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from harness.common.files import toml_text
from harness.common.units import scale, to_si
from harness.models.signals import SIGNALS, TRUTH
from harness.recordings.cause import DELAY, DRIFT, OFFSET, SCALE, Cause
from harness.recordings.channel_map import ChannelMap, MapFile
from harness.recordings.faults import EXCHANGED, HEADING, SIGN, TIME, Fault
from harness.recordings.reversing import COURSE

_UNITS = {
    "rad": ("rad", "deg", "mrad"),
    "rad/s": ("rad/s", "deg/s", "mrad/s"),
    "rad/s^2": ("rad/s^2", "deg/s^2"),
    "m/s": ("m/s", "km/h", "mph", "knot", "mm/s", "km/s"),
    "m/s^2": ("m/s^2", "g_0", "mm/s^2", "km/s^2"),
    "m": ("m", "mm", "km"),
    "s": ("s", "ms", "us", "ns"),
}
"""Units that a channel may be said to be in, by the SI unit of its signal."""


def content_of(mapping: ChannelMap) -> dict[str, Any]:
    """Return the content of a map for a file that needs none: every column under its own name, in SI units.

    Without what a simulation wrote as the truth: it is exact, and no sensor's.
    """
    content: dict[str, Any] = {"time": [{"channel": clock, "unit": "s"} for clock in mapping.clocks]}
    for channel in mapping.channels:
        if channel.signal.startswith(TRUTH):
            continue
        content[channel.signal] = {"channel": channel.channel, "unit": SIGNALS[channel.signal].unit}
    return content


def listed(content: Mapping[str, Any]) -> dict[str, Any]:
    """Return the content of a map with its clocks as a list, which one clock need not be."""
    clock = content.get("time")
    return {**content, "time": [clock]} if isinstance(clock, Mapping) else dict(content)


def mended(
    content: Mapping[str, Any],
    faults: Sequence[Fault],
    causes: Sequence[Cause],
    clocks: Mapping[int, str],
    duration: float,
    unsigned: Sequence[str] = (),
) -> dict[str, Any]:
    """Return a channel map without the faults.

    Args:
        content: The map as it is.
        faults: What is wrong by the catalogue, in the order in which it was found.
        causes: What is off by a little, once those are mended.
        clocks: Channel of the clock by its number.
        duration: s of the recording, over which a clock drifts.
        unsigned: Speeds without a sign in a recording of a vehicle that drives backwards.
    """
    found = listed(copy.deepcopy(dict(content)))
    for name in unsigned:
        found[name]["reverse"] = COURSE
    for fault in faults:
        _mend(found, fault)
    for cause in causes:
        _correct(found, cause, clocks, duration)
    return found


def lines(before: Mapping[str, Any], after: Mapping[str, Any]) -> list[str]:
    """Return the lines of the map that are others than before."""
    old = listed(before)
    found = []
    for key, value in after.items():
        if value != old.get(key):
            plain = value[0] if key == "time" and isinstance(value, list) and len(value) == 1 else value
            found.append(_line(key, plain))
    return found


def _line(key: str, value: Any) -> str:
    if isinstance(value, list):
        return f"{key} = [{', '.join(_table(v) for v in value)}]"
    return f"{key} = {_table(value)}"


def _table(value: Mapping[str, Any]) -> str:
    parts = []
    for key, v in value.items():
        text = toml_text({key: v}).strip() if not isinstance(v, Mapping) else f"{key} = {_table(v)}"
        parts.append(text)
    return "{ " + ", ".join(parts) + " }"


def _mend(content: dict[str, Any], fault: Fault) -> None:
    """Take one fault out of a map, in place."""
    if fault.kind == TIME:
        for clock in content.get("time", []):
            clock["unit"] = _unit("s", clock["unit"], fault.factor) or clock["unit"]
        rate = content.get("recording", {})
        if not content.get("time") and "rate" in rate:
            rate["rate"] = to_si(rate["rate"], "Hz", "recording.rate") / fault.factor
        return
    if fault.kind == EXCHANGED:
        one, other = fault.signals
        alike = SIGNALS[one].unit == SIGNALS[other].unit
        if fault.factor == 1.0 and alike:
            content[one], content[other] = content[other], content[one]
            return
        content[one]["channel"], content[other]["channel"] = content[other]["channel"], content[one]["channel"]
        if fault.factor == 1.0:  # both keep the numbers that they had, in units of their own
            scales = [scale(content[name]["unit"], SIGNALS[name].unit, name) for name in (one, other)]
            _scaled(content[one], one, scales[1] / scales[0])
            _scaled(content[other], other, scales[0] / scales[1])
        return
    for name in fault.signals:
        entry = content.get(name)
        if entry is None:
            continue
        if fault.kind in (SIGN, HEADING) and fault.factor < 0:
            if entry.get("factor", 1.0) < 0:  # the map has the sign in its factor
                entry["factor"] = -entry["factor"]
                _drop(entry, "factor", 1.0)
            else:
                entry["sign"] = -entry.get("sign", 1)
                _drop(entry, "sign", 1)
        _scaled(entry, name, abs(fault.factor), np.sign(fault.factor))
        if fault.offset:
            _moved(entry, name, fault.offset)


def _scaled(entry: dict[str, Any], name: str, factor: float, sign: float = 1.0) -> None:
    """Multiply what an entry gives by a factor: by another unit if there is one, else by the factor of the entry."""
    si = SIGNALS[name].unit
    if factor != 1.0:
        unit = _unit(si, entry["unit"], factor)
        if unit is not None:
            entry["unit"] = unit
        else:
            entry["factor"] = float(f"{entry.get('factor', 1.0) * factor:.6g}")
            _drop(entry, "factor", 1.0)
    if "offset" in entry:
        entry["offset"] = float(f"{sign * factor * to_si(entry['offset'], si, name):.6g}")


def _moved(entry: dict[str, Any], name: str, by: float) -> None:
    """Add to what an entry gives."""
    si, shown = SIGNALS[name].unit, SIGNALS[name].report_unit
    total = to_si(entry.get("offset", 0.0), si, name) + by
    entry["offset"] = f"{total / scale(shown, si, name):.5g} {shown}"


def _drop(entry: dict[str, Any], key: str, usual: float) -> None:
    if entry[key] == usual:
        del entry[key]


def _unit(si: str, unit: str, factor: float) -> str | None:
    """Return the unit that is so many times the stated one, if there is a usual one."""
    wanted = scale(unit, si, "unit") * factor
    return next((u for u in _UNITS.get(si, ()) if abs(scale(u, si, "unit") / wanted - 1) < 1e-4), None)


def _correct(content: dict[str, Any], cause: Cause, clocks: Mapping[int, str], duration: float) -> None:
    """Take a small cause out of a map, in place."""
    if cause.clock >= 0 and cause.clock in clocks and content.get("time"):
        clock = next((c for c in content["time"] if c["channel"] == clocks[cause.clock]), None)
        if clock is not None:
            later = to_si(clock.get("offset", 0.0), "s", "time") - cause.value
            if (
                cause.kind == DRIFT
            ):  # known in the middle of the recording, while a clock's factor counts from its start
                later += 1.5 * cause.value
                clock["factor"] = float(f"{clock.get('factor', 1.0) * (1 - cause.value / duration):.8g}")
            clock["offset"] = f"{1e3 * later:.4g} ms"
            return
    geodetic = {"position_x": "longitude", "position_y": "latitude"}
    for name in cause.signals:
        entry = content.get(name, content.get(geodetic.get(name, "")))
        if entry is None:
            continue
        if cause.kind == SCALE:
            _scaled(entry, name, 1 / (1 + cause.value))
        elif cause.kind == OFFSET:
            _moved(entry, name, -cause.value)
        elif cause.kind == DELAY and entry.get("delay") != "estimate":
            late = to_si(entry.get("delay", 0.0), "s", name) + cause.value
            entry["delay"] = f"{1e3 * late:.4g} ms"


def map_text(content: Mapping[str, Any]) -> str:
    """Return a map as a file."""
    order = sorted(content, key=lambda key: key in MapFile.model_fields and key not in ("title", "source", "time"))
    return toml_text({key: content[key] for key in order}, "Proposed by harness check: look at every changed entry.")
