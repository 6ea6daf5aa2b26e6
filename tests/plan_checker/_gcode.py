"""Reads ISO (Fanuc-like), LinuxCNC and Siemens programs. A word that is not known is a finding, never passed over."""

import re
from dataclasses import dataclass, field
from itertools import pairwise

import numpy as np

from ._events import Arc, Control
from ._touching import Touching
from .dialects import DIALECTS

WORD = re.compile(
    r"([A-Z])\s*(?:=\s*)?([-+]?(?:\d+\.?\d*|\.\d+))|([A-Z][A-Z0-9_]*)(?:\s*=\s*([A-Z_][A-Z0-9_]*|[-+]?[\d.]+))?"
)
MACRO_TEXT = 26
"""Characters of #3006 that the screen shows."""
PLANES = {"17": ("X", "Y"), "18": ("Z", "X"), "19": ("Y", "Z")}
SETTINGS = re.compile(r"17|18|19|21|40|49|50|6[01]|61\.1|64|69|71|80|9[012]\.1|500|60[1-3]|64[25]|710|43|9[0134]")
NAMED = {
    "TOROTOF", "PAROTOF", "STOPRE", "DIAMOF", "SOFT", "BRISK", "FFWON", "FFWOF", "COMPOF", "ORIMKS",
    "ORIWKS", "CYCLE800", "TRANS", "ROT", "SUPA",
}  # fmt: skip
BY_OPERATOR = re.compile(r"TURN SPINDLE TO ([-\d.]+) DEG")
"""A stop at which the operator turns the spindle, where the control has no words for it."""
IGNORED_M = {"2", "5", "9", "19", "30", "17", "62", "63", "64", "65"}


@dataclass
class Block:
    """Words of a line: `g` and `m` codes, `axes`, other addresses, names without a number, comment and message on the screen."""

    line: int
    g: list[str] = field(default_factory=list)
    m: list[str] = field(default_factory=list)
    axes: dict[str, float | str] = field(default_factory=dict)
    other: dict[str, float] = field(default_factory=dict)
    names: list[str] = field(default_factory=list)
    comment: str = ""
    message: str | None = None


SWITCHED_MM = 2e-4


