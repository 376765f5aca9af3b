"""Reader of tyre property files (``.tir``) of PAC2002, MF 5.2, 6.1 and 6.2: coefficients of ``magic_formula_61``.

Pacejka 2006 and 2012, 4.3; MSC Adams/Tire, PAC2002. Only what a lateral force reads is taken. A negative ``PKY1`` says
that the file has the signs of ISO (W axes, a positive slip angle makes a negative force), a positive one those of the
adapted SAE. Files of a left and a right tyre (``TYRESIDE``) are mirror images: an axle has the same curve with either.
"""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from harness.common.errors import UserError
from harness.common.files import read_content, with_unix_lines
from harness.config.bounds import out_of_bounds
from harness.models.tyres import magic_formula_61

TYRE = "magic_formula_61"

_SCALES = {
    "LENGTH": {"meter": 1.0, "m": 1.0, "mm": 1e-3, "millimeter": 1e-3, "cm": 1e-2, "km": 1e3, "inch": 0.0254,
               "in": 0.0254, "foot": 0.3048, "ft": 0.3048},
    "FORCE": {"newton": 1.0, "n": 1.0, "kn": 1e3, "knewton": 1e3, "kilonewton": 1e3, "pound_force": 4.4482216152605,
              "lbf": 4.4482216152605, "kg_force": 9.80665, "kgf": 9.80665},
    "PRESSURE": {"pascal": 1.0, "pa": 1.0, "kpascal": 1e3, "kpa": 1e3, "bar": 1e5, "psi": 6894.757293168},
    "ANGLE": {"radian": 1.0, "radians": 1.0, "rad": 1.0},
}  # fmt: skip
_UNIT_OF = {
    **dict.fromkeys(("FNOMIN", "FZMIN", "FZMAX"), ("FORCE",)),
    **dict.fromkeys(("IP", "IP_NOM", "INFLPRES", "NOMPRES"), ("PRESSURE",)),
    "UNLOADED_RADIUS": ("LENGTH",),
    "LATERAL_STIFFNESS": ("FORCE", "LENGTH"),  # over
}
_NEEDED = ("FNOMIN", "PCY1", "PDY1", "PKY1", "PKY2")
"""Without one of these there is no force; the signs of ``PDY1`` and ``PKY1`` are those of the axes."""
_SMALLEST, _LARGEST = 1e-6, 1e9
"""Of what there is no force without, and of any number in SI units: their squares are numbers."""
_TAKEN = re.compile(
    r"P[CDEKHV]Y\d|PPY\d|PTY\d|PCFY\d|L(FZO|CY|MUY|EY|KY|KYC|KYG|GAY|SGAL)|FITTYP|" + "|".join(_UNIT_OF)
)
_MARK = re.compile(r"[!$]")
_READ = "PAC2002 and Magic Formula 5.2, 6.1 and 6.2 are read"
_FITTYP = {5: False, 6: False, 61: True, 62: True}
"""Whether the value of FITTYP means MF 6.x."""


@dataclass(frozen=True)
class TyreFile:
    """One tyre of a property file.

    Attributes:
        path: The file.
        kind: Its equations in words.
        coefficients: Parameters of ``magic_formula_61`` but for the number of tyres, SI units.
        loads: Smallest and largest load of the measurements in N.
        radius: Unloaded radius in m; 0 where it is not stated.
        transient: Coefficients of the relaxation length.
    """

    path: Path
    kind: str
    coefficients: dict[str, float]
    loads: tuple[float, float]
    radius: float
    transient: dict[str, float]

    def stiffness(self, load: float) -> float:
        """Return the cornering stiffness of one tyre in N/rad without camber (4.E25)."""
        c = self.coefficients
        dp = c["pressure"] / c["nominal_pressure"] - 1
        peak = c["nominal_load"] * c["pky2"] * (1 + c["ppy2"] * dp)
        return c["pky1"] * c["nominal_load"] * (1 + c["ppy1"] * dp) * math.sin(c["pky4"] * math.atan2(load, peak))

    def relaxation(self, load: float) -> float:
        """Return the relaxation length in m at a load of a tyre in N; 0 where the file states none.

        It is stiffness over lateral stiffness (MF 6.1), or ``PTY1 sin(2 atan(F_z / (PTY2 F_z0))) R_0`` (5.2).
        """
        t, nominal = self.transient, self.coefficients["nominal_load"]
        df = load / nominal - 1
        if (rigid := t["LATERAL_STIFFNESS"]) > 0:
            dp = self.coefficients["pressure"] / self.coefficients["nominal_pressure"] - 1
            rigid *= (1 + t["PCFY1"] * df + t["PCFY2"] * df**2) * (1 + t["PCFY3"] * dp)
            return self.stiffness(load) / rigid * t["LSGAL"] if rigid > 0 else 0.0
        if t["PTY1"] == 0 or t["PTY2"] == 0 or self.radius == 0:
            return 0.0
        turned = math.sin(2 * math.atan2(load, t["PTY2"] * nominal))
        return abs(t["PTY1"] * turned * self.radius * t["LFZO"] * t["LSGAL"])


