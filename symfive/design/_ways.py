"""Ways of a run's program on which no bodies meet and no axis leaves its travel.

Moves are straight in the axes between the program's blocks. A pose has a way out where the tool can be drawn back from it, go up
alone to the top and, there, turn the rotary axes home. Two such poses are joined over the top: rotary axes and plane in either
order, or by way of the rotary axes' home. On rapid moves bodies keep `RAPID_MM` apart, and the ball `KEPT_OFF` off its nest. Not
tested are the first moves, from wherever the machine stands to above the first pose.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from symfive.campaign import FIRST_LINE, Run
from symfive.design._bodies import Clearances
from symfive.errors import InputError
from symfive.machine import Machine
from symfive.nc import Positions, Post, Step, Way, at_the_top, lifts, over_the_top, program_steps, upright_axis
from symfive.procedures import Nominal, home

__all__ = ["REMEDY", "Ways", "blocked_moves", "cleared"]

Array = NDArray[np.float64]
LINEAR_MM, ROTARY_DEG = 4.0, 1.0
"""A move is tested at least so densely."""
KEPT_OFF, RAPID_MM = 15.0, 5.0
"""What the tool ball keeps off the nest and all bodies off each other on rapid moves, mm: the operator's tool is a little longer
or shorter than planned."""
ROUNDING_MM = 1e-3
RETRACTS_MM = (50.0, 80.0, 120.0, 200.0)
REMEDY = (
    "what clears such ways: a longer tool, a slimmer post or tool ([workspace] post_radius, tool_radius), more travel"
)


class Ways:
    """Clear ways between the poses of one run."""

    def __init__(self, machine: Machine, run: Run, retract_mm: float = RETRACTS_MM[0]) -> None:
        self.machine, self.run = machine, run
        self.nominal, self.clearances = Nominal(machine), Clearances(machine, run)
        self.retracts = sorted({retract_mm, *RETRACTS_MM}, key=lambda mm: (mm != retract_mm, mm))
        self.nest = np.asarray(run.table_ball)
        self.kept = np.array(
            [0.0 if name.startswith(("travel", "bar")) else RAPID_MM for name in self.clearances.names]
        )
        self._lifts: dict[tuple[float, ...], Positions | str] = {}

    def meets(self, before: Positions, after: Positions, *, rapid: bool, bar: bool = False) -> str | None:
        """What meets on a straight move, None where it is clear."""
        met = self.along(_between(self.machine, before, after), rapid=rapid, bar=bar)
        return met[0][1] if met else None

    def along(self, commands: Array, *, rapid: bool, bar: bool) -> list[tuple[int, str]]:
        """Positions (N, axes) at which something meets, and what."""
        values = self.clearances(commands, bar=bar) - (self.kept if rapid else 0.0)
        worst = np.argmin(values, axis=1)
        least = values[np.arange(len(values)), worst]
        near = np.full(len(commands), False)
        if rapid:
            near = np.linalg.norm(self.clearances.places(commands) - self.nest, axis=1) < KEPT_OFF
        names = self.clearances.names
        bad = np.flatnonzero(~(least >= -ROUNDING_MM) | near)
        return [(int(i), "tool ball and nest" if least[i] >= -ROUNDING_MM else names[worst[i]]) for i in bad]

    def lift(self, row: int) -> Positions | str:
        """Where the tool is drawn back to from a pose that has a way out; else what meets on the first way that was tried."""
        pose = {name: float(q[row]) for name, q in self.run.commands.items()}
        key = tuple(pose.values())
        if key not in self._lifts:
            self._lifts[key] = self._lift(row, pose)
        return self._lifts[key]

    def _lift(self, row: int, pose: Positions) -> Positions | str:
        met = self.meets(pose, pose, rapid=False, bar=True) or ""
        for mm in self.retracts if not met else ():
            for lifted in lifts(self.nominal, self.run, row, mm):
                top = at_the_top(self.machine, lifted)
                away = self.meets(lifted, top, rapid=True) or self.meets(top, self._at_home(top), rapid=True)
                away = away or self.meets(pose, lifted, rapid=False)
                if away is None:
                    return lifted
                met = met or away
        return met or f"travel of {upright_axis(self.machine)}"

    def around(self, row: int) -> Way:
        """The way to a row from the one before, out of the nest. Both must have a way out. Raises `InputError` where none is
        clear."""
        before, after = self.lift(row - 1), self.lift(row)
        met = [met for met in (before, after) if isinstance(met, str)]
        if not (isinstance(before, str) or isinstance(after, str)):
            for way in self._over(before, after):
                found = (self.meets(a, b, rapid=True) for a, b in itertools.pairwise(way))
                met.append(next((what for what in found if what is not None), ""))
                if not met[-1]:
                    return way
        problem = f"run {self.run.id}: {met[0]} on every way to the pose of line {row + FIRST_LINE}"
        raise InputError(problem, remedy=REMEDY)

    def _over(self, before: Positions, after: Positions) -> Iterator[Way]:
        """Ways over the top: directly, and by way of the rotary axes' home."""
        for rotary_first in (True, False):
            yield over_the_top(self.machine, before, after, rotary_first=rotary_first)
        high, there = (at_the_top(self.machine, place) for place in (before, after))
        yield before, high, self._at_home(high), self._at_home(there), there, after

    def _at_home(self, place: Positions) -> Positions:
        axes = self.machine.axes
        return {name: home(axes[name]) if axes[name].rotary else value for name, value in place.items()}


