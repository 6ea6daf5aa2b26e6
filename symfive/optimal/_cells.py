"""Bounds of φ in cells: boxes of the angles about their centres.

In a cell of half widths h about a pose φ is its Taylor polynomial of second order and a remainder below Σ sup|∂ᵅφ| hᵅ/α! over all
third derivatives. With slope g and second derivatives H, and since |H_ij δ_i δ_j| ≤ |H_ij| (δ_i² h_j/h_i + δ_j² h_i/h_j)/2,

    φ ≤ φ(centre) + Σ_i max over 0 ≤ t ≤ h_i of (|g_i| t + D_i t²/2) + remainder,    D_i = H_ii + Σ_j |H_ij| h_j/h_i.

The first cells are those of a regular grid, on which the polynomial φ and all its derivatives of the first four orders cost a few
matrix products; the fifth is bounded everywhere (`_spectrum`). In a first cell, and so in every part of it,

    sup|∂ᵅφ| ≤ |∂ᵅφ| + Σ_i |∂_i ∂ᵅφ| h_i + Σ_ij sup|∂_i ∂_j ∂ᵅφ| h_i h_j/2,

which is a tenth of the bound that holds everywhere. Most first cells are settled by their own Taylor polynomial of fourth order.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from symfive.arrays import Array, Flags, Indices
from symfive.optimal._spectrum import Spectrum

Order = tuple[int, ...]
NEGLECTED, WIDEST, MOST_FIRST = 4e-6, math.radians(20.0), 1_500_000
"""Share of the limit that the fifth derivatives add in a first cell, and most of these cells: one costs a twentieth of a cell
that is halved later, so that a fine grid pays."""
TINY = 1e-30


@dataclass(frozen=True)
class Cells:
    """Boxes: `centres` and half widths `halves` (n, d), and `third` (n,), the first cell that each is part of."""

    centres: Array
    halves: Array
    third: Indices

    def __len__(self) -> int:
        return len(self.centres)

    def take(self, chosen: Indices | Flags) -> Cells:
        """Some of them."""
        return Cells(self.centres[chosen], self.halves[chosen], self.third[chosen])

    def joined(self, other: Cells) -> Cells:
        """These and others."""
        return Cells(
            np.concatenate([self.centres, other.centres]),
            np.concatenate([self.halves, other.halves]),
            np.concatenate([self.third, other.third]),
        )

    def halved(self, across: Indices) -> Cells:
        """Both halves of every cell."""
        row = np.arange(len(self))
        halves = self.halves.copy()
        halves[row, across] *= 0.5
        shift = np.zeros_like(halves)
        shift[row, across] = halves[row, across]
        centres = np.concatenate([self.centres - shift, self.centres + shift])
        return Cells(centres, np.tile(halves, (2, 1)), np.tile(self.third, 2))


@dataclass(frozen=True)
class Cut:
    """A limit for each of some cells, what must be ≥ 0, as its Taylor polynomial: `value` (n,), `slope` (n, d), `bent` (n, d, d)
    and the most that its third order adds, shared out among the angles, `third` (n, d)."""

    value: Array
    slope: Array
    bent: Array
    third: Array

    @classmethod
    def nothing(cls, n: int, d: int) -> Cut:
        """Limits of n cells that exclude nothing."""
        return cls(np.zeros(n), np.zeros((n, d)), np.zeros((n, d, d)), np.zeros((n, d)))

    def with_rows(self, rows: Indices, other: Cut) -> Cut:
        """These with the limits `other` of some cells."""
        found = Cut(self.value.copy(), self.slope.copy(), self.bent.copy(), self.third.copy())
        for name in ("value", "slope", "bent", "third"):
            getattr(found, name)[rows] = getattr(other, name)
        return found

    def take(self, chosen: Flags | Indices) -> Cut:
        """Of some of the cells."""
        return Cut(self.value[chosen], self.slope[chosen], self.bent[chosen], self.third[chosen])

    def most(self, half: Array) -> Array:
        """The most that the limit may be in each cell (n,)."""
        steepest = _steepest(self.slope, _diagonal(self.bent, half), half)
        return np.asarray(self.value + steepest.sum(axis=1) + self.third.sum(axis=1))


@dataclass(frozen=True)
class FirstCells:
    """The cells of a regular grid in which φ may exceed a limit; `settled`, the highest bound of all others;
    `thirds` (n, orders), bounds of the third derivatives over α! in each of `cells`, by `orders` (orders, d)."""

    cells: Cells
    settled: float
    thirds: Array
    orders: Indices

    def bounded(self, cells: Cells, value: Array, slope: Array, bent: Array, cut: Cut) -> tuple[Array, Indices]:
        """The bound in the reachable parts of these cells, and the angle across which to halve.

        From φ and its derivatives at the centres. Where a limit is ≥ 0, φ is not above φ plus any positive multiple of it: of the
        multiples that balance φ's slope in one angle the best counts (weak duality).
        """
        half = cells.halves
        own = _steepest(slope, _diagonal(bent, half), half)
        bound = own.sum(axis=1)
        with np.errstate(divide="ignore", invalid="ignore"):
            multiples = np.where(slope * cut.slope < 0.0, -slope / cut.slope, 0.0)
        for multiple in multiples.T[:, :, None]:
            each = _steepest(slope + multiple * cut.slope, _diagonal(bent + multiple[:, None] * cut.bent, half), half)
            each += multiple * cut.third
            less = multiple[:, 0] * cut.value + each.sum(axis=1)
            better = less < bound
            bound, own = np.where(better, less, bound), np.where(better[:, None], each, own)
        beyond = self.thirds[cells.third] * np.prod(half[:, None, :] ** self.orders, axis=2)
        return value + bound + beyond.sum(axis=1), np.argmax(own + beyond @ (self.orders / 3.0), axis=1)


def first_cells(spectrum: Spectrum, low: Array, high: Array, limit: float) -> FirstCells:
    """The cells of the box between `low` and `high` in which φ may exceed `limit`."""
    order = np.argsort([-angle.size for angle in spectrum.angles], kind="stable")
    found = _first_cells(spectrum.turned(order), low[order], high[order], limit)
    back, cells = np.argsort(order), found.cells
    cells = replace(cells, centres=cells.centres[:, back], halves=cells.halves[:, back])
    return replace(found, cells=cells, orders=found.orders[:, back])


def _first_cells(spectrum: Spectrum, low: Array, high: Array, limit: float) -> FirstCells:
    """The same for angles in the order that is least work."""
    fifth, d = spectrum.bounds(5), len(low)
    counts = _counts(low, high, fifth, limit)
    half = (high - low) / counts / 2.0
    axes = [a + h * (2.0 * np.arange(n) + 1.0) for a, h, n in zip(low, half, counts, strict=True)]
    orders = [order for order in itertools.product(range(4), repeat=d) if sum(order) == 3]
    shares = {order: _share(order, half) for order in itertools.product(range(5), repeat=d) if 2 < sum(order) < 5}
    beyond = sum(most * _share(order, half) for order, most in fifth.items())
    least = {order: _least_third(order, fifth, half) for order in orders}
    settled, centres, thirds = 0.0, [np.empty((0, d))], [np.empty((0, len(orders)))]
    first, *others = spectrum.bases(axes, 4)
    for i in range(counts[0]):
        slab = [first[:, :, i : i + 1], *others]
        found = {order: values.ravel() for order, values in spectrum.derivatives(slab, 0, 4)}
        bound = _by_fourth_order(found, shares, half) + beyond
        open_ = bound > limit
        settled = max(settled, float(bound.max(where=~open_, initial=0.0)))
        opened = np.flatnonzero(open_)
        there = np.unravel_index(opened, (1, *counts[1:]))
        centres.append(np.stack([a[k] for a, k in zip((axes[0][i : i + 1], *axes[1:]), there, strict=True)], axis=1))
        left = {order: values[opened] for order, values in found.items()}
        thirds.append(np.stack([_third(order, left, least[order], half) for order in orders], axis=1))
    poses = np.concatenate(centres)
    cells = Cells(poses, np.tile(half, (len(poses), 1)), np.arange(len(poses)))
    return FirstCells(cells, settled, np.concatenate(thirds), np.array(orders))


def _counts(low: Array, high: Array, fifth: Mapping[Order, float], limit: float) -> Indices:
    """How many first cells along every angle: so many that its fifth derivative adds no more than `NEGLECTED` of the limit."""
    d = len(low)
    own = np.array([fifth[tuple(5 * int(i == j) for j in range(d))] for i in range(d)])
    half = (math.factorial(5) * NEGLECTED * limit / np.maximum(own, TINY)) ** 0.2
    counts = np.maximum(1.0, (high - low) / np.minimum(2.0 * half, WIDEST))
    counts *= min(1.0, (MOST_FIRST / float(counts.prod())) ** (1.0 / d))
    return np.asarray(np.ceil(counts), dtype=np.int64)


def _diagonal(bent: Array, half: Array) -> Array:
    """D (n, d)."""
    coupled = np.abs(bent)
    np.einsum("nii->ni", coupled)[:] = 0.0
    return np.asarray(np.einsum("nii->ni", bent) + np.einsum("nij,nj->ni", coupled, half) / half)


def _steepest(slope: Array, diagonal: Array, half: Array | float) -> Array:
    """The most that each angle adds to φ by the first two orders (n, d)."""
    slope = np.abs(slope)
    turned = np.where(diagonal < 0.0, np.minimum(half, slope / np.maximum(-diagonal, TINY)), half)
    return np.asarray(slope * turned + 0.5 * diagonal * turned**2)


def _by_fourth_order(found: Mapping[Order, Array], shares: Mapping[Order, float], half: Array) -> Array:
    """The bound of the first four orders in first cells, from all their derivatives at the centres; `shares` hᵅ/α! of the third
    and fourth ones."""
    nothing = (0,) * len(half)
    bound = found[nothing].copy()
    for i, h in enumerate(half.tolist()):
        slope, diagonal = _raised(nothing, i), found[_raised(nothing, i, i)]
        for j, other in enumerate(half.tolist()):
            if i != j:
                diagonal = diagonal + np.abs(found[_raised(slope, j)]) * (other / h)
        bound += _steepest(found[slope], diagonal, h)
    for order, share in shares.items():
        bound += np.abs(found[order]) * share
    return bound


def _raised(order: Order, *angles: int) -> Order:
    """A derivative's orders with one more in each of some angles."""
    return tuple(m + angles.count(i) for i, m in enumerate(order))


def _share(order: Order, half: Array) -> float:
    """hᵅ/α!."""
    return math.prod(float(h) ** m / math.factorial(m) for h, m in zip(half, order, strict=True))


def _least_third(order: Order, fifth: Mapping[Order, float], half: Array) -> float:
    """What the fifth derivatives add to the bound of a third one in first cells."""
    each: list[tuple[int, float]] = list(enumerate(half.tolist()))
    return sum(fifth[_raised(order, i, j)] * a * b / 2.0 for (i, a), (j, b) in itertools.product(each, repeat=2))


def _third(order: Order, found: Mapping[Order, Array], least: float, half: Array) -> Array:
    """A bound of one third derivative in first cells, over α!; `least` of it the fifth derivatives add."""
    bound = np.abs(found[order]) + least
    for i, h in enumerate(half.tolist()):
        bound += np.abs(found[_raised(order, i)]) * h
    return np.asarray(bound / math.prod(map(math.factorial, order)))
