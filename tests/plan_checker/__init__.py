"""An independent checker of measurement plans: reads a plan's folder and every NC program in it, and says what is wrong.

It shares no code with symfive: the files are read with tomllib and csv, the programs by readers of its own, the chain is the
independent plant's, the bodies are its own cylinders. `check(folder)` returns findings, each a sentence with file, line, number
and unit; `python -m tests.plan_checker DIR …` prints them and ends with 1 where there are any.

What a program must do (docs/design.md and docs/conventions.md say what the numbers mean):

    first move  the tool axis alone to its top in machine coordinates (G53, G28 in G91, SUPA, M91, M140), then the rotary axes,
                then the plane, then the tool axis down
    modal       plane, units, G90, no cutter compensation, length offset, datum and tool-centre control set before that
    poses       at every row of the file, in its order, the program rests (a dwell), to the last digit written
    series      a program of several runs, named by them with +, does so for each, the instrument seated throughout
    arc         a recorded circle is the control's own arc: the rows' circle, sense, angles and speed, with overshoot, in fewer
                than ten blocks; a bar is fed in and out radially
    travel      of every axis along every block, rapids both straight and each axis at its own speed
    feed        no axis above its greatest feed on the true path; static runs at most half of it while seated
    clearance   spindle nose, tool, ball bar, what carries the table ball, and table keep apart along the whole path
    bar, nest   while the bar is on: its length within the stroke, no rapid; the ball comes to its nest from above, creeping,
                and the tool leans no further than the nest opens
    stop        where a hand must act, with a text that this control shows
    table       balls stand within `table_radius` of the axis that turns the table, within `ball_height`
    time        the file's time table and the plan's minutes within 5 % of what the programs take
    end         the tool axis at its top, length, tool-centre control and G93 cancelled
    probing     touches stop on contact, are looked at, and log what they found (`_touching`)
    sheet       ball, tool, bar, datum, tool length, poses and angles turned as on setup.html
    dialects    the programs of all dialects describe the same motion
    program     every word is known to the checker

Not checked: where axes go before the program has brought them to known places, acceleration within a path of blocks, and what the
files do not describe (cradle, clamps, cables, sensors of the nest, covers).
"""

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path as File

import numpy as np

from . import _motion, _order, _times
from ._events import Control, Event, Finding
from ._gcode import GCode
from ._klartext import Klartext
from ._path import Path
from ._plan import Machine, Plan, Run, read_plan
from ._sheet import sheet
from .dialects import DIALECTS

__all__ = ["Finding", "Path", "Plan", "check", "read_plan", "read_program"]

RULES = (
    _order.modal, _order.first_move, _order.visits, _order.stops, _order.quiet, _order.end, _times.time_table, _motion.feeds,
)  # fmt: skip
"""Of every program."""
ALONG_THE_PATH = (_motion.travel, _motion.clearances, _motion.bar_length, _motion.nest)
"""Of one dialect's program, and of those of other dialects that do not describe the same motion."""


def read_program(machine: Machine, run: Run, file: File, dialect: str, reversed_axes: tuple[str, ...] = ()) -> Path:
    """One NC program as events and sampled path."""
    control = Control(machine, run, file, reversed_axes)
    reader = Klartext(control) if DIALECTS[dialect].klartext else GCode(control, dialect)
    reader.read(file.read_text(encoding="ascii"))
    if control.written > (kept := DIALECTS[dialect].decimals):
        control.fault(0, f"positions have {control.written} decimals, the control keeps {kept}")
    return Path(machine, run, dialect, control)


