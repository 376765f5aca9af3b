"""What the name of a column says: the signal that it may be, its unit, the body on which it was measured."""

from __future__ import annotations

import re

NAMES: tuple[tuple[str, str], ...] = (
    ("articulation_angle", r"\bartic|hitch (angle|ang)|knickwinkel"),
    ("steering_wheel_angle", r"steer|swa|lenk|lws|\blrw\b|handwheel|^delta( h| sw)?$"),
    ("yaw_acceleration", r"yaw (ang(ular)? )?acc|psi pp|yaw ddot"),
    (
        "yaw_rate",
        r"yaw (rate|vel|speed)|yawrate|gier|psi (p|dot)$|^(r|wz|w z|omega z|gyro z|gz)$|(ang(ular)? )?rate z|yaw dot",
    ),
    ("roll_rate", r"roll (rate|vel)|^(wx|omega x|gyro x|gx)$|rate x"),
    ("lateral_acceleration", r"lat(eral)? ?acc|querbeschl|acc(el(eration)?)? ?(y|lat)|^a ?y( ?cg)?$"),
    (
        "longitudinal_acceleration",
        r"long(itudinal)? ?acc|laengsbeschl|längsbeschl|acc(el(eration)?)? ?(x|long)|^a ?x( ?cg)?$",
    ),
    ("lateral_velocity", r"lat(eral)? ?(vel|speed)|vel(ocity)? (y|lat)|quer ?gesch|^v ?(y|quer|lat)$"),
    ("speed", r"speed|geschw|veloc|^v( ?x| veh| fzg)?$|vel (x|long)|kmh|kph"),
    ("sideslip_angle", r"side ?slip|schwimm|^beta$"),
    ("heading", r"heading|course|kurs|azimuth|^(psi|yaw)( angle)?$"),
    ("roll_angle", r"^(roll|phi)( angle)?$|wank"),
    ("latitude", r"^(gps |gnss )?lat(itude)?$|breitengrad"),
    ("longitude", r"^(gps |gnss )?(lon|lng|long|longitude)$|laengengrad|längengrad"),
    ("position_x", r"^(pos(ition)? )?x( pos)?$|east(ing)?$"),
    ("position_y", r"^(pos(ition)? )?y( pos)?$|north(ing)?$"),
)
"""Signals by what the names of their columns look like, the first that matches."""

TIME = re.compile(r"^(t|time|timestamp|zeit|clock|stamp)\b|\btime$|^timestamps?$")
TRAILER = re.compile(r"trailer|anhänger|anhaenger|auflieger|\btebs")
"""How names of columns say that something was measured on the trailer of a vehicle combination."""


WRITTEN = {
    "rad/s": r"rad ?/ ?s(ec)?|rad ?s ?-1|radps|rads",
    "deg/s": r"(deg|°|grad) ?/ ?s(ec)?|degps|dps|deg ?s ?-1|degs",
    "km/h": r"km ?/ ?h|kmh|kph",
    "m/s^2": r"m ?/ ?s ?(2|²|\^2|\*\*2)|mps2|ms2|m ?s ?-2",
    "m/s": r"m ?/ ?s|mps|m ?s ?-1",
    "g_0": r"g|g0",
    "deg": r"deg(rees?)?|°|grad",
    "rad": r"rad(ians?)?",
    "ms": r"ms|msec|millis(econds)?",
    "us": r"us|µs|micros(econds)?",
    "ns": r"ns|nanos(econds)?",
    "s": r"s|sec(onds)?",
    "m": r"m|met(er|re)s?",
}
"""How units are written in files and names."""


def in_words(name: str) -> str:
    """Return a column's name in small words, without unit, group and module: ``EBS11.YawRate [deg/s]`` is yaw rate."""
    name = re.sub(r"[\[(].*?[\])]", " ", name)
    name = re.split(r"[./\\:]", name.strip())[-1] if not re.search(r"\w/\w$", name) else name
    name = re.sub(r"([a-z])([A-Z])", r"\1 \2", name)
    words = re.sub(r"[^a-z0-9äöüß]+", " ", name.lower()).split()
    while len(words) > 1 and unit_of(words[-1]) is not None and words[-1] != "g":
        words.pop()
    return " ".join(words)


def unit_of(text: str) -> str | None:
    """Return a unit by how it is written; ``None`` if it is none of those known."""
    text = text.strip().lower()
    return next((unit for unit, pattern in WRITTEN.items() if re.fullmatch(pattern, text)), None)


def stated_unit(column: str, by_file: str) -> tuple[str, str] | None:
    """Return the unit that file or name state, and which of them."""
    found = unit_of(by_file) if by_file else None
    if found is not None:
        return found, "unit by the file"
    for written in (*re.findall(r"[\[(](.*?)[\])]", column), re.split(r"[_ ]", column)[-1] if "_" in column else ""):
        if (found := unit_of(written)) is not None:
            return found, "unit by the name"
    return None
