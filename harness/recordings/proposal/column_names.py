"""Meaning of the name of a column: its unit, whose motion it is, and the signals that it may be.

A name is cut into words (``VehSpd``, ``latacc``, ``Giergeschwindigkeit``), each of which means something: a kind of
quantity, an axis, something that turns but is not the vehicle. The signal follows from the meanings, and a name whose
meanings contradict a signal gives the reason why it is none.
"""

from __future__ import annotations

import functools
import re
from collections.abc import Iterable
from dataclasses import dataclass, replace

from harness.common.unit_spellings import ColumnUnit, unit_of
from harness.models.signals import SIGNALS

AXLE = "the speed of an axle or of wheels"
"""Substitute for the speed of the vehicle where there is no other."""

_SCRIPTS = {
    "目標": "target", "目标": "target", "エンジン": "engine", "电机": "motor", "発動機": "engine", "发动机": "engine",
    "車輪速": "wheel speed", "轮速": "wheel speed", "車速": "speed", "车速": "speed",
    "トルク": "torque", "转矩": "torque",
    "ヨーレイト": "yaw rate", "ヨーレート": "yaw rate", "横摆角速度": "yaw rate", "ロールレイト": "roll rate",
    "操舵角": "steering angle", "方向盘转角": "steering wheel angle", "方向盘转速": "steering rate",
    "横加速度": "lateral acceleration", "侧向加速度": "lateral acceleration", "横向加速度": "lateral acceleration",
    "前後加速度": "longitudinal acceleration", "纵向加速度": "longitudinal acceleration", "操舵": "steering",
    "横すべり角": "sideslip angle", "侧偏角": "sideslip angle", "回転数": "rpm", "转速": "rpm",
    "時間": "time", "时间": "time",
}  # fmt: skip
"""Words of Japanese and Chinese loggers; a longer one stands before those that it contains."""
_ACCENTS = str.maketrans("éèêàâîôûçÉ", "eeeaaioucE")


_MEANINGS = {
    # whose motion it is
    "vehicle": "vehicle veh car fzg fahrzeug ego chassis host ground machine",
    "tractor": "tractor zugmaschine",
    "trailer": "trailer släp anhänger anhaenger auflieger tebs",
    "engine": "engine eng motor mot mtr emotor crank crankshaft",
    "fan": "fan lüfter luefter blower",
    "wind": "wind air airspeed luft",
    "shaft": "shaft driveshaft gear gearbox trans transmission getriebe pto clutch kupplung cardan propeller prop pump "
    "pumpe drum spindle belt compressor retarder",
    "turbine": "turbine turbo turbocharger rotor",
    "wheel": "wheel whl wss rad raeder räder",
    "tyre": "tire tyre reifen",
    "axle": "axle achse front rear vorn hinten vorne",
    "corner": "left right links rechts fl fr rl rr lf rf lr vl vr hl hr l1 r1 l2 r2 l3 r3",
    # what is not the motion itself
    "wanted": "target desired des trgt setpoint set request requested req cmd command commanded cruise limit lim soll "
    "ziel demand consigne börvärde",
    "about": "std stdev sigma var variance cov covariance error err accuracy quality valid validity status state flag "
    "offset bias counter checksum crc temp temperature age quat quaternion orientation max min",
    "effort": "torque moment trq tq current voltage percentage percent pressure force power",
    # which quantity
    "speed": "speed spd velocity velo vel geschw geschwindigkeit vitesse hastighet sog twist",
    "acceleration": "acceleration accel accl accelerometer acc beschl beschleunigung gforce gs",
    "rate": "rate dot punkt turn",
    "angle": "angle ang angl agl ag winkel wnkl vinkel",
    "angular": "angular gyro gyr gyroscope omega rotation rotational drehrate",
    "revolutions": "rpm drehzahl revs revolutions",
    "position": "position pos displacement",
    "steering": "steering steer strng steered lenk lenkung lws sas swa msw str handwheel lenkrad lrw volant ratt",
    "linear": "linear",
    "road": "road roadwheel",
    "yaw": "yaw gier gir psi lacet",
    "roll": "roll wank phi",
    "pitch": "pitch nick",
    "sideslip": "sideslip schwimm beta",
    "articulation": "artic articulation hitch knick",
    "heading": "heading course kurs hdg bearing azimuth cog",
    # along which axis
    "lateral": "lateral laterale sido quer transverse transversal transversale latitude breitengrad lat",
    "longitudinal": "longitudinal longitudinale longi lgt lineal inline längs laengs forward fwd long lon lng "
    "longitude laengengrad längengrad",
    "vertical": "vertical vert",
    "compass": "north east northing easting nord ost up down",
    # nothing that matters here
    "aside": "sensor value signal imu ins gps gnss can bus raw brute roh filtered filt actual act meas measured ist "
    "data info of the over based mean com esp esc abs ecu est estimated pose corrected side slip cg tacho "
    "tachograph",
}
"""Words by what they mean."""