def read_tyre_file(path: Path) -> TyreFile:
    """Return the tyre of a property file.

    Raises:
        UserError: If it is no property file of a version that is read, lacks a coefficient, or has one that is no
            number; with line and remedy.
    """
    words, lines = _entries(path)
    new = _is_new(words, path)
    scales = _scales(words, path)
    numbers = {key: _number(value, f"{path}: line {lines[key]}: {key}") for key, value in words.items()
               if _TAKEN.fullmatch(key)}  # fmt: skip
    for key, (unit, *under) in _UNIT_OF.items():
        if key in numbers:
            numbers[key] *= scales[unit] / (scales[under[0]] if under else 1.0)
    if lacking := [key for key in _NEEDED if key not in numbers]:
        raise UserError(f"{path}: no {', '.join(lacking)}: without these there is no lateral force; {_READ}")
    for key in _NEEDED:
        if abs(numbers[key]) < _SMALLEST or (key not in ("PDY1", "PKY1") and numbers[key] < 0):
            raise UserError(f"{path}: line {lines[key]}: {key} = {numbers[key]:g} cannot be; the tyre has no force")
    radius, transient = numbers.get("UNLOADED_RADIUS", 0.0), {"LFZO": 1.0, "LSGAL": 1.0}
    transient = {k: numbers.get(k, transient.get(k, 0.0)) for k in
                 ("LATERAL_STIFFNESS", "PCFY1", "PCFY2", "PCFY3", "PTY1", "PTY2", "LFZO", "LSGAL")}  # fmt: skip
    kind = f"MF 6.{int(numbers['FITTYP']) % 10}" if new else words.get("PROPERTY_FILE_FORMAT", "MF 5.2")
    loads = numbers.get("FZMIN", 0.0), numbers.get("FZMAX", math.inf)
    coefficients = _coefficients(numbers, new)
    for parameter in magic_formula_61.PARAMETERS:
        wrong = out_of_bounds(parameter, coefficients.get(parameter.name, parameter.lower))
        if wrong is not None:
            raise UserError(f"{path}: {wrong}")
    return TyreFile(path, kind, coefficients, loads, radius, transient)


def _entries(path: Path) -> tuple[dict[str, str], dict[str, int]]:
    """Return the values as they are written and their lines, by key in capitals."""
    words: dict[str, str] = {}
    lines: dict[str, int] = {}
    text = with_unix_lines(read_content(path).decode("latin-1"))  # a comment may have a sign of any code page
    for i, line in enumerate(text.split("\n"), 1):
        if line.lstrip().startswith(("!", "$", "{", "[")):
            continue
        key, is_entry, value = line.partition("=")
        key, value = key.strip().upper(), value.strip()
        if not is_entry or not re.fullmatch(r"\w+", key):
            continue
        quoted = re.match(r"(['\"])(.*?)\1", value)
        value = quoted[2].strip() if quoted else _MARK.split(value)[0].strip()
        if key in words and words[key] != value and _TAKEN.fullmatch(key):
            raise UserError(
                f"{path}: {key} is {words[key]} in line {lines[key]} and {value} in line {i}; delete the wrong one"
            )
        words[key], lines[key] = value, i
    return words, lines


