"""Lines of the channel map that correct faults and small deviations.

A recording that is mended of its causes is compared again. A cause that is not sure, or without which the comparisons
agree as well, is stated and not mended: a wrong line makes a right channel wrong. Where a nominal model is given,
neither is one without which that fits better.
"""

from __future__ import annotations

import copy
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np
import xarray as xr

from harness.common.arrays import Floats
from harness.common.files import toml_text
from harness.common.statistics import grows
from harness.common.units import scale, to_si
from harness.models.signals import SIGNALS, TRUTH
from harness.recordings.check.causes import (
    DELAY,
    DRIFT,
    EXCHANGED,
    HEADING,
    OFFSET,
    SCALE,
    SIGN,
    TIME,
    Cause,
    RecordingFault,
    corrected,
)
from harness.recordings.check.responses import tells
from harness.recordings.motion.consistency import LEAST_DELAY, LEAST_SCALE, SmoothedSignals, compare
from harness.recordings.motion.pair_fit import Agreement
from harness.recordings.motion.pose import COURSE
from harness.recordings.read.channel_map import ChannelMap, MapFile

SURE = 2 / 3
"""Least probability of what is mended: to mend a right channel is twice as bad as to leave a wrong one."""

_COARSE = 0.03
"""s; a delay that is known no better is stated and not mended."""


FitError = Callable[[xr.Dataset], Floats]
"""Squared error of the nominal model in each block of a recording that it was fitted to ``(blocks,)``."""


def spoils(reached: Floats, without: Floats) -> bool:
    """Return whether the nominal model fits worse with a line of the map than without it.

    Args:
        reached: Squared errors of the blocks with it, as ``FitError`` returns them.
        without: The same without it; blocks that only one of them has do not count.
    """
    if np.isinf(reached).any() or np.isinf(without).any():
        return bool(np.isinf(reached).any() and not np.isinf(without).any())
    count = min(len(reached), len(without))
    return grows((reached[:count] - without[:count]) / np.nanmean(without))


def worth_mending(causes: Sequence[Cause], fits: Sequence[Agreement], smoothed: SmoothedSignals) -> list[Cause]:
    """Return the causes that are sure and without which the comparisons would agree less.

    Args:
        causes: Small deviations.
        fits: Comparisons of the signals as they are.
        smoothed: The signals that they compare.
    """
    kept = [c for c in causes if c.posterior > SURE and not (c.kind == DELAY and c.std > _COARSE)]
    touched = {n for c in kept for n in c.signals}
    concerned = [f for f in fits if touched & set(f.relation.signals)]
    reached = _disagreement(kept, concerned, smoothed) if kept else (0, 0.0)
    for cause in sorted(kept, key=lambda c: c.posterior):
        fewer = [c for c in kept if c is not cause]
        without = _disagreement(fewer, concerned, smoothed)
        if without <= reached:
            kept, reached = fewer, without
    return kept


def _disagreement(causes: Sequence[Cause], fits: Sequence[Agreement], smoothed: SmoothedSignals) -> tuple[int, float]:
    """Return in how much comparisons disagree once the causes are mended, and how far they are from agreement."""
    if causes:
        without = corrected(causes, smoothed)
        fits = [compare(f.relation, without) for f in fits]
    return sum(len(f.off) for f in fits), sum(_deviation(f) for f in fits)


def _deviation(fit: Agreement) -> float:
    """Return how far a comparison is from agreement, as a sum of squares of standard errors."""
    relation = fit.relation
    if relation.circular or not tells(fit):
        return 0.0
    centre, factor = relation.slope
    least = LEAST_SCALE[relation.through_zero] / 3
    parts = [np.log(fit.slope / centre) / np.sqrt((fit.slope_std / fit.slope) ** 2 + least**2 + np.log(factor) ** 2)]
    if relation.exact:
        parts += [
            fit.delay / np.hypot(fit.delay_std, LEAST_DELAY / 3),
            fit.drift / np.hypot(fit.drift_std, LEAST_DELAY / 3),
            fit.offset / fit.offset_std if not relation.through_zero else 0.0,
        ]
    return float(np.nansum(np.square(parts)))


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
    faults: Sequence[RecordingFault],
    causes: Sequence[Cause],
    clocks: Mapping[int, str],
    duration: float,
    unsigned: Sequence[str] = (),
) -> dict[str, Any]:
    """Return a channel map without the faults.

    Args:
        content: The given map.
        faults: What is wrong by the catalogue, in the order in which it was found.
        causes: Small deviations once those are mended.
        clocks: Channel of the clock by its number.
        duration: s of the recording, over which a clock drifts.
        unsigned: Speeds without a sign in a recording of a vehicle that drives backwards.
    """
    result = listed(copy.deepcopy(dict(content)))
    for name in unsigned:
        result[name]["reverse"] = COURSE
    for fault in faults:
        _mend(result, fault)
    for cause in causes:
        _correct(result, cause, clocks, duration)
    return result


def lines(before: Mapping[str, Any], after: Mapping[str, Any]) -> list[str]:
    """Return the lines of the map that are others than before."""
    old = listed(before)
    changed = []
    for key, value in after.items():
        if value != old.get(key):
            plain = value[0] if key == "time" and isinstance(value, list) and len(value) == 1 else value
            changed.append(_line(key, plain))
    return changed


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


def _mend(content: dict[str, Any], fault: RecordingFault) -> None:
    """Take one fault out of a map, in place."""
    if fault.kind == TIME:
        for clock in content.get("time", []):
            clock["unit"] = _unit("s", clock["unit"], fault.factor) or clock["unit"]
        rate = content.get("recording", {})
        if not content.get("time") and "rate" in rate:
            rate["rate"] = to_si(rate["rate"], "Hz", "recording.rate") / fault.factor
        return
    if fault.kind == EXCHANGED:
        first, second = fault.signals
        alike = SIGNALS[first].unit == SIGNALS[second].unit
        if fault.factor == 1.0 and alike:
            content[first], content[second] = content[second], content[first]
            return
        content[first]["channel"], content[second]["channel"] = content[second]["channel"], content[first]["channel"]
        if fault.factor == 1.0:  # both keep the numbers that they had, in units of their own
            scales = [scale(content[name]["unit"], SIGNALS[name].unit, name) for name in (first, second)]
            _scaled(content[first], first, scales[1] / scales[0])
            _scaled(content[second], second, scales[0] / scales[1])
        return
    for name in fault.signals:
        entry = content.get(name)
        if entry is None:
            continue
        if entry.pop("convention", ""):
            if fault.kind == HEADING and fault.factor < 0 and np.isclose(fault.offset, np.pi / 2):
                continue  # the same convention once more
            entry["sign"] = -entry.get("sign", 1)
            _moved(entry, name, np.pi / 2)
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
