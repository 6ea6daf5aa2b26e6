"""Moves from pose to pose with the ball in its nest, or the bar at its length: straight blocks that stay near the true path."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from symfive.arrays import Array, Indices
from symfive.campaign import FIRST_LINE, Run
from symfive.errors import InputError
from symfive.instruments import has_bar, instruments_of
from symfive.machine import Machine
from symfive.procedures import Nominal

CHORD_SHARE = 0.05
"""A straight block may leave the true path by this share of the sensor's range or the bar's stroke."""
MOST_BLOCKS = 4096
DENSELY = np.linspace(0.0, 1.0, 65)[1:]
"""Shares of a move at which the axes are looked at where the control makes the blocks."""


Leg = tuple[Mapping[str, float], Mapping[str, float], int]
"""A seated move: positions of all axes at its start and its end, and the row to which it leads."""


@dataclass(frozen=True)
class _Legs:
    """Legs as arrays: `ends` (legs, 2, axes), `balls` (legs, 2, 3) mm in the workpiece frame, the `rows` that they lead to."""

    ends: Array
    balls: Array
    rows: Sequence[int]


class Seat:
    """Ball and nest, or bar, of a static run: `places` of the tool ball in the workpiece frame at its poses (rows, 3), mm."""

    def __init__(self, machine: Machine, run: Run, nominal: Nominal) -> None:
        self.machine, self.run, self.nominal = machine, run, nominal
        self.names, self.following = machine.axis_names, nominal.following()
        self.places = nominal.ball(run.commands, run.tool_ball)
        self.bar = has_bar(run)

    def blocks(self, legs: Sequence[Leg], centred: bool) -> list[tuple[Array, Array, Array]]:
        """Straight blocks of every leg: positions (n, axes) and places (n, 3) at the ends of n equal blocks, and the path of the
        axes (m, axes), start and end included. `centred`: the control makes them follow the ball."""
        allowed = CHORD_SHARE * instruments_of(self.run)[0].stroke(self.machine)
        stand = [np.array([[place[n] for n in self.names] for place in (a, b)]) for a, b, _ in legs]
        ends = np.array(stand).reshape(-1, 2, len(self.names))
        balls = self.nominal.ball({n: ends[:, :, i].ravel() for i, n in enumerate(self.names)}, self.run.tool_ball)
        moves = _Legs(ends, balls.reshape(-1, 2, 3), [row for *_, row in legs])
        found: dict[int, tuple[Array, Array, Array]] = {}
        held: dict[int, tuple[Array, Array, Array]] = {}  # near at their middles; they may be off between these
        left, blocks = np.arange(len(legs)), 1
        while left.size:
            commands, places = self._between(moves, left, np.arange(1, 2 * blocks + 1) / (2.0 * blocks))
            commands[:, -1] = moves.ends[left, 1]
            before = moves.ends[left, :1], moves.balls[left, :1]
            middles = self._middles(np.hstack([before[0], commands]), np.hstack([before[1], places]), centred)
            near = self._error(middles, places[:, ::2]) <= allowed
            if blocks == MOST_BLOCKS and not near.all():
                where = self._words_of(moves, int(left[np.argmin(near)]))
                remedy = "choose poses that the linear axes reach from another without a jump"
                raise InputError(f"{where}: the axes cannot follow the ball", remedy=remedy)
            dense = self._between(moves, left[near], DENSELY)[0] if centred and near.any() else commands[near, 1::2]
            for i, leg, path in zip(np.flatnonzero(near), left[near].tolist(), dense, strict=True):
                there = commands[i, 1::2]
                drawn = there, places[i, 1::2], np.vstack([moves.ends[leg, 0], path if centred else there])
                if leg in held or blocks >= MOST_BLOCKS:  # half as long they are near too
                    found[leg] = held.get(leg, drawn)
                held[leg] = drawn
            for leg in left[~near].tolist():
                held.pop(leg, None)
            left, blocks = np.array([leg for leg in left.tolist() if leg not in found], dtype=np.int64), 2 * blocks
        return [found[leg] for leg in range(len(legs))]

    def path(self, before: Mapping[str, float], after: Mapping[str, float]) -> Array | None:
        """The path of the axes (m, axes) on a straight move with the ball seated; None where they cannot follow the ball."""
        return self.paths([(before, after)])[0]

    def paths(self, moves: Sequence[tuple[Mapping[str, float], Mapping[str, float]]]) -> list[Array | None]:
        """The same of several moves, all at once as long as the axes can follow the ball on all of them."""
        try:
            return [path for *_, path in self.blocks([(*move, 0) for move in moves], centred=False)]
        except InputError:
            return [None] if len(moves) == 1 else [self.path(*move) for move in moves]

    def _between(self, moves: _Legs, legs: Indices, share: Array) -> tuple[Array, Array]:
        """Commands (legs, n, axes) and places (legs, n, 3) at n shares of the legs: rotary axes straight, the bar on the shorter
        arc."""
        first, last = moves.ends[legs, 0], moves.ends[legs, 1]
        fixed = {
            n: (first[:, i, None] + share * (last[:, i] - first[:, i])[:, None]).ravel()
            for i, n in enumerate(self.names)
            if n not in self.following
        }
        places = self._ball_path(moves.balls[legs, 0], moves.balls[legs, 1], share)

        def what(pose: int) -> str:
            return self._words_of(moves, legs[pose // len(share)])

        found = self.nominal.follow(places.reshape(-1, 3), self.run.tool_ball, fixed, what)
        return np.stack([found[n] for n in self.names], axis=1).reshape(len(legs), len(share), -1), places

    def _words_of(self, moves: _Legs, leg: int) -> str:
        return f"the move to line {moves.rows[leg] + FIRST_LINE} of run {self.run.id}"

    def _ball_path(self, before: Array, after: Array, share: Array) -> Array:
        """Places (legs, n, 3) of the tool ball at shares of the paths from some places (legs, 3) to others."""
        table = np.asarray(self.run.table_ball)
        straight = before[:, None] + share[:, None] * (after - before)[:, None]
        out = np.linalg.norm(before - table, axis=1) > 1e-9
        if self.bar and out.any():
            straight[out] = table + along_arcs(before[out] - table, after[out] - table, share)
        return np.asarray(straight)

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


def along_arcs(a: Array, b: Array, share: Array) -> Array:
    """Vectors (legs, n, 3) at n shares of the shorter arcs from a to b (legs, 3), length interpolated."""
    la, lb = (np.linalg.norm(vector, axis=1, keepdims=True) for vector in (a, b))
    u, v = a / la, b / lb
    cosine = np.sum(u * v, axis=1, keepdims=True)
    across = v - cosine * u
    sine = np.linalg.norm(across, axis=1, keepdims=True)
    upright = np.where(np.abs(u[:, 2:]) < 0.9, [[0.0, 0.0, 1.0]], [[1.0, 0.0, 0.0]])
    across = np.where(sine < 1e-12, np.cross(u, upright), across)
    across = across / np.linalg.norm(across, axis=1, keepdims=True)
    angle, size = share * np.arctan2(sine, cosine), (1.0 - share) * la + share * lb
    turned = np.cos(angle)[..., None] * u[:, None] + np.sin(angle)[..., None] * across[:, None]
    return np.asarray(size[..., None] * turned)
