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

from symfive.arrays import Array, Flags, Indices

STEPS, WITHIN_MM = 40, 1e-4
"""Steps of the search, and how near the two bounds are when it ends."""
FLAT = 1e-12
STRAIGHT = 1e-9
"""Sine below which a direction is along the axis: what is left of it across is rounding."""
EDGES, FACES = (np.array(list(itertools.combinations(range(4), count))) for count in (2, 3))
SPANNED = np.array([np.isin(range(4), corners) for corners in (*EDGES, *FACES)])
"""Which of a tetrahedron's corners each of its edges and then each of its faces has."""


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

    def at(self, rows: Indices) -> Rod:
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
        size = _size(aside)
        over = size > STRAIGHT * _size(direction)
        return np.asarray(point + (self.radius * over / np.where(over, size, 1.0))[:, None] * aside)

    def nearest(self, points: Array) -> Array:
        """The points (N, 3) of the cylinders that are nearest to the points (N, 3)."""
        offset = points - self.start
        along = _dot(offset, self.axis)
        aside = offset - along[:, None] * self.axis
        share = self.radius / np.maximum(_size(aside), np.maximum(self.radius, FLAT))
        return np.asarray(self.start + np.clip(along, 0.0, self.length)[:, None] * self.axis + share[:, None] * aside)


@dataclass(frozen=True)
class Box:
    """Boxes along the axes of the frame: their corners `low` and `high` (N, 3), mm."""

    low: Array
    high: Array
    axis = np.array([0.0, 0.0, 1.0])

    def at(self, rows: Indices) -> Box:
        """Some of them."""
        return Box(self.low[rows], self.high[rows])

    @property
    def middle(self) -> Array:
        """Their centres (N, 3)."""
        return 0.5 * (self.low + self.high)

    def farthest(self, direction: Array) -> Array:
        """The corners (N, 3) that lie farthest along the directions (N, 3)."""
        return np.where(direction > 0.0, self.high, self.low)

    def nearest(self, points: Array) -> Array:
        """The points (N, 3) of the boxes that are nearest to the points (N, 3)."""
        return np.clip(points, self.low, self.high)


def apart(a: Rod, b: Rod | Box, enough: float | Array = math.inf) -> Array:
    """Distance (N,) of cylinders from cylinders or boxes, mm, from below, negative where they meet; not sought further once it is
    above `enough`, of all or (N,).

    Three directions settle most: between the middles, along b (a stands above its end), and between two near points.
    """
    there = b.nearest(a.middle)
    here = a.nearest(there)
    found, above = np.full(len(a.start), -np.inf), _size(here - there)
    for direction in (a.middle - b.middle, np.broadcast_to(b.axis, a.start.shape), here - there):
        corner = a.farthest(-direction)
        found = np.maximum(found, _bound(direction, corner - b.farthest(direction)))
        above = np.minimum(above, _size(corner - b.nearest(corner)))
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
        size = _size(nearest)
        on = np.flatnonzero((size - found[live] > WITHIN_MM) & (found[live] <= enough[live]) & (size > WITHIN_MM))
        live, a, b = live[on], a.at(on), b.at(on)
        simplex = np.where(kept[on, :, None], simplex[on], point[on, None, :])
        nearest, kept, inside = _nearest(simplex)
        on = np.flatnonzero(~inside)
        live, a, b, simplex, nearest, kept = live[on], a.at(on), b.at(on), simplex[on], nearest[on], kept[on]
    return found


def _dot(a: Array, b: Array) -> Array:
    return np.asarray(np.einsum("...i,...i->...", a, b))


def _size(a: Array) -> Array:
    return np.asarray(np.sqrt(_dot(a, a)))


def _cross(a: Array, b: Array) -> Array:
    """`np.cross` of (…, 3) without what that does about other shapes, which costs more than the products."""
    (x, y, z), (u, v, w) = (np.moveaxis(vector, -1, 0) for vector in (a, b))
    return np.stack([y * w - z * v, z * u - x * w, x * v - y * u], axis=-1)


def _support(a: Rod, b: Rod | Box, direction: Array) -> Array:
    """The point of a - b that lies farthest against the direction."""
    return a.farthest(-direction) - b.farthest(direction)


def _bound(direction: Array, point: Array) -> Array:
    size = _size(direction)
    return np.where(size > FLAT, _dot(direction, point) / np.where(size > FLAT, size, 1.0), -np.inf)


def _nearest(simplex: Array) -> tuple[Array, Flags, Flags]:
    """Of tetrahedra (N, 4, 3), which may be flat: the points nearest to 0 of their edges and faces, the corners that span these,
    and whether 0 lies inside."""
    first = simplex[:, EDGES[:, 0]]
    way = simplex[:, EDGES[:, 1]] - first
    square = _dot(way, way)
    share = np.clip(-_dot(first, way) / np.where(square > FLAT, square, 1.0), 0.0, 1.0)
    x, y, z = (simplex[:, FACES[:, i]] for i in range(3))
    along, across = y - x, z - x
    normal, opposite = _cross(along, across), _cross(y, z)
    square = _dot(normal, normal)
    flat = square <= FLAT * _dot(along, along) * _dot(across, across)
    least = np.minimum(_dot(normal, opposite), np.minimum(_dot(normal, _cross(z, x)), _dot(normal, _cross(x, y))))
    foot = normal * (_dot(x, normal) / np.where(flat, 1.0, square))[..., None]
    foot[flat | (least < 0.0)] = np.inf
    points = np.concatenate([first + share[..., None] * way, foot], axis=1)
    best, rows = np.argmin(_dot(points, points), axis=1), np.arange(len(simplex))
    corners = SPANNED[best]
    edge = np.flatnonzero(best < len(EDGES))
    for end, left_out in enumerate((share >= 1.0, share <= 0.0)):
        corners[edge, EDGES[best[edge], end]] = ~left_out[edge, best[edge]]
    return points[rows, best], corners, _holds_zero(_dot(x, opposite))


def _holds_zero(parts: Array) -> Flags:
    """Whether 0 lies inside a tetrahedron: the four that it forms with the faces, of the volumes `parts` (N, 4) times 6, have the
    sign of the whole."""
    signed = parts[:, ::-1] * [1.0, -1.0, 1.0, -1.0]
    whole = np.abs(signed.sum(axis=1)) > FLAT
    return np.asarray(whole & ((signed > 0.0).all(axis=1) | (signed < 0.0).all(axis=1)))
