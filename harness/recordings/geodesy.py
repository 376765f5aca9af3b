"""Latitude and longitude as positions east and north in the plane that touches the ellipsoid at the first fix.

A dozen lines of closed form: geodetic to earth-centred coordinates, and their turning into east and north (Farrell
2008, Aided Navigation, 2.3). A library of map projections would be a heavy dependency for that. The height is taken as
zero: 100 m of it scale the distances by 16 millionths.
"""

from __future__ import annotations

import numpy as np

from harness.common.arrays import Floats

_SEMI_MAJOR = 6_378_137.0
_FLATTENING = 1 / 298.257223563
_SQUARED_ECCENTRICITY = _FLATTENING * (2 - _FLATTENING)


def earth_centred(latitude: Floats, longitude: Floats) -> tuple[Floats, Floats, Floats]:
    """Return earth-centred coordinates in m of points on the ellipsoid WGS 84; angles in rad (2.9 to 2.11)."""
    normal = _SEMI_MAJOR / np.sqrt(1 - _SQUARED_ECCENTRICITY * np.sin(latitude) ** 2)
    return (
        normal * np.cos(latitude) * np.cos(longitude),
        normal * np.cos(latitude) * np.sin(longitude),
        normal * (1 - _SQUARED_ECCENTRICITY) * np.sin(latitude),
    )


def tangent_plane(latitude: Floats, longitude: Floats) -> tuple[Floats, Floats]:
    """Return positions east and north of the first known fix.

    Args:
        latitude: rad, shape ``(samples,)``; NaN where missing.
        longitude: rad, east positive.

    Returns:
        East and north in m, each ``(samples,)``. All NaN if there is no fix.
    """
    there = np.flatnonzero(np.isfinite(latitude) & np.isfinite(longitude))
    if not there.size:
        return np.full(len(latitude), np.nan), np.full(len(latitude), np.nan)
    phi, lam = latitude[there[0]], longitude[there[0]]
    x, y, z = earth_centred(latitude, longitude)
    x0, y0, z0 = earth_centred(phi, lam)
    dx, dy, dz = x - x0, y - y0, z - z0
    east = -np.sin(lam) * dx + np.cos(lam) * dy
    north = -np.sin(phi) * (np.cos(lam) * dx + np.sin(lam) * dy) + np.cos(phi) * dz
    return east, north
