"""The way of one recording: straight sweeps through positions (`_sweeps`), the most informative in the time.

Every sweep between two positions of a grid adds its information (`_sweeps`) and takes its seconds. A way grows by the position
that lowers ψ most per time, wherever it is put in; then positions are exchanged, put in and left out as long as ψ falls and the
time lasts. Changes are ranked by their first order, ⟨-dψ/dM, change⟩, and the best of them computed. At last the positions leave
the grid, by halved steps.
"""

from __future__ import annotations

import itertools
import math
import sys
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from symfive.arrays import Array, Flags, Indices
from symfive.design._circles import Goal
from symfive.design._sweeps import Sweep, Sweeps

POSITIONS, OF_A_BAR, MOST_TRIED = 48, 80, 50
"""Positions between any two of which a sweep is offered, of a bar with its two variables more, and how many times as many are
tried for them."""
EXACT = 6
"""Changes of a way that are computed, of all that are ranked."""
LEAST_GAIN = 1e-6
AT_ONCE = 64
"""Random sweeps that are computed before the first of them is needed."""
SHAKES, MOST_LEFT_OUT = 60, 6
"""How often part of the best way is left out, and how many of its positions at most."""
FIRST_STEP, HALVINGS = 8, 4
"""By which part of its range a stop is first moved off its position, and how many steps there are, each half the last."""
WORTH = 5e-3
"""By how much ψ falls in a round of steps that is followed by another of the same size."""
DIGITS = 2
"""Angles are rounded to 0.01°."""


@dataclass(frozen=True)
class Grid:
    """Positions (n, variables), degree, with the information (n, n, k, k) and the seconds (n, n) of the sweeps between them,
    infinite where there is none; `ends` (n,) where the instrument can be mounted."""

    positions: Array
    matrices: Array
    seconds: Array
    ends: Flags

    def without(self, sweeps: Sequence[tuple[int, int]]) -> None:
        """Some sweeps, and their reverses, are no longer offered."""
        for a, b in sweeps:
            self.seconds[a, b] = self.seconds[b, a] = math.inf


def positions_of(sweeps: Sweeps) -> Array:
    """Random positions (n, variables), degree, inside all limits."""
    generator, found = np.random.default_rng(0), np.zeros((0, len(sweeps.low)))
    count = OF_A_BAR if sweeps.bar else POSITIONS
    for _ in range(MOST_TRIED):
        drawn = np.round(generator.uniform(sweeps.low, sweeps.high, (count, len(sweeps.low))), DIGITS)
        found = np.concatenate([found, drawn[sweeps.reachable(drawn)]])[:count]
    return found


def draw(sweeps: Sweeps, count: int, speed: float) -> Iterator[Sweep]:
    """Sweeps between `count` pairs of random positions, of which a variable turns or stays by chance, where they are possible."""
    generator, pairs = np.random.default_rng(0), []
    for _ in range(count):
        start, there = np.round(generator.uniform(sweeps.low, sweeps.high, (2, len(sweeps.low))), DIGITS)
        pairs.append((start, np.where(generator.random(len(start)) < 0.5, start, there)))
    ends = np.array(pairs)
    possible = ends[sweeps.reachable(ends[:, 0]) & sweeps.reachable(ends[:, 1])] if count else ends
    for first in range(0, len(possible), AT_ONCE):
        some = [(start, there) for start, there in possible[first : first + AT_ONCE]]
        yield from (found for found in sweeps.all_between(some, speed) if found is not None)


def grid_of(sweeps: Sweeps, positions: Array, ends: Flags, speed: float) -> Grid:
    """All sweeps between positions of a grid."""
    n, k = len(positions), len(sweeps.start)
    matrices, seconds = np.zeros((n, n, k, k)), np.full((n, n), math.inf)
    pairs = list(itertools.permutations(range(n), 2))
    offered = sweeps.all_between([(positions[a], positions[b]) for a, b in pairs], speed)
    for (a, b), found in zip(pairs, offered, strict=True):
        if found is not None:
            matrices[a, b], seconds[a, b] = found.matrix, found.seconds
    return Grid(positions, matrices, seconds, ends)