def blocked_moves(machine: Machine, run: Run, steps: Sequence[Step]) -> list[tuple[int, str]]:
    """Moves of a program on which bodies meet or an axis leaves its travel: (the row they lead to, what meets)."""
    ways = Ways(machine, run)
    moves, found = _moves(machine, steps)
    blocked = {row for row, _ in found}
    moves = [move for move in moves if move[0].towards not in blocked]
    for rapid, bar in itertools.product((False, True), repeat=2):
        alike = [move for move in moves if (move[0].kind != "feed", move[0].seated) == (rapid, bar)]
        if not alike:
            continue
        owner = np.repeat(np.arange(len(alike)), [len(commands) for _, commands in alike])
        met = ways.along(np.concatenate([commands for _, commands in alike]), rapid=rapid, bar=bar)
        first = {int(owner[i]): what for i, what in reversed(met)}
        found += [(alike[i][0].towards or 0, what) for i, what in sorted(first.items())]
    return found


def _moves(machine: Machine, steps: Sequence[Step]) -> tuple[list[tuple[Step, Array]], list[tuple[int, str]]]:
    """The positions to be tested of every move, and the rows on whose way a block ends outside an axis' travel.

    Such a way is blocked whatever else it meets, and where the chain is nearly singular it is kilometres long: nothing more of
    it is looked at. Blocks that are shorter than what is tested anyway are taken together.
    """
    moves: list[tuple[Step, Array]] = []
    outside: dict[int, str] = {}
    before: Positions = {}
    tested: Positions = {}
    for step, after in itertools.zip_longest(steps, steps[1:]):
        if step.kind not in ("rapid", "feed", "retract"):
            continue
        if not (before and step.commands and step.towards is not None):
            before, tested = step.commands, {}
            continue
        out = _outside(machine, step.commands)
        if out or step.towards in outside:
            outside.setdefault(step.towards, f"travel of {out}")
            tested = {}
        else:
            tested = tested or before
            alike = after is not None and _kind(after) == _kind(step) and step.kind == "feed"
            if not (alike and after is not None and _close(machine, tested, after.commands)):
                moves.append((step, _between(machine, tested, step.commands)))
                tested = {}
        before = step.commands
    return moves, list(outside.items())


def _kind(step: Step) -> tuple[str, int | None, bool]:
    return step.kind, step.towards, step.seated


def _outside(machine: Machine, commands: Positions) -> str | None:
    """An axis that is outside its travel."""
    for name, axis in machine.axes.items():
        low, high = axis.travel
        if not low - ROUNDING_MM <= commands[name] <= high + ROUNDING_MM:
            return name
    return None


def _close(machine: Machine, before: Positions, after: Positions) -> bool:
    """Whether two positions are so near that nothing between them is tested: short blocks need no test each."""
    return all(
        abs(after[name] - before[name]) <= (ROTARY_DEG if axis.rotary else LINEAR_MM)
        for name, axis in machine.axes.items()
    )


def _between(machine: Machine, before: Positions, after: Positions) -> Array:
    """Positions along a straight move (N, axes), the first one left out."""
    names = machine.axis_names
    a, b = (np.array([step[name] for name in names]) for step in (before, after))
    grain = np.array([ROTARY_DEG if machine.axes[name].rotary else LINEAR_MM for name in names])
    count = max(1, int(np.ceil(np.max(np.abs(b - a) / grain))))
    return np.asarray(a + np.outer(np.arange(1, count + 1) / count, b - a))


def cleared(
    machine: Machine, runs: Iterable[Run], unsafe: Mapping[str, Sequence[int]], post: Post | None = None
) -> Post:
    """The programs with every move clear: rows whose way with the ball seated is not lead around.

    `unsafe` run → rows that lead around anyway. Raises `InputError` where a pose has no way out.
    """
    post = post or Post()
    around: dict[str, tuple[int, ...]] = {}
    ways: dict[str, dict[int, Way]] = {}
    tested = machine.workspace.spindle_nose is not None
    for run in runs:
        own = Ways(machine, run, post.retract_mm)
        ends = {row: _lifted(own, row) for row in (0, run.rows - 1)}
        ways[run.id] = {0: (ends[0],), run.rows: (ends[run.rows - 1],)}
        found = {row for row in unsafe.get(run.id, ()) if row}
        if not run.dynamic:
            direct = program_steps(machine, run, replace(post, unsafe={}, ways=ways, tested=tested))
            found |= {row for row, _ in blocked_moves(machine, run, direct) if 0 < row < run.rows}
        ways[run.id] |= {row: own.around(row) for row in sorted(found)}
        around[run.id] = tuple(sorted(found))
    return replace(post, unsafe={run: rows for run, rows in around.items() if rows}, ways=ways, tested=tested)


def _lifted(ways: Ways, row: int) -> Positions:
    found = ways.lift(row)
    if isinstance(found, str):
        problem = f"run {ways.run.id}: {found} on every way out of the pose of line {row + FIRST_LINE}"
        raise InputError(problem, remedy=REMEDY)
    return found
