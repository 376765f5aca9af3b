"""Uncertainty of a fit: standard errors, correlation, profile likelihoods, and a verdict in words.

Standard errors and correlation follow from the Fisher information. Where the likelihood is no parabola they mislead,
so the 95 % interval is taken from the profile likelihood: all values whose likelihood, with everything else refitted,
lies less than 1.92 below the largest (half the 95 % quantile of chi-square with one degree of freedom).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from harness.common.arrays import Floats, Mask
from harness.identification.contract import Estimate, Profile, Verdict
from harness.identification.coordinates import Coordinate, Coordinates, Kind
from harness.identification.fisher_scoring import Objective, maximise

NORMAL = 1.959963984540054
"""97.5 % quantile of the standard normal distribution."""

WELL, BARELY = math.log(1.2), math.log(3.0)
"""A parameter is determined if its 95 % interval lies within this of the estimate, weakly if within the second.

In logarithms: a fifth and a factor of three. Parameters that may be negative are measured by their range.
"""

CONFOUNDED = 0.9
"""Correlation from which two parameters count as confounded: knowing one would more than halve the other's error."""

ENTANGLED = 0.99
"""Multiple correlation with all others from which a parameter is not determined, however narrow its interval: all but
one fiftieth of what the recordings say of it goes into combinations, and the least error of the model moves it along
them."""

_LEARNT_BY = 0.1
"""Share that a parameter has in a direction, in units of what is known beforehand, from which it depends on it."""

_SINGULAR = 1e-11
_FARTHEST = 5
"""Standard errors to which a profile is followed at most."""

_REFITTING = 6
_AGREES = 0.05
_AT_BOUND = 1e-3


@dataclass(frozen=True)
class Covariance:
    """What an information matrix leaves open.

    Attributes:
        unit: Inverse of the information when that is scaled to a unit diagonal ``(n, n)``.
        scale: Roots of the diagonal of the information ``(n,)``.
        lost: Coordinates that move along a direction of which it says nothing ``(n,)``.
    """

    unit: Floats
    scale: Floats
    lost: NDArray[np.bool_]

    @property
    def matrix(self) -> Floats:
        """The covariance ``(n, n)``."""
        return self.unit / np.outer(self.scale, self.scale)

    @property
    def errors(self) -> Floats:
        """Standard error of each coordinate ``(n,)``, infinite where the information leaves it open."""
        return np.where(self.lost, np.inf, np.sqrt(np.maximum(np.diagonal(self.unit), 0.0)) / self.scale)

    @property
    def correlation(self) -> Floats:
        """Correlation of each pair ``(n, n)``."""
        deviation = np.sqrt(np.diagonal(self.unit))
        return self.unit / np.outer(deviation, deviation)


def covariance_of(information: Floats, singular: float = _SINGULAR, dropped: bool = False) -> Covariance:
    """Return the inverse of an information matrix; one that is not finite tells nothing.

    Args:
        information: Fisher information, with that of the priors ``(n, n)``.
        singular: Share of the largest eigenvalue below which a direction counts as empty.
        dropped: Whether empty directions are left out of the inverse (the pseudo-inverse, to solve with); otherwise
            they count as known that badly, so that it shows how estimates are correlated.
    """
    information = information if np.isfinite(information).all() else np.zeros_like(information)
    scale = np.sqrt(np.maximum(np.diagonal(information), 1e-300))
    values, vectors = np.linalg.eigh(information / np.outer(scale, scale))
    floor = max(singular * values.max(initial=0.0), 1e-300)
    empty = values < floor
    parts = np.where(empty & dropped, 0.0, vectors / np.maximum(values, floor))
    return Covariance(parts @ vectors.T, scale, (vectors[:, empty] ** 2).sum(axis=1) > 1e-6)


def marginal(information: Floats, rows: Sequence[int]) -> Floats:
    """Return the information on some coordinates where all others are open as well ``(rows, rows)``.

    Args:
        information: Fisher information, with that of the priors ``(n, n)``.
        rows: The coordinates.
    """
    own = np.asarray(rows, dtype=int)
    others = np.setdiff1d(np.arange(len(information)), own)
    cross = information[np.ix_(others, own)]
    open_ = covariance_of(information[np.ix_(others, others)], dropped=True).matrix
    remaining: Floats = information[np.ix_(own, own)] - cross.T @ open_ @ cross
    return remaining


