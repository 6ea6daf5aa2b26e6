"""From a task to a design: set-ups, candidates, exchange, refinement, many starts.

The workers of any executor share the starts. What crosses is plain: machine, noise, set-up errors and task as bytes, a few
numbers of the start, the design that comes back. Every process makes the space from it once. So a start gives the same design
wherever it runs.
"""

from __future__ import annotations

import functools
import io
import math
import pickle
from collections.abc import Callable, Sequence
from concurrent.futures import Executor
from types import MappingProxyType
from typing import Any, TypeVar

import numpy as np

from symfive.arrays import Indices
from symfive.design._candidates import (
    PER_SETUP,
    best_setups,
    candidates_in,
    pose_grid,
    rows_of,
    setup_options,
    value_of,
)
from symfive.design._certificate import SUPPORT, generate
from symfive.design._space import Space, make_space
from symfive.executors import Inline, results
from symfive.optimal import Rows, Task, apportioned, choose, exchange, refine
from symfive.threads import one_thread
from symfive.validation import freeze

LARGEST_REFINED = 80
"""Poses up to which the continuous refinement runs; beyond, whole numbers of the relaxed design's poses are nearly as good (96
poses of a ball bar: certified 0.949, refined in twice the time 0.962)."""
SHARES, STEPS = (1.0, 1.0 / 3.0, 0.0), (12, 30, 150)
"""Successive halving, to a third as Hyperband does (L. Li et al. 2018): this share of the starts, at least one, is refined by so
many steps."""
FIRST_PASSES = 3
ROUNDINGS, FEW_ROUNDS, LOOSE, WORTH = 2, 5, 1e-2, 5e-3
"""Rounding of the relaxed design: how often, its column generation, and the gain in ψ for which to go on."""
PART = 0.6
"""Share of the corners and poses that a random start sees."""
DENSE = 3 * PER_SETUP
"""Poses by which set-ups are compared. They rank as their best poses do, and what few poses miss of these is more than set-ups
differ by."""
T = TypeVar("T")


def optimise(
    space: Space, task: Task, points: int, setups: int, *, starts: int = 2, seed: int = 0,
    pool: Executor | None = None, progress: Callable[[str], None] = lambda message: None,
) -> tuple[Rows, tuple[float, ...]]:  # fmt: skip
    """The best design found, and ψ of every initial design.

    Start 0 uses the most informative set-ups and every pose of the grid, the others random parts of both. Each begins with one
    design for every number of set-ups up to `setups`: one more set-up lowers ψ of the relaxed design, but costs the readings that
    determine its errors. Successive halving: all are refined a little, the better third further, and the best one until it no
    longer improves. Then it competes with whole numbers of the poses in the relaxed design of its set-ups. For a large plan
    a smaller one is refined; its set-ups and the relaxed design in them give the large one. The workers of `pool`
    (`symfive.executors`) share the starts.
    """
    small = min(points, LARGEST_REFINED)
    calls = [(small, setups, seed + s, *part) for s, part in enumerate(_parts(space, setups, starts, seed))]
    begun = [design for designs in each(pool, _started, space, task, calls) for design in designs]
    feasible = [(value_of(space, task, rows), rows) for rows in begun]
    running = dict(enumerate(begun))
    values = [value for value, _ in feasible]
    for share, steps in zip(SHARES, STEPS, strict=True):
        better = sorted(running, key=lambda s: values[s])[: max(1, math.ceil(share * len(begun)))]
        found = each(pool, _refined, space, task, [(running[start], steps) for start in better])
        running = {}
        for start, (value, rows, reachable) in zip(better, found, strict=True):
            running[start], values[start] = rows, value
            feasible += [(value, rows)] if reachable else []
        progress(
            f"{len(running)} of {len(begun)} designs refined by {steps} steps: criterion ψ = {min(values[s] for s in better):.5f}"
        )
    if points > small:
        many = _many(space, task, _best(feasible), points)
        return many, (value_of(space, task, many),)
    for _ in range(ROUNDINGS):
        before = _best(feasible)
        _rounded_relaxed(space, task, before, feasible)
        gained = value_of(space, task, before) - value_of(space, task, _best(feasible))
        progress(f"relaxed design rounded: criterion ψ = {value_of(space, task, _best(feasible)):.5f}")
        if gained < WORTH:
            break
    return _best(feasible), tuple(values)


def _best(feasible: list[tuple[float, Rows]]) -> Rows:
    return min(feasible, key=lambda found: found[0])[1]


def _rounded_relaxed(space: Space, task: Task, rows: Rows, feasible: list[tuple[float, Rows]]) -> None:
    """Whole numbers of the poses that the relaxed design in the same set-ups uses, refined; and the design itself, further."""
    found, n = generate(space, task, rows, LOOSE, FEW_ROUNDS), len(rows.z)
    kept = np.flatnonzero(found.relaxed.weights > SUPPORT)
    support = found.columns.take(kept)
    both = rows_of(space, rows).joined(support)
    for first in (np.arange(n), n + apportioned(found.relaxed.weights[kept], n)):
        chosen = exchange(task, both, rows.groups, first)
        if np.array_equal(chosen, np.arange(n)):
            continue  # the design itself, which was refined
        picked = both.take(chosen)
        start = Rows.of(picked.z, picked.k, picked.group, rows.poses)
        feasible.append((value_of(space, task, start), start))
        value, finer, reachable = _refined(space, task, start, STEPS[-1])
        feasible += [(value, finer)] if reachable else []


