"""What a program consists of, and the contracts of a dialect, a small template that writes it down, and of its probing cycle."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace

from symfive.errors import InputError
from symfive.nc._post import Post
from symfive.nc._touch import Move, Touch


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
    spindle to `text` degree. `contour` calls the plane named by `text`, if any, and the contouring mode.
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


@dataclass(frozen=True, kw_only=True)
class Dialect:
    """A control's dialect. Templates take `{words}`, `{feed}`, `{text}`, `{name}` and the program's
    `{number}`, `dwell` `{seconds}` or `{milliseconds}`; `rapid` and `feed` are those of ISO 6983 where they are not given.

    After the `head`, `rotary` (where the machine has rotary axes: kinematics off) and `start` set every modal state that the
    program relies on: units, plane, absolute words, datum, no tool offset; what may move the tool waits for the operator
    (`after_first_stop`); `end` ends it.
    `retract` drives `{axis}` alone in machine coordinates to `{words}`, tool offset cancelled. `stop` shows its `{text}`, of at
    most 26 characters, on the control's screen and waits. `datum` says in words which lines call datum and tool offset.
    `decimals` that the control keeps, at most, by default those of a least increment of 0.0001 mm and degree: positions are
    written to these by `word` with `{axis}`, `{value}` and `{decimals}`, fewer where all `digits` of a number would be more than
    it reads; `upper`: it reads capital letters only.
    `orient` turns the spindle to `{angle}` degree and holds it; controls whose words for it depend on the builder stop and let
    the operator turn it.
    `steady` switches exact stop off before straight blocks, where `start` has not done so; `contour` calls a
    circle's `{plane}` and the contouring mode: exact stop off, look-ahead as in production. `arc` writes a
    circle's blocks, by default one a turn.
    `tool_centre`: the lines that switch tool-centre control on, with the length of tool `{tool}`, and off, at the place
    `{words}`; None where they depend on the machine's configuration, for which `tool_centre_example` shows what may stand there.
    `frame_of_start`: their X, Y and Z are in the workpiece frame as the table stands where they are switched on, not with its
    axes at 0.
    `inverse_time`: whether the control has G93, where F is 1/minutes of the block. Without it F is mm/min of the linear
    axes (degree/min where none moves) and the time stands in a comment: what F means with rotary axes in the block
    depends on the control's parameters.
    `numbered`: the number before each line, from its `{block}` (from 0), as `N{block}`; nothing: lines have none.
    `file`: from the name of a run or a series to the name that the control takes for a file.
    `cycle`: how the control probes; None where it is not known, then it takes no programs of a touch probe.
    """

    name: str
    suffix: str
    head: Sequence[str]
    start: Sequence[str]
    end: Sequence[str]
    dwell: str
    stop: Sequence[str]
    retract: Sequence[str]
    orient: Sequence[str]
    comment: str
    datum: str
    rapid: str = "G0 {words}"
    feed: str = "G1 {words} F{feed}"
    rotary: Sequence[str] = ()
    after_first_stop: Sequence[str] = ()
    contour: Sequence[str] = ("{plane} G64",)
    steady: Sequence[str] = ("G64",)
    arc: Callable[[Block], Sequence[str]] = lambda arc: [f"{arc.code} {arc.words} {arc.offset} F{arc.feed}"] * arc.turns
    tool_centre: tuple[str, str] | None = None
    tool_centre_example: str = ""
    frame_of_start: bool = False
    inverse_time: bool = True
    numbered: str = ""
    upper: bool = False
    decimals: int = 4
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

    def words(self, positions: Mapping[str, float]) -> str:
        """Positions as the dialect writes them, in the order in which they stand."""
        return " ".join(
            self.word.format(axis=axis, value=self.rounded(value), decimals=self.places(value))
            for axis, value in positions.items()
        )

    def worded(self, post: Post) -> Post:
        """The decisions with the dialect's own words for tool-centre control, where it is wished and the user gives none. Raises
        `InputError` where they depend on the machine's builder."""
        if not post.tool_centre or post.tool_centre_on:
            return replace(post, frame_of_start=False)
        if self.tool_centre is None:
            problem = (
                f"{self.name}: which lines switch tool-centre control with the ball's length depends on your machine"
            )
            raise InputError(
                problem, remedy=f"give --tool-centre-on and --tool-centre-off, as {self.tool_centre_example}"
            )
        on, off = (text.replace("{tool}", str(post.tool_number)) for text in self.tool_centre)
        return replace(post, tool_centre_on=on, tool_centre_off=off, frame_of_start=self.frame_of_start)


@dataclass(frozen=True, kw_only=True)
class Cycle:
    """How a control probes, in the words of its dialect.

    What is stored is where the axes stood, in the words of the program and not corrected for the tip. A servo lag or a delay of
    the signal is the same in all slow touches, along their direction: the effective radius of the sphere takes it.
    docs/howto/touch-probe.md has the table of the controls.

    `guarded` a move that stops on contact, after which the program goes no further; `touched` fast touch, back, slow touch, the
    line of the log called by the name given; `opening` and `closing` lines around all touches; `prepared` the dialect with what
    has to stand before the first move and behind the last one; `log` the log's name from the `{run}` or the program's `{name}`,
    `says` where it is written, `cautions` what the operator has to know; `beside` further files that the program needs on the
    control, name → text; `centred`: whether it may probe under tool-centre control; `calls_probe`: whether it probes only with
    the probe's tool called.
    """

    guarded: Callable[[Dialect, Move], Sequence[str]]
    touched: Callable[[Dialect, Touch, str], Sequence[str]]
    opening: Sequence[str] = ()
    closing: Sequence[str] = ()
    says: str
    log: str = ""
    prepared: Callable[[Dialect, Post], Dialect] = lambda dialect, post: dialect
    cautions: Sequence[str] = ()
    beside: Mapping[str, str] = field(default_factory=dict)
    centred: bool = False
    calls_probe: bool = False
