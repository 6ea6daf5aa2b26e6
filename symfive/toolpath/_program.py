"""An NC program as a tool path: modal codes, straight and circular blocks, sampled where the tool cuts.

Circular blocks: centre by I J K (from the start) or radius R, in the planes XY, ZX and YZ, with whatever else moves.
The words of a block (ISO 6983-1, LinuxCNC) are letters with plain numbers.
"""

from __future__ import annotations

import math
import re
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

import numpy as np

from symfive.arrays import Array
from symfive.errors import InputError
from symfive.files import read_text, shown
from symfive.machine import Machine
from symfive.toolpath._path import PROGRAM_LINEAR, STEP_DEG, STEP_MM, ToolPath

AXES = "XYZABCUVW"
_WORD = re.compile(r"\s*([A-Z])\s*([+-]?(?:\d+\.?\d*|\.\d+))")
_COMMENT = re.compile(r"\([^()]*\)|;.*")
POSTED = "post the program as plain ISO or LinuxCNC blocks"
SILENT = "NOFS"
"""Numbers of block and program, feed and speed: the tool's path is the same without them."""
MOTIONS = ("G0", "G1", "G2", "G3")
OFFSETS = ("G54", "G55", "G56", "G57", "G58", "G59")
HARMLESS = (
    "G9", "G15", "G40", "G50", "G61", "G61.1", "G64", "G69", "G80", "G91.1", "G93", "G94", "G95", "G96", "G97", "G98", "G99",
)  # fmt: skip
"""They change speed, or end what is not on."""
AWAY = ("G28", "G30", "G53")
"""The axes go where the machine file does not know: they have to be commanded anew before the tool cuts."""
BESIDE = {"G4": "PXU", "G43": "H", "G43.4": "H", "G64": "PQ", "G96": "D", "G97": "D"}
"""Words that belong to a code and move nothing."""
REFUSED = {
    "G5": "a spline is not read", "G10": "data set by the program are not read", "G41": "cutter compensation is not read",
    "G42": "cutter compensation is not read", "G43.5": "tool vectors are not read", "G51": "scaling is not read",
    "G52": "a shifted zero is not read", "G68": "a turned frame is not read", "G68.2": "a tilted plane is not read",
    "G90.1": "absolute centres of arcs are not read", "G92": "a shifted zero is not read",
    "M97": "a subprogram is not read", "M98": "a subprogram is not read", "M128": "M128 is not read",
    "M428": "switching of kinematics is not read", "M429": "switching of kinematics is not read",
    "M430": "switching of kinematics is not read",
}  # fmt: skip
TOOL_CENTRE = "post the program with the tool's centre in the workpiece (G43.4), straight blocks and arcs"
ENDS = ("M2", "M30", "M99")
MOST_PLACES = 20_000
PLANES = {"G17": ("X", "Y"), "G18": ("Z", "X"), "G19": ("Y", "Z")}
CENTRE = {"X": "I", "Y": "J", "Z": "K"}
OFF_MM, OFF_SHARE = 0.01, 1e-3
"""By so much may start and end differ in their distance from the centre: controls allow about as much."""


@dataclass(frozen=True)
class Block:
    """A block: its `line` from 1, the `modal` codes as `G43.4`, the numbers of `words` by letter."""

    line: int
    modal: tuple[str, ...]
    words: dict[str, float]

    def axes(self) -> dict[str, float]:
        """The words that name an axis."""
        return {letter: value for letter, value in self.words.items() if letter in AXES}

    def only(self, letters: str) -> None:
        """Raise `InputError` for a word whose letter is none of an axis or of `letters`."""
        for letter, value in self.words.items():
            if letter not in AXES + letters:
                raise InputError(f"the word {letter}{value:g} cannot be understood here", line=self.line, remedy=POSTED)


