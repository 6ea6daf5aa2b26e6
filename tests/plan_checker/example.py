"""A plan that is in order, written without symfive: what the checker must pass, and what its tests spoil.

A tilting-table machine, an R-test run and a ball-bar run; each goes out once between two poses and in again.
"""

import json
import tomllib
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ._plan import Array, Machine

Step = tuple[str, object, float]
BLOCKS, DWELL, WAY, CREEP = 60, 2.0, 4.0, 6.0
LIFT, BAR = 50.0, 100.0
TOOL_LENGTH = 150.0


@dataclass(frozen=True)
class Made:
    """A run: its entry in campaign.toml, rows (N, n), times (N,) and the steps of its program."""

    name: str
    toml: str
    rows: Array
    times: Array
    steps: list[Step]


def write_example(folder: Path, machine_text: str) -> Path:
    """The plan's folder with programs of all four dialects; `machine_text` is a machine file with axes X Y Z B C."""
    machine = Machine(tomllib.loads(machine_text))
    runs = [_nest(machine), _bar(machine)]
    (folder / "nc").mkdir(parents=True)
    (folder / "machine.toml").write_text(machine_text, encoding="utf-8")
    head = 'schema = "symfive.campaign/1"\nmachine = "machine.toml"\n'
    (folder / "campaign.toml").write_text(head + "".join(run.toml for run in runs), encoding="utf-8")
    for run in runs:
        names = ",".join(axis.column for axis in machine.chain.axes)
        lines = [",".join(f"{v:.6f}" for v in (t, *row)) for t, row in zip(run.times, run.rows, strict=True)]
        (folder / f"{run.name}.csv").write_text(f"t_s,{names}\n" + "\n".join(lines) + "\n", encoding="utf-8")
        for dialect, (suffix, writer) in WRITERS.items():
            (folder / "nc" / dialect).mkdir(exist_ok=True)
            text = "\n".join(writer(machine, run)) + "\n"
            (folder / "nc" / dialect / f"{run.name}{suffix}").write_text(text, encoding="ascii")
    sheet = " ".join(_sheet(**tomllib.loads(run.toml)["run"][0]) + _poses(machine, run.rows) for run in runs)
    (folder / "setup.html").write_text(f"<html>{sheet} No tool length is called.</html>", encoding="utf-8")
    seconds = sum(float(run.times[-1]) + 30.0 for run in runs) + 300.0 * len(runs)
    (folder / "plan.json").write_text(json.dumps({"minutes": seconds / 60.0}), encoding="utf-8")
    return folder


def _nest(machine: Machine) -> Made:
    nest = np.array([80.0, 30.0, 100.0])
    angles = [(0.0, 0.0), (20.0, 60.0), (-30.0, 140.0), (-30.0, -140.0)]
    toml = _toml("nest", "r_test", nest)
    return _made(
        machine, "nest", toml, angles, nest, ("Seat the ball in the nest, zero the sensors", "Free the ball"), bar=False
    )


def _bar(machine: Machine) -> Made:
    ball = np.array([60.0, -40.0, 120.0])
    place = ball + BAR * np.array([0.6, 0.0, 0.8])
    toml = _toml("bar", "ball_bar", ball) + f"length = {BAR}\n"
    return _made(machine, "bar", toml, [(0.0, 0.0), (15.0, 50.0), (-15.0, 90.0), (-15.0, -90.0)], place,
                 ("Mount the bar", "Remove the bar"), bar=True)  # fmt: skip


def _toml(name: str, instrument: str, table_ball: Array) -> str:
    return (
        f'[[run]]\nid = "{name}"\nfile = "{name}.csv"\ninstrument = "{instrument}"\nsampling = "static"\n'
        f"table_ball = {table_ball.tolist()}\ntool_ball = [0.0, 0.0, {-TOOL_LENGTH}]\n"
    )


def _sheet(*, id: str, table_ball: list[float], tool_ball: list[float], length: float = 0.0, **_: str) -> str:
    x, y, z = (round(value) for value in table_ball)
    bar = f"Bar of {length:g} mm." if length else ""
    tool = f"the tool ball at {-tool_ball[2]:g} mm below the spindle nose"
    return f"<p>Run {id} · place the ball at x = {x}, y = {y}, z = {z} mm, {tool}. {bar}</p>"


def _poses(machine: Machine, rows: Array) -> str:
    heads = "".join(
        f"<th>{name} / {'°' if turns else 'mm'}</th>" for name, turns in zip(machine.names, machine.rotary, strict=True)
    )
    lines = [[str(k + 1), str(k + 2), *(f"{v:.3f}" for v in row)] for k, row in enumerate(rows)]
    body = "".join("<tr>" + "".join(f'<td class="n">{cell}</td>' for cell in line) + "</tr>" for line in lines)
    b = rows[:, machine.names.index("B")]
    return f'It turns B from {b.min():g}° to {b.max():g}°.<table class="poses-list"><tr>{heads}</tr>{body}</table>'


