"""The largest box of perturbations that an estimator tolerates, from a ``tolerance`` design.

The design (``harness.study.design``) nests boxes about the nominal point; the same relative points lie in each, so that
every point of the unit box is a ray along which all factors drift together. Along a ray, the error at the nominal
point and in each box says where the limit is reached first: the *reach* of the ray, as a share of the whole box. All
points of a box are within the limit exactly if no ray has a smaller reach.

Rays are a sample. The smallest of n reaches bounds from below, with confidence ``1 - (1 - q)^n``, the size of the box
in which a fraction q of all rays break the limit (Wilks 1941): with n = 64 rays and 95 % confidence, a box as large as
the smallest reach holds the limit at 95.4 % of its points or more. Rays hardly ever run along an axis, where one factor
drifts alone; those points of the design may end the box earlier (``Tolerance.box``), which breaks no bound: a smaller
box loses no more of its points.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from harness.common.arrays import Floats


@dataclass(frozen=True)
class Tolerance:
    """What one estimator tolerates for one target, as shares of the box of the study.

    Attributes:
        nominal: Error at the nominal point over the limit, on the worst drive; infinite if a run was lost there.
        box: Smallest reach of all rays and of each factor alone; 1 if none breaks the limit, 0 if the nominal point
            does.
        typical: Median reach.
        holds: Share of the box at which the limit holds at least, at 95 % confidence.
        lower: Reach of each factor alone towards its lower edge, ``(factor,)``; 1 if the limit holds up to the edge.
        upper: Likewise towards the upper edge.
        rays: Number of rays.
    """

    nominal: float
    box: float
    typical: float
    holds: float
    lower: Floats
    upper: Floats
    rays: int

    @property
    def first(self) -> tuple[int, bool] | None:
        """The factor that alone breaks the limit first, and whether upwards; ``None`` if none of them does."""
        reaches = np.stack([self.lower, self.upper])
        if self.nominal > 1.0 or not (reaches < 1.0).any():
            return None
        side, factor = np.unravel_index(int(np.argmin(reaches)), reaches.shape)
        return int(factor), bool(side)


def reaches(errors: Floats, limit: float) -> Floats:
    """Return where errors along rays reach a limit first, as a share of the whole box.

    Args:
        errors: Errors at the nominal point and in each of K evenly spaced boxes, ``(K + 1, rays)``; infinite where a
            run was lost.
        limit: The limit.

    Returns:
        ``(rays,)``, linear in the error between two boxes, at the inner box if the run in the outer one was lost; 1
        where the limit holds throughout, 0 where the nominal point breaks it.
    """
    boxes = len(errors) - 1
    beyond = errors > limit
    broken = beyond.any(axis=0)
    outer = np.argmax(beyond, axis=0)
    inner = np.maximum(outer - 1, 0)
    ray = np.arange(errors.shape[1])
    inside, outside = errors[inner, ray], errors[outer, ray]
    part = np.zeros(errors.shape[1])
    between = broken & (outer > 0) & np.isfinite(outside)
    part[between] = (limit - inside[between]) / (outside[between] - inside[between])
    return np.where(broken, np.where(outer > 0, (inner + part) / boxes, 0.0), 1.0)


def tolerance(errors: Floats, limit: float, factors: int, level: float = 0.95) -> Tolerance:
    """Return what an estimator tolerates from its errors in a ``tolerance`` design.

    Args:
        errors: Largest error over drives and repeats, ``(box, sample)`` in the order of the design, infinite where a
            run was lost.
        limit: Largest error that counts as tolerable, in the same unit.
        factors: Number of factors.
        level: Confidence level.
    """
    nominal = errors[:, :1].max(axis=0)  # the same point in every box
    along = reaches(np.vstack([np.broadcast_to(nominal, errors.shape[1:]), errors]), limit)
    alone, rays = along[1 : 1 + 2 * factors], along[1 + 2 * factors :]
    return Tolerance(
        nominal=float(nominal[0] / limit),
        box=float(min(rays.min(), alone.min())),
        typical=float(np.median(rays)),
        holds=float((1.0 - level) ** (1.0 / len(rays))),
        lower=alone[0::2],
        upper=alone[1::2],
        rays=len(rays),
    )
