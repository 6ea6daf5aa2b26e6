"""The drive loop of FORMATS.md section 3, exact per substep, with hard friction and a two-mass screw.

    v_ref = Kp.(c - x) + ff.dc/dt
    u     = Kv.(v_ref - v + I/Ti) - viscous.v - friction,     dI/dt = v_ref - v,  dx/dt = v,  dv/dt = u

The command c is linear between rows, so the linear part advances by a matrix exponential without any
truncation;
friction is set-valued: it sticks while |u| is below the breakaway level.  Units: mm or rad, s.
"""

from __future__ import annotations

import itertools
from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import ArrayLike

from .chain import Array
from .scan import compiled_scan, python_scan

BLOCK = 32
"""Rows of a linear drive that are advanced together."""


@dataclass(frozen=True)
class Friction:
    """Inertia-normalised friction; levels in mm/s^2 or rad/s^2, speeds in mm/s or rad/s.

    Coulomb/Stribeck: g(v) = coulomb + (breakaway - coulomb).exp(-(v/stribeck_speed)^2), stick at v = 0.
    LuGre (`stiffness` > 0, 1/s^2): dz/dt = v - stiffness.|v|.z/g(v), friction = stiffness.z + damping.dz/dt.
    `asymmetry` scales the level by 1 + asymmetry in positive and 1 - asymmetry in negative motion.
    """

    coulomb: float = 0.0
    breakaway: float = 0.0
    stribeck_speed: float = 1.0
    stiffness: float = 0.0
    damping: float = 0.0
    asymmetry: float = 0.0


@dataclass(frozen=True)
class TwoMass:
    """Screw as a spring: load'' = w^2.(x - load) + 2.zeta.w.(v - load'), reaction on the motor
    times `ratio`.
    """

    frequency_hz: float
    damping: float = 0.05
    ratio: float = 0.0


@dataclass(frozen=True)
class Drive:
    """Position and velocity loop of one axis, inertia-normalised (1/s, s, 1/s, 0..1)."""

    position_gain: float
    velocity_gain: float
    integral_time: float
    viscous: float = 0.0
    feedforward: float = 0.0
    friction: Friction = field(default_factory=Friction)
    two_mass: TwoMass | None = None

    @classmethod
    def from_table(cls, table: Mapping[str, float]) -> Drive:
        """Drive of an ``[axes.NAME.drive]`` table."""
        return cls(**{k: float(v) for k, v in table.items()})


@dataclass(frozen=True)
class Motion:
    """Position, velocity, acceleration behind the screw and the encoder's position, each (N,)."""

    x: Array
    v: Array
    a: Array
    encoder: Array


def state_matrices(drive: Drive) -> tuple[Array, Array]:
    """A (n, n) and B (n, 3) of z' = A z + B (c, dc/dt, -friction), z = (x, v, I[, load, load'])."""
    kp, kv, ti, ff = drive.position_gain, drive.velocity_gain, drive.integral_time, drive.feedforward
    n = 5 if drive.two_mass else 3
    a, b = np.zeros((n, n)), np.zeros((n, 3))
    a[0, 1] = 1.0
    a[1, :3] = -kv * kp, -kv - drive.viscous, kv / ti
    a[2, :2] = -kp, -1.0
    b[1] = kv * kp, kv * ff, 1.0
    b[2, :2] = kp, ff
    if drive.two_mass:
        w = 2.0 * np.pi * drive.two_mass.frequency_hz
        spring = np.array([w**2, 2.0 * drive.two_mass.damping * w, 0.0, -(w**2), -2.0 * drive.two_mass.damping * w])
        a[3, 4] = 1.0
        a[4] = spring
        a[1] -= drive.two_mass.ratio * spring
    return a, b


def expm(m: Array) -> Array:
    """Matrix exponential by scaling, Taylor order 18 and squaring."""
    scale = max(0, int(np.ceil(np.log2(max(np.abs(m).sum(axis=1).max(), 1e-300)))) + 1)
    step = m / 2.0**scale
    term = out = np.eye(len(m))
    for k in range(1, 19):
        term = term @ step / k
        out = out + term
    for _ in range(scale):
        out = out @ out
    return out


def transition(a: Array, b: Array, h: float) -> tuple[Array, Array]:
    """Phi (n, n) and G (n, 3): z(h) = Phi z + G (c0, dc/dt, -friction) with c = c0 + dc/dt.t, friction
    constant.
    """
    n = len(a)
    m = np.zeros((n + 3, n + 3))
    m[:n, :n], m[:n, n:] = a, b
    m[n, n + 1] = 1.0
    e = expm(m * h)
    return e[:n, :n], e[:n, n:]


def follow(drive: Drive, c: ArrayLike, dt: float, substep: float = 1e-4, *, compiled: bool = True) -> Motion:
    """Motion of one axis on the command `c` (N,) mm or rad at constant row spacing `dt` (s), starting at rest
    on it.

    Without friction the rows are exact; with friction `substep` (s) resolves the stick and slip events.
    Without a compiler (or `compiled=False`) a plain Python scan runs with five times that substep.
    """
    c = np.ascontiguousarray(c, float)
    rub = drive.friction.coulomb > 0.0 or drive.friction.breakaway > 0.0
    a, b = state_matrices(drive)
    z = np.zeros(len(a))
    z[0] = c[0]
    if drive.two_mass:
        z[3] = c[0]
    if not rub:
        out = _scan_linear(a, b, c, dt, z)
    else:
        scan = compiled_scan() if compiled else None
        sub = max(1, round(dt / (substep if scan else 5.0 * substep)))
        stuck = a.copy(), b.copy()
        for m in stuck:
            m[:2] = 0.0
        p, g = transition(a, b, dt / sub)
        ps, gs = transition(*stuck, dt / sub)
        f = drive.friction
        levels = np.array(
            [f.coulomb, max(f.breakaway, f.coulomb), f.stribeck_speed, f.stiffness, f.damping, f.asymmetry]
        )
        out = (scan or python_scan)(c, dt, sub, p, g, ps, gs, a, b, levels, z)
    i = 3 if drive.two_mass else 0
    acceleration = out[:, :-1] @ a[4] if drive.two_mass else out[:, -1]
    return Motion(out[:, i], out[:, i + 1], acceleration, out[:, 0])


def _scan_linear(a: Array, b: Array, c: Array, dt: float, z: Array) -> Array:
    """z[k + 1] = Phi z[k] + drive[k], a block of rows at a time: its answer from rest, and then what it begins with."""
    p, g = transition(a, b, dt)
    rate = np.append(np.diff(c) / dt, 0.0)
    blocks = -(-len(c) // BLOCK)
    drive = np.zeros((blocks * BLOCK, len(z)))
    drive[: len(c)] = np.outer(c, g[:, 0]) + np.outer(rate, g[:, 1])
    powers = np.stack(list(itertools.accumulate([p] * BLOCK, np.matmul, initial=np.eye(len(p)))))
    since = np.arange(BLOCK + 1)[:, None] - 1 - np.arange(BLOCK)
    answers = np.where((since >= 0)[..., None, None], powers[since], 0.0).swapaxes(1, 2)
    rested = drive.reshape(blocks, -1) @ answers.reshape((BLOCK + 1) * len(z), -1).T
    states = rested.reshape(blocks, BLOCK + 1, len(z))
    for block in states:
        block += powers @ z
        z = block[-1]
    out = states[:, :-1].reshape(-1, len(z))[: len(c)]
    return np.column_stack([out, out @ a[1] + b[1, 0] * c + b[1, 1] * rate])