def _made(machine: Machine, name: str, toml: str, angles: list[tuple[float, float]], place: Array, said: tuple[str, str], *,
          bar: bool) -> Made:  # fmt: skip
    """Rows at `angles` (B, C); between the last two the program goes out and in again."""
    rows = np.array([_at(machine, b, c, place) for b, c in angles])
    steps: list[Step] = [*_in(machine, rows[0]), ("stop", said[0], 0.0), ("dwell", None, DWELL)]
    times = [0.0]
    for k in range(1, len(rows)):
        taken = WAY
        if k < len(rows) - 1:
            for share in np.linspace(0.0, 1.0, BLOCKS + 1)[1:]:
                b, c = (1.0 - share) * np.array(angles[k - 1]) + share * np.array(angles[k])
                steps.append(("feed", _at(machine, b, c, place), WAY / BLOCKS))
        else:
            steps += [("stop", said[1], 0.0)] if bar else []
            steps += [*_out(machine, rows[k - 1]), *_in(machine, rows[k])]
            steps += [("stop", said[0], 0.0)] if bar else []
            taken = 2.0 * CREEP + 3.2
        steps.append(("dwell", None, DWELL))
        times.append(times[-1] + taken + DWELL)
    steps += [("stop", said[1], 0.0), *_out(machine, rows[-1])]
    return Made(name, toml, rows, np.array(times), steps)


def _at(machine: Machine, b: float, c: float, place: Array) -> Array:
    q = np.zeros((1, len(machine.names)))
    q[0, machine.names.index("B")], q[0, machine.names.index("C")] = b, c
    return np.round(machine.following(q, place[None, :], np.array([0.0, 0.0, -TOOL_LENGTH]))[0], 4) + 0.0


def _in(machine: Machine, row: Array) -> Iterator[Step]:
    """From the top: rotary axes, plane, tool axis down, and in at a creep."""
    lifted = row.copy()
    lifted[machine.names.index("Z")] += LIFT
    yield "rapid BC", lifted, 0.0
    yield "rapid XY", lifted, 0.0
    yield "rapid Z", lifted, 0.0
    yield "feed", row, CREEP


def _out(machine: Machine, row: Array) -> Iterator[Step]:
    lifted = row.copy()
    lifted[machine.names.index("Z")] += LIFT
    yield "feed", lifted, CREEP
    yield "top", None, 0.0


def _words(machine: Machine, q: Array, letters: str, form: Callable[[str, float], str]) -> str:
    return " ".join(form(n, float(q[machine.names.index(n)])) for n in "XYZABC" if n in letters and n in machine.names)


def _plain(name: str, value: float) -> str:
    return f"{name}{value:.4f}"


def _gcode(machine: Machine, run: Made, head: list[str], top: str, dwell: str, stop: Callable[[str], list[str]], tail: list[str]
           ) -> Iterator[str]:  # fmt: skip
    yield from head
    for kind, value, seconds in run.steps:
        if kind == "feed":
            yield f"G1 {_words(machine, value, 'XYZBC', _plain)} F{60.0 / seconds:.6g}"
        elif kind.startswith("rapid"):
            yield f"G0 {_words(machine, value, kind[6:], _plain)}"
        elif kind == "dwell":
            yield dwell.format(seconds)
        elif kind == "top":
            yield top
        else:
            yield from stop(str(value))
    yield from tail


def _iso(machine: Machine, run: Made) -> Iterator[str]:
    head = ["%", f"O0001 ({run.name})", "G21 G90 G17 G40 G80", "M5", "G53 G0 Z0", "G49", "G54", "G93"]
    return _gcode(machine, run, head, "G53 G0 Z0", "G4 X{:.3f}", lambda t: [f"M0 ({t})"], ["G94", "M30", "%"])


def _linuxcnc(machine: Machine, run: Made) -> Iterator[str]:
    head = [f"({run.name})", "G21 G90 G17 G40 G49 G80", "M5", "G53 G0 Z0", "G54", "G64 P0.005", "G93"]
    return _gcode(machine, run, head, "G53 G0 Z0", "G4 P{:.3f}", lambda t: [f"(MSG, {t})", "M0"], ["G94", "M2"])


def _siemens(machine: Machine, run: Made) -> Iterator[str]:
    head = [f"; {run.name}", "G71 G90 G17 G40", "TRAFOOF", "D0", "M5", "SUPA G0 Z0", "G54", "G93"]
    return _gcode(
        machine, run, head, "SUPA G0 Z0", "G4 F{:.3f}", lambda t: [f'MSG("{t}")', "M0", "MSG()"], ["G94", "M30"]
    )


def _heidenhain(machine: Machine, run: Made) -> Iterator[str]:
    head = "TOOL CALL 0 Z S0|M129|M5|L Z-1 R0 FMAX M91|CYCL DEF 247 DATUM SETTING ~|Q339=+1 ;DATUM NUMBER"
    lines = [f"BEGIN PGM {run.name.upper()} MM", *head.split("|")]
    before = np.zeros(len(machine.names))
    for kind, value, seconds in run.steps:
        if kind == "feed":
            way = float(np.linalg.norm((np.asarray(value) - before)[~machine.rotary]))
            lines.append(f"L {_words(machine, value, 'XYZBC', _signed)} R0 F{60.0 * way / seconds:.1f}")
        elif kind.startswith("rapid"):
            lines.append(f"L {_words(machine, value, kind[6:], _signed)} R0 FMAX")
        elif kind == "dwell":
            lines += ["CYCL DEF 9.0 DWELL TIME", f"CYCL DEF 9.1 DWELL {seconds:.3f}"]
        elif kind == "top":
            lines.append("L Z-1 R0 FMAX M91")
        else:
            lines += [f"; {value}", "STOP M0"]
        before = np.asarray(value) if kind.startswith(("feed", "rapid")) else before
    lines += ["M30", f"END PGM {run.name.upper()} MM"]
    return (f"{i} {line}" for i, line in enumerate(lines))


def _signed(name: str, value: float) -> str:
    return f"{name}{value:+.4f}"


WRITERS = {
    "iso": (".nc", _iso),
    "siemens": (".mpf", _siemens),
    "heidenhain": (".h", _heidenhain),
    "linuxcnc": (".ngc", _linuxcnc),
}