@dataclass(frozen=True)
class Uncertainty:
    """What the Fisher information says about the coordinates of a fit.

    Attributes:
        error: Standard error of each coordinate ``(n,)``, infinite if nothing is known of it.
        correlation: ``(n, n)``; zero for what nothing is known of.
        side: -1 at the lower bound, 1 at the upper, else 0 ``(n,)``.
        multiple: Multiple correlation of each coordinate with all others, by the recordings alone ``(n,)``.
        unlearnt: Whether it moves along a direction of which less is known by the recordings alone than was stated
            before them ``(n,)``.
    """

    error: Floats
    correlation: Floats
    side: NDArray[np.int64]
    multiple: Floats
    unlearnt: Mask


def at_bound(z: float, lower: float, upper: float) -> int:
    """Return -1 if a coordinate is at its lower bound, 1 if it is at its upper one, else 0."""
    near = _AT_BOUND * min(upper - lower, 1.0)
    return 1 if upper - z < near else -1 if z - lower < near else 0


def limits_of_knowledge(space: Coordinates, z: Floats, information: Floats) -> Uncertainty:
    """Return errors and correlation of the coordinates, those at a bound held there.

    Directions that the information leaves empty (two parameters of which only the product acts) make the error of
    whatever they move infinite. Where the slopes of the likelihood overflow, as at a measurement of 1e6 rad/s, the
    recordings tell nothing.
    """
    information = information if np.isfinite(information).all() else np.diag(space.weight)
    reach = space.upper - space.lower
    side = np.array([at_bound(*bounds) for bounds in zip(z, space.lower, space.upper, strict=True)], dtype=int)
    recorded = information - np.diag(space.weight)  # by the recordings alone
    silent = (
        np.sqrt(np.maximum(np.diagonal(recorded), 0.0)) * reach < 2.0 * NORMAL
    )  # all else known, it would be the whole range
    side[silent] = 0
    determined = (side == 0) & ~silent
    n, multiple = len(space), np.zeros(len(space))
    error, correlation = np.full(n, np.inf), np.eye(n)
    error[side != 0] = np.nan
    if determined.any():
        covariance = covariance_of(information[np.ix_(determined, determined)])
        error[determined] = covariance.errors
        correlation[np.ix_(determined, determined)] = covariance.correlation
        alone = covariance_of((information - np.diag(space.weight))[np.ix_(determined, determined)])
        multiple[determined] = np.sqrt(1.0 - 1.0 / np.maximum(np.diagonal(alone.unit), 1.0))
    return Uncertainty(error, correlation, side, multiple, _unlearnt(space, information, determined))


def _unlearnt(space: Coordinates, information: Floats, determined: Mask) -> Mask:
    """Return which coordinates move along a direction that the recordings tell less of than was stated before."""
    unlearnt, before = np.zeros(len(space), dtype=bool), np.array([c.stated_std for c in space.coordinates])
    rows = np.flatnonzero(determined & np.isfinite(before))
    if not rows.size:
        return unlearnt
    others = np.flatnonzero(determined & ~np.isfinite(before))
    alone = information - np.diag(space.weight)
    recorded = alone[np.ix_(rows, rows)]
    if others.size:  # all else free
        across = alone[np.ix_(rows, others)]
        recorded = (
            recorded
            - across @ np.linalg.pinv(alone[np.ix_(others, others)], rcond=_SINGULAR, hermitian=True) @ across.T
        )
    values, vectors = np.linalg.eigh(recorded * np.outer(before[rows], before[rows]))
    unlearnt[rows] = (vectors[:, values < 1.0] ** 2).sum(axis=1) > _LEARNT_BY
    return unlearnt


@dataclass(frozen=True)
class Summit:
    """The maximum of a likelihood, and what is known there.

    Attributes:
        space: The coordinates.
        objective: The likelihood.
        z: Where it is largest ``(n,)``.
        value: Its value there.
        information: Fisher information there ``(n, n)``.
        knowledge: From ``limits_of_knowledge``.
    """

    space: Coordinates
    objective: Objective
    z: Floats
    value: float
    information: Floats
    knowledge: Uncertainty


@dataclass(frozen=True)
class Colour:
    """What coloured innovations do to the estimates of a fit.

    Attributes:
        outputs: Whose innovations are coloured.
        factor: By which each standard error is larger than with white innovations ``(n,)``.
        lower: Lower end of the 95 % interval of a fit without process noise ``(n,)``; NaN where there is none.
        upper: Upper end.
    """

    outputs: tuple[str, ...]
    factor: Floats
    lower: Floats
    upper: Floats

    def interval(self, i: int, z: float, lower: float, upper: float) -> tuple[float, float]:
        """Return the interval of a coordinate with what the colour adds to that of white innovations."""
        below, above = (z + self.factor[i] * (end - z) for end in (lower, upper))
        return float(np.fmin(below, self.lower[i])), float(np.fmax(above, self.upper[i]))


