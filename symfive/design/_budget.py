"""Plans within a time: what fits, and what is most informative per minute."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np

from symfive.design._candidates import value_of
from symfive.design._schedule import SETUP_S, Schedule
from symfive.design._space import Space
from symfive.errors import InputError
from symfive.machine import Machine
from symfive.optimal import Rows, Task

Lay = Callable[[Rows], Schedule]
SHARE = 0.1
"""Of the poses, taken out at a time."""


def affordable(
    machine: Machine, minutes: float | None, points: int, runs: int, returns: int, repeats: int
) -> list[tuple[int, int]]:
    """Numbers of poses and runs that fit into the time, for every number of runs (without a budget: as wished).

    Raises `InputError` where not even two poses can be read.
    """
    if minutes is None:
        return [(points, min(runs, max(1, points // 2)))]
    pace = machine.workspace.seconds_per_pose * repeats
    found = []
    for count in range(1, runs + 1):
        most = int((60.0 * minutes - count * SETUP_S) // pace) - count * returns
        if most >= 2 * count:
            found.append((min(points, most), min(count, max(1, points // 2))))
    if not found:
        least = math.ceil((SETUP_S + (2 + returns) * pace) / 60.0)
        problem = f"{minutes:g} minutes are too short for one set-up ({SETUP_S / 60.0:g} min) and two poses"
        raise InputError(problem, remedy=f"give at least {least} minutes")
    return found


def without_least(space: Space, task: Task, rows: Rows, drop: int) -> Rows:
    """The design without its least informative poses, one after the other."""
    for _ in range(drop):
        sensitivities = space.kernel.rows(rows.z, rows.k)
        whole = task.layout(rows.groups).embed(sensitivities, rows.group)
        information = task.information(sensitivities, rows.group, rows.groups)
        least = int(np.argmin([task.value(information - row @ row.T) for row in whole]))
        kept = np.delete(np.arange(len(rows.z)), least)
        rows = Rows.of(rows.z[kept], rows.k[kept], rows.group[kept], rows.poses)
    return rows


def _without_a_run(space: Space, task: Task, rows: Rows) -> Rows:
    """The design without its least informative run."""
    left = [rows.group != g for g in range(rows.groups)]
    designs = [Rows.of(rows.z[kept], rows.k[kept], rows.group[kept], rows.poses) for kept in left]
    return min(designs, key=lambda design: value_of(space, task, design))


def shortened(space: Space, task: Task, rows: Rows, schedule: Schedule, seconds: float, lay: Lay) -> Schedule:
    """The schedule without its least informative poses until it fits. Raises `InputError` where it cannot."""
    while schedule.seconds > seconds:
        excess = (schedule.seconds - seconds) / max(schedule.seconds - rows.groups * SETUP_S, 1.0)
        drop = max(1, int(0.8 * excess * len(rows.z)))
        if len(rows.z) - drop < 2:
            if rows.groups == 1:
                least = math.ceil(schedule.seconds / 60.0)
                problem = f"the plan does not fit into {seconds / 60.0:g} minutes"
                raise InputError(problem, remedy=f"give about {least} minutes")
            rows = _without_a_run(space, task, rows)
        else:
            rows = without_least(space, task, rows, drop)
        schedule = lay(rows)
    return schedule


def most_per_minute(space: Space, task: Task, rows: Rows, lay: Lay) -> Schedule:
    """The part of a design that lowers ψ most per minute, set-up included: the least informative ones are removed."""
    before = task.value(task.prior)

    def rate(schedule: Schedule) -> float:
        return (before - value_of(space, task, schedule.rows)) / schedule.seconds

    current = best = lay(rows)
    while len(current.rows.z) > 2:
        drop = min(max(1, int(SHARE * len(current.rows.z))), len(current.rows.z) - 2)
        options = [lay(without_least(space, task, current.rows, drop))]
        if current.rows.groups > 1:
            fewer = _without_a_run(space, task, current.rows)
            options += [lay(fewer)] if len(fewer.z) >= 2 else []
        current = max(options, key=rate)
        best = max(best, current, key=rate)
    return best
