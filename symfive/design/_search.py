"""The largest ⟨G, F(pose)⟩ over all poses of some set-ups, searched: `_proof` bounds it.

The search starts from quasi-random poses (Halton's), some of them on the edges and corners of the travels and some beyond the
limits, and from the poses of the relaxed design, and ascends from the best (`_sensitivity`). For the poses of a plan themselves a
compass search is enough.
"""

from __future__ import annotations

import itertools

import numpy as np

from symfive.arrays import Array, Indices
from symfive.design._sensitivity import local_maxima, penalty_of, sensitivity_function
from symfive.design._space import Space
from symfive.optimal import TINY, Candidates, Relaxed, Task, sensitivity

COARSE = 4096
FEW, MANY = 25, 125
"""Poses of the grid in a set-up from which a search ascends, by the square of how many angles a pose has: while poses are
collected, and before nothing more is sought."""
BLOCKS = 8
"""Of every angle: many of the best poses lie about one maximum, and those about the others would start nowhere."""
MOST_FRESH, NEAR = 200, 3e-3
"""Poses that a search returns, and how far apart these are, of the ranges."""
FROM_GRID, HALVINGS, THINNED, SLANTED = 192, 14, (3, 6), 4
"""Of the compass search: where it begins, how often its step is halved and after which halvings near poses become one. Steps lead
along the angles and in slanted directions, so many per angle: where two limits meet no single angle can move."""
STRETCHED = 1.5
"""Half of the poses again are spread over a box as much wider and put back onto its limits: a third of their coordinates."""
PRIMES = (2, 3, 5, 7, 11, 13)


