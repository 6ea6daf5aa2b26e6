"""The words in which four controls touch: a move that stops on contact, what it stored, and a line in a file.

All store where the axes stood, in the words of the program and not corrected for the tip. A servo lag or a delay of the signal is
the same in all slow touches, along their direction: the effective radius of the sphere takes it. docs/howto/touch-probe.md has
the table. LinuxCNC's ran on a control; the others follow the makers' documentation as far as it was at hand.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

from symfive.nc._base import Dialect
from symfive.nc._post import Post
from symfive.nc._touch import Cycle, Move, Touch

__all__ = ["CYCLES"]

REACHED_MM = 0.02
"""Within this of its end an ISO control's move was not stopped: three words rounded to 0.001 mm, and its window of arrival."""
ON_ITS_WAY, NO_CONTACT, NO_LOG = "PROBE TOUCHED ON ITS WAY", "NO CONTACT", "LOG NOT WRITTEN"
"""What the control shows; 26 characters at most."""


# --- LinuxCNC: G38.3 stops on contact and G38.2 raises an error without one; #5061 … hold the words at the contact.


def _linuxcnc_guarded(dialect: Dialect, move: Move) -> list[str]:
    return [f"G38.3 {move.words(dialect)} F{move.feed:g}"]


def _linuxcnc_touched(dialect: Dialect, touch: Touch, log: str) -> list[str]:
    return [
        f"G38.2 {touch.fast.words(dialect)} F{touch.fast.feed:g}",
        f"G1 {_off(touch, STORED)} F{touch.fast.feed:g}",
        f"G38.2 {touch.slow.words(dialect)} F{touch.slow.feed:g}",
        f"(LOG,{touch.row},{touch.number},{','.join(STORED.values())})",
    ]


STORED = {"X": "#5061", "Y": "#5062", "Z": "#5063"}


def _off(touch: Touch, stored: Mapping[str, str]) -> str:
    """Words of the place `back_off` off the contact."""
    return " ".join(f"{axis}[{stored[axis]}{touch.back_off * d:+.5f}]" for axis, d in touch.away.items())


LINUXCNC = Cycle(
    guarded=_linuxcnc_guarded,
    touched=_linuxcnc_touched,
    opening=("G61 G94", "(LOGOPEN,{log})"),
    closing=("(LOGCLOSE)",),
    log="{run}.txt",
    says="the control writes {log}",
    centred=True,
)


# --- ISO, Fanuc-like: G31 skips what is left of a move; without contact #5061 … hold its end. DPRNT prints eight digits.


def _from_end(move: Move) -> str:
    return "+".join(f"ABS[{STORED[axis]}{-value:+.3f}]" for axis, value in move.end.items())


def _iso_guarded(dialect: Dialect, move: Move) -> list[str]:
    stopped = f"IF[[{_from_end(move)}]GT{REACHED_MM:g}]THEN #3000=1({ON_ITS_WAY})"
    return [f"G31 {move.words(dialect)} F{move.feed:g}", stopped]


def _iso_touched(dialect: Dialect, touch: Touch, log: str) -> list[str]:
    def touched(move: Move) -> list[str]:
        missed = f"IF[[{_from_end(move)}]LT{REACHED_MM:g}]THEN #3000=2({NO_CONTACT})"
        return [f"G31 {move.words(dialect)} F{move.feed:g}", missed]

    printed = "".join(f"{axis}{number}[44]" for axis, number in STORED.items())
    return [
        *touched(touch.fast),
        f"G1 {_off(touch, STORED)} F{touch.fast.feed:g}",
        *touched(touch.slow),
        f"DPRNT[R{touch.row}T{touch.number}{printed}]",
    ]


ISO = Cycle(
    guarded=_iso_guarded,
    touched=_iso_touched,
    opening=("G61", "POPEN"),
    closing=("PCLOS", "G64"),
    says="DPRNT writes the log to the device of parameter 0020 (a card: PRNT0000.DAT)",
    cautions=("G31 may ignore feed override and dry run: stop it by feed hold",),
)


# --- Siemens: MEAS=1 deletes the distance to go on contact; $AC_MEA[1] says whether there was one, $AA_MW[…] where (work).


def _siemens_move(dialect: Dialect, move: Move, fails: str) -> list[str]:
    return [f"MEAS=1 G1 {move.words(dialect)} F{move.feed:g}", "STOPRE", f"IF $AC_MEA[1]{fails}"]


def _siemens_guarded(dialect: Dialect, move: Move) -> list[str]:
    return _siemens_move(dialect, move, "==1 GOTOB ON_ITS_WAY")


