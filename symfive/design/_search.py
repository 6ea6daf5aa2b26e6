"""The largest ⟨G, F(pose)⟩ over all poses of some set-ups, searched: `_proof` bounds it.

The search starts from quasi-random poses (Halton's), some of them on the edges and corners of the travels, and from the poses of
the relaxed design, and climbs by steps along the angles and in slanted directions.
"""

from __future__ import annotations

import itertools

import numpy as np
from numpy.typing import NDArray

from symfive.design._exchange import Candidates
from symfive.design._information import Task
from symfive.design._relaxed import Relaxed, sensitivity
from symfive.design._space import Space

__all__ = ["COARSE", "Search"]

Array = NDArray[np.float64]
Indices = NDArray[np.int64]
COARSE = 4096
FROM_GRID, MOST_FRESH, NEAR = 192, 200, 3e-3
STRETCHED = 1.5
"""Half of the poses again are spread over a box as much wider and put back onto its limits: a third of their coordinates."""
HALVINGS, THINNED, SLANTED = 14, (3, 6), 4
"""Steps lead along the angles and in slanted directions, so many per angle: where two limits meet no single angle can move."""
PRIMES = (2, 3, 5, 7, 11, 13)


class Search:
    """The largest ⟨G, F⟩ over the feasible poses of some set-ups."""

    def __init__(self, space: Space, task: Task, setups: Array, lengths: Array) -> None:
        self.space, self.setups, self.lengths = space, setups, lengths
        self.groups = len(setups)
        self.layout = task.layout(self.groups)
        inside, outer = np.split(_spread(COARSE + COARSE // 2, space.poses), [COARSE])
        outer = np.clip(0.5 + STRETCHED * (outer - 0.5), 0.0, 1.0)
        corners = np.array(list(itertools.product((0.0, 1.0), repeat=space.poses)))
        low, high = space.lower[: space.poses], space.upper[: space.poses]
        poses = low + (high - low) * np.concatenate([inside, outer, corners])
        self.grid = self._candidates(*self._rows(poses))
        self.whole = self.layout.embed(self.grid.rows, self.grid.group)

    def _rows(self, poses: Array) -> tuple[Array, Array, Indices]:
        n = len(poses)
        z = np.concatenate([np.tile(poses, (self.groups, 1)), np.repeat(self.setups, n, axis=0)], axis=1)
        return z, np.repeat(self.lengths, n, axis=0), np.repeat(np.arange(self.groups), n)

    def _candidates(self, z: Array, k: Array, group: Indices) -> Candidates:
        rows = self.space.kernel.rows(z, k)
        fits = self.space.feasible(z, k, rows)
        return Candidates(z[fits], k[fits], group[fits], rows[fits])

    def _told(self, pull: Array, z: Array, k: Array, group: Indices) -> Array:
        """⟨G, F⟩ of poses, -inf of those that cannot be reached."""
        rows = self.space.kernel.rows(z, k)
        told = sensitivity(pull, self.layout.embed(rows, group))
        return np.where(self.space.feasible(z, k, rows), told, -np.inf)

    def largest(self, relaxed: Relaxed, columns: Candidates | None = None) -> tuple[float, Candidates]:
        """The largest value found and poses at local maxima, by compass search from the best of the grid in every set-up and
        from `columns`, those that the relaxed design already weighs."""
        seen = sensitivity(relaxed.pull, self.whole)
        each = [np.flatnonzero(self.grid.group == g) for g in range(self.groups)]
        first = np.concatenate([mine[np.argsort(seen[mine])[::-1][: FROM_GRID // self.groups]] for mine in each])
        z, k, group = self.grid.z[first].copy(), self.grid.k[first], self.grid.group[first]
        value = seen[first]
        if columns is not None:
            z, k = np.concatenate([z, columns.z]), np.concatenate([k, columns.k])
            group = np.concatenate([group, columns.group])
            value = np.concatenate([value, sensitivity(relaxed.pull, self.layout.embed(columns.rows, columns.group))])
        poses = self.space.poses
        low, high = self.space.lower[:poses], self.space.upper[:poses]
        step = (high - low) * COARSE ** (-1.0 / poses)
        generator = np.random.default_rng(0)
        for halving in range(HALVINGS):
            if halving in THINNED:
                some = self._distinct(z, group, value, len(z))
                z, k, group, value = z[some], k[some], group[some], value[some]
            slanted = generator.uniform(-1.0, 1.0, (SLANTED * poses, poses))
            for direction in np.concatenate([np.eye(poses), -np.eye(poses), slanted]):
                trial = z.copy()
                trial[:, :poses] = np.clip(trial[:, :poses] + direction * step, low, high)
                there = self._told(relaxed.pull, trial, k, group)
                better = there > value
                z[better], value[better] = trial[better], there[better]
            step = 0.5 * step
        fresh = self._distinct(z, group, value, MOST_FRESH)
        return float(value.max()), Candidates(
            z[fresh], k[fresh], group[fresh], self.space.kernel.rows(z[fresh], k[fresh])
        )

    def _distinct(self, z: Array, group: Indices, value: Array, most: int) -> Indices:
        """The best of every neighbourhood, best first."""
        poses = self.space.poses
        place = np.concatenate(
            [z[:, :poses] / (self.space.upper - self.space.lower)[:poses], 1e3 * group[:, None]], axis=1
        )
        left = np.argsort(value)[::-1]
        found: list[int] = []
        while len(left) and len(found) < most:
            found.append(int(left[0]))
            left = left[np.abs(place[left] - place[left[0]]).max(axis=1) >= NEAR]
        return np.array(found, dtype=np.int64)


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