_WORDS = {word: meaning for meaning, words in _MEANINGS.items() for word in words.split()}
_LETTERS = {"x": "longitudinal", "y": "lateral", "z": "vertical"}
_SYMBOLS = {"v": "speed", "a": "acceleration", "g": "acceleration", "w": "angular", "av": "angular", "n": "revolutions"}
"""Letters that begin a symbol (``v_x``, ``ay``, ``wz``, ``nMot``)."""
_PLACES = {
    **dict.fromkeys(("lat", "latitude", "breitengrad"), "latitude"),
    **dict.fromkeys(("lon", "long", "lng", "longitude", "laengengrad", "längengrad"), "longitude"),
    **dict.fromkeys(("x", "east", "easting"), "position_x"),
    **dict.fromkeys(("y", "north", "northing"), "position_y"),
}
"""Where the vehicle is, where nothing else is said."""
_WHOLE = {
    "r": "yaw_rate", "w": "yaw_rate", "v": "speed", "dpsi": "yaw_rate", "psi p": "yaw_rate", "psip": "yaw_rate",
    "psi pp": "yaw_acceleration", "side slip": "sideslip_angle", "df": "road_wheel_angle",
    "delta f": "road_wheel_angle", "delta": "steering_wheel_angle",
    "delta h": "steering_wheel_angle", "delta sw": "steering_wheel_angle", "vss": "speed",
    "slip angle": "sideslip_angle", "angle slip": "sideslip_angle", "rate turn": "yaw_rate", "turn rate": "yaw_rate",
}  # fmt: skip
"""Symbols that mean a signal as a whole."""

