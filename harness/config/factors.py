"""Resolve the factors of a design: levels, shifts, bands and ranges in SI, each checked against bounds."""

from __future__ import annotations

import math
import re
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from harness.common.errors import UserError
from harness.common.registry import closest
from harness.config.bounds import out_of_bounds, quantity
from harness.config.derived import derived_parameters, derived_value
from harness.config.design_tables import DistributionTable, FactorTable
from harness.config.distributions import DistributionReader
from harness.config.marginals import EDGE, Marginal
from harness.config.parameter_set import set_std
from harness.config.problems import Problems
from harness.config.specs import NOISE_SCALES, FactorSpec, ModelSpec, Side
from harness.models.contracts import Parameter

_PERCENT = ("%", "percent")
_SCALE = Parameter("", "", "dimensionless", 0.0, float("inf"), "factor on every variance of its kind")
_LONGEST = 200
"""Bytes of a name; file systems allow 255, with what a store adds to it."""
_NEEDED = {
    "process_noise": "process noise to multiply; state it, {0}.noise.process, for a state or disturbance of its own",
    "input_noise": "noise of inputs to multiply; state it, e.g. {0}.noise.input.speed",
}
FORMS = ("levels", "shift", "bands", "range", "distribution")
"""The keys of a factor that say what values it takes; each has exactly one of them."""


@dataclass(frozen=True)
class Models:
    """The two models a factor may vary, and the folder of the study."""

    plant: ModelSpec
    belief: ModelSpec
    folder: Path = Path()

    def sides(self, side: Side) -> dict[str, ModelSpec]:
        """Return the models whose values a factor of this side replaces, by name."""
        both = {"plant": self.plant, "belief": self.belief}
        return both if side == "both" else {side: both[side]}


def number(raw: Any, written_unit: str | None, unit: str, where: str) -> float:
    """Return a number of a factor in SI: text by its own unit, a plain number by the factor's ``unit`` key.

    Raises:
        UserError: If it is no number or its unit does not fit.
    """
    from harness.common.units import scale, to_si

    value = to_si(raw, unit, where)
    return value if written_unit is None or isinstance(raw, str) else value * scale(written_unit, unit, where)


def resolve_factor(table: FactorTable, key: str, models: Models, problems: Problems) -> FactorSpec | None:
    """Return the resolved factor, or ``None`` if a problem with it was noted.

    Args:
        table: The table.
        key: Its key path, e.g. ``design[0].factor[1]``.
        models: Plant and belief, resolved.
        problems: Where problems are noted.
    """
    parameter = _parameter(table, key, models, problems)
    if (
        parameter is None
        or not _check_name(table.parameter, key, models, table.of, problems)
        or not _check_noise(table, key, models, problems)
        or not _check_form(table, key, problems)
    ):
        return None
    name = table.parameter
    nominal = 1.0 if name in NOISE_SCALES else _nominal(name, models)
    report_unit = _report_unit(table, parameter.unit, f"{key}.unit", problems)
    if report_unit is None:
        return None
    stated = distribution_reader(table, problems.at(f"{key}.distribution"), parameter, nominal, models)
    reader = _FactorReader(table, key, parameter, nominal, report_unit, problems, stated)
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
        lower=tuple(r.lower for r in rows),
        upper=tuple(r.upper for r in rows),
        labels=tuple(table.labels or [r.label for r in rows]),
        log=table.scale == "log" or (stated is not None and stated.table.kind == "log_uniform"),
        marginal=rows[0].marginal,
    )
    for i in range(len(rows)):
        _check_bounds(factor, i, reader.item(i), parameter, problems)
    return factor if len(problems) == before else None


def distribution_reader(
    table: FactorTable, where: str, parameter: Parameter, nominal: float, models: Models
) -> DistributionReader | None:
    """Return what reads the distribution of a factor; ``None`` of one without."""
    if table.distribution is None:
        return None
    stated = table.distribution
    if isinstance(stated, str):
        stated = DistributionTable.model_validate({"kind": stated})
    stds = (set_std(model, models.folder) for model in (models.belief, models.plant))
    std = next((each[parameter.name] for each in stds if parameter.name in each), None)

    def read(raw: Any, place: str) -> float:
        return number(raw, table.unit, parameter.unit, place)

    return DistributionReader(stated, where, parameter, nominal, read, std, models.folder)


