"""What a program consists of, and the contract of a dialect: a small template that writes it down."""

from __future__ import annotations

import math
import textwrap
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from symfive.nc._touch import Cycle


@dataclass(frozen=True, kw_only=True)
class Step:
    """One step of a program: `kind` is `rapid`, `feed`, `arc`, `contour`, `retract`, `dwell`, `stop`, `trigger`, `orient`,
    `comment` or `text`.

    `positions` axis → mm or degree, of the axes that the block names (of a `retract`: one, in machine coordinates; of a `text`:
    where the machine stands, in the words that hold from there on); `seconds` the time of a move or a dwell; `row` of the run
    whose pose is reached (None on the way) and `towards` the row to which a move leads (the number of rows: away from the last
    one); `text` of a comment, of a stop or of the user's own lines (a `trigger` starts a reading); `seated`: whether the ball is
    in its nest, or the bar on, while it moves; `commands` the positions of all axes at its end, empty where they are not known.
    `feed` mm/min along the path, of moves whose speed is part of the result: a program that has one is written with feeds, not
    with times of blocks. An `arc` names the two axes of its plane in `positions` (XY, YZ, ZX, in this order), `centre` of the
    circle in the same words, the signed `sweep` in degree, positive from the first to the second axis, and the positions of all
    axes on its `way` by row of the run; so does a block along which the control keeps the tool's centre. `orient` turns the
    spindle to `text` degree. `contour` calls the plane named by `text` and the contouring mode.
    """

    kind: str
    positions: Mapping[str, float] = field(default_factory=dict)
    seconds: float = 0.0
    text: str = ""
    row: int | None = None
    towards: int | None = None
    seated: bool = False
    commands: Mapping[str, float] = field(default_factory=dict)
    feed: float = 0.0
    centre: Mapping[str, float] = field(default_factory=dict)
    sweep: float = 0.0
    way: Mapping[int, Mapping[str, float]] = field(default_factory=dict)

    @property
    def straight(self) -> tuple[Step, ...]:
        """The step itself, or an arc or a block whose path is the control's as straight feed moves between the positions on its
        way."""
        if not self.way:
            return (self,)
        return tuple(replace(self, kind="feed", commands=there, towards=row) for row, there in self.way.items())


@dataclass(frozen=True, kw_only=True)
class Block:
    """Words of an arc: `code` G2 or G3, `words` of its end, `pole` those of the centre, `offset` I J K
    from start to centre, signed `sweep` in degree, `turns` begun (1 up to a whole circle), `feed`."""

    code: str
    words: str
    pole: str
    offset: str
    sweep: float
    turns: int
    feed: str


def _block_a_turn(arc: Block) -> Sequence[str]:
    return [f"{arc.code} {arc.words} {arc.offset} F{arc.feed}"] * arc.turns


