"""Heidenhain Klartext: signed words, numbered blocks, no inverse-time feed (the time of a block stands in a comment)."""

from symfive.nc._base import Dialect

HEIDENHAIN = Dialect(
    name="heidenhain",
    suffix=".h",
    start=("BEGIN PGM {name} MM",),
    end=("M30", "END PGM {name} MM"),
    rapid="L {words} R0 FMAX",
    feed="L {words} R0 F{feed}",
    dwell="CYCL DEF 9.0 DWELL TIME\nCYCL DEF 9.1 DWELL {seconds}",
    stop="STOP M0",
    comment="; {text}",
    inverse_time=False,
    numbered=True,
    decimals=4,
    word=lambda axis, value: f"{axis}{value:+.4f}",
)
