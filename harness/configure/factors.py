"""Resolve ``[[design]]`` and its factors: levels, shifts and bands in SI, each checked against bounds."""

from __future__ import annotations

import itertools
import re
from dataclasses import dataclass
from typing import Any

from harness.configure.file import DesignTable, FactorTable
from harness.configure.limits import broken_relations, out_of_bounds
from harness.configure.problems import Problems
from harness.configure.specs import NOISE_SCALES, DesignSpec, FactorSpec, ModelSpec, Side
from harness.errors import UserError
from models.contracts import Parameter
from models.registry import closest

_PERCENT = re.compile(r"[-+]?\s*[\d.]+(?:[eE][-+]?\d+)?\s*(?:%|percent)")
_SCALE = Parameter("", "", "dimensionless", 0.0, float("inf"), "factor on every variance of its kind")
_MOST_CORNERS = 8
"""A box of up to this many factors is checked at all its corners, a larger one factor by factor."""


@dataclass(frozen=True)
class Models:
    """The two models a factor may vary."""

    plant: ModelSpec
    belief: ModelSpec

    def of(self, side: Side) -> dict[str, ModelSpec]:
        """Return the models whose values a factor of this side replaces, by name."""
        both = {"plant": self.plant, "belief": self.belief}
        return both if side == "both" else {side: both[side]}


def number(raw: Any, written_unit: str | None, unit: str, where: str) -> float:
    """Return a number of a factor in SI: text by its own unit, a plain number by the factor's ``unit`` key.

    Raises:
        UserError: If it is no number or its unit does not fit.
    """
    from harness.units import scale, to_si

    value = to_si(raw, unit, where)
    return value if written_unit is None or isinstance(raw, str) else value * scale(written_unit, unit, where)


def resolve_design(raw: DesignTable, key: str, models: Models, problems: Problems) -> DesignSpec | None:
    """Return the resolved design, or ``None`` if a problem with it was noted.

    Args:
        raw: The table.
        key: Its key path, e.g. ``design[0]``.
        models: Plant and belief, resolved.
        problems: Where problems are noted.
    """
    before = len(problems)
    factors = []
    seen: dict[tuple[str, str], str] = {}
    for i, table in enumerate(raw.factor):
        place = f"{key}.factor[{i}]"
        for side in models.of(table.of):
            first = seen.setdefault((table.parameter, side), place)
            if first != place:
                problems.add(
                    f"{place}.parameter",
                    f"'{table.parameter}' of the {side} is varied by {first} already; remove one of the two",
                )
        factor = _resolve_factor(table, place, models, problems)
        if factor is not None:
            factors.append(factor)
    if len(problems) > before:
        return None
    design = DesignSpec(raw.name, tuple(factors), raw.samples, raw.repeats)
    _check_bands(raw, design, key, problems)
    if len(problems) == before:
        _check_relations(raw, design, key, models, problems)
    return design if len(problems) == before else None


def _resolve_factor(table: FactorTable, key: str, models: Models, problems: Problems) -> FactorSpec | None:
    parameter = _parameter(table, key, models, problems)
    if parameter is None or not _check_form(table, key, problems):
        return None
    name = table.parameter
    nominal = 1.0
    if name not in NOISE_SCALES:
        nominal = models.belief.values.get(name, models.plant.values.get(name, float("nan")))
    report_unit = _report_unit(table, parameter.unit, f"{key}.unit", problems)
    if report_unit is None:
        return None
    reader = _FactorReader(table, key, parameter, nominal, report_unit, problems)
    before = len(problems)
    rows = reader.rows()
    if rows is None:
        return None
    factor = FactorSpec(
        parameter=name,
        of=table.of,
        unit=parameter.unit,
        report_unit=report_unit,
        nominal=nominal,
        levels=tuple(r.centre for r in rows),
        half_widths=tuple(r.half_width for r in rows),
        labels=tuple(table.labels or [r.label for r in rows]),
    )
    for i in range(len(rows)):
        _check_bounds(factor, i, reader.item(i), parameter, problems)
    return factor if len(problems) == before else None


def _parameter(table: FactorTable, key: str, models: Models, problems: Problems) -> Parameter | None:
    """Return the declaration of the varied parameter; every side that is varied must have it."""
    if table.parameter in NOISE_SCALES:
        return Parameter(table.parameter, *list(vars(_SCALE).values())[1:])
    found = None
    for side, spec in models.of(table.of).items():
        known = {p.name: p for p in spec.model().parameters}
        if table.parameter not in known:
            choices = [*known, *NOISE_SCALES]
            problems.add(
                f"{key}.parameter",
                f"the {side} has no parameter '{table.parameter}'{closest(table.parameter, choices)}",
            )
            return None
        found = known[table.parameter]
    return found