def completed(table: FactorTable, spec: FactorSpec, models: Models) -> FactorTable:
    """Return the table of a resolved factor with all that its distribution takes from a set or a file written out."""
    parameter = Parameter(spec.parameter, "", spec.unit, -math.inf, math.inf, "")
    reader = distribution_reader(table, "", parameter, spec.nominal, models)
    return table if reader is None else table.model_copy(update={"distribution": reader.complete()})


def _check_name(name: str, key: str, models: Models, side: Side, problems: Problems) -> bool:
    """A name must be that of one thing alone, and of an array in a store."""
    for spec in models.sides(side).values():
        remedy = "[parameters] of its map" if spec.external and spec.external.description.kind == "fmu" else "its class"
        if name in NOISE_SCALES and any(p.name == name for p in spec.model().parameters):
            wrong = "is the factor on all variances of a kind, and a parameter of the plant as well"
        elif any(c in "/\\" or not c.isprintable() for c in name):
            wrong = "separates folders or is no plain text, which the name of an array in a result cannot"
        elif len(name.encode()) > _LONGEST:
            wrong = f"is longer than {_LONGEST} bytes, which is too long for the name of an array in a result"
        else:
            continue
        problems.add(f"{key}.parameter", f"{name!r} {wrong}; give the parameter another name in {remedy}")
        return False
    return True


def _check_noise(table: FactorTable, key: str, models: Models, problems: Problems) -> bool:
    """A factor on the noise of states or inputs needs some; that of outputs is always there."""
    kind = table.parameter.removesuffix("_scale")
    sides = models.sides(table.of).items() if kind in _NEEDED else ()
    lacking = [side for side, spec in sides if not any(getattr(spec, kind).values())]
    if lacking:
        what = _NEEDED[kind].format(lacking[0])
        problems.add(f"{key}.parameter", f"the {lacking[0]} has no {what}")
    return not lacking


def is_believed(name: str, belief: ModelSpec) -> bool:
    """Return whether a belief holds what a factor varies, so that the nominal value is its."""
    return name in NOISE_SCALES or name in belief.values or name in derived_parameters(belief)


def _nominal(name: str, models: Models) -> float:
    """Return what the belief holds, or the plant where the belief has no such quantity."""
    for spec in (models.belief, models.plant):
        if name in spec.values:
            return spec.values[name]
        if name in derived_parameters(spec):
            return derived_value(spec, name)
    return float("nan")


def _parameter(table: FactorTable, key: str, models: Models, problems: Problems) -> Parameter | None:
    """Return the declaration of the varied parameter; every side that is varied must have it."""
    if table.parameter in NOISE_SCALES:
        return Parameter(table.parameter, *list(vars(_SCALE).values())[1:])
    parameter = None
    for side, spec in models.sides(table.of).items():
        parameters = derived_parameters(spec) | {p.name: p for p in spec.model().parameters}
        if table.parameter not in parameters:
            choices = [*parameters, *NOISE_SCALES]
            problems.add(
                f"{key}.parameter",
                f"the {side} has no parameter '{table.parameter}'{closest(table.parameter, choices)}",
            )
            return None
        parameter = parameters[table.parameter]
    return parameter


def _check_form(table: FactorTable, key: str, problems: Problems) -> bool:
    """Exactly one of the forms; ``band`` only with the first two; as many labels as bands."""
    given = [k for k in FORMS if getattr(table, k) is not None]
    if len(given) != 1:
        has = "has none of them" if not given else f"has {' and '.join(given)}"
        problems.add(key, f"a factor needs exactly one of levels, shift, bands, range and distribution; this one {has}")
        return False
    if table.band is not None and given[0] not in ("levels", "shift"):
        problems.add(f"{key}.band", f"'{given[0]}' gives the width already; remove 'band'")
        return False
    if given == ["distribution"] and table.scale == "log":
        problems.add(f"{key}.scale", "a distribution says itself how a factor is filled; remove 'scale'")
        return False
    count = 1 if given[0] in ("range", "distribution") else len(getattr(table, given[0]))
    if table.labels is not None and len(table.labels) != count:
        problems.add(f"{key}.labels", f"{len(table.labels)} labels for {count} {given[0]}; give one each")
        return False
    return True


