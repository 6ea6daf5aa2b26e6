"""Table of poses on the set-up sheet: positions, time of reading, preparation."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from symfive.campaign import FIRST_LINE, Campaign, Run
from symfive.instruments import instruments_of, mounted, touches_of
from symfive.nc import Post
from symfive.numbers import unit_words

READ = {
    "dwell": "read",
    "stop": "the program stops and shows the number of the pose: read",
    "trigger": "your trigger line starts the reading of",
}
"""How a settled pose is read (`Post.at_pose`)."""


def mounted_before(runs: Sequence[Run], run: Run) -> Run | None:
    """The first of the earlier runs whose ball, tool and bar stand as in this one; None where it is a new mounting."""
    mounting = (run.table_ball, run.tool_ball, run.length)
    for earlier in runs[: [r.id for r in runs].index(run.id)]:
        if (earlier.table_ball, earlier.tool_ball, earlier.length) == mounting:
            return earlier
    return None


def pose_table(campaign: Campaign, run: Run, post: Post) -> dict[str, Any]:
    """Pose by pose: number, line of the file, when the program gets there, the axes' positions, what to do before: `heads`, and
    `rows` of numbers and what comes before.

    All poses of a run have the same ball, dwell and reading columns; `what` says these.
    """
    machine = campaign.machine
    names = sorted(machine.axis_names, key=lambda name: not machine.axes[name].rotary)
    positions = [f"{name} / {unit_words(machine.axes[name].unit)}" for name in names]
    rows, readings = [], _readings(run)
    probed = "touch_probe" in run.instrument
    waits = 0.0 if probed else post.dwell_s
    for row in range(run.rows):
        numbers = [str(row + 1), str(row + FIRST_LINE), _clock(float(run.time[row]) + waits)]
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
    at = ", ".join(f"{v:.1f}" for v in run.table_ball)
    if "touch_probe" in run.instrument:
        return f"sphere at ({at}) mm, {len(touches_of(run))} touches at each, which the control logs"
    columns = [column.name for i in instruments_of(run) for column in i.columns(run, campaign.machine)]
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


def _clock(seconds: float) -> str:
    return f"{int(seconds) // 60}:{seconds % 60:04.1f}"


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
    if row in post.unsafe.get(run.id, ()) and "touch_probe" not in run.instrument:
        bar = run.length is not None
        said.append("remove the bar, mount it again" if bar else _leaves(run))
    if run.spindle is not None and (row == 0 or run.spindle[row] != run.spindle[row - 1]):
        said.append(f"spindle turned to {run.spindle[row]:g}°")
    if row > same[0]:
        said.append(f"again pose {same[0] + 1}, reading {same.index(row) + 1} of {len(same)}")
    elif len(same) > 1:
        said.append(f"pose measured {len(same)} times")
    return "; ".join(said)
