"""Touch probes: how each control's words for a touch are read, and what a probing program must do.

    probing     every move towards the sphere stops on contact and is looked at before the next one; what moves without that
                goes away from the sphere or back along a way just proven
    touch       each row of the run is touched in the declared directions: the line goes through the sphere's centre, begins
                off it and ends behind its surface, fast first, then slowly, and the log says which touch it was
    clear       no rotary axis moves and no rapid passes near the sphere

The tip meets the sphere of which the program's head says the radius, the machine being nominal.
"""

import re
from collections.abc import Iterator
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from ._events import Control, Event, Finding
from ._path import Path

Array = NDArray[np.float64]
RADII = re.compile(r"sphere radius ([\d.]+), tip radius ([\d.]+)", re.I)
NUMBER = r"([-+]?\d+\.?\d*)"
MOVES = {
    "linuxcnc": re.compile(r"G38\.(?P<kind>[23]) (?P<words>.*)"),
    "iso": re.compile(r"G31 (?P<words>.*)"),
    "siemens": re.compile(r"MEAS=1 G1 (?P<words>.*)"),
}
LOOKS = {
    "iso": re.compile(
        rf"IF\[\[ABS\[#5061{NUMBER}\]\+ABS\[#5062{NUMBER}\]\+ABS\[#5063{NUMBER}\]\](?P<sign>GT|LT)0\.02\]"
        r"THEN #3000=\d\((?P<says>.{1,26})\)"
    ),
    "siemens": re.compile(r"IF \$AC_MEA\[1\]==(?P<sign>[01]) GOTOB (?P<says>\w+)"),
    "heidenhain": re.compile(r"FN (?P<sign>9: IF \+Q4 EQU|10: IF \+Q4 NE) -1 GOTO LBL (?P<says>\d+)"),
}
GUARDED = ("GT", "1", "10: IF +Q4 NE", "3")
LOGS = {
    "linuxcnc": re.compile(r"\(LOG,(\d+),(\d+),#5061,#5062,#5063\)"),
    "iso": re.compile(r"DPRNT\[R(\d+)T(\d+)X#5061\[44\]Y#5062\[44\]Z#5063\[44\]\]"),
    "siemens": re.compile(
        r'WRITE\(FAULT,"(\w{1,24})","R(\d+) T(\d+) X"<<\$AA_MW\[X\]<<" Y"<<\$AA_MW\[Y\]<<" Z"<<\$AA_MW\[Z\]\)'
    ),
}
OPENED = {"linuxcnc": r"\(LOGOPEN,.+\)", "iso": "POPEN", "siemens": r'DELETE\(FAULT,"(\w+)"\)'}
CLOSED = {"linuxcnc": r"\(LOGCLOSE\)", "iso": "PCLOS"}
ON_CONTACT = re.compile(r"([XYZ])(?:\[#506([123])|=\$AA_MW\[([XYZ])\])([-+][\d.]+)\]?")
MASK = '"R%1.0LF T%1.0LF X%1.5LF Y%1.5LF Z%1.5LF",Q10,Q11,Q1,Q2,Q3;\n'
FIVE = ((0.0, 0.0, 1.0), (1.0, 0.0, 0.0), (-1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, -1.0, 0.0))
OFF_MM = 5.0
"""What a rapid and a turning axis keep off the sphere."""
NEAR_MM = 20.0
"""Within this of the sphere moves stop on contact."""
AIM_MM = 1.0
"""A touch begins so far off the surface, and ends so far behind it, at least."""
BESIDE_MM = 0.01
BACK = 300.0
"""mm/min at which a control goes back by itself, at least."""
SLOW = 100.0
"""mm/min of the touch that counts."""


