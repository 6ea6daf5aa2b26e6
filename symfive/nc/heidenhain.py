"""Heidenhain Klartext: signed words, numbered blocks, no inverse-time feed (the time of a block stands in a comment).

A circle is a polar arc about CC, of more than one turn where its angle says so; the contouring mode is cycle 32's, which stays as
it is set. The planes YZ and ZX count from Y and from Z.
Cycle 13 says the spindle's angle, `M19` turns it there (`M20` on some machines: the builder's).
`M91` refers a block to the machine datum; tool 0 has no length; cycle 247 calls the datum (preset) 1.
"""

from symfive.nc._base import Block, Dialect


def _arc(arc: Block) -> list[str]:
    return [f"CC {arc.pole}", f"CP IPA{arc.sweep:+.4f} DR{'+' if arc.sweep > 0.0 else '-'} F{arc.feed}"]


HEIDENHAIN = Dialect(
    name="heidenhain",
    suffix=".h",
    head=("BEGIN PGM {name} MM",),
    start=("TRANS DATUM RESET", "CYCL DEF 247 DATUM SETTING Q339=+1", "TOOL CALL 0 Z", "M5"),
    rotary=("FUNCTION RESET TCPM", "PLANE RESET STAY"),
    end=("M30", "END PGM {name} MM"),
    rapid="L {words} R0 FMAX",
    feed="L {words} R0 F{feed}",
    dwell="CYCL DEF 9.0 DWELL TIME\nCYCL DEF 9.1 DWELL {seconds}",
    stop=("; {text}", "STOP M0"),
    contour=(),
    arc=_arc,
    retract=("L {words} R0 FMAX M91",),
    orient=("CYCL DEF 13.0 ORIENTATION", "CYCL DEF 13.1 ANGLE {angle}", "M19"),
    comment="; {text}",
    datum="cycle 247 calls datum 1; TOOL CALL 0: no tool length, take the line out where it would empty the spindle, L = 0 then",
    tool_centre_example="FUNCTION TCPM F TCP AXIS POS PATHCTRL AXIS after your TOOL CALL, and FUNCTION RESET TCPM",
    inverse_time=False,
    numbered=True,
    decimals=4,
    word=lambda axis, value: f"{axis}{value:+.4f}",
)
