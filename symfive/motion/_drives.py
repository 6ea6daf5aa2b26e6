"""The position loop of an axis (conventions, section 3), exactly discretised and differentiated.

    v_ref = position_gain·(c - x) + feedforward·dc/dt
    u     = velocity_gain·(v_ref - v + (1/integral_time)·∫(v_ref - v)dt) - viscous·v
    dx/dt = v,   dv/dt = u - coulomb·sgn(v)

The command is linear between rows, so with state (x, v, ∫) the step over one row is `exp` of a 5×5 matrix (first-order
hold, no discretisation error). The matrix exponential is a CasADi expression of the gains: its derivatives are exact.
Without friction the recursion is solved for all rows at once by recursive doubling; with friction a set-valued Coulomb
force, constant over a substep of at most 1 ms, brings the axis to rest whenever it can hold it there (P. Lötstedt 1982).
"""

from __future__ import annotations

from collections.abc import Mapping
from functools import lru_cache
from typing import Any

import casadi as ca
import numpy as np
from numpy.typing import NDArray

__all__ = ["GAINS", "drive_response", "linear_recurrence"]

Array = NDArray[np.float64]
GAINS = ("position_gain", "velocity_gain", "integral_time", "viscous", "feedforward", "coulomb")
"""The quantities of a drive that can be parameters, in order; `coulomb` is mm/s² or rad/s²."""

SUBSTEP_S = 1e-3
_SQUARINGS = 14
_TERMS = 8


@lru_cache(maxsize=1)
def _loop() -> tuple[Any, Any, Any]:
    """(gains 5, dx/dt matrix 3×5 acting on (x, v, ∫, c, dc/dt)) as symbols."""
    kp, kv, ti, viscous, ff = gains = ca.SX.sym("gains", 5)[0], *ca.SX.sym("g", 4).elements()
    reference = ca.horzcat(-kp, 0, 0, kp, ff)
    error = reference - ca.horzcat(0, 1, 0, 0, 0)
    force = kv * (error + ca.horzcat(0, 0, 1 / ti, 0, 0)) - ca.horzcat(0, viscous, 0, 0, 0)
    return ca.vertcat(*gains), ca.vertcat(ca.horzcat(0, 1, 0, 0, 0), force, error), reference


@lru_cache(maxsize=1)
def _discretisation() -> Any:
    """(gains, h) → step matrix 3×6 on (x, v, ∫, c, dc/dt, force) and its derivative 18×5 with respect to the gains."""
    gains, rate, _ = _loop()
    h = ca.SX.sym("h")
    matrix = ca.SX.zeros(6, 6)
    matrix[0:3, 0:5] = rate
    matrix[3, 4] = 1
    matrix[1, 5] = 1
    scaled = matrix * (h / 2**_SQUARINGS)
    power, change = ca.SX.eye(6), ca.SX.zeros(6, 6)
    for k in range(1, _TERMS + 1):
        power = power @ scaled / k
        change = change + power
    inputs = [gains, h]
    squared = ca.SX.sym("E", 6, 6)
    square = ca.Function("square", [squared], [2 * squared + squared @ squared])
    # exp(M) - I is squared as 2E + E², which keeps the digits that I + E would lose
    function = ca.Function("taylor", inputs, [change])
    mx_inputs = [ca.MX.sym("gains", 5), ca.MX.sym("h")]
    result = function(*mx_inputs)
    for _ in range(_SQUARINGS):
        result = square(result)
    step = (result + ca.DM.eye(6))[0:3, :]
    return ca.Function("discretise", mx_inputs, [step, ca.jacobian(ca.vec(step), mx_inputs[0])])


@lru_cache(maxsize=1)
def _acceleration() -> Any:
    """(state 3, c, dc/dt, gains 5) → acceleration, its slope in the state and in the gains."""
    gains, rate, _ = _loop()
    state, c, slope = ca.SX.sym("s", 3), ca.SX.sym("c"), ca.SX.sym("dc")
    value = (rate @ ca.vertcat(state, c, slope))[1]
    return ca.Function("acceleration", [state, c, slope, gains], [value, ca.jacobian(value, state), ca.jacobian(value, gains)])


def linear_recurrence(step: Array, forcing: Array) -> Array:
    """s with s[k] = step · s[k-1] + forcing[k], s[-1] = 0, for a stable step, by recursive doubling.

    `step` (n, n), `forcing` (N, n, m); O(N log N) and no eigenvectors, so equal poles need no care.
    """
    state = forcing.copy()
    power, reach = step, 1
    while reach < len(state) and np.abs(power).max() > 1e-18:
        state[reach:] = state[reach:] + np.einsum("ij,kjm->kim", power, state[:-reach])
        power, reach = power @ power, 2 * reach
    return state


