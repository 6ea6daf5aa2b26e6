"""LinuxCNC (RS274/NGC): parsed by its own interpreter `rs274` in the tests."""

from symfive.nc._base import Dialect

LINUXCNC = Dialect(
    name="linuxcnc",
    suffix=".ngc",
    start=("({name})", "G21 G90 G17 G40 G49 G80", "G64 P0.005", "G93"),
    end=("G94", "M2"),
    rapid="G0 {words}",
    feed="G1 {words} F{feed}",
    dwell="G4 P{seconds}",
    stop="M0",
    comment="({text})",
    verified="parsed by LinuxCNC's own interpreter",
)
