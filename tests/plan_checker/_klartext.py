"""Reads Heidenhain Klartext. A word that is not known is a finding."""

import re

import numpy as np

from ._events import Arc, Control
from ._touching import Touching

AXIS = re.compile(r"\b(I?)([XYZABCUVW])([-+]\d+(?:\.\d*)?)(?!\w)")
KNOWN = (
    (r"BEGIN PGM \S+ MM", "MM"), (r"END PGM \S+ MM", ""), (r"FUNCTION RESET TCPM", "TCP off"), (r"M129", "TCP off"),
    (r"FUNCTION TCPM .*", "TCP on"), (r"M128.*", "TCP on"), (r"PLANE RESET (STAY|MOVE|TURN).*", "PLANE RESET"),
    (r"CYCL DEF 247 .*", "datum"), (r"Q339=.*", ""), (r"CYCL DEF 7\.0 DATUM SHIFT", ""), (r"CYCL DEF 7\.\d .*", "datum shift"),
    (r"TRANS DATUM RESET", "no shift"),
    (r"TRANS DATUM .*", "datum shift"), (r"CYCL DEF 10\.\d .*", "rotation"), (r"CYCL DEF 32\.\d .*", ""), (r"BLK FORM .*", ""),
    (r"CYCL DEF 19\.\d .*", "PLANE RESET"), (r"CYCL DEF 9\.0 DWELL TIME", ""), (r"CYCL DEF 13\.0 ORIENTATION", ""),
    (r"M19", ""), (r"M5", "M5"), (r"M9", ""), (r"M126|M127", ""),
)  # fmt: skip


class Klartext:
    """One program: `read` goes through its lines and leaves events and findings in the control."""

    def __init__(self, control: Control) -> None:
        self.control = control
        self.centre: dict[str, float] = {}
        self.comment = ""
        self.touching, self.labels = Touching(control, "heidenhain"), set[str]()

    def read(self, text: str) -> None:
        """All lines, counted from 1."""
        lines = [re.sub(r"^\s*\d+\s+", "", line).strip() for line in text.splitlines()]
        for number, line in enumerate(lines, 1):
            if any(event.kind == "end" for event in self.control.events):
                self._after_the_end(line)
            elif not self.touching.takes(number, line):
                self._line(number, line)
        for label in sorted(self.touching.labels - self.labels):
            self.control.fault(
                len(lines), f"LBL {label} is called and does not stand behind the end of the program", "probing"
            )

    def _after_the_end(self, line: str) -> None:
        """Labels to which a fault leads."""
        if found := re.fullmatch(r"LBL (\d+)", line):
            self.labels.add(found[1])

    def _line(self, number: int, line: str) -> None:
        control = self.control
        code, _, comment = line.partition(";")
        code = code.strip().rstrip("~").strip()
        if not code:
            self.comment = comment.strip() or self.comment
            return
        if re.fullmatch(r"STOP( M0)?|M0", code):
            control.say("stop", number, comment.strip() or self.comment)
        elif found := re.fullmatch(r"CYCL DEF 13\.1 ANGLE ([-\d.]+)", code):
            control.say("orient", number, found[1])
        elif found := re.fullmatch(r"CYCL DEF 9\.1 DWELL (?:TIME)?\s*([\d.]+)", code):
            control.say("dwell", number, seconds=float(found[1]))
        elif found := re.fullmatch(r"TOOL CALL (\S+) Z.*", code):
            control.length_on = found[1] != "0"
            control.switch(number, "length on" if control.length_on else "length off")
        elif code in ("M30", "M2"):
            control.say("end", number)
        elif found := re.fullmatch(r"L M140 MB (MAX|[\d.]+)( FMAX)?", code):
            control.retract(number, {control.machine.names[control.machine.tool_axis]: found[1]})
        elif re.match(r"(L|C|CP|CC) ", code):
            self._path(number, code)
        else:
            self._other(number, code)
        self.comment = ""

    def _other(self, number: int, code: str) -> None:
        fact = next((fact for pattern, fact in KNOWN if re.fullmatch(pattern, code)), None)
        if fact is None:
            self.control.fault(number, f"the checker cannot read {code!r}")
        elif fact:
            self.control.centred = {"TCP on": True, "TCP off": False}.get(fact, self.control.centred)
            self.control.switch(number, fact)

    def _path(self, number: int, code: str) -> None:
        control = self.control
        kind, rest = code.split(" ", 1)
        words = {("I" if i else "") + axis: float(value) for i, axis, value in AXIS.findall(rest)}
        for _, _, value in AXIS.findall(rest):
            control.wrote(value)
        rest = AXIS.sub(" ", rest)
        if kind == "CC":
            self.centre = words
            return
        rapid = bool(re.search(r"\bFMAX\b", rest))
        if found := re.search(r"\bF(\d+(?:\.\d*)?)\b", rest):
            control.feed = float(found[1])
        machine = bool(re.search(r"\bM91\b", rest))
        turn = re.search(r"\bIPA([-+][\d.]+)", rest)
        sense = re.search(r"\bDR([-+])", rest)
        left = re.sub(r"\b(FMAX|F\d+(\.\d*)?|R0|M91|IPA[-+][\d.]+|DR[-+])(?!\w)", " ", rest).strip()
        if left:
            control.fault(number, f"the checker cannot read {left!r}")
        if machine:
            control.retract(number, {**words})
        elif kind == "L":
            absolute = {axis: value for axis, value in words.items() if len(axis) == 1}
            incremental = {axis[1]: value for axis, value in words.items() if len(axis) == 2}
            if absolute and incremental:
                control.fault(number, "absolute and incremental words in one block")
            control.move("rapid" if rapid else "feed", number, absolute or incremental, incremental=bool(incremental))
        else:
            self._circle(number, words, float(turn[1]) if turn else None, -1.0 if sense and sense[1] == "-" else 1.0)

    def _circle(self, number: int, words: dict[str, float], turn: float | None, sense: float) -> None:
        """C with an end or CP with IPA about the pole of CC."""
        control, names = self.control, sorted(self.centre)
        if len(names) != 2:
            control.fault(number, "an arc without a centre of two axes (CC)")
            return
        if names == ["X", "Z"]:
            names = ["Z", "X"]
        i, j = (control.machine.names.index(n) for n in names)
        start = control.here()
        length = [control.tool_length if control.length_on and k == control.machine.tool_axis else 0.0 for k in (i, j)]
        centre = (self.centre[names[0]] + length[0], self.centre[names[1]] + length[1])
        if turn is None:
            end, _ = control.to_axes(words, False, number)
            first, last = (np.arctan2(p[j] - centre[1], p[i] - centre[0]) for p in (start, end))
            sweep = sense * ((sense * (last - first)) % (2.0 * np.pi) or 2.0 * np.pi)
            control.move("feed", number, words, arc=Arc((i, j), centre, float(sweep)))
            return
        sweep = sense * abs(np.deg2rad(turn))
        angle = np.arctan2(start[j] - centre[1], start[i] - centre[0]) + sweep
        size = np.hypot(start[i] - centre[0], start[j] - centre[1])
        ends = centre[0] + size * np.cos(angle) - length[0], centre[1] + size * np.sin(angle) - length[1]
        control.move(
            "feed",
            number,
            {**words, names[0]: float(ends[0]), names[1]: float(ends[1])},
            arc=Arc((i, j), centre, sweep),
        )