class Search:
    """The largest ⟨G, F⟩ over the feasible poses of some set-ups."""

    def __init__(self, space: Space, task: Task, setups: Array, lengths: Array) -> None:
        self.space, self.setups, self.lengths = space, setups, lengths
        self.groups = len(setups)
        self.layout = task.layout(self.groups)
        z, k, group = self._rows(poses_everywhere(space))
        self.all = Candidates(z, k, group, space.kernel.rows(z, k))
        self.fits = space.feasible(z, k, self.all.rows)
        self.violated = np.sum(np.minimum(space.kernel.limits(z, k), 0.0) ** 2, axis=1)
        self.grid = self.all.take(np.flatnonzero(self.fits))
        self.whole = self.layout.embed(self.all.rows, group)
        self.block = self._blocks(z, group)

    def _blocks(self, z: Array, group: Indices) -> Indices:
        """The block of its set-up that each pose lies in (n,), of `BLOCKS` along every angle."""
        poses, low, high = self.space.poses, self.space.lower, self.space.upper
        share = (z[:, :poses] - low[:poses]) / np.maximum(high - low, TINY)[:poses]
        place = np.minimum((BLOCKS * share).astype(np.int64), BLOCKS - 1)
        return np.asarray(np.ravel_multi_index((group, *place.T), (self.groups, *(BLOCKS,) * poses)))

    def _starts(self, merit: Array, g: int, count: int) -> Indices:
        """Where to begin in set-up g: the best pose of every block, best first, then the second ones."""
        mine = np.flatnonzero(self.all.group == g)
        mine = mine[np.argsort(merit[mine])[::-1]]
        by_block = np.argsort(self.block[mine], kind="stable")
        blocks = self.block[mine][by_block]
        rank = np.empty(len(mine), dtype=np.int64)
        rank[by_block] = np.arange(len(mine)) - np.searchsorted(blocks, blocks)
        return np.asarray(mine[np.argsort(rank, kind="stable")][:count])

    def _rows(self, poses: Array) -> tuple[Array, Array, Indices]:
        n = len(poses)
        z = np.concatenate([np.tile(poses, (self.groups, 1)), np.repeat(self.setups, n, axis=0)], axis=1)
        return z, np.repeat(self.lengths, n, axis=0), np.repeat(np.arange(self.groups), n)

    def largest(self, relaxed: Relaxed, columns: Candidates, starts: int = FEW) -> tuple[float, Candidates]:
        """The largest value found and poses at local maxima, from the best of the grid, `starts` (see `FEW`) in every set-up,
        and from `columns`, those that the relaxed design already weighs."""
        pull = relaxed.pull
        seen = sensitivity(pull, self.whole)
        known = sensitivity(pull, self.layout.embed(columns.rows, columns.group))
        top = max(float(seen[self.fits].max(initial=0.0)), float(known.max(initial=0.0)))
        penalty = penalty_of(seen / top, self.violated)
        merit = seen / top - penalty * self.violated
        poses = self.space.poses
        parts = []
        for g in range(self.groups):
            mine, own = self._starts(merit, g, starts * poses**2), columns.group == g
            start = np.concatenate([self.all.z[mine], columns.z[own]])[:, :poses]
            phi = sensitivity_function(self.space, self.layout, pull, self.setups[g], self.lengths[g], g)
            higher = local_maxima(phi, start, top, penalty)
            there = np.where(self.space.feasible(*phi.decided(higher)), phi.values(higher), -np.inf)
            before = np.concatenate([np.where(self.fits[mine], seen[mine], -np.inf), known[own]])
            value = np.concatenate([there, before])
            z = phi.decided(np.concatenate([higher, start]))[0]
            some = self._distinct(z[:, :poses], value, np.zeros(len(z), dtype=np.int64))
            parts.append((z[some], value[some], np.full(len(some), g)))
        z, value, group = (np.concatenate(part) for part in zip(*parts, strict=True))
        best = np.argsort(value)[::-1][:MOST_FRESH]
        z, k, group = z[best], self.lengths[group[best]], group[best]
        return float(value[best[0]]), Candidates(z, k, group, self.space.kernel.rows(z, k))

    def spread(self, relaxed: Relaxed, columns: Candidates) -> tuple[float, Candidates]:
        """The largest value found, and informative poses, by compass search: many stop before a local maximum, which
        leaves integer numbers of poses more to choose from."""
        seen = sensitivity(relaxed.pull, self.whole[self.fits])
        each = [np.flatnonzero(self.grid.group == g) for g in range(self.groups)]
        first = np.concatenate([mine[np.argsort(seen[mine])[::-1][: FROM_GRID // self.groups]] for mine in each])
        z, k, group = self.grid.z[first].copy(), self.grid.k[first], self.grid.group[first]
        value = seen[first]
        z, k = np.concatenate([z, columns.z]), np.concatenate([k, columns.k])
        group = np.concatenate([group, columns.group])
        value = np.concatenate([value, sensitivity(relaxed.pull, self.layout.embed(columns.rows, columns.group))])
        poses = self.space.poses
        low, high = self.space.lower[:poses], self.space.upper[:poses]
        step = (high - low) * COARSE ** (-1.0 / poses)
        generator = np.random.default_rng(0)
        for halving in range(HALVINGS):
            if halving in THINNED:
                some = self._distinct(z[:, :poses], value, group, len(z))
                z, k, group, value = z[some], k[some], group[some], value[some]
            slanted = generator.uniform(-1.0, 1.0, (SLANTED * poses, poses))
            for direction in np.concatenate([np.eye(poses), -np.eye(poses), slanted]):
                trial = z.copy()
                trial[:, :poses] = np.clip(trial[:, :poses] + direction * step, low, high)
                better, there = self._better(relaxed.pull, trial, k, group, value)
                z[better], value[better] = trial[better], there
            step = 0.5 * step
        fresh = self._distinct(z[:, :poses], value, group)
        z, k = z[fresh], k[fresh]
        return float(value.max()), Candidates(z, k, group[fresh], self.space.kernel.rows(z, k))

    def _better(self, pull: Array, z: Array, k: Array, group: Indices, value: Array) -> tuple[Indices, Array]:
        """Poses that can be reached and exceed `value` (n,), and their ⟨G, F⟩."""
        rows = self.space.kernel.rows(z, k)
        phi = sensitivity(pull, self.layout.embed(rows, group))
        more = np.flatnonzero(phi > value)
        more = more[self.space.feasible(z[more], k[more], rows[more])]
        return more, phi[more]

    def _distinct(self, poses: Array, value: Array, group: Indices, most: int = MOST_FRESH) -> Indices:
        """The best of every neighbourhood in a set-up, best first; none that cannot be reached."""
        place = poses / (self.space.upper - self.space.lower)[: self.space.poses]
        by_first = np.argsort(place[:, 0], kind="stable")
        first = place[by_first, 0]
        low, high = (np.searchsorted(first, place[:, 0] + side * NEAR) for side in (-1.0, 1.0))
        left, found = np.isfinite(value), list[int]()
        for i in np.argsort(value)[::-1].tolist():
            if len(found) == most:
                break
            if left[i]:
                found.append(i)
                beside = by_first[low[i] : high[i]]
                apart = np.abs(place[beside] - place[i]).max(axis=1)
                left[beside[(apart < NEAR) & (group[beside] == group[i])]] = False
        return np.array(found, dtype=np.int64)


def poses_everywhere(space: Space) -> Array:
    """Poses (n, poses) spread evenly over their ranges, with many on the edges and all corners."""
    inside, outer = np.split(_spread(COARSE + COARSE // 2, space.poses), [COARSE])
    outer = np.clip(0.5 + STRETCHED * (outer - 0.5), 0.0, 1.0)
    corners = np.array(list(itertools.product((0.0, 1.0), repeat=space.poses)))
    low, high = space.lower[: space.poses], space.upper[: space.poses]
    return np.asarray(low + (high - low) * np.concatenate([inside, outer, corners]))


def _spread(count: int, dimensions: int) -> Array:
    """Points (count, dimensions) spread evenly over the unit cube (J. H. Halton 1960): the digits of 1, 2, … to prime bases,
    mirrored at the point. `scipy.stats` has them too and takes as long to import as a search takes."""
    columns = []
    for base in PRIMES[:dimensions]:
        left, column, place = np.arange(1, count + 1), np.zeros(count), 1.0
        while left.any():
            place /= base
            left, digit = np.divmod(left, base)
            column += place * digit
        columns.append(column)
    return np.stack(columns, axis=1)
