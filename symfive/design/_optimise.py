"""From a task to a design: set-ups, candidates, exchange, refinement, many starts."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from symfive.design._candidates import PER_SETUP, best_setups, candidates_in, pose_grid, setup_options
from symfive.design._certificate import generate
from symfive.design._exchange import Candidates, choose, exchange, greedy
from symfive.design._information import Task
from symfive.design._refine import Rows, refine
from symfive.design._space import UNIT_MM, Space

__all__ = ["optimise", "rounded", "value_of"]

Array = NDArray[np.float64]
LARGEST_REFINED = 80
"""Poses up to which the continuous refinement runs; beyond, whole numbers of the relaxed design's poses are as good."""
SHARES, STEPS = (1.0, 0.5, 0.3), (12, 30, 150)
"""Successive halving: this share of the starts, at least one, is refined by so many steps."""
FIRST_PASSES = 3
ROUNDINGS, FEW_ROUNDS, LOOSE, WORTH = 2, 5, 1e-2, 5e-3
"""Rounding of the relaxed design: how often, its column generation, and the gain in ψ for which to go on."""
PART = 0.6
"""Share of the corners and poses that a random start sees."""
COARSE = 100
"""Poses by which set-ups are compared."""
ANGLE_DEG, PLACE_MM = 0.01, 1.0


def value_of(space: Space, task: Task, rows: Rows) -> float:
    """ψ of a design."""
    return task.value(task.information(space.kernel.rows(rows.z, rows.k), rows.group, rows.groups))


def optimise(
    space: Space, task: Task, points: int, setups: int, *, starts: int = 6, seed: int = 0,
    progress: Callable[[str], None] = lambda message: None,
) -> tuple[Rows, tuple[float, ...]]:  # fmt: skip
    """The best design found and ψ of every start.

    Start 0 uses the most telling set-ups and every pose of the grid, the others random parts of both. Successive halving: all
    starts are refined a little, the better half of them further, and the best one until it stands still. Then whole numbers of
    the poses that the relaxed design in its set-ups uses compete with it. Of a large plan only a smaller one is refined; its
    set-ups and the relaxed design in them give the large one.
    """
    small = min(points, LARGEST_REFINED)
    generator = np.random.default_rng(seed)
    running: dict[int, Rows] = {}
    feasible: list[tuple[float, Rows]] = []
    for start in range(starts):
        running[start] = _started(space, task, small, setups, seed + start, generator if start else None)
        feasible.append((value_of(space, task, running[start]), running[start]))
    values = [value for value, _ in feasible]
    for share, steps in zip(SHARES, STEPS, strict=True):
        better = sorted(running, key=lambda s: values[s])[: max(1, math.ceil(share * starts))]
        for start in better:
            running[start], values[start] = _refined(space, task, running[start], steps, feasible)
        running = {start: running[start] for start in better}
        progress(
            f"{len(running)} of {starts} starts refined by {steps} steps: ψ = {min(values[s] for s in better):.5f}"
        )
    if points > small:
        many = _many(space, task, _best(feasible), points)
        return many, (value_of(space, task, many),)
    for _ in range(ROUNDINGS):
        before = _best(feasible)
        _rounded_relaxed(space, task, before, feasible)
        gained = value_of(space, task, before) - value_of(space, task, _best(feasible))
        progress(f"relaxed design rounded: ψ = {value_of(space, task, _best(feasible)):.5f}")
        if gained < WORTH:
            break
    return _best(feasible), tuple(values)


def _best(feasible: list[tuple[float, Rows]]) -> Rows:
    return min(feasible, key=lambda found: found[0])[1]


def _rounded_relaxed(space: Space, task: Task, rows: Rows, feasible: list[tuple[float, Rows]]) -> None:
    """Whole numbers of the poses that the relaxed design in the same set-ups uses, refined; and the design itself, further."""
    both = _joined(_own(space, rows), generate(space, task, rows, LOOSE, FEW_ROUNDS).support)
    n = len(rows.z)
    for first in (np.arange(n), greedy(task, both, rows.groups, n, -(-n // rows.groups))):
        picked = both.take(exchange(task, both, rows.groups, first))
        start = Rows.of(picked.z, picked.k, picked.group, rows.poses)
        feasible.append((value_of(space, task, start), start))
        _refined(space, task, start, STEPS[-1], feasible)


def _many(space: Space, task: Task, rows: Rows, points: int) -> Rows:
    """A larger design in the set-ups of `rows`: whole numbers of the poses that the relaxed design of `points` poses uses."""
    both = _joined(_own(space, rows), generate(space, task, rows, LOOSE, FEW_ROUNDS, points=points).support)
    picked = both.take(choose(task, both, rows.groups, points))
    return Rows.of(picked.z, picked.k, picked.group, rows.poses)


def _own(space: Space, rows: Rows) -> Candidates:
    return Candidates(rows.z, rows.k, rows.group, space.kernel.rows(rows.z, rows.k))


def _joined(a: Candidates, b: Candidates) -> Candidates:
    return Candidates(*(np.concatenate([getattr(a, n), getattr(b, n)]) for n in ("z", "k", "group", "rows")))


def _started(
    space: Space, task: Task, points: int, setups: int, seed: int, generator: np.random.Generator | None
) -> Rows:
    """The best set-ups of some corners of the workspace, and by exchange the best poses of the grid in them."""
    options = len(setup_options(space)[0])
    poses, among = pose_grid(space, PER_SETUP, seed), None
    if generator is not None:
        among = generator.choice(options, max(setups + 1, round(PART * options)), replace=False)
        poses = poses[np.sort(generator.choice(len(poses), max(1, round(PART * len(poses))), replace=False))]
    places, lengths = best_setups(space, task, setups, points, poses[:: max(1, len(poses) // COARSE)], among)
    candidates = candidates_in(space, places, lengths, poses)
    picked = candidates.take(choose(task, candidates, len(places), points, FIRST_PASSES))
    return Rows.of(picked.z, picked.k, picked.group, space.poses)


def _refined(
    space: Space, task: Task, rows: Rows, steps: int, feasible: list[tuple[float, Rows]]
) -> tuple[Rows, float]:
    """Some steps of refinement, then exchange within the set-ups on a fine grid; what keeps all limits joins `feasible`."""
    finer, value = refine(task, space.kernel, rows, space.lower, space.upper, max_iter=steps)
    if not space.feasible(finer.z, finer.k).all():
        return finer, value
    finer, value = _exchanged(space, task, finer, value)
    feasible.append((value, finer))
    return finer, value


def _exchanged(space: Space, task: Task, rows: Rows, value: float) -> tuple[Rows, float]:
    setups = np.stack([rows.z[rows.group == g][0, rows.poses :] for g in range(rows.groups)])
    lengths = np.stack([rows.k[rows.group == g][0] for g in range(rows.groups)])
    grid = candidates_in(space, setups, lengths, pose_grid(space, PER_SETUP, len(rows.z)))
    n = len(rows.z)
    both = _joined(_own(space, rows), grid)
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
