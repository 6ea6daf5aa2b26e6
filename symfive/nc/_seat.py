"""The way from pose to pose with the ball in its nest, or the bar at its length: straight blocks that stay near the true way."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from symfive.campaign import FIRST_LINE, Run
from symfive.machine import Machine
from symfive.procedures import Nominal

__all__ = ["Seat"]

Array = NDArray[np.float64]
CHORD_SHARE = 0.05
"""A straight block may leave the true way by this share of the sensor's range or the bar's stroke."""
MOST_BLOCKS = 4096
DENSELY = np.linspace(0.0, 1.0, 65)[1:]
"""Shares of a way at which the axes are looked at where the control makes the blocks."""


class Seat:
    """Ball and nest, or bar, of a static run: `places` of the tool ball in the workpiece frame at its poses (rows, 3), mm."""

    def __init__(self, machine: Machine, run: Run, nominal: Nominal) -> None:
        self.machine, self.run, self.nominal = machine, run, nominal
        self.names = machine.axis_names
        self.places = nominal.ball(run.commands, run.tool_ball)
        self.bar = "ball_bar" in run.instrument

    def blocks(self, row: int, centred: bool) -> tuple[Array, Array, Array]:
        """The way from the pose before `row` to it: positions (n, axes) and places (n, 3) at the ends of n equal blocks, and
        the path of the axes (m, axes), start and end included. `centred`: the control makes them follow the ball.
        """
        allowed = CHORD_SHARE * self.machine.workspace.stroke(bar=self.bar)
        before = np.array([self.run.commands[n][row - 1] for n in self.names])
        blocks = 1
        while True:
            commands, places = self._between(row, np.arange(1, 2 * blocks + 1) / (2.0 * blocks))
            middles = self._middles(np.vstack([before, commands]), np.vstack([self.places[row - 1], places]), centred)
            if blocks >= MOST_BLOCKS or self._error(middles, places[::2]) <= allowed:
                break
            blocks *= 2
        ends = commands[1::2].copy()
        ends[-1] = [self.run.commands[n][row] for n in self.names]
        path = self._between(row, DENSELY)[0] if centred else ends
        return ends, places[1::2], np.vstack([before, path])

    def _between(self, row: int, share: Array) -> tuple[Array, Array]:
        """Commands (n, axes) and places (n, 3) at shares of the way: rotary axes straight, the bar on the shorter arc."""
        before, after = ({n: float(self.run.commands[n][r]) for n in self.names} for r in (row - 1, row))
        rotary = [n for n in self.names if self.machine.axes[n].rotary]
        fixed = {n: before[n] + share * (after[n] - before[n]) for n in rotary}
        table = np.asarray(self.run.table_ball)
        a, b = self.places[row - 1] - table, self.places[row] - table
        if self.bar and float(np.linalg.norm(a)) > 1e-9:
            places = table + _arc(a, b, share)
        else:
            places = self.places[row - 1] + share[:, None] * (self.places[row] - self.places[row - 1])
        what = f"the way to line {row + FIRST_LINE} of run {self.run.id}"
        found = self.nominal.follow(places, self.run.tool_ball, fixed, what)
        return np.stack([found[n] for n in self.names], axis=1), places

    def _middles(self, commands: Array, places: Array, centred: bool) -> Array:
        """Where the ball is in the middle of each straight block: straight is what the words of the program say, the ball's
        place where the control follows it, the positions of the axes elsewhere."""
        if centred:
            return np.asarray(0.5 * (places[:-1:2] + places[2::2]))
        straight = 0.5 * (commands[:-1:2] + commands[2::2])
        middles: Mapping[str, Array] = {n: straight[:, i] for i, n in enumerate(self.names)}
        return self.nominal.ball(middles, self.run.tool_ball)

    def _error(self, there: Array, places: Array) -> float:
        """How far a straight block's middle leaves the nest, or by how much it changes the bar's length."""
        if self.bar:
            table = np.asarray(self.run.table_ball)
            return float(np.abs(np.linalg.norm(there - table, axis=1) - np.linalg.norm(places - table, axis=1)).max())
        return float(np.linalg.norm(there - places, axis=1).max())


def _arc(a: Array, b: Array, share: Array) -> Array:
    """From vector a to b on the shorter arc, length interpolated (n, 3)."""
    la, lb = np.linalg.norm(a), np.linalg.norm(b)
    u, v = a / la, b / lb
    across = v - (v @ u) * u
    angle = float(np.arctan2(np.linalg.norm(across), u @ v))
    if np.linalg.norm(across) < 1e-12:
        across = np.cross(u, [0.0, 0.0, 1.0] if abs(u[2]) < 0.9 else [1.0, 0.0, 0.0])
    across = across / np.linalg.norm(across)
    size = (1.0 - share) * la + share * lb
    return np.asarray(size[:, None] * (np.cos(share * angle)[:, None] * u + np.sin(share * angle)[:, None] * across))