def block_of(text: str, line: int) -> Block:
    """The words of one line. Raises `InputError` with the line for what is no word."""
    rest = _COMMENT.sub(" ", text).upper().strip().removeprefix("/").strip()
    modal, words, place = list[str](), dict[str, float](), 0
    while place < len(rest):
        found = _WORD.match(rest, place)
        if found is None:
            raise _no_word(rest[place:].split(maxsplit=1)[0], line)
        letter, number = found[1], float(found[2])
        place = found.end()
        if letter in "GM":
            modal.append(f"{letter}{number:g}")
        elif letter in words:
            raise InputError(f"the word {letter} stands twice in the block", line=line, remedy=POSTED)
        elif letter not in SILENT:
            words[letter] = number
    return Block(line, tuple(modal), words)


def _no_word(text: str, line: int) -> InputError:
    if any(sign in text for sign in "#[<="):
        problem = f"{shown(text)} holds a parameter or an expression, which is not read"
        return InputError(problem, line=line, remedy="post the program with plain numbers")
    return InputError(f"{shown(text)} is no word with a number", line=line, remedy=POSTED)


def read_program(
    path: Path, machine: Machine, tool_length: float, zero: dict[str, float], *, tool_centre: bool = False
) -> ToolPath:
    """The places where a program cuts. Raises `InputError` with its line for what cannot be understood."""
    program = _Program(machine, tool_length, tool_centre)
    texts = read_text(path).split("\n")
    if not any(text.strip() for text in texts):
        raise InputError("the file is empty", path=path, line=1, remedy="give a program with G1, G2 or G3")
    for number, text in enumerate(texts, start=1):
        if text.strip() == "%":
            continue
        try:
            if program.ended(block_of(text, number)):
                break
        except InputError as error:
            raise error.at(path, line=number) from None
    if not program.stretches:
        raise InputError("the program never cuts", path=path, remedy="give a program with G1, G2 or G3")
    return program.path(path, zero)


class _Stretch(NamedTuple):
    """Places (n, axes) on which the tool cuts, in program words: how far `along`, in steps; `tip` whether XYZ are the tip's
    place, `lift` what is to be added to Z; whether it `begins` after a rapid move."""

    places: Array
    along: Array
    tip: bool
    lift: float
    line: int
    begins: bool


