"""How the motion of the axes changes with the path: derivatives with respect to what shapes the commands.

A path c(t; v) is recorded at N rows h(v) apart. The drive's step s[k+1] = A(g, h) s[k] + B(g, h) u[k], u = (c, Δc/h), is exact
(`_drives`), so its derivatives in v are the recursion differentiated,

    s'[k+1]  = A s'[k] + B u'[k] + h' (A_h s[k] + B_h u[k]),

and those of its sensitivities to a gain g, s_g, are the same once more. All are linear recurrences with the matrix A.
"""

from __future__ import annotations

from collections.abc import Mapping
from functools import lru_cache
from typing import Any

import casadi as ca
import numpy as np

from symfive.arrays import Array
from symfive.motion._loop import LOOP, acceleration, discretisation, linear_recurrence


@lru_cache(maxsize=1)
def _in_time() -> Any:
    """(gains, h) → d/dh of the step matrix (18) and of its derivative in the gains (18×5)."""
    inputs = [ca.MX.sym("gains", 5), ca.MX.sym("h")]
    step, slope = discretisation()(*inputs)
    return ca.Function("in_time", inputs, [ca.jacobian(ca.vec(step), inputs[1]), ca.jacobian(ca.vec(slope), inputs[1])])


def moved_response(
    command: Array, moved: Array, dt: float, dt_moved: Array, gains: Mapping[str, float], wanted: tuple[str, ...]
) -> tuple[Array, Array]:
    """Motion of a driven axis without friction, and its derivatives in the path's parameters.

    `command` (N,) and its derivatives `moved` (N, nv); rows `dt` s apart, with derivatives `dt_moved` (nv,). Returns what
    `drive_response` does, (N, 3, 1 + len(wanted)), and its derivatives (N, 3, 1 + len(wanted), nv).
    """
    n, nv = moved.shape
    relative, relative_moved = command - command[0], moved - moved[0]
    slope, slope_moved = np.zeros(n), np.zeros((n, nv))
    slope[:-1] = np.diff(relative) / dt
    slope_moved[:-1] = np.diff(relative_moved, axis=0) / dt - np.outer(slope[:-1], dt_moved / dt)
    vector = np.array([gains[name] for name in LOOP])
    step, by_gain = (np.asarray(part) for part in discretisation()(vector, dt))
    by_time, by_both = (np.asarray(part) for part in _in_time()(vector, dt))
    places = [LOOP.index(name) for name in wanted]
    A_h = by_time.reshape(3, 6, order="F")
    A_g = [by_gain[:, i].reshape(3, 6, order="F") for i in places]
    A_gh = [by_both.reshape(18, 5, order="F")[:, i].reshape(3, 6, order="F") for i in places]
    inputs = np.stack([relative, slope], axis=1)
    inputs_moved = np.stack([relative_moved, slope_moved], axis=1)

    def solve(forcing: Array) -> Array:
        shifted = np.zeros_like(forcing)
        shifted[1:] = forcing[:-1]
        return linear_recurrence(step[:, :3], shifted)

    def through(matrix: Array, state: Array, driven: Array) -> Array:
        """matrix (3, 6) on (state, inputs), each (N, ·, m): (N, 3, m)."""
        return np.asarray(
            np.einsum("ij,kjm->kim", matrix[:, :3], state) + np.einsum("ij,kjm->kim", matrix[:, 3:5], driven)
        )

    still, nothing = inputs[:, :, None], np.zeros((n, 3, nv))
    value = solve(through(step, np.zeros((n, 3, 1)), still))
    value_moved = solve(through(step, nothing, inputs_moved) + through(A_h, value, still) * dt_moved)
    states, states_moved = [value], [value_moved[:, :, None, :]]
    for first, second in zip(A_g, A_gh, strict=True):
        by = solve(through(first, value, still))
        states.append(by)
        driven = through(first, value_moved, inputs_moved) + through(second, value, still) * dt_moved
        driven += np.einsum("ij,kjm->kim", A_h[:, :3], by) * dt_moved
        states_moved.append(solve(driven)[:, :, None, :])
    return _with_acceleration(
        np.concatenate(states, axis=2), np.concatenate(states_moved, axis=2), (inputs, inputs_moved), vector, places,
        float(command[0]), moved[0],
    )  # fmt: skip


def _with_acceleration(
    states: Array, moved: Array, inputs: tuple[Array, Array], gains: Array, places: list[int], start: float,
    start_moved: Array,
) -> tuple[Array, Array]:  # fmt: skip
    """Position, velocity and acceleration of (position, velocity, integral), and their derivatives in the path."""
    row, slopes = acceleration(gains)
    motion, motion_moved = states.copy(), moved.copy()
    motion[:, 2] = np.einsum("i,kim->km", row[:3], states)
    motion_moved[:, 2] = np.einsum("i,kimv->kmv", row[:3], moved)
    motion[:, 2, 0] += inputs[0] @ row[3:]
    motion_moved[:, 2, 0] += np.einsum("i,kiv->kv", row[3:], inputs[1])
    for j, place in enumerate(places, start=1):
        motion[:, 2, j] += states[:, :, 0] @ slopes[:3, place] + inputs[0] @ slopes[3:, place]
        motion_moved[:, 2, j] += np.einsum("i,kiv->kv", slopes[:3, place], moved[:, :, 0])
        motion_moved[:, 2, j] += np.einsum("i,kiv->kv", slopes[3:, place], inputs[1])
    motion[:, 0, 0] += start
    motion_moved[:, 0, 0] += start_moved
    return motion, motion_moved
