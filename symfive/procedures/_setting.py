"""What a test uses where its caller does not say: balls, bars, angles from the machine's workspace and
travels."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import replace

import numpy as np

from symfive.arrays import Array
from symfive.campaign import Campaign, Run, SetupSigma
from symfive.errors import InputError, among
from symfive.machine import Axis, Machine
from symfive.runs import MOUNTED

Vector = tuple[float, float, float]
BALL_SETUP = SetupSigma()
"""Set-up of balls by hand: 20 µm each, 0.5 µm of bar length."""

PAUSE_S = 120.0


def tool_ball_of(machine: Machine, wanted: Sequence[float] | None) -> Vector:
    """The tool ball, mm in the tool frame: the given one or (0, 0, -L), L the middle of the workspace's
    tool lengths."""
    if wanted is not None:
        return vector(wanted)
    shortest, longest = machine.workspace.tool_length or (150.0, 150.0)
    return (0.0, 0.0, -(shortest + longest) / 2.0)


def vector(values: Sequence[float] | Array) -> Vector:
    """Three floats. Raises `InputError`."""
    array = np.asarray(values, dtype=float)
    if array.shape != (3,) or not np.isfinite(array).all():
        raise InputError(f"{list(values)} is not a point", remedy="write three finite numbers (x, y, z) in mm")
    return (float(array[0]), float(array[1]), float(array[2]))


def heights(machine: Machine) -> tuple[float, float]:
    """Lowest and highest table ball, mm."""
    return machine.workspace.ball_height or (50.0, 150.0)


def table_ball_of(machine: Machine, wanted: Sequence[float] | None) -> Vector:
    """The table ball, mm in the workpiece frame: the wanted one or over the table's centre at the middle of the ball heights."""
    return vector((*machine.table_centre, sum(heights(machine)) / 2.0) if wanted is None else wanted)


def circle_radius(machine: Machine, wanted: float | None) -> float:
    """The wanted radius or a bar of the workspace, mm. Raises `InputError`."""
    size = bar_length(machine, wanted)
    if not size > 0.0:
        raise InputError(f"a circle of radius {size:g} mm is none", remedy="give a radius above 0")
    return size


def pose_times(machine: Machine, rows: int, seconds: float | None) -> Array:
    """Times of the poses (rows,), s, by default as many seconds apart as the workspace says."""
    return (machine.workspace.seconds_per_pose if seconds is None else seconds) * np.arange(float(rows))


def bar_length(machine: Machine, wanted: float | None, near: float = 100.0) -> float:
    """The wanted length or the bar of the workspace nearest to `near`, mm."""
    if wanted is not None:
        return float(wanted)
    return min(machine.workspace.bar_lengths, key=lambda length: abs(length - near), default=near)


def rotary_axes(machine: Machine) -> tuple[str, ...]:
    """Rotary axes, those that cannot turn once around first."""
    return tuple(sorted(machine.rotary_axes, key=lambda name: whole_turn(machine.axes[name])))


def whole_turn(axis: Axis) -> bool:
    """Whether a rotary axis can turn once around."""
    return axis.travel[1] - axis.travel[0] >= 360.0


def turning_axis(machine: Machine, wanted: str | None) -> str:
    """The wanted rotary axis, or the one that turns the workpiece, or else any that turns."""
    names = rotary_axes(machine)
    if wanted is not None:
        among(wanted, names, f"the machine has no rotary axis {wanted}")
    if not names:
        raise InputError("the machine has no rotary axis", remedy="choose another procedure")
    on_table = [name for name in names if name in machine.structure.workpiece]
    return wanted or (on_table or list(names))[-1]


def angles(axis: Axis, step: float) -> tuple[float, ...]:
    """Angles of a rotary axis, degree: once around, or within ±90° (or half a turn to one side) of its
    travel."""
    low, high = axis.travel
    inside = step * np.arange(np.ceil(low / step - 1e-9), np.floor(high / step + 1e-9) + 1.0)
    if whole_turn(axis):
        start = 0.0 if low <= 0.0 <= high - 360.0 + step else inside[0]
        return tuple(float(v) for v in inside[(inside >= start) & (inside < start + 360.0 - 1e-9)])
    near = inside[np.abs(inside) <= 90.0]
    one_sided = near.size < 2 or near[0] > -step or near[-1] < step
    return tuple(float(v) for v in (inside[np.abs(inside) <= 180.0] if one_sided else near))


def serpentine(grid: Mapping[str, Sequence[float]], *, returning: bool = False) -> dict[str, Array]:
    """All poses of a grid: the last axis moves fastest, to and fro; `returning` appends all of them
    backwards.

    Each axis then approaches most poses from both sides, which makes its backlash visible. Raises
    `InputError`.
    """
    for name, values in grid.items():
        if len(values) == 0 or not np.isfinite(np.asarray(values, dtype=float)).all():
            raise InputError(f"the grid of axis {name} has no poses", remedy="give at least one finite position")
    rows: list[tuple[float, ...]] = [()]
    for values in grid.values():
        turns = [tuple(values), tuple(reversed(list(values)))]
        rows = [(*row, float(v)) for i, row in enumerate(rows) for v in turns[i % 2]]
    if returning:
        rows = rows + rows[::-1]
    return {name: np.array([row[i] for row in rows]) for i, name in enumerate(grid)}


def one_after_another(runs: Sequence[Run], *, pause_s: float = PAUSE_S) -> tuple[Run, ...]:
    """The runs with `start_s` set: each begins `pause_s` after the end of the one before."""
    laid, clock = [], 0.0
    for run in runs:
        laid.append(replace(run, start_s=clock))
        clock += run.duration + pause_s
    return tuple(laid)


def left_in_place(runs: Iterable[Run]) -> Iterator[Run]:
    """The runs, every recording of a ball bar with the mounting of the run before it if balls and bar stand as there: nobody
    touches them in between, so that their set-up errors are the same."""
    number, before = 0, None
    for run in runs:
        stands = run.stands if run.dynamic and run.length is not None else None
        number, before = number + (stands != before), stands
        yield run if stands is None else replace(run, mounting=dict.fromkeys(MOUNTED, f"{number}"))


def campaign_of(machine: Machine, runs: Sequence[Run], name: str = "plan", *, pause_s: float = PAUSE_S) -> Campaign:
    """A plan of these runs, one after another on one clock."""
    return Campaign(machine=machine, runs=one_after_another(runs, pause_s=pause_s), name=name)
