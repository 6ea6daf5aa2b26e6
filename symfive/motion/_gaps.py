"""The command in rows that the recorder lost: the programme went on meanwhile, smoothly or round a corner."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline

if TYPE_CHECKING:
    from symfive.campaign import Run

__all__ = ["filled", "programme_of"]

Array = NDArray[np.float64]
SIDE = 4
"""Rows of each side that say how the programme went on."""
CORNER = 0.2
"""A change of speed from row to row by this share of the highest speed is a corner: a circle in 1000 rows has 0.006."""


def programme_of(run: Run) -> Run:
    """What was commanded in a recording, without readings and with the rows that the recorder lost."""
    bare = run.with_readings({})
    if not run.dynamic or len(run.steps) == run.steps[-1] + 1:
        return bare
    time = run.time[0] + run.interval * np.arange(run.steps[-1] + 1)
    return replace(bare, time=time, commands={name: filled(run.steps, way) for name, way in run.commands.items()})


def filled(steps: NDArray[np.int64], command: Array) -> Array:
    """The command at all rows 0…steps[-1], of which `command` (N,) has those at `steps`.

    Each gap is filled from the rows about it, as far as the next corners: by a cubic spline, or, where the two sides do not
    continue each other, by each side's own course as far as their crossing. An axis that comes to rest does not overshoot.
    """
    rows = np.arange(int(steps[-1]) + 1)
    full = np.interp(rows, steps, command)
    if np.ptp(command) == 0.0:
        return full
    speed = np.diff(command) / np.diff(steps)
    corner = np.abs(np.diff(speed)) > CORNER * float(np.abs(speed).max())
    for i in np.flatnonzero(np.diff(steps) > 1):
        missing = rows[steps[i] + 1 : steps[i + 1]]
        before, after = _side(corner, int(i), -1), _side(corner, int(i) + 1, 1)
        x, y = steps.astype(float), command
        if len(before) < 2 or len(after) < 2:
            continue
        if _apart(x, y, before, after) > 0.5 * CORNER * float(np.abs(speed).max()):
            full[missing] = _round(x, y, before, after, missing)
        else:
            near = np.concatenate([before, after])
            full[missing] = CubicSpline(x[near], y[near])(missing)
        if speed[after[0]] == 0.0 or speed[before[-2]] == 0.0:  # towards rest nothing overshoots
            full[missing] = np.clip(full[missing], *sorted((y[i], y[i + 1])))
    return full


def _side(corner: NDArray[np.bool_], edge: int, way: int) -> NDArray[np.int64]:
    """Rows on one side of a gap whose edge is row `edge`, in order, as far as the next corner."""
    found = [edge]
    while len(found) < SIDE:
        row = found[-1]
        if not 0 <= row + way <= len(corner) + 1:
            break
        if len(found) > 1 and corner[row - 1]:
            break
        found.append(row + way)
    return np.array(sorted(found))


def _apart(x: Array, y: Array, before: NDArray[np.int64], after: NDArray[np.int64]) -> float:
    """By how much each side's course misses the other's first row, the lesser of both; an acceleration misses by nothing."""
    missed = [
        np.polynomial.Polynomial.fit(x[side], y[side], min(len(side) - 1, 2))(x[other]) - y[other]
        for side, other in ((before, after[0]), (after, before[-1]))
    ]
    return float(np.min(np.abs(missed)))


def _round(
    x: Array, y: Array, before: NDArray[np.int64], after: NDArray[np.int64], missing: NDArray[np.int64]
) -> Array:
    """Both sides' courses as far as the crossing of their last directions."""
    b, a = before[-1], after[0]
    slope_b = (y[b] - y[b - 1]) / (x[b] - x[b - 1])
    slope_a = (y[a + 1] - y[a]) / (x[a + 1] - x[a])
    crossing = 0.5 * (x[b] + x[a])
    if slope_a != slope_b:
        crossing = x[b] + (y[a] - y[b] - slope_a * (x[a] - x[b])) / (slope_b - slope_a)
    courses = [np.polynomial.Polynomial.fit(x[s], y[s], min(len(s) - 1, 2))(missing) for s in (before, after)]
    return np.where(missing < np.clip(crossing, x[b], x[a]), *courses)
