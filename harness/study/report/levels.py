"""A level of a design in words, such as ``with the trailer mass 30 % lighter than believed``.

Levels that a study states as differences (``shift``, ``bands``) are said as differences, all others by their values.
"""

from __future__ import annotations

import math
import re

from harness.models.quantities import listed
from harness.study.results import Design

NAMED = 4
"""Factors of a design up to which each is named."""

_COMPARATIVES = {
    "kg": ("lighter", "heavier"),
    **dict.fromkeys(("N/m", "N/rad", "N*m/rad"), ("softer", "stiffer")),
}
"""Less and more of a quantity by its SI unit."""

_OTHERS = ("smaller", "larger")

_LABEL = re.compile(r"([+-]?)(\d+(?:\.\d+)?(?:e[+-]?\d+)?)( [^±]+)?(?: (±.+))?")
"""Sign, number, unit and band of the label of a level."""


def phrase(design: Design, band: int, home: int | None = None) -> str:
    """Say which level is meant, and what it is compared with.

    Args:
        design: The design.
        band: Index of the level.
        home: Index of the level that it is compared with; ``None`` if that is not to be said.
    """
    if not design.factors:
        return "in the case as stated"
    if design.whole:
        return f"over the {design.whole} of {varied(design)}"
    said = _difference(design, band)
    text = _value(design, band) if said is None else f"with {said[0]}"
    if home is None:
        return text
    other = None if said is None else _difference(design, home)
    if other is not None:
        return f"{text} instead of {other[1]}" if other[1] else text
    named = home == design.matched and all(f.of == "plant" for f in design.factors) and _is_single(design, home)
    return f"{text} instead of {f'the {design.nominal_is} ' if named else ''}{design.bands[home]}"


def varied(design: Design) -> str:
    """Name the factors of a design; of more than ``NAMED`` say only how many there are."""
    names = [f.words for f in design.factors]
    return listed(names) if len(names) <= NAMED else f"{len(names)} factors"


def _is_single(design: Design, band: int) -> bool:
    """Whether the label of a level is the value of one factor."""
    return len(design.factors) == 1 and not design.bands[band].startswith("±")


def _value(design: Design, band: int) -> str:
    """Say a level by its label, e.g. ``with the trailer mass at 8 t``."""
    label = design.bands[band]
    if label.startswith("±"):
        return f"with the {varied(design)} within {label}"
    if len(design.factors) == 1:
        return f"with the {varied(design)} {'believed to be' if design.factors[0].of == 'belief' else 'at'} {label}"
    return f"with {label}" if all(f.words in label for f in design.factors) else f"at the level {label}"


def _difference(design: Design, band: int) -> tuple[str, str] | None:
    """Say a level as a difference from what is believed, and the difference alone, empty where there is none.

    ``None`` where the study states it as a value, or in words of its own.
    """
    factors, labels = design.factors, _labels(design, band)
    as_what = design.nominal_is
    owner = "believed to be " if all(f.of == "belief" for f in factors) else ""
    exactly = f"the {varied(design)} {owner}as {as_what}", ""
    width, *others = dict.fromkeys(re.sub(r"^0[^±]* (?=±)", "", label) for label in labels)  # of a shift by nothing
    if width.startswith("±") and not others:
        if all(f.lower[band] == f.upper[band] for f in factors):
            return exactly
        if all(math.isclose((f.lower[band] + f.upper[band]) / 2, f.nominal, rel_tol=1e-6) for f in factors):
            return f"the {varied(design)} {owner}within {width} of what is {as_what}", width
    amounts = [_amount(design, i, band, label) for i, label in enumerate(labels)]
    if None in amounts:
        return None
    some = [(f.words, amount) for f, amount in zip(factors, amounts, strict=True) if amount]
    if not some:
        return exactly
    differences = list(dict.fromkeys(amount for _, amount in some))
    if len(differences) == 1 and len(some) == len(factors):
        return f"the {varied(design)} {owner}{differences[0]} than {as_what}", str(differences[0])
    each = listed([f"the {name} {owner}{amount}" for name, amount in some])
    return f"{each} than {as_what}", listed([f"the {name} {amount}" for name, amount in some])


def _labels(design: Design, band: int) -> list[str]:
    """Return the label of each factor in a level: the part behind its name, or what all share."""
    label, parts = design.bands[band], design.bands[band].split(", ")
    named = len(parts) == len(design.factors) > 1
    if named and all(part.startswith(f"{f.words} ") for part, f in zip(parts, design.factors, strict=True)):
        return [part.removeprefix(f"{f.words} ") for part, f in zip(parts, design.factors, strict=True)]
    return [label] * len(design.factors)


def _amount(design: Design, index: int, band: int, label: str) -> str | None:
    """Return by how much a factor differs, e.g. ``30 % softer``; empty for nothing, ``None`` for another label."""
    match, factor = _LABEL.fullmatch(label), design.factors[index]
    if match is None or not factor.nominal:
        return None
    sign, size, unit, around = match.groups()
    number = float(sign + size)
    shift = (factor.lower[band] + factor.upper[band]) / 2 - factor.nominal
    stated = number / 100 * factor.nominal if unit == " %" else number
    if bool(sign) != bool(number) or not math.isclose(shift, stated, rel_tol=1e-4, abs_tol=1e-9 * abs(factor.nominal)):
        return None
    if not number:
        return ""
    comparative = _COMPARATIVES.get(str(design.data[f"factor_{factor.name}"].attrs.get("units")), _OTHERS)[number > 0]
    return f"{size}{unit or ''} {comparative}" + (f" ({around})" if around else "")
