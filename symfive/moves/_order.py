"""Order of the poses: short travel, with drift separable from geometry.

A round trip on the shortest way makes time and pose nearly the same thing, and a slow drift then looks like geometry. The
alternative visits every second pose on the way out and the others on the way back, so that each part of the workspace is
seen early and late. Poses visited again (in the middle and at the end) fix the drift. Which order is taken is decided by the
information left when a linear drift is a nuisance.
"""

from __future__ import annotations

import itertools

import numpy as np

from symfive.arrays import Array, Indices
from symfive.machine import Axis, Machine
from symfive.nc import CAUTION, able


def _axis_time(way: Array, axis: Axis) -> Array:
    """Time from rest to rest, s."""
    speed, push = (CAUTION * most for most in able(axis))
    return np.asarray(np.where(way * push > speed**2, way / speed + speed / push, 2.0 * np.sqrt(way / push)))


def move_times(machine: Machine, commands: dict[str, Array]) -> Array:
    """About the time between any two poses (n, n), s, for the order: the slowest axis', straight from one to the other."""
    times = np.zeros((len(next(iter(commands.values()))),) * 2)
    for name, axis in machine.axes.items():
        times = np.maximum(times, _axis_time(np.abs(commands[name][:, None] - commands[name][None, :]), axis))
    return times


def round_trip(times: Array) -> Indices:
    """A short tour (nearest neighbour, then 2-opt: G. A. Croes 1958) that begins at the pose nearest to all others."""
    n = len(times)
    tour = [int(np.argmin(times.sum(axis=0)))]
    left = set(range(n)) - set(tour)
    while left:
        tour.append(min(left, key=lambda j: times[tour[-1], j]))
        left.remove(tour[-1])
    order = np.array(tour)
    for _ in range(2 * n):
        improved = False
        for i in range(1, n - 1):
            a, b = order[i - 1], order[i]
            ends, after = order[i + 1 :], np.append(order[i + 2 :], -1)
            onward = np.where(after >= 0, times[b, after], 0.0)
            present = np.where(after >= 0, times[ends, after], 0.0)
            gain = times[a, b] + present - times[a, ends] - onward
            j = int(np.argmax(gain))
            if gain[j] > 1e-9:
                order[i : i + j + 2] = order[i : i + j + 2][::-1]
                improved = True
        if not improved:
            break
    return np.asarray(order)


def there_and_back(order: Indices) -> Indices:
    """Every second pose on the way out, the others on the way back."""
    return np.concatenate([order[::2], order[1::2][::-1]])


def out_and_back(order: Indices, returns: int) -> Indices:
    """The order with its first pose visited again `returns` times, evenly spread and the last time at the end."""
    if returns == 0 or len(order) < 3:
        return order
    parts = np.array_split(order, min(returns, len(order) - 1))
    return np.concatenate([np.append(part, order[0]) for part in parts])


def kept_apart(order: Indices, pose: Indices, times: Array) -> Indices:
    """The order in which no pose follows itself, where that can be: visits in its interior move to where they cost least.

    `pose` (n,) numbers the poses, the same for rows that are equal; `times` (n, n) from one row to another.
    """
    found = [int(i) for i in order]
    for _ in range(len(found)):
        twice = [i for i in range(1, len(found)) if pose[found[i]] == pose[found[i - 1]]]
        inner = [j for i in twice for j in (i, i - 1) if 0 < j < len(found) - 1]
        if not inner:
            break
        moved = found[inner[0]]
        rest = found[: inner[0]] + found[inner[0] + 1 :]
        gaps = [
            (times[a, moved] + times[moved, b] - times[a, b], i + 1)
            for i, (a, b) in enumerate(itertools.pairwise(rest))
            if pose[moved] not in (pose[a], pose[b])
        ]
        if not gaps:
            break
        place = min(gaps)[1]
        found = [*rest[:place], moved, *rest[place:]]
    return np.array(found)