@dataclass(frozen=True, kw_only=True)
class Dialect:
    """A control's dialect. Templates take `{words}`, `{feed}`, `{text}`, `{name}` and the program's
    `{number}`, `dwell` `{seconds}` or `{milliseconds}`.

    After the `head`, `rotary` (where the machine has rotary axes: kinematics off) and `start` set every modal state that the
    program relies on: units, plane, absolute words, datum, no tool offset; what may move the tool waits for the operator
    (`after_first_stop`); `end` ends it.
    `retract` drives `{axis}` alone in machine coordinates to `{words}`, tool offset cancelled. `stop` shows its `{text}`, of at
    most 26 characters, on the control's screen and waits. `datum` says in words which lines call datum and tool offset.
    `decimals` to which positions are written, by `word` with `{axis}`, `{value}` and `{decimals}`, fewer where all `digits`
    of a number would be more than the control reads; `upper`: it reads capital letters only.
    `orient` turns the spindle to `{angle}` degree and holds it; controls whose words for it depend on the builder stop and let
    the operator turn it.
    `contour` calls a circle's `{plane}` and the contouring mode: exact stop off, look-ahead as in production. `arc` writes a
    circle's blocks, by default one a turn.
    `tool_centre`: the lines that switch tool-centre control on, with the length of tool `{tool}`, and off, at the place
    `{words}`; None where they depend on the machine's configuration, for which `tool_centre_example` shows what may stand there.
    `frame_of_start`: their X, Y and Z are in the workpiece frame as the table stands where they are switched on, not with its
    axes at 0.
    `inverse_time`: whether the control has G93, where F is 1/minutes of the block. Without it F is mm/min of the linear
    axes (degree/min where none moves) and the time stands in a comment: what F means with rotary axes in the block
    depends on the control's parameters.
    `file`: from the name of a run or a series to the name that the control takes for a file.
    `cycle`: how the control probes; None where it is not known, then it takes no programs of a touch probe.
    """

    name: str
    suffix: str
    head: Sequence[str]
    start: Sequence[str]
    end: Sequence[str]
    rapid: str
    feed: str
    dwell: str
    stop: Sequence[str]
    retract: Sequence[str]
    orient: Sequence[str]
    comment: str
    datum: str
    rotary: Sequence[str] = ()
    after_first_stop: Sequence[str] = ()
    contour: Sequence[str] = ("{plane} G64",)
    arc: Callable[[Block], Sequence[str]] = _block_a_turn
    tool_centre: tuple[str, str] | None = None
    tool_centre_example: str = ""
    frame_of_start: bool = False
    inverse_time: bool = True
    numbered: bool = False
    upper: bool = False
    decimals: int = 5
    digits: int = 15
    word: str = "{axis}{value:.{decimals}f}"
    file: Callable[[str], str] = str
    verified: str = "not verified on a control"
    cycle: Cycle | None = None

    def places(self, value: float) -> int:
        """Decimals to which a position is written."""
        return min(self.decimals, self.digits - len(f"{abs(value):.0f}"))

    def rounded(self, value: float) -> float:
        """A position as it is written."""
        return round(value, self.places(value)) + 0.0


SPELLED = {"µ": "u", "°": " deg", "…": "...", "(": "[", ")": "]", ";": ",", "%": " ", '"': "'", "{": "[", "}": "]"}
LONGEST = 70
"""Characters of a comment: with brackets and block number a line has fewer than 80, which every control shows and takes whole."""
SHORTEST_S = 5e-4
"""A dwell of less is written as none."""
LEAST_FEED = 1e-3
"""mm/min or degree/min: the last digit of a feed without G93."""


def plain(text: str) -> str:
    """Text that any control takes in a comment: one line, ASCII, no brackets or separators."""
    ascii_ = "".join(SPELLED.get(c, c) for c in text)
    return " ".join("".join(c if 32 <= ord(c) < 127 else "?" for c in ascii_).split())


def render(dialect: Dialect, name: str, steps: Sequence[Step], number: int = 1, *, rotary: bool = True) -> str:
    """The program's text; `number` for controls that call programs by number; `rotary`: the machine has rotary axes."""
    start = [*dialect.head, *(dialect.rotary if rotary else ()), *dialect.start]
    lines = [line.format(name=program_name(name), number=f"{number:04d}") for line in start]
    feeds = [step for step in steps if step.kind in ("feed", "arc")]
    timed = dialect.inverse_time and bool(feeds) and not any(step.feed for step in feeds)
    lines += ["G93"] if timed else []
    before: Mapping[str, float] = {}
    late, time = list(dialect.after_first_stop), ""
    for step in steps:
        note = "" if timed else _block_time(step, before)
        if note and note != time:  # once for all blocks that take as long
            lines += _lines(dialect, Step(kind="comment", text=note), before, timed=timed)
        time = note
        lines += _lines(dialect, step, before, timed=timed)
        if step.kind == "stop":
            lines += late
            late.clear()
        before = {**before, **step.positions}
    lines += ["G94"] if timed else []
    lines += [line.format(name=program_name(name)) for line in dialect.end]
    if dialect.numbered:
        lines = [f"{i} {line}" for i, line in enumerate(lines)]
    return "\n".join(lines) + "\n"


