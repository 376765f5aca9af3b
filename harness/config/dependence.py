"""Dependence of the factors of a design: correlations of their normal scores, and groups that are taken together."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from harness.common.arrays import Floats
from harness.common.registry import closest
from harness.config.design_tables import DesignTable
from harness.config.problems import Problems
from harness.config.specs import FactorSpec

_LEAST = 1e-6
"""Smallest eigenvalue of a correlation matrix."""

_STEPS = 500


@dataclass(frozen=True)
class Correlation:
    """Correlation of the normal scores of a design's factors (Gaussian copula).

    Attributes:
        matrix: One row per factor.
        change: Largest difference from what was stated; above zero where that was no correlation matrix.
    """

    matrix: tuple[tuple[float, ...], ...]
    change: float = 0.0


def resolve_correlation(
    raw: DesignTable, factors: Sequence[FactorSpec], key: str, problems: Problems
) -> Correlation | None:
    """Return the correlation of a design's factors, or ``None`` where none is stated or a problem was noted."""
    if raw.correlation is None:
        return None
    before, place = len(problems), f"{key}.correlation"
    if raw.sampling == "saltelli":
        problems.add(place, "Sobol indices of sampling = 'saltelli' need independent factors; take 'population'")
    names = [f.written for f in factors]
    stated = np.eye(len(factors))
    for i, (first, second, size) in enumerate(raw.correlation):
        for name in (first, second):
            if name not in names:
                problems.add(f"{place}[{i}]", f"'{name}' is no factor of the design{closest(name, names)}")
            elif not factors[names.index(name)].banded:
                problems.add(f"{place}[{i}]", f"'{name}' takes one value; give it a distribution or a band")
        if not -1 < size < 1:
            problems.add(f"{place}[{i}]", f"a correlation lies between -1 and 1, got {size:g}")
        if len(problems) > before:
            continue
        pair = names.index(first), names.index(second)
        if pair[0] == pair[1] or stated[pair]:
            problems.add(f"{place}[{i}]", f"'{first}' and '{second}' are correlated already; remove the entry")
        stated[pair] = stated[pair[::-1]] = size
    if len(problems) > before:
        return None
    nearest = nearest_correlation(stated)
    change = float(np.abs(nearest - stated).max())
    return Correlation(tuple(map(tuple, nearest.tolist())), change)


def nearest_correlation(stated: Floats) -> Floats:
    """Return the correlation matrix nearest to a symmetric matrix with ones on its diagonal, itself if it is one.

    In the Frobenius norm, by alternating projections with Dykstra's correction (Higham 2002, algorithm 3.3, doi
    10.1093/imanum/22.3.329).
    """
    if np.linalg.eigvalsh(stated)[0] >= _LEAST:
        return stated
    nearest, correction = stated.copy(), np.zeros_like(stated)
    for _ in range(_STEPS):
        shifted = nearest - correction
        sizes, vectors = np.linalg.eigh(shifted)
        valid = (vectors * np.maximum(sizes, _LEAST)) @ vectors.T
        correction = valid - shifted
        nearest = valid.copy()
        np.fill_diagonal(nearest, 1.0)
        if np.abs(nearest - valid).max() < 1e-10:
            break
    deviation = np.sqrt(np.diag(valid))
    return np.asarray(valid / np.outer(deviation, deviation))


def resolve_groups(
    raw: DesignTable, factors: Sequence[FactorSpec], key: str, problems: Problems
) -> tuple[tuple[str, tuple[str, ...]], ...]:
    """Return the groups of a design by name, each with the names of its factors."""
    groups: Mapping[str, list[str]] = raw.groups or {}
    if groups and raw.sampling != "population":
        problems.add(f"{key}.groups", "groups belong to sampling = 'population'; remove the key")
    names, taken = [f.written for f in factors], dict[str, str]()
    for group, members in groups.items():
        if group in names and members != [group]:
            problems.add(f"{key}.groups.{group}", "a factor has this name; take another for the group")
        for i, name in enumerate(members):
            place = f"{key}.groups.{group}[{i}]"
            if name not in names:
                problems.add(place, f"'{name}' is no factor of the design{closest(name, names)}")
            elif name in taken:
                problems.add(place, f"'{name}' is in the group '{taken[name]}' already; remove one of the two")
            taken[name] = group
    return tuple((group, tuple(members)) for group, members in groups.items())
