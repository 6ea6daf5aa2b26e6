"""The linear position loop of an axis (conventions, section 3), exactly discretised.

    v_ref = position_gain·(c - x) + feedforward·dc/dt
    dv/dt = velocity_gain·(v_ref - v + (1/integral_time)·∫(v_ref - v)dt) - viscous·v + force

The command is linear between rows and the force constant, so with state (x, v, ∫) the step over one row is `exp` of a 6×6
matrix (first-order hold, no discretisation error), a CasADi expression of the gains: its derivatives are exact.
"""

from __future__ import annotations

from functools import lru_cache
from typing import Any

import casadi as ca
import numpy as np

from symfive.arrays import Array

LOOP = ("position_gain", "velocity_gain", "integral_time", "viscous", "feedforward")
"""The quantities of a drive that the machine file states, in order."""
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
def discretisation() -> Any:
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
    gains, rate, _ = _loop()
    return ca.Function("acceleration", [gains], [rate[1, :].T, ca.jacobian(rate[1, :].T, gains)])


def linear_recurrence(step: Array, forcing: Array) -> Array:
    """s with s[k] = step · s[k-1] + forcing[k], s[-1] = 0, for a stable step, by recursive doubling.

    `step` (n, n), `forcing` (N, n, m); O(N log N) and no eigenvectors, so equal poles need no care.
    """
    rows, n, m = forcing.shape
    state = np.ascontiguousarray(forcing.transpose(1, 0, 2)).reshape(n, rows * m)  # one product of matrices a doubling
    power, reach = step, 1
    while reach < rows and np.abs(power).max() > 1e-18:
        state[:, reach * m :] += power @ state[:, : -reach * m]
        power, reach = power @ power, 2 * reach
    return np.ascontiguousarray(state.reshape(n, rows, m).transpose(1, 0, 2))


@lru_cache(maxsize=256)
def _step(h: float, gains: bytes) -> tuple[Array, Array]:
    step, slope = (np.asarray(part) for part in discretisation()(np.frombuffer(gains), h))
    return step, slope


@lru_cache(maxsize=256)
def _accelerating(gains: bytes) -> tuple[Array, Array]:
    row, slopes = (np.asarray(part) for part in _acceleration()(np.frombuffer(gains)))
    return row[:, 0], slopes


def acceleration(vector: Array) -> tuple[Array, Array]:
    """Of the gains LOOP: the row (5,) that makes the acceleration of (x, v, ∫, c, dc/dt), and its slopes (5, 5) in the gains."""
    return _accelerating(vector.tobytes())


def step_matrices(h: float, vector: Array, wanted: tuple[str, ...]) -> tuple[Array, list[Array]]:
    """Of the step `h` (s) and the gains LOOP: the matrix 3×6 on (x, v, ∫, c, dc/dt, force), its slopes in the wanted gains."""
    step, slope = _step(float(h), vector.tobytes())
    slopes = [slope[:, LOOP.index(name)].reshape(3, 6, order="F") for name in wanted if name in LOOP]
    return step, slopes


def linear_states(relative: Array, slope: Array, dt: float, vector: Array, wanted: tuple[str, ...]) -> Array:
    """States (x, v, ∫) (N, 3, 1 + len(wanted)) without friction, values first, then their derivatives in the wanted gains."""
    step, slopes = step_matrices(dt, vector, wanted)
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