def program_name(name: str) -> str:
    """A name that every control takes: 24 capitals, digits and _."""
    return "".join(c if c.isalnum() and c.isascii() else "_" for c in name).upper()[:24]


def _lines(dialect: Dialect, step: Step, before: Mapping[str, float], *, timed: bool) -> list[str]:
    text = plain(step.text)
    text = text.upper() if dialect.upper else text
    words = " ".join(word(dialect, axis, value) for axis, value in step.positions.items())
    if step.kind == "comment":
        return [dialect.comment.format(text=line) for line in textwrap.wrap(text, LONGEST)]
    if step.kind in ("text", "trigger"):
        return [line.replace("{words}", words) for line in step.text.splitlines() if line.strip()]
    if step.kind == "stop":
        return [line.format(text=text) for line in dialect.stop]
    if step.kind == "orient":
        return [line.format(angle=step.text) for line in dialect.orient]
    if step.kind == "dwell":
        if step.seconds < SHORTEST_S:
            return []
        return dialect.dwell.format(
            seconds=f"{step.seconds:.3f}", milliseconds=f"{1e3 * step.seconds:.0f}"
        ).splitlines()
    if step.kind == "retract":
        axis = next(iter(step.positions))
        return [line.format(words=words, axis=axis) for line in dialect.retract]
    if step.kind == "rapid":
        return [dialect.rapid.format(words=words)]
    if step.kind == "contour":
        return [line.format(plane=PLANES[step.text]) for line in dialect.contour]
    if step.kind == "arc":
        return list(dialect.arc(_arc(dialect, step, before)))
    return [dialect.feed.format(words=words, feed=_feed(dialect, step, before, timed=timed))]


def _block_time(step: Step, before: Mapping[str, float]) -> str:
    """How long a feed move takes in which a rotary axis turns."""
    turning = any(axis in "ABC" and value != before.get(axis, value) for axis, value in step.positions.items())
    return f"block time {step.seconds:.3f} s" if turning and step.kind == "feed" else ""


PLANES = {"XY": "G17", "ZX": "G18", "YZ": "G19"}
OFFSETS = dict(zip("XYZ", "IJK", strict=True))


def _arc(dialect: Dialect, step: Step, before: Mapping[str, float]) -> Block:
    """The words of an arc. The offset is from where the block before ends, as it is written there."""
    offset = {OFFSETS[n]: step.centre[n] - dialect.rounded(before[n]) for n in step.positions}
    end, pole, centre = (
        " ".join(word(dialect, name, value) for name, value in sorted(words.items()))
        for words in (step.positions, step.centre, offset)
    )
    return Block(
        code="G3" if step.sweep > 0.0 else "G2", words=end, pole=pole, offset=centre, sweep=step.sweep,
        turns=math.ceil(abs(step.sweep) / 360.0 - 1e-9), feed=f"{step.feed:g}",
    )  # fmt: skip


def word(dialect: Dialect, axis: str, value: float) -> str:
    """A position as the dialect writes it."""
    return dialect.word.format(axis=axis, value=dialect.rounded(value), decimals=dialect.places(value))


def _feed(dialect: Dialect, step: Step, before: Mapping[str, float], *, timed: bool) -> str:
    if step.feed:
        return f"{step.feed:g}"
    minutes = max(step.seconds, 1e-4) / 60.0
    if timed:
        return _down(1.0 / minutes)
    written = {axis: dialect.rounded(value) for axis, value in step.positions.items()}
    moved = {axis: v - dialect.rounded(before.get(axis, v)) for axis, v in written.items()}
    linear = math.hypot(*(d for axis, d in moved.items() if axis[0] in "XYZUVW"))
    way = linear or max((abs(d) for d in moved.values()), default=0.0)
    return f"{max(way / minutes, LEAST_FEED):.3f}"


def _down(value: float) -> str:
    """Six digits, rounded down: a feed is never higher than planned."""
    scale = 10.0 ** (math.floor(math.log10(value)) - 5)
    return f"{math.floor(value / scale * (1.0 + 1e-12)) * scale:.6g}"