def _is_new(words: Mapping[str, str], path: Path) -> bool:
    """Whether the equations are those of MF 6.x."""
    kind, fit = words.get("PROPERTY_FILE_FORMAT", ""), words.get("FITTYP", "")
    number = int(float(fit)) if re.fullmatch(r"\d+(\.0*)?", fit) else None
    if number in _FITTYP:
        return _FITTYP[number]
    if fit == "" and kind.upper() in ("PAC2002", "MF_05", "MF_52", "MF-TYRE 5.2"):
        return False
    stated = [f"{k} = {v}" for k, v in (("PROPERTY_FILE_FORMAT", kind), ("FITTYP", fit)) if v]
    what = " and ".join(stated) or "neither PROPERTY_FILE_FORMAT nor FITTYP, so it is no tyre property file"
    raise UserError(f"{path}: states {what}; {_READ} (FITTYP 5, 6, 61, 62); export the tyre as one of these")


def _scales(words: Mapping[str, str], path: Path) -> dict[str, float]:
    """Return SI units per unit of the file; SI where it states none."""
    scales = {}
    for kind, names in _SCALES.items():
        unit = words.get(kind, next(iter(names))).lower()
        if unit not in names:
            why = " (a coefficient counts radians)" if kind == "ANGLE" else ""
            raise UserError(f"{path}: [UNITS] {kind} = '{unit}' is not read{why}; write one of {', '.join(names)}")
        scales[kind] = names[unit]
    return scales


def _number(text: str, where: str) -> float:
    try:
        number = float(re.sub(r"(?<=[\d.])[dD](?=[+-]?\d)", "e", text))
    except ValueError:
        number = math.nan
    if not math.isfinite(number) or "_" in text:
        raise UserError(f"{where}: '{text}' is no number; write it with a decimal point")
    if abs(number) > _LARGEST:
        raise UserError(f"{where}: {text} is larger than any coefficient of a tyre")
    return number


def _coefficients(given: Mapping[str, float], new: bool) -> dict[str, float]:
    """Return the parameters of ``magic_formula_61``: scaled, and in its signs."""
    n = {f"P{letter}Y{i}": 0.0 for letter in "CDEKHVP" for i in range(1, 8)} | {"PKY4": 2.0} | dict(given)
    if not new:
        n |= {"PKY4": 2.0, "PKY5": 0.0, "PEY5": 0.0, "PPY5": 0.0}
    factor = {key: given.get(key, 1.0) for key in ("LFZO", "LCY", "LMUY", "LEY", "LKY", "LKYC", "LKYG", "LGAY")}
    friction = factor["LMUY"]
    leaning, camber = (1.0, factor["LKYC"]) if new else (factor["LGAY"], factor["LKYG"])
    to_iso = -math.copysign(1.0, n["PKY1"])  # of forces and their slopes
    grip = math.copysign(friction, n["PDY1"])
    # the degressive friction factor of 6.1 (4.E8, A_mu = 10) on the vertical shift
    lifted = to_iso * camber * leaning * (10 * friction / (1 + 9 * friction) if new else friction)
    vertical = {key: lifted * n[key.upper()] for key in ("pvy3", "pvy4")}
    gained = to_iso * camber
    of_pressure = {f"ppy{i}": n[f"PPY{i}"] for i in range(1, 6)}
    nominal = given.get("NOMPRES" if new else "IP_NOM", 0.0)
    actual = given.get("INFLPRES" if new else "IP", nominal)
    if not nominal > 0 or not actual > 0:  # nothing to count the change of pressure from
        nominal = actual = 2e5
        of_pressure = dict.fromkeys(of_pressure, 0.0)
    return {
        "nominal_load": n["FNOMIN"] * factor["LFZO"],
        "nominal_pressure": nominal,
        "tangent": float(new),
        "pressure": actual,
        "pcy1": n["PCY1"] * factor["LCY"],
        "pdy1": n["PDY1"] * grip,
        "pdy2": n["PDY2"] * grip,
        "pdy3": n["PDY3"] * leaning**2,
        "pey1": n["PEY1"] * factor["LEY"],
        "pey2": n["PEY2"] * factor["LEY"],
        "pey4": -n["PEY4"] * leaning,
        "pey5": n["PEY5"] * leaning**2,
        "pky1": abs(n["PKY1"]) * factor["LKY"],
        "pky2": n["PKY2"],
        "pky3": n["PKY3"] * abs(leaning),
        "pky4": n["PKY4"],
        "pky5": n["PKY5"] * leaning**2,
        "pky6": gained * n["PKY6"] if new else vertical["pvy3"],
        "pky7": gained * n["PKY7"] if new else vertical["pvy4"],
        "phy3": -n["PHY3"] * leaning * camber if not new else 0.0,
        **vertical,
        **of_pressure,
    }