def _report_unit(table: FactorTable, unit: str, key: str, problems: Problems) -> str | None:
    """Return the unit of the labels: as stated, else as the first entry is written, else the SI unit.

    ``None`` if the stated unit does not fit; a unit written with an entry is judged with that entry.
    """
    from harness.common.units import scale

    if table.unit is not None:
        with problems.catch(key):
            scale(table.unit, unit, problems.at(key))
            return table.unit
        return None
    relative = () if table.levels or table.range else _PERCENT  # of what is nominal
    written = next((w for w in map(_written_unit, _entries(table)) if w and w not in relative), None)
    if written is None:
        return unit
    try:
        scale(written, unit, key)
    except UserError:
        return unit
    return written


def _written_unit(raw: Any) -> str | None:
    """Return the unit that an entry is written with, ``None`` for a plain number and for what cannot be read."""
    from harness.common.units import split

    parts = split(_unsigned(raw)) if isinstance(raw, str) else None
    return None if parts is None else parts[1]


def _entries(table: FactorTable) -> list[Any]:
    """Return the numbers of the one form that is given."""
    if isinstance(stated := table.distribution, DistributionTable):
        quantiles = list((stated.quantiles or {}).values())
        return [*(stated.range or quantiles or stated.values or []), *filter(None, (stated.mean, stated.std))]
    return table.levels or table.shift or table.bands or table.range or []


def _unsigned(raw: Any) -> Any:
    """Drop the sign that may precede a half-width: ``"+-5 %"``, ``"±5 %"``."""
    return re.sub(r"^\s*(?:\+/?-|±)\s*", "", raw) if isinstance(raw, str) else raw


def form(table: FactorTable) -> str:
    """Return the key that says what values the factor takes."""
    return next(k for k in FORMS if getattr(table, k) is not None)


@dataclass(frozen=True)
class _Row:
    centre: float
    lower: float
    upper: float
    label: str
    marginal: Marginal | None = None


@dataclass(frozen=True)
class _FactorReader:
    """Reads the numbers of one factor."""

    table: FactorTable
    key: str
    parameter: Parameter
    nominal: float
    report_unit: str
    problems: Problems
    distribution: DistributionReader | None = None

    def item(self, i: int) -> str:
        """Return the key path of the i-th entry."""
        name = form(self.table)
        return f"{self.key}.{name}" if name in ("range", "distribution") else f"{self.key}.{name}[{i}]"

    def rows(self) -> list[_Row] | None:
        """Return centre, half-width and label of every band, or ``None`` if a problem was noted."""
        before = len(self.problems)
        rows: list[_Row] = []
        if self.distribution is not None:
            with self.problems.catch(self.item(0)):
                rows.append(self._distributed(self.distribution))
        elif self.table.range is not None:
            with self.problems.catch(self.item(0)):
                rows.append(self._range(self.table.range))
        else:
            for i, raw in enumerate(_entries(self.table)):
                with self.problems.catch(self.item(i)):
                    rows.append(self._row(raw, self.item(i)))
        if self.table.scale == "log" and any(row.lower <= 0.0 for row in rows):
            self.problems.add(f"{self.key}.scale", "a logarithm needs values above zero; raise the lower edge")
        return rows if len(self.problems) == before else None

    def _distributed(self, distribution: DistributionReader) -> _Row:
        marginal = distribution.marginal()
        if marginal.kind in ("uniform", "log_uniform"):  # a band, filled as one
            low, high = marginal.arguments
            middle = (low + high) / 2 if marginal.kind == "uniform" else math.sqrt(low * high)
            return _Row(middle, low, high, f"{self._label(low)} to {self._label(high)}")
        if wrong := _reaches_beyond(marginal, self.parameter):
            raise UserError(wrong)
        low, middle, high = marginal.at(np.array([0.05, 0.5, 0.95])).tolist()
        words = marginal.kind.replace("_", " ")
        return _Row(middle, *marginal.ends(EDGE), f"{self._label(low)} to {self._label(high)} ({words})", marginal)

    def _range(self, entries: list[Any]) -> _Row:
        lower, upper = (self._number(raw, f"{self.key}.range[{i}]") for i, raw in enumerate(entries))
        if not lower < upper:
            raise UserError(
                f"{self.problems.at(self.item(0))}: the lower edge comes first and lies below the upper; "
                f"got {entries[0]!r} and {entries[1]!r}"
            )
        middle = math.sqrt(lower * upper) if self.table.scale == "log" and lower > 0.0 else (lower + upper) / 2
        return _Row(middle, lower, upper, f"{self._label(lower)} to {self._label(upper)}")

    def _row(self, raw: Any, key: str) -> _Row:
        if self.table.bands is not None:
            width, label = self._half_width(raw, self.nominal, key)
            return self._around(self.nominal, width, label)
        if self.table.levels is not None:
            centre = self._number(raw, key)
            label = self._label(centre)
        else:
            centre, label = self._shifted(raw, key)
        if self.table.band is None:
            return _Row(centre, centre, centre, label)
        width, around = self._half_width(self.table.band, centre, f"{self.key}.band")
        return self._around(centre, width, f"{label} {around}")

    def _around(self, centre: float, width: float, label: str) -> _Row:
        return _Row(centre, centre - width, centre + width, label)

    def _number(self, raw: Any, key: str) -> float:
        return number(raw, self.table.unit, self.parameter.unit, self.problems.at(key))

    def _fraction(self, raw: Any, key: str) -> float | None:
        """Return a percentage as a fraction, ``None`` if the text is no percentage."""
        from harness.common.units import to_si

        if _written_unit(raw) in _PERCENT:
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
        itself = self.table.bands is not None and width == 0 and not fraction  # the nominal value, no band
        if not width > 0 and not itself:
            if width < 0 or (fraction or 0.0) < 0:
                why = f"a half-width has no sign, got {raw!r}; leave it out, or state a one-sided change by 'shift'"
            elif fraction:
                why = "percent of a level of zero is zero; give the half-width in the parameter's unit"
            else:
                why = "a half-width must be positive; for a single value use 'levels' without a band"
            raise UserError(f"{self.problems.at(key)}: {why}")
        shown = f"{100 * fraction:g} %" if fraction is not None else self._label(width)
        return width, f"±{shown}"

    def _label(self, value: float, sign: bool = False) -> str:
        """Write a number in the report unit."""
        from harness.common.units import scale

        if self.parameter.name in NOISE_SCALES:
            return f"×{value:g}"
        shown = value / scale(self.report_unit, self.parameter.unit, self.key)
        text = _signed(shown) if sign else f"{shown:.6g}"
        return text if self.report_unit in ("", "dimensionless") else f"{text} {self.report_unit}"


