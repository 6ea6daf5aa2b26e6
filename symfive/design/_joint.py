"""Poses and the moves between them chosen together: the time to remove the bar against the information of a pose.

Twice the time is twice the readings, which lower ψ by log 2; so ψ + log(time) compares plans of different length, and a pose
is replaced by a slightly less informative one that can be reached with the bar mounted, where that lowers the sum.
"""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np

from symfive.design._candidates import information_of, value_of
from symfive.design._schedule import Schedule
from symfive.design._space import Space
from symfive.nc import Post
from symfive.optimal import Candidates, Rows, Task

Laid = tuple[Schedule, Post]


def chosen_with_moves(
    space: Space, task: Task, laid: Laid, candidates: Callable[[], Candidates], lay: Callable[[Rows], Laid]
) -> Laid:
    """The plan with poses exchanged for which the bar had to come off, or the ball out of its nest, as long as that pays.

    `laid` a schedule with the ways of its programs; `candidates` other poses of its set-ups; `lay` makes both for a design. Each
    pose at an end of such a move is replaced by the most informative candidate of those with a straight move to the pose beyond.
    """
    best, tried = laid, set[bytes]()
    if space.instrument == "touch_probe":  # every move of a probe leads around
        return best
    while (place := _next(best[0], tried)) is not None:
        run, row, pose = place
        tried.add(_key(best[0].rows, pose))
        rows = _exchanged(space, task, best[0], run, row, pose, candidates())
        if rows is None:
            continue
        trial = lay(rows)
        if price(space, task, trial[0]) < price(space, task, best[0]):
            best = trial
    return best


def price(space: Space, task: Task, schedule: Schedule) -> float:
    """ψ + log(time), less what is left under a drift."""
    return value_of(space, task, schedule.rows) - math.log(max(schedule.drift, 1e-9)) + math.log(schedule.seconds)


def _next(schedule: Schedule, tried: set[bytes]) -> tuple[str, int, int] | None:
    """A move around whose pose was not tried: the run, the row at its other end, and the pose's number in the design."""
    for g, (name, moves) in enumerate(schedule.moves.items()):
        mine = np.flatnonzero(schedule.rows.group == g)
        for row in schedule.unsafe.get(name, ()):
            for here, beyond in ((row, row - 1), (row - 1, row)):
                pose = int(mine[moves.order[here]])
                if _key(schedule.rows, pose) not in tried:
                    return name, beyond, pose
    return None


def _key(rows: Rows, pose: int) -> bytes:
    return bytes(rows.z[pose].tobytes())


def _exchanged(
    space: Space, task: Task, schedule: Schedule, run: str, beyond: int, pose: int, candidates: Candidates
) -> Rows | None:
    """The design with a pose exchanged for the most informative candidate in reach; None where there is none."""
    rows, moves = schedule.rows, schedule.moves[run]
    own = np.flatnonzero(candidates.group == rows.group[pose])
    own = own[moves.seated.reached_from(int(moves.order[beyond]), candidates.z[own])]
    if not own.size:
        return None
    information = information_of(space, task, rows)
    layout = task.layout(rows.groups)
    leaving = layout.embed(space.kernel.rows(rows.z[[pose]], rows.k[[pose]]), rows.group[[pose]])[0]
    entering = layout.embed(candidates.rows[own], candidates.group[own])
    less = information - leaving @ leaving.T
    best = own[int(np.argmin([task.value(less + row @ row.T) for row in entering]))]
    z = rows.z.copy()
    z[pose, : rows.poses] = candidates.z[best, : rows.poses]
    return Rows.of(z, rows.k, rows.group, rows.poses)
