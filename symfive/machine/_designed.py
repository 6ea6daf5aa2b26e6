"""The machine as designed, in plain numbers: what a file can be judged by before any model is built."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from symfive.arrays import Array

if TYPE_CHECKING:
    from symfive.machine._data import Machine


def designed_ball(machine: Machine, commands: Mapping[str, Array], tool_ball: ArrayLike) -> Array:
    """The tool's ball in the workpiece frame (N, 3) mm without errors; `commands` axis → (N,) in mm or degree.

    From the tool to the bed and on to the workpiece every axis moves it along its direction by q, or turns it about its line by
    q (conventions, section 1, all errors zero: the workpiece side moves by -q and is inverted).
    """
    structure = machine.structure
    count = len(next(iter(commands.values())))
    point = np.broadcast_to(np.asarray(tool_ball, dtype=float), (count, 3))
    for name in (*reversed(structure.tool), *reversed(structure.workpiece)):
        axis = machine.axes[name]
        q, direction = commands[name][:, None] * axis.to_internal, np.array(axis.direction)
        if not axis.rotary:
            point = point + direction * q
            continue
        arm = point - np.array(axis.origin)
        along = (arm @ direction)[:, None] * direction
        point = np.array(axis.origin) + along + (arm - along) * np.cos(q) + np.cross(direction, arm) * np.sin(q)
    return np.asarray(point)
