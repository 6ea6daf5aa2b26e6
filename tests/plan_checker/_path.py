"""Where every axis is along a program, densely, and what state the instrument is in meanwhile."""

import re
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from ._bodies import Cylinder
from ._events import Control, Event, Finding
from ._plan import Machine, Run

Array = NDArray[np.float64]
LINEAR_MM, ROTARY_DEG = 2.0, 0.5
"""Along a block the path is looked at at least so densely."""
NOSE_LENGTH = 300.0
"""mm of spindle nose and housing above the nose's lower end that the plans promise to keep off everything (docs/design.md)."""
POST_TOP = 15.0
"""mm below the table ball at which what carries it ends."""
TABLE_EDGE = 50.0
"""mm by which the table is wider than the circle on which a ball may stand."""
TABLE_DEPTH = 2000.0

ON = re.compile(r"\b(put|mount|seat|fit|refit|insert)\b", re.I)
OFF = re.compile(r"\b(take|remove|free|unseat|lift off)\b", re.I)


@dataclass(frozen=True)
class Path:
    """A program as read: its events, and the samples of its motion; `seated` per event: bar on or ball in its nest."""

    machine: Machine
    run: Run
    dialect: str
    control: Control

    @property
    def events(self) -> list[Event]:
        """In the program's order."""
        return self.control.events

    def fault(self, check: str, line: int, says: str) -> Finding:
        """A finding in this program."""
        return Finding(check, self.control.file, line, says)

    @cached_property
    def seated(self) -> NDArray[np.bool_]:
        """Whether the operator has seated the instrument and not yet freed it, at each event (a stop counts as after it)."""
        state, found = False, []
        for event in self.events:
            if event.kind == "stop":
                on, off = ON.search(event.text), OFF.search(event.text)
                if on or off:
                    state = bool(on) and (not off or on.start() < off.start())
            found.append(state)
        return np.array(found, bool)

    @cached_property
    def known(self) -> list[int]:
        """Events that are moves between positions that are known."""
        finite = [e.motion and np.isfinite(e.start).all() and np.isfinite(e.end).all() for e in self.events]
        return [int(i) for i in np.flatnonzero(finite)]

    @cached_property
    def _sampled(self) -> tuple[Array, NDArray[np.int64]]:
        pieces, owners = [], []
        for i in self.known:
            event = self.events[i]
            for curve in self._curves(event):
                pieces.append(curve)
                owners.append(np.full(len(curve), i))
        if not pieces:
            return np.zeros((0, len(self.machine.names))), np.zeros(0, np.int64)
        return np.concatenate(pieces), np.concatenate(owners)

    def along(self, event: Event, share: Array) -> Array:
        """Axis positions (N, n) at shares of a move from 0 to 1, mm and degree."""
        words = event.words(share)
        if not event.centred:
            return words
        return self.machine.following(words, words[:, self.control.linear], self.run.tool_ball)

    def _curves(self, event: Event) -> list[Array]:
        """A straight path in the words; of a rapid also that of axes which each run at their own greatest speed."""
        way = np.abs(event.end - event.start)
        grain = np.where(self.machine.rotary, ROTARY_DEG, LINEAR_MM)
        count = max(2, int(np.ceil((way / grain).max())))
        if event.arc is not None:
            count = max(count, int(np.ceil(abs(np.rad2deg(event.arc.sweep)))))
        share = np.linspace(0.0, 1.0, count + 1)
        words = self.along(event, share)
        if event.centred:
            return [words]
        if event.kind != "rapid" or np.count_nonzero(way > 1e-9) < 2:
            return [words]
        needed = way / np.where(np.isfinite(self.machine.limit("max_feed")), self.machine.limit("max_feed"), 1e4)
        own = np.minimum(share[:, None] * needed.max() / np.maximum(needed, 1e-12), 1.0)
        return [words, event.start + own * (event.end - event.start)]

    @property
    def q(self) -> Array:
        """Axis positions (N, n) at all samples, mm and degree."""
        return self._sampled[0]

    @property
    def owner(self) -> NDArray[np.int64]:
        """The event to which each sample belongs (N,)."""
        return self._sampled[1]

    @cached_property
    def rapid(self) -> NDArray[np.bool_]:
        """Whether each sample belongs to a rapid (N,)."""
        return np.array([event.kind == "rapid" for event in self.events], bool)[self.owner]

    @cached_property
    def ball(self) -> Array:
        """The tool ball in the workpiece frame (N, 3)."""
        return self._frame[:, 0]

    @cached_property
    def tool(self) -> Array:
        """Unit vector from the tool ball to the spindle, workpiece frame (N, 3)."""
        return self._frame[:, 1] - self._frame[:, 0]

    @cached_property
    def _frame(self) -> Array:
        ball = self.run.tool_ball
        return self.machine.points(self.q, np.stack([ball, ball + np.array([0.0, 0.0, 1.0])]))

    @cached_property
    def nose(self) -> Cylinder | None:
        """The spindle nose, or None where the machine file names none."""
        shape = self.machine.workspace.get("spindle_nose")
        if shape is None:
            return None
        start = self.ball + float(shape["above_ball"]) * self.tool
        return Cylinder(start, self.tool, np.full(len(start), NOSE_LENGTH), float(shape["radius"]))

    @cached_property
    def stem(self) -> Cylinder:
        """The tool from its ball to the spindle nose."""
        shape = self.machine.workspace.get("spindle_nose", {})
        length = float(shape.get("above_ball", -self.run.tool_ball[2]))
        radius = float(self.machine.workspace.get("tool_radius", 0.0))
        return Cylinder(self.ball, self.tool, np.full(len(self.ball), length), radius)

    @cached_property
    def bar(self) -> Cylinder:
        """The ball bar from the table ball to the tool ball."""
        way = self.ball - self.run.table_ball
        length = np.linalg.norm(way, axis=1)
        return Cylinder(
            np.broadcast_to(self.run.table_ball, way.shape), way / np.maximum(length, 1e-9)[:, None], length,
            float(self.machine.workspace.get("bar_radius", 0.0)),
        )  # fmt: skip

    @cached_property
    def post(self) -> Cylinder:
        """What carries the table ball or the nest."""
        n, foot = len(self.ball), self.run.table_ball * [1.0, 1.0, 0.0]
        height = max(float(self.run.table_ball[2]) - POST_TOP, 0.0)
        return Cylinder(
            np.broadcast_to(foot, (n, 3)), np.broadcast_to([0.0, 0.0, 1.0], (n, 3)), np.full(n, height),
            float(self.machine.workspace.get("post_radius", 0.0)),
        )  # fmt: skip

    @cached_property
    def table(self) -> Cylinder:
        """The table, of unknown depth."""
        n, radius = len(self.ball), float(self.machine.workspace.get("table_radius", 150.0)) + TABLE_EDGE
        centre = np.array([*self.machine.table_centre, -TABLE_DEPTH])
        return Cylinder(
            np.broadcast_to(centre, (n, 3)), np.broadcast_to([0.0, 0.0, 1.0], (n, 3)), np.full(n, TABLE_DEPTH), radius
        )
