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
from functools import lru_cache
from typing import Any, NamedTuple

import casadi as ca

from symfive.machine import Axis, Machine, Structure

Symbol = Any
"""A CasADi SX expression (CasADi carries no types)."""
LETTERS = "XYZABC"


class _Joint(NamedTuple):
    """What of an axis decides its pose."""

    name: str
    rotary: bool
    direction: tuple[float, float, float]
    origin: tuple[float, float, float]

    @classmethod
    def of(cls, axis: Axis) -> _Joint:
        return cls(axis.name, axis.rotary, axis.direction, axis.origin)


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
    across, cross, outer = _about(*direction)
    return ca.cos(angle) * across + ca.sin(angle) * cross + outer


@lru_cache(maxsize=64)
def _about(x: float, y: float, z: float) -> tuple[Symbol, Symbol, Symbol]:
    """1 - u uᵀ, the cross product with u, and u uᵀ of a unit vector u."""
    cross = ca.sparsify(ca.DM([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]]))
    outer = ca.sparsify(ca.DM([[x * x, x * y, x * z], [x * y, y * y, y * z], [x * z, y * z, z * z]]))
    return ca.SX(ca.DM.eye(3) - outer), ca.SX(cross), ca.SX(outer)


def angles(a: Symbol, b: Symbol, c: Symbol) -> Symbol:
    """Rx(a) Ry(b) Rz(c)."""
    return _rotation(0, a) @ _rotation(1, b) @ _rotation(2, c)


def axis_pose(
    axis: Axis | _Joint, carries: str, position: Symbol, location: Mapping[str, Symbol], motion: Mapping[str, Symbol]
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
    return chain_of(machine).poses(position, location, motion)


def chain_of(machine: Machine) -> Chain:
    """The chain of a machine: machines that differ in anything else have the same one."""
    return Chain(machine.structure, tuple(_Joint.of(machine.axes[name]) for name in machine.structure.axes))


class Chain(NamedTuple):
    """All that decides the kinematics of a machine without errors, to keep by what was made of it."""

    structure: Structure
    axes: tuple[_Joint, ...]

    def poses(
        self, position: Mapping[str, Symbol], location: Mapping[str, Symbol], motion: Mapping[str, Symbol]
    ) -> tuple[Pose, Pose]:
        """As `chain_poses`."""
        names = self.structure.axes

        def column(pattern: str, source: Mapping[str, Symbol]) -> Symbol:
            return ca.vertcat(*(source.get(pattern.format(letter, name), 0.0) for name in names for letter in LETTERS))

        parts = _chain(*self)(
            ca.SX(ca.vertcat(*(position[name] for name in names))),
            ca.SX(column("E{}0{}", location)),
            ca.SX(column("E{}{}", motion)),
        )
        return Pose(*parts[:2]), Pose(*parts[2:])


@lru_cache(maxsize=64)
def _chain(structure: Structure, axes: tuple[_Joint, ...]) -> Any:
    """The chain of a structure as a function of positions, location errors and error motions (LETTERS of each axis): it is
    put together once, and where an error is zero, calling it leaves nothing of that error in the expression."""
    n = len(axes)
    q, location, motion = ca.SX.sym("q", n), ca.SX.sym("location", 6 * n), ca.SX.sym("motion", 6 * n)
    places = [(axis.name, letter) for axis in axes for letter in LETTERS]
    locations = {f"E{letter}0{name}": location[i] for i, (name, letter) in enumerate(places)}
    motions = {f"E{letter}{name}": motion[i] for i, (name, letter) in enumerate(places)}
    by_name = {axis.name: (axis, q[i]) for i, axis in enumerate(axes)}
    parts = []
    for names in (tuple(reversed(structure.workpiece)), structure.tool):
        pose = Pose.identity()
        for name in names:
            axis, position = by_name[name]
            pose = pose @ axis_pose(axis, structure.carries(name), position, locations, motions)
        parts += [ca.densify(pose.rotation), ca.densify(pose.translation)]
    return ca.Function("chain", [q, location, motion], parts)


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
