"""Heidenhain Klartext: signed words, numbered blocks, no inverse-time feed (the time of a block stands in a comment).

A circle is a polar arc about CC, of more than one turn where its angle says so; the contouring mode is cycle 32's, which stays as
it is set. The planes YZ and ZX count from Y and from Z.
Cycle 13 says the spindle's angle, `M19` turns it there (`M20` on some machines: the builder's).
`M91` refers a block to the machine datum; tool 0 has no length; cycle 247 calls the datum (preset) 1.
`TCH PROBE 4` measures along a vector into Q1 Q2 Q3, and -1 into Q4 where nothing was touched within ABST; it backs off by
MB itself, since no axis moves while the stylus is deflected. From the maker's documentation as far as it was at hand.
"""

from __future__ import annotations

from dataclasses import replace

from symfive.nc._base import Block, Cycle, Dialect
from symfive.nc._post import Post
from symfive.nc._touch import NO_CONTACT, ON_ITS_WAY, Move, Touch

MASK = "TOUCHES.A"
LEFT = ". What the program before left must be off: mirror image, rotation, scaling (cycles 8, 10, 11, 26)"


def _arc(arc: Block) -> list[str]:
    return [f"CC {arc.pole}", f"CP IPA{arc.sweep:+.4f} DR{'+' if arc.sweep > 0.0 else '-'} F{arc.feed}"]


def _probed(move: Move, back: float, fails: str) -> list[str]:
    # of the words as they stand
    way = {axis: round(end, 4) - round(move.start[axis], 4) for axis, end in move.end.items()}
    vector = " ".join(f"I{axis}{round(d, 4) + 0.0:+.4f}" for axis, d in way.items())
    return [
        "TCH PROBE 4.0 MEASURING IN 3-D",
        "TCH PROBE 4.1 Q1",
        f"TCH PROBE 4.2 {vector}",
        f"TCH PROBE 4.3 ABST{move.length:+.4f} F{move.feed:g} MB{back:.4f} REFERENCE SYSTEM:0",
        fails,
    ]


def _touched(dialect: Dialect, touch: Touch, log: str) -> list[str]:
    missed = "FN 9: IF +Q4 EQU -1 GOTO LBL 98"
    return [
        *_probed(touch.fast, touch.back, missed),
        *_probed(touch.slow, touch.back, missed),
        f"FN 0: Q10 = +{touch.row}",
        f"FN 0: Q11 = +{touch.number}",
        f"FN 16: F-PRINT {MASK} / {log}",
    ]


def _prepared(dialect: Dialect, post: Post) -> Dialect:
    """The probe is a tool whose length counts: the datum is shifted by it, so that the words stay those of the spindle nose."""
    call = f"TOOL CALL {post.probe_tool} Z"
    ends = {97: ON_ITS_WAY, 98: NO_CONTACT}
    lines = [
        line
        for label, said in ends.items()
        for line in (f"LBL {label}", f"; {said}", "STOP M0", f"FN 9: IF +0 EQU +0 GOTO LBL {label}")
    ]
    *last, end = dialect.end
    return replace(
        dialect,
        after_first_stop=(call, "CYCL DEF 7.0 DATUM SHIFT", "CYCL DEF 7.1 Z-Q114"),
        end=("TRANS DATUM RESET", *last, *lines, end),
        datum=f"cycle 247 calls datum 1; {call}: the touch probe, in the spindle before; the shift by Q114 takes its length "
        f"out{LEFT}",
    )


CYCLE = Cycle(
    guarded=lambda dialect, move: _probed(move, 0.0, "FN 10: IF +Q4 NE -1 GOTO LBL 97"),
    touched=_touched,
    prepared=_prepared,
    log="{name}.TXT",
    says=f"FN 16 writes {{log}} beside this program, laid out by the file {MASK}, which must stand there too",
    calls_probe=True,
    beside={MASK: '"R%1.0LF T%1.0LF X%1.5LF Y%1.5LF Z%1.5LF",Q10,Q11,Q1,Q2,Q3;\n'},
)

HEIDENHAIN = Dialect(
    name="heidenhain",
    suffix=".h",
    head=("BEGIN PGM {name} MM",),
    start=("TRANS DATUM RESET", "CYCL DEF 247 DATUM SETTING Q339=+1", "M5"),
    after_first_stop=("TOOL CALL 0 Z",),
    rotary=("FUNCTION RESET TCPM", "PLANE RESET STAY"),
    end=("M30", "END PGM {name} MM"),
    rapid="L {words} R0 FMAX",
    feed="L {words} R0 F{feed}",
    dwell="CYCL DEF 9.0 DWELL TIME\nCYCL DEF 9.1 DWELL {seconds}",
    stop=("; {text}", "STOP M0"),
    contour=(),
    steady=(),
    arc=_arc,
    retract=("L {words} R0 FMAX M91",),
    orient=("CYCL DEF 13.0 ORIENTATION", "CYCL DEF 13.1 ANGLE {angle}", "M19"),
    comment="; {text}",
    datum="cycle 247 calls datum 1; TOOL CALL 0 after the first stop: no tool length; if it unloads the spindle on your machine, "
    "delete the line and call the ball's tool with L = 0" + LEFT,
    tool_centre_example="FUNCTION TCPM F TCP AXIS POS PATHCTRL AXIS after your TOOL CALL, and FUNCTION RESET TCPM",
    inverse_time=False,
    numbered="{block}",
    word="{axis}{value:+.{decimals}f}",
    cycle=CYCLE,
)
