"""The position loop of an axis with friction, and its derivatives.

    dx/dt = v,   dv/dt = u - F

Either F is set-valued, F = g(v)·sgn(v), and holds the axis at rest whenever it can (P. Lötstedt 1982); or the contact
yields before it slides (LuGre: C. Canudas de Wit et al. 1995, with their damping √σ for the stiffness σ):

    F = z + √σ·(dz/dt)/σ,   dz/dt = σ·(v - |v|·z/g(v)),   σ = coulomb/pre_sliding,
    g(v) = coulomb + stiction·exp(-(v/stribeck_speed)²)

Near a reversal the loop advances by substeps of at most 1 ms, with a constant force in each; where the axis slides at the
full force, the loop is linear and its rows follow in closed form.
"""

from __future__ import annotations

import threading
from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import casadi as ca
import numpy as np

from symfive.arrays import Array
from symfive.compiled import Mapped
from symfive.motion._loop import LOOP, linear_recurrence, linear_states, step_matrices

FRICTION = ("coulomb", "stiction", "stribeck_speed", "pre_sliding")
"""Friction while sliding, what it has more at rest (mm/s² or rad/s²), the speed at which that fades (mm/s or rad/s), the way
in which the contact yields (mm or rad)."""

SUBSTEP_S = 1e-3
ROWS, MOST_BLOCKS = 16, 64
REACH = 512
"""Rows in closed form at once."""
FADED, SETTLED = 6.0, 1e-12
"""Beyond so many Stribeck speeds stiction is nothing (e^-36); so near its limit, the share of it, friction is at its limit."""


def _stribeck(v: Any, friction: Any) -> Any:
    return ca.fmax(friction[0] + friction[1] * ca.exp(-((v / ca.fmax(friction[2], 1e-9)) ** 2)), 1e-9)


def _stiffness(friction: Any, h: Any) -> Any:
    """σ, 1/s²; what yields by less than a substep can follow counts as a little softer, in a smooth passage: a contact that is
    too stiff still has a slope towards one that can be seen."""
    stiffness = ca.fmax(friction[0] / ca.fmax(friction[3], 1e-12), 1.0)
    return stiffness / (1 + (2 * h**2 * stiffness) ** 4) ** 0.25


def _hard(s: Any, c: Any, rate: Any, step: Any, friction: Any, h: Any) -> Any:
    """The state (x, v, ∫) after a substep under set-valued friction."""
    free, reach = step[:, :5] @ ca.vertcat(s, c, rate), step[1, 5]
    level = _stribeck(s[1], friction)
    sticks = ca.fabs(free[1]) < level * reach
    force = ca.if_else(sticks, -free[1] / reach, -ca.sign(free[1]) * level)
    after = free + force * step[:, 5]
    return ca.vertcat(after[0], ca.if_else(sticks, 0, after[1]), after[2])


def _yielding(s: Any, c: Any, rate: Any, step: Any, friction: Any, h: Any) -> Any:
    """The state (x, v, ∫, z) after a substep under friction that yields: z by the mean speed, then the rest by the mean force."""
    free = step[:, :5] @ ca.vertcat(s[:3], c, rate) - s[3] * step[:, 5]
    v = 0.5 * (s[1] + free[1])
    level, stiffness = _stribeck(v, friction), _stiffness(friction, h)
    limit = ca.sign(v) * level
    z = limit + (s[3] - limit) * ca.exp(-stiffness * ca.fabs(v) * h / level)
    return ca.vertcat(free - (z - s[3]) * (0.5 + 1 / (ca.sqrt(stiffness) * h)) * step[:, 5], z)