def estimates_of(
    summit: Summit, profiles: Sequence[Kind], say: Callable[[str], None], colour: Colour | None = None
) -> tuple[Estimate, ...]:
    """Return every coordinate as an estimate with interval, verdict and reason.

    Args:
        summit: Where the likelihood is largest.
        profiles: What gets its profile, and the interval from it; noise only where it may be determined.
        say: Takes a line on what is being done.
        colour: What coloured innovations do to them; ``None`` if nothing.
    """
    space, z, knowledge = summit.space, summit.z, summit.knowledge
    estimates = []
    drawn = {}
    wanted = [i for i, c in enumerate(space.coordinates) if c.kind in profiles and np.isfinite(knowledge.error[i])]
    wanted = [i for i in wanted if space.coordinates[i].kind == "parameter" or knowledge.error[i] < BARELY]
    if wanted:
        say(f"profiles of {len(wanted)} {'parameters' if 'parameter' in profiles else 'variances'}")
        drawn = profile(summit, wanted)
    for i, c in enumerate(space.coordinates):
        error = float(knowledge.error[i])
        lower, upper = z[i] - NORMAL * error, z[i] + NORMAL * error
        if i in drawn:
            lower, upper = _interval(*drawn[i], z[i], error)
        width = upper - lower
        if colour is not None and math.isfinite(error):
            lower, upper = colour.interval(i, float(z[i]), lower, upper)
            error *= float(colour.factor[i])
        widened = (upper - lower) / width if width > 0.0 and math.isfinite(error) else 1.0
        lower, upper = (float(np.clip(end, c.lower, c.upper)) for end in (lower, upper))  # NaN stays NaN
        if math.isinf(error):
            lower, upper = c.lower, c.upper
        verdict, reason = _judge(space, knowledge, i, float(z[i]), lower, upper)
        if colour is not None and verdict == "determined" and c.kind == "parameter":
            verdict, reason = "weakly determined", f"{reason}; the innovations are coloured, so it may be biased"
        estimates.append(
            Estimate(
                name=c.name,
                unit=c.unit,
                start=c.value(c.centre),
                value=c.value(float(z[i])),
                error=error * c.slope(float(z[i])),
                lower=c.value(lower),
                upper=c.value(upper),
                verdict=verdict,
                reason=reason,
                profile=_in_values(c, *drawn[i]) if i in drawn else None,
                widened=widened,
            )
        )
    return tuple(estimates)


def profile(summit: Summit, wanted: list[int]) -> dict[int, tuple[Floats, Floats]]:
    """Return the likelihood along coordinates: values of each and how far below the maximum, all others refitted.

    Each side goes outwards by standard errors until it is outside the 95 % interval, from the point before it along
    the ridge that the information predicts. Where the likelihood there is what the parabola says, or above, the
    point stands; elsewhere the others are refitted by scoring.
    """
    space, objective, z, value = summit.space, summit.objective, summit.z, summit.value
    sides = [_Side(summit, i, way) for i in wanted for way in (-1, 1)]
    for k in range(1, _FARTHEST + 1):
        active = [side for side in sides if side.open]
        if not active:
            break
        points = [side.next_point(space) for side in active]
        drops = value - objective.values(np.column_stack(points))
        for side, point, drop in zip(active, points, drops, strict=True):
            settled = float(drop)
            if not settled < (1.0 + _AGREES) * 0.5 * k * k:
                refitted = maximise(objective, point, side.others, _REFITTING, enough=0.01 * k * k)
                point, settled = refitted.z, min(settled, value - refitted.value)
            side.add(point, settled)
    profiles = {}
    for i in wanted:
        pairs = sorted({(float(z[i]), 0.0)}.union(*(side.pairs for side in sides if side.index == i)))
        profiles[i] = (np.array([at for at, _ in pairs]), np.array([drop for _, drop in pairs]))
    return profiles


class _Side:
    """One side of a profile on its way outwards."""

    def __init__(self, summit: Summit, index: int, way: int) -> None:
        space, z, information = summit.space, summit.z, summit.information
        step = way * summit.knowledge.error[index]
        self.index, self.point, self.open = index, z, True
        self.others = summit.knowledge.side == 0
        self.others[index] = False
        informed = self.others & np.isfinite(summit.knowledge.error)  # where it says nothing, it predicts any distance
        inner = information[np.ix_(informed, informed)]
        ridge = np.zeros(len(z))
        ridge[informed] = -np.linalg.lstsq(inner, information[informed, index], rcond=_SINGULAR)[0]
        ridge[index] = 1.0
        self.step = step * ridge
        self.bound = space.upper[index] if step > 0 else space.lower[index]
        self.pairs: set[tuple[float, float]] = set()

    def next_point(self, space: Coordinates) -> Floats:
        """Return the next point, on the bound if the step leads beyond it."""
        return np.clip(self.point + self.step, space.lower, space.upper)

    def add(self, point: Floats, drop: float) -> None:
        """Take a settled point; the side is closed once it is outside the interval, at its bound or lost."""
        self.open = drop < 0.5 * NORMAL**2 and point[self.index] != self.bound
        self.point = point
        if np.isfinite(drop):
            self.pairs.add((float(point[self.index]), max(drop, 0.0)))


