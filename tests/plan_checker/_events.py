"""What a program does, in order, whatever its dialect: moves, dwells, stops and switches of the control.

Positions are those of the axes, mm and degree, in the machine's order of axes; NaN where nobody knows them. Words in the work
coordinate system are positions of the axes with the workpiece frame's origin as datum: of the tool axis the place of the spindle
nose, or with a length offset that of the tool ball (tool length added here). With tool-centre control X Y Z are the ball's
place in the workpiece frame. Machine coordinates only ever draw the tool back: to the top of the tool axis' travel.
"""

import re
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ._plan import Machine, Run

Array = NDArray[np.float64]
STANDS_MM = 1e-6
"""Below this the linear axes, or the ball with tool-centre control, stand still."""
BY_HAND = re.compile(r"\b(by hand|jog|drive)\b", re.I)
"""A stop at which the operator moves the axes: nobody knows afterwards where they stand."""


@dataclass(frozen=True)
class Finding:
    """One fault: which check, where, and what is wrong with numbers and units."""

    check: str
    file: Path
    line: int
    says: str

    def __str__(self) -> str:
        return f"{self.file}:{self.line}: {self.check}: {self.says}"


@dataclass(frozen=True)
class Arc:
    """A circle in the axes' words: `centre` and `plane` (two indices), radians `sweep` from the start, positive from the first
    axis of the plane to the second."""

    plane: tuple[int, int]
    centre: tuple[float, float]
    sweep: float


@dataclass(frozen=True)
class Event:
    """`kind`: rapid, feed, dwell, stop, orient (the spindle turned to `text` degree), switch, log (a line of it) or end.

    A move has `start` and `end`, the axes named in the block (`moved`), whether its words are `machine` coordinates or the
    ball's place (`centred`), its `arc` and `seconds` (NaN for a rapid). A stop has the `text` that the control shows, a switch
    the state of the control that it changes. A move that stops on contact is `probing`: `guarded` where there must be none,
    `touch` where one ends it before its `aim`; `back` is the control's own way back from it.
    """

    kind: str
    line: int
    text: str = ""
    start: Array = field(default_factory=lambda: np.zeros(0))
    end: Array = field(default_factory=lambda: np.zeros(0))
    moved: tuple[int, ...] = ()
    machine: bool = False
    centred: bool = False
    arc: Arc | None = None
    seconds: float = 0.0
    probing: str = ""
    aim: Array = field(default_factory=lambda: np.zeros(0))

    @property
    def motion(self) -> bool:
        """Whether axes move."""
        return self.kind in ("rapid", "feed")

    def words(self, share: Array) -> Array:
        """Words along the path (N, n) at shares of it from 0 to 1."""
        path = self.start + share[:, None] * (self.end - self.start)
        if self.arc is not None:
            (i, j), (a, b) = self.arc.plane, self.arc.centre
            angle = np.arctan2(self.start[j] - b, self.start[i] - a) + share * self.arc.sweep
            size = np.hypot(self.start[i] - a, self.start[j] - b)
            path[:, i], path[:, j] = a + size * np.cos(angle), b + size * np.sin(angle)
        return path

    def length(self, linear: NDArray[np.bool_]) -> float:
        """Length along the linear axes, mm."""
        way = np.where(linear, self.end - self.start, 0.0)
        if self.arc is None:
            return float(np.linalg.norm(way))
        (i, j), (a, b) = self.arc.plane, self.arc.centre
        way[[i, j]] = 0.0
        return float(np.hypot(np.hypot(self.start[i] - a, self.start[j] - b) * self.arc.sweep, np.linalg.norm(way)))


