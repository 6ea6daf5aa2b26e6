"""What a program consists of, and the contract of a dialect: a small template that writes it down."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field

__all__ = ["Dialect", "Step", "render"]


@dataclass(frozen=True, kw_only=True)
class Step:
    """One step of a program: `kind` is `rapid`, `feed`, `dwell`, `stop`, `comment` or `text`.

    `positions` axis → mm or degree; `seconds` the time of a feed move or a dwell; `row` of the run whose pose is reached
    (None on the way); `text` of a comment, of a stop or of the user's own lines; `seated`: whether the ball is in its nest, or
    the bar on, while it moves; `commands` the positions of the axes themselves where the words are others;
    `by_hand`: a stop during which the operator drives the machine.
    """

    kind: str
    positions: Mapping[str, float] = field(default_factory=dict)
    seconds: float = 0.0
    text: str = ""
    row: int | None = None
    seated: bool = False
    by_hand: bool = False
    commands: Mapping[str, float] = field(default_factory=dict)


def _plain_word(axis: str, value: float) -> str:
    return f"{axis}{value:.5f}"


@dataclass(frozen=True, kw_only=True)
class Dialect:
    """A control's dialect. Templates take `{words}`, `{feed}`, `{seconds}`, `{text}`, `{name}` and the program's `{number}`.

    `decimals` to which positions are written, by `word`.
    `inverse_time`: whether the control has G93, where F is 1/minutes of the block. Without it F is mm/min of the linear
    axes (degree/min where none moves) and the time stands in a comment: what F means with rotary axes in the block
    depends on the control's parameters.
    """

    name: str
    suffix: str
    start: Sequence[str]
    end: Sequence[str]
    rapid: str
    feed: str
    dwell: str
    stop: str
    comment: str
    inverse_time: bool = True
    numbered: bool = False
    decimals: int = 5
    word: Callable[[str, float], str] = _plain_word
    verified: str = "not verified on a control"


SPELLED = {"µ": "u", "°": " deg", "…": "...", "(": "[", ")": "]", ";": ",", "%": " ", '"': "'", "{": "[", "}": "]"}


def plain(text: str) -> str:
    """Text that any control takes in a comment: one line, ASCII, no brackets or separators."""
    ascii_ = "".join(SPELLED.get(c, c) for c in text)
    return " ".join("".join(c if 32 <= ord(c) < 127 else "?" for c in ascii_).split())


def render(dialect: Dialect, name: str, steps: Sequence[Step], number: int = 1) -> str:
    """The program's text; `number` for controls that call programs by number."""
    lines = [line.format(name=_program_name(name), number=f"{number:04d}") for line in dialect.start]
    before: Mapping[str, float] = {}
    for step in steps:
        lines += _lines(dialect, step, before)
        before = step.positions or before
    lines += [line.format(name=_program_name(name)) for line in dialect.end]
    if dialect.numbered:
        lines = [f"{i} {line}" for i, line in enumerate(lines)]
    return "\n".join(lines) + "\n"


def _program_name(name: str) -> str:
    return "".join(c if c.isalnum() and c.isascii() else "_" for c in name).upper()[:24]


def _lines(dialect: Dialect, step: Step, before: Mapping[str, float]) -> list[str]:
    comment = dialect.comment.format(text=plain(step.text))
    words = " ".join(dialect.word(axis, round(value, dialect.decimals) + 0.0) for axis, value in step.positions.items())
    if step.kind == "comment":
        return [comment]
    if step.kind == "text":
        return [line for line in step.text.splitlines() if line.strip()]
    if step.kind == "stop":
        return [comment, dialect.stop]
    if step.kind == "dwell":
        return dialect.dwell.format(seconds=f"{step.seconds:.3f}").splitlines()
    if step.kind == "rapid":
        return [dialect.rapid.format(words=words)]
    note = [] if dialect.inverse_time else [dialect.comment.format(text=f"block time {step.seconds:.3f} s")]
    return [*note, dialect.feed.format(words=words, feed=_feed(dialect, step, before))]


def _feed(dialect: Dialect, step: Step, before: Mapping[str, float]) -> str:
    minutes = max(step.seconds, 1e-4) / 60.0
    if dialect.inverse_time:
        return f"{1.0 / minutes:.6g}"
    moved = {axis: value - before.get(axis, value) for axis, value in step.positions.items()}
    linear = math.hypot(*(d for axis, d in moved.items() if axis[0] in "XYZUVW"))
    way = linear or max((abs(d) for d in moved.values()), default=0.0)
    return f"{max(way / minutes, 1.0):.1f}"
