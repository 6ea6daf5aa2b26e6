"""R-test on a grid of the rotary axes: the linear axes keep the nominal tool ball in the nest (Oyama et al.
2010)."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from symfive.campaign import Run, SetupSigma
from symfive.errors import InputError
from symfive.machine import Machine
from symfive.procedures._limits import checked
from symfive.procedures._nominal import Nominal
from symfive.procedures._setting import (
    BALL_SETUP,
    angles,
    heights,
    one_after_another,
    pose_times,
    rotary_axes,
    serpentine,
    tool_ball_of,
    vector,
)


def r_test_grid(
    machine: Machine, *, grid: Mapping[str, Sequence[float]] | None = None,
    nests: Sequence[Sequence[float]] | None = None, returning: bool = True, step_deg: float = 30.0,
    seconds_per_pose: float | None = None, tool_ball: Sequence[float] | None = None, noise_um: float = 0.4,
    setup_sigma_um: SetupSigma = BALL_SETUP,
) -> tuple[Run, ...]:  # fmt: skip
    """Static R-tests at every combination of the rotary axes' positions, one run per nest.

    `grid` axis → positions in degree, the last axis moving fastest, to and fro; by default every rotary axis
    in steps of `step_deg`, those with a full revolution last. `nests` mm in the workpiece frame, by default
    two at different heights and radii, which separate tilt from offset. `returning` repeats all poses in reverse
    order, so that every pose is approached from both sides and drift becomes visible. Rotary axes that are not in the
    grid and redundant linear axes stay at home. Works for table, head and nutating axes alike. Raises
    `InputError` where a pose cannot be reached.
    """
    rotary = rotary_axes(machine)
    if grid is None:
        grid = {name: angles(machine.axes[name], step_deg) for name in rotary}
    if not grid:
        raise InputError("the machine has no rotary axis", remedy="choose another procedure, or give a grid")
    if nests is None:
        low, high = heights(machine)
        reach = min(machine.workspace.table_radius or 100.0, 100.0)
        x, y = machine.table_centre
        nests = ((x + 0.9 * reach, y - 0.2 * reach, low), (x + 0.5 * reach, y + 0.4 * reach, high))
    ball = tool_ball_of(machine, tool_ball)
    poses = serpentine(grid, returning=returning)
    rows = len(next(iter(poses.values())))
    nominal = Nominal(machine)
    runs = []
    for number, nest in enumerate(map(vector, nests), start=1):
        run = Run(
            id=f"r-test-{number}", instrument=("r_test",), sampling="static", time=pose_times(machine, rows, seconds_per_pose),
            commands=nominal.follow(np.tile(nest, (rows, 1)), ball, poses, "R-test grid"), table_ball=nest,
            tool_ball=ball, noise_um=noise_um, setup_sigma_um=setup_sigma_um,
        )  # fmt: skip
        runs.append(checked(machine, run, place="the grid, the nest or the tool length"))
    return one_after_another(runs)