def check(folder: File | str, reversed_axes: tuple[str, ...] = ()) -> list[Finding]:
    """All findings of a plan's folder; an empty list where the plan is in order. A folder without programs is checked for
    its rows and its table only."""
    plan = read_plan(folder)
    found = [finding for run in plan.runs for finding in _set_up(plan, run)]
    read: dict[str, list[Path]] = {}
    for run in plan.runs:
        paths = []
        for dialect, files in plan.programs().items():
            if (name := run.table["id"]) in files:
                paths.append(read_program(plan.machine, run, files[name], dialect, reversed_axes))
                read.setdefault(dialect, []).append(paths[-1])
            else:
                found.append(Finding("program", plan.folder / "nc" / dialect, 0, f"no program for run {name}"))
        for path in paths:
            found += path.control.findings
            found += [finding for rule in RULES for finding in rule(path)]
            unlike = [] if path is paths[0] else list(_differs(paths[0], path))
            if path is paths[0] or unlike or path.seated.sum() != paths[0].seated.sum():
                found += [finding for rule in ALONG_THE_PATH for finding in rule(path)]
            found += unlike
    found += [
        finding
        for dialect, files in plan.programs().items()
        for finding in _series(plan, dialect, files, reversed_axes)
    ]
    found += _minutes(plan, read)
    found += sheet(plan, [path for paths in read.values() for path in paths])
    return found


def _series(plan: Plan, dialect: str, files: dict[str, File], reversed_axes: tuple[str, ...]) -> Iterator[Finding]:
    """A program of several runs, named by them with + between, does for each of them what a program of its own must do: it is
    read as the moves before the instrument is seated, that run's part between two stops, and the moves after."""
    runs = {run.table["id"]: run for run in plan.runs}
    for name, file in files.items():
        ids = name.split("+")
        if len(ids) == 1 and name in runs:
            continue
        if not set(ids) <= set(runs):
            yield Finding("program", file, 0, f"no run is named {name}")
            continue
        whole = read_program(plan.machine, runs[ids[0]], file, dialect, reversed_axes)
        yield from whole.control.findings
        seated, stops = whole.seated, [event.kind == "stop" for event in whole.events]
        first, last = int(np.argmax(seated)), len(seated) - 1 - int(np.argmax(seated[::-1]))
        cuts = [first, *(i for i in range(first + 1, last + 1) if stops[i]), last + 1]
        if len(cuts) - 1 != len(ids):
            yield Finding(
                "program", file, 0, f"{len(cuts) - 1} parts between stops with the instrument seated, {len(ids)} runs"
            )
            continue
        for k, id in enumerate(ids):
            part = whole.events[: first + 1] + whole.events[cuts[k] + 1 : cuts[k + 1]] + whole.events[last + 1 :]
            path = Path(plan.machine, runs[id], dialect, replace(whole.control, events=part))
            path.control.position = whole.control.position
            for rule in (*RULES, *ALONG_THE_PATH):
                yield from rule(path)


def _set_up(plan: Plan, run: Run) -> Iterator[Finding]:
    """Balls, tool and bar within the workspace, and rows within travel, range and stroke."""
    file, space, machine = plan.folder / "campaign.toml", plan.machine.workspace, plan.machine
    name = f"run {run.table['id']}"
    if not (run.bar or run.nest or run.probe):
        return
    off = float(np.hypot(*(run.table_ball[:2] - machine.table_centre)))
    if off > float(space.get("table_radius", np.inf)) + 1e-3:
        centre = " ".join(f"{v:g}" for v in machine.table_centre)
        yield Finding("table", file, 0, f"{name}: the table ball stands {off:.1f} mm from the table's centre ({centre}), "
                      f"table_radius is {space['table_radius']:g} mm")  # fmt: skip
    for what, key, value in (
        ("table ball's height", "ball_height", run.table_ball[2]), ("tool length", "tool_length", -run.tool_ball[2]),
    ):  # fmt: skip
        low, high = space.get(key, (-np.inf, np.inf))
        if not low - 1e-3 <= value <= high + 1e-3:
            yield Finding("table", file, 0, f"{name}: {what} {value:.3f} mm is not within {low:g} to {high:g} mm")
    low, high = machine.travel.T
    beyond = np.maximum(low - run.rows, run.rows - high)
    if beyond.max() > 1e-6:
        k, i = np.unravel_index(np.argmax(beyond), beyond.shape)
        yield Finding("travel", run.file, int(k) + 2, f"{machine.names[i]} is {beyond[k, i]:.3f} beyond its travel")
    ball = machine.points(run.rows, run.tool_ball[None, :])[:, 0]
    away = np.linalg.norm(ball - run.table_ball, axis=1) - (float(run.table["length"]) if run.bar else 0.0)
    reach = float(space.get("bar_stroke" if run.bar else "sensor_range", 1.0))
    k = int(np.argmax(np.abs(away)))
    if abs(away[k]) > reach:
        yield Finding(
            "bar" if run.bar else "nest",
            run.file,
            k + 2,
            f"the reading would be {away[k]:.3f} mm, the range is ± {reach:g} mm",
        )


