"""The machine without errors, forward and inverse: which linear positions bring the tool ball where it shall
stand."""

from __future__ import annotations

from collections.abc import Callable, Container, Mapping, Sequence
from functools import cached_property, lru_cache
from typing import Any

import casadi as ca
import numpy as np

from symfive.arrays import Array
from symfive.compiled import Mapped
from symfive.errors import InputError, among
from symfive.kinematics import Chain, Pose, axis_pose, chain_of
from symfive.machine import Machine

Commands = dict[str, Array]
Fixed = Mapping[str, float | Array]
REACHED_MM = 1e-7
REACHED_RAD = 1e-12
REACHED_DEG = 1e-6
COARSE_RAD = 0.02
SOMEWHERE = 6.0  # mm and degree of every axis
SEED_DEG = 30.0
NEWTON = 25
REGULAR = 1e-6
"""Determinant of the directions of three linear axes above which they span the space."""
POLE = 60.0
"""A rotary axis that turns so much faster than the tool passes within 1° of the pole, where the tool points along it."""


def _shortest(slopes: Array, wanted: Array) -> Array:
    """The shortest changes (N, m) whose products with the slopes (N, 3, m) come nearest to those wanted (N, 3)."""
    change = np.zeros((len(slopes), slopes.shape[2]))
    regular = np.zeros(len(slopes), dtype=bool)
    if slopes.shape[2] == 3:
        regular = np.abs(np.linalg.det(slopes)) > REGULAR
        change[regular] = np.linalg.solve(slopes[regular], wanted[regular, :, None])[..., 0]
    inverses = np.linalg.pinv(slopes[~regular], rcond=1e-9)
    change[~regular] = np.einsum("nij,nj->ni", inverses, wanted[~regular])
    return change


def _poses(chain: Chain, units: tuple[float, ...]) -> tuple[Any, Pose, Pose]:
    """Commands as symbols, file units, and the poses of workpiece and tool."""
    q = ca.SX.sym("q", len(units))
    position = {name: unit * q[i] for i, (name, unit) in enumerate(zip(chain.structure.axes, units, strict=True))}
    return q, *chain.poses(position, {}, {})


@lru_cache(maxsize=64)
def _nominal(chain: Chain, units: tuple[float, ...]) -> Mapped:
    """Commands, mm and degree (`units` of each in mm and rad), and tool ball → ball in the workpiece frame, its slopes, rotation
    and translation of the workpiece, rotation of the tool; made once for each chain."""
    tool_ball = ca.SX.sym("tool_ball", 3)
    q, workpiece, tool = _poses(chain, units)
    ball = workpiece.apply_inverse(tool.apply(tool_ball))
    outputs = [ball, ca.jacobian(ball, q), workpiece.rotation, workpiece.translation, tool.rotation]
    return Mapped(ca.Function("nominal", [q, tool_ball], [ca.densify(part) for part in outputs]))


@lru_cache(maxsize=64)
def _pointing(chain: Chain, units: tuple[float, ...]) -> Mapped:
    """Commands → the tool's axis in the workpiece frame (3,) and its slopes (3, axes)."""
    q, workpiece, tool = _poses(chain, units)
    pointing = workpiece.rotation.T @ tool.rotation[:, 2]
    return Mapped(ca.Function("pointing", [q], [ca.densify(pointing), ca.densify(ca.jacobian(pointing, q))]))