def _siemens_touched(dialect: Dialect, touch: Touch, log: str) -> list[str]:
    back = " ".join(f"{axis}=$AA_MW[{axis}]{touch.back_off * d:+.5f}" for axis, d in touch.away.items())
    stored = '<<" '.join(f'{axis}"<<$AA_MW[{axis}]' for axis in touch.away)
    return [
        *_siemens_move(dialect, touch.fast, "==0 GOTOB NO_CONTACT"),
        f"G1 {back} F{touch.fast.feed:g}",
        *_siemens_move(dialect, touch.slow, "==0 GOTOB NO_CONTACT"),
        f'WRITE(FAULT,"{log}","R{touch.row} T{touch.number} {stored})',
        "IF FAULT<>0 GOTOB NO_LOG",
    ]


def _siemens_prepared(dialect: Dialect, post: Post) -> Dialect:
    """The log's variable before everything else; before the first move the ends to which a fault leads, each a stop for ever."""
    ends = {"ON_ITS_WAY": ON_ITS_WAY, "NO_CONTACT": NO_CONTACT, "NO_LOG": f"{NO_LOG}, SEE MD11420"}
    lines = [
        line for label, said in ends.items() for line in (f'{label}: MSG("{said}: RESET")', "M0", f"GOTOB {label}")
    ]
    return replace(
        dialect,
        head=(*dialect.head, "DEF INT FAULT"),
        start=(*dialect.start, "GOTOF TO_WORK", *lines, "TO_WORK:"),
    )


SIEMENS = Cycle(
    guarded=_siemens_guarded,
    touched=_siemens_touched,
    opening=("G60", 'DELETE(FAULT,"{log}")'),
    closing=("G64",),
    prepared=_siemens_prepared,
    log="{name:.20}_LOG",
    says="WRITE writes {log}.MPF beside this program, {kilobytes} kB: not more than MD11420 allows",
)


# --- Heidenhain: TCH PROBE 4 measures along a vector into Q1 Q2 Q3, and -1 into Q4 where nothing was touched within ABST; it
# backs off by MB itself, since no axis moves while the stylus is deflected.


def _probed(move: Move, back: float, fails: str) -> list[str]:
    way = {
        axis: round(end, 4) - round(move.start[axis], 4) for axis, end in move.end.items()
    }  # of the words as they stand
    vector = " ".join(f"I{axis}{round(d, 4) + 0.0:+.4f}" for axis, d in way.items())
    return [
        "TCH PROBE 4.0 MEASURING IN 3-D",
        "TCH PROBE 4.1 Q1",
        f"TCH PROBE 4.2 {vector}",
        f"TCH PROBE 4.3 ABST{move.length:+.4f} F{move.feed:g} MB{back:.4f} REFERENCE SYSTEM:0",
        fails,
    ]


def _heidenhain_guarded(dialect: Dialect, move: Move) -> list[str]:
    return _probed(move, 0.0, "FN 10: IF +Q4 NE -1 GOTO LBL 97")


def _heidenhain_touched(dialect: Dialect, touch: Touch, log: str) -> list[str]:
    missed = "FN 9: IF +Q4 EQU -1 GOTO LBL 98"
    return [
        *_probed(touch.fast, touch.back, missed),
        *_probed(touch.slow, touch.back, missed),
        f"FN 0: Q10 = +{touch.row}",
        f"FN 0: Q11 = +{touch.number}",
        f"FN 16: F-PRINT {MASK} / {log}",
    ]


MASK = "TOUCHES.A"


def _heidenhain_prepared(dialect: Dialect, post: Post) -> Dialect:
    """The probe is a tool whose length counts: the datum is shifted by it, so that the words stay those of the spindle nose."""
    call = f"TOOL CALL {post.probe_tool} Z"
    called = [call if line.startswith("TOOL CALL") else line for line in dialect.start]
    ends = {97: ON_ITS_WAY, 98: NO_CONTACT}
    lines = [
        line
        for label, said in ends.items()
        for line in (f"LBL {label}", f"; {said}", "STOP M0", f"FN 9: IF +0 EQU +0 GOTO LBL {label}")
    ]
    *last, end = dialect.end
    return replace(
        dialect,
        start=(*called, "CYCL DEF 7.0 DATUM SHIFT", "CYCL DEF 7.1 Z-Q114"),
        end=("TRANS DATUM RESET", *last, *lines, end),
        datum=f"cycle 247 calls datum 1; {call}: the touch probe, in the spindle before; the shift by Q114 takes its length out",
    )


HEIDENHAIN = Cycle(
    guarded=_heidenhain_guarded,
    touched=_heidenhain_touched,
    prepared=_heidenhain_prepared,
    log="{name}.TXT",
    says=f"FN 16 writes {{log}} beside this program, laid out by the file {MASK}, which must stand there too",
    calls_probe=True,
    beside={MASK: '"R%1.0LF T%1.0LF X%1.5LF Y%1.5LF Z%1.5LF",Q10,Q11,Q1,Q2,Q3;\n'},
)

CYCLES: dict[str, Cycle] = {"iso": ISO, "siemens": SIEMENS, "heidenhain": HEIDENHAIN, "linuxcnc": LINUXCNC}
"""The controls for which a touch is written, by dialect."""