_HANDWHEEL = {"swa", "lrw", "lws", "sas", "lenkrad", "handwheel", "volant"}
"""Words for a steering wheel, which nothing but its angle is recorded of."""
_TURNS = {"rate", "speed", "angular"}
_RULES: tuple[tuple[set[str], set[str], str], ...] = (
    ({"steering"}, {*_TURNS, "acceleration"}, "!a rate of the steering"),
    ({"steering"}, {"corner"}, "!the angle of one wheel"),
    ({"steering"}, {"road", "tyre"}, "road_wheel_angle"),
    ({"steering"}, set(), "steering_wheel_angle"),
    ({"road", "wheel"}, set(), "road_wheel_angle"),
    ({"articulation"}, {*_TURNS, "acceleration"}, "!a rate of the articulation"),
    ({"articulation"}, set(), "articulation_angle"),
    ({"sideslip"}, {*_TURNS, "acceleration"}, "!a rate of the sideslip"),
    ({"sideslip"}, set(), "sideslip_angle"),
    ({"engine"}, set(), "!an engine or a motor, not the vehicle"),
    ({"fan"}, set(), "!a fan, not the vehicle"),
    ({"wind"}, set(), "!the air, not the vehicle"),
    ({"shaft"}, set(), "!a shaft or gear, not the vehicle"),
    ({"turbine"}, set(), "!a turbine or rotor, not the vehicle"),
    ({"revolutions"}, set(), "!revolutions, no motion of the vehicle"),
    ({"tyre"}, set(), "!one wheel, not the vehicle"),
    ({"wheel"}, {"corner", "angular", "vertical"}, "!one wheel, not the vehicle"),
    ({"corner"}, _TURNS, "!one wheel or side, not the vehicle"),
    ({"wheel"}, {"speed"}, AXLE),
    ({"axle"}, {"speed"}, AXLE),
    ({"wheel"}, set(), "!a wheel, not the vehicle"),
    ({"pitch"}, set(), "!a pitch motion, of which there is no signal"),
    ({"yaw"}, {"acceleration"}, "yaw_acceleration"),
    ({"yaw"}, _TURNS, "yaw_rate"),
    ({"roll"}, {"acceleration"}, "!a roll acceleration, of which there is no signal"),
    ({"roll"}, _TURNS, "roll_rate"),
    ({"heading", "rate"}, set(), "yaw_rate"),
    ({"vertical"}, {"angular", "rate"}, "yaw_rate"),
    ({"longitudinal"}, {"angular", "rate"}, "roll_rate"),
    ({"lateral"}, {"angular", "rate"}, "!a pitch rate, of which there is no signal"),
    ({"angular"}, set(), "?yaw_rate"),
    ({"acceleration"}, {"vertical", "compass"}, "!along no axis of the road plane"),
    ({"acceleration", "lateral"}, set(), "lateral_acceleration"),
    ({"acceleration", "longitudinal"}, set(), "longitudinal_acceleration"),
    ({"acceleration"}, set(), "?longitudinal_acceleration"),
    ({"speed"}, {"vertical", "compass"}, "!along no axis of the vehicle in the road plane"),
    ({"speed", "lateral"}, set(), "lateral_velocity"),
    ({"speed"}, set(), "speed"),
    ({"linear", "longitudinal"}, set(), "speed"),
    ({"linear", "lateral"}, set(), "lateral_velocity"),
    ({"linear", "vertical"}, set(), "!along no axis of the vehicle in the road plane"),
    ({"position"}, {"vertical"}, "!a height, of which there is no signal"),
)
"""Signals by the meanings in a name: all of the first, one of the second if there are any; the first that holds.

Behind ``!`` stands why it is no signal, behind ``?`` a signal that the words do not fully determine.
"""
_ABOUT = {"wanted": "what is wanted", "about": "something about a measurement", "effort": "an effort"}
"""Meanings of words in names of what is no motion."""
_KINDS = {"m/s": "speed", "m/s^2": "acceleration", "rad/s": "rate"}
"""Kind of quantity by unit."""

_VECTOR = re.compile(r"(?:^|[._/])(linear|angular|linear_acceleration)(?:_velocity)?[._][xyz]$")
"""Components of vectors in messages of ROS, which are in SI units."""
TIME = re.compile(
    r"^(t|time|timestamp|zeit|clock|stamp|ts|utc|uhrzeit|zeitstempel|datetime|date time|x value|temps|seconds?)\b|"
    r"^(secs?|tv|datenum|epoch|elapsed)$|"
    r"\b(time|stamp|timestamps?|uhrzeit)$"
)
"""Words of a clock."""


@dataclass(frozen=True)
class Reading:
    """Meaning of a name.

    Attributes:
        words: The name in small words, without unit and group.
        unit: Unit that is stated; None if none is.
        signal: Signal that it may be; empty if none.
        sure: Log odds of it: 5 for the name of the signal, 4 by words, less for letters and unclear words.
        why_not: Reason why it is none, where the name has one.
        trailer: Whether it was measured on the trailer of a vehicle combination.
        letter: Whether a letter names the axis, which may be another one than the vehicle's.
        along: Whether it is along the vehicle by its name.
        bare: Whether no word means an angle.
        handwheel: Whether it names a steering wheel.
        symbol: Whether it is a symbol, as papers and models write it.
    """

    words: str
    unit: ColumnUnit | None
    signal: str = ""
    sure: float = 0.0
    why_not: str = ""
    trailer: bool = False
    letter: bool = False
    along: bool = False
    bare: bool = False
    handwheel: bool = False
    symbol: bool = False


