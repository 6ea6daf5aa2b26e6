"""The kinematic chain, exact: section 1 of docs/conventions.md, written once in CasADi.

    linear axis:  A(q) = Trans(R0·e·s + E(q)) · R(q)
    rotary axis:  A(q) = Trans(o + P0 + E(q)) · R0 · R(q) · Rot(e, s) · Trans(-o)

with s = -q on the workpiece side and s = +q on the tool side, `R0 = Rx(EA0j) Ry(EB0j) Rz(EC0j)`,
`P0 = (EX0j, EY0j, EZ0j)` and the error motions `E = (EXj, EYj, EZj)`, `R = Rx(EAj) Ry(EBj) Rz(ECj)`. No angle is
taken as small. The chains are multiplied from the bed outward.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import casadi as ca

from symfive.machine import Axis, Machine

__all__ = ["Pose", "angles", "axis_pose", "ball_in_workpiece", "chain_poses", "first_order"]

Symbol = Any
"""A CasADi SX expression (CasADi carries no types)."""


@dataclass(frozen=True)
class Pose:
    """A rigid motion: `rotation` 3×3, `translation` 3 (mm); `a @ b` is a after b."""

    rotation: Symbol
    translation: Symbol

    @classmethod
    def identity(cls) -> Pose:
        """No motion."""
        return cls(ca.SX.eye(3), ca.SX(3, 1))

    def __matmul__(self, other: Pose) -> Pose:
        return Pose(self.rotation @ other.rotation, self.rotation @ other.translation + self.translation)

    def apply(self, point: Symbol) -> Symbol:
        """The point carried by the motion."""
        return self.rotation @ point + self.translation

    def apply_inverse(self, point: Symbol) -> Symbol:
        """The point seen from the moved frame."""
        return self.rotation.T @ (point - self.translation)


def _rotation(direction: tuple[float, float, float] | int, angle: Symbol) -> Symbol:
    """Rodrigues' formula about a unit vector, or about x, y, z for 0, 1, 2."""
    angle = ca.SX(angle)
    if angle.is_zero():
        return ca.SX.eye(3)
    if isinstance(direction, int):
        direction = (float(direction == 0), float(direction == 1), float(direction == 2))
    c, s = ca.cos(angle), ca.sin(angle)
    x, y, z = direction
    cross = ca.sparsify(ca.DM([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]]))
    outer = ca.sparsify(ca.DM([[x * x, x * y, x * z], [x * y, y * y, y * z], [x * z, y * z, z * z]]))
    return c * (ca.DM.eye(3) - outer) + s * cross + outer


def angles(a: Symbol, b: Symbol, c: Symbol) -> Symbol:
    """Rx(a) Ry(b) Rz(c)."""
    return _rotation(0, a) @ _rotation(1, b) @ _rotation(2, c)


def axis_pose(
    axis: Axis, carries: str, position: Symbol, location: Mapping[str, Symbol], motion: Mapping[str, Symbol]
) -> Pose:
    """A(q) of one axis. `position` mm or rad; `location` and `motion` in mm and rad by ISO 230-1 name, absent = 0."""
    name = axis.name
    s = -position if carries == "workpiece" else position

    def errors(pattern: str, letters: str, source: Mapping[str, Symbol]) -> list[Symbol]:
        return [source.get(pattern.format(letter, name), ca.SX(0)) for letter in letters]

    shift = ca.vertcat(*errors("E{}{}", "XYZ", motion))
    turn = angles(*errors("E{}{}", "ABC", motion))
    tilt = angles(*errors("E{}0{}", "ABC", location))
    if not axis.rotary:
        return Pose(turn, tilt @ ca.DM(axis.direction) * s + shift)
    origin = ca.DM(axis.origin)
    rotation = tilt @ turn @ _rotation(axis.direction, s)
    offset = ca.vertcat(*errors("E{}0{}", "XYZ", location))
    return Pose(rotation, origin + offset + shift - rotation @ origin)


def chain_poses(
    machine: Machine, position: Mapping[str, Symbol], location: Mapping[str, Symbol], motion: Mapping[str, Symbol]
) -> tuple[Pose, Pose]:
    """(W, T): the workpiece and the tool in the machine frame."""
    poses = []
    for names in (tuple(reversed(machine.structure.workpiece)), machine.structure.tool):
        pose = Pose.identity()
        for name in names:
            axis = machine.axes[name]
            pose = pose @ axis_pose(axis, machine.structure.carries(name), position[name], location, motion)
        poses.append(pose)
    return poses[0], poses[1]


def ball_in_workpiece(
    machine: Machine,
    position: Mapping[str, Symbol],
    tool_ball: Symbol,
    *,
    location: Mapping[str, Symbol] | None = None,
    motion: Mapping[str, Symbol] | None = None,
    shift: Symbol | None = None,
) -> Symbol:
    """d = W⁻¹ · (T · tool_ball + shift) in mm: the tool ball in the workpiece frame.

    `position` axis → mm or rad, `tool_ball` 3 (mm, tool frame), `location` and `motion` errors by ISO 230-1 name in
    mm and rad, `shift` a displacement of the tool in the machine frame (mm).
    """
    workpiece, tool = chain_poses(machine, position, location or {}, motion or {})
    point = tool.apply(tool_ball)
    return workpiece.apply_inverse(point if shift is None else point + shift)


def first_order(expression: Symbol, errors: Symbol) -> Symbol:
    """The expression linearised in `errors` about zero, by differentiation of the exact one."""
    zero = ca.DM.zeros(errors.shape)
    value, slope = ca.substitute([expression, ca.jacobian(expression, errors)], [errors], [zero])
    return ca.simplify(value + slope @ errors)
