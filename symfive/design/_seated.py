"""Moves with the ball in its nest or the bar on where the straight one is blocked: by way of intermediate positions.

A probabilistic roadmap (L. E. Kavraki et al. 1996) of one set-up: its nodes are the run's poses and positions of a grid, its
edges straight seated moves that keep all limits at some positions in between. The shortest path in time joins two poses; whether
the bodies themselves keep apart along it is tested only for the paths that are used (lazily, R. Bohlin & L. E. Kavraki 2000).
Sparse graphs are imported when a move is bent: most plans with an R-test have none.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Sequence
from functools import cached_property
from typing import Any

import numpy as np

from symfive.arrays import Array, Flags, Indices
from symfive.design._candidates import pose_grid
from symfive.design._rounding import on_grid
from symfive.design._space import Space
from symfive.moves import move_times
from symfive.nc import Positions, Way, along_arcs

BETWEEN = np.linspace(0.0, 1.0, 37)[1:-1]
"""Shares of a move at which the limits are looked at while the order is sought."""
FEWER = BETWEEN[2::5]
MANY = 60
"""Poses in one run beyond which the moves between all pairs are looked at less closely; those taken always are."""
PLACES = 1000
"""Positions of the grid that are tried as nodes."""
NEIGHBOURS = 20
"""Edges of a node to the nearest others, in time."""
BESIDE_DEG = 2.0
"""From so far beside it a pose is reached from the side that its row says."""
Moves = Sequence[tuple[Positions, Positions]]
"""Straight seated moves, each from one place to another."""
Clear = Callable[[Moves], Sequence[bool]]
"""Whether each of some of them is clear of everything."""
LEAST_S = 0.1
"""Time of the shortest edge: a sparse graph has none of no length."""


class Seated:
    """Seated moves between the poses (n) of one set-up: `z` (n, nz) and `k` (n, 1) of its rows.

    `commands` of the poses; `straight` (n, n) about the times of straight moves, `times` (n, n) of the shortest clear ones,
    infinite where the limits part two poses, s; `direct` (n, n) whether the straight move keeps all limits; `followed` beginning
    and end of a straight move → whether the linear axes can follow the ball along it, as far as was asked. The tip of a touch
    probe cannot follow its sphere: no two of its poses are joined.
    """

    def __init__(self, space: Space, z: Array, k: Array) -> None:
        self.space, self.count = space, len(z)
        self.z, self.k = z, k
        self.commands = space.commands(z, k)
        self.straight = move_times(space.machine, self.commands)
        self.follows = space.instrument != "touch_probe"
        self.direct = np.eye(self.count, dtype=bool)
        if self.follows:
            first, last = np.nonzero(~self.direct)
            self.direct[first, last] = ~_leaves(space, z, k, first, last, BETWEEN if self.count <= MANY else FEWER)
        self._blocked: set[tuple[int, int]] = set()
        self.followed: dict[tuple[float, ...], bool] = {}

    @cached_property
    def times(self) -> Array:
        """Times of the shortest clear moves (n, n), s."""
        if not self.follows:
            return np.where(self.direct, 0.0, np.inf)
        if self.direct.all():
            return self.straight
        from scipy.sparse.csgraph import dijkstra

        return np.asarray(dijkstra(self._graph, indices=range(self.count))[:, : self.count])

    def via(self, first: int, last: int, sides: Array, clear: Clear | None = None) -> Way | None:
        """Intermediate positions of the shortest move from one pose to another, () of a straight one, None where there is none.

        `sides` (R,) from which the rotary axes have to reach the pose, -1 or 1: a static row counts as approached from the side
        of the rows before it. `clear` of straight seated moves decides finally; what it refuses is not tried again.
        """
        while (path := self._path(first, last, sides)) is not None:
            legs = list(itertools.pairwise(path))
            fits = clear([(self._position(a), self._position(b)) for a, b in legs]) if clear else (True,) * len(legs)
            bad = [leg for leg, fit in zip(legs, fits, strict=True) if not fit]
            if not bad:
                return tuple(self._position(node) for node in path[1:-1])
            self._blocked |= {*bad, *((b, a) for a, b in bad)}
        return None

    def likely_moves(self, order: Indices, sides: Array) -> list[tuple[Positions, Positions]]:
        """Beginnings and ends of the moves on the shortest paths between the rows of an order, come from `sides` (rows, R)."""
        rows = [i for i in range(1, len(order)) if order[i] != order[i - 1]]
        paths = [self._path(int(order[i - 1]), int(order[i]), sides[i]) for i in rows]
        legs = dict.fromkeys(leg for path in paths if path for leg in itertools.pairwise(path))
        return [(self._position(a), self._position(b)) for a, b in legs]

    def reached_from(self, pose: int, z: Array) -> Flags:
        """Whether the straight moves from a pose to other rows (m, nz) of the set-up keep all limits (m,)."""
        both, k = np.concatenate([self.z[pose : pose + 1], z]), np.repeat(self.k[:1], len(z) + 1, axis=0)
        return ~_leaves(self.space, both, k, np.zeros(len(z), dtype=np.int64), np.arange(1, len(z) + 1), BETWEEN)

    def _path(self, first: int, last: int, sides: Array) -> list[int] | None:
        """Nodes of the shortest move, not through a leg that was refused."""
        if self.direct[first, last] and (first, last) not in self._blocked:
            return [first, last]
        if not self.follows:
            return None
        from scipy.sparse.csgraph import dijkstra

        graph = self._graph.copy()
        if self._blocked:
            refused = np.zeros(graph.shape, dtype=bool)
            refused[tuple(np.array(list(self._blocked)).T)] = True
            graph.data[refused[graph.nonzero()]] = 0.0  # of straight moves that were refused some are no edges
            graph.eliminate_zeros()
        into = graph[:, [last]].tocoo()  # between opposite bars the way there may be clear and the way back not
        nodes = into.coords[0]
        graph[nodes, last] = 0.0  # nothing leads through it
        graph.eliminate_zeros()
        reached, before = dijkstra(graph, indices=first, return_predecessors=True)
        total = reached[nodes] + into.data
        for i in np.argsort(total):
            if not np.isfinite(total[i]):
                break
            path = [last, int(nodes[i])]
            while path[-1] != first:
                path.append(int(before[path[-1]]))
            path.reverse()
            turned = np.diff(self._rotary[path], axis=0)
            if np.all((np.sign(turned[-1]) == sides) | ~turned.any(axis=0)):
                return path
        return None

    @cached_property
    def _nodes(self) -> tuple[Array, Array]:
        """Variables and constants of the poses and, behind them, of positions within all limits: beside every different pose in
        each direction of the rotary axes, so that it can be reached from any side, and on a grid."""
        axes = self.space.machine.axes
        rotary = sum(axis.rotary for axis in axes.values())
        steps = np.array(list(itertools.product((0.0, -1.0, 1.0), repeat=rotary)))[1:] * np.radians(BESIDE_DEG)
        different = np.unique(self.z[:, : self.space.poses], axis=0)
        beside = np.repeat(different, len(steps), axis=0)
        beside[:, :rotary] += np.tile(steps, (len(different), 1))
        poses = on_grid(self.space, np.concatenate([beside, pose_grid(self.space, PLACES)]))
        setup = np.broadcast_to(self.z[0, self.space.poses :], (len(poses), self.z.shape[1] - self.space.poses))
        z, k = np.hstack([poses, setup]), np.repeat(self.k[:1], len(poses), axis=0)
        fits = self.space.feasible(z, k)
        return np.concatenate([self.z, z[fits]]), np.concatenate([self.k, k[fits]])

    @cached_property
    def _commands(self) -> dict[str, Array]:
        return self.space.commands(*self._nodes)

    @cached_property
    def _rotary(self) -> Array:
        """Positions of the rotary axes at all nodes (N, R), degree."""
        axes = self.space.machine.axes
        found = [q for name, q in self._commands.items() if axes[name].rotary]
        return np.stack(found, axis=1) if found else np.zeros((len(self._nodes[0]), 0))

    def _position(self, node: int) -> Positions:
        return {name: float(q[node]) for name, q in self._commands.items()}

    @cached_property
    def _graph(self) -> Any:
        """Times of the edges, sparse (N, N)."""
        from scipy.sparse import csr_array

        z, k = self._nodes
        times = move_times(self.space.machine, self._commands)
        others = times + np.diag(np.full(len(z), np.inf))
        order = np.argpartition(others, min(NEIGHBOURS, len(z) - 1), axis=1)[:, :NEIGHBOURS]
        near = np.zeros(times.shape, dtype=bool)
        near[np.arange(len(z))[:, None], order] = True
        near[: self.count, : self.count] = False
        first, last = np.nonzero(np.triu(near | near.T))
        fits = ~_leaves(self.space, z, k, first, last, BETWEEN)
        edge = np.zeros(times.shape, dtype=bool)
        edge[first[fits], last[fits]] = True
        edge |= edge.T
        edge[: self.count, : self.count] = self.direct & ~np.eye(self.count, dtype=bool)
        return csr_array(np.where(edge, np.maximum(times, LEAST_S), 0.0))


def _leaves(space: Space, z: Array, k: Array, first: Indices, last: Indices, shares: Array) -> Flags:
    """Whether the seated moves from some rows to others leave the limits: rotary axes straight, the ball in its nest or the bar
    on the shorter arc, as the program drives."""
    a, b = z[first], z[last]
    bars = (bars_of(space, a), bars_of(space, b)) if space.bar else None
    live = np.arange(len(first))
    # the first limit that is left settles a move: few places far apart are looked at first
    for share in np.concatenate([shares[2::5], np.delete(shares, np.s_[2::5])]):
        there = a[live] + share * (b[live] - a[live])
        if bars is not None:
            between = along_arcs(bars[0][live], bars[1][live], np.array([share]))
            there[:, space.poses - 2 : space.poses] = angles_of(between[:, 0])
        live = live[~np.any(space.kernel.limits(there, k[first[live]]) < -1e-6, axis=1)]
    bad = np.ones(len(first), dtype=bool)
    bad[live] = False
    return bad


def angles_of(bars: Array) -> Array:
    """Azimuth and elevation (n, 2) of unit vectors."""
    return np.stack([np.arctan2(bars[:, 1], bars[:, 0]), np.arcsin(np.clip(bars[:, 2], -1.0, 1.0))], axis=1)


def bars_of(space: Space, z: Array) -> Array:
    """Unit vectors (n, 3) from the table ball along the bar, workpiece frame, of rows of a ball bar."""
    azimuth, elevation = z[:, space.poses - 2], z[:, space.poses - 1]
    return np.stack(
        [np.cos(elevation) * np.cos(azimuth), np.cos(elevation) * np.sin(azimuth), np.sin(elevation)], axis=1
    )