class Nominal:
    """The exact nominal kinematics of a machine for many poses at once; commands in mm and degree."""

    def __init__(self, machine: Machine) -> None:
        self.machine = machine
        units = tuple(machine.axes[name].to_internal for name in machine.axis_names)
        self._given = chain_of(machine), units
        self._function = _nominal(*self._given)

    def _evaluate(self, commands: Mapping[str, Array], tool_ball: Sequence[float] | Array) -> list[Array]:
        """Ball (N, 3, 1), its slopes (N, 3, axes), the workpiece's rotation and translation, the tool's
        rotation."""
        q = np.stack([commands[name] for name in self.machine.axis_names], axis=1)
        balls = np.broadcast_to(np.asarray(tool_ball, dtype=float), (len(q), 3))
        return [part.reshape(len(q), part.shape[1] // 3, 3).transpose(0, 2, 1) for part in self._function(q, balls)]

    def commands(self, fixed: Fixed, rows: int) -> Commands:
        """Every axis at its fixed position or at home (rows,). Raises `InputError` for an axis the machine
        lacks."""
        for name in fixed:
            among(name, self.machine.axis_names, f"the machine has no axis {name}")
        values = {name: fixed.get(name, self.machine.home(name)) for name in self.machine.axes}
        return {name: np.broadcast_to(np.asarray(value, dtype=float), (rows,)).copy() for name, value in values.items()}

    def ball(self, commands: Mapping[str, Array], tool_ball: Sequence[float] | Array) -> Array:
        """The tool ball in the workpiece frame, (N, 3) mm."""
        return self._evaluate(commands, tool_ball)[0][:, :, 0]

    def workpiece_rotation(self, commands: Mapping[str, Array]) -> Array:
        """The workpiece frame's axes in the machine frame, (N, 3, 3)."""
        return self._evaluate(commands, (0.0, 0.0, 0.0))[2]

    def workpiece_origin(self, commands: Mapping[str, Array]) -> Array:
        """The workpiece frame's origin in the machine frame, (N, 3) mm."""
        return self._evaluate(commands, (0.0, 0.0, 0.0))[3][:, :, 0]

    def tool_rotation(self, commands: Mapping[str, Array]) -> Array:
        """The tool frame's axes in the machine frame, (N, 3, 3)."""
        return self._evaluate(commands, (0.0, 0.0, 0.0))[4]

    def seen_from_workpiece(self, commands: Mapping[str, Array], directions: Sequence[float] | Array) -> Array:
        """Directions of the machine frame, (3,) or (N, 3), in the workpiece frame: (N, 3)."""
        rotation = self.workpiece_rotation(commands)
        vectors = np.broadcast_to(np.asarray(directions, dtype=float), (len(rotation), 3))
        return np.asarray(np.einsum("nji,nj->ni", rotation, vectors))

    def following(self, fixed: Container[str] = ()) -> list[str]:
        """The linear axes that follow the ball: of those not in `fixed` the first from the bed that span space, three at most."""
        names, moving = self.machine.axis_names, list[str]()
        for name in self.machine.linear_axes:
            columns = [names.index(n) for n in (*moving, name)]
            if name not in fixed and np.linalg.matrix_rank(self._slopes[:, columns], tol=REGULAR) == len(columns):
                moving.append(name)
        return moving

    @cached_property
    def _slopes(self) -> Array:
        """Motion of the ball with each axis (3, axes) somewhere: linear axes are independent anywhere or nowhere."""
        somewhere = {name: np.full(1, SOMEWHERE) for name in self.machine.axis_names}
        return np.asarray(self._evaluate(somewhere, (0.0, 0.0, 0.0))[1][0])

    def follow(
        self, target: Array, tool_ball: Sequence[float] | Array, fixed: Fixed, what: str | Callable[[int], str]
    ) -> Commands:
        """Commands that bring the tool ball to `target` (N, 3), mm in the workpiece frame.

        The linear axes of `following` are solved for, all others stand where `fixed` says (a number or (N,)) or at home. The
        ball moves linearly with them, so one linear solve is exact, whatever their directions. Raises `InputError` naming
        `what` cannot be reached, a text or a function of the target's number.
        """
        commands = self.commands(fixed, len(target))
        names = self.machine.axis_names
        moving = self.following(fixed)
        ball, slope, *_ = self._evaluate(commands, tool_ball)
        matrix = slope[:, :, [names.index(name) for name in moving]]
        wanted = target - ball[:, :, 0]
        change = _shortest(matrix, wanted)
        missed = np.linalg.norm(np.einsum("nij,nj->ni", matrix, change) - wanted, axis=1)
        if missed.size and missed.max() > REACHED_MM:
            named = what if isinstance(what, str) else what(int(missed.argmax()))
            problem = f"{named}: the linear axes {', '.join(moving) or '(none)'} miss a pose by {missed.max():.3g} mm"
            raise InputError(problem, remedy="choose poses that they can reach, or free a linear axis")
        for i, name in enumerate(moving):
            commands[name] = commands[name] + change[:, i]
        return commands

    def pointing(self, directions: Array, what: str) -> Commands:
        """Angles of the rotary axes, degree, that point the tool's axis along `directions` (N, 3) of the workpiece frame, a
        path without jumps.

        Of all branches that stay within the travel, the one whose axes go the least way and stay near 0. Raises
        `InputError` where there is none.
        """
        rotary = self.machine.rotary_axes
        if not rotary:
            raise InputError(
                f"{what}: the machine has no rotary axis to point the tool", remedy="choose another procedure"
            )
        steps = np.linalg.norm(np.diff(directions, axis=0), axis=1)
        coarse = np.unique(np.searchsorted(np.cumsum(steps), np.arange(0.0, steps.sum() + COARSE_RAD, COARSE_RAD)))
        coarse = np.append(coarse[coarse < len(directions) - 1], len(directions) - 1)
        found: list[tuple[float, Array]] = []
        limits = np.array([self.machine.axes[name].travel for name in rotary])
        for seed in self._seeds(rotary, directions[0]):
            knots = np.zeros((len(coarse), len(rotary)))
            near = seed
            for k, row in enumerate(coarse):
                ahead = 2.0 * knots[k - 1] - knots[k - 2] if k > 1 else near
                near = knots[k] = self._turn(rotary, ahead[None], directions[row][None])[0]
            path = np.stack([np.interp(np.arange(len(directions)), coarse, column) for column in knots.T], axis=1)
            path = self._whole_turns(rotary, self._turn(rotary, path, directions))
            quick = np.abs(np.diff(path, axis=0)).max(axis=1) > np.degrees(POLE * steps) + REACHED_DEG
            inside = (path >= limits[:, 0] - REACHED_DEG) & (path <= limits[:, 1] + REACHED_DEG)
            if np.isfinite(path).all() and not quick.any() and inside.all():
                found.append((float(np.abs(np.diff(path, axis=0)).sum() + np.abs(path.mean(axis=0)).sum()), path))
        if not found:
            problem = f"{what}: {' and '.join(rotary)} cannot point the tool all along within the travel"
            remedy = "choose other angles, and none that lead close to the pole (tool along the turning axis)"
            raise InputError(problem, remedy=remedy)
        _, best = min(found, key=lambda f: f[0])
        return {name: best[:, i] for i, name in enumerate(rotary)}

    def _seeds(self, rotary: Sequence[str], direction: Array) -> Array:
        """All rotary positions within a turn that point along one direction, (M, R) degree."""
        travels = [self.machine.axes[name].travel for name in rotary]
        grids = [np.arange(max(low, -180.0), min(high, 180.0) + 1e-9, SEED_DEG) for low, high in travels]
        start = np.stack([g.ravel() for g in np.meshgrid(*grids, indexing="ij")], axis=1)
        solved = self._turn(rotary, start, np.broadcast_to(direction, (len(start), 3)))
        within = (solved[np.isfinite(solved).all(axis=1)] + 180.0) % 360.0 - 180.0
        return np.unique(np.round(within, 6), axis=0)

    def _whole_turns(self, rotary: Sequence[str], path: Array) -> Array:
        """The path (N, R) moved by whole turns of each axis to where it is nearest to 0 within the travel."""
        moved = path.copy()
        for column, name in zip(moved.T, rotary, strict=True):
            low, high = self.machine.axes[name].travel
            nearest = -360.0 * np.round(column.mean() / 360.0)
            turns = nearest + 360.0 * np.array([0.0, -1.0, 1.0])
            fits = [t for t in turns if column.min() + t >= low and column.max() + t <= high]
            column += fits[0] if fits else nearest
        return moved

    def _turn(self, rotary: Sequence[str], start: Array, directions: Array) -> Array:
        """Newton's method on the rotary axes (N, R), degree, from `start`; NaN where it does not arrive."""
        names = self.machine.axis_names
        columns = [names.index(name) for name in rotary]
        q = np.zeros((len(start), len(names)))
        q[:, columns] = start
        missed = np.full(len(start), np.inf)
        for _ in range(NEWTON):
            point, slope = _pointing(*self._given)(q)
            left = directions - point
            missed = np.linalg.norm(left, axis=1)
            if missed.max() < REACHED_RAD:
                break
            slopes = slope.reshape(len(start), -1, 3).transpose(0, 2, 1)[:, :, columns]
            change = np.einsum("nij,nj->ni", np.linalg.pinv(slopes, rcond=1e-6), left)
            q[:, columns] += np.clip(change, -SEED_DEG, SEED_DEG)
        return np.where(missed[:, None] < REACHED_RAD, q[:, columns], np.nan)

    def axis_line(self, name: str, fixed: Fixed) -> tuple[Array, Array]:
        """A point (mm) on a rotary axis and its direction, in the machine frame, with the other axes as in
        `fixed`."""
        side = self.machine.structure.carries(name)
        chain = self.machine.structure.tool
        if side == "workpiece":
            chain = tuple(reversed(self.machine.structure.workpiece))
        axis = self.machine.axes[name]
        point, direction = ca.DM(axis.origin), ca.DM(axis.direction)
        for inner in reversed(chain[: chain.index(name)]):
            carrier = self.machine.axes[inner]
            position = float(np.asarray(fixed.get(inner, self.machine.home(inner))).flat[0]) * carrier.to_internal
            pose = axis_pose(carrier, side, ca.SX(position), {}, {})
            point, direction = ca.evalf(pose.apply(point)), ca.evalf(pose.rotation @ direction)
        return np.asarray(point, dtype=float)[:, 0], np.asarray(direction, dtype=float)[:, 0]
