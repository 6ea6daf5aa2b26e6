"""The search for a plan: its poses and set-ups, what they are exchanged for, and the ways between them.

Twice the time is twice the readings, which lower ψ by log 2; so ψ + log(time) compares plans of different length, and a pose
is replaced by a slightly less informative one that can be reached with the bar mounted, where that lowers the sum.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from symfive.campaign import Run
from symfive.design._candidates import PER_SETUP, candidates_in, information_of, pose_grid, value_of
from symfive.design._optimise import optimise
from symfive.design._reach import Reach, settable_in, with_ways_out
from symfive.design._request import Request
from symfive.design._robust import robust_exchange, survive_a_lost_pose
from symfive.design._rounding import one_tool, rounded
from symfive.design._schedule import Laid, Schedule, most_per_minute, retimed, scheduled, shortened
from symfive.design._space import Space
from symfive.moves import Tested, cleared
from symfive.nc import Post, addressed
from symfive.optimal import Candidates, Rows, Task

MOST_SHARES = 3
"""Numbers of runs that all get the full search."""
Found = tuple[Rows, tuple[float, ...]]
"""A design, and ψ of every design that its search began with."""
Driven = tuple[Schedule, Post]


@dataclass(frozen=True)
class PlanSearch:
    """The search for the plan of a request.

    It remembers runs that were laid out, by their poses; the ways of runs, by their poses in order and the set-up; and what is
    known of moves, by the set-up.
    """

    request: Request
    space: Space
    task: Task
    _laid: dict[tuple[str, bytes], list[Laid]] = field(default_factory=dict, init=False, repr=False, compare=False)
    _cleared: dict[tuple[object, ...], Post] = field(default_factory=dict, init=False, repr=False, compare=False)
    _tested: dict[tuple[object, ...], Tested] = field(default_factory=dict, init=False, repr=False, compare=False)

    def best(self, shares: Sequence[tuple[int, int]]) -> Found:
        """The best design of so many poses and at most so many runs, of several such pairs."""
        if len(shares) > MOST_SHARES:  # one start each finds the best number of runs
            tried = [self._value(self._fitted(self._optimised(*share, starts=1)[0])) for share in shares]
            shares = [shares[int(np.argmin(tried))]]
        found = [self._optimised(*share) for share in shares]
        return min(((self._fitted(rows), psi) for rows, psi in found), key=lambda pair: self._value(pair[0]))

    def most_per_minute(self, rows: Rows, values: tuple[float, ...]) -> Found:
        """As many poses and runs of a design as are most informative per minute, or as many others that are better."""
        self.request.progress("selecting the poses with most information per minute")
        fewer = most_per_minute(self.space, self.task, rows, self._lay).rows
        again, psi = self._optimised(len(fewer.z), fewer.groups)
        before = self.task.value(self.task.prior)
        rates = [(before - self._value(d)) / self._lay(d).seconds for d in (again, fewer)]
        return (again, psi) if rates[0] > rates[1] else (fewer, values)

    def robust(self, rows: Rows, drawn: Sequence[Space], how: str) -> Rows:
        """The design for the `mean` or `worst` of some machines."""
        self.request.progress("improving the plan for machines drawn from the priors")
        return rounded(self.space, robust_exchange(drawn, self.task, rows, self._grid_in(rows), how))

    def surviving(self, rows: Rows) -> Rows:
        """The design for the loss of any one pose."""
        self.request.progress("improving the plan for the loss of one pose")
        return rounded(self.space, survive_a_lost_pose(self.space, self.task, rows, self._grid_in(rows)))

    def driven(self, rows: Rows) -> Driven:
        """The order of the poses and the clear ways between them, within the time; poses may be exchanged for it."""
        self.request.progress("planning the moves between the poses")
        first = self._with_ways(self._fitted(self._with_ways_out(rows)))

        def again(design: Rows) -> Driven:
            return self._with_ways(self._with_ways_out(design))

        schedule, post = chosen_with_moves(
            self.space, self.task, first, lambda: settable_in(self.space, first[0].rows), again
        )
        while self.request.minutes is not None and schedule.seconds > 60.0 * self.request.minutes:
            estimate = self._lay(schedule.rows).seconds
            fewer = self._shortened(schedule.rows, estimate - (schedule.seconds - 60.0 * self.request.minutes))
            schedule, post = self._with_ways(fewer)
        return schedule, post

    def _value(self, rows: Rows) -> float:
        return value_of(self.space, self.task, rows)

    def _optimised(self, points: int, runs: int, starts: int | None = None) -> Found:
        design, psi = optimise(
            self.space, self.task, points, runs, starts=starts or self.request.starts, seed=self.request.seed,
            pool=self.request.pool, progress=self.request.progress,
        )  # fmt: skip
        return self._with_ways_out(one_tool(self.space, self.task, rounded(self.space, design))), psi

    @cached_property
    def _reach(self) -> Reach:
        return Reach(self.space)

    def _with_ways_out(self, rows: Rows) -> Rows:
        return with_ways_out(self._reach, self.task, rows)

    def _lay(self, rows: Rows) -> Schedule:
        asked = self.request
        return scheduled(
            self.space, rows, returns=asked.returns, repeats=asked.repeats, noise_um=asked.noise_um, index=bool(asked.index),
            known=self._laid,
        )  # fmt: skip

    def _fitted(self, rows: Rows) -> Rows:
        """As much of a design as fits into the time."""
        return rows if self.request.minutes is None else self._shortened(rows, 60.0 * self.request.minutes)

    def _shortened(self, rows: Rows, seconds: float) -> Rows:
        return shortened(self.space, self.task, rows, self._lay(rows), seconds, self._lay).rows

    def _with_ways(self, rows: Rows) -> Driven:
        """The order of the poses, the ways of its programs, and its times on these."""
        schedule = self._lay(rows)
        machine = schedule.campaign.machine
        if not addressed(machine):
            return schedule, Post(unsafe=schedule.unsafe, via=schedule.via)
        posts = [self._with_clear_ways(schedule, run) for run in schedule.campaign.runs]
        post = posts[0]
        for other in posts[1:]:
            unsafe, via, ways = {**post.unsafe, **other.unsafe}, {**post.via, **other.via}, {**post.ways, **other.ways}
            post = replace(post, unsafe=unsafe, via=via, ways=ways)
        return retimed(schedule, post), post

    def _with_clear_ways(self, schedule: Schedule, run: Run) -> Post:
        """The ways of one run's program, all of them clear."""
        setup = run.stands
        key = run.id, *setup, np.stack([*run.commands.values()]).tobytes()
        if key not in self._cleared:
            name, via = run.id, {run.id: schedule.via[run.id]} if run.id in schedule.via else {}
            detours, tested = {name: schedule.moves[name].via}, {name: self._tested.setdefault(setup, Tested())}
            machine, unsafe = schedule.campaign.machine, schedule.unsafe
            self._cleared[key] = cleared(machine, [run], unsafe, Post(via=via), detours, tested)
        return self._cleared[key]

    def _grid_in(self, rows: Rows) -> Candidates:
        """Poses of a grid in the set-ups of a design."""
        return candidates_in(self.space, *rows.setups, pose_grid(self.space, PER_SETUP))


def chosen_with_moves(
    space: Space, task: Task, laid: Driven, candidates: Callable[[], Candidates], lay: Callable[[Rows], Driven]
) -> Driven:
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
