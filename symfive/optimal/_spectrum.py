"""A sensitivity function as a polynomial of its angles, with bounds of its derivatives that hold everywhere in their ranges.

Positions follow from rotations, and error motions are polynomials or harmonics of positions. What a pose tells,
φ = ⟨G, F(pose)⟩, is therefore a trigonometric polynomial of every angle that goes all the way round and in which it is periodic.
In any other angle it is entire, and its Chebyshev series on the angle's range ends, to rounding, after a few terms; a spline's
does not, and is refused.

A grid finer than the degrees bounds such a polynomial everywhere (H. Ehlich & K. Zeller 1964): sup|f| is at most the largest |f|
on the grid times 1/cos(πd/n) for every periodic angle (degree d, n > 2d points) and 1/cos(πp/2n) for every other (degree p, n > p
Chebyshev points). Derivatives have no higher degrees, so the same holds for them.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.polynomial import chebyshev

from symfive.arrays import Array, Indices

Order = tuple[int, ...]
ValuesAt = Callable[[Array], Array]
"""φ (n,) at poses (n, d)."""
TURN = 2.0 * math.pi
LINE, LINES = 96, 3
VANISHES = 1e-12
"""Share of the largest coefficient of a line from which on all are rounding."""
AGREES, PROBES = 1e-6, 200
"""How well the polynomial has to agree with φ, as a share of its largest value, at so many random poses."""
MOST_COEFFICIENTS, MOST_GRID = 1_500_000, 1_000_000
FINENESS = (8.0, 6.0, 5.0, 4.0, 3.0)
"""Points of the bounding grid per degree: the first of them whose grid is small enough."""


@dataclass(frozen=True)
class _Angle:
    """One coordinate between `low` and `high`, `round` where φ is periodic in it, and its `degree`."""

    low: float
    high: float
    round: bool
    degree: int

    @property
    def size(self) -> int:
        """Number of basis functions."""
        return 2 * self.degree + 1 if self.round else self.degree + 1

    def grid(self, count: int) -> Array:
        """Points that bound a polynomial."""
        if self.round:
            return self.low + TURN * np.arange(count) / count
        middle, half = 0.5 * (self.low + self.high), 0.5 * (self.high - self.low)
        return np.asarray(middle + half * np.cos(math.pi * (np.arange(count) + 0.5) / count))

    def matrix(self, q: Array, order: int) -> Array:
        """Derivatives of that order of the basis functions 1, cos kq, sin kq or T_k(q) at points (n,): (n, size)."""
        if self.round:
            k = np.arange(1, self.degree + 1)
            turned = k * q[:, None] + 0.5 * math.pi * order
            constant = np.full((len(q), 1), 1.0 if order == 0 else 0.0)
            waves = [constant, k**order * np.cos(turned), k**order * np.sin(turned)]
            return np.asarray(np.concatenate(waves, axis=1), dtype=np.float64)
        half = 0.5 * (self.high - self.low)
        derived = chebyshev.chebder(np.eye(self.size), order) if order else np.eye(self.size)
        x = (q - 0.5 * (self.low + self.high)) / half
        return np.asarray(chebyshev.chebvander(x, len(derived) - 1) @ derived / half**order, dtype=np.float64)

    def points(self, fine: float) -> int:
        """How many points of a grid so fine."""
        return max(1, math.ceil(fine * self.degree * (1.0 if self.round else 0.5)))

    def enlarged(self, count: int) -> float:
        """By how much a polynomial can exceed its largest value on the grid."""
        return 1.0 / math.cos(math.pi * self.degree / count * (1.0 if self.round else 0.5))


@dataclass(frozen=True)
class Spectrum:
    """φ as a polynomial: `coefficients`, one axis per angle, and `disagrees`, the most that it was off at random poses."""

    angles: tuple[_Angle, ...]
    coefficients: Array
    disagrees: float

    def values(self, poses: Array) -> Array:
        """φ at poses (n, d)."""
        first, *others = (angle.matrix(poses[:, i], 0) for i, angle in enumerate(self.angles))
        found = np.tensordot(first, self.coefficients, axes=([1], [0]))
        for basis in others:
            found = np.einsum("nk...,nk->n...", found, basis)
        return np.asarray(found)

    def turned(self, order: Indices) -> Spectrum:
        """The same polynomial with its angles in another order."""
        angles = tuple(self.angles[i] for i in order.tolist())
        return replace(self, angles=angles, coefficients=np.ascontiguousarray(self.coefficients.transpose(order)))

    def bases(self, grids: Sequence[Array], most: int) -> list[Array]:
        """Of every angle the derivatives up to the order `most` of its basis functions on its grid: (most + 1, size, points)."""
        return [np.stack([a.matrix(q, m).T for m in range(most + 1)]) for a, q in zip(self.angles, grids, strict=True)]

    def derivatives(self, bases: Sequence[Array], least: int, most: int) -> Iterator[tuple[Order, Array]]:
        """All derivatives of the total orders `least` to `most` on a grid: their orders in each angle, and values, one axis per
        angle. It is least work where the angles with most basis functions come first."""
        shape = tuple(basis.shape[2] for basis in bases)

        def deeper(found: Array, order: Order) -> Iterator[tuple[Order, Array]]:
            basis, left, last = bases[len(order)], most - sum(order), len(order) + 1 == len(bases)
            first = max(0, left - most + least) if last else 0
            each = found.reshape(basis.shape[1], -1).T @ basis[first : left + 1]
            for m, values in enumerate(each, first):
                if last:
                    yield (*order, m), values.reshape(shape)
                else:
                    yield from deeper(values, (*order, m))

        yield from deeper(self.coefficients, ())

    def bounds(self, total: int) -> dict[Order, float]:
        """Bounds of all absolute derivatives of one total order everywhere in the ranges, by their orders."""
        sizes = [[angle.points(fine) for angle in self.angles] for fine in FINENESS]
        counts = next((size for size in sizes if math.prod(size) <= MOST_GRID), sizes[-1])
        enlarged = math.prod(angle.enlarged(count) for angle, count in zip(self.angles, counts, strict=True))
        bases = self.bases([angle.grid(count) for angle, count in zip(self.angles, counts, strict=True)], total)
        return {
            order: max(float(found.max()), -float(found.min())) * enlarged
            for order, found in self.derivatives(bases, total, total)
        }


def spectrum_of(values_at: ValuesAt, low: Array, high: Array) -> Spectrum | None:
    """The polynomial that φ is for angles between `low` and `high`; None where it is none of a moderate degree."""
    generator = np.random.default_rng(0)
    bases = low + (high - low) * generator.random((LINES, len(low)))
    angles: list[_Angle] = []
    for i, (a, b) in enumerate(zip(low.tolist(), high.tolist(), strict=True)):
        angle = _angle(values_at, bases, i, a, b)
        if angle is None:
            return None
        angles.append(angle)
    if math.prod(angle.size for angle in angles) > MOST_COEFFICIENTS:
        return None
    found = _on_grid(values_at, angles)
    for i, angle in enumerate(angles):
        inverse = np.linalg.inv(angle.matrix(angle.grid(angle.size), 0))
        found = np.moveaxis(np.tensordot(inverse, found, axes=([1], [i])), 0, i)
    spectrum = Spectrum(tuple(angles), found, 0.0)
    poses = low + (high - low) * generator.random((PROBES, len(low)))
    true = values_at(poses)
    off = float(np.abs(spectrum.values(poses) - true).max())
    return replace(spectrum, disagrees=off) if off <= AGREES * float(true.max()) else None


def _angle(values_at: ValuesAt, bases: Array, i: int, low: float, high: float) -> _Angle | None:
    """Whether φ is periodic in one angle, and its degree."""
    turned = bases.copy()
    turned[:, i] += TURN
    before, after = values_at(bases), values_at(turned)
    if not (np.isfinite(before).all() and np.isfinite(after).all()):  # the chain is singular somewhere
        return None
    whole = high - low >= TURN - 1e-9 and np.allclose(before, after, rtol=1e-9, atol=1e-9 * np.abs(before).max())
    line = _Angle(low, high, whole, LINE // 2 - 1 if whole else LINE - 1)
    points = line.grid(line.size)
    poses = np.repeat(bases, line.size, axis=0)
    poses[:, i] = np.tile(points, len(bases))
    values = values_at(poses).reshape(len(bases), line.size)
    if not np.isfinite(values).all():
        return None
    strength = np.abs(np.linalg.solve(line.matrix(points, 0), values.T)).max(axis=1)
    if whole:  # the cosine and the sine of every degree
        strength = np.concatenate([strength[:1], np.maximum(*strength[1:].reshape(2, -1))])
    degree = int(np.flatnonzero(strength > VANISHES * strength.max()).max(initial=0))
    return None if degree > 0.7 * line.degree else replace(line, degree=degree)


def _on_grid(values_at: ValuesAt, angles: list[_Angle]) -> Array:
    """φ on the grid that determines its coefficients, one axis per angle."""
    grids = [angle.grid(angle.size) for angle in angles]
    shape = tuple(map(len, grids))
    found = np.empty(math.prod(shape))
    for first in range(0, len(found), 20_000):
        place = np.unravel_index(np.arange(first, min(first + 20_000, len(found))), shape)
        poses = np.stack([grid[p] for grid, p in zip(grids, place, strict=True)], axis=1)
        found[first : first + len(poses)] = values_at(poses)
    return found.reshape(shape)
