"""The position loop of an axis (conventions, section 3), exactly discretised and differentiated.

    v_ref = position_gain·(c - x) + feedforward·dc/dt
    u     = velocity_gain·(v_ref - v + (1/integral_time)·∫(v_ref - v)dt) - viscous·v
    dx/dt = v,   dv/dt = u - F(v)·sgn(v),   F(v) = coulomb + stiction·exp(-(v/stribeck_speed)²)

The command is linear between rows, so with state (x, v, ∫) the step over one row is `exp` of a 5×5 matrix
(first-order hold, no discretisation error). The matrix exponential is a CasADi expression of the gains: its
derivatives are exact. Without friction the recursion is solved for all rows at once by recursive doubling; with
friction a set-valued force, constant over a substep of at most 1 ms, brings the axis to rest whenever it can hold it
there (P. Lötstedt 1982).
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
LOOP = ("position_gain", "velocity_gain", "integral_time", "viscous", "feedforward")
"""The quantities of a drive that the machine file states, in order."""
FRICTION = ("coulomb", "stiction", "stribeck_speed")
"""Friction while sliding, what it has more at rest (mm/s² or rad/s²), the speed at which that fades (mm/s or rad/s)."""
GAINS = (*LOOP, *FRICTION)
"""The quantities of a drive that can be parameters."""

SUBSTEP_S = 1e-3
ROWS, BLOCKS = 16, 64
_SQUARINGS = 14
_TERMS = 8


@lru_cache(maxsize=1)
def _loop() -> tuple[Any, Any, Any]:
    """(gains 5, dx/dt matrix 3×5 acting on (x, v, ∫, c, dc/dt)) as symbols."""
    gains: list[Any] = [ca.SX.sym(name) for name in LOOP]
    kp, kv, ti, viscous, ff = gains
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
    """gains → the row (1, 5) that makes the acceleration of (x, v, ∫, c, dc/dt), and its slope (5, 5) in the gains."""
    gains, rate, _ = _loop()
    return ca.Function("acceleration", [gains], [rate[1, :], ca.jacobian(rate[1, :].T, gains)])


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
        states = _with_friction(relative, slope, dt, vector, friction, wanted)
    else:
        states = _linear(relative, slope, dt, vector, wanted)
    motion = np.empty((len(command), 3, 1 + len(wanted)))
    motion[:, 0:2] = states[:, 0:2]
    row, slopes = (np.asarray(part) for part in _acceleration()(vector))
    state = np.column_stack([states[:, :, 0], relative, slope])
    motion[:, 2, 0] = state @ row[0]
    for i, name in enumerate(wanted):
        direct = state @ slopes[:, LOOP.index(name)] if name in LOOP else 0.0
        motion[:, 2, 1 + i] = states[:, :, 1 + i] @ row[0, :3] + direct
    if rubs:
        _add_friction(motion, friction, wanted)
    motion[:, 0, 0] += reference
    return motion


def _add_friction(motion: Array, friction: Array, wanted: tuple[str, ...]) -> None:
    """Take the friction force off the acceleration: all of it while sliding, what it takes to stay while at rest."""
    velocity, pull = motion[:, 1, 0], motion[:, 2, 0].copy()
    resting = np.abs(velocity) < 1e-12
    levels = _friction_level().map(len(pull))(velocity[None], friction)
    level, by_velocity, by_friction = (np.asarray(part) for part in levels)
    holds = resting & (np.abs(pull) <= level[0])
    sign = np.sign(np.where(resting, pull, velocity))
    motion[:, 2, 0] = np.where(holds, 0.0, pull - level[0] * sign)
    by_friction = by_friction.reshape(-1, 3)
    for i, name in enumerate(wanted):
        slope = by_velocity[0] * motion[:, 1, 1 + i]
        if name in FRICTION:
            slope = slope + by_friction[:, FRICTION.index(name)]
        motion[:, 2, 1 + i] = np.where(holds, 0.0, motion[:, 2, 1 + i] - slope * sign)


def _step_matrices(h: float, vector: Array, wanted: tuple[str, ...]) -> tuple[Array, list[Array]]:
    step, slope = (np.asarray(part) for part in _discretisation()(vector, h))
    slopes = [slope[:, LOOP.index(name)].reshape(3, 6, order="F") for name in wanted if name in LOOP]
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


@lru_cache(maxsize=1)
def _friction_level() -> Any:
    """(v, friction 3) → F(v), its slope in v and in the friction's quantities (Stribeck's curve)."""
    v: Any = ca.SX.sym("v")
    friction: list[Any] = [ca.SX.sym(name) for name in FRICTION]
    coulomb, stiction, speed = friction
    fading = ca.exp(-((v / ca.fmax(speed, 1e-9)) ** 2))
    value = coulomb + stiction * fading
    by_speed = stiction * fading * 2 * v**2 / ca.fmax(speed, 1e-9) ** 3
    by_velocity = -stiction * fading * 2 * v / ca.fmax(speed, 1e-9) ** 2
    return ca.Function("level", [v, ca.vertcat(*friction)], [value, by_velocity, ca.horzcat(1, fading, by_speed)])


@lru_cache(maxsize=32)
def _friction_rows(substeps: int, wanted: tuple[str, ...]) -> Any:
    """Rows with friction: (state and tangents, c, dc/dt, constants) → the last state, the states after each row.

    The constants, one column a block of ROWS: the step matrix, its slopes in the wanted loop gains, the friction, the substep.
    A block is one graph of scalars, since calling a function takes longer than a row.
    """
    loop = [name for name in wanted if name in LOOP]
    state, tangent = ca.SX.sym("s", 3), ca.SX.sym("t", 3, len(wanted))
    command, rate, h = ca.SX.sym("c"), ca.SX.sym("dc"), ca.SX.sym("h")
    step, changes = ca.SX.sym("step", 3, 6), [ca.SX.sym(f"step_{name}", 3, 6) for name in loop]
    friction = ca.SX.sym("friction", 3)
    s, t, c = state, tangent, command
    for _ in range(substeps):
        level, by_velocity, by_friction = _friction_level()(s[1], friction)
        drive = ca.vertcat(s, c, rate)
        free, free_t = step[:, :5] @ drive, step[:, :3] @ t
        reach = step[1, 5]
        force = ca.fmin(ca.fmax(-free[1] / reach, -level), level)
        sticks = ca.fabs(free[1]) < level * reach
        force_t = ca.SX.zeros(1, len(wanted))
        for i, name in enumerate(wanted):
            level_t: Any = by_velocity * t[1, i]
            reach_t: Any = 0.0
            if name in LOOP:
                change = changes[loop.index(name)]
                free_t[:, i] += change[:, :5] @ drive
                reach_t = change[1, 5]
            else:
                level_t += by_friction[FRICTION.index(name)]
            holding = -free_t[1, i] / reach + free[1] * reach_t / reach**2
            force_t[i] = ca.if_else(sticks, holding, -ca.sign(free[1]) * level_t)
            if name in LOOP:
                free_t[:, i] += force * change[:, 5]
        s, t = free + force * step[:, 5], free_t + step[:, 5] @ force_t
        s[1] = ca.if_else(sticks, 0, s[1])
        c = c + rate * h
    packed = ca.vertcat(state, ca.vec(tangent))
    constants = ca.vertcat(*(ca.vec(matrix) for matrix in (step, *changes)), friction, h)
    row = ca.Function("row", [packed, command, rate, constants], [ca.vertcat(s, ca.vec(t))], {"cse": True})
    commands, rates, after = ca.SX.sym("c", 1, ROWS), ca.SX.sym("dc", 1, ROWS), [packed]
    for i in range(ROWS):
        after.append(row(after[-1], commands[i], rates[i], constants))
    block = ca.Function("block", [packed, commands, rates, constants], [after[-1], ca.horzcat(*after[1:])])
    return block.mapaccum(BLOCKS)


def _with_friction(
    relative: Array, slope: Array, dt: float, vector: Array, friction: Array, wanted: tuple[str, ...]
) -> Array:
    substeps = max(1, int(np.ceil(dt / SUBSTEP_S - 1e-9)))
    step, slopes = _step_matrices(dt / substeps, vector, wanted)
    rows = _friction_rows(substeps, wanted)
    constants = np.concatenate([*(m.ravel(order="F") for m in (step, *slopes)), friction, [dt / substeps]])
    repeated = np.repeat(constants[:, None], BLOCKS, axis=1)
    count = 1 + len(wanted)
    states = np.zeros((len(relative), 3 * count))
    reach = ROWS * BLOCKS
    for first in range(0, len(relative) - 1, reach):
        n = min(reach, len(relative) - 1 - first)
        inputs = np.zeros((2, reach))
        inputs[:, :n] = relative[first : first + n], slope[first : first + n]
        out = np.asarray(rows(states[first], inputs[:1], inputs[1:], repeated)[1])
        states[first + 1 : first + 1 + n] = out.T[:n]
    return states.reshape(-1, count, 3).transpose(0, 2, 1)
