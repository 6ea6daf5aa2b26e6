"""The steps of a program, and how long they take."""

from __future__ import annotations

import statistics
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from symfive.arrays import Array
from symfive.campaign import Run
from symfive.errors import InputError
from symfive.instruments import has_bar, is_probed
from symfive.machine import Machine
from symfive.nc._arc import circle_of
from symfive.nc._base import Step
from symfive.nc._post import Post
from symfive.nc._probing import ProbeWays
from symfive.nc._recording import STANDSTILL, pose_of, pulled_out
from symfive.nc._route import Positions
from symfive.nc._writer import LINEAR, ORIENT_S, ROTARY, Writer

SHORT_REST_S = 0.1


def check_addresses(machine: Machine) -> None:
    """Raises `InputError` for an axis whose name is no NC address of its kind: a control reads the feed of W in mm/min."""
    for name, axis in machine.axes.items():
        letters = ROTARY if axis.rotary else LINEAR
        if name not in letters:
            kind = "rotary" if axis.rotary else "linear"
            remedy = f"name {kind} axes by {', '.join(letters)} for programs"
            raise InputError(f"axis {name} has no NC address", remedy=remedy)


def addressed(machine: Machine) -> bool:
    """Whether all axes have an NC address."""
    try:
        check_addresses(machine)
    except InputError:
        return False
    return True


def program_steps(machine: Machine, run: Run, post: Post | None = None) -> list[Step]:
    """The steps of a run's program. Raises `InputError` for an axis whose name is no NC address, and where no travel is left to
    draw the tool back."""
    check_addresses(machine)
    return _without_standstill(_writer_of(machine, run, post or Post()).steps())


def series_of(machine: Machine, runs: Sequence[Run]) -> list[tuple[Run, ...]]:
    """Circles that one program can run without removing the bar: same mounting, each from the end of the one before."""
    series: list[list[Run]] = []
    for run in runs:
        if series and _goes_on(machine, series[-1][-1], run):
            series[-1].append(run)
        else:
            series.append([run])
    return [tuple(found) for found in series if len(found) > 1]


def _goes_on(machine: Machine, before: Run, run: Run) -> bool:
    """Whether a circle begins, its bar pulled out, where the one before it ended."""
    a, b = circle_of(machine, before), circle_of(machine, run)
    if a is None or b is None or (before.instrument, before.stands) != (run.instrument, run.stands):
        return False
    if not has_bar(run) or (a.plane, a.centre, a.radius) != (b.plane, b.centre, b.radius):
        return False
    there, here = pulled_out(before, a, before.rows - 1), pulled_out(run, b, 0)
    return all(abs(there[name] - here[name]) < STANDSTILL for name in here)


def series_name(runs: Sequence[Run]) -> str:
    """The name of the program of a series: no control takes those of all runs."""
    return f"{runs[0].id}-and-{len(runs) - 1}-more"


def series_steps(machine: Machine, runs: Sequence[Run], post: Post) -> list[Step]:
    """The steps of one program for all circles of a series: a stop between two of them at which the instrument's software is made
    ready, the bar stays on. Its moves are those of the runs' own programs."""
    writers = [Writer(machine, run, post) for run in runs]
    steps = writers[0].opening()
    for number, writer in enumerate(writers):
        circle = writer.circle
        assert circle is not None  # `series_of` asked
        if number:
            sense = "CCW" if circle.sweep > 0.0 else "CW"
            steps.append(Step(kind="comment", text=f"run {writer.run.id}, {writer.run.rows} rows"))
            steps.append(Step(kind="stop", text=f"STORED? THEN {sense} F{circle.feed:g}"))
        steps += writer.recording()
    return _without_standstill([*steps, *writers[-1].closing()])


def stands(machine: Machine, run: Run, row: int) -> list[Positions]:
    """Positions of all axes from where a row's pose is entered to where it is left: the pose, or a touch probe's way around the
    sphere. Raises `InputError` where that leaves a travel."""
    if is_probed(run):
        return ProbeWays(machine, run, Post()).stands(row)
    return [pose_of(run, row)]


