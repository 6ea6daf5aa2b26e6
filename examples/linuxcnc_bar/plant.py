"""The machine behind the control's joints and the ball bar on it; knows nothing of symfive.

Each axis has the cascaded loop of the conventions, section 3, closed on the motor; Coulomb friction acts on the motor, and its
play lies between motor and carriage, outside the loop.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
SUBSTEPS = 10


@dataclass(frozen=True, kw_only=True)
class Axis:
    """A servo axis: gains as in a machine file (1/s, s), `coulomb` mm/s², `play` mm."""

    position_gain: float
    velocity_gain: float
    integral_time: float
    viscous: float
    feedforward: float
    coulomb: float
    play: float

    def carriage(self, command: Array, step_s: float) -> Array:
        """Where the carriage is (N,), mm, while the control commands (N,) in steps of `step_s`.

        The motor by Moreau's time stepping: friction takes at most what is left of the speed. The carriage rests until the motor
        has crossed the play. Both start where the first command is.
        """
        h, kp, kv = step_s / SUBSTEPS, self.position_gain, self.velocity_gain
        x, v, integral, carriage = float(command[0]), 0.0, 0.0, float(command[0])
        found = np.empty(len(command))
        for i, after in enumerate(command.tolist()):
            before = float(command[i - 1]) if i else after
            rate = (after - before) / step_s
            for k in range(SUBSTEPS):
                wanted = kp * (before + rate * (k + 1) * h - x) + self.feedforward * rate
                integral += h * (wanted - v)
                free = v + h * (kv * (wanted - v + integral / self.integral_time) - self.viscous * v)
                v = max(abs(free) - h * self.coulomb, 0.0) * (1.0 if free > 0.0 else -1.0)
                x += h * v
            carriage = min(max(carriage, x - 0.5 * self.play), x + 0.5 * self.play)
            found[i] = carriage
        return found


@dataclass(frozen=True, kw_only=True)
class Bar:
    """A ball bar: its `length` mm, the table ball's place by the machine's axes, `squareness` of Y to X in rad, noise in µm."""

    length: float
    ball: Mapping[str, float]
    squareness: float
    noise_um: float


def length_um(bar: Bar, carriage: Mapping[str, Array], rng: np.random.Generator) -> Array:
    """Change of the bar's length (N,), µm."""
    x, y, z = (carriage[name] - bar.ball[name] for name in "XYZ")
    away = np.sqrt((x - bar.squareness * y) ** 2 + y**2 + z**2)
    return np.asarray(1e3 * (away - bar.length) + bar.noise_um * rng.standard_normal(len(away)))


def exported(reading_um: Array, step_s: float, *, start_deg: float, sweep_deg: float, rows: int) -> tuple[Array, Array]:
    """Angle (rows,) degree and deviation (rows,) µm of the whole turn amid one recording of the bar, as its software makes them.

    The software sees the bar only: it takes the arc to begin and end where the feed-in and the feed-out, seen half way, would end
    and begin at the same speed, and the angle to grow with time in between; `sweep_deg` is negative clockwise.
    """
    pulled = np.flatnonzero(reading_um > 750.0)
    begin, end = (
        float(np.max(pulled[pulled < len(reading_um) // 2])),
        float(np.min(pulled[pulled > len(reading_um) // 2])),
    )
    half = 0.75 / _speed(reading_um, int(begin), step_s) / step_s
    first, last = begin + half, end - half
    margin = 0.5 * (abs(sweep_deg) - 360.0)
    share = (margin + 360.0 * np.arange(rows) / rows) / abs(sweep_deg)
    at = first + share * (last - first)
    return start_deg + share * sweep_deg, np.interp(at, np.arange(len(reading_um)), reading_um)


def _speed(reading_um: Array, at: int, step_s: float) -> float:
    """Speed of the feed-in half way, mm/s."""
    near = slice(max(at - 5, 0), at + 6)
    return float(-np.polyfit(step_s * np.arange(near.stop - near.start), 1e-3 * reading_um[near], 1)[0])