class GCode:
    """One program: `read` goes through its lines and leaves events and findings in the control."""

    def __init__(self, control: Control, dialect: str) -> None:
        self.control, self.words = control, DIALECTS[dialect]
        self.motion, self.plane, self.incremental = "", "17", False
        self.shown, self.last_comment, self.literal = "", "", ""
        self.touching = Touching(control, dialect)

    def read(self, text: str) -> None:
        """All lines, counted from 1."""
        for number, line in enumerate(text.splitlines(), 1):
            self._line(number, line.strip())

    def _line(self, number: int, line: str) -> None:
        if not line or line == "%" or self.touching.takes(number, line):
            return
        self.literal, line = line, self.touching.substituted(line)
        block = self._split(number, line)
        if block.message is not None:
            self.shown = block.message
        self._states(block)
        self._stops(block)
        self._motion(block)
        if block.g or block.m or block.axes or block.names:
            self.last_comment = ""
        elif block.comment:
            self.last_comment = block.comment

    def _split(self, number: int, line: str) -> Block:
        block = Block(number)
        if found := re.search(self.words.message, line, re.I) if self.words.message else None:
            block.message = found["text"]
            if self.words.stops and len(found["text"]) > MACRO_TEXT:
                self.control.fault(
                    number, f"#3006 shows {MACRO_TEXT} characters, the text has {len(found['text'])}", "stop"
                )
            line = line[: found.start()] + (" M0 " if self.words.stops else " ") + line[found.end() :]
        if self.words.comment == ";":
            line, _, block.comment = line.partition(";")
        else:
            block.comment = " ".join(re.findall(r"\(([^)]*)\)", line)).strip()
            line = re.sub(r"\([^)]*\)", " ", line)
        line = line.upper().replace("()", "")
        rest = WORD.sub(lambda found: self._word(block, found), line)
        if rest.strip():
            self.control.fault(number, f"the checker cannot read {rest.strip()!r}")
        return block

    def _word(self, block: Block, found: re.Match[str]) -> str:
        letter, value, name, given = found.groups()
        if letter is None:
            self._name(block, name, given)
            return " "
        if letter in "GM":
            (block.g if letter == "G" else block.m).append(re.sub(r"^0+(?=\d)", "", value))
        elif letter in "XYZABCUVW" and not (letter in "XU" and "4" in block.g):
            block.axes[letter] = float(value)
            if value in self.literal:
                self.control.wrote(value)
        elif letter not in "NO":
            block.other[letter] = float(value)
        return " "

    def _name(self, block: Block, name: str, given: str | None) -> None:
        if given is not None and len(name) == 1:
            block.axes[name] = given
        elif given is not None:
            block.other[name] = float(given) if re.fullmatch(r"[-+]?[\d.]+", given) else np.nan
        else:
            block.names.append(name)

    def _states(self, block: Block) -> None:
        control = self.control
        for code in block.g:
            if code in ("90", "91"):
                self.incremental = code == "91"
            if code in PLANES:
                self.plane = code
            if code in ("93", "94"):
                control.inverse_time = code == "93"
            if code in ("43", self.words.no_length):
                control.length_on = code == "43"
            self._centre(block.line, code)
            if re.fullmatch(self.words.datum, code):
                control.switch(block.line, "datum")
            elif SETTINGS.fullmatch(code) or code in self._own or re.fullmatch(self.words.known, code):
                control.switch(block.line, f"G{code}")
            elif code not in ("0", "1", "2", "3", "4", "28", "30", "75", *self.words.machine):
                control.fault(block.line, f"the checker does not know G{code}")
        for name in block.names:
            self._centre(block.line, name)
            if name not in NAMED and name not in self._own:
                control.fault(block.line, f"the checker does not know {name}")
            if name != "SUPA":
                control.switch(block.line, name)
        if "D" in block.other:
            control.length_on = block.other["D"] != 0.0
            control.switch(block.line, f"D{int(block.other['D'] != 0.0)}")
        if "F" in block.other and "4" not in block.g:
            control.feed = block.other["F"]
        elif (
            control.inverse_time
            and block.axes
            and (set(block.g) & {"1", "2", "3"} or (not block.g and self.motion != "0"))
        ):
            control.feed = 0.0  # G93 wants F in every block

    @property
    def _own(self) -> set[str]:
        """The control's words for tool-centre control and for no tool length."""
        return {*self.words.centre, self.words.no_length}

    def _centre(self, line: int, word: str) -> None:
        """Tool-centre control goes on or off."""
        control, (on, off) = self.control, self.words.centre
        if word == on:
            control.centre(as_it_stands=self.words.frame_of_start)
            control.switch(line, "TCP on")
        elif word == off:
            control.centred = False

    def _stops(self, block: Block) -> None:
        control = self.control
        for code in block.m:
            if code in ("0", "1"):
                text = self._text(block)
                turned = BY_OPERATOR.fullmatch(text)
                control.say("orient" if turned else "stop", block.line, turned[1] if turned else text)
            elif code == "19" and "R" in block.other:
                control.say("orient", block.line, f"{block.other['R']:g}")
            elif code not in IGNORED_M:
                control.fault(block.line, f"the checker does not know M{code}")
            if code in ("2", "30"):
                control.say("end", block.line)
            if code == "5":
                control.switch(block.line, "M5")
        if "SPOS" in block.other:
            control.say("orient", block.line, f"{block.other['SPOS']:g}")
        if "4" in block.g:
            seconds = block.other.get(self.words.dwell)
            if self.words.dwell == "X" and seconds is None:
                seconds = block.other.get("U", block.other.get("P", np.nan) / 1000.0)
            if seconds is None or not np.isfinite(seconds):
                control.fault(block.line, "a dwell without a time")
            control.say("dwell", block.line, seconds=float(seconds or 0.0))

    def _text(self, block: Block) -> str:
        """What this control shows while it stands: a message, on some also the comment at the stop."""
        shown = self.shown if not self.words.reads_comment or block.message else block.comment or self.last_comment
        if not self.words.held:
            self.shown = ""
        return shown

    def _motion(self, block: Block) -> None:
        control = self.control
        for code in block.g:
            if code in ("0", "1", "2", "3"):
                self.motion = code
        if not block.axes:
            return
        if set(block.g) & {"28", "30", "75"}:
            if {"28", "30"} & set(block.g) and not (self.incremental and all(v == 0.0 for v in block.axes.values())):
                control.fault(
                    block.line, "the reference point is reached by way of a position in the block", "first move"
                )
            control.retract(block.line, dict.fromkeys(block.axes, 0.0))
            return
        if {*block.g, *block.names} & {*self.words.machine}:
            if self.motion != "0":
                control.fault(block.line, "machine coordinates at a feed are not expected")
            control.retract(block.line, block.axes)
            return
        words = {axis: value for axis, value in block.axes.items() if isinstance(value, float)}
        if len(words) < len(block.axes) or not self.motion:
            control.fault(block.line, "axis words without a number, or before any of G0 to G3")
            return
        if self._own & set(block.g):  # the place where the axes stand, in the words from here on
            away = float(np.abs(control.to_axes(words, False, block.line)[0] - control.here()).max())
            if not away < SWITCHED_MM:
                control.fault(block.line, f"the tool moves by {away:g} where its length is switched", "first move")
        elif self.motion in "01":
            control.move("feed" if self.motion == "1" else "rapid", block.line, words, incremental=self.incremental)
        else:
            arc = self._arc(block, words)
            control.move("feed", block.line, words, incremental=self.incremental, arc=arc)

    def _arc(self, block: Block, words: dict[str, float]) -> Arc | None:
        """From I J K, incremental to the centre; further turns as the dialect says them."""
        control, names = self.control, PLANES[self.plane]
        i, j = (control.machine.names.index(n) for n in names)
        start = control.here()
        end, _ = control.to_axes(words, self.incremental, block.line)
        offset = [block.other.get({"X": "I", "Y": "J", "Z": "K"}[n], 0.0) for n in names]
        centre = (start[i] + offset[0], start[j] + offset[1])
        radii = [float(np.hypot(p[i] - centre[0], p[j] - centre[1])) for p in (start, end)]
        if not {"I", "J", "K"} & set(block.other) or not np.isfinite(radii).all() or abs(radii[0] - radii[1]) > 0.01:
            control.fault(block.line, f"an arc whose ends lie {radii[0]:.4f} and {radii[1]:.4f} mm from its centre")
            return None
        angles = [np.arctan2(p[j] - centre[1], p[i] - centre[0]) for p in (start, end)]
        sense = 1.0 if self.motion == "3" else -1.0
        sweep = float(next(b - a for a, b in pairwise(angles)) * sense) % (2.0 * np.pi)
        sweep = 2.0 * np.pi if sweep < 1e-6 or sweep > 2.0 * np.pi - 1e-6 else sweep
        address, one = self.words.turns
        turns = block.other.get(address, one) - one
        return Arc((i, j), centre, sense * (sweep + 2.0 * np.pi * turns))
