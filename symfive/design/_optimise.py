"""From a task to a design: set-ups, candidates, exchange, refinement, many starts."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from symfive.design._candidates import PER_SETUP, best_setups, candidates_in, pose_grid, setup_options
from symfive.design._exchange import Candidates, choose, exchange
from symfive.design._information import Task
from symfive.design._refine import Rows, refine
from symfive.design._space import UNIT_MM, Space

__all__ = ["optimise", "rounded", "value_of"]

Array = NDArray[np.float64]
LARGEST_REFINED = 80
"""Poses up to which the continuous refinement runs; beyond, candidates on a fine grid are as good to 1e-3."""
ANGLE_DEG, PLACE_MM = 0.01, 1.0


def value_of(space: Space, task: Task, rows: Rows) -> float:
    """ψ of a design."""
    return task.value(task.information(space.kernel.rows(rows.z, rows.k), rows.group, rows.groups))


def optimise(
    space: Space, task: Task, points: int, setups: int, *, starts: int = 6, seed: int = 0,
    progress: Callable[[str], None] = lambda message: None,
) -> tuple[Rows, tuple[float, ...]]:  # fmt: skip
    """The best design found and ψ of every start. Start 0 uses the most telling set-ups, the others a random part of them."""
    generator = np.random.default_rng(seed)
    options = len(setup_options(space)[0])
    best: Rows | None = None
    values: list[float] = []
    for start in range(starts):
        poses = pose_grid(space, PER_SETUP, seed + start)
        among = None if start == 0 else generator.choice(options, max(setups + 1, options * 2 // 3), replace=False)
        places, lengths = best_setups(space, task, setups, points, poses[:: max(1, len(poses) // 100)], among)
        candidates = candidates_in(space, places, lengths, poses)
        chosen = choose(task, candidates, len(places), points)
        picked = candidates.take(chosen)
        rows = Rows.of(picked.z, picked.k, picked.group, space.poses)
        value = value_of(space, task, rows)
        if points <= LARGEST_REFINED:
            rows, value = _refined(space, task, rows, value)
        if not values or value < min(values):
            best = rows
        values.append(value)
        progress(f"start {start + 1} of {starts}: ψ = {value:.5f}, best {min(values):.5f}")
    assert best is not None
    return best, tuple(values)


def _refined(space: Space, task: Task, rows: Rows, value: float) -> tuple[Rows, float]:
    """Refinement, then exchange within the refined set-ups on a fine grid, then refinement again."""
    for _ in range(2):
        finer, reached = refine(task, space.kernel, rows, space.lower, space.upper)
        if reached >= value or not space.feasible(finer.z, finer.k).all():
            break
        gained, rows, value = value - reached, finer, reached
        if gained < 1e-4:
            break
        rows, value = _exchanged(space, task, rows, value)
    return rows, value


def _exchanged(space: Space, task: Task, rows: Rows, value: float) -> tuple[Rows, float]:
    setups = np.stack([rows.z[rows.group == g][0, rows.poses :] for g in range(rows.groups)])
    lengths = np.stack([rows.k[rows.group == g][0] for g in range(rows.groups)])
    grid = candidates_in(space, setups, lengths, pose_grid(space, PER_SETUP, len(rows.z)))
    n = len(rows.z)
    own = Candidates(rows.z, rows.k, rows.group, space.kernel.rows(rows.z, rows.k))
    both = Candidates(*(np.concatenate([getattr(own, f), getattr(grid, f)]) for f in ("z", "k", "group", "rows")))
    chosen = exchange(task, both, rows.groups, np.arange(n), passes=3)
    picked = both.take(chosen)
    moved = Rows.of(picked.z, picked.k, picked.group, rows.poses)
    reached = value_of(space, task, moved)
    return (moved, reached) if reached < value else (rows, value)


def rounded(space: Space, rows: Rows) -> Rows:
    """Angles to 0.01°, balls and tool to 1 mm, as a person can set them; a row that this makes infeasible keeps its own."""
    z = rows.z.copy()
    z[:, : rows.poses] = np.radians(np.round(np.degrees(z[:, : rows.poses]) / ANGLE_DEG) * ANGLE_DEG)
    for g in range(rows.groups):
        mine = np.flatnonzero(rows.group == g)
        x, y, height = (round(v / PLACE_MM) * PLACE_MM / UNIT_MM for v in space.table_ball(z[mine[0]]))
        tool = round(z[mine[0], rows.poses + 3] * UNIT_MM / PLACE_MM) * PLACE_MM / UNIT_MM
        polar = [min(np.hypot(x, y), space.upper[rows.poses]), np.arctan2(y, x), height, tool]
        z[mine, rows.poses :] = np.clip(polar, space.lower[rows.poses :], space.upper[rows.poses :])
    z = np.clip(z, space.lower, space.upper)
    return Rows(z, rows.k, rows.group, rows.groups, rows.poses) if space.feasible(z, rows.k).all() else rows