class Touching:
    """State of a control while it probes: the move not yet looked at, the last contact, the log."""

    def __init__(self, control: Control, dialect: str) -> None:
        self.control, self.dialect = control, dialect
        self.reach = np.nan
        self.pending: tuple[int, str, dict[str, float], float, float] | None = None
        self.contact: dict[str, float] = {}
        self.file, self.labels, self.skips = "", set[str](), ""
        self.cycle: dict[str, str] = {}
        self.registers: dict[str, str] = {}

    def takes(self, number: int, line: str) -> bool:
        """Whether the line is one of probing, which then is done. What the rest says of the contact is worth `substituted`."""
        if found := RADII.search(line):
            self.reach = float(found[1]) + float(found[2])
        if self.skips:
            self._skipped(line)
            return True
        if self.pending and line != "STOPRE" and not self._looks(number, line):
            self.control.fault(number, "the move before this one is not looked at: was there a contact?", "probing")
            self.pending = None
        elif self.pending is None and LOOKS.get(self.dialect) and LOOKS[self.dialect].fullmatch(line):
            return True  # just done
        words = getattr(self, f"_{self.dialect}", None)  # of dialects that probe
        return words is not None and bool(words(number, line))

    def substituted(self, line: str) -> str:
        """The line with the places of the last contact as numbers."""

        def place(found: re.Match[str]) -> str:
            axis = "XYZ"[int(found[2]) - 1] if found[2] else found[3]
            if axis != found[1]:
                return found[0]
            return f"{axis}{self.contact.get(axis, np.nan) + float(found[4]):.9f}"

        return ON_CONTACT.sub(place, line)

    def _linuxcnc(self, number: int, line: str) -> bool:
        if found := MOVES["linuxcnc"].fullmatch(line):
            words, feed = self._words(found["words"])
            self._done(number, "guarded" if found["kind"] == "3" else "touch", words, feed)
            return True
        return self._log(number, line)

    def _iso(self, number: int, line: str) -> bool:
        return self._remembered(number, line) or self._log(number, line)

    def _siemens(self, number: int, line: str) -> bool:
        if line.startswith("GOTOF "):
            self.skips = line.removeprefix("GOTOF ") + ":"
            return True
        if line in ("STOPRE", "DEF INT FAULT"):
            return True
        if found := re.fullmatch(r"IF FAULT<>0 GOTOB (\w+)", line):
            self._known(number, found[1])
            return True
        return self._remembered(number, line) or self._log(number, line)

    def _heidenhain(self, number: int, line: str) -> bool:
        if found := re.fullmatch(r"TCH PROBE 4\.([0-3]) (.*)", line):
            self.cycle[found[1]] = found[2]
            if found[1] == "3":
                self._vector(number)
            return True
        if found := re.fullmatch(r"FN 0: (Q1[01]) = \+(\d+)", line):
            self.registers[found[1]] = found[2]
            return True
        if found := re.fullmatch(r"FN 16: F-PRINT TOUCHES\.A / (\w{1,24}\.TXT)", line):
            mask = self.control.file.parent / "TOUCHES.A"
            if not mask.exists() or mask.read_text() != MASK:
                self.control.fault(number, "TOUCHES.A beside the program does not print row, touch and place", "touch")
            self.control.say("log", number, f"{self.registers.pop('Q10', '?')},{self.registers.pop('Q11', '?')}")
            return True
        if line == "CYCL DEF 7.1 Z-Q114":
            self.control.length_on = False
            self.control.switch(number, "length taken out")
            return True
        return line == "CYCL DEF 7.0 DATUM SHIFT"

    def _skipped(self, line: str) -> None:
        if line == self.skips:
            self.skips = ""
        elif found := re.match(r"(\w+): MSG\(", line):
            self.labels.add(found[1])

    def _known(self, number: int, label: str) -> None:
        if label not in self.labels:
            self.control.fault(number, f"label {label} does not stand before this line", "probing")

    def _words(self, text: str) -> tuple[dict[str, float], float]:
        words = {axis: float(value) for axis, value in re.findall(rf"\b([XYZF])=?{NUMBER}", text)}
        return words, words.pop("F", np.nan)

    def _remembered(self, number: int, line: str) -> bool:
        found = MOVES[self.dialect].fullmatch(line)
        if found is None:
            return False
        words, feed = self._words(found["words"])
        self.pending = (number, line, words, feed, 0.0)
        return True

    def _vector(self, number: int) -> None:
        """TCH PROBE 4: along a vector by ABST, back by MB."""
        ways = re.fullmatch(rf"IX{NUMBER} IY{NUMBER} IZ{NUMBER}", self.cycle.get("2", ""))
        how = re.fullmatch(rf"ABST\+?{NUMBER} F{NUMBER} MB{NUMBER} REFERENCE SYSTEM:0", self.cycle.get("3", ""))
        if not ways or not how or self.cycle.get("1") != "Q1":
            self.control.fault(number, f"the checker cannot read TCH PROBE 4 {self.cycle}")
            return
        vector = np.array([float(v) for v in ways.groups()])
        far, feed, back = (float(v) for v in how.groups())
        here = self.control.here()[self.control.linear]
        place = here + far * vector / np.linalg.norm(vector)
        self.cycle = {}
        self.pending = (number, "", dict(zip("XYZ", place.tolist(), strict=True)), feed, back)

    def _looks(self, number: int, line: str) -> bool:
        """Whether this line asks for the contact of the move before it; then that move is done."""
        found = LOOKS[self.dialect].fullmatch(line) if self.dialect in LOOKS else None
        if found is None or self.pending is None:
            return False
        at, _, words, feed, back = self.pending
        if self.dialect == "iso":
            ends = [-float(v) for v in found.groups()[:3]]
            if np.abs(np.array(ends) - [words[axis] for axis in "XYZ"]).max() > 6e-4:
                self.control.fault(
                    number, "compares the place of the contact with another place than the move's end", "probing"
                )
        elif self.dialect == "siemens":
            self._known(number, found["says"])
        else:
            self.labels.add(found["says"])
        self.pending = None
        self._done(at, "guarded" if found["sign"] in GUARDED else "touch", words, feed, back)
        return True

    def _done(self, number: int, kind: str, words: dict[str, float], feed: float, back: float = 0.0) -> None:
        """The move, to its end or, of a touch, to the sphere, and back."""
        control = self.control
        start, aim = control.here(), control.to_axes(words, False, number)[0]
        control.feed = feed
        if kind == "guarded":
            control.move("feed", number, words)
            control.events[-1] = replace(control.events[-1], probing=kind, aim=aim)
            return
        share = self._meets(start, aim)
        if not np.isfinite(share):
            control.fault(number, "the touch does not meet the sphere", "touch")
            share = 1.0
        contact = start + share * (aim - start)
        self.contact = {axis: float(contact[control.machine.names.index(axis)]) for axis in "XYZ"}
        control.move("feed", number, self.contact)
        control.events[-1] = replace(control.events[-1], probing=kind, aim=aim)
        if back:
            gone = min(back, float(np.linalg.norm(contact - start)))
            place = contact + gone * (start - contact) / np.linalg.norm(start - contact)
            control.feed = max(feed, BACK)
            control.move("feed", number, {a: float(place[control.machine.names.index(a)]) for a in "XYZ"})
            control.events[-1] = replace(control.events[-1], probing="back")

    def _meets(self, start: Array, aim: Array) -> float:
        """Share of a way (axes) at which the tip meets the sphere; NaN where it does not."""
        control = self.control
        a, b = (
            control.machine.points(np.stack([start, aim]), control.run.tool_ball[None])[:, 0] - control.run.table_ball
        )
        way = b - a
        half, rest = float(a @ way) / float(way @ way), float(a @ a - self.reach**2) / float(way @ way)
        found = -half - np.sqrt(half**2 - rest) if half**2 > rest else np.nan
        return float(found) if 0.0 <= found <= 1.0 else np.nan

    def _log(self, number: int, line: str) -> bool:
        control = self.control
        if found := re.fullmatch(OPENED[self.dialect], line):
            self.file = found[1] if found.groups() else "open"
            return True
        if self.dialect in CLOSED and re.fullmatch(CLOSED[self.dialect], line):
            self.file = ""
            return True
        if not (found := LOGS[self.dialect].fullmatch(line)):
            return False
        *name, row, touch = found.groups()
        if not self.file or (name and name[0] != self.file):
            control.fault(number, "a line for a log that is not open", "touch")
        control.say("log", number, f"{row},{touch}")
        return True


