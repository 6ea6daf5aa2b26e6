"""Poses without a clear path are replaced by others of the same set-ups."""

from __future__ import annotations

import numpy as np

from symfive.arrays import Array, Indices
from symfive.campaign import Run
from symfive.design._candidates import candidates_in, rows_of
from symfive.design._rounding import on_grid
from symfive.design._search import poses_everywhere
from symfive.design._space import Space
from symfive.errors import InputError
from symfive.moves import REMEDY, Ways
from symfive.optimal import Candidates, Rows, Task, exchange


class Reach:
    """Whether poses of a design's set-ups have an exit path; what blocks it where they have none. A pose is tested once."""

    def __init__(self, space: Space) -> None:
        self.space = space
        self._known: dict[bytes, str] = {}

    def in_the_way(self, z: Array, k: Array) -> list[str]:
        """Of every row (n,): "" or what meets."""
        keys = [np.concatenate(pair).tobytes() for pair in zip(z, k, strict=True)]
        new = [i for i, key in enumerate(keys) if key not in self._known]
        _, group = np.unique(np.hstack([z[new][:, self.space.poses :], k[new]]), axis=0, return_inverse=True)
        for g in range(int(group.max(initial=-1)) + 1):
            mine = [new[i] for i in np.flatnonzero(group.ravel() == g)]
            ways = Ways(self.space.machine, _run(self.space, z[mine], k[mine]))
            found = ways.outs(range(len(mine)))
            self._known |= {keys[i]: what if isinstance(what, str) else "" for i, what in zip(mine, found, strict=True)}
        return [self._known[key] for key in keys]


def _run(space: Space, z: Array, k: Array) -> Run:
    """Rows of one set-up as a run."""
    return Run(
        id="poses", instrument=(space.instrument,), sampling="static", time=np.arange(len(z), dtype=float),
        commands=space.commands(z, k), table_ball=space.table_ball(z[0]), tool_ball=space.tool_ball(z[0]),
        length=float(k[0, 0]) if space.bar else None, noise_um=space.noise_um,
    )  # fmt: skip


def settable_in(space: Space, rows: Rows) -> Candidates:
    """Poses everywhere in the set-ups of a design, as a person can set them."""
    return candidates_in(space, *rows.setups, on_grid(space, poses_everywhere(space)))


def with_ways_out(reach: Reach, task: Task, rows: Rows) -> Rows:
    """The design with every pose one from which the tool can be drawn back clear of everything.

    The others are exchanged for the most informative of the poses from which the certificate's search starts, in the same
    set-ups. Raises `InputError` where no pose has an exit path.
    """
    space = reach.space
    met = reach.in_the_way(rows.z, rows.k)
    if not any(met):
        return rows
    first = next(what for what in met if what)
    joined = rows_of(space, rows).joined(settable_in(space, rows))

    def reached(some: Indices) -> list[bool]:
        return [not what for what in reach.in_the_way(joined.z[some], joined.k[some])]

    chosen = exchange(task, joined, rows.groups, np.arange(len(rows.z)), allowed=reached)
    if not all(reached(chosen)):
        raise InputError(f"no pose has a clear exit path: {first} is in the way", remedy=REMEDY)
    return Rows.of(joined.z[chosen], joined.k[chosen], joined.group[chosen], rows.poses)
