"""A sensitivity function as a trigonometric polynomial of its angles, with bounds of its derivatives that hold everywhere.

Positions follow from rotations, so what a pose tells, φ = ⟨G, F(pose)⟩, is a trigonometric polynomial of every angle: location
errors, Fourier error motions of rotary axes and polynomial ones of linear axes alike. A polynomial error motion of a rotary axis
multiplies it by a polynomial of the same angle. There the angle is taken twice: s, in the travel, of which φ is an algebraic
polynomial, and θ, all the way round, of which it is a trigonometric one; φ at s = θ + 2πm, m = 0, 1, …, tells one from the other.

A grid finer than the degrees bounds such a polynomial everywhere (H. Ehlich & K. Zeller 1964): sup|f| is at most the largest |f|
on the grid times 1/cos(πd/n) for every angle (degree d, n > 2d points) and 1/cos(πp/2n) for every s (degree p, n > p Chebyshev
points). Derivatives have the same degrees, so the same holds for them.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.polynomial import chebyshev
from numpy.typing import NDArray

__all__ = ["Spectrum", "spectrum_of"]

Array = NDArray[np.float64]
RowsAt = Callable[[Array], Array]
"""Rows (n, r, ny) at poses (n, d) with φ = Σ rows²."""
TURN = 2.0 * math.pi
LINE, LINES = 96, 3
MOST_TURNS = 9
VANISHES = 1e-9
"""Share of the largest coefficient below which one is rounding."""
AGREES, PROBES = 1e-6, 200
"""How well the polynomial has to agree with φ, as a share of its largest value, at so many random poses."""
MOST_COEFFICIENTS, MOST_GRID = 1_500_000, 10_000_000
FINENESS = (8.0, 6.0, 5.0, 4.0, 3.0)
"""Points of the bounding grid per degree: the first of them whose grid is small enough."""


@dataclass(frozen=True)
class _Angle:
    """One coordinate: trigonometric of degree `degree` in the angle and of degree `power` in its place on the travel."""

    degree: int
    power: int
    low: float
    high: float

    @property
    def size(self) -> int:
        return (2 * self.degree + 1) * (self.power + 1)

    def grid(self, angles: int, places: int) -> tuple[Array, Array]:
        """Places s and angles θ of a product grid, flat."""
        theta = TURN * np.arange(angles) / angles
        middle, half = 0.5 * (self.low + self.high), 0.5 * (self.high - self.low)
        s = middle + half * np.cos(math.pi * (np.arange(places) + 0.5) / places)
        return np.repeat(s, angles), np.tile(theta, places)

    def matrix(self, s: Array, theta: Array, order: int) -> Array:
        """Derivatives of that order along s = θ of all basis functions T_j(s) · (1, cos kθ, sin kθ): (n, size)."""
        half = 0.5 * (self.high - self.low)
        x = (s - 0.5 * (self.low + self.high)) / half
        total = np.zeros((len(s), self.size))
        for m in range(order + 1):
            product = (
                math.comb(order, m) * self._places(x, half, m)[:, :, None] * self._waves(theta, order - m)[:, None]
            )
            total += product.reshape(len(s), -1)
        return total

    def _places(self, x: Array, half: float, order: int) -> Array:
        each = np.eye(self.power + 1)
        derived = [chebyshev.chebval(x, chebyshev.chebder(c, order) if order else c) for c in each]
        return np.asarray(
            np.stack([np.broadcast_to(d, x.shape) for d in derived], axis=1) / half**order, dtype=np.float64
        )

    def _waves(self, theta: Array, order: int) -> Array:
        k = np.arange(1, self.degree + 1)
        turned = k * theta[:, None] + 0.5 * math.pi * order
        constant = np.full((len(theta), 1), 1.0 if order == 0 else 0.0)
        waves = [constant, k**order * np.cos(turned), k**order * np.sin(turned)]
        return np.asarray(np.concatenate(waves, axis=1), dtype=np.float64)


@dataclass(frozen=True)
class Spectrum:
    """φ as a polynomial: `coefficients`, one axis per angle, and `disagrees`, the most that it was off at random poses."""

    angles: tuple[_Angle, ...]
    coefficients: Array
    disagrees: float

    def values(self, poses: Array) -> Array:
        """φ at poses (n, d)."""
        found = np.broadcast_to(self.coefficients, (len(poses), *self.coefficients.shape))
        for i in reversed(range(len(self.angles))):
            found = np.einsum("n...k,nk->n...", found, self.angles[i].matrix(poses[:, i], poses[:, i], 0))
        return np.asarray(found)

    def largest(self, order: tuple[int, ...]) -> float:
        """A bound of the absolute derivative of those orders wherever the angles are and the places in their travels."""
        fine = next((f for f in FINENESS if self._points(f) <= MOST_GRID), FINENESS[-1])
        found, enlarged = self.coefficients, 1.0
        for angle, m in zip(self.angles, order, strict=True):
            n, p = _grid_sizes(angle, fine)
            enlarged /= math.cos(math.pi * angle.degree / n) * math.cos(0.5 * math.pi * angle.power / p)
            found = np.tensordot(found, angle.matrix(*angle.grid(n, p), m), axes=([0], [1]))
        return float(np.abs(found).max()) * enlarged

    def _points(self, fine: float) -> float:
        return math.prod(float(math.prod(_grid_sizes(angle, fine))) for angle in self.angles)

    def third(self) -> dict[tuple[int, ...], float]:
        """Bounds of all third derivatives, by their orders."""
        d = len(self.angles)
        orders = (order for order in itertools.product(range(4), repeat=d) if sum(order) == 3)
        return {order: self.largest(order) for order in orders}


def _grid_sizes(angle: _Angle, fine: float) -> tuple[int, int]:
    return max(1, math.ceil(fine * angle.degree)), max(1, math.ceil(0.5 * fine * angle.power))


def spectrum_of(rows_at: RowsAt, low: Array, high: Array) -> Spectrum | None:
    """The polynomial that φ = Σ `rows_at`² is for angles between `low` and `high`; None where it is none."""
    d = len(low)
    generator = np.random.default_rng(0)
    bases = low + (high - low) * generator.random((LINES, d))
    powers = [_power(rows_at, bases, i) for i in range(d)]
    if None in powers:
        return None
    split = _Split(rows_at, [p or 0 for p in powers], low, high)
    degrees = [_degree(split, bases, i) for i in range(d)]
    if None in degrees:
        return None
    angles = tuple(
        _Angle(degree or 0, 2 * (power or 0), float(a), float(b))
        for degree, power, a, b in zip(degrees, powers, low, high, strict=True)
    )
    if math.prod(angle.size for angle in angles) > MOST_COEFFICIENTS:
        return None
    found = split.values(angles)
    for i, angle in enumerate(angles):
        inverse = np.linalg.inv(angle.matrix(*angle.grid(2 * angle.degree + 1, angle.power + 1), 0))
        found = np.moveaxis(np.tensordot(inverse, found, axes=([1], [i])), 0, i)
    spectrum = Spectrum(angles, found, 0.0)
    poses = low + (high - low) * generator.random((PROBES, d))
    true = np.sum(rows_at(poses) ** 2, axis=(1, 2))
    off = float(np.abs(spectrum.values(poses) - true).max())
    return Spectrum(angles, found, off) if off <= AGREES * float(true.max()) else None


def _power(rows_at: RowsAt, bases: Array, i: int) -> int | None:
    """Degree of the polynomial by which the rows change from turn to turn of one angle."""
    turned = np.repeat(bases, MOST_TURNS, axis=0)
    turned[:, i] += TURN * np.tile(np.arange(MOST_TURNS), len(bases))
    found = rows_at(turned)
    if not np.isfinite(found).all():
        return None
    differences = found.reshape(len(bases), MOST_TURNS, -1)
    largest = np.abs(differences).max()
    for power in range(MOST_TURNS - 1):
        differences = np.diff(differences, axis=1)
        if np.abs(differences).max() <= VANISHES * largest:
            return power
    return None


@dataclass(frozen=True)
class _Split:
    """φ with the places s apart from the angles θ, the rows being polynomials of degrees `powers` in s."""

    rows_at: RowsAt
    powers: list[int]
    low: Array
    high: Array

    def at(self, s: Array, theta: Array) -> Array:
        """φ at places s and angles θ, both (n, d)."""
        poses, weights = theta[None], np.ones((1, len(theta)))
        for i, power in enumerate(self.powers):
            if power == 0:
                continue
            first = np.round((0.5 * (self.low[i] + self.high[i]) - theta[:, i]) / TURN - 0.5 * power)
            nodes = theta[:, i] + TURN * (first + np.arange(power + 1)[:, None])
            lagrange = np.stack([
                np.prod([(s[:, i] - nodes[b]) / (nodes[a] - nodes[b]) for b in range(power + 1) if b != a], axis=0)
                for a in range(power + 1)
            ])  # fmt: skip
            poses = np.repeat(poses, power + 1, axis=0)
            poses[:, :, i] = np.tile(nodes, (len(poses) // (power + 1), 1))
            weights = (weights[:, None] * lagrange).reshape(-1, len(theta))
        rows = sum(w[:, None, None] * self.rows_at(p) for w, p in zip(weights, poses, strict=True))
        return np.asarray(np.sum(np.asarray(rows) ** 2, axis=(1, 2)))

    def values(self, angles: tuple[_Angle, ...]) -> Array:
        """φ on the grid that determines its coefficients, one axis per angle."""
        grids = [angle.grid(2 * angle.degree + 1, angle.power + 1) for angle in angles]
        shape = tuple(len(s) for s, _ in grids)
        found = np.empty(math.prod(shape))
        for first in range(0, len(found), 20_000):
            place = np.unravel_index(np.arange(first, min(first + 20_000, len(found))), shape)
            s = np.stack([grid[0][p] for grid, p in zip(grids, place, strict=True)], axis=1)
            theta = np.stack([grid[1][p] for grid, p in zip(grids, place, strict=True)], axis=1)
            found[first : first + len(s)] = self.at(s, theta)
        return found.reshape(shape)


def _degree(split: _Split, bases: Array, i: int) -> int | None:
    """Trigonometric degree in one angle."""
    theta = np.repeat(bases, LINE, axis=0)
    theta[:, i] = np.tile(TURN * np.arange(LINE) / LINE, len(bases))
    values = split.at(np.repeat(bases, LINE, axis=0), theta).reshape(len(bases), LINE)
    if not np.isfinite(values).all():
        return None
    strength = np.abs(np.fft.rfft(values, axis=1)).max(axis=0)
    strong = np.flatnonzero(strength > VANISHES * strength.max())
    return None if strong.max() > LINE // 3 else int(strong.max())