@functools.lru_cache(maxsize=4096)
def read_name(column: str, by_file: str = "") -> Reading:
    """Return the meaning of the name of a column, and the unit that file or name state."""
    bare, unit = _without_unit(column)
    if by_file.strip() and (stated := unit_of(by_file)) is not None:
        unit = replace(stated, by="file")
    if unit is None and (vector := _VECTOR.search(column)) is not None:
        stated = unit_of({"linear": "m/s", "angular": "rad/s"}.get(vector[1], "m/s^2"))
        unit = None if stated is None else replace(stated, by="messages of ROS (REP 103)")
    *groups, leaf = [_cut(part) for part in re.split(r"[./\\:]+", bare) if part.strip()] or [[]]
    if ":" in bare and groups and _meanings(leaf) <= {"vehicle", "aside"}:  # channel:application
        leaf, *groups = groups[-1], *groups[:-1], leaf
    outcome, sure = _outcome(leaf, groups, unit)
    if unit is not None and outcome in SIGNALS and unit.si != SIGNALS[outcome].unit:
        outcome = f"!{unit.text} is no unit of {outcome}"
    telling = [w for w in leaf if _WORDS.get(w) != "aside"]
    is_signal = outcome in SIGNALS
    return Reading(
        words=" ".join(leaf),
        unit=unit,
        signal=outcome if is_signal else "",
        sure=sure if is_signal else 0.0,
        why_not="" if is_signal else outcome.removeprefix("!"),
        trailer=any("trailer" in map(_WORDS.get, part) for part in (leaf, *groups)),
        letter=any(w in _LETTERS for w in leaf),
        along="longitudinal" in _meanings(leaf),
        handwheel=bool({"wheel", "whl", *_HANDWHEEL} & set(leaf)),
        bare=not {"heading", "angle"} & _meanings(leaf),
        symbol=" ".join(telling) in _WHOLE or telling[:1] in [[symbol] for symbol in (*_SYMBOLS, "psi", "beta")],
    )


def _outcome(leaf: list[str], groups: list[list[str]], unit: ColumnUnit | None) -> tuple[str, float]:
    """Return the signal that the words of a name and of its groups mean and how surely; or why it is none."""
    if unit is not None and not unit.si:
        return f"!{unit.text} is the unit of no signal here", 0.0
    for word in leaf:
        if (what := _ABOUT.get(_WORDS.get(word, ""))) and not (word == "force" and "g" in leaf):
            return f"!“{word}” in its name: {what}, not the motion", 0.0
    exact = "_".join(leaf).removeprefix("measured_")
    if exact in SIGNALS and exact not in ("time", "speed"):
        return exact, 5.0
    if (whole := " ".join(w for w in leaf if _WORDS.get(w) != "aside" or w in ("side", "slip"))) in _WHOLE:
        return _WHOLE[whole], 2.5
    own = _meanings(leaf)
    if leaf and unit is not None and unit.si == "rad" and leaf[0] in _SYMBOLS and leaf[0] not in _WORDS:
        own -= {_SYMBOLS[leaf[0]]}  # an angle is not what the symbol says
    unclear = sum(w not in _WORDS and w not in _LETTERS and w not in _SYMBOLS and not w.isdigit() for w in leaf)
    sure = 4.0 - 0.85 * unclear - any(w in _LETTERS for w in leaf) + 0.5 * ("vehicle" in own) + (exact == "speed")
    if leaf and leaf[-1].isdigit() and leaf[-1] > "1":
        sure -= 1.5  # of a second sensor or body
    meanings = own | {_KINDS.get("" if unit is None else unit.si, "aside")} if own - {"aside"} else set()
    for depth in range(len(groups) + 1):
        meanings |= _meanings(groups[-depth]) - set(_ABOUT) if depth else set()
        outcome = _by_rule(meanings)
        if outcome.startswith("?"):
            return outcome[1:], sure - 3.0
        if (
            outcome == "steering_wheel_angle"
            and unit is None
            and not any(_WORDS.get(w) in ("angle", "wheel") or w in _HANDWHEEL for w in leaf)
        ):
            return outcome, sure - 2.5  # it may be a share of the largest angle
        if outcome:
            strange = outcome == "speed" and any(_by_rule(_meanings(g) - {"speed"}).startswith("!") for g in groups)
            return outcome, sure - 4.5 * (strange and not depth) - 0.2 * (depth > 0)
    meanings |= set().union(*map(_meanings, groups))
    if turning := {"yaw", "heading", "roll"} & own:
        return "roll_angle" if turning == {"roll"} else "heading", sure
    places = {_PLACES[w] for w in leaf if w in _PLACES}
    placed = "position" in meanings or (not unclear and meanings <= own | {"aside"})
    return (places.pop(), sure) if len(places) == 1 and placed else ("", 0.0)


