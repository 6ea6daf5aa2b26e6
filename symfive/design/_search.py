"""The largest ⟨G, F(pose)⟩ over all poses of some set-ups: searched, and where it can be, proved.

The search starts from quasi-random poses (Halton's) and from the poses of the relaxed design, and climbs by compass steps. The
proof is branch and bound with Bernstein's inequality for trigonometric polynomials of two rotary axes (see `_certificate`).
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from symfive.design._bodies import NOSE_LENGTH
from symfive.design._exchange import Candidates
from symfive.design._information import Task
from symfive.design._relaxed import Relaxed, sensitivity
from symfive.design._space import UNIT_MM, Space

__all__ = ["COARSE", "Search"]

Array = NDArray[np.float64]
Indices = NDArray[np.int64]
COARSE = 4096
FROM_GRID, MOST_FRESH, NEAR = 96, 200, 3e-3
HALVINGS, THINNED = 14, (3, 6)
PRIMES = (2, 3, 5, 7, 11, 13)
TORUS = 48
MOST_CELLS = 100_000


class Search:
    """The largest ⟨G, F⟩ over the feasible poses of some set-ups."""

    def __init__(self, space: Space, task: Task, setups: Array, lengths: Array) -> None:
        self.space, self.setups, self.lengths = space, setups, lengths
        self.groups = len(setups)
        self.layout = task.layout(self.groups)
        low, high = space.lower[: space.poses], space.upper[: space.poses]
        poses = low + _spread(COARSE, space.poses) * (high - low)
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

    def _pulled(self, pull: Array, z: Array, k: Array, group: Indices) -> Array:
        return sensitivity(pull, self.layout.embed(self.space.kernel.rows(z, k), group))

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
        step = (self.space.upper[:poses] - self.space.lower[:poses]) * COARSE ** (-1.0 / poses)
        for halving in range(HALVINGS):
            if halving in THINNED:
                some = self._distinct(z, group, value, len(z))
                z, k, group, value = z[some], k[some], group[some], value[some]
            for i in range(poses):
                for sign in (1.0, -1.0):
                    trial = z.copy()
                    trial[:, i] = np.clip(trial[:, i] + sign * step[i], self.space.lower[i], self.space.upper[i])
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

    def proved_largest(self, relaxed: Relaxed, slack: float) -> float | None:
        """An upper bound of ⟨G, F⟩ over all poses by branch and bound; None where the readings are no trigonometric
        polynomials of two rotary axes, or it would take too long."""
        if self.space.poses != 2 or self.space.instrument != "r_test":
            return None
        top = self.largest(relaxed)[0]
        bounds = [self._prove(relaxed.pull, g, top, slack) for g in range(self.groups)]
        return None if any(bound is None for bound in bounds) else max(bound for bound in bounds if bound is not None)

    def _degrees(self, pull: Array, g: int) -> tuple[Array, float] | None:
        """Degrees of the trigonometric polynomial in either angle and a bound of its values."""
        angles = 2.0 * math.pi * np.arange(TORUS) / TORUS
        poses = np.stack(np.meshgrid(angles, angles, indexing="ij"), axis=-1).reshape(-1, 2)
        z = np.concatenate([poses, np.tile(self.setups[g], (len(poses), 1))], axis=1)
        values = self._pulled(pull, z, np.tile(self.lengths[g], (len(z), 1)), np.full(len(z), g))
        if not np.isfinite(values).all():  # the chain is singular somewhere on the torus: it is no polynomial
            return None
        spectrum = np.abs(np.fft.fft2(values.reshape(TORUS, TORUS)))
        strong = np.argwhere(spectrum > 1e-9 * spectrum.max())
        degrees = np.minimum(strong, TORUS - strong).max(axis=0).astype(float)
        if degrees.max() > TORUS // 4:
            return None
        enlarged = 1.0 / math.prod(math.cos(math.pi * d / TORUS) for d in degrees)  # Ehlich & Zeller 1964
        return degrees, float(values.max()) * enlarged

    def _prove(self, pull: Array, g: int, top: float, slack: float) -> float | None:
        found = self._degrees(pull, g)
        if found is None:
            return None
        degrees, most = found
        low, high = self.space.lower[:2], self.space.upper[:2]
        counts = np.ceil((high - low) / np.radians(6.0)).astype(int)
        half = (high - low) / counts / 2.0
        axes = [low[i] + half[i] * (2.0 * np.arange(counts[i]) + 1.0) for i in range(2)]
        cells = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 2)
        worst = top
        while len(cells):
            z = np.concatenate([cells, np.tile(self.setups[g], (len(cells), 1))], axis=1)
            k = np.tile(self.lengths[g], (len(z), 1))
            reachable = self._near_limits(z, k, half)
            z, k, cells = z[reachable], k[reachable], cells[reachable]
            group = np.full(len(z), g)
            rows, slopes = self.space.kernel.slopes(z, k)
            whole, moved = self.layout.embed(rows, group), self.layout.embed(slopes[:, :2], group)
            weighted = pull @ whole
            value = np.einsum("npy,npy->n", whole, weighted)
            slope = 2.0 * np.einsum("nkpy,npy->nk", moved, weighted)
            bent = 0.5 * float(degrees @ half) ** 2 * most
            highest = value + np.abs(slope) @ half + bent
            close = highest <= top * (1.0 + slack)
            if 4 * int((~close).sum()) > MOST_CELLS:
                close[:] = True  # a valid bound all the same, only less sharp
            if close.any():
                worst = max(worst, float(highest[close].max()))
            cells = cells[~close]
            half = 0.5 * half
            cells = np.concatenate([cells + half * s for s in np.array([[1, 1], [1, -1], [-1, 1], [-1, -1]])])
        return worst

    def _near_limits(self, z: Array, k: Array, half: Array) -> NDArray[np.bool_]:
        """Cells that may hold a reachable pose: limits at the centre, with the slope across the cell and the most that they bend:
        positions are trigonometric polynomials of degree one in either angle, none larger than the lever."""
        if not self.space.kernel.limit_count:
            return np.full(len(z), True)
        limits = self.space.kernel.limits(z, k)
        slopes = np.abs(self.space.kernel.limit_slopes(z, k)[:, :2])
        across = np.einsum("nkg,k->ng", slopes, half)
        bend = 0.5 * float(half.sum()) ** 2 * self._lever(z[0]) / UNIT_MM
        return np.asarray(np.all(limits + across + bend >= 0.0, axis=1))

    def _lever(self, z: Array) -> float:
        """mm that no point of nest, tool and spindle nose lies farther from an axis than."""
        machine = self.space.machine
        reach = [np.linalg.norm(self.space.table_ball(z)), np.linalg.norm(self.space.tool_ball(z))]
        reach += [2.0 * np.linalg.norm(axis.origin) for axis in machine.axes.values() if axis.rotary]
        return float(sum(reach)) + sum((machine.workspace.spindle_nose or {}).values()) + NOSE_LENGTH


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
