"""Signals: what an effect or an instrument needs along a run beside the positions of the axes.

A signal is a small hashable description; `series` computes its values along a run and its exact derivatives with respect
to the parameters it depends on. What has memory (play, direction of approach, a resonance) lives here; everything
else is written symbolically in the row.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from symfive.motion._drives import linear_recurrence
from symfive.motion._motion import RunMotion, Series

__all__ = [
    "Acceleration", "Command", "Direction", "Play", "Position", "Resonance", "ReversalDistance", "Signal", "Velocity",
]  # fmt: skip

Array = NDArray[np.float64]


class Signal(Protocol):
    """The contract: hashable, with the names of the parameters it depends on itself and its values along a run."""

    @property
    def parameters(self) -> tuple[str, ...]:
        """Parameters that enter the signal itself (not through the drives)."""
        ...

    def series(self, motion: RunMotion) -> Series:
        """Values (N,) and tangents, internal units."""
        ...


@dataclass(frozen=True)
class _OfAxis:
    axis: str

    @property
    def parameters(self) -> tuple[str, ...]:
        return ()


class Position(_OfAxis):
    """Position behind the drive's encoder, mm or rad."""

    def series(self, motion: RunMotion) -> Series:
        return motion.axis(self.axis).position


class Command(_OfAxis):
    """Commanded position, mm or rad."""

    def series(self, motion: RunMotion) -> Series:
        return Series(motion.axis(self.axis).command)


class Velocity(_OfAxis):
    """Velocity behind the drive, mm/s or rad/s."""

    def series(self, motion: RunMotion) -> Series:
        return motion.axis(self.axis).velocity


class Acceleration(_OfAxis):
    """Acceleration behind the drive, mm/s² or rad/s²."""

    def series(self, motion: RunMotion) -> Series:
        return motion.axis(self.axis).acceleration


def _approach(positions: Array) -> Array:
    """Sign of the last motion at each row; rows before the first motion count as approached like the first one."""
    change = np.diff(positions)
    resolution = 1e-12 * max(1.0, float(np.abs(positions).max()))
    signs = np.where(np.abs(change) > resolution, np.sign(change), 0.0)
    moved = np.flatnonzero(signs)
    if not moved.size:
        return np.zeros_like(positions)
    last = np.maximum.accumulate(np.where(signs != 0.0, np.arange(len(signs)), -1))
    filled = signs[np.where(last < 0, moved[0], last)]
    return np.concatenate([filled[:1], filled])


class Direction(_OfAxis):
    """Direction of the last motion, -1 or +1 (0: the axis never moves)."""

    def series(self, motion: RunMotion) -> Series:
        return Series(_approach(motion.axis(self.axis).position.value), steps=True)


class ReversalDistance(_OfAxis):
    """Distance from the last reversal |q - q_r|, mm or rad, by which pre-sliding and creep effects fade."""

    def series(self, motion: RunMotion) -> Series:
        position = motion.axis(self.axis).position.value
        direction = _approach(position)
        turned = np.flatnonzero(np.diff(direction) != 0.0)
        origin = np.full(len(position), -1)
        origin[turned + 1] = turned
        origin = np.maximum.accumulate(origin)
        far = 1e6  # before the first reversal the axis counts as far from one
        return Series(np.where(origin < 0, far, np.abs(position - position[np.maximum(origin, 0)])), steps=True)


@dataclass(frozen=True)
class Play:
    """State of a play of total `width` (a parameter's name): -1 and +1 at the flanks, between them while it is crossed.

    Behind the play the coordinate is q - (width/2)·state; it starts on the flank of the first motion.
    """

    axis: str
    width: str

    @property
    def parameters(self) -> tuple[str, ...]:
        return (self.width,)

    def series(self, motion: RunMotion) -> Series:
        position = motion.axis(self.axis).position
        approach = _approach(position.value)
        width = abs(motion.values[self.width])
        if not motion.run.dynamic or width < 1e-15:
            return Series(approach, steps=True)
        state = _play_states(position.value.tolist(), float(approach[0]), 0.5 * width)
        return Series(state, self._tangents(state, position, width), steps=True)

    def _tangents(self, state: Array, position: Series, width: float) -> dict[str, Array]:
        """Between the flanks the output stands, so state = (q - held)/(width/2) moves with q and with the width."""
        crossing = np.abs(state) < 1.0
        if not crossing.any():
            return {}
        contact = np.where(crossing, -1, np.arange(len(state)))
        contact = np.maximum(np.maximum.accumulate(contact), 0)
        half = 0.5 * width
        tangents = {self.width: np.where(crossing, (state[contact] - state) / width, 0.0)}
        for name, slope in position.tangents.items():
            tangents[name] = np.where(crossing, (slope - slope[contact]) / half, 0.0)
        return tangents


def _play_states(positions: list[float], start: float, half: float) -> Array:
    states = np.empty(len(positions))
    output = positions[0] - start * half
    for k, position in enumerate(positions):
        output = min(max(output, position - half), position + half)
        states[k] = (position - output) / half
    states[np.abs(states) > 1.0 - 1e-12] = np.sign(states[np.abs(states) > 1.0 - 1e-12])
    return states


@dataclass(frozen=True)
class Resonance:
    """Relative displacement per unit of a mass on a spring carried by the axis: ÿ + 2ζω ẏ + ω² y = -a(t), mm per mm/s².

    `frequency` (Hz) and `damping` (ζ) name parameters. The acceleration is linear between rows (first-order hold).
    """

    axis: str
    frequency: str
    damping: str

    @property
    def parameters(self) -> tuple[str, ...]:
        return (self.frequency, self.damping)

    def series(self, motion: RunMotion) -> Series:
        frequency, damping = motion.values[self.frequency], motion.values[self.damping]
        acceleration = motion.axis(self.axis).acceleration
        value = self._response(motion, acceleration.value, frequency, damping)
        tangents = {name: self._response(motion, slope, frequency, damping) for name, slope in acceleration.tangents.items()}
        for name, step in ((self.frequency, (1e-4 * max(frequency, 1e-3), 0.0)), (self.damping, (0.0, 1e-5))):
            up = self._response(motion, acceleration.value, frequency + step[0], damping + step[1])
            down = self._response(motion, acceleration.value, frequency - step[0], damping - step[1])
            tangents[name] = (up - down) / (2.0 * sum(step))
        return Series(value, tangents)

    @staticmethod
    def _response(motion: RunMotion, acceleration: Array, frequency: float, damping: float) -> Array:
        from scipy.linalg import expm

        h, omega = motion.interval, 2.0 * np.pi * frequency
        matrix = np.zeros((4, 4))
        matrix[0, 1] = 1.0
        matrix[1, :3] = [-(omega**2), -2.0 * damping * omega, -1.0]
        matrix[2, 3] = 1.0
        step = expm(matrix * h)
        slope = np.append(np.diff(acceleration) / h, 0.0)
        forcing = np.zeros((len(acceleration), 2, 1))
        forcing[1:, :, 0] = np.stack([acceleration[:-1], slope[:-1]], axis=1) @ step[:2, 2:].T
        return np.asarray(linear_recurrence(step[:2, :2], forcing)[:, 0, 0])
