"""What the checker and the tests know of each dialect, one entry each; nothing of it comes from symfive."""

from dataclasses import dataclass


@dataclass(frozen=True, kw_only=True)
class Dialect:
    """How a dialect is read, and what is expected in its programs.

    Read: `klartext` or G-code; `comment` after `;` or in `(`brackets`)`; `dwell` the address of its seconds; `turns` the address
    of further turns of an arc and what it says for one turn; `datum` the numbers of the G codes that call one, `machine` the
    words for machine coordinates in a block, `no_length` the G code without a tool length, `centre` the words (G codes without
    their G) for tool-centre control on and off, `frame_of_start` whether its frame is that of the table as it stands then;
    `known` further G codes that set a state; `needed` the states that a program sets before its first motion (of those in
    brackets one), `turning` where rotary axes are, `moves_alone` codes that may move the tool by its length where it stands.
    `message`: a text for the screen, whether it stops the program itself
    (`stops`; 26 characters), whether it stays until the next one (`held`), whether a comment at a stop is
    shown too (`reads_comment`).

    Expected: `decimals` that the control keeps, at most; `suffix` of the file; `top` the first move, to -3 mm in machine
    coordinates; `calls` lines that stand before it;
    `screen` a stop and its text; `orient` the spindle's angle; `circle` two turns clockwise of radius 100 mm; `spoiled` what is
    changed in an arc and what the checker says then.
    """

    decimals: int
    suffix: str
    top: str
    calls: tuple[str, ...]
    screen: str
    orient: str
    circle: tuple[str, ...]
    spoiled: tuple[str, str, str]
    needed: tuple[str | tuple[str, ...], ...]
    turning: tuple[str, ...] = ()
    klartext: bool = False
    comment: str = "("
    dwell: str = "X"
    datum: str = r"5[4-9]"
    machine: tuple[str, ...] = ("53",)
    no_length: str = "49"
    centre: tuple[str, str] = ("43.4", "49")
    frame_of_start: bool = True
    known: str = ""
    moves_alone: tuple[str, ...] = ()
    turns: tuple[str, float] = ("P", 1.0)
    message: str = ""
    stops: bool = False
    held: bool = False
    reads_comment: bool = False


def _turns(decimals: int, *turns: str) -> tuple[str, ...]:
    """The circle's blocks, which the bar is fed into and out of; `turns` what each arc has behind its words."""
    zero, half = "0" * decimals, "5".ljust(decimals, "0")
    arc = f"G2 X-100.{zero} Y0.{zero} I100.{zero} J0.{zero}"
    fed = [f"G1 X-10{out} Y0.{zero} F1000" for out in (f"0.{zero}", f"1.{half}")]
    return fed[0], *(f"{arc}{turn} F1000" for turn in turns), fed[1]


G_STATES = ("G17", "G21", "G40", "G80", "G90", "G49", "datum")

DIALECTS: dict[str, Dialect] = {
    "iso": Dialect(
        decimals=4, suffix=".nc", top="G91 G28 Z0.", calls=("G21 G17 G90 G94 G40 G80", "G69", "G54"), moves_alone=("G49",),
        screen=r"#3006=1\(([^)]{5,26})\)", orient=r"TURN SPINDLE TO (\d+)",
        circle=_turns(4, "", ""), spoiled=("G2 X", "G3 X", ""),
        needed=G_STATES, message=r"#3006\s*=\s*1\s*\((?P<text>.*?)\)", stops=True,
        reads_comment=True,
    ),
    "siemens": Dialect(
        decimals=4, suffix=".mpf", top="SUPA G0 Z-3.0000 D0",
        calls=("TRAFOOF", "TOROTOF", "PAROTOF", "G710 G17 G90 G94 G40 G500 D0", "TRANS", "G54"),
        screen=r'MSG\("([^"]+)"\)\nM0\nMSG\(\)', orient=r"SPOS=(\d+)",
        circle=_turns(4, " TURN=1"), spoiled=("TURN=1", "TURN=2", "turns by"),
        needed=("G17", ("G71", "G710"), "G40", "G90", ("D0", "D1"), "datum"), turning=("TRAFOOF",),
        comment=";", dwell="F", datum=r"5[4-7]|50[5-9]|5[1-9]\d", machine=("53", "153", "SUPA"), turns=("TURN", 0.0),
        centre=("TRAORI", "TRAFOOF"), frame_of_start=False,
        message=r'MSG\(\s*"?(?P<text>.*?)"?\s*\)', held=True,
    ),
    "heidenhain": Dialect(
        decimals=4, suffix=".h", top="L Z-3.0000 R0 FMAX M91",
        calls=("FUNCTION RESET TCPM", "PLANE RESET STAY", "TRANS DATUM RESET", "CYCL DEF 247 DATUM SETTING Q339=+1",
               "TOOL CALL 0 Z"),
        screen=r"; ([^\n]+)\n\d+ STOP M0", orient=r"13\.1 ANGLE (\d+)",
        circle=("L X-100.0000 Y+0.0000 R0 F1000", "CC X+0.0000 Y+0.0000", "CP IPA-720.0000 DR- F1000",
                "L X-101.5000 Y+0.0000 R0 F1000"),
        spoiled=("CC X+0.0000", "CC X+5.0000", "off the circle"),
        needed=("MM", ("length off", "length on"), ("datum", "datum shift")), turning=("TCP off",), klartext=True,
    ),
    "linuxcnc": Dialect(
        decimals=5, suffix=".ngc", top="G53 G0 Z-3.00000", calls=("G21 G17 G90 G94 G40 G49 G80 G92.1", "G54", "G49"),
        screen=r"\(MSG, ([^)]+)\)\nM0", orient=r"M19 R(\d+)",
        circle=_turns(5, " P2"), spoiled=(" P2 F", " P3 F", "turns by"),
        needed=G_STATES, dwell="P", datum=r"5[4-9](\.[123])?", message=r"\(\s*MSG\s*,\s*(?P<text>[^)]*)\)",
    ),
}  # fmt: skip
