"""Resolve ``[[design]]``: its factors together, how its bands are filled, and whether all of it is possible."""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from dataclasses import replace

from harness.config.bounds import broken_relations, loading_parameters, out_of_bounds
from harness.config.dependence import resolve_correlation, resolve_groups
from harness.config.derived import derived_parameters, derived_value, settled
from harness.config.design_tables import DesignTable
from harness.config.factors import Models, form, resolve_factor
from harness.config.posterior import with_posterior
from harness.config.problems import Problems
from harness.config.specs import NOISE_SCALES, DesignSpec, FactorSpec, ModelSpec

SCRAMBLINGS = 8
"""Independent scramblings of a population, unless the study says otherwise."""

BOXES = 8
"""Nested boxes of a tolerance design, unless the study says otherwise."""

_MOST_CORNERS = 8
"""A box of up to this many factors is checked at all its corners, a larger one factor by factor."""


def resolve_design(raw: DesignTable, key: str, models: Models, problems: Problems) -> DesignSpec | None:
    """Return the resolved design, or ``None`` if a problem with it was noted.

    Args:
        raw: The table.
        key: Its key path, e.g. ``design[0]``.
        models: Plant and belief, resolved.
        problems: Where problems are noted.
    """
    before, own = len(problems), len(raw.factor)
    raw = with_posterior(raw, key, models.plant, models.folder, problems)
    _refuse_twice(raw, key, models, problems)
    factors: tuple[FactorSpec, ...] = ()
    for i, table in enumerate(raw.factor):
        place = f"{key}.factor[{i}]" if i < own else f"{key}.posterior ({table.parameter})"
        with problems.catch(place):
            factor = resolve_factor(table, place, models, problems)
            factors += () if factor is None else (factor,)
    if len(problems) == before:
        _refuse_following(raw, key, models, problems)
    if len(problems) > before:
        return None
    whole = raw.sampling == "population"
    scramblings = raw.scramblings or (SCRAMBLINGS if whole else 1)
    design = DesignSpec(raw.name, factors, raw.samples, raw.repeats, raw.sampling, scramblings, share=raw.share)
    if raw.scramblings is not None and not whole:
        problems.add(f"{key}.scramblings", "scramblings belong to sampling = 'population'; remove the key")
    if raw.share is not None and not whole:
        problems.add(f"{key}.share", "a share is of vehicles drawn by sampling = 'population'; remove the key")
    if (correlation := resolve_correlation(raw, factors, key, problems)) is not None:
        design = replace(design, correlation=correlation.matrix, correlation_change=correlation.change)
    design = replace(design, groups=resolve_groups(raw, factors, key, problems))
    if raw.sampling == "sobol":
        _check_bands(raw, design, key, problems)
    else:
        _check_one_box(raw, design, key, problems)
    if len(problems) == before:
        _check_relations(raw, design, key, models, problems)
    if len(problems) > before:
        return None
    match raw.sampling:
        case "saltelli":
            return replace(design, factors=tuple(replace(f, labels=("whole box",)) for f in factors))
        case "population":
            return replace(design, factors=tuple(replace(f, labels=("population",)) for f in factors))
        case "tolerance":
            return replace(design, factors=tuple(_nested(f, raw.boxes or BOXES) for f in factors))
    return design


def check_shares(designs: Sequence[DesignSpec], problems: Problems) -> None:
    """Note where designs are to be weighed by their shares and cannot be: intervals are by the scramblings."""
    stated = [d for d in designs if d.share is not None]
    if len(stated) == 1:
        problems.add("design", f"'{stated[0].name}' alone states a share; give one to each model, or remove it")
    elif len({d.scramblings for d in stated}) > 1:
        counts = ", ".join(f"{d.name} {d.scramblings}" for d in stated)
        problems.add("design", f"designs with a share need equally many scramblings, not {counts}")


def _refuse_twice(raw: DesignTable, key: str, models: Models, problems: Problems) -> None:
    """A value may have one factor only."""
    seen: dict[tuple[str, str], str] = {}
    for i, table in enumerate(raw.factor):
        place = f"{key}.factor[{i}]"
        for side in models.sides(table.of):
            first = seen.setdefault((table.parameter, side), place)
            if first != place:
                problems.add(
                    f"{place}.parameter",
                    f"'{table.parameter}' of the {side} is varied by {first} already; remove one of the two",
                )