def _by_rule(meanings: set[str]) -> str:
    return next((out for every, some, out in _RULES if every <= meanings and (not some or some & meanings)), "")


def _without_unit(column: str) -> tuple[str, ColumnUnit | None]:
    """Return a name without its unit, which stands in brackets or at the end; other brackets stay as words."""
    unit = None
    for written, words in _SCRIPTS.items():
        column = column.replace(written, f" {words} ")
    column = re.sub(r"\[([012])\]", lambda place: f" {'xyz'[int(place[1])]}", column)  # of a vector
    for bracketed in re.findall(r"[\[(]([^\[\]()]+)[\])]", column):
        if (stated := unit_of(bracketed)) is not None:
            unit, column = stated, re.sub(rf"[\[(]{re.escape(bracketed)}[\])]", " ", column)
    column = re.sub(r"[\[\](){}\"]", " ", column.replace("CoG", "cog"))
    column = re.sub(r"(?<=[a-zäöüß])(?=[A-ZÄÖÜ])|(?<=[A-Z])(?=[A-Z][a-z]{2})", " ", column).strip(" /|_")
    for gap in re.finditer(r"[ _./|\\]+", column if unit is None else ""):
        tail = column[gap.end() :].strip().lower()
        stated = None if tail in ("h", "min") or (tail == "s" and not TIME.search(column.lower())) else unit_of(tail)
        if stated is not None and (stated.si or tail in ("%", "pct", "percent", "rpm")):
            return column[: gap.start()], stated
    return column, unit


def _cut(part: str) -> list[str]:
    """Return the words of a part of a name, small; what is written together is cut where all of it is words."""
    part = part.translate(_ACCENTS)
    tokens = re.findall(r"\b[lr]\d\b|[a-zäöüß]+|\d+", part.lower().replace("_", " "))
    return [piece for token in tokens for piece in _pieces(token)]


@functools.lru_cache(maxsize=4096)
def _pieces(token: str) -> tuple[str, ...]:
    """Return the fewest words that make up a token, a symbol in front or an axis behind; the token if none do."""
    if token in _WORDS or token in _WHOLE or len(token) < 2:
        return (token,)
    for plural, single in (("ies", "y"), ("s", "")):
        if token.endswith(plural) and token.removesuffix(plural) + single in _WORDS:
            return (token.removesuffix(plural) + single,)
    ways: list[tuple[str, ...]] = []
    for end in range(1, len(token)):
        head, tail = token[:end], token[end:]
        if head in _SYMBOLS and (tail in _LETTERS or tail in _WORDS):
            ways.append((head, tail))
        elif head in _WORDS:
            for rest in (tail, tail.removeprefix("s")):  # the joint of German compounds
                pieces = _pieces(rest)
                if all(p in _WORDS or p in _LETTERS or p == "g" for p in pieces):
                    ways.append((head, *pieces))
    return min(ways, key=len, default=(token,))


def _meanings(words: Iterable[str]) -> set[str]:
    """Return what words mean; a letter in front may be a symbol, x, y or z an axis."""
    words = list(words)
    meanings = {_WORDS[w] for w in words if w in _WORDS} | {_LETTERS[w] for w in words if w in _LETTERS}
    telling = [w for w in words if _WORDS.get(w) != "aside" and (len(w) > 1 or w in {*_SYMBOLS, *_LETTERS})]
    if len(telling) > 1 and telling[0] in _SYMBOLS:
        meanings.add(_SYMBOLS[telling[0]])
    if meanings & {"vehicle", "yaw", "lateral", "longitudinal"} and not meanings & {"speed", "acceleration", "rate"}:
        meanings |= {_SYMBOLS[w] for w in words if w in ("v", "a", "w")}
    if words[-1:] == ["g"] and meanings & {"lateral", "longitudinal", "vertical"}:
        meanings.add("acceleration")
    if "based" in words or ("steering" in meanings and "road" not in meanings):
        meanings.discard("wheel")
    return meanings
