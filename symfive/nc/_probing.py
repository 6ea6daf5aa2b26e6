"""A touch probe's program: at every pose the sphere is touched, from a distance and never while the rotary axes move.

The tip stands off the sphere along the tool's axis, goes to the start of each touch around the sphere, touches fast, backs off,
touches slowly, and the control writes down where its axes stood. Between two poses it leaves along the ways of the plan. All
moves towards the sphere stop on contact. A control's words for that are the `Cycle` of its dialect.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace

import numpy as np

from symfive.arrays import Array
from symfive.campaign import Run
from symfive.errors import InputError
from symfive.instruments import touches_of
from symfive.machine import Machine
from symfive.nc._base import Cycle, Dialect, Step
from symfive.nc._post import Post
from symfive.nc._recording import STANDSTILL, pose_of
from symfive.nc._render import program_name
from symfive.nc._route import LEAST_LIFT_MM, Positions
from symfive.nc._touch import Move, Probing, Touch, probing_of
from symfive.nc._writer import Writer

LINE_BYTES = 64
"""Of one touch in a log, at most."""
STARTS_S = 0.5
"""Time of the starts and stops within one touch."""


def cycle_of(dialect: Dialect, post: Post) -> Cycle:
    """How a control probes. Raises `InputError` where it cannot as the user decided, or where its words for it are not known."""
    cycle = dialect.cycle
    if cycle is None:
        problem = f"{dialect.name}: its words for a touch are not known"
        raise InputError(problem, remedy="choose another dialect, or give this one a Cycle (docs/howto/dialect.md)")
    if post.centred and not cycle.centred:
        problem = f"{dialect.name}: under tool-centre control the touches are not stored as positions of the axes"
        raise InputError(problem, remedy="plan a touch probe without tool-centre control")
    if cycle.calls_probe and post.probe_tool is None:
        problem = f"{dialect.name}: its touches need the probe called as a tool, and its number is not given"
        raise InputError(problem, remedy="give --probe-tool, the number of the touch probe in the tool table")
    return cycle


def check_probing(machine: Machine) -> None:
    """Raises `InputError` for other linear axes than X, Y and Z."""
    if set(machine.linear_axes) != {"X", "Y", "Z"}:
        raise InputError("a touch probe moves X, Y and Z", remedy="name the linear axes so, and leave out U, V and W")


class ProbeWays(Writer):
    """The moves between the poses of a probing program, and their times."""

    def __init__(self, machine: Machine, run: Run, post: Post, probing: Probing | None = None) -> None:
        check_probing(machine)
        super().__init__(machine, run, post)
        self.probing = probing or probing_of(machine)
        self.reach = self.probing.sphere_radius + self.probing.tip_radius
        self.above = np.array([0.0, 0.0, self.reach + self.probing.clearance])
        self.least_lift = self.reach + LEAST_LIFT_MM
        workpiece, self._tool = self.nominal.workpiece_rotation(run.commands), self.nominal.tool_rotation(run.commands)
        self._turns = workpiece.transpose(0, 2, 1) @ self._tool  # from the tool's frame to the workpiece's (rows, 3, 3)

    def stays(self, row: int) -> float:
        """Time of a pose's touches, from where it is reached to where it is left, s."""
        moves = [*self.moves_at(row)]
        return sum(move.seconds for move in moves) + STARTS_S * sum(isinstance(move, Touch) for move in moves)

    def seconds_to(self, row: int) -> float:
        """How long the way around to a row takes, s."""
        return sum(self._rapidly(a, b) for a, b in itertools.pairwise(self._way_to(row)))

    def moves_at(self, row: int) -> Iterator[Move | Touch]:
        """What is done at a pose: down from where it is reached, from touch to touch, up to where it is left."""
        feed, above = self.probing.between_feed, self._place_words(row, self.above)
        yield from _moves((self._linear_words(self._way_to(row)[-1]), above), feed, guarded=True)
        yield from self.touching(row)
        yield from _moves((above, self._linear_words(self._way_to(row + 1)[0])), feed)

    def touching(self, row: int) -> Iterator[Move | Touch]:
        """From above the sphere from touch to touch, and back there."""
        probing, off, feed = self.probing, float(self.above[2]), self.probing.between_feed
        above, in_machine = self._place_words(row, self.above), self.run.options.get("touch_frame") == "machine"
        for number, touch in enumerate(touches_of(self.run)):
            n = self._tool[row].T @ touch if in_machine else np.asarray(touch)
            if n[2] < -1e-9:
                problem = f"run {self.run.id}: touch {number + 1} comes from below the sphere's equator"
                raise InputError(problem, remedy="touch the half of the sphere that faces the tool", keys=("touches",))
            depths = (off, self.reach, self.reach + 1.0, self.reach - probing.overtravel, self.reach + probing.back_off)
            offsets = np.array([[off * n[0], off * n[1], off], *(depth * n for depth in depths)])
            beside, start, contact, further, target, backed = self._words_at(row, offsets)
            yield from _moves((above, beside, start), feed, guarded=True)
            yield Touch(
                fast=Move(start=start, end=target, feed=probing.fast_feed),
                slow=Move(start=backed, end=target, feed=probing.slow_feed),
                contact=contact, away={axis: further[axis] - contact[axis] for axis in "XYZ"}, back_off=probing.back_off,
                row=row, number=number,
            )  # fmt: skip
            yield Move(start=contact, end=start, feed=feed)
            yield from _moves((start, beside, above), feed)

    def steps(self) -> list[Step]:
        """The moves alone, to contact and back, in no control's words."""
        found = self.first_moves()
        for row in range(self.run.rows):
            if row:
                found += [self._rapid(a, b, row) for a, b in itertools.pairwise(self._way_to(row))]
            found += [
                Step(kind="feed", positions=place, commands={**pose_of(self.run, row), **place}, towards=row)
                for move in self.moves_at(row) for place in _places(move)
            ]  # fmt: skip
        return [*found, *self.last_moves("")]

    def stands(self, row: int) -> list[Positions]:
        """Positions of all axes, one after the other, while a pose's sphere is touched from above it."""
        above = self._place_words(row, self.above)
        places = [above, *(place for move in self.touching(row) for place in _places(move))]
        return [{**pose_of(self.run, row), **place} for place in places]

    def first_moves(self) -> list[Step]:
        """The tool's axis alone to the top, rotary axes, plane, down to the lifted pose."""
        return [self._to_the_top(0), *self._alone(self._way_to(0)[-1], 0)]

    def last_moves(self, text: str) -> list[Step]:
        """The tool's axis alone to the top, rotary axes home one by one."""
        rows = self.run.rows
        lifted, top, *turned = self._way_to(rows)
        up = replace(self._to_the_top(rows, top), seconds=self._rapidly(lifted, top))
        return [up, *(self._rapid(a, b, rows) for a, b in itertools.pairwise([top, *turned]))]

    def _linear_words(self, place: Mapping[str, float]) -> dict[str, float]:
        words = self._words(place, self._place(place))
        return {axis: words[axis] for axis in "XYZ"}

    def _place_words(self, row: int, offset: Array) -> dict[str, float]:
        """X Y Z that bring the tip so far (tool frame, mm) from the sphere's centre."""
        return self._words_at(row, offset[None])[0]

    def _words_at(self, row: int, offsets: Array) -> list[dict[str, float]]:
        """The same of several places (n, 3)."""
        places = np.asarray(self.run.table_ball) + offsets @ self._turns[row].T
        fixed = {name: self.run.commands[name][row] for name in self.rotary}
        commands = self.nominal.follow(places, self.run.tool_ball, fixed, f"a touch of run {self.run.id}")
        found = []
        for i, place in enumerate(places):
            at = {name: float(q[i]) for name, q in commands.items()}
            for name, value in at.items():
                low, high = self.machine.reach(name)
                if not low <= value <= high:
                    where = f"run {self.run.id}: touching at pose {row + 1}"
                    problem = f"{where} takes {name} to {value:.1f}, a plan uses {low:g} to {high:g} of its travel"
                    raise InputError(problem, remedy="place the sphere elsewhere, or leave that pose out")
            words = self._words(at, place)
            found.append({axis: words[axis] for axis in "XYZ"})
        return found