class _Way:
    """A way through positions of a grid, and what changing it does."""

    def __init__(self, grid: Grid, goal: Goal, way: Sequence[int]) -> None:
        self.grid, self.goal, self.way = grid, goal, list(way)
        pairs = list(itertools.pairwise(self.way))
        self.seconds = float(sum(grid.seconds[pair] for pair in pairs))
        self.total = np.sum([grid.matrices[pair] for pair in pairs], axis=0)

    @property
    def value(self) -> float:
        """ψ of the recording."""
        return self.goal.psi(self.total)

    def rate(self, seconds: float) -> float:
        """ψ if the recording were repeated for so many seconds."""
        return self.goal.psi(self.total * (seconds / self.seconds))

    def changed(self, change: int) -> _Way:
        """The way after a change, by its number."""
        size = len(self.grid.positions) + 1
        place, kind = divmod(change, 2 * size)
        wide, position = divmod(kind, size)
        between = [position] if position < size - 1 else []
        return _Way(self.grid, self.goal, [*self.way[:place], *between, *self.way[place + wide :]])

    def changes(self, pull: Array, room: float, *, grow: bool) -> tuple[Array, Array, Indices]:
        """First-order gain, seconds and number of every change that takes at most `room` seconds (m,): a position put in anywhere
        and, unless the way has only to `grow`, put in the place of another or left out."""
        tables = [np.pad(table, (0, 1)) for table in (np.tensordot(self.grid.matrices, pull, 2), self.grid.seconds)]
        size = len(tables[0])
        won, cost = np.zeros((2, len(self.way) + 1, 2, size))
        cost[:] = math.inf
        for wide in (0,) if grow else (0, 1):
            places = slice(len(self.way) + 1 - wide)
            won[places, wide], cost[places, wide] = self._between(tables, wide)
        fits = np.flatnonzero(cost <= min(room, sys.float_info.max))
        return won.ravel()[fits], cost.ravel()[fits], fits

    def _between(self, tables: Sequence[Array], wide: int) -> tuple[Array, Array]:
        """What it gains and takes to put each position, or none (last column), between two neighbours of the way or, if `wide`,
        in the place of the one between them; infinite seconds where that is not possible. The last position of the `tables` is
        beside the way: from it and to it nothing is gained and takes no time."""
        n = len(self.grid.positions)
        way = np.array([n, *self.way, n])
        before, after = way[: len(way) - 1 - wide], way[1 + wide :]
        ends, inner = np.append(self.grid.ends, False), (before < n) & (after < n)
        left_out = (before != after) & (inner | ends[before] | ends[after]) & (wide == 1) & (len(self.way) > 2)
        possible = np.concatenate([self.grid.ends | inner[:, None], left_out[:, None]], axis=1)
        won, cost = (
            np.concatenate([table[before, :n] + table[:n, after].T, table[before, after][:, None]], axis=1)
            - (table[before, way[1:-1]] + table[way[1:-1], after] if wide else table[before, after])[:, None]
            for table in tables
        )
        return won, np.where(possible, cost, math.inf)


def best_way(grid: Grid, goal: Goal, seconds: float, start: Sequence[int] = ()) -> list[int]:
    """Numbers of the positions of the most informative way found in at most so many seconds: parts of the best one are left out
    at random and grown anew (iterated local search, H. R. Lourenço et al. 2003)."""
    generator = np.random.default_rng(0)
    best = _exchanged(_grown(_Way(grid, goal, start or _first(grid, goal, seconds)), seconds), seconds)
    for _ in range(SHAKES):
        size = int(generator.integers(1, MOST_LEFT_OUT + 1))
        place = int(generator.integers(0, max(len(best.way) - size, 0) + 1))
        left = [*best.way[:place], *best.way[place + size :]]
        joined = all(math.isfinite(grid.seconds[pair]) for pair in itertools.pairwise(left))
        if len(left) < 2 or not (joined and grid.ends[left[0]] and grid.ends[left[-1]]):
            continue
        other = _exchanged(_grown(_Way(grid, goal, left), seconds), seconds)
        if other.value < best.value - LEAST_GAIN:
            best = other
    return best.way


