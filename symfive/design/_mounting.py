"""What the set-up sheet says of a run: ball position, path of the tool ball, table of poses."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import takewhile
from typing import Any

import numpy as np

from symfive.arrays import Array
from symfive.campaign import FIRST_LINE, Campaign, Run
from symfive.errors import InputError
from symfive.instruments import columns_of, is_probed, mounted, touches_of
from symfive.nc import Post, word_order
from symfive.numbers import plain_number, unit_words
from symfive.procedures import Nominal

STILL = 1e-3
"""What moves by less, mm or degree, stands still; directions that differ by less are one."""
READ = {
    "dwell": "read",
    "stop": "the program stops and shows the number of the pose: read",
    "trigger": "your trigger line starts the reading of",
}
"""How a settled pose is read (`Post.at_pose`)."""


def digits(value: float) -> str:
    """mm or degree to 0.001."""
    return f"{round(float(value), 3) + 0.0:.3f}"


def short(value: float) -> str:
    """mm to 0.001, without zeros behind."""
    return digits(value).rstrip("0").rstrip(".")


def over_the_ball(nominal: Nominal, run: Run) -> dict[str, Array]:
    """Positions of the axes, (1,) each, at which the tool's ball stands where the table's does; none where they cannot."""
    try:
        return nominal.follow(np.array([run.table_ball]), run.tool_ball, {}, "the table ball")
    except InputError:
        return {}


def from_axes(nominal: Nominal, run: Run) -> dict[str, Array]:
    """From each rotary axis square across to the ball, (3,) mm in the machine frame, rotary axes at home."""
    at = over_the_ball(nominal, run) or nominal.commands({}, 1)
    ball = nominal.workpiece_origin(at)[0] + nominal.workpiece_rotation(at)[0] @ np.asarray(run.table_ball)
    found = {}
    for name, axis in nominal.machine.axes.items():
        if axis.rotary:
            foot, along = nominal.axis_line(name, at)
            found[name] = ball - foot - (ball - foot) @ along * along
    return found


def path_facts(nominal: Nominal, run: Run) -> dict[str, str]:
    """Radius, plane, direction and feed of the tool ball's path, as the workpiece sees it (the machine where only linear axes
    move)."""
    machine = nominal.machine
    moving = [name for name, q in run.commands.items() if np.ptp(q) > STILL]
    turning = [name for name in moving if machine.axes[name].rotary]
    way = nominal.ball(run.commands, run.tool_ball) - np.asarray(run.table_ball)
    if not turning:
        way = way @ nominal.workpiece_rotation(run.commands)[0].T
    frame = "workpiece frame" if turning else "machine frame"
    _, spread, axes = np.linalg.svd(way - way.mean(axis=0), full_matrices=False)
    wide = spread / np.sqrt(run.rows) > STILL
    if not wide[1]:
        if not wide[0]:
            return _carried(nominal, run, turning, way[0])
        line = way @ axes[0]
        return {
            "Path": f"straight, {plain_number(np.ptp(line))} mm",
            "Feed": f"{plain_number(run.fastest(line))} mm/min",
        }
    normal = axes[2] * np.sign(axes[2][np.argmax(np.abs(axes[2]))])
    ring = way - np.outer(way @ normal, normal)
    radius = np.linalg.norm(ring, axis=1)
    if wide[2] or np.ptp(radius) > STILL:
        return {}
    main = int(np.argmax(normal))
    lean = np.degrees(np.arccos(min(1.0, normal[main])))
    plane, towards = ("yz", "zx", "xy")[main], f"+{'xyz'[main]}"
    if lean > STILL:
        towards = f"({', '.join(map(digits, normal))})"
        plane = f"leaning by {lean:.1f}° from {plane}"
    u = ring[0] / radius[0]
    phi = np.unwrap(np.arctan2(ring @ np.cross(normal, u), ring @ u))
    sense = "counter-clockwise" if phi[-1] > phi[0] else "clockwise"
    facts = {
        "Circle": f"radius {plain_number(radius[0], 'mm')} mm, {np.degrees(np.ptp(phi)):.0f}° with run-up and run-out",
        "Plane": f"{plane} of the {frame}",
        "Direction": f"{sense}, viewed from {towards}",
        "Feed": f"{plain_number(run.fastest(radius[0] * phi))} mm/min along the circle",
    }
    if len(moving) == 2 and len(turning) == 1 and run.length is not None:
        x_t = float(np.linalg.norm(from_axes(nominal, run)[turning[0]]))
        together = f"{turning[0]} and {next(n for n in moving if n not in turning)} move"
        ratio = f"X_T/r = {plain_number(x_t)}/{plain_number(run.length)} = {plain_number(x_t / run.length)}"
        facts["Together"] = f"{together}; the ball is X_T = {digits(x_t)} mm from axis {turning[0]}, {ratio}"
    return facts


def _carried(nominal: Nominal, run: Run, turning: Sequence[str], bar: Array) -> dict[str, str]:
    """The tool's ball rests beside the workpiece: how the bar lies to the axis that turns."""
    if len(turning) != 1:
        return {}
    (name,) = turning
    q, home = run.commands[name], nominal.commands({}, 1)
    _, along = nominal.axis_line(name, home)
    across = from_axes(nominal, run)[name]
    bar = nominal.workpiece_rotation(home)[0] @ bar / max(float(np.linalg.norm(bar)), STILL)
    outward = abs(bar @ across) / max(float(np.linalg.norm(across)), STILL)
    lies = (
        "along"
        if abs(bar @ along) > 0.999
        else "tangential to"
        if outward < STILL < np.linalg.norm(across)
        else "radial to"
    )
    return {
        "Bar": f"{lies} axis {name}, turning with it",
        "Direction": f"{name} {'rising' if q[-1] > q[0] else 'falling'}",
        "Feed": f"{plain_number(run.fastest(q))} {unit_words(nominal.machine.axes[name].unit)}/min of {name}",
    }