@lru_cache(maxsize=32)
def _block(substeps: int, wanted: tuple[str, ...], yields: bool) -> Any:
    """ROWS rows with friction: (state and tangents, c, dc/dt, constants) → the last state, the states after each row.

    The constants, one column: the step matrix, its slopes in the wanted loop gains, the friction, the substep. The block is
    one graph of scalars, since calling a function takes longer than a row.
    """
    loop = [name for name in wanted if name in LOOP]
    n = 4 if yields else 3
    state, tangent = ca.SX.sym("s", n), ca.SX.sym("t", n, len(wanted))
    command, rate, h = ca.SX.sym("c"), ca.SX.sym("dc"), ca.SX.sym("h")
    step, changes = ca.SX.sym("step", 3, 6), [ca.SX.sym(f"step_{name}", 3, 6) for name in loop]
    friction = ca.SX.sym("friction", 4)
    towards = ca.SX.zeros(22, len(wanted))  # what each wanted quantity does to step and friction
    for i, name in enumerate(wanted):
        if name in LOOP:
            towards[:18, i] = ca.vec(changes[loop.index(name)])
        else:
            towards[18 + FRICTION.index(name), i] = 1
    given = ca.vertcat(ca.vec(step), friction)
    after: Any = (_yielding if yields else _hard)(state, command, rate, step, friction, h)
    moved = ca.jacobian(after, state) @ tangent + ca.jacobian(after, given) @ towards
    constants = ca.vertcat(*(ca.vec(matrix) for matrix in (step, *changes)), friction, h)
    packed = ca.vertcat(state, ca.vec(tangent))
    once = ca.Function("substep", [packed, command, rate, constants], [ca.vertcat(after, ca.vec(moved))], {"cse": True})
    reached, c = packed, command
    for _ in range(substeps):
        reached, c = once(reached, c, rate, constants), c + rate * h
    row = ca.Function("row", [packed, command, rate, constants], [reached], {"cse": True})
    commands, rates, rows = ca.SX.sym("c", 1, ROWS), ca.SX.sym("dc", 1, ROWS), [packed]
    for i in range(ROWS):
        rows.append(row(rows[-1], commands[i], rates[i], constants))
    return ca.Function("block", [packed, commands, rates, constants], [rows[-1], ca.horzcat(*rows[1:])])


class _Blocks:
    """Several blocks one after the other, with arrays in and out: CasADi's own conversions take as long as the rows."""

    def __init__(self, block: Any, count: int) -> None:
        function = block.mapaccum(count)
        self._buffer, self._trigger = function.buffer()
        self._sources = [np.zeros(function.numel_in(i)) for i in range(4)]
        self._last, self._rows = np.zeros(function.numel_out(0)), np.zeros((count * ROWS, block.size1_in(0)))
        for i, source in enumerate(self._sources):
            self._buffer.set_arg(i, source.data)
        for i, result in enumerate((self._last, self._rows)):
            self._buffer.set_res(i, result.data)
        self._lock = threading.Lock()

    def __call__(self, start: Array, inputs: Array, constants: Array) -> Array:
        """States and tangents after each row (count·ROWS, n) from those at the start, command and rate (2, count·ROWS)."""
        with self._lock:
            for source, value in zip(self._sources[:3], (start, *inputs), strict=True):
                source[:] = value
            self._sources[3].reshape(-1, len(constants))[:] = constants
            self._trigger()
            return self._rows.copy()


@lru_cache(maxsize=256)
def _blocks(substeps: int, wanted: tuple[str, ...], yields: bool, count: int) -> _Blocks:
    return _Blocks(_block(substeps, wanted, yields), count)


@lru_cache(maxsize=32)
def _powers(step: bytes) -> tuple[Array, Array]:
    """Pᵐ (REACH + 1, 3, 3) and Σ Pʲb over j < m (REACH + 1, 3) of a row's step matrix (3, 6), b what a unit of force does."""
    matrix = np.frombuffer(step).reshape(3, 6)
    powers, sums = np.empty((REACH + 1, 3, 3)), np.zeros((REACH + 1, 3))
    powers[0] = np.eye(3)
    for m in range(REACH):
        powers[m + 1] = matrix[:, :3] @ powers[m]
        sums[m + 1] = sums[m] + powers[m] @ matrix[:, 5]
    return powers, sums


@lru_cache(maxsize=128)
def _without_friction(relative: bytes, dt: float, gains: bytes) -> Array:
    """The states (N, 3) that all frictions have in common."""
    command = np.frombuffer(relative)
    rate = np.append(np.diff(command) / dt, 0.0)
    return linear_states(command, rate, dt, np.frombuffer(gains), ())[:, :, 0].copy()