def _signed(value: float) -> str:
    return f"{value:+.6g}" if value else "0"


def _reaches_beyond(marginal: Marginal, parameter: Parameter) -> str | None:
    """Return the bound that a distribution breaks in words, or ``None``."""
    low, high = marginal.ends()
    for value, side, least in ((low, "below", "smallest"), (high, "above", "largest")):
        if out_of_bounds(parameter, value) is None:
            continue
        bound = parameter.lower if side == "below" else parameter.upper
        chance = marginal.below(bound) if side == "below" else 1.0 - marginal.below(bound)
        remedy = "state a smaller 'std'" if marginal.kind == "lognormal" else "keep within the bounds"
        if marginal.kind == "normal":
            remedy = 'write kind = "truncated_normal", which ends at the bounds'
        return (
            f"the distribution reaches too far: {parameter.name} lies {side} {quantity(bound, parameter.unit)}, the "
            f"{least} value allowed, with a probability of {chance:.1g}; {remedy}"
        )
    return None


def _check_bounds(factor: FactorSpec, i: int, key: str, parameter: Parameter, problems: Problems) -> None:
    for edge in dict.fromkeys((factor.lower[i], factor.upper[i])):
        wrong = out_of_bounds(parameter, edge)
        if wrong is None and factor.parameter in NOISE_SCALES and edge == 0:
            wrong = _refuse_nothing(factor)
        if wrong is not None:
            reach = f"the band {factor.labels[i]} reaches too far: " if factor.lower[i] < factor.upper[i] else ""
            problems.add(key, reach + wrong)


def _refuse_nothing(factor: FactorSpec) -> str | None:
    """Return why a factor on variances cannot be zero; inputs may be exact, if estimators know that they are."""
    if factor.of == "plant":
        return None
    if factor.parameter != "input_noise_scale":
        return "an estimator cannot work with variances of zero; give a positive factor"
    return None if factor.of == "both" else "inputs with noise would be taken for exact; give a positive factor"