def drive_response(command: Array, dt: float, gains: Mapping[str, float], wanted: tuple[str, ...]) -> Array:
    """Motion of the driven axis and its derivatives with respect to `wanted` gains.

    `command` (N,) at a constant rate of 1/`dt`, mm or rad; the axis stands still on the first one. Returns
    (N, 3, 1 + len(wanted)): position, velocity, acceleration (in mm or rad), last index value first, then derivatives.
    """
    reference = float(command[0])
    relative = np.asarray(command, dtype=float) - reference
    slope = np.append(np.diff(relative) / dt, 0.0)
    vector = np.array([gains[name] for name in GAINS[:5]])
    coulomb = float(gains.get("coulomb", 0.0))
    if coulomb == 0.0 and "coulomb" not in wanted:
        states = _linear(relative, slope, dt, vector, wanted)
    else:
        states = _with_friction(relative, slope, dt, vector, coulomb, wanted)
    motion = np.empty((len(command), 3, 1 + len(wanted)))
    motion[:, 0:2] = states[:, 0:2]
    value, by_state, by_gain = (
        np.asarray(part) for part in _acceleration().map(len(command))(states[:, :, 0].T, relative[None], slope[None], vector)
    )
    by_state, by_gain = by_state.reshape(-1, 3), by_gain.reshape(-1, 5)
    motion[:, 2, 0] = value[0]
    for i, name in enumerate(wanted):
        direct = by_gain[:, GAINS.index(name)] if name != "coulomb" else 0.0
        motion[:, 2, 1 + i] = np.einsum("kj,kj->k", by_state, states[:, :, 1 + i]) + direct
    motion[:, 0, 0] += reference
    return motion


def _step_matrices(h: float, vector: Array, wanted: tuple[str, ...]) -> tuple[Array, list[Array]]:
    step, slope = (np.asarray(part) for part in _discretisation()(vector, h))
    slopes = [
        slope[:, GAINS.index(name)].reshape(3, 6, order="F") if name != "coulomb" else np.zeros((3, 6)) for name in wanted
    ]
    return step, slopes


def _linear(relative: Array, slope: Array, dt: float, vector: Array, wanted: tuple[str, ...]) -> Array:
    step, slopes = _step_matrices(dt, vector, wanted)
    inputs = np.stack([relative[:-1], slope[:-1]], axis=1)
    forcing = np.zeros((len(relative), 3, 1))
    forcing[1:, :, 0] = inputs @ step[:, 3:5].T
    value = linear_recurrence(step[:, :3], forcing)
    if not wanted:
        return value
    source = np.zeros((len(relative), 3, len(wanted)))
    for i, change in enumerate(slopes):
        source[1:, :, i] = value[:-1, :, 0] @ change[:, :3].T + inputs @ change[:, 3:5].T
    return np.concatenate([value, linear_recurrence(step[:, :3], source)], axis=2)


def _with_friction(
    relative: Array, slope: Array, dt: float, vector: Array, coulomb: float, wanted: tuple[str, ...]
) -> Array:
    substeps = max(1, int(np.ceil(dt / SUBSTEP_S - 1e-9)))
    h = dt / substeps
    step, slopes = _step_matrices(h, vector, wanted)
    count = len(wanted)
    state, tangent = ca.SX.sym("s", 3), ca.SX.sym("t", 3, count)
    command, rate = ca.SX.sym("c"), ca.SX.sym("dc")
    s, t, c = state, tangent, command
    for _ in range(substeps):
        drive = ca.vertcat(s, c, rate)
        free = ca.DM(step[:, :5]) @ drive
        free_t = ca.DM(step[:, :3]) @ t
        for i, change in enumerate(slopes):
            free_t[:, i] += ca.DM(change[:, :5]) @ drive
        reach = float(step[1, 5])
        force = ca.fmin(ca.fmax(-free[1] / reach, -coulomb), coulomb)
        sticks = ca.fabs(free[1]) < coulomb * reach
        force_t = ca.SX.zeros(1, count)
        for i, name in enumerate(wanted):
            reach_t = float(slopes[i][1, 5])
            slides = -ca.sign(free[1]) if name == "coulomb" else 0.0
            force_t[i] = ca.if_else(sticks, -free_t[1, i] / reach + free[1] * reach_t / reach**2, slides)
            free_t[:, i] += force * ca.DM(slopes[i][:, 5])
        s = free + force * ca.DM(step[:, 5])
        t = free_t + ca.DM(step[:, 5]) @ force_t
        c = c + rate * h
    packed = ca.vertcat(state, ca.vec(tangent))
    row = ca.Function("row", [packed, command, rate], [ca.vertcat(s, ca.vec(t))])
    n = len(relative) - 1
    states = np.zeros((n + 1, 3, 1 + count))
    if n:
        out = np.asarray(row.mapaccum(n)(ca.DM.zeros(packed.shape), relative[None, :-1], slope[None, :-1]))
        states[1:] = out.T.reshape(n, 1 + count, 3).transpose(0, 2, 1)
    return states
