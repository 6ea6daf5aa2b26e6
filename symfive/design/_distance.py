"""Distance of convex bodies, from below.

Any direction d separates two bodies A and B by at least -h_A(-d) - h_B(d), h their support functions; the largest of these over
all directions is their distance, and where they meet each is negative. The algorithm of E. G. Gilbert, D. W. Johnson & S. S.
Keerthi (1988) finds that direction: v is the point nearest to 0 of a simplex of points of A - B, its size a bound from above, the
point of A - B that lies farthest against v gives the bound from below and joins the simplex. What is returned is always the bound
from below, so a distance that has not converged is too small, never too large.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

__all__ = ["Rod", "apart"]

Array = NDArray[np.float64]
STEPS, WITHIN_MM = 40, 1e-4
"""Steps of the search, and how near the two bounds are when it ends."""
FLAT = 1e-12
STRAIGHT = 1e-9
"""Sine below which a direction is along the axis: what is left of it across is rounding."""
EDGES, FACES = list(itertools.combinations(range(4), 2)), list(itertools.combinations(range(4), 3))


@dataclass(frozen=True)
class Rod:
    """Cylinders with flat ends: `start` (N, 3) of their axes, unit vectors `axis` (N, 3), `length` and `radius` (N,), mm."""

    start: Array
    axis: Array
    length: Array
    radius: float | Array = 0.0

    @classmethod
    def joined(cls, rods: Sequence[Rod]) -> Rod:
        """All of several, one after the other."""
        radius = np.concatenate([np.broadcast_to(rod.radius, rod.length.shape) for rod in rods])
        start, axis, length = (np.concatenate([getattr(rod, n) for rod in rods]) for n in ("start", "axis", "length"))
        return cls(start, axis, length, radius)

    def at(self, rows: NDArray[np.int64]) -> Rod:
        """Some of them."""
        radius = np.broadcast_to(self.radius, self.length.shape)[rows]
        return Rod(self.start[rows], self.axis[rows], self.length[rows], radius)

    @property
    def middle(self) -> Array:
        """Of their axes (N, 3)."""
        return self.start + 0.5 * self.length[:, None] * self.axis

    @property
    def lowest(self) -> Array:
        """z of the lowest point of each (N,)."""
        return -_dot(self.farthest(np.broadcast_to([0.0, 0.0, -1.0], self.start.shape)), np.array([0.0, 0.0, -1.0]))

    def farthest(self, direction: Array) -> Array:
        """The points (N, 3) that lie farthest along the directions (N, 3)."""
        along = _dot(direction, self.axis)
        point = self.start + np.where(along > 0.0, self.length, 0.0)[:, None] * self.axis
        if not np.any(self.radius):
            return np.asarray(point)
        aside = direction - along[:, None] * self.axis
        size = np.linalg.norm(aside, axis=1)
        over = size > STRAIGHT * np.linalg.norm(direction, axis=1)
        return np.asarray(point + (self.radius * over / np.where(over, size, 1.0))[:, None] * aside)

    def nearest(self, points: Array) -> Array:
        """The points (N, 3) of the cylinders that are nearest to the points (N, 3)."""
        offset = points - self.start
        along = _dot(offset, self.axis)
        aside = offset - along[:, None] * self.axis
        share = self.radius / np.maximum(np.linalg.norm(aside, axis=1), np.maximum(self.radius, FLAT))
        return np.asarray(self.start + np.clip(along, 0.0, self.length)[:, None] * self.axis + share[:, None] * aside)


def apart(a: Rod, b: Rod, enough: float | Array = math.inf) -> Array:
    """Distance (N,) of the cylinders, mm, from below, negative where they meet; not sought further once it is above `enough`, of
    all or (N,).

    Three directions settle most: between the middles, along b (a stands above its end), and between two near points.
    """
    there = b.nearest(a.middle)
    here = a.nearest(there)
    found, above = np.full(len(a.start), -np.inf), np.linalg.norm(here - there, axis=1)
    for direction in (a.middle - b.middle, np.broadcast_to(b.axis, a.start.shape), here - there):
        corner = a.farthest(-direction)
        found = np.maximum(found, _bound(direction, corner - b.farthest(direction)))
        above = np.minimum(above, np.linalg.norm(corner - b.nearest(corner), axis=1))
    enough = np.broadcast_to(enough, found.shape)
    live = np.flatnonzero((found <= enough) & (above - found > WITHIN_MM))
    a, b = a.at(live), b.at(live)
    simplex = np.repeat(_support(a, b, a.middle - b.middle)[:, None, :], 4, axis=1)
    nearest = simplex[:, 0]
    kept = np.zeros((len(live), 4), bool)
    kept[:, 0] = True
    for _ in range(STEPS):
        if not live.size:
            break
        point = _support(a, b, nearest)
        below = _bound(nearest, point)
        found[live] = np.maximum(found[live], below)
        size = np.linalg.norm(nearest, axis=1)
        on = np.flatnonzero((size - found[live] > WITHIN_MM) & (found[live] <= enough[live]) & (size > WITHIN_MM))
        live, a, b = live[on], a.at(on), b.at(on)
        simplex = np.where(kept[on, :, None], simplex[on], point[on, None, :])
        nearest, kept, inside = _nearest(simplex)
        on = np.flatnonzero(~inside)
        live, a, b, simplex, nearest, kept = live[on], a.at(on), b.at(on), simplex[on], nearest[on], kept[on]
    return found


def _dot(a: Array, b: Array) -> Array:
    return np.asarray(np.sum(a * b, axis=-1))


def _support(a: Rod, b: Rod, direction: Array) -> Array:
    """The point of a - b that lies farthest against the direction."""
    return a.farthest(-direction) - b.farthest(direction)


def _bound(direction: Array, point: Array) -> Array:
    size = np.linalg.norm(direction, axis=1)
    return np.where(size > FLAT, _dot(direction, point) / np.where(size > FLAT, size, 1.0), -np.inf)


def _nearest(simplex: Array) -> tuple[Array, NDArray[np.bool_], NDArray[np.bool_]]:
    """Of tetrahedra (N, 4, 3), which may be flat: the points nearest to 0 of their edges and faces, the corners that span these,
    and whether 0 lies inside."""
    points, corners = [], []
    for edge in EDGES:
        first, way = simplex[:, edge[0]], simplex[:, edge[1]] - simplex[:, edge[0]]
        square = _dot(way, way)
        share = np.clip(-_dot(first, way) / np.where(square > FLAT, square, 1.0), 0.0, 1.0)
        points.append(first + share[:, None] * way)
        corners.append(_spanned(edge, np.stack([share < 1.0, share > 0.0], axis=1)))
    for face in FACES:
        x, y, z = (simplex[:, i] for i in face)
        normal = np.cross(y - x, z - x)
        square = _dot(normal, normal)
        flat = square <= FLAT * _dot(y - x, y - x) * _dot(z - x, z - x)
        weights = [_dot(normal, np.cross(p, q)) for p, q in ((y, z), (z, x), (x, y))]
        outside = flat | (np.min(weights, axis=0) < 0.0)
        foot = normal * (_dot(x, normal) / np.where(flat, 1.0, square))[:, None]
        points.append(np.where(outside[:, None], np.inf, foot))
        corners.append(_spanned(face, np.ones((len(simplex), 3), bool)))
    sizes = np.stack([_dot(point, point) for point in points])
    best, rows = np.argmin(sizes, axis=0), np.arange(len(simplex))
    return np.stack(points)[best, rows], np.stack(corners)[best, rows], _holds_zero(simplex)


def _spanned(corners: tuple[int, ...], used: NDArray[np.bool_]) -> NDArray[np.bool_]:
    found = np.zeros((len(used), 4), bool)
    found[:, list(corners)] = used
    return found


def _holds_zero(simplex: Array) -> NDArray[np.bool_]:
    """Whether 0 lies inside a tetrahedron: the four that it forms with the faces have the sign of the whole."""
    parts = [_dot(simplex[:, i], np.cross(simplex[:, j], simplex[:, k])) for i, j, k in FACES]
    signed = np.stack([parts[3], -parts[2], parts[1], -parts[0]])
    whole = np.abs(signed.sum(axis=0)) > FLAT
    return np.asarray(whole & ((signed > 0.0).all(axis=0) | (signed < 0.0).all(axis=0)))
