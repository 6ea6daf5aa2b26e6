"""From a run of a plan to the steps of a program: approach, every pose with its dwell, retract.

Between two poses the ball must stay in its nest (or the bar at its length), so the linear axes follow the rotary ones in
short straight blocks; with the control's own tool-centre point control (the user's text switches it on) the words are the
ball's place in the workpiece frame instead and the control does the following.
"""

from __future__ import annotations

import itertools
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from symfive.campaign import Run
from symfive.errors import InputError
from symfive.machine import Machine
from symfive.nc._base import Step
from symfive.procedures import Nominal

__all__ = ["Post", "program_steps"]

Array = NDArray[np.float64]
LETTERS = "XYZABCUVW"
SEATED = {"ball_bar": "ball bar", "grid_encoder": "reading head"}
"""What the operator seats before a run, by instrument."""
RETRACT_MM = 50.0
CHORD_SHARE = 0.05
"""A straight block may leave the true way by this share of the sensor's range or the bar's stroke."""
CREEP_MM_PER_MIN = 500.0
DWELL_S = 2.0
SHORTEST_BLOCK_S = 0.02
FLAT = 0.2
"""Sine of the angle between tool and table below which drawing back along the tool would not lead away from the table."""
SHORT_REST_S = 0.1
MOST_BLOCKS = 4096
STANDSTILL = 1e-4
"""mm or degree: the last digit that every control reads."""


@dataclass(frozen=True, kw_only=True)
class Post:
    """What the user decides about the programs.

    `tool_centre_on`, `tool_centre_off`: the control's lines that switch tool-centre point control (TRAORI, G43.4 H1, M128,
    M428 …); without them the words are positions of the axes. `reversed_axes`: rotary axes that the control turns against
    ISO 841. `retract_mm` along the tool, `dwell_s` at each pose; `unsafe` run → rows to which the way leads around, out of
    the nest and over the top; `by_hand` those to which even that way could not be shown to be clear: the program waits;
    `tested`: whether all ways were tested for collisions with this retract, `blocked` run → rows to which they are not clear.
    """

    tool_centre_on: str = ""
    tool_centre_off: str = ""
    reversed_axes: tuple[str, ...] = ()
    retract_mm: float = RETRACT_MM
    dwell_s: float = DWELL_S
    unsafe: Mapping[str, Sequence[int]] = field(default_factory=dict)
    by_hand: Mapping[str, Sequence[int]] = field(default_factory=dict)
    tested: bool = False
    blocked: Mapping[str, Sequence[int]] = field(default_factory=dict)


def program_steps(machine: Machine, run: Run, post: Post | None = None) -> list[Step]:
    """The steps of a run's program. Raises `InputError` for an axis whose name is no NC address."""
    for name in machine.axis_names:
        if name not in LETTERS:
            raise InputError(f"axis {name} has no NC address", remedy=f"name axes by {', '.join(LETTERS)} for programs")
    return _without_standstill(_Writer(machine, run, post or Post()).steps())


def _without_standstill(steps: Sequence[Step]) -> list[Step]:
    """The steps without moves to where the axes stand already.

    While the instrument reads, their time stays: a rest becomes a dwell, a short one is added to the move that follows.
    """
    found: list[Step] = []
    there: Mapping[str, float] = {}
    rest: Step | None = None
    for step in steps:
        if step.positions and there and all(abs(v - there[n]) < STANDSTILL for n, v in step.positions.items()):
            if step.seated:
                before = rest.seconds if rest else 0.0
                rest = replace(step, kind="dwell", positions={}, commands={}, seconds=before + step.seconds)
            continue
        if rest is not None and step.kind == "feed" and step.seated and rest.seconds < SHORT_REST_S:
            step = replace(step, seconds=step.seconds + rest.seconds)
        elif rest is not None:
            found.append(rest)
        rest = None
        if step.kind == "text" or step.by_hand:  # the words mean something else, or the operator has moved the axes
            there = {}
        there = step.positions or there
        found.append(step)
    return found