def touches(path: Path) -> Iterator[Finding]:
    """All that this module's head says."""
    reach = next((float(a) + float(b) for a, b in RADII.findall(path.control.file.read_text())), np.nan)
    if not np.isfinite(reach):
        yield path.fault("touch", 1, "the head does not say the radii of sphere and tip")
        return
    ways = _ways(path)
    yield from _clear(path, ways, reach)
    yield from _order(path, ways, reach)


Ways = dict[int, tuple[Array, Array]]
"""Of each move between known positions: the tip about the sphere's centre at its samples (N, 3), and where it aims (3,)."""


def _ways(path: Path) -> Ways:
    if not path.known:
        return {}
    moves = [path.events[i] for i in path.known]
    aims = np.stack([event.aim if event.aim.size else event.end for event in moves])
    there = path.machine.points(aims, path.run.tool_ball[None])[:, 0] - path.run.table_ball
    tips = np.split(path.ball - path.run.table_ball, np.searchsorted(path.owner, path.known[1:]))
    return dict(zip(path.known, zip(tips, there, strict=True), strict=True))


def _clear(path: Path, ways: Ways, reach: float) -> Iterator[Finding]:
    """Ways: which of them may come near."""
    proven: list[tuple[Array, Array]] = []
    rotary = path.machine.rotary
    for i in path.known:
        event = path.events[i]
        tip, aim = ways[i]
        off = np.linalg.norm(tip, axis=1)
        turning = np.abs(event.end - event.start)[rotary].max(initial=0.0) > 1e-9
        if turning:
            proven = []
        if (turning or event.kind == "rapid") and off.min() < reach + OFF_MM:
            what = "a rotary axis turns" if turning else "a rapid passes"
            yield path.fault("clear", event.line, f"{what} with the tip {off.min() - reach:.2f} mm off the sphere")
        elif event.probing == "guarded":
            proven.append((tip[0], aim))
            if off.min() < reach + AIM_MM:
                yield path.fault(
                    "probing", event.line, f"on its way the tip comes {off.min() - reach:.2f} mm near the sphere"
                )
        elif event.kind == "feed" and event.probing != "touch" and off.min() < reach + NEAR_MM:
            away = bool((np.diff(off) > -1e-4).all())
            back = any(np.abs(tip[0] - b).max() < 1e-2 and np.abs(tip[-1] - a).max() < 1e-2 for a, b in proven)
            if not away and not back:
                says = f"the tip goes to {off.min() - reach:.2f} mm off the sphere and would not stop on contact"
                yield path.fault("probing", event.line, says)


