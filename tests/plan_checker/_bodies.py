"""Cylinders and how far they keep apart.

Two cylinders (convex) meet where a point of one lies in the other. Straight lines on the mantle of each are searched for the
point nearest to the other, whose signed distance along a line is convex. Lines lie on the body, so a meeting that is found is
one; between two of the `LINES` a meeting shallower than radius·(1 - cos(π/LINES)) can hide.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
LINES = 24
HALVINGS = 24
EDGE_MM = 5.0
GOLDEN = (np.sqrt(5.0) - 1.0) / 2.0


@dataclass(frozen=True)
class Cylinder:
    """From `start` (N, 3) along the unit vector `axis` (N, 3) over `length` (N,), with flat ends; a line where `radius` is 0."""

    start: Array
    axis: Array
    length: Array
    radius: float

    def at(self, where: NDArray[np.bool_]) -> Cylinder:
        """Some of them."""
        return Cylinder(self.start[where], self.axis[where], self.length[where], self.radius)

    def distance(self, points: Array) -> Array:
        """Signed distance of `points` (N, k, 3), negative inside, mm."""
        offset = points - self.start[:, None, :]
        along = np.einsum("nkj,nj->nk", offset, self.axis)
        away = np.linalg.norm(offset - along[..., None] * self.axis[:, None, :], axis=2) - self.radius
        beyond = np.maximum(-along, along - self.length[:, None])
        outside = np.hypot(np.maximum(away, 0.0), np.maximum(beyond, 0.0))
        return outside + np.minimum(np.maximum(away, beyond), 0.0)

    def lines(self) -> Array:
        """Starts (N, k, 3) of the lines on its mantle; they run along the axis."""
        if self.radius == 0.0:
            return self.start[:, None, :]
        aside = np.where(np.abs(self.axis[:, :1]) < 0.9, [[1.0, 0.0, 0.0]], [[0.0, 1.0, 0.0]])
        u = np.cross(self.axis, aside)
        u /= np.linalg.norm(u, axis=1, keepdims=True)
        v = np.cross(self.axis, u)
        angle = 2.0 * np.pi * np.arange(LINES) / LINES
        ring = np.cos(angle)[None, :, None] * u[:, None, :] + np.sin(angle)[None, :, None] * v[:, None, :]
        return self.start[:, None, :] + self.radius * ring

    def lowest(self) -> Array:
        """z of the lowest point of each (N,)."""
        ends = self.start[:, 2], self.start[:, 2] + self.length * self.axis[:, 2]
        return np.minimum(*ends) - self.radius * np.sqrt(np.maximum(1.0 - self.axis[:, 2] ** 2, 0.0))


@dataclass(frozen=True)
class Box:
    """From corner `low` to corner `high` (3,), its faces square to the axes of the frame."""

    low: Array
    high: Array

    def distance(self, points: Array) -> Array:
        """Signed distance of `points` (N, k, 3), negative inside, mm."""
        beyond = np.maximum(self.low - points, points - self.high)
        return np.linalg.norm(np.maximum(beyond, 0.0), axis=-1) + np.minimum(beyond.max(axis=-1), 0.0)

    def edges(self) -> Array:
        """Points (k, 3) of its edges, every `EDGE_MM` at least."""
        found = []
        for along in range(3):
            count = int(np.ceil((self.high[along] - self.low[along]) / EDGE_MM)) + 1
            for corner in range(4):
                points = np.empty((count, 3))
                for i, upper in zip([i for i in range(3) if i != along], (corner & 1, corner >> 1), strict=True):
                    points[:, i] = (self.high if upper else self.low)[i]
                points[:, along] = np.linspace(self.low[along], self.high[along], count)
                found.append(points)
        return np.concatenate(found)


def box_clearance(a: Cylinder, box: Box, near: float = 5.0) -> Array:
    """Distance of cylinders (N,) from a box in mm, negative where they meet: of their mantles' lines, and of its edges; infinite
    where the balls about them are above `near`."""
    middle, found = a.start + 0.5 * a.length[:, None] * a.axis, np.full(len(a.start), np.inf)
    close = box.distance(middle[:, None, :])[:, 0] - np.hypot(0.5 * a.length, a.radius) < near
    for rows in np.array_split(np.flatnonzero(close), 1 + int(close.sum()) // 500):
        if rows.size:
            some, edges = a.at(rows), box.edges()  # type: ignore[arg-type]
            corners = some.distance(np.broadcast_to(edges, (rows.size, *edges.shape))).min(axis=1)
            found[rows] = np.minimum(_lines_to(some, box), corners)
    return found


def clearance(a: Cylinder, b: Cylinder, near: float = 5.0) -> Array:
    """Distance of two cylinders (N,) in mm, negative where they meet; infinite where it is certainly above `near`."""
    found = np.full(len(a.start), np.inf)
    close = _centre_lines(a, b) - a.radius - b.radius < near
    if close.any():
        first, second = a.at(close), b.at(close)
        found[close] = np.minimum(_lines_to(first, second), _lines_to(second, first))
    return found


def _lines_to(a: Cylinder, b: Cylinder | Box) -> Array:
    """Smallest signed distance of a's lines from b (N,), by golden section."""
    starts = a.lines()

    def value(share: Array) -> Array:
        return b.distance(starts + (share * a.length[:, None])[..., None] * a.axis[:, None, :])

    low, high = np.zeros(starts.shape[:2]), np.ones(starts.shape[:2])
    best = np.minimum(value(low), value(high))
    left, right = high - GOLDEN * (high - low), low + GOLDEN * (high - low)
    at_left, at_right = value(left), value(right)
    for _ in range(HALVINGS):
        lower = at_left < at_right
        low, high = np.where(lower, low, left), np.where(lower, right, high)
        left, right = high - GOLDEN * (high - low), low + GOLDEN * (high - low)
        at_left, at_right = value(left), value(right)
        best = np.minimum(best, np.minimum(at_left, at_right))
    return np.asarray(best.min(axis=1))


def _centre_lines(a: Cylinder, b: Cylinder) -> Array:
    """Distance of the two centre lines (N,), closed form (Ericson, Real-Time Collision Detection, 5.1.9)."""
    d1, d2, r = a.axis * a.length[:, None], b.axis * b.length[:, None], a.start - b.start
    aa, ee, f = (np.einsum("nj,nj->n", x, y) for x, y in ((d1, d1), (d2, d2), (d2, r)))
    c, bb = np.einsum("nj,nj->n", d1, r), np.einsum("nj,nj->n", d1, d2)
    aa, ee = np.maximum(aa, 1e-12), np.maximum(ee, 1e-12)
    across = aa * ee - bb * bb
    s = np.where(across > 1e-9 * aa * ee, np.clip((bb * f - c * ee) / np.maximum(across, 1e-12), 0.0, 1.0), 0.0)
    t = (bb * s + f) / ee
    s = np.where(t < 0.0, np.clip(-c / aa, 0.0, 1.0), np.where(t > 1.0, np.clip((bb - c) / aa, 0.0, 1.0), s))
    t = np.clip(t, 0.0, 1.0)
    return np.linalg.norm(r + s[:, None] * d1 - t[:, None] * d2, axis=1)
