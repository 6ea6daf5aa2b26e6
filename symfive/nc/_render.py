"""A program's text from its steps, in the words of a dialect."""

from __future__ import annotations

import math
import textwrap
from collections.abc import Mapping, Sequence

from symfive.nc._base import Block, Dialect, Step

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
        lines = [f"{dialect.numbered.format(block=i)} {line}" for i, line in enumerate(lines)]
    return "\n".join(lines) + "\n"


def program_name(name: str) -> str:
    """A name that every control takes: 24 capitals, digits and _."""
    return "".join(c if c.isalnum() and c.isascii() else "_" for c in name).upper()[:24]


def _lines(dialect: Dialect, step: Step, before: Mapping[str, float], *, timed: bool) -> list[str]:
    text = plain(step.text)
    text = text.upper() if dialect.upper else text
    words = dialect.words(step.positions)
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
        lines = dialect.contour if step.text else dialect.steady
        return [line.format(plane=PLANES.get(step.text, "")) for line in lines]
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
        dialect.words(dict(sorted(positions.items()))) for positions in (step.positions, step.centre, offset)
    )
    return Block(
        code="G3" if step.sweep > 0.0 else "G2", words=end, pole=pole, offset=centre, sweep=step.sweep,
        turns=math.ceil(abs(step.sweep) / 360.0 - 1e-9), feed=f"{step.feed:g}",
    )  # fmt: skip


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
