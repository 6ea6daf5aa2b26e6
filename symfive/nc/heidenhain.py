"""Heidenhain Klartext: signed words, numbered blocks, no inverse-time feed (the time of a block stands in a comment).

`M91` refers a block to the machine datum; tool 0 has no length; cycle 247 calls the datum (preset) 1.
"""

from symfive.nc._base import Dialect

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
    retract=("L {words} R0 FMAX M91",),
    comment="; {text}",
    datum="cycle 247 calls datum 1; TOOL CALL 0: no tool length, take the line out where it would empty the spindle, L = 0 then",
    inverse_time=False,
    numbered=True,
    decimals=4,
    word=lambda axis, value: f"{axis}{value:+.4f}",
)