def _order(path: Path, ways: Ways, reach: float) -> Iterator[Finding]:
    """Touches and lines of the log: for every row, in every declared direction, fast and slow."""
    declared = np.array(path.run.table.get("touches", FIVE), float)
    declared /= np.linalg.norm(declared, axis=1)[:, None]
    wanted = [f"{row},{k}" for row in range(len(path.run.rows)) for k in range(len(declared))]
    done: list[tuple[Event, Array, Array]] = []
    logged = []
    for i, event in enumerate(path.events):
        if event.probing == "touch":
            tip, aim = ways[i]
            done.append((event, tip, aim))
            yield from _aimed(path, event, tip, aim, reach)
        elif event.kind == "log":
            logged.append(event.text)
            yield from _logged(path, event, done, declared)
            done = []
    if logged != wanted:
        k = next(
            (k for k, (a, b) in enumerate(zip(logged, wanted, strict=False)) if a != b), min(len(logged), len(wanted))
        )
        said, due = (x[k] if k < len(x) else "nothing" for x in (logged, wanted))
        yield path.fault("touch", path.events[-1].line, f"the log has {said} where {due} is due")


def _aimed(path: Path, event: Event, tip: Array, aim: Array, reach: float) -> Iterator[Finding]:
    start = tip[0]
    beside = float(np.linalg.norm(np.cross(start, aim))) / float(np.linalg.norm(aim - start))
    if beside > BESIDE_MM:
        yield path.fault("touch", event.line, f"the touch passes the sphere's centre at {beside:.3f} mm")
    off, behind = np.linalg.norm(start) - reach, reach - np.linalg.norm(aim)
    if off < 0.1 or behind < AIM_MM:
        yield path.fault(
            "touch", event.line, f"the touch begins {off:.2f} mm off the sphere and ends {behind:.2f} mm behind"
        )


def _logged(path: Path, event: Event, done: list[tuple[Event, Array, Array]], declared: Array) -> Iterator[Finding]:
    """The two touches before a line of the log."""
    row, number = (int(word) if word.isdigit() else -1 for word in event.text.split(","))
    if len(done) != 2 or not 0 <= row < len(path.run.rows) or not 0 <= number < len(declared):
        yield path.fault(
            "touch", event.line, f"{len(done)} touches before the line {event.text} of the log, two are due"
        )
        return
    (fast, first, _), (slow, tip, _) = done
    feeds = [60.0 * e.length(~path.machine.rotary) / e.seconds for e in (fast, slow)]
    off = float(np.linalg.norm(first[0]) - np.linalg.norm(first[-1]))
    if not feeds[1] <= min(feeds[0], SLOW) or off < AIM_MM:
        says = f"touched at {feeds[0]:.0f} and {feeds[1]:.0f} mm/min, from {off:.2f} mm off"
        yield path.fault("touch", slow.line, says)
    q = slow.end
    turned = np.abs(q - path.run.rows[row])[path.machine.rotary].max(initial=0.0)
    if turned > 0.51 * 10.0**-path.control.decimals + 1e-9:
        yield path.fault("touch", slow.line, f"row {row} of the run has the rotary axes {turned:.4f}° elsewhere")
    frame = path.machine.points(q[None], np.vstack([np.zeros(3), np.eye(3)]))[0]
    axes = frame[1:] - frame[0]  # of the tool in the workpiece frame
    n = axes @ (tip[-1] / np.linalg.norm(tip[-1]))
    if path.run.table.get("touch_frame", "tool") == "tool" and np.abs(n - declared[number]).max() > 1e-3:
        yield path.fault("touch", slow.line, f"touch {number} comes from {np.round(n, 3).tolist()} in the tool frame")
