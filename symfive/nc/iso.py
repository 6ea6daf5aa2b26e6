"""DIN 66025 / ISO 6983 as Fanuc-like controls read it; feed moves with G93.

A circle is one block a turn, end and start in one point, with I, J, K from start to centre; `G64` is its contouring mode: what
look-ahead (`G5.1 Q1`, `G8 P1`, Haas `G187`) is on in production is switched on by hand before, and reported.

Spindle orientation to an angle (`M19` with R, S or nothing) is the builder's: the program stops, the operator turns the spindle.
`#3006` stops and shows its text (26 characters); `G28` drives to the reference point, which lies at the top of the tool's axis.
`G43.4` fixes X, Y and Z to the table as it stands then (Fanuc 30i A-79348E 1.1, 15i B-63783EN-1 10.4.14, Mitsubishi M700V 13.24).
It and `G49` name the place where the axes stand: alone in a block they move the tool by its length where parameter 5006#6 is 0
(Mazak: F93, F94). So `G49` waits until the tool is at its top, where `G28` has cancelled the offset (0i-MB B-63844EN 14.1.2), and
`G28` follows once more.
`G31` skips what is left of a move; without contact `#5061` … hold its end. `DPRNT` prints eight digits, and
a number of more than eight is an alarm. From the makers' documentation.
"""

from __future__ import annotations

from symfive.nc._base import Cycle, Dialect
from symfive.nc._touch import NO_CONTACT, ON_ITS_WAY, STORED, Move, Touch

REACHED_MM = 0.02
"""Within this of its end a move was not stopped: three words rounded to 0.001 mm, and the control's window of arrival."""


def _from_end(move: Move) -> str:
    return "+".join(f"ABS[{STORED[axis]}{-value:+.3f}]" for axis, value in move.end.items())


def _guarded(dialect: Dialect, move: Move) -> list[str]:
    stopped = f"IF[[{_from_end(move)}]GT{REACHED_MM:g}]THEN #3000=1({ON_ITS_WAY})"
    return [f"G31 {dialect.words(move.end)} F{move.feed:g}", stopped]


def _touched(dialect: Dialect, touch: Touch, log: str) -> list[str]:
    def touched(move: Move) -> list[str]:
        missed = f"IF[[{_from_end(move)}]LT{REACHED_MM:g}]THEN #3000=2({NO_CONTACT})"
        return [f"G31 {dialect.words(move.end)} F{move.feed:g}", missed]

    printed = "".join(f"{axis}{number}[44]" for axis, number in STORED.items())
    return [
        *touched(touch.fast),
        f"G1 {touch.backed_off} F{touch.fast.feed:g}",
        *touched(touch.slow),
        f"DPRNT[R{touch.row}T{touch.number}{printed}]",
    ]


CYCLE = Cycle(
    guarded=_guarded,
    touched=_touched,
    opening=("G61", "POPEN"),
    closing=("PCLOS", "G64"),
    says="DPRNT writes the log to the device of parameter 0020 (a card: PRNT0000.DAT)",
    cautions=("G31 may ignore feed override and dry run: stop it by feed hold",),
)

ISO = Dialect(
    name="iso",
    suffix=".nc",
    head=("%", "O{number} ({name})"),
    start=("G21 G17 G90 G94 G40 G80", "G69", "M5", "G54"),
    end=("M30", "%"),
    dwell="G4 X{seconds}",
    stop=("#3006=1({text})",),
    retract=("G91 G28 {axis}0.", "G49", "G28 {axis}0.", "G90"),
    orient=("#3006=1(TURN SPINDLE TO {angle} DEG)",),
    comment="({text})",
    datum="G54 calls the datum, G49: no tool length offset. What the program before left must be zero or off: G52, G92, external "
    "offset, scaling (G51), mirror image",
    upper=True,
    digits=8,
    tool_centre=("G1 G43.4 H{tool} {words} F1", "G1 G49 {words} F1"),
    frame_of_start=True,
    cycle=CYCLE,
)
