"""LinuxCNC (RS274/NGC): parsed by its own interpreter `rs274` in the tests.

A circle is one block, `P` its turns. `G64 P Q` with small values: the planner splits arcs flatter than P into lines, which Q
joins. `M19` needs a spindle that can be oriented (HAL pins `spindle.0.orient-…`) and waits 30 s for it.
`G38.3` stops on contact and `G38.2` raises an error without one; `#5061` … hold the words at the contact. This ran on a control.
"""

from __future__ import annotations

from symfive.nc._base import Block, Cycle, Dialect
from symfive.nc._touch import STORED, Touch


def _arc(arc: Block) -> list[str]:
    turns = f" P{arc.turns}" if arc.turns > 1 else ""
    return [f"{arc.code} {arc.words} {arc.offset}{turns} F{arc.feed}"]


def _touched(dialect: Dialect, touch: Touch, log: str) -> list[str]:
    return [
        f"G38.2 {dialect.words(touch.fast.end)} F{touch.fast.feed:g}",
        f"G1 {touch.backed_off} F{touch.fast.feed:g}",
        f"G38.2 {dialect.words(touch.slow.end)} F{touch.slow.feed:g}",
        f"(LOG,{touch.row},{touch.number},{','.join(STORED.values())})",
    ]


CYCLE = Cycle(
    guarded=lambda dialect, move: [f"G38.3 {dialect.words(move.end)} F{move.feed:g}"],
    touched=_touched,
    opening=("G61 G94", "(LOGOPEN,{log})"),
    closing=("(LOGCLOSE)",),
    log="{run}.txt",
    says="the control writes {log}",
    centred=True,
)

LINUXCNC = Dialect(
    name="linuxcnc",
    suffix=".ngc",
    head=("({name})",),
    start=("G21 G17 G90 G94 G40 G49 G80 G92.1", "M5", "G54", "G64 P0.005"),
    end=("M2",),
    dwell="G4 P{seconds}",
    stop=("(MSG, {text})", "M0"),
    contour=("{plane} G64 P0.002 Q0.001",),
    steady=(),
    arc=_arc,
    retract=("G49", "G53 G0 {words}"),
    orient=("M19 R{angle} Q30",),
    comment="({text})",
    decimals=5,
    datum="G54 calls the datum, whose rotation R must be 0, G49: no tool length offset",
    tool_centre_example="M428 and M429 in some configurations (a remap sets the kinematics), the other way round in others",
    verified="parsed by LinuxCNC's own interpreter",
    cycle=CYCLE,
)
