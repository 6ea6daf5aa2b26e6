"""What meets on straight moves of the axes, between the positions that are looked at as well.

At two neighbouring positions bodies keep apart by m and m', and between them no point of what moves goes a longer way than L:
then nowhere between does anything come nearer than (m + m' - L)/2. Where that is not enough the move is halved, down to
`FINE_MM`.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Mapping, Sequence

import numpy as np

from symfive.arrays import Array, Flags, Indices
from symfive.campaign import Run
from symfive.machine import Machine
from symfive.moves._bodies import RAPID_MM, kept_off_nest
from symfive.moves._clearances import NEAR, ON_THE_BAR, Clearances
from symfive.nc import Positions, Step

LINEAR_MM, ROTARY_DEG = 4.0, 1.0
"""A move is looked at at least so densely."""
FINE_MM = 0.25
"""What moves so little between two positions is not looked at in between: a clearance is known to half of it."""
ROUNDING_MM = 1e-3
AT_ONCE = 8192
"""Positions at which distances are sought at once: what that needs in memory stays small."""
FEW = 8
"""Places of a path that are looked at first."""
ENOUGH_MM = 25.0
"""Distances above it are not sought further."""

Met = Callable[[Sequence[tuple[Positions, Positions]], bool, bool], Sequence[str]]
"""What meets on each of some straight moves, "" where it is clear, given whether they are rapid and the ball is seated."""


class Moves:
    """Straight moves of one run's axes."""

    def __init__(self, machine: Machine, run: Run) -> None:
        self.machine, self.clearances = machine, Clearances(machine, run)
        self.nest = np.asarray(run.table_ball)
        self.kept_off = kept_off_nest(machine.workspace, self.clearances.probe)
        self.names = (*self.clearances.names, "tool ball and nest")
        clearance = machine.workspace.clearance
        self.kept, self.kept_on_rapids = (
            np.array([0.0 if name.startswith(("travel", *near)) else mm for name in self.clearances.names])
            for near, mm in ((NEAR, clearance), (ON_THE_BAR, max(clearance, RAPID_MM)))
        )
        self.bodies = np.array([not name.startswith("travel") for name in self.names])
        low, high = np.array([machine.reach(n) for n in machine.axis_names]).T
        self.low, self.high = low - ROUNDING_MM, high + ROUNDING_MM
        self.grain = np.array([ROTARY_DEG if machine.axes[n].rotary else LINEAR_MM for n in machine.axis_names])

    def vector(self, positions: Positions) -> Array:
        """Positions in the machine's order of axes."""
        return np.array([positions[name] for name in self.machine.axis_names])

    def outside(self, places: Array) -> Flags:
        """Whether each axis is outside its travel (…, axes)."""
        return np.asarray(~((places >= self.low) & (places <= self.high)))

    def close(self, before: Array, after: Array) -> bool:
        """Whether two places are so near that nothing between them is tested: short blocks need no test each."""
        return bool(np.all(np.abs(after - before) <= self.grain))

    def clear(self, paths: Sequence[Array]) -> list[bool]:
        """Whether nothing meets along each of some paths (n, axes) of straight blocks with the ball seated; blocks shorter than
        what is tested anyway are taken together. What is blocked is so in many places mostly: a few are looked at first.

        Nothing more of a path is looked at that leaves a travel: near a singular pose it is kilometres long.
        """
        inside = {i: self._thinned(path) for i, path in enumerate(paths) if not self.outside(path).any()}
        few = {i: path[:: max(1, len(path) // FEW)] for i, path in inside.items()}
        inside = self._clear(inside, {i: (path, path) for i, path in few.items()})
        inside = self._clear(inside, {i: (path[:-1], path[1:]) for i, path in inside.items()})
        return [i in inside for i in range(len(paths))]

    def _clear(self, paths: dict[int, Array], moves: Mapping[int, tuple[Array, Array]]) -> dict[int, Array]:
        """The paths on none of whose moves anything meets."""
        if not moves:
            return {}
        starts, ends = (np.concatenate(places) for places in zip(*moves.values(), strict=True))
        owner = np.repeat(np.arange(len(moves)), [len(before) for before, _ in moves.values()])
        met = self.met(starts, ends, rapid=False, bar=True, of=owner)
        return {i: path for (i, path), what in zip(paths.items(), met, strict=True) if not what}

    def _thinned(self, path: Array) -> Array:
        places = [path[0]]
        for here, after in itertools.pairwise(path[1:]):
            if not self.close(places[-1], after):
                places.append(here)
        return np.array([*places, path[-1]])

    def met(self, starts: Array, ends: Array, *, rapid: bool, bar: bool, of: Indices | None = None) -> list[str]:
        """Of moves (M, axes): what meets first along each, "" where it is clear; or along each path, `of` (M,) says whose."""
        of = np.arange(len(starts)) if of is None else of
        counts = np.maximum(1, np.ceil(np.abs(ends - starts) / self.grain).max(axis=1, initial=0.0)).astype(int)
        owner = np.repeat(np.arange(len(starts)), counts + 1)
        share = np.concatenate([np.arange(count + 1) / count for count in counts])
        commands = starts[owner] + share[:, None] * (ends - starts)[owner]
        left = self._left(commands, rapid, bar)
        found = [""] * (int(of.max(initial=-1)) + 1)
        self._note(found, of[owner], left)
        first = np.flatnonzero(np.diff(owner) == 0)
        a, b = (commands[first], left[first]), (commands[first + 1], left[first + 1])
        owner = of[owner[first]]
        while owner.size:
            on = np.flatnonzero(self._doubtful(a, b) & np.array([not found[i] for i in owner]))
            owner, a, b = owner[on], (a[0][on], a[1][on]), (b[0][on], b[1][on])
            if not owner.size:
                break
            middle = 0.5 * (a[0] + b[0])
            left = self._left(middle, rapid, bar)
            self._note(found, owner, left)
            halves = ((a[0], middle), (a[1], left)), ((middle, b[0]), (left, b[1]))
            a = np.concatenate([a[0], middle]), np.concatenate([a[1], left])
            b = np.concatenate([middle, b[0]]), np.concatenate([left, b[1]])
            owner = np.tile(owner, len(halves))
        return found

    def meetings(self, moves: Sequence[tuple[Positions, Positions]], rapid: bool, bar: bool) -> list[str]:
        """`met` of moves from place to place."""
        starts, ends = (np.stack([self.vector(place) for place in places]) for places in zip(*moves, strict=True))
        return self.met(starts, ends, rapid=rapid, bar=bar)

    def _left(self, commands: Array, rapid: bool, bar: bool) -> Array:
        """What is left of every clearance above what must be kept (N, pairs)."""
        chunks = np.array_split(commands, 1 + len(commands) // AT_ONCE)
        values = np.concatenate([self.clearances(chunk, bar=bar, enough=ENOUGH_MM) for chunk in chunks])
        values -= self.kept_on_rapids if rapid else self.kept
        off = np.full(len(commands), np.inf)
        if rapid:
            off = np.linalg.norm(self.clearances.frames(commands)[0] - self.nest, axis=1) - self.kept_off
        return np.column_stack([values, off])

    def _note(self, found: list[str], owner: Indices, left: Array) -> None:
        for i in np.flatnonzero(~(left.min(axis=1) >= -ROUNDING_MM)):
            found[owner[i]] = found[owner[i]] or self.names[int(np.argmin(left[i]))]

    def _doubtful(self, a: tuple[Array, Array], b: tuple[Array, Array]) -> Flags:
        """Whether something could meet between two positions."""
        (here, axis), (there, other) = self.clearances.frames(a[0]), self.clearances.frames(b[0])
        way = np.linalg.norm(there - here, axis=1) + self.clearances.reach * np.linalg.norm(other - axis, axis=1)
        beyond = way[:, None]
        one, two = (np.where(np.isinf(x), y - beyond, x) for x, y in ((a[1], b[1]), (b[1], a[1])))
        least = np.min(0.5 * (one + two - beyond), axis=1, where=np.isfinite(one) & self.bodies, initial=np.inf)
        return np.asarray((least < -ROUNDING_MM) & (way > FINE_MM))


def blocked_moves(machine: Machine, run: Run, steps: Sequence[Step], met: Met | None = None) -> list[tuple[int, str]]:
    """Moves of a program on which bodies meet or an axis leaves its travel: (the row they lead to, what meets); `met` answers
    from what it knows."""
    test = Moves(machine, run)
    met = met or test.meetings
    moves, outside = _moves(test, steps)
    found = dict(outside)
    for rapid, bar in itertools.product((False, True), repeat=2):
        alike = [
            (step, before)
            for step, before in moves
            if (step.kind != "feed", step.seated) == (rapid, bar) and step.towards not in outside
        ]
        if not alike:
            continue
        whats = met([(before, step.commands) for step, before in alike], rapid, bar)
        for (step, _), what in zip(alike, whats, strict=True):
            if what:
                found.setdefault(step.towards or 0, what)
    return sorted(found.items())


def _moves(test: Moves, steps: Sequence[Step]) -> tuple[list[tuple[Step, Positions]], dict[int, str]]:
    """The moves to be tested, each with where it begins, and the rows on whose way a block ends outside an axis' travel.

    Such a way is blocked whatever else it meets, and where the chain is nearly singular it is kilometres long: nothing more of
    it is looked at. Blocks that are shorter than what is tested anyway are taken together.
    """
    moves: list[tuple[Step, Positions]] = []
    outside: dict[int, str] = {}
    before: Positions = {}
    tested: Positions = {}
    steps = [straight for step in steps for straight in step.straight]
    for step, after in itertools.zip_longest(steps, steps[1:]):
        if step.kind not in ("rapid", "feed", "retract"):
            continue
        if not (before and step.commands and step.towards is not None):
            before, tested = step.commands, {}
            continue
        out = test.outside(test.vector(step.commands))
        if out.any() or step.towards in outside:
            outside.setdefault(step.towards, f"travel of {test.machine.axis_names[int(np.argmax(out))]}")
            tested = {}
        else:
            tested = tested or before
            alike = after is not None and _kind(after) == _kind(step) and step.kind == "feed"
            if not (alike and after is not None and test.close(test.vector(tested), test.vector(after.commands))):
                moves.append((step, tested))
                tested = {}
        before = step.commands
    return moves, outside


def _kind(step: Step) -> tuple[str, int | None, bool]:
    return step.kind, step.towards, step.seated