@dataclass(frozen=True, eq=False)
class _Rows:
    """An axis along a run: `inputs` (N, 2) command and its rate, `linear` (N, 3) its states without friction, the step
    matrix of a row and its slopes in the wanted gains; `states` (N, 3 or 4, 1 + len(wanted)) with friction, filled in turn."""

    inputs: Array
    linear: Array
    step: Array
    changes: dict[str, Array]
    friction: Array
    wanted: tuple[str, ...]
    states: Array

    def slide(self, first: int) -> int:
        """Fill the rows after `first` for as long as the axis slides at its full force; the last row filled."""
        coulomb, stiction, speed, _ = self.friction
        state = self.states[first]
        sign = float(np.sign(state[1, 0]))
        if sign == 0.0 or (len(state) == 4 and abs(state[3, 0] - sign * coulomb) > SETTLED * coulomb):
            return first
        count = min(REACH, len(self.linear) - 1 - first)
        powers, sums = (part[: count + 1] for part in _powers(self.step.tobytes()))
        here = slice(first, first + count + 1)
        values = self.linear[here] + powers @ (state[:3, 0] - self.linear[first]) - sign * coulomb * sums
        ahead = sign * values[:, 1]
        sticks = bool(stiction) or not {"stiction", "stribeck_speed"}.isdisjoint(self.wanted)
        least = np.maximum(np.abs(np.diff(values[:, 1])), FADED * speed if sticks else 0.0)
        slides = np.minimum(ahead[1:], ahead[:-1]) > least
        count = count if slides.all() else int(np.argmin(slides))
        if count == 0:
            return first
        last = first + count
        self.states[first + 1 : last + 1, :3, 0] = values[1 : count + 1]
        if len(state) == 4:
            self.states[first + 1 : last + 1, 3, :] = 0.0
            self.states[first + 1 : last + 1, 3, 0] = sign * coulomb
            if "coulomb" in self.wanted:
                self.states[first + 1 : last + 1, 3, 1 + self.wanted.index("coulomb")] = sign
        self._tangents(first, last, sign * coulomb, powers[: count + 1], sums[: count + 1], sign)
        return last

    def _tangents(self, first: int, last: int, force: float, powers: Array, sums: Array, sign: float) -> None:
        start = self.states[first, :3, 1:]
        filled = self.states[first + 1 : last + 1, :3, 1:]
        if not self.changes:
            filled[:] = powers[1:] @ start
            if "coulomb" in self.wanted:
                filled[:, :, self.wanted.index("coulomb")] -= sign * sums[1:]
            return
        source = np.zeros((last - first + 1, 3, len(self.wanted)))
        source[0] = start
        for i, name in enumerate(self.wanted):
            if name in self.changes:
                change = self.changes[name]
                source[1:, :, i] = self.states[first:last, :3, 0] @ change[:, :3].T
                source[1:, :, i] += self.inputs[first:last] @ change[:, 3:5].T - force * change[:, 5]
            elif name == "coulomb":
                source[1:, :, i] = -sign * self.step[:, 5]
        filled[:] = linear_recurrence(self.step[:, :3], source)[1:]

    def stepper(self, dt: float, gains: Array) -> Callable[[int, int], int]:
        """(first row, number of blocks of ROWS) → the last row, filled by substeps."""
        substeps = max(1, int(np.ceil(dt / SUBSTEP_S - 1e-9)))
        step, slopes = step_matrices(dt / substeps, gains, self.wanted)
        constants = np.concatenate([*(m.ravel(order="F") for m in (step, *slopes)), self.friction, [dt / substeps]])

        def advance(first: int, blocks: int) -> int:
            reach = ROWS * blocks
            last = min(first + reach, len(self.states) - 1)
            inputs = np.zeros((2, reach))
            inputs[:, : last - first] = self.inputs[first:last].T
            rows = _blocks(substeps, self.wanted, self.states.shape[1] == 4, blocks)
            found = rows(self.states[first].ravel(order="F"), inputs, constants)[: last - first]
            self.states[first + 1 : last + 1] = found.reshape(last - first, -1, self.states.shape[1]).transpose(0, 2, 1)
            return last

        return advance