def mounted_before(runs: Sequence[Run], run: Run) -> Run | None:
    """The first of the earlier runs whose ball, tool and bar stand as in this one; of a recording only those right before it, in
    which nothing was taken away since. None where it is a new mounting."""
    earlier = list(runs[: [r.id for r in runs].index(run.id)])
    if run.dynamic:
        earlier = list(takewhile(lambda e: e.stands == run.stands, reversed(earlier)))[::-1]
    return next((e for e in earlier if e.stands == run.stands), None)


def pose_table(campaign: Campaign, run: Run, post: Post) -> dict[str, Any]:
    """Pose by pose: number, line of the file, when the program gets there, the axes' positions, what to do before: `heads`, and
    `rows` of numbers and what comes before.

    All poses of a run have the same ball, dwell and reading columns; `what` says these.
    """
    machine = campaign.machine
    names = word_order(machine)
    positions = [f"{name} / {unit_words(machine.axes[name].unit)}" for name in names]
    rows, readings = [], _readings(run)
    probed = is_probed(run)
    waits = 0.0 if probed else post.dwell_s
    for row in range(run.rows):
        at = float(run.time[row]) + waits
        numbers = [str(row + 1), str(row + FIRST_LINE), f"{int(at) // 60}:{at % 60:04.1f}"]
        numbers += [f"{run.commands[name][row] + 0.0:.3f}" for name in names]
        rows.append((numbers, _before(run, row, post, readings[row])))
    different = len({same[0] for same in readings})
    counted = f"All {run.rows} poses" + (f", {different} of them different" if different < run.rows else "")
    return {
        "what": f"{counted}: {_how_read(campaign, run, post)}.",
        "heads": ["pose", "line", f"{'touched' if probed else 'read'} at / min:s", *positions, "remark"],
        "rows": rows,
    }


def _how_read(campaign: Campaign, run: Run, post: Post) -> str:
    """What stands where, and how a pose is read."""
    at = ", ".join(map(short, run.table_ball))
    if is_probed(run):
        return f"sphere at ({at}) mm, {len(touches_of(run))} touches at each, which the control logs"
    columns = [column.name for column in columns_of(run, campaign.machine)]
    bar = "" if run.length is None else f", bar of {run.length:g} mm"
    stands, _ = mounted(run)
    what = f"{stands} at ({at}) mm{bar}; " if stands else ""
    read = f"{post.dwell_s:g} s at rest, then {READ[post.at_pose]} {', '.join(columns)}"
    return f"{what}{read} into the line of {run.file}"


def _leaves(run: Run) -> str:
    """What the operator does where the tool ball leaves its nest, or a head the ball on the table."""
    stands, held = mounted(run)
    moved = held.split()[-1]
    again = "seat it" if moved == "ball" else "bring it to the ball"
    return f"{moved} leaves the {stands}; {again} again, do not move the {stands}"


def _readings(run: Run) -> list[list[int]]:
    """For every row the rows of the same pose, itself included."""
    rows = list(zip(*(q.tolist() for q in run.commands.values()), strict=True))
    same: dict[tuple[float, ...], list[int]] = {}
    for i, pose in enumerate(rows):
        same.setdefault(pose, []).append(i)
    return [same[pose] for pose in rows]


def _before(run: Run, row: int, post: Post, same: Sequence[int]) -> str:
    """What the operator has to know before a pose; `same` rows are of this pose."""
    said = []
    if row in post.unsafe.get(run.id, ()) and not is_probed(run):
        bar = run.length is not None
        said.append("remove the bar, mount it again" if bar else _leaves(run))
    if run.spindle is not None and (row == 0 or run.spindle[row] != run.spindle[row - 1]):
        said.append(f"spindle turned to {run.spindle[row]:g}°")
    if row > same[0]:
        said.append(f"again pose {same[0] + 1}, reading {same.index(row) + 1} of {len(same)}")
    elif len(same) > 1:
        said.append(f"pose measured {len(same)} times")
    return "; ".join(said)