def _refuse_following(raw: DesignTable, key: str, models: Models, problems: Problems) -> None:
    """A value that follows from a varied load or stiffness may have no factor of its own."""
    for i, table in enumerate(raw.factor):
        for side, spec in models.sides(table.of).items():
            derived, load = derived_parameters(spec), loading_parameters(spec.vehicle)
            if table.parameter not in derived:
                continue
            followers = _followers(spec, table.parameter)
            for j, other in enumerate(raw.factor):
                if j == i or other.of not in (side, "both") or {table.parameter, other.parameter} <= load.keys():
                    continue
                if followers & (_followers(spec, other.parameter) if other.parameter in derived else {other.parameter}):
                    problems.add(
                        f"{key}.factor[{j}].parameter",
                        f"'{other.parameter}' of the {side} follows from '{table.parameter}', which {key}.factor[{i}] "
                        "varies; remove one of the two",
                    )


def _followers(spec: ModelSpec, name: str) -> set[str]:
    """Return the parameters that follow from a quantity of ``derived_parameters``."""
    return set(settled(spec, {name: derived_value(spec, name)}))


def _check_bands(raw: DesignTable, design: DesignSpec, key: str, problems: Problems) -> None:
    counts = {f.parameter: len(f.levels) for f in design.factors}
    if len(set(counts.values())) > 1:
        listed = ", ".join(f"{name} {n}" for name, n in counts.items())
        problems.add(
            f"{key}.factor",
            f"the i-th bands of all factors belong together, but their numbers differ ({listed}); "
            "give every factor the same number, or put the factors into separate designs",
        )
        return
    _refuse_alike(raw, design, key, problems)
    if raw.boxes is not None:
        problems.add(f"{key}.boxes", "nested boxes belong to sampling = 'tolerance'; remove the key")
    banded, n = any(f.banded for f in design.factors), design.base_samples
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
    elif not raw.sobol_any_n:
        _check_power_of_two(n, key, problems, ", or set sobol_any_n = true")


def _refuse_alike(raw: DesignTable, design: DesignSpec, key: str, problems: Problems) -> None:
    """Refuse two bands with the same values, or of the same label: nobody could tell them apart."""
    edges = [tuple((f.lower[b], f.upper[b]) for f in design.factors) for b in range(design.bands)]
    for band, (edge, label) in enumerate(zip(edges, design.band_labels, strict=True)):
        i = next((i for i, f in enumerate(raw.factor) if f.labels is not None), 0) if raw.factor else 0
        if edge in edges[:band]:
            entry = f"{key}.factor[0].{form(raw.factor[0])}"
            problems.add(f"{entry}[{band}]", f"the same as [{edges.index(edge)}]: {label}; remove one of the two")
        elif label in (before := design.band_labels[:band]):
            what = "labels" if raw.factor[i].labels is not None else form(raw.factor[i])
            problems.add(
                f"{key}.factor[{i}].{what}[{band}]",
                f"'{label}' is the label of [{before.index(label)}] already; give each its own by 'labels'",
            )


def _check_power_of_two(n: int, key: str, problems: Problems, way_out: str = "") -> None:
    if n & (n - 1):
        low = 1 << (n.bit_length() - 1)
        problems.add(
            f"{key}.samples",
            f"{n} is no power of two: the first N points of a Sobol sequence fill every half, quarter ... "
            f"of a band equally often only for N = 2^k; take {low} or {2 * low}{way_out}",
        )