def states_with_friction(
    relative: Array, slope: Array, dt: float, gains: Array, friction: Array, wanted: tuple[str, ...]
) -> Array:
    """States (x, v, ∫) of all rows, and z where the contact yields: (N, 3 or 4, 1 + len(wanted)), values, then derivatives."""
    yields = bool(friction[3]) or "pre_sliding" in wanted
    step, slopes = step_matrices(dt, gains, wanted)
    rows = _Rows(
        inputs=np.stack([relative, slope], axis=1),
        linear=_without_friction(relative.tobytes(), dt, gains.tobytes()),
        step=np.ascontiguousarray(step),
        changes=dict(zip([name for name in wanted if name in LOOP], slopes, strict=True)),
        friction=friction,
        wanted=wanted,
        states=np.zeros((len(relative), 4 if yields else 3, 1 + len(wanted))),
    )
    advance = rows.stepper(dt, gains)
    reached, blocks = 0, 1
    while reached < len(relative) - 1:
        reached = advance(reached, blocks)
        slid = rows.slide(reached)
        blocks = 1 if slid > reached else min(2 * blocks, MOST_BLOCKS)
        while slid > reached:
            reached, slid = slid, rows.slide(slid)
    return rows.states


def add_friction(motion: Array, states: Array, friction: Array, wanted: tuple[str, ...], dt: float) -> None:
    """Take the friction force off the acceleration of `motion` (N, 3, 1 + len(wanted)): what the contact holds where it yields,
    else all of it while sliding, and what it takes to stay while at rest."""
    if states.shape[1] == 4:
        h = dt / max(1, int(np.ceil(dt / SUBSTEP_S - 1e-9)))
        _take_yielding(motion, states, friction, wanted, h)
        return
    velocity, pull = motion[:, 1, 0], motion[:, 2, 0].copy()
    resting = np.abs(velocity) < 1e-12
    coulomb, stiction, speed, _ = friction
    ratio = velocity / max(speed, 1e-9)
    fading = np.exp(-(ratio**2))
    level = coulomb + stiction * fading
    by_velocity = -2.0 * stiction * fading * ratio / max(speed, 1e-9)
    by_friction = {"coulomb": 1.0, "stiction": fading, "stribeck_speed": -by_velocity * ratio}
    holds = resting & (np.abs(pull) <= level)
    sign = np.sign(np.where(resting, pull, velocity))
    motion[:, 2, 0] = np.where(holds, 0.0, pull - level * sign)
    for i, name in enumerate(wanted):
        change = by_velocity * motion[:, 1, 1 + i] + by_friction.get(name, 0.0)
        motion[:, 2, 1 + i] = np.where(holds, 0.0, motion[:, 2, 1 + i] - change * sign)


@lru_cache(maxsize=1)
def _force() -> Mapped:
    """Rows of (v, z), friction 4, h → the force of a contact that yields, its slopes in both."""
    moving, friction, h = ca.SX.sym("m", 2), ca.SX.sym("friction", 4), ca.SX.sym("h")
    v, z = ca.vertsplit(moving)
    rate = v - ca.fabs(v) * z / _stribeck(v, friction)
    value = z + ca.sqrt(_stiffness(friction, h)) * rate
    results = [value, ca.densify(ca.jacobian(value, moving)), ca.densify(ca.jacobian(value, friction))]
    return Mapped(ca.Function("force", [moving, friction, h], results), held=(1, 2))


def _take_yielding(motion: Array, states: Array, friction: Array, wanted: tuple[str, ...], h: float) -> None:
    value, by_motion, by_friction = _force()(states[:, [1, 3], 0], friction, np.array([h]))
    motion[:, 2, 0] -= value[:, 0]
    for i, name in enumerate(wanted):
        motion[:, 2, 1 + i] -= np.sum(by_motion * states[:, [1, 3], 1 + i], axis=1)
        if name in FRICTION:
            motion[:, 2, 1 + i] -= by_friction[:, FRICTION.index(name)]
