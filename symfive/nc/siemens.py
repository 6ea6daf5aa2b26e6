"""Siemens Sinumerik 840D: comments after a semicolon, dwell in seconds with F, G93 for the time of a block.

A circle is one block, `TURN` more turns; `G64` is its contouring mode.
`SUPA` suppresses every frame in its block, `D0` the tool offset; `TRANS` alone clears the whole programmable frame (turned,
scaled, mirrored), `TOROTOF` and `PAROTOF` those that follow tool and table. Basic and system frames outlive a program (K2
08/2005, 2.4.13.4); which of them a control has is the builder's, so the head names them. `MSG` shows its text.
`MEAS=1` deletes the distance to go on contact; `$AC_MEA[1]` says whether there was one, `$AA_MW[…]` where (work). From the
maker's documentation.
"""

from __future__ import annotations

from dataclasses import replace

from symfive.nc._base import Block, Cycle, Dialect
from symfive.nc._post import Post
from symfive.nc._render import program_name
from symfive.nc._touch import NO_CONTACT, NO_LOG, ON_ITS_WAY, Move, Touch


def _file(name: str) -> str:
    """The first two characters of a file's name are letters."""
    stem = program_name(name)
    return stem if stem[:2].isalpha() else f"RUN_{stem}"[:24]


def _arc(arc: Block) -> list[str]:
    more = f" TURN={arc.turns - 1}" if arc.turns > 1 else ""
    return [f"{arc.code} {arc.words} {arc.offset}{more} F{arc.feed}"]


def _move(dialect: Dialect, move: Move, fails: str) -> list[str]:
    return [f"MEAS=1 G1 {dialect.words(move.end)} F{move.feed:g}", "STOPRE", f"IF $AC_MEA[1]{fails}"]


def _touched(dialect: Dialect, touch: Touch, log: str) -> list[str]:
    back = " ".join(f"{axis}=$AA_MW[{axis}]{more}" for axis, more in touch.off.items())
    stored = '<<" '.join(f'{axis}"<<$AA_MW[{axis}]' for axis in touch.away)
    return [
        *_move(dialect, touch.fast, "==0 GOTOB NO_CONTACT"),
        f"G1 {back} F{touch.fast.feed:g}",
        *_move(dialect, touch.slow, "==0 GOTOB NO_CONTACT"),
        f'WRITE(FAULT,"{log}","R{touch.row} T{touch.number} {stored})',
        "IF FAULT<>0 GOTOB NO_LOG",
    ]


def _prepared(dialect: Dialect, post: Post) -> Dialect:
    """The log's variable before everything else; before the first move the ends to which a fault leads, each a stop for ever."""
    ends = {"ON_ITS_WAY": ON_ITS_WAY, "NO_CONTACT": NO_CONTACT, "NO_LOG": f"{NO_LOG}, SEE MD11420"}
    lines = [
        line for label, said in ends.items() for line in (f'{label}: MSG("{said}: RESET")', "M0", f"GOTOB {label}")
    ]
    return replace(
        dialect, head=(*dialect.head, "DEF INT FAULT"), start=(*dialect.start, "GOTOF TO_WORK", *lines, "TO_WORK:")
    )


CYCLE = Cycle(
    guarded=lambda dialect, move: _move(dialect, move, "==1 GOTOB ON_ITS_WAY"),
    touched=_touched,
    opening=("G60", 'DELETE(FAULT,"{log}")'),
    closing=("G64",),
    prepared=_prepared,
    log="{name:.20}_LOG",
    says="WRITE writes {log}.MPF beside this program, {kilobytes} kB: not more than MD11420 allows",
)

SIEMENS = Dialect(
    name="siemens",
    suffix=".mpf",
    file=_file,
    head=("; {name}",),
    start=("G710 G17 G90 G94 G40 G500 D0", "TRANS", "M5", "G54"),
    rotary=("TRAFOOF", "TOROTOF", "PAROTOF"),
    end=("M30",),
    dwell="G4 F{seconds}",
    stop=('MSG("{text}")', "M0", "MSG()"),
    arc=_arc,
    retract=("SUPA G0 {words} D0",),
    orient=("SPOS={angle}",),
    comment="; {text}",
    datum="G54 calls the datum, D0: no tool offset. What the program before left must be zero: basic frame, external and DRF "
    "offset, swivelled plane (CYCLE800)",
    tool_centre=("T{tool} D1\nTRAORI", "TRAFOOF\nD0"),
    cycle=CYCLE,
)