def _writer_of(machine: Machine, run: Run, post: Post) -> Writer:
    return (ProbeWays if is_probed(run) else Writer)(machine, run, post)


def arrival_times(machine: Machine, run: Run, post: Post, least_s: float = 0.0) -> Array:
    """Times (rows,) at which the program of a static run reaches its poses, s from the first one: its moves, the dwells,
    stops of `HAND_S` where a bar is removed and mounted, and of `READ_S` where the operator reads; at least `least_s` a
    pose, to 0.1 s. A touch probe needs its touches at every pose."""
    writer = _writer_of(machine, run, post)
    needed = [
        writer.stays(row - 1) + writer.seconds_to(row) + (ORIENT_S if writer.turned(row) else 0.0)
        for row in range(1, run.rows)
    ]
    each = np.maximum(
        np.ceil(np.array(needed) * 10.0 - 1e-6) / 10.0, least_s
    )  # the program waits on ways around: `tenths`
    return np.concatenate([[0.0], np.cumsum(each)])


def outside_s(machine: Machine, run: Run, post: Post) -> float:
    """Time of a program's moves before the first pose and from the last dwell or touch on, s, without the stops."""
    writer = _writer_of(machine, run, post)
    steps = [*writer.first_moves(), *writer.last_moves("")]
    return writer.stays(run.rows - 1) + sum(step.seconds for step in steps)


def retract_words(machine: Machine, run: Run, post: Post) -> str:
    """How far the program draws the tool back, for the set-up sheet: most often so far, and where otherwise."""
    found = {row: round(mm) for row, mm in _writer_of(machine, run, post).retracts().items()}
    usual = statistics.mode(found.values())
    others = [f"{mm} mm at pose {row + 1}" for row, mm in sorted(found.items()) if mm != usual]
    return f"The program draws the tool back by {usual} mm{', '.join(['', *others])}"


def rotary_ranges(machine: Machine, run: Run, post: Post) -> str:
    """Between which angles the program turns each rotary axis, once it has reached the first pose; nothing where none turns."""
    ways = (*post.ways.get(run.id, {}).values(), *post.via.get(run.id, {}).values())
    said = []
    for name in machine.rotary_axes:
        angles = [machine.home(name), *run.commands[name].tolist(), *(place[name] for way in ways for place in way)]
        sign = -1.0 if name in post.reversed_axes else 1.0
        low, high = sorted((sign * min(angles), sign * max(angles)))
        if high - low > STANDSTILL:
            said.append(f"{name} from {low:.6g}° to {high:.6g}°")
    turned = " and ".join(said)
    return (
        f"The program turns {turned}: the control has to take each angle as written, not the shortest way"
        if said
        else ""
    )


def _without_standstill(steps: Sequence[Step]) -> list[Step]:
    """The steps without moves to where the axes stand already.

    While the instrument reads, their time stays: a rest becomes a dwell, a short one is added to the move that follows. A row
    that is reached stays with the move that reached it.
    """
    found: list[Step] = []
    there: dict[str, float] = {}
    rest: Step | None = None
    for step in steps:
        stands = all(name in there and abs(q - there[name]) < STANDSTILL for name, q in step.positions.items())
        if step.kind in ("rapid", "feed") and stands:
            if step.seated:
                before = rest.seconds if rest else 0.0
                rest = replace(step, kind="dwell", positions={}, commands={}, seconds=before + step.seconds)
            elif step.row is not None:
                last = max(i for i, s in enumerate(found) if s.positions and s.kind != "text")
                found[last] = replace(found[last], row=step.row, towards=step.towards)
            continue
        if rest is not None and step.kind == "feed" and step.seated and rest.seconds < SHORT_REST_S:
            step = replace(step, seconds=step.seconds + rest.seconds)
        elif rest is not None:
            found.append(rest)
        rest = None
        if step.kind in ("text", "retract"):  # the words mean something else, or the place is not known in them
            there = {}
        else:
            there.update(step.positions)
        found.append(step)
    return found
