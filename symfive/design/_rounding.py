"""A design as a person can set it: angles to 0.01°, balls and tool to 1 mm, and one tool for all runs where that costs little.

What lies at a limit (edge of the table, end of a travel) is rounded towards the inside: of the grid's places near the wanted
one the nearest is taken at which every pose can be reached.
"""

from __future__ import annotations

import itertools
from dataclasses import replace

import numpy as np

from symfive.arrays import Array, Flags
from symfive.design._candidates import value_of
from symfive.design._pose import UNIT_MM
from symfive.design._space import Space
from symfive.optimal import Rows, Task

ANGLE, PLACE = np.radians(0.01), 1.0 / UNIT_MM
"""The grid: rad, and 1 mm in the units of a design."""
RINGS = (1, 10, 100)
"""By how many steps of the angles' grid a pose is moved, ring after ring, until it can be reached."""
NEAREST = 24
"""Places of the grid that are tried for a set-up."""
EPS = 1e-6
ONE_TOOL_COSTS = 0.01
"""ψ that one tool for all runs may cost."""


def rounded(space: Space, rows: Rows) -> Rows:
    """Angles to 0.01°, balls and tool to 1 mm; a set-up or pose that no place of the grid suits keeps its own values."""
    z = rows.z.copy()
    for g in range(rows.groups):
        mine = np.flatnonzero(rows.group == g)
        for setup in (*_setups_near(space, z[mine[0]]), z[mine[0], space.poses :]):
            there, fits = _poses_in(space, z[mine], rows.k[mine], setup)
            if fits.all():
                break
        z[mine] = there
    return replace(rows, z=z)


def _setups_near(space: Space, z: Array) -> list[Array]:
    """Set-ups (4,) on the grid around that of a row, inside the workspace, the nearest first."""
    low, high = space.lower[space.poses :], space.upper[space.poses :]
    x, y, height = (v / UNIT_MM for v in space.table_ball(z))
    wanted = np.array([x, y, height, z[space.poses + 3]])
    levels = [
        _levels(v, a, b)
        for v, a, b in zip(wanted, (-np.inf, -np.inf, *low[2:]), (np.inf, np.inf, *high[2:]), strict=True)
    ]
    places = sorted(itertools.product(*levels), key=lambda place: float(np.linalg.norm(np.array(place) - wanted)))
    polar = [(*space.polar(UNIT_MM * p[0], UNIT_MM * p[1]), p[2], p[3]) for p in places]
    return [np.array([min(p[0], high[0]), *p[1:]]) for p in polar if p[0] <= high[0] + 1e-9][:NEAREST]


def _levels(value: float, low: float, high: float) -> list[float]:
    """The grid's levels next to a value within its limits; the value itself where these leave no level."""
    near = np.round(value / PLACE) + np.arange(-2, 3)
    inside = near[(near * PLACE >= low - 1e-9) & (near * PLACE <= high + 1e-9)]
    return [float(n * PLACE) for n in inside[np.argsort(np.abs(inside * PLACE - value))][:3]] or [value]


def _poses_in(space: Space, z: Array, k: Array, setup: Array) -> tuple[Array, Flags]:
    """The rows with their poses rounded in a set-up, and which of them can be reached there; the others keep their pose."""
    poses = space.poses
    own = z.copy()
    own[:, poses:] = setup
    found, fits = own.copy(), np.zeros(len(z), dtype=bool)
    for ring in (0, *RINGS):
        left = np.flatnonzero(~fits)
        if not left.size:
            break
        steps = sorted(itertools.product((0, ring, -ring), repeat=poses), key=np.count_nonzero)
        chosen = np.array(steps[1:] if ring else steps[:1])
        trial = np.repeat(own[left], len(chosen), axis=0)
        trial[:, :poses] = on_grid(space, trial[:, :poses], np.tile(chosen, (len(left), 1)))
        good = space.feasible(trial, np.repeat(k[left], len(chosen), axis=0)).reshape(len(left), -1)
        some = np.flatnonzero(good.any(axis=1))
        first = np.argmax(good[some], axis=1)
        found[left[some]] = trial.reshape(len(left), len(chosen), -1)[some, first]
        fits[left[some]] = True
    return found, fits


def on_grid(space: Space, angles: Array, step: Array | int = 0) -> Array:
    """Angles (n, poses) on the grid, moved by some steps, within their limits; those whose limits hold no level stay."""
    low = np.ceil(space.lower[: space.poses] / ANGLE - EPS)
    high = np.floor(space.upper[: space.poses] / ANGLE + EPS)
    levels = np.clip(np.round(angles / ANGLE) + step, low, high)
    whole = np.clip(np.radians(np.round(0.01 * levels, 2)), space.lower[: space.poses], space.upper[: space.poses])
    return np.where(low <= high, whole, angles)


def one_tool(space: Space, task: Task, rows: Rows) -> Rows:
    """The same tool length in all runs, one of those that the design has, if that raises ψ by at most `ONE_TOOL_COSTS`."""
    lengths = np.unique(np.round(rows.z[:, -1], 9))
    best, limit = rows, value_of(space, task, rows) + ONE_TOOL_COSTS
    for length in lengths if len(lengths) > 1 else ():
        z = rows.z.copy()
        z[:, -1] = length
        trial = rounded(space, replace(rows, z=z))
        if np.ptp(trial.z[:, -1]) < EPS and space.feasible(trial.z, trial.k).all():
            value = value_of(space, task, trial)
            if value <= limit:
                best, limit = trial, value
    return best


def not_rounded(space: Space, rows: Rows) -> tuple[tuple[int, ...], int]:
    """Which set-ups (numbers from 1) and how many poses are not on the grid although their limits hold levels of it."""
    setups = []
    for g in range(rows.groups):
        z = rows.z[rows.group == g][0]
        x, y, height = (v / UNIT_MM for v in space.table_ball(z))
        wanted = (x, y, height, z[-1])
        low, high = (-np.inf, -np.inf, *space.lower[-2:]), (np.inf, np.inf, *space.upper[-2:])
        near = [_levels(*values)[0] for values in zip(wanted, low, high, strict=True)]
        if np.abs(np.array(near) - wanted).max() > EPS:
            setups.append(g + 1)
    angles = rows.z[:, : rows.poses]
    off = np.abs(on_grid(space, angles) - angles) > EPS * ANGLE * 100.0
    return tuple(setups), int(off.any(axis=1).sum())
