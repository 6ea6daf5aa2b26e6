"""Siemens Sinumerik 840D: comments after a semicolon, dwell in seconds with F, G93 for the time of a block."""

from symfive.nc._base import Dialect

SIEMENS = Dialect(
    name="siemens",
    suffix=".mpf",
    start=("; {name}", "G71 G90 G17 G40", "G93"),
    end=("G94", "M30"),
    rapid="G0 {words}",
    feed="G1 {words} F{feed}",
    dwell="G4 F{seconds}",
    stop="M0",
    comment="; {text}",
    word=lambda axis, value: f"{axis}={value:.5f}" if len(axis) > 1 else f"{axis}{value:.5f}",
)