class _Writer:
    def __init__(self, machine: Machine, run: Run, post: Post) -> None:
        self.machine, self.run, self.post = machine, run, post
        self.nominal = Nominal(machine)
        self.names = machine.axis_names
        self.rotary = [name for name in self.names if machine.axes[name].rotary]
        self.linear = [name for name in self.names if not machine.axes[name].rotary]
        self.places = self.nominal.ball(run.commands, run.tool_ball)
        self.seated = self.centred = False

    def steps(self) -> list[Step]:
        run, post = self.run, self.post
        ball = next((SEATED[name] for name in run.instrument if name in SEATED), "nest")
        found = [
            Step(kind="comment", text=f"run {run.id}, {run.rows} rows, {', '.join(run.instrument)}"),
            Step(
                kind="comment", text=f"table ball {_numbers(run.table_ball)} mm, tool length {-run.tool_ball[2]:g} mm"
            ),
            Step(kind="comment", text="work offset: the workpiece frame's origin, all rotary axes at 0"),
        ]
        if run.length is not None:
            found.append(Step(kind="comment", text=f"bar {run.length:g} mm"))
        found.append(Step(kind="stop", text="spindle clear above the table, spindle stopped and locked, then start"))
        lifted = self._retracted(0)
        found += [*self._centred(False), self._rapid(lifted), *self._centred(True), *self._creep(0)]
        found.append(Step(kind="stop", text=f"seat the {ball}, zero the instrument, then start"))
        self.seated = True
        found += self._recording() if run.dynamic else self._poses()
        self.seated = False
        last = run.rows - 1
        found.append(Step(kind="stop", text=f"free the {ball}, then start to retract"))
        lifted = self._retracted(last)
        found.append(self._feed(lifted, self._place(lifted), 60.0 * post.retract_mm / CREEP_MM_PER_MIN))
        return [*found, *self._centred(False)]

    def _centred(self, wanted: bool) -> list[Step]:
        """The user's text that switches tool-centre control; from here on the words are the ball's place, or the axes'."""
        self.centred = wanted and bool(self.post.tool_centre_on)
        text = self.post.tool_centre_on if wanted else self.post.tool_centre_off
        return [Step(kind="text", text=text)] if text else []

    def _poses(self) -> list[Step]:
        found = [Step(kind="dwell", seconds=self.post.dwell_s)]
        unsafe = set(self.post.unsafe.get(self.run.id, ()))
        for row in range(1, self.run.rows):
            seconds = float(self.run.time[row] - self.run.time[row - 1]) - self.post.dwell_s
            found += self._detour(row) if row in unsafe else self._way(row, max(seconds, 0.5))
            found.append(Step(kind="dwell", seconds=self.post.dwell_s))
        return found

    def _way(self, row: int, seconds: float) -> list[Step]:
        """From the pose before to this one in blocks so short that the ball stays where it belongs."""
        allowed = CHORD_SHARE * self.machine.workspace.stroke(bar="ball_bar" in self.run.instrument)
        if all(self.run.commands[n][row] == self.run.commands[n][row - 1] for n in self.names):
            return [self._pose(row, seconds)]
        blocks = 1
        while blocks < MOST_BLOCKS:
            share = np.arange(1, 2 * blocks + 1) / (2.0 * blocks)
            commands, places = self._between(row, share)
            if self._error(self._middles(row, commands, places), places[::2]) <= allowed:
                break
            blocks *= 2
        steps = [
            self._feed({n: float(commands[n][i]) for n in self.names}, places[i], seconds / blocks)
            for i in range(1, 2 * blocks - 1, 2)
        ]
        return [*steps, self._pose(row, seconds / blocks)]

    def _between(self, row: int, share: Array) -> tuple[dict[str, Array], Array]:
        """Commands and places of the ball at shares of the way: rotary axes straight, the bar on the shorter arc."""
        before, after = ({n: float(self.run.commands[n][r]) for n in self.names} for r in (row - 1, row))
        fixed = {n: before[n] + share * (after[n] - before[n]) for n in self.rotary}
        table = np.asarray(self.run.table_ball)
        a, b = self.places[row - 1] - table, self.places[row] - table
        size = float(np.linalg.norm(a))
        if "ball_bar" in self.run.instrument and size > 1e-9:
            places = table + _arc(a, b, share)
        else:
            places = self.places[row - 1] + share[:, None] * (self.places[row] - self.places[row - 1])
        return self.nominal.follow(
            places, self.run.tool_ball, fixed, f"the way to row {row + 1} of run {self.run.id}"
        ), places

    def _middles(self, row: int, commands: Mapping[str, Array], places: Array) -> Array:
        """Where the ball is in the middle of each straight block: straight is what the words of the program say, the ball's
        place where the control follows it, the positions of the axes elsewhere."""
        if self.centred:
            way = np.concatenate([self.places[row - 1 : row], places])
            return np.asarray(0.5 * (way[:-1:2] + way[2::2]))
        whole = np.stack([np.concatenate([[self.run.commands[n][row - 1]], commands[n]]) for n in self.names])
        straight = 0.5 * (whole[:, :-1:2] + whole[:, 2::2])
        return self.nominal.ball({n: straight[i] for i, n in enumerate(self.names)}, self.run.tool_ball)

    def _error(self, there: Array, places: Array) -> float:
        """How far a straight block's middle leaves the nest, or by how much it changes the bar's length."""
        if "ball_bar" in self.run.instrument:
            table = np.asarray(self.run.table_ball)
            return float(np.abs(np.linalg.norm(there - table, axis=1) - np.linalg.norm(places - table, axis=1)).max())
        return float(np.linalg.norm(there - places, axis=1).max())

    def _recording(self) -> list[Step]:
        """A dynamic run: its own rows, thinned to blocks that a control can read ahead."""
        step = max(1, int(np.ceil(SHORTEST_BLOCK_S / max(self.run.interval, 1e-6) - 1e-9)))
        rows = list(range(0, self.run.rows, step))
        if rows[-1] != self.run.rows - 1:
            rows.append(self.run.rows - 1)
        return [self._pose(b, float(self.run.time[b] - self.run.time[a])) for a, b in itertools.pairwise(rows)]

    def _detour(self, row: int) -> list[Step]:
        """Out of the nest along the tool, around, and in again; a bar is taken off meanwhile."""
        lifted, arriving = self._retracted(row - 1), self._retracted(row)
        seconds = 60.0 * self.post.retract_mm / CREEP_MM_PER_MIN
        bar = "ball_bar" in self.run.instrument
        self.seated = False
        steps = [Step(kind="stop", text="take the bar off, then start")] if bar else []
        steps += [
            self._feed(lifted, self._place(lifted), seconds),
            *self._centred(False),
            *self._around(lifted, arriving, row),
            *self._centred(True),
            *self._creep(row),
        ]
        self.seated = True
        return [*steps, *([Step(kind="stop", text="put the bar on, then start")] if bar else [])]

    def _around(self, lifted: Mapping[str, float], arriving: Mapping[str, float], row: int) -> list[Step]:
        """From one lifted pose to the other with the upright axis at the upper end of its travel."""
        if row in self.post.by_hand.get(self.run.id, ()):
            there = ", ".join(f"{n} {arriving[n]:.3f}" for n in self.names)
            return [Step(kind="stop", text=f"drive by hand to {there}, then start", by_hand=True)]
        upright = max(self.linear, key=lambda n: abs(self.machine.axes[n].direction[2]))
        axis = self.machine.axes[upright]
        top = axis.travel[1] if axis.direction[2] > 0.0 else axis.travel[0]
        high = ({**lifted, upright: top}, {**arriving, upright: top})
        return [*(self._rapid(commands) for commands in high), self._rapid(arriving)]

    def _creep(self, row: int) -> list[Step]:
        return [self._pose(row, 60.0 * self.post.retract_mm / CREEP_MM_PER_MIN)]

    def _pose(self, row: int, seconds: float) -> Step:
        commands = {n: float(self.run.commands[n][row]) for n in self.names}
        return self._feed(commands, self.places[row], seconds, row)

    def _feed(self, commands: Mapping[str, float], place: Array, seconds: float, row: int | None = None) -> Step:
        words = self._words(commands, place)
        return Step(kind="feed", positions=words, seconds=seconds, row=row, seated=self.seated, commands=dict(commands))

    def _rapid(self, commands: Mapping[str, float]) -> Step:
        return Step(kind="rapid", positions=self._words(commands, self._place(commands)), commands=dict(commands))

    def _place(self, commands: Mapping[str, float]) -> Array:
        return np.asarray(self.nominal.ball({n: np.array([v]) for n, v in commands.items()}, self.run.tool_ball)[0])

    def _words(self, commands: Mapping[str, float], place: Array) -> dict[str, float]:
        signs = {name: -1.0 if name in self.post.reversed_axes else 1.0 for name in self.names}
        words = {name: signs[name] * commands[name] for name in sorted(self.names, key=LETTERS.index)}
        if self.centred:
            words |= {axis: float(place[i]) for i, axis in enumerate("XYZ") if axis in words}
        return words

    def _retracted(self, row: int) -> dict[str, float]:
        """The pose with the tool drawn back along its own axis, or up from the table where it lies flat, as far as the
        travel allows."""
        commands = {n: np.array([self.run.commands[n][row]]) for n in self.names}
        workpiece, tool = (f(commands)[0] for f in (self.nominal.workpiece_rotation, self.nominal.tool_rotation))
        away = workpiece.T @ tool[:, 2]
        if away[2] < FLAT:
            away = np.array([0.0, 0.0, 1.0])
        fixed = {n: commands[n] for n in self.rotary}
        for share in np.linspace(1.0, 0.0, 11):
            target = (self.places[row] + share * self.post.retract_mm * away)[None, :]
            moved = self.nominal.follow(target, self.run.tool_ball, fixed, "the retract")
            if all(self._inside(n, float(moved[n][0])) for n in self.linear):
                break
        return {n: float(moved[n][0]) for n in self.names}

    def _inside(self, name: str, value: float) -> bool:
        low, high = self.machine.axes[name].travel
        return low - 1e-9 <= value <= high + 1e-9


def _arc(a: Array, b: Array, share: Array) -> Array:
    """From vector a to b on the shorter arc, length interpolated (n, 3)."""
    la, lb = np.linalg.norm(a), np.linalg.norm(b)
    u, v = a / la, b / lb
    across = v - (v @ u) * u
    angle = float(np.arctan2(np.linalg.norm(across), u @ v))
    if np.linalg.norm(across) < 1e-12:
        across = np.cross(u, [0.0, 0.0, 1.0] if abs(u[2]) < 0.9 else [1.0, 0.0, 0.0])
    across = across / np.linalg.norm(across)
    size = (1.0 - share) * la + share * lb
    return np.asarray(size[:, None] * (np.cos(share * angle)[:, None] * u + np.sin(share * angle)[:, None] * across))


def _numbers(values: Sequence[float]) -> str:
    return " ".join(f"{round(v, 3) + 0.0:.3f}" for v in values)
