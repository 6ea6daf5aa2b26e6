"""DIN 66025 / ISO 6983 as Fanuc-like controls read it; feed moves with G93.

A circle is one block a turn, end and start in one point, with I, J, K from start to centre; `G64` is its contouring mode: what
look-ahead (`G5.1 Q1`, `G8 P1`, Haas `G187`) is on in production is switched on by hand before, and reported.

Spindle orientation to an angle (`M19` with R, S or nothing) is the builder's: the program stops, the operator turns the spindle.
`#3006` stops and shows its text (26 characters); `G28` drives to the reference point, which lies at the top of the tool's axis.
"""

from symfive.nc._base import Dialect

ISO = Dialect(
    name="iso",
    suffix=".nc",
    head=("%", "O{number} ({name})"),
    start=("G21 G17 G90 G94 G40 G49 G80", "G69", "M5", "G54"),
    end=("M30", "%"),
    rapid="G0 {words}",
    feed="G1 {words} F{feed}",
    dwell="G4 X{seconds}",
    stop=("#3006=1({text})",),
    retract=("G49", "G91 G28 {axis}0.", "G90"),
    orient=("#3006=1(TURN SPINDLE TO {angle} DEG)",),
    comment="({text})",
    datum="G54 calls the datum, G49: no tool length offset",
    upper=True,
    tool_centre=("G43.4 H{tool}", "G49"),
)