@dataclass
class Control:
    """State of a control while a program is read; shared by the dialects."""

    machine: Machine
    run: Run
    file: Path
    reversed_axes: tuple[str, ...] = ()
    events: list[Event] = field(default_factory=list)
    findings: list[Finding] = field(default_factory=list)
    facts: set[str] = field(default_factory=set)
    before_motion: set[str] = field(default_factory=set)
    written: int = 0
    far: int = 99
    feed: float = 0.0
    inverse_time: bool = False
    length_on: bool = False
    centred: bool = False
    frame: Array = field(default_factory=lambda: np.eye(4))
    position: Array = field(init=False)

    @property
    def decimals(self) -> int:
        """Decimals to which places are known: those of the longest number, fewer where one beyond 1000 has fewer."""
        return min(self.written, self.far)

    def wrote(self, value: str) -> None:
        """Notes a position as it is written."""
        whole, _, decimals = value.lstrip("+-").partition(".")
        self.written = max(self.written, len(decimals))
        if len(whole) > 3 and decimals:
            self.far = min(self.far, len(decimals))

    def __post_init__(self) -> None:
        self.position = np.full(len(self.machine.names), np.nan)

    def fault(self, line: int, says: str, check: str = "program") -> None:
        """A finding of the reader."""
        self.findings.append(Finding(check, self.file, line, says))

    def say(self, kind: str, line: int, text: str = "", seconds: float = 0.0) -> None:
        """An event that is no motion."""
        self.events.append(Event(kind, line, text, seconds=seconds))
        if kind == "stop" and BY_HAND.search(text):
            self.position = np.full(len(self.machine.names), np.nan)

    def switch(self, line: int, fact: str) -> None:
        """A state of the control is set."""
        self.facts.add(fact)
        if not any(event.motion and not (event.machine and fact.startswith(("datum", "G49"))) for event in self.events):
            self.before_motion.add(fact)
        self.say("switch", line, fact)

    def index(self, axis: str) -> int | None:
        """Place of an axis in the machine's order."""
        return self.machine.names.index(axis) if axis in self.machine.names else None

    def to_axes(self, words: Mapping[str, float], incremental: bool, line: int) -> tuple[Array, tuple[int, ...]]:
        """Target of a block from its words, in the frame in which the block moves."""
        target, moved = self.here(), []
        if self.centred:
            target[self.linear] = (self.frame @ [*target[self.linear], 1.0])[:3]
        for axis, value in words.items():
            i = self.index(axis)
            if i is None:
                self.fault(line, f"axis {axis} is not one of this machine's ({', '.join(self.machine.names)})")
                continue
            value = -value if axis in self.reversed_axes else value
            offset = self.tool_length if self.length_on and i == self.machine.tool_axis and not self.centred else 0.0
            target[i] = target[i] + value if incremental else value + offset
            moved.append(i)
        if self.centred:
            target[self.linear] = np.linalg.solve(self.frame, [*target[self.linear], 1.0])[:3]
        return target, tuple(moved)

    @property
    def tool_length(self) -> float:
        """Of the tool ball below the spindle nose, mm."""
        return -float(self.run.tool_ball[2])

    def here(self) -> Array:
        """Where the axes stand; with tool-centre control the linear ones replaced by the ball's place."""
        if not self.centred:
            return self.position.copy()
        words = self.position.copy()
        words[self.linear] = self.machine.points(self.position[None, :], self.run.tool_ball[None, :])[0, 0]
        return words

    @property
    def linear(self) -> list[int]:
        """Indices of X, Y and Z."""
        return [self.machine.names.index(name) for name in "XYZ"]

    def centre(self, *, as_it_stands: bool) -> None:
        """Tool-centre control is on, its frame fixed to the table with its axes at 0, or as it stands (Fanuc, Mitsubishi)."""
        self.centred, self.frame = True, np.eye(4)
        if not as_it_stands:
            return
        table = [axis.name for axis in self.machine.chain.workpiece if axis.rotary]
        stands = np.where(np.isin(self.machine.names, table), self.position, 0.0)
        corners = self.machine.points(stands[None, :], np.vstack([np.eye(3), np.zeros(3)]))[0]
        self.frame = np.linalg.inv(np.block([[(corners[:3] - corners[3]).T, corners[3][:, None]], [np.zeros(3), 1.0]]))

    def move(
        self, kind: str, line: int, words: Mapping[str, float], *, incremental: bool = False, arc: Arc | None = None
    ) -> None:
        """A move in work coordinates at the control's feed."""
        start = self.here()
        end, moved = self.to_axes(words, incremental, line)
        if not moved:
            return
        event = Event(kind, line, start=start, end=end, moved=moved, centred=self.centred, arc=arc)
        seconds = np.nan if kind == "rapid" else self._seconds(event)
        self.events.append(
            Event(kind, line, start=start, end=end, moved=moved, centred=self.centred, arc=arc, seconds=seconds)
        )
        if self.centred:
            end = self.machine.following(end[None, :], end[None, self.linear], self.run.tool_ball)[0]
        self.position = end

    def retract(self, line: int, words: Mapping[str, float | str]) -> None:
        """A rapid in machine coordinates: axis → number or the name of a parameter that the operator has set."""
        start, end = self.position.copy(), self.position.copy()
        moved = tuple(i for axis in words if (i := self.index(axis)) is not None)
        for axis, value in words.items():
            i = self.index(axis)
            if i is None:
                self.fault(line, f"axis {axis} is not one of this machine's ({', '.join(self.machine.names)})")
            elif i != self.machine.tool_axis:
                self.fault(line, f"axis {axis} moves in machine coordinates, whose zero no plan knows", "first move")
                end[i] = np.nan
            elif isinstance(value, float) and not (-5.0 <= value <= 0.0 or abs(value - self.machine.top) < 1e-3):
                top = f"its top, {self.machine.top:g} mm"
                says = f"{axis} {value:g} mm in machine coordinates is neither the axis' zero nor {top}"
                self.fault(line, says, "first move")
                end[i] = np.nan
            else:
                end[i] = self.machine.top
        self.events.append(Event("rapid", line, start=start, end=end, moved=moved, machine=True, seconds=np.nan))
        self.position = end

    def _seconds(self, event: Event) -> float:
        """Time of a feed move: G93's, else F along the linear axes, or degree/min of the fastest rotary one."""
        if self.feed <= 0.0:
            return np.nan
        if self.inverse_time:
            return 60.0 / self.feed
        way, turn = event.length(~self.machine.rotary), np.abs(event.end - event.start)[self.machine.rotary]
        if way < STANDS_MM and turn.size:
            way = float(turn.max())
        return 60.0 * way / self.feed