def _differs(first: Path, other: Path) -> Iterator[Finding]:
    """Moves in work coordinates, dwells and stops agree with those of another dialect."""
    mine, theirs = (_order.joined(_compared(p)) for p in (first, other))
    if [e.kind for e in mine] != [e.kind for e in theirs]:
        yield other.fault(
            "dialects",
            1,
            f"the sequence of moves, dwells and stops is not that of {first.dialect} ({len(theirs)} and {len(mine)})",
        )
        return
    tolerance = 10.0 ** -min(first.control.decimals, other.control.decimals)
    for a, b in zip(mine, theirs, strict=True):
        ways = 3.0 if a.probing else 1.0  # a control that is told ways instead of places rounds each of them
        if a.motion and np.nan_to_num(np.abs(a.end - b.end)).max() > ways * tolerance:
            yield other.fault(
                "dialects", b.line, f"ends {np.nanmax(np.abs(a.end - b.end)):.5f} from line {a.line} of {first.dialect}"
            )
            return
        if a.arc and (not b.arc or a.arc.plane != b.arc.plane or abs(a.arc.sweep - b.arc.sweep) > 1e-4):
            yield other.fault("dialects", b.line, f"is not the arc of line {a.line} of {first.dialect}")
            return
        if a.text != b.text and a.kind == "log":
            yield other.fault("dialects", b.line, f"logs {b.text}, line {a.line} of {first.dialect} {a.text}")
            return
        if abs(np.nan_to_num(a.seconds) - np.nan_to_num(b.seconds)) > 0.01 * np.nan_to_num(a.seconds) + 0.002:
            yield other.fault(
                "dialects", b.line, f"takes {b.seconds:.3f} s, line {a.line} of {first.dialect} {a.seconds:.3f} s"
            )
            return


def _compared(path: Path) -> list[Event]:
    """What programs of all dialects do; a control's own way back from a touch is one with the move that goes on from it."""
    kinds, linear = ("rapid", "feed", "dwell", "stop", "orient", "log"), ~path.machine.rotary
    found: list[Event] = []
    for event in (e for e in path.events if e.kind in kinds and not e.machine):
        back = found[-1] if found and found[-1].probing == "back" else None
        if back and event.kind == "log":
            found.insert(len(found) - 1, event)
            continue
        if back and event.kind == "feed" and event.probing != "touch":
            whole = replace(event, start=back.start)
            found[-1] = replace(whole, seconds=event.seconds * whole.length(linear) / event.length(linear))
            continue
        found.append(event)
    return found


def _minutes(plan: Plan, read: dict[str, list[Path]]) -> Iterator[Finding]:
    stated = plan.stated.get("minutes")
    for dialect, paths in read.items() if isinstance(stated, (int, float)) else ():
        least, most = _times.minutes(paths, plan.runs)
        if len(paths) == len(plan.runs) and not least <= stated <= most:
            taken = f"the {dialect} programs take {least:.2f} to {most:.2f} min with 5 min of set-up a run"
            says = f"{stated:.2f} min are stated, {taken}"
            yield Finding("time", plan.folder / "plan.json", 0, says)
