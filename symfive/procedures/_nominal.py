"""The machine without errors, forward and inverse: which linear positions bring the tool ball where it shall
stand."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from symfive.errors import InputError
from symfive.kinematics import axis_pose, chain_poses
from symfive.machine import Axis, Machine

__all__ = ["Commands", "Fixed", "Nominal", "home"]

Array = NDArray[np.float64]
Commands = dict[str, Array]
Fixed = Mapping[str, float | Array]
REACHED_MM = 1e-7


def home(axis: Axis) -> float:
    """Where an axis stands that a test does not use: at 0, or at the end of its travel that is nearest to 0."""
    return float(np.clip(0.0, *axis.travel))


class Nominal:
    """The exact nominal kinematics of a machine for many poses at once; commands in mm and degree."""

    def __init__(self, machine: Machine) -> None:
        self.machine = machine
        names = machine.axis_names
        q = ca.SX.sym("q", len(names))
        tool_ball = ca.SX.sym("tool_ball", 3)
        position = {name: machine.axes[name].to_internal * q[i] for i, name in enumerate(names)}
        workpiece, tool = chain_poses(machine, position, {}, {})
        ball = workpiece.apply_inverse(tool.apply(tool_ball))
        outputs = [ball, ca.jacobian(ball, q), workpiece.rotation, workpiece.translation, tool.rotation]
        self._function: Any = ca.Function("nominal", [q, tool_ball], [ca.densify(part) for part in outputs])

    def _evaluate(self, commands: Mapping[str, Array], tool_ball: Sequence[float] | Array) -> list[Array]:
        """Ball (N, 3, 1), its slopes (N, 3, axes), the workpiece's rotation and translation, the tool's
        rotation."""
        q = np.stack([commands[name] for name in self.machine.axis_names])
        balls = np.broadcast_to(np.asarray(tool_ball, dtype=float), (q.shape[1], 3)).T
        parts = [np.asarray(part) for part in self._function.map(q.shape[1])(ca.DM(q), ca.DM(balls))]
        return [part.reshape(3, q.shape[1], -1).transpose(1, 0, 2) for part in parts]

    def commands(self, fixed: Fixed, rows: int) -> Commands:
        """Every axis at its fixed position or at home (rows,). Raises `InputError` for an axis the machine
        lacks."""
        for name in fixed:
            if name not in self.machine.axes:
                remedy = f"use one of {', '.join(self.machine.axis_names)}"
                raise InputError(f"the machine has no axis {name}", remedy=remedy)
        values = {name: fixed.get(name, home(axis)) for name, axis in self.machine.axes.items()}
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

    def follow(self, target: Array, tool_ball: Sequence[float] | Array, fixed: Fixed, what: str) -> Commands:
        """Commands that bring the tool ball to `target` (N, 3), mm in the workpiece frame.

        Rotary axes stand where `fixed` says (a number or (N,)) or at home; the linear axes that are not fixed
        are solved for. The ball moves linearly with them, so one linear solve is exact, whatever their
        directions; where there are more than three, the shortest motion is taken. Raises `InputError` naming
        `what` cannot be reached.
        """
        commands = self.commands(fixed, len(target))
        names = self.machine.axis_names
        moving = [n for n in names if not self.machine.axes[n].rotary and n not in fixed]
        ball, slope, *_ = self._evaluate(commands, tool_ball)
        matrix = slope[:, :, [names.index(name) for name in moving]]
        wanted = target - ball[:, :, 0]
        change = np.einsum("nij,nj->ni", np.linalg.pinv(matrix, rcond=1e-9), wanted)
        missed = np.linalg.norm(np.einsum("nij,nj->ni", matrix, change) - wanted, axis=1)
        if missed.size and missed.max() > REACHED_MM:
            problem = f"{what}: the linear axes {', '.join(moving) or '(none)'} miss a pose by {missed.max():.3g} mm"
            raise InputError(problem, remedy="choose poses that they can reach, or free a linear axis")
        for i, name in enumerate(moving):
            commands[name] = commands[name] + change[:, i]
        return commands

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
            position = float(np.asarray(fixed.get(inner, home(carrier))).flat[0]) * carrier.to_internal
            pose = axis_pose(carrier, side, ca.SX(position), {}, {})
            point, direction = ca.evalf(pose.apply(point)), ca.evalf(pose.rotation @ direction)
        return np.asarray(point, dtype=float)[:, 0], np.asarray(direction, dtype=float)[:, 0]