class _Program:
    """The state of a control while a program runs, and the stretches on which the tool cuts."""

    def __init__(self, machine: Machine, tool_length: float, tool_centre: bool) -> None:
        self.names = tuple(machine.axis_names)
        self.rotary = machine.rotary_axes
        along = {name: machine.axes[name].direction[i] for i, name in enumerate("XYZ") if name in machine.axes}
        self.signs = {name: math.copysign(1.0, part) for name, part in along.items()}
        self.tool_length, self.always, self.tip, self.lengthened = tool_length, tool_centre, tool_centre, False
        self.motion, self.plane, self.scale, self.incremental = "", PLANES["G17"], 1.0, False
        self.offset, self.tools = "", set[float]()
        unknown = [name for name in PROGRAM_LINEAR if name in self.names]
        self.now = dict.fromkeys(self.names, 0.0) | dict.fromkeys(unknown, math.nan)
        self.stretches: list[_Stretch] = []
        self.cutting = False

    def ended(self, block: Block) -> bool:
        """Run a block; whether the program ends with it."""
        codes = [code for code in block.modal if code.startswith("G")]
        for code in codes:
            self._set(code)
        for code in block.modal:
            if code in REFUSED:
                raise InputError(f"{code}: {REFUSED[code]}", remedy=TOOL_CENTRE)
        if "T" in block.words:
            self.tools.add(block.words["T"])
        beside = "T" + "".join(BESIDE.get(code, "") for code in codes)
        if "G4" in codes:
            return False
        self._move(block, codes, beside + ("PQLEDH" if len(codes) < len(block.modal) else ""))
        return any(code in ENDS for code in block.modal)

    def _set(self, code: str) -> None:
        """One code that stays in force. Raises `InputError` for one that is not known."""
        if code in MOTIONS:
            self.motion = code
        elif code in PLANES:
            self.plane = PLANES[code]
        elif code in ("G20", "G21"):
            self.scale = 25.4 if code == "G20" else 1.0
        elif code in ("G90", "G91"):
            self.incremental = code == "G91"
        elif code in OFFSETS:
            if self.offset not in ("", code):
                problem = f"the program cuts in {self.offset} and {code}"
                raise InputError(problem, remedy="give the part of one zero at a time")
            self.offset = code
        elif code in ("G43", "G43.4", "G49"):
            self._switch(code)
        elif code not in HARMLESS and code not in AWAY and code != "G4" and code not in REFUSED:
            raise InputError(f"{code} cannot be understood", remedy=TOOL_CENTRE)

    def _switch(self, code: str) -> None:
        """Tool length and tool-centre control: what X, Y and Z mean from here on, and which of them are to be commanded anew."""
        tip, lengthened = self.always or code == "G43.4", code != "G49"
        turned = any(self.now[name] != 0.0 for name in self.rotary)
        heights = ("Z",) if lengthened != self.lengthened and not self.always else ()
        lost = PROGRAM_LINEAR if tip != self.tip and turned else heights
        self.now |= {name: math.nan for name in lost if name in self.now}
        self.tip, self.lengthened = tip, lengthened

    def _move(self, block: Block, codes: list[str], beside: str) -> None:
        axes = block.axes()
        for name in axes:
            if name not in self.names:
                there = ", ".join(n for n in self.names if n in AXES)
                raise InputError(f"the machine has no axis {name}", remedy=f"its axes are {there}")
        arcs = self.motion in ("G2", "G3") and not any(code in AWAY for code in codes)
        block.only(beside + ("IJKR" if arcs else ""))
        centre = {letter: self.scale * value for letter, value in block.words.items() if letter in "IJKR"}
        if any(code in AWAY for code in codes):
            self.now |= dict.fromkeys(axes, math.nan)
            self.cutting = False
            return
        if not axes and not (arcs and centre):
            return
        if not self.motion:
            raise InputError("axes are commanded before G0, G1, G2 or G3", remedy="begin the program with one of them")
        target = dict(self.now)
        for name, word in axes.items():
            value = word * (1.0 if name in self.rotary else self.scale)
            target[name] = self.now[name] + value if self.incremental else value
        if self.motion != "G0":
            self._cut(target, centre if arcs else None, block.line)
        self.cutting, self.now = self.motion != "G0", target

    def _cut(self, target: dict[str, float], centre: dict[str, float] | None, line: int) -> None:
        """A stretch from where the tool stands to `target`."""
        unknown = next((name for name in self.names if math.isnan(self.now[name] + target[name])), None)
        if unknown is not None:
            problem = f"the tool cuts before the place of {unknown} is known"
            raise InputError(problem, remedy=f"command {unknown} by G0 before it, after every change of what it means")
        start, end = (np.array([place[name] for name in self.names]) for place in (self.now, target))
        straight = [i for i, name in enumerate(self.names) if name not in self.rotary]
        length = float(np.linalg.norm((end - start)[straight]))
        turned = float(np.abs(np.delete(end - start, straight)).max(initial=0.0))
        shape = None
        if centre is not None:
            if not {"X", "Y", "Z"} <= set(self.names):
                raise InputError("arcs need axes X, Y and Z", remedy="give straight blocks")
            shape = arc(self.now, target, self.plane, centre, self.motion == "G2")
            other = next(i for i in straight if self.names[i] in {"X", "Y", "Z"} - set(self.plane))
            length = math.hypot(shape[1] * shape[2], (end - start)[other])
        steps = max(length / STEP_MM, turned / STEP_DEG)
        shares = np.linspace(0.0, 1.0, max(1, math.ceil(steps)) + 1)[0 if not self.cutting else 1 :]
        places = start + shares[:, None] * (end - start)
        if shape is not None:
            middle, radius, turn = shape
            (first, second), (i, j) = self.plane, (self.names.index(n) for n in self.plane)
            begin = math.atan2(self.now[second] - middle[second], self.now[first] - middle[first])
            places[:, i] = middle[first] + radius * np.cos(begin + turn * shares)
            places[:, j] = middle[second] + radius * np.sin(begin + turn * shares)
        lift = 0.0 if self.tip else self.lengthened * self.tool_length
        self.stretches.append(_Stretch(places, shares * steps, self.tip, lift, line, not self.cutting))

    def path(self, file: Path, zero: dict[str, float]) -> ToolPath:
        """Places of all stretches, as many as a path needs: one every step, and the first after every rapid move."""
        counts = [len(stretch.places) for stretch in self.stretches]
        places = np.concatenate([stretch.places for stretch in self.stretches])
        tip, lift, line = (
            np.repeat([getattr(s, name) for s in self.stretches], counts) for name in ("tip", "lift", "line")
        )
        begun = np.zeros(len(places), dtype=bool)
        begun[np.cumsum([0, *counts[:-1]])] = [stretch.begins for stretch in self.stretches]
        ends = np.cumsum([stretch.along[-1] for stretch in self.stretches])
        along = np.concatenate([s.along + end - s.along[-1] for s, end in zip(self.stretches, ends, strict=True)])
        step = max(1.0, float(along[-1]) / MOST_PLACES)
        number = np.floor(along / step + 1e-9)
        kept = np.flatnonzero(begun | np.append(number[1:] != number[:-1], True))
        position = {name: places[kept, i].copy() for i, name in enumerate(self.names)}
        for name, shift in zero.items():
            if name in position:
                position[name] += np.where(tip[kept], 1.0, self.signs[name]) * shift
        if "Z" in position:
            position["Z"] += self.signs["Z"] * lift[kept]
        return ToolPath(
            file, line[kept].astype(np.int64), position, tip[kept], self.tool_length, step, notes=self._notes()
        )

    def _notes(self) -> tuple[str, ...]:
        if len(self.tools) < 2:
            return ()
        count, length = len(self.tools), self.tool_length
        return (f"the part's program calls {count} tools; all count as {length:g} mm long (--part-tool)",)