class Prober(ProbeWays):
    """The program in a control's words. Raises `InputError` for touches that come from below the stand-off, for further linear
    axes, and where `cycle_of` does."""

    def __init__(self, machine: Machine, run: Run, dialect: Dialect, post: Post, probing: Probing | None) -> None:
        super().__init__(machine, run, post, probing)
        self.dialect = dialect
        self.cycle = cycle_of(dialect, post)
        self.log = self.probing.log or self.cycle.log.format(run=run.id, name=dialect.file(program_name(run.id)))

    def steps(self) -> list[Step]:
        found = [
            *self._what_it_is(),
            Step(kind="stop", text=f"CLEAR? {self.upright} GOES TO TOP FIRST"),
            *_text(self.post.probe_on),
            *_text("\n".join(self.cycle.opening).format(log=self.log)),
            *self._centred(False, {}),
            *self.first_moves(),
        ]
        for row in range(self.run.rows):
            way, left = self._way_to(row), self._way_to(row + 1)[0]
            if row:
                found.append(Step(kind="comment", text=f"to pose {row + 1}"))
                found += [self._rapid(a, b, row) for a, b in itertools.pairwise(way)]
            found += self._centred(True, way[-1])
            if row == 0:
                found.append(Step(kind="stop", text="PROBE ABOVE THE SPHERE?"))
            lines = [line for move in self.moves_at(row) for line in self._lines(move)]
            found += [*_text("\n".join(lines)), *self._centred(False, left)]
        return [*found, *self.last_moves(""), *_text("\n".join(self.cycle.closing)), *_text(self.post.probe_off)]

    def _what_it_is(self) -> list[Step]:
        probing, touches = self.probing, len(touches_of(self.run))
        kilobytes = math.ceil(self.run.rows * touches * LINE_BYTES / 1024)
        said = (
            f"run {self.run.id}, {self.run.rows} centres of a sphere, {touches} touches each",
            f"sphere radius {probing.sphere_radius:g}, tip radius {probing.tip_radius:g}",
            f"probe length {-self.run.tool_ball[2]:g}",
            f"sphere at {' '.join(f'{v:g}' for v in self.run.table_ball)} in the workpiece frame",
            "work offset: origin of the workpiece frame, all rotary axes at 0",
            f"spindle locked, probe switched on before the first touch; {self.upright} goes up first, alone",
            "in air it ends at the first touch, without contact",
            self.cycle.says.format(log=self.log, kilobytes=kilobytes),
            *self.cycle.cautions,
        )
        return [Step(kind="comment", text=text) for text in said]

    def _lines(self, move: Move | Touch) -> Sequence[str]:
        if isinstance(move, Touch):
            return self.cycle.touched(self.dialect, move, self.log)
        if move.guarded:
            return self.cycle.guarded(self.dialect, move)
        return [self.dialect.feed.format(words=self.dialect.words(move.end), feed=f"{move.feed:g}")]


def _moves(places: Sequence[Mapping[str, float]], feed: float, *, guarded: bool = False) -> Iterator[Move]:
    """From place to place; moves to where the tip is already are left out."""
    for start, end in itertools.pairwise(places):
        move = Move(start=start, end=end, feed=feed, guarded=guarded)
        if move.length >= STANDSTILL:
            yield move


def _places(move: Move | Touch) -> tuple[Mapping[str, float], ...]:
    """Where a move ends; a touch: at the contact."""
    return (move.contact,) if isinstance(move, Touch) else (move.end,)


def _text(lines: str) -> list[Step]:
    return [Step(kind="text", text=lines)] if lines else []
