"""LinuxCNC (RS274/NGC): parsed by its own interpreter `rs274` in the tests."""

from symfive.nc._base import Dialect

LINUXCNC = Dialect(
    name="linuxcnc",
    suffix=".ngc",
    head=("({name})",),
    start=("G21 G17 G90 G94 G40 G49 G80 G92.1", "M5", "G54", "G64 P0.005", "G93"),
    end=("G94", "M2"),
    rapid="G0 {words}",
    feed="G1 {words} F{feed}",
    dwell="G4 P{seconds}",
    stop=("(MSG, {text})", "M0"),
    retract=("G49", "G53 G0 {words}"),
    comment="({text})",
    datum="G54 calls the datum, G49: no tool length offset",
    verified="parsed by LinuxCNC's own interpreter",
)