def _check_form(table: FactorTable, key: str, problems: Problems) -> bool:
    """Exactly one of levels, shift and bands; ``band`` only with the first two; as many labels as bands."""
    given = [k for k in ("levels", "shift", "bands") if getattr(table, k) is not None]
    if len(given) != 1:
        has = "has none of them" if not given else f"has {' and '.join(given)}"
        problems.add(key, f"a factor needs exactly one of levels, shift and bands; this one {has}")
        return False
    if table.band is not None and given == ["bands"]:
        problems.add(f"{key}.band", "'bands' gives the half-widths already; remove 'band'")
        return False
    count = len(getattr(table, given[0]))
    if table.labels is not None and len(table.labels) != count:
        problems.add(f"{key}.labels", f"{len(table.labels)} labels for {count} {given[0]}; give one each")
        return False
    return True


def _report_unit(table: FactorTable, unit: str, key: str, problems: Problems) -> str | None:
    """Return the unit of the labels: as stated, else as the first entry is written, else the SI unit.

    ``None`` if the stated unit does not fit; a unit written with an entry is judged with that entry.
    """
    from harness.units import scale

    if table.unit is not None:
        with problems.catch(key):
            scale(table.unit, unit, problems.at(key))
            return table.unit
        return None
    for raw in table.levels or table.shift or table.bands or []:
        text = _unsigned(raw)
        if isinstance(text, str) and not _PERCENT.fullmatch(text.strip()):
            written = re.sub(r"^\s*[-+]?\s*[\d.]+(?:[eE][-+]?\d+)?\s*", "", text).strip()
            try:
                scale(written, unit, key)
            except UserError:
                return unit
            return written
    return unit


def _unsigned(raw: Any) -> Any:
    """Drop the sign people write before a half-width: ``"+-5 %"``, ``"±5 %"``."""
    return re.sub(r"^\s*(?:\+/?-|±)\s*", "", raw) if isinstance(raw, str) else raw


@dataclass(frozen=True)
class _Row:
    centre: float
    half_width: float
    label: str


@dataclass(frozen=True)
class _FactorReader:
    """Reads the numbers of one factor."""

    table: FactorTable
    key: str
    parameter: Parameter
    nominal: float
    report_unit: str
    problems: Problems

    def item(self, i: int) -> str:
        """Return the key path of the i-th entry."""
        name = next(k for k in ("levels", "shift", "bands") if getattr(self.table, k) is not None)
        return f"{self.key}.{name}[{i}]"

    def rows(self) -> list[_Row] | None:
        """Return centre, half-width and label of every band, or ``None`` if a problem was noted."""
        before = len(self.problems)
        rows: list[_Row] = []
        entries: list[Any] = self.table.levels or self.table.shift or self.table.bands or []
        for i, raw in enumerate(entries):
            with self.problems.catch(self.item(i)):
                rows.append(self._row(raw, self.item(i)))
        return rows if len(self.problems) == before else None

    def _row(self, raw: Any, key: str) -> _Row:
        if self.table.bands is not None:
            width, label = self._half_width(raw, self.nominal, key)
            return _Row(self.nominal, width, label)
        if self.table.levels is not None:
            centre = self._number(raw, key)
            label = self._label(centre)
        else:
            centre, label = self._shifted(raw, key)
        if self.table.band is None:
            return _Row(centre, 0.0, label)
        width, around = self._half_width(self.table.band, centre, f"{self.key}.band")
        return _Row(centre, width, f"{label} {around}")

    def _number(self, raw: Any, key: str) -> float:
        return number(raw, self.table.unit, self.parameter.unit, self.problems.at(key))

    def _fraction(self, raw: Any, key: str) -> float | None:
        """Return a percentage as a fraction, ``None`` if the text is no percentage."""
        from harness.units import to_si

        if isinstance(raw, str) and _PERCENT.fullmatch(raw.strip()):
            return to_si(raw.strip(), "", self.problems.at(key))
        return None

    def _shifted(self, raw: Any, key: str) -> tuple[float, str]:
        fraction = self._fraction(raw, key)
        if fraction is not None:
            return self.nominal * (1 + fraction), f"{_signed(100 * fraction)} %"
        shift = self._number(raw, key)
        return self.nominal + shift, self._label(shift, sign=True)

    def _half_width(self, raw: Any, centre: float, key: str) -> tuple[float, str]:
        text = _unsigned(raw)
        fraction = self._fraction(text, key)
        width = self._number(text, key) if fraction is None else fraction * abs(centre)
        if not width > 0:
            why = (
                "percent of a level of zero is nothing; give the half-width in the parameter's unit"
                if fraction
                else "a half-width must be positive; for a single value use 'levels' without a band"
            )
            raise UserError(f"{self.problems.at(key)}: {why}")
        shown = f"{100 * fraction:g} %" if fraction is not None else self._label(width)
        return width, f"±{shown}"

    def _label(self, value: float, sign: bool = False) -> str:
        """Write a number in the report unit."""
        from harness.units import scale

        if self.parameter.name in NOISE_SCALES:
            return f"×{value:g}"
        shown = value / scale(self.report_unit, self.parameter.unit, self.key)
        text = _signed(shown) if sign else f"{shown:.6g}"
        return text if self.report_unit in ("", "dimensionless") else f"{text} {self.report_unit}"


