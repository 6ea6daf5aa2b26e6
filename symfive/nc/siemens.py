"""Siemens Sinumerik 840D: comments after a semicolon, dwell in seconds with F, G93 for the time of a block.

A circle is one block, `TURN` more turns; `G64` is its contouring mode.
`SUPA` suppresses every frame in its block, `D0` the tool offset, `TRANS` the programmed frames; `MSG` shows its text.
"""

from symfive.nc._base import Block, Dialect


def _arc(arc: Block) -> list[str]:
    more = f" TURN={arc.turns - 1}" if arc.turns > 1 else ""
    return [f"{arc.code} {arc.words} {arc.offset}{more} F{arc.feed}"]


SIEMENS = Dialect(
    name="siemens",
    suffix=".mpf",
    head=("; {name}",),
    start=("G710 G17 G90 G94 G40 G500 D0", "TRANS", "M5", "G54"),
    rotary=("TRAFOOF",),
    end=("M30",),
    rapid="G0 {words}",
    feed="G1 {words} F{feed}",
    dwell="G4 F{seconds}",
    stop=('MSG("{text}")', "M0", "MSG()"),
    arc=_arc,
    retract=("SUPA G0 {words} D0",),
    orient=("SPOS={angle}",),
    comment="; {text}",
    datum="G54 calls the datum, D0: no tool offset",
    tool_centre=("T{tool} D1\nTRAORI", "TRAFOOF\nD0"),
    word=lambda axis, value: f"{axis}={value:.5f}" if len(axis) > 1 else f"{axis}{value:.5f}",
)
