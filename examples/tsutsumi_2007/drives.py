"""Section 3.1 of the paper: the feed drives of its figure 4, with hard friction, worm error and play.

    v  = Kpp (ref - k θm) + Kff ref'        q' = v - ω         k = l/2π (X, mm per rad) or R_all (C)
    T  = Kvp [(v - ω) + q/Ti]               J ω' = T - C ω - f sign(ω)         θm' = ω

Coulomb friction is set-valued: at rest any |T| ≤ f holds the axis. The step is backward Euler in ω; what friction leaves
of it is the free step shrunk towards zero, ω = ω_free ∓ min(|ω_free|, f/(J/dt + Kvp + C)). Both sides of the equations
scale with k, so they are integrated in the coordinate of the axis itself.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

Array = NDArray[np.float64]


@dataclass(frozen=True, kw_only=True)
class Drive:
    """A column of the paper's table 1, seen from the motor.

    `inertia` J kg·m², `friction` f N·m, `viscous` C N·m·s/rad, `velocity_gain` Gv = Kvp/J and `position_gain` Gp = Kpp·k
    in 1/s, `reset_time` Ti s, `reduction` k: mm (X) or rad (C) of the axis per rad of the motor; `feedforward` 0…1 of
    Kff = 1/k.
    """

    inertia: float
    friction: float
    viscous: float
    velocity_gain: float
    position_gain: float
    reset_time: float
    reduction: float
    feedforward: float = 0.0

    @property
    def damping(self) -> float:
        """C/J, 1/s."""
        return self.viscous / self.inertia

    @property
    def coulomb(self) -> float:
        """k f/J: the friction as an acceleration of the axis, mm/s² or rad/s²."""
        return self.reduction * self.friction / self.inertia


@dataclass(frozen=True, kw_only=True)
class Gear:
    """What follows the C drive: `teeth` N and `fluctuation` W rad of the worm wheel (9), `backlash` b rad."""

    teeth: int = 120
    fluctuation: float = 4e-5
    backlash: float = 2e-4


@dataclass(frozen=True, kw_only=True)
class Drives:
    """Both drives and the gear of C."""

    x: Drive
    c: Drive
    gear: Gear


PAPER = Drives(
    x=Drive(
        inertia=0.028, friction=1.0, viscous=0.04, velocity_gain=200.0, position_gain=40.0, reset_time=0.05,
        reduction=10.0 / (2.0 * np.pi),
    ),
    c=Drive(
        inertia=0.025, friction=0.2, viscous=0.005, velocity_gain=35.0, position_gain=40.0, reset_time=0.05,
        reduction=1.0 / 90.0,
    ),
    gear=Gear(),
)  # fmt: skip
"""Table 1 where it can be read (Gp, R_all, Gv of C) and values that give the paper's curves where it cannot."""


def driven(drives: Sequence[Drive], commands: Array, row_s: ArrayLike, *, step_s: float, moving: bool) -> Array:
    """Positions (R, L) of L axes side by side, each on its own commands (R, L), mm or rad, straight between rows.

    `row_s` (L,) s between rows; every row is cut into equal steps of at most `step_s`. With `moving` an axis begins in the
    steady state of its first velocity, else it stands on its first command.
    """
    kp, kv, ti, damping, feedforward, coulomb = (
        np.array([getattr(drive, name) for drive in drives])
        for name in ("position_gain", "velocity_gain", "reset_time", "damping", "feedforward", "coulomb")
    )
    row = np.broadcast_to(np.asarray(row_s, dtype=float), (len(drives),))
    steps = max(1, int(np.ceil(row.max() / step_s - 1e-9)))
    dt = row / steps
    rates = np.diff(commands, axis=0) / row
    inverse = 1.0 / (1.0 / dt + kv + damping)
    keep, push, pull = inverse / dt, inverse * kv, inverse * kv / ti
    stick = inverse * coulomb
    speed = rates[0].copy() if moving else np.zeros(len(drives))
    place = commands[0] - (1.0 - feedforward) / kp * speed
    wound = ti * (damping * speed + coulomb * np.sign(speed)) / kv
    out = np.empty_like(commands)
    out[0] = place
    for k, rate in enumerate(rates):
        reference, ahead, advance = commands[k] * kp, feedforward * rate, kp * rate * dt
        for _ in range(steps):
            reference = reference + advance
            wanted = reference - kp * place + ahead
            free = keep * speed + push * wanted + pull * wound
            speed = free - np.minimum(np.maximum(free, -stick), stick)
            wound += dt * (wanted - speed)
            place = place + dt * speed
        out[k + 1] = place
    return out


def behind_the_gear(position: Array, gear: Gear, *, start: float | None = None) -> Array:
    """C_out (R,) rad of the drive's position R_all·θm (R,): the worm's fluctuation (9), then the play.

    The paper's contact flank is the positive one: C_out is y while C moves forward and y + b while it moves back. `start`
    is where in the play C begins, 0…1 (0.5: amid it); by default at the flank of its first motion.
    """
    y = position + gear.fluctuation * np.sin(gear.teeth * position)
    if gear.backlash == 0.0:
        return y
    begin = float(y[1] < y[0]) if start is None else start
    held = float(y[0]) + begin * gear.backlash
    out = []
    for low in y.tolist():
        held = min(max(held, low), low + gear.backlash)
        out.append(held)
    return np.array(out)