def arc(
    start: dict[str, float], end: dict[str, float], plane: tuple[str, str], words: dict[str, float], clockwise: bool
) -> tuple[dict[str, float], float, float]:
    """The centre (the plane's two axes), radius and signed angle (rad) of an arc. Raises `InputError` for one that is none."""
    a, b = (np.array([p[name] for name in plane]) for p in (start, end))
    if "R" in words:
        centre = _centre_by_radius(a, b, words["R"], clockwise)
    else:
        centre = a + np.array([words.get(CENTRE[name], 0.0) for name in plane])
    radius, other = float(np.hypot(*(a - centre))), float(np.hypot(*(b - centre)))
    if radius == 0.0:
        raise InputError("the arc has no radius", remedy="give its centre by I, J, K from the start, or R")
    if abs(radius - other) > max(OFF_MM, OFF_SHARE * radius):
        problem = f"the arc begins {radius:.4g} mm from its centre and ends {other:.4g} mm from it"
        raise InputError(problem, remedy="give the centre by I, J, K from the start (G91.1)")
    begin, last = (math.atan2(*(p - centre)[::-1]) for p in (a, b))
    turn = (begin - last if clockwise else last - begin) % (2.0 * math.pi)
    turn = 2.0 * math.pi if np.allclose(a, b, atol=1e-9) else turn
    return dict(zip(plane, map(float, centre), strict=True)), radius, -turn if clockwise else turn


def _centre_by_radius(a: Array, b: Array, radius: float, clockwise: bool) -> Array:
    """R > 0: the arc of at most half a turn, R < 0: the other one."""
    chord = b - a
    length = float(np.hypot(*chord))
    if length < 1e-9:
        raise InputError("an arc with R ends where it begins", remedy="give a whole circle by I, J, K")
    if 0.5 * length > abs(radius) + OFF_MM:
        problem = f"the arc's ends are {length:.4g} mm apart, more than twice its radius R of {abs(radius):.4g} mm"
        raise InputError(problem, remedy="correct R or the end")
    height = math.sqrt(max(radius**2 - 0.25 * length**2, 0.0))
    left = np.array([-chord[1], chord[0]]) / length
    side = -1.0 if clockwise == (radius > 0.0) else 1.0
    return np.asarray(0.5 * (a + b) + side * height * left)