def _check_one_box(raw: DesignTable, design: DesignSpec, key: str, problems: Problems) -> None:
    """Note where a design over all factors at once lacks one band of each, or its boxes the nominal value."""
    if not design.factors:
        problems.add(f"{key}.factor", f"sampling = '{raw.sampling}' varies all factors at once; give at least one")
    for i, factor in enumerate(design.factors):
        place = f"{key}.factor[{i}]"
        if len(factor.levels) != 1 or not factor.banded:
            problems.add(
                place,
                f"sampling = '{raw.sampling}' fills one box; give '{factor.parameter}' one band, such as "
                'range = [lower, upper] or bands = ["20 %"]',
            )
        elif raw.sampling == "tolerance" and not factor.lower[0] <= factor.nominal <= factor.upper[0]:
            problems.add(
                f"{place}.{form(raw.factor[i])}",
                f"the boxes of a tolerance design are nested around the nominal value {factor.nominal:g} of "
                f"'{factor.parameter}', which lies outside; widen the band",
            )
    if raw.sobol_any_n:
        problems.add(
            f"{key}.sobol_any_n", f"sampling = '{raw.sampling}' does not allow unbalanced points; remove the key"
        )
    if raw.boxes is not None and raw.sampling != "tolerance":
        problems.add(f"{key}.boxes", "nested boxes belong to sampling = 'tolerance'; remove the key")
    if design.base_samples < 2:
        problems.add(f"{key}.samples", "one point does not sample a box; give samples = 64 or another power of two")
    _check_power_of_two(design.base_samples, key, problems)


def _nested(factor: FactorSpec, boxes: int) -> FactorSpec:
    """Return the factor with a band for each box: the full one scaled about the nominal value."""
    shares = [(k + 1) / boxes for k in range(boxes)]
    lower, upper = (
        tuple(_towards(factor, edge, share) for share in shares) for edge in (factor.lower[0], factor.upper[0])
    )
    labels = (*(f"{100 * share:.3g} % of the box" for share in shares[:-1]), "whole box")
    return replace(factor, levels=(factor.nominal,) * boxes, lower=lower, upper=upper, labels=labels)


def _towards(factor: FactorSpec, edge: float, share: float) -> float:
    """Return the value at a share of the way from nominal to an edge, on the scale of the factor."""
    if share == 1.0:
        return edge
    if factor.log:
        return factor.nominal * math.exp(share * math.log(edge / factor.nominal))
    return factor.nominal + share * (edge - factor.nominal)


def _check_relations(raw: DesignTable, design: DesignSpec, key: str, models: Models, problems: Problems) -> None:
    """Ask the vehicle's ``check`` at the corners of every band, and for the bounds of what follows from them."""
    for band in range(design.bands):
        for side, spec in (("plant", models.plant), ("belief", models.belief)):
            varied = [f for f in design.factors if f.of in (side, "both") and f.parameter not in NOISE_SCALES]
            bounds = {p.name: p for p in spec.model().parameters}
            wrong: dict[str, str] = {}
            for corner in _corners(varied, band, independent=not design.correlation):
                changed = settled(spec, corner)
                for name, message in broken_relations(spec.vehicle, {**spec.values, **changed}):
                    wrong.setdefault(name, message)
                for name in changed.keys() - corner.keys():
                    beyond = out_of_bounds(bounds[name], changed[name])
                    if beyond is not None:
                        wrong.setdefault(name, f"{beyond}; it follows from what is varied")
            for name, message in wrong.items():
                at = next((i for i, f in enumerate(raw.factor) if f.parameter == name), None)
                place = f"{key}.factor"
                if at is not None:
                    entry = form(raw.factor[at])
                    item = "" if entry in ("range", "distribution") else f"[{band}]"
                    place = f"{key}.factor[{at}].{entry}{item}"
                problems.add(place, f"{design.band_labels[band]} of the {side}: {name}: {message}")


def _corners(factors: list[FactorSpec], band: int, independent: bool) -> list[dict[str, float]]:
    """Return the corners of a band's box; of a large box or dependent factors those where one factor is at an edge."""
    edges = {f.parameter: tuple(dict.fromkeys((f.lower[band], f.upper[band]))) for f in factors}
    if len(factors) <= _MOST_CORNERS and independent:
        return [dict(zip(edges, point, strict=True)) for point in itertools.product(*edges.values())]
    centre = {f.parameter: f.levels[band] for f in factors}
    return [{**centre, name: edge} for name, pair in edges.items() for edge in pair]