def _many(space: Space, task: Task, rows: Rows, points: int) -> Rows:
    """A larger design in the set-ups of `rows`: whole numbers of the poses that the relaxed design of `points` poses uses."""
    both = rows_of(space, rows).joined(generate(space, task, rows, LOOSE, FEW_ROUNDS, points=points).support)
    picked = both.take(choose(task, both, rows.groups, points))
    return Rows.of(picked.z, picked.k, picked.group, rows.poses)


def _parts(space: Space, setups: int, starts: int, seed: int) -> list[tuple[Indices | None, Indices | None]]:
    """Which corners of the workspace and which poses of the grid every start sees (None: all), drawn in their order."""
    corners, poses = len(setup_options(space)[0]), len(pose_grid(space, PER_SETUP))
    generator = np.random.default_rng(seed)
    parts: list[tuple[Indices | None, Indices | None]] = [(None, None)]
    while len(parts) < starts:
        among = generator.choice(corners, max(setups + 1, round(PART * corners)), replace=False)
        parts.append((among, np.sort(generator.choice(poses, max(1, round(PART * poses)), replace=False))))
    return parts


def _started(
    space: Space, task: Task, points: int, setups: int, seed: int, among: Indices | None, some: Indices | None
) -> list[Rows]:
    """Of every number of set-ups the best ones of some corners of the workspace, and by exchange the best poses of the grid in
    them."""
    poses, designs = pose_grid(space, PER_SETUP, seed), []
    for places, lengths in best_setups(space, task, setups, points, pose_grid(space, DENSE, seed), among):
        candidates = candidates_in(space, places, lengths, poses if some is None else poses[some])
        picked = candidates.take(choose(task, candidates, len(places), points, FIRST_PASSES))
        designs.append(Rows.of(picked.z, picked.k, picked.group, space.poses))
    return designs


def _refined(space: Space, task: Task, rows: Rows, steps: int) -> tuple[float, Rows, bool]:
    """Some steps of refinement, then, where it keeps all limits, exchange within the set-ups on a fine grid; ψ, the design
    and whether it keeps them."""
    finer, value = refine(task, space.kernel, rows, space.lower, space.upper, max_iter=steps)
    if not space.feasible(finer.z, finer.k).all():
        return value, finer, False
    finer, value = _exchanged(space, task, finer, value)
    return value, finer, True


def _exchanged(space: Space, task: Task, rows: Rows, value: float) -> tuple[Rows, float]:
    grid = candidates_in(space, *rows.setups, pose_grid(space, PER_SETUP, len(rows.z)))
    n = len(rows.z)
    both = rows_of(space, rows).joined(grid)
    chosen = exchange(task, both, rows.groups, np.arange(n), passes=3)
    picked = both.take(chosen)
    moved = Rows.of(picked.z, picked.k, picked.group, rows.poses)
    reached = value_of(space, task, moved)
    return (moved, reached) if reached < value else (rows, value)


def each(
    pool: Executor | None, function: Callable[..., T], space: Space, task: Task, calls: Sequence[tuple[Any, ...]]
) -> list[T]:
    """`function(space, task, *call)` of every call, in their order; `space` is as `make_space` makes it.

    Without a pool in this process. Raises what the first of the calls raised that failed.
    """
    if pool is None or isinstance(pool, Inline):
        return [function(space, task, *call) for call in calls]
    packed = _packed((space.machine, space.instrument, space.noise_um, space.setup_sigma), task)
    return results(pool, _there, [(packed, function, *call) for call in calls])


@one_thread
def _there(packed: bytes, function: Callable[..., T], *call: Any) -> T:
    """The same call in a worker."""
    return function(*_unpacked(packed), *call)


@functools.lru_cache(maxsize=1)
def _unpacked(packed: bytes) -> tuple[Space, Task]:
    (machine, instrument, noise_um, setup_sigma), task = pickle.loads(packed)
    return make_space(machine, instrument, noise_um=noise_um, setup_sigma=setup_sigma), task


def _packed(*parts: Any) -> bytes:
    file = io.BytesIO()
    _Pickler(file).dump(parts)
    return file.getvalue()


class _Pickler(pickle.Pickler):
    """Knows the read-only mappings of a machine, and keeps the order of an array's axes in memory: sums follow it."""

    def reducer_override(self, item: Any) -> Any:
        if isinstance(item, MappingProxyType):
            return freeze, (dict(item),)
        if isinstance(item, np.ndarray) and not item.flags.forc:
            order = np.argsort(item.strides, kind="stable")[::-1]
            return np.transpose, (np.ascontiguousarray(item.transpose(order)), np.argsort(order))
        return NotImplemented
