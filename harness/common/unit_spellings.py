"""Units as loggers spell them: ``degps``, ``m_s2``, ``Km_h``, ``Gs``; ``units`` takes those that pint reads."""

from __future__ import annotations

import re
from collections.abc import Iterable
from dataclasses import dataclass

_ATOMS = {
    written: (kind, unit)
    for kind, unit, texts in (
        ("angle", "rad", "rad radian radians"), ("angle", "deg", "deg degree degrees ° grad"),
        ("angle", "mrad", "mrad"),
        ("length", "m", "m meter meters metre metres"), ("length", "km", "km"), ("length", "cm", "cm"),
        ("length", "mm", "mm"), ("length", "ft", "ft feet"), ("length", "mile", "mi mile miles"),
        ("gravity", "g_0", "g gs gee gees g0 g_0"), ("gravity", "mg_0", "mg"),
        ("time", "s", "s sec secs second seconds"), ("time", "ms", "ms msec milliseconds millis"),
        ("time", "us", "us µs usec microseconds usecs"), ("time", "ns", "ns nsec nanosec nanoseconds nsecs"),
        ("time", "min", "min"), ("time", "h", "h hr hour hours"), ("turns", "turn", "rev revs u umdr tr"),
        ("plain", "rad", "1"),
    )
    for written in texts.split()
}  # fmt: skip
"""Parts of units by their spelling: the quantity that they measure, and the spelling of pint."""
_SHORT = {
    **dict.fromkeys(("kph", "kmh", "kmph", "kmhr"), ("km/h", "m/s")), "mph": ("mph", "m/s"), "mps": ("m/s", "m/s"),
    **dict.fromkeys(("kn", "kt", "kts", "knot", "knots"), ("knot", "m/s")), "fps": ("ft/s", "m/s"),
    "dps": ("deg/s", "rad/s"), "degs": ("deg/s", "rad/s"), "rps": ("rad/s", "rad/s"), "rads": ("rad/s", "rad/s"),
    "rpm": ("rpm", ""),
}  # fmt: skip
"""Units that have a short form of their own, with the SI unit that they are of."""


def _any(words: Iterable[str]) -> str:
    return "|".join(sorted(map(re.escape, words), key=len, reverse=True))


_UNIT = re.compile(
    rf"(?P<part>{_any(_ATOMS)})(?:\s*(?:[/|*·._ ]|per|p|)\s*"
    rf"(?P<per>{_any(w for w, (kind, _) in _ATOMS.items() if kind == 'time')})\s*(?:\^|\*\*)?\s*(?P<power>-?[12])?)?"
)
_NO_MOTION = re.compile(
    r"%|pct|percent|prozent|m?bar|k?pa|psi|[mk]?v|volts?|m?a|amps?|°?[cfk]|celsius|fahrenheit|n ?m|n|k?w|hp|k?hz|l|l/h|"
    r"kg|cnt|counts?|ppm|lux|db|mah|rpm|1/k?m|-"
)
"""Units that are stated and are those of no signal here."""


@dataclass(frozen=True)
class ColumnUnit:
    """A unit that file or name state.

    Attributes:
        text: As pint reads it.
        si: SI unit of what it measures; empty for what no signal here is measured in.
        by: ``"file"`` or ``"name"``.
    """

    text: str
    si: str
    by: str = "name"


def unit_of(text: str) -> ColumnUnit | None:
    """Return a unit by how it is written (``deg/s``, ``degps``, ``m_s2``, ``Km_h``, ``1/s``); None if it is none."""
    text = re.sub(r"[\[\](){}\"' ]+", " ", text).strip()
    if text == "kN":
        return ColumnUnit(text, "")
    text = text.lower().translate(str.maketrans("²⁻¹", "2-1")).replace("/s/s", "/s^2")
    if text in _SHORT:
        return ColumnUnit(*_SHORT[text])
    match = _UNIT.fullmatch(text)
    if match is None:
        return ColumnUnit(text, "") if _NO_MOTION.fullmatch(text) else None
    kind, part = _ATOMS[match["part"]]
    if match["per"] is None:
        si = {"angle": "rad", "length": "m", "gravity": "m/s^2", "time": "s"}.get(kind)
        return None if si is None else ColumnUnit(part, si)
    per, power = _ATOMS[match["per"]][1], (match["power"] or "1").lstrip("-")
    if kind == "turns" or (kind == "plain" and per == "min"):
        return ColumnUnit("rpm" if per == "min" else f"turn/{per}", "")
    if kind not in ("angle", "length", "plain") or per == "min":
        return None
    over = f"/{per}" if power == "1" else f"/{per}^2"
    return ColumnUnit(part + over, ("m" if kind == "length" else "rad") + ("/s" if power == "1" else "/s^2"))
