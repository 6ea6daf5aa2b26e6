"""How long a path takes: no axis faster than a share of its greatest feed and acceleration, along the path itself."""

from __future__ import annotations

import math

import numpy as np

from symfive.arrays import Array
from symfive.machine import Axis, Machine

CAUTION = 0.5
"""Share of an axis' greatest feed and acceleration that a program asks for."""


LINEAR, ROTARY = (5000.0, 500.0), (1800.0, 100.0)
"""Greatest feed (mm/min, degree/min) and acceleration (mm/s², degree/s²) of an axis of which the machine file says none: what any
machine tool does. Without a limit its blocks would be as fast as the control can, the ball in its nest."""


def able(axis: Axis) -> tuple[float, float]:
    """Greatest speed and acceleration of an axis, mm or degree per s and s²."""
    feed, push = ROTARY if axis.rotary else LINEAR
    return (axis.max_feed or feed) / 60.0, axis.max_acceleration or push


def pace(machine: Machine, path: Array, share: float = CAUTION) -> tuple[float, float]:
    """Seconds of the blocks, and seconds more for getting up to speed and to rest again.

    `path` (n + 1, axes), mm and degree, the ends of n straight blocks that take the same time T each. With the change Δ of an
    axis in a block, T is the least with |Δ| ≤ T v and |Δ' - Δ| ≤ T² a, and not less than what makes the whole shortest from rest
    to rest: n T + |Δ|/(T a) has its minimum at T = √(|Δ|/(n a)), for one straight move the triangle of 2 √(way/a). v and a are
    a `share` of the axes' limits (1: a rapid, which the control drives as fast as they can).
    """
    blocks = len(path) - 1
    steps = np.abs(np.diff(path, axis=0)).max(axis=0, initial=0.0)
    turns = np.abs(np.diff(path, n=2, axis=0)).max(axis=0, initial=0.0) if blocks > 1 else np.zeros_like(steps)
    least, limits = 0.0, []
    for name, step, turn in zip(machine.axis_names, steps.tolist(), turns.tolist(), strict=True):
        speed, push = (share * most for most in able(machine.axes[name]))
        limits.append((step, push))
        least = max(least, step / speed, math.sqrt(turn / push), math.sqrt(step / push / blocks))
    if least == 0.0:
        return 0.0, 0.0
    return blocks * least, max(step / least / push for step, push in limits)


def spread(least: float, more: float, seconds: float) -> tuple[float, float]:
    """A pace (`pace`) made slower to take `seconds` in all, where that is longer: seconds of the blocks, and seconds more for
    getting up to speed and to rest again.

    The slower the blocks, the sooner they are up to speed: blocks of s seconds in all need `more` · `least`/s more.
    """
    if least == 0.0 or seconds <= least + more:
        return least, more
    whole = 0.5 * (seconds + math.sqrt(seconds**2 - 4.0 * more * least))
    return whole, more * least / whole


def tenths(seconds: float) -> float:
    """Whole tenths of a second, rounded down, not below 0."""
    return max(0.0, math.floor(10.0 * seconds + 1e-6) / 10.0)
