"""Static ball bar: at every pose the nominal tool ball stands one bar's length from the table ball."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from symfive.arrays import Array
from symfive.campaign import Run, SetupSigma
from symfive.errors import InputError
from symfive.machine import Machine
from symfive.procedures._limits import checked
from symfive.procedures._nominal import Nominal
from symfive.procedures._setting import (
    BALL_SETUP,
    angles,
    bar_length,
    heights,
    one_after_another,
    pose_times,
    serpentine,
    tool_ball_of,
    turning_axis,
    vector,
)


def static_ball_bar(
    machine: Machine, *, poses: Mapping[str, Sequence[float] | Array] | None = None,
    direction: Sequence[float] | Sequence[Sequence[float]] | None = None,
    table_balls: Sequence[Sequence[float]] | None = None, length: float | None = None,
    seconds_per_pose: float | None = None, tool_ball: Sequence[float] | None = None, noise_um: float = 0.4,
    setup_sigma_um: SetupSigma = BALL_SETUP,
) -> tuple[Run, ...]:  # fmt: skip
    """Static ball-bar readings, one run per position of the table ball.

    `poses` axis → positions in degree, one per row (`serpentine` makes them from a grid); by default one turn
    of the table (or of the head) in steps of 15°. `direction` of the bar from the table ball to the tool ball
    in the machine frame, one for all poses or one each; by default the bar turns with the workpiece, against its x.
    `table_balls` mm in the workpiece frame, by default at two heights, one bar's length from the table's centre, over which
    the tool ball then stands still (Wang & Li 2016, (14)-(15)); `length` mm. Raises `InputError` where a pose cannot be reached.
    """
    if poses is None:
        name = turning_axis(machine, None)
        poses = serpentine({name: angles(machine.axes[name], 15.0)})
    fixed = {name: np.asarray(values, dtype=float) for name, values in poses.items()}
    sizes = {values.size for values in fixed.values()}
    if len(sizes) != 1 or 0 in sizes:
        raise InputError("the poses differ in number from axis to axis", remedy="give every axis one position per row")
    rows = sizes.pop()
    size = bar_length(machine, length)
    if table_balls is None:
        x, y = machine.table_centre
        table_balls = [(x + size, y, height) for height in heights(machine)]
    ball = tool_ball_of(machine, tool_ball)
    nominal = Nominal(machine)
    bar = np.tile((-size, 0.0, 0.0), (rows, 1))
    if direction is not None:
        directions = np.broadcast_to(np.asarray(direction, dtype=float), (rows, 3))
        norms = np.linalg.norm(directions, axis=1)
        if not np.all(norms > 1e-9):
            raise InputError("a direction of the bar has no length", remedy="give a vector such as (1, 0, 0)")
        bar = nominal.seen_from_workpiece(nominal.commands(fixed, rows), size * directions / norms[:, None])
    runs = []
    for number, table_ball in enumerate(map(vector, table_balls), start=1):
        run = Run(
            id=f"ball-bar-{number}", instrument=("ball_bar",), sampling="static",
            time=pose_times(machine, rows, seconds_per_pose),
            commands=nominal.follow(np.asarray(table_ball) + bar, ball, fixed, "static ball bar"),
            table_ball=table_ball, tool_ball=ball, length=size, noise_um=noise_um, setup_sigma_um=setup_sigma_um,
        )  # fmt: skip
        runs.append(checked(machine, run, place="the poses, the table ball, the bar or the tool length"))
    return one_after_another(runs)