def _grown(way: _Way, seconds: float) -> _Way:
    """Positions put in until no more fits into the time."""
    while True:
        pull = way.goal.pull(way.total * (seconds / way.seconds))
        mean = float(np.sum(pull * way.total)) / way.seconds
        won, cost, changes = way.changes(pull, seconds - way.seconds, grow=True)
        tried = [way.changed(change) for change in _first_of(changes, cost * mean - won)]
        if not tried:
            return way
        way = min(tried, key=lambda other: other.rate(seconds))


def _exchanged(way: _Way, seconds: float) -> _Way:
    """Positions exchanged, put in and left out until ψ falls no more."""
    while True:
        now, pull = way, way.goal.pull(way.total)
        won, _, changes = now.changes(pull, seconds - now.seconds, grow=False)
        way = min([now, *map(now.changed, _first_of(changes, -won))], key=lambda other: other.value)
        if way.value > now.value - LEAST_GAIN:
            return now


def _first_of(changes: Indices, key: Array) -> list[int]:
    """The changes that are computed: those of the lowest key."""
    found: list[int] = changes[np.argsort(key, kind="stable")[:EXACT]].tolist()
    return found


def _first(grid: Grid, goal: Goal, seconds: float) -> Sequence[int]:
    """The most informative sweep per second between two positions at which the instrument can be mounted."""
    fits = np.isfinite(grid.seconds) & (grid.seconds <= seconds) & grid.ends[:, None] & grid.ends[None, :]
    ways = [_Way(grid, goal, pair) for pair in np.argwhere(fits).tolist()]
    return min(ways, key=lambda way: way.rate(seconds)).way


def refined_way(sweeps: Sweeps, goal: Goal, stops: Sequence[Array], speed: float, seconds: float) -> list[Array]:
    """The stops, but for the two ends, moved off their positions where that lowers ψ within so many seconds: of all moves of one
    variable of one stop by a step, those that gain most and share no sweep."""
    way = list(stops)
    parts = [_known(sweeps, pair, speed) for pair in itertools.pairwise(way)]
    total, used = np.sum([p.matrix for p in parts], axis=0), sum(p.seconds for p in parts)
    value, step, halved = goal.psi(total), (sweeps.high - sweeps.low) / FIRST_STEP, 0
    while halved < HALVINGS:
        before, pull, changed = value, goal.pull(total), set[int]()
        moves = _moves(sweeps, way, step * 0.5**halved, speed)
        moves.sort(
            key=lambda move: -sum(float(np.sum(pull * (p.matrix - q.matrix))) for p, q in _exchange(parts, move))
        )
        for move in moves:
            i, moved, new = move
            if not changed.isdisjoint((i - 1, i)):
                continue
            pairs = _exchange(parts, move)
            then = total + sum(p.matrix - q.matrix for p, q in pairs)
            time = used + sum(p.seconds - q.seconds for p, q in pairs)
            if time <= seconds and (psi := goal.psi(then)) < value - LEAST_GAIN:
                way[i], parts[i - 1 : i + 1], total, used, value = moved, new, then, time, psi
                changed |= {i - 1, i}
        halved += value > before - WORTH
    return way


_Move = tuple[int, Array, list[Sweep]]


def _moves(sweeps: Sweeps, way: Sequence[Array], step: Array, speed: float) -> list[_Move]:
    """Number and new position of a stop, and the sweeps to it and from it, where both are possible."""
    signs = [sign * axis for axis in np.eye(len(step)) for sign in (1.0, -1.0)]
    moved = [(i, np.round(way[i] + sign * step, DIGITS)) for i in range(1, len(way) - 1) for sign in signs]
    pairs = [pair for i, stop in moved for pair in ((way[i - 1], stop), (stop, way[i + 1]))]
    fresh = sweeps.all_between(pairs, speed)
    found = ((i, stop, [to, on]) for (i, stop), to, on in zip(moved, fresh[::2], fresh[1::2], strict=True))
    return [(i, stop, [p for p in new if p]) for i, stop, new in found if all(new)]


def _exchange(parts: Sequence[Sweep], move: _Move) -> list[tuple[Sweep, Sweep]]:
    """The sweeps of a move with those in whose place they come."""
    i, _, new = move
    return list(zip(new, parts[i - 1 : i + 1], strict=True))


def _known(sweeps: Sweeps, pair: tuple[Array, Array], speed: float) -> Sweep:
    found = sweeps.between(*pair, speed)
    assert found is not None  # it is of the grid
    return found
