"""DIN 66025 / ISO 6983 as Fanuc-like controls read it; feed moves with G93."""

from symfive.nc._base import Dialect

ISO = Dialect(
    name="iso",
    suffix=".nc",
    start=("%", "O{number} ({name})", "G21 G90 G17 G40 G49 G80", "G93"),
    end=("G94", "M30", "%"),
    rapid="G0 {words}",
    feed="G1 {words} F{feed}",
    dwell="G4 X{seconds}",
    stop="M0",
    comment="({text})",
)
