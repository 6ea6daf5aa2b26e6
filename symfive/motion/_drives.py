"""What the drive of an axis makes of its command (conventions, section 3), and its derivatives in the drive's quantities."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from symfive.arrays import Array
from symfive.motion._friction import FRICTION, add_friction, states_with_friction
from symfive.motion._loop import LOOP, acceleration, linear_states

GAINS = (*LOOP, *FRICTION)
"""The quantities of a drive that can be parameters."""


def drive_response(command: Array, dt: float, gains: Mapping[str, float], wanted: tuple[str, ...]) -> Array:
    """Motion of the driven axis and its derivatives with respect to `wanted` gains.

    `command` (N,) at a constant rate of 1/`dt`, mm or rad; the axis stands still on the first one. Returns (N, 3, 1 +
    len(wanted)): position, velocity, acceleration (in mm or rad), last index value first, then derivatives.
    """
    reference = float(command[0])
    relative = np.asarray(command, dtype=float) - reference
    slope = np.append(np.diff(relative) / dt, 0.0)
    vector = np.array([gains[name] for name in LOOP])
    friction = np.array([float(gains.get(name, 0.0)) for name in FRICTION])
    rubs = bool(friction[:2].any()) or any(name in FRICTION for name in wanted)
    if rubs:
        states = states_with_friction(relative, slope, dt, vector, friction, wanted)
    else:
        states = linear_states(relative, slope, dt, vector, wanted)
    motion = np.empty((len(command), 3, 1 + len(wanted)))
    motion[:, 0:2] = states[:, 0:2]
    row, slopes = acceleration(vector)
    state = np.column_stack([states[:, :3, 0], relative, slope])
    motion[:, 2, 0] = state @ row
    for i, name in enumerate(wanted):
        direct = state @ slopes[:, LOOP.index(name)] if name in LOOP else 0.0
        motion[:, 2, 1 + i] = states[:, :3, 1 + i] @ row[:3] + direct
    if rubs:
        add_friction(motion, states, friction, wanted, dt)
    motion[:, 0, 0] += reference
    return motion