def _interval(at: Floats, drop: Floats, z: float, error: float) -> tuple[float, float]:
    """Return where the profile lies 1.92 below its maximum; its root is nearly straight on either side."""
    root = np.sqrt(2.0 * drop)

    def end(side: int) -> float:
        chosen = (at - z) * side >= 0
        places, heights = (at[chosen] - z) * side, root[chosen]
        order = np.argsort(places)
        places, heights = places[order], np.maximum.accumulate(heights[order])
        if len(places) < 2 or heights[-1] <= 0:
            return z + side * NORMAL * error
        if heights[-1] < NORMAL:  # flatter than a parabola even at the last point
            return z + side * float(places[-1]) * NORMAL / float(heights[-1])
        return z + side * float(np.interp(NORMAL, heights, places))

    return end(-1), end(1)


def _in_values(c: Coordinate, at: Floats, drop: Floats) -> Profile:
    return Profile(np.array([c.value(v) for v in at]), drop)


def _judge(
    space: Coordinates, knowledge: Uncertainty, i: int, z: float, lower: float, upper: float
) -> tuple[Verdict, str]:
    """Return the verdict on a coordinate and the reason in a sentence."""
    c = space.coordinates[i]
    if knowledge.side[i]:
        which, bound = ("lower", c.lower) if knowledge.side[i] < 0 else ("upper", c.upper)
        more = "the noise is practically zero" if c.kind != "parameter" else "the true value may lie beyond it"
        if c.kind == "measurement" and knowledge.side[i] < 0:
            more = "the filter follows the signal to the least noise that it shows; process noise explains the rest"
        return "at its bound", f"at its {which} bound {c.value(bound):.4g}; {more}"
    measured = zip(space.coordinates, knowledge.side, strict=True)
    silent = [
        m.name.split()[-1]
        for m, side in measured
        if m.kind == "measurement" and side < 0 and not math.isclose(m.value(m.lower), m.quantisation)
    ]
    if silent and c.kind == "parameter":
        return "not determined", f"errors are measured by noise, and the recordings show none of {', '.join(silent)}"
    half = max(upper - z, z - lower)
    if not c.logarithmic:
        half = half / (c.upper - c.lower) * 2.0 * BARELY
    partners = _partners(space, knowledge, i)
    within = "" if not partners else f"; confounded with {partners}"
    if math.isinf(knowledge.error[i]) or not half < BARELY:
        reason = "these drives do not determine it" if not partners else "these drives do not determine it alone"
        return "not determined", reason + within
    if c.kind == "parameter" and knowledge.unlearnt[i]:
        return "not determined", "these drives tell less of it than was stated of it before" + within
    if c.kind == "parameter" and knowledge.multiple[i] >= ENTANGLED:
        reason = "these drives determine a combination of it with others, not it alone"
        return "confounded", f"{reason}; multiple correlation {knowledge.multiple[i]:.4f}{within}"
    if half < WELL:
        return "determined", _width(c, z, lower, upper) + within
    return "weakly determined", _width(c, z, lower, upper) + within


def _width(c: Coordinate, z: float, lower: float, upper: float) -> str:
    if not c.logarithmic:
        return f"95 % interval {lower:.4g} to {upper:.4g}"
    below, above = 1.0 - math.exp(lower - z), math.exp(upper - z) - 1.0
    return f"95 % interval from {100 * below:.2g} % below to {100 * above:.2g} % above"


def _partners(space: Coordinates, knowledge: Uncertainty, i: int) -> str:
    """Name the other coordinates that nearly move together with one, the strongest first."""
    strength = np.abs(knowledge.correlation[i])
    strength[i] = 0.0
    order = [int(k) for k in np.argsort(-strength) if strength[k] >= CONFOUNDED][:3]
    names = [space.coordinates[k].name.replace("_", " ") for k in order]
    return ", ".join(f"{name} ({knowledge.correlation[i, k]:+.2f})" for name, k in zip(names, order, strict=True))