def _signed(value: float) -> str:
    return f"{value:+.6g}" if value else "0"


def _check_bounds(factor: FactorSpec, i: int, key: str, parameter: Parameter, problems: Problems) -> None:
    for edge in dict.fromkeys((factor.lower[i], factor.upper[i])):
        wrong = out_of_bounds(parameter, edge)
        if wrong is None and factor.parameter in NOISE_SCALES and factor.of != "plant" and edge == 0:
            wrong = "an estimator cannot work with variances of zero; give a positive factor"
        if wrong is not None:
            reach = f"the band {factor.labels[i]} reaches too far: " if factor.half_widths[i] else ""
            problems.add(key, reach + wrong)


def _check_bands(raw: DesignTable, design: DesignSpec, key: str, problems: Problems) -> None:
    counts = {f.parameter: len(f.levels) for f in design.factors}
    if len(set(counts.values())) > 1:
        listed = ", ".join(f"{name} {n}" for name, n in counts.items())
        problems.add(
            f"{key}.factor",
            f"the i-th bands of all factors belong together, but their numbers differ ({listed}); "
            "give each factor as many, or put the factors into designs of their own",
        )
        return
    banded, n = any(f.banded for f in design.factors), design.samples
    if banded and n == 1:
        problems.add(
            f"{key}.samples",
            "a band is sampled by a Sobol sequence; give samples = 16 or another power of two",
        )
    elif not banded and n > 1:
        problems.add(
            f"{key}.samples",
            f"{n} samples of the same point, as no factor has a band; give a band, or use repeats = {n}",
        )
    elif n & (n - 1) and not raw.sobol_any_n:
        low = 1 << (n.bit_length() - 1)
        problems.add(
            f"{key}.samples",
            f"{n} is no power of two: the first N points of a Sobol sequence fill every half, quarter ... "
            f"of a band equally often only for N = 2^k; take {low} or {2 * low}, or set "
            "sobol_any_n = true",
        )


def _check_relations(raw: DesignTable, design: DesignSpec, key: str, models: Models, problems: Problems) -> None:
    """Ask the vehicle's ``check`` at the corners of every band."""
    for band in range(design.bands):
        for side in ("plant", "belief"):
            spec = models.plant if side == "plant" else models.belief
            varied = [f for f in design.factors if f.of in (side, "both") and f.parameter not in NOISE_SCALES]
            wrong: dict[str, str] = {}
            for corner in _corners(varied, band):
                for name, message in broken_relations(spec.vehicle, {**spec.values, **corner}):
                    wrong.setdefault(name, message)
            for name, message in wrong.items():
                at = next((i for i, f in enumerate(raw.factor) if f.parameter == name), None)
                kind = "levels"
                if at is not None:
                    kind = next(k for k in ("levels", "shift", "bands") if getattr(raw.factor[at], k) is not None)
                place = f"{key}.factor" if at is None else f"{key}.factor[{at}].{kind}[{band}]"
                problems.add(place, f"{design.band_labels[band]} of the {side}: {name}: {message}")


def _corners(factors: list[FactorSpec], band: int) -> list[dict[str, float]]:
    """Return the corners of a band's box; of a large box those where one factor is at an edge."""
    edges = {f.parameter: tuple(dict.fromkeys((f.lower[band], f.upper[band]))) for f in factors}
    if len(factors) <= _MOST_CORNERS:
        return [dict(zip(edges, point, strict=True)) for point in itertools.product(*edges.values())]
    centre = {f.parameter: f.levels[band] for f in factors}
    return [{**centre, name: edge} for name, pair in edges.items() for edge in pair]
