"""The command in rows that the recorder lost: the programme went on meanwhile, smoothly or round a corner."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from symfive.arrays import Array, Flags, Indices

if TYPE_CHECKING:
    from symfive.runs import Run

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


def filled(steps: Indices, command: Array) -> Array:
    """The command at all rows 0…steps[-1], of which `command` (N,) has those at `steps`.

    Each gap is filled from the rows about it, as far as the next corners: by a cubic spline, or, where the two sides do not
    continue each other, by each side's own course as far as their crossing. An axis that comes to rest does not overshoot.
    """
    rows = np.arange(int(steps[-1]) + 1)
    full = np.interp(rows, steps, command)
    if np.ptp(command) == 0.0:
        return full
    x, y = steps.astype(float), command
    speed = np.diff(command) / np.diff(steps)
    bend = CORNER * float(np.abs(speed).max())
    corner = np.abs(np.diff(speed)) > bend
    for i in np.flatnonzero(np.diff(steps) > 1):
        missing = rows[steps[i] + 1 : steps[i + 1]]
        before, after = _side(corner, int(i), -1), _side(corner, int(i) + 1, 1)
        if len(before) < 2 or len(after) < 2:
            continue
        forward, back = (np.polynomial.Polynomial.fit(x[s], y[s], min(len(s) - 1, 2)) for s in (before, after))
        # what each side's course misses of the other's first row: an acceleration misses nothing
        missed = forward(x[i + 1]) - y[i + 1], back(x[i]) - y[i]
        if min(np.abs(missed)) > 0.5 * bend:
            turn = _crossing(x, y, int(i))
            full[missing] = np.where(missing < turn, forward(missing), back(missing))
        else:
            from scipy.interpolate import CubicSpline

            near = np.concatenate([before, after])
            full[missing] = CubicSpline(x[near], y[near])(missing)
        if speed[after[0]] == 0.0 or speed[before[-2]] == 0.0:  # towards rest nothing overshoots
            full[missing] = np.clip(full[missing], *sorted((y[i], y[i + 1])))
    return full


def _side(corner: Flags, edge: int, way: int) -> Indices:
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


def _crossing(x: Array, y: Array, i: int) -> float:
    """Where the last directions on both sides of the gap behind row i cross, within the gap."""
    before, after = ((y[k + 1] - y[k]) / (x[k + 1] - x[k]) for k in (i - 1, i + 1))
    if before == after:
        return float(0.5 * (x[i] + x[i + 1]))
    crossing = x[i] + (y[i + 1] - y[i] - after * (x[i + 1] - x[i])) / (before - after)
    return float(np.clip(crossing, x[i], x[i + 1]))
