"""The way from pose to pose with the ball in its nest, or the bar at its length: straight blocks that stay near the true way."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from symfive.campaign import FIRST_LINE, Run
from symfive.machine import Machine
from symfive.procedures import Nominal

__all__ = ["Seat"]

Array = NDArray[np.float64]
Indices = NDArray[np.int64]
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

    def blocks(self, rows: Sequence[int], centred: bool) -> list[tuple[Array, Array, Array]]:
        """The ways from the pose before each of the `rows` to it: positions (n, axes) and places (n, 3) at the ends of n equal
        blocks, and the path of the axes (m, axes), start and end included. `centred`: the control makes them follow the ball.
        """
        allowed = CHORD_SHARE * self.machine.workspace.stroke(bar=self.bar)
        stand = np.stack([self.run.commands[n] for n in self.names], axis=1)
        found: dict[int, tuple[Array, Array, Array]] = {}
        left, blocks = np.asarray(rows, dtype=np.int64), 1
        while left.size:
            commands, places = self._between(left, np.arange(1, 2 * blocks + 1) / (2.0 * blocks))
            before = stand[left - 1, None], self.places[left - 1, None]
            middles = self._middles(np.hstack([before[0], commands]), np.hstack([before[1], places]), centred)
            near = (self._error(middles, places[:, ::2]) <= allowed) | (blocks >= MOST_BLOCKS)
            dense = self._between(left[near], DENSELY)[0] if centred and near.any() else commands[near, 1::2]
            for i, row, path in zip(np.flatnonzero(near), left[near].tolist(), dense, strict=True):
                ends = np.vstack([commands[i, 1:-1:2], stand[row]])
                found[row] = ends, places[i, 1::2], np.vstack([stand[row - 1], path if centred else ends])
            left, blocks = left[~near], 2 * blocks
        return [found[row] for row in rows]

    def _between(self, rows: Indices, share: Array) -> tuple[Array, Array]:
        """Commands (rows, n, axes) and places (rows, n, 3) at n shares of the ways: rotary axes straight, the bar on the shorter
        arc."""
        fixed = {
            n: (q[rows - 1, None] + share * (q[rows] - q[rows - 1])[:, None]).ravel()
            for n, q in self.run.commands.items()
            if self.machine.axes[n].rotary
        }
        places = np.stack([self._way(row, share) for row in rows])

        def what(pose: int) -> str:
            return f"the way to line {rows[pose // len(share)] + FIRST_LINE} of run {self.run.id}"

        found = self.nominal.follow(places.reshape(-1, 3), self.run.tool_ball, fixed, what)
        return np.stack([found[n] for n in self.names], axis=1).reshape(len(rows), len(share), -1), places

    def _way(self, row: int, share: Array) -> Array:
        """Places (n, 3) of the tool ball at shares of the way to a row."""
        before, after, table = self.places[row - 1], self.places[row], np.asarray(self.run.table_ball)
        if self.bar and float(np.linalg.norm(before - table)) > 1e-9:
            return np.asarray(table + _arc(before - table, after - table, share))
        return np.asarray(before + share[:, None] * (after - before))

    def _middles(self, commands: Array, places: Array, centred: bool) -> Array:
        """Where the ball is in the middle of each straight block (rows, n, 3): straight is what the words of the program say, the
        ball's place where the control follows it, the positions of the axes elsewhere."""
        if centred:
            return np.asarray(0.5 * (places[:, :-1:2] + places[:, 2::2]))
        straight = 0.5 * (commands[:, :-1:2] + commands[:, 2::2])
        middles: Mapping[str, Array] = {n: straight[:, :, i].ravel() for i, n in enumerate(self.names)}
        return self.nominal.ball(middles, self.run.tool_ball).reshape(*straight.shape[:2], 3)

    def _error(self, there: Array, places: Array) -> Array:
        """How far the straight blocks' middles leave the nest, or by how much they change the bar's length (rows,)."""
        if self.bar:
            table = np.asarray(self.run.table_ball)
            lengths = np.linalg.norm(there - table, axis=2), np.linalg.norm(places - table, axis=2)
            return np.asarray(np.abs(lengths[0] - lengths[1]).max(axis=1))
        return np.asarray(np.linalg.norm(there - places, axis=2).max(axis=1))


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
