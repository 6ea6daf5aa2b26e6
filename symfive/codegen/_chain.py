"""Position and direction of the tool in the workpiece and their exact derivatives, by the geometry of the chain.

Each error of an axis is an elementary motion in the frame of its parent: a shift along a unit vector `a`, or a turn about
a unit vector `a` through a point `c`. With the parent's rotation R seen from the workpiece, it moves the tool point d by
`R a` or by `R a × (d - c)`, and its direction t by zero or by `R a × t`; on the workpiece's side by the negative of that.
That needs a third of the operations of automatic differentiation and is the same derivative (tests compare both).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import casadi as ca

from symfive.codegen._subject import Subject
from symfive.kinematics import Pose, angles, axis_pose
from symfive.machine import Machine

Symbol = Any
Columns = dict[tuple[str, str], tuple[Symbol, Symbol]]
TOOL_AXIS = (0.0, 0.0, 1.0)


@dataclass(frozen=True)
class Chain:
    """Symbolic expressions in `q` (mm, rad), `tool` (mm, tool frame) and `p` (units of the parameters).

    `position` (3, mm) the tool point and `direction` (3) the tool frame's z in the workpiece frame; `nominal_` without
    errors; `_by_q` (3, axes) and `_by_p` (3, parameters) derivatives.
    """

    q: Symbol
    tool: Symbol
    p: Symbol
    position: Symbol
    direction: Symbol
    position_by_q: Symbol
    direction_by_q: Symbol
    position_by_p: Symbol
    direction_by_p: Symbol
    nominal_position: Symbol
    nominal_direction: Symbol
    nominal_position_by_q: Symbol


def chain_of(subject: Subject) -> Chain:
    """The chain of a subject, symbolically."""
    machine = subject.machine
    q = ca.SX.sym("q", len(subject.axes))
    tool = ca.SX.sym("tool", 3)
    p = ca.SX.sym("p", len(subject.parameters))
    row = subject.row(q, p, tool)
    position, direction, columns = _walk(machine, row.axis, row.location, row.motion, row.shift, row.tool_ball)
    causes: dict[tuple[str, str], Symbol] = {("axis", name): value for name, value in row.axis.items()}
    causes |= {("location", name): value for name, value in row.location.items()}
    causes |= {("motion", name): value for name, value in row.motion.items()}
    causes |= {("shift", "xyz"[i]): row.shift[i] for i in range(3)}
    causes |= {("tool", "xyz"[i]): row.tool_ball[i] for i in range(3)}
    stack = ca.vertcat(*causes.values())
    moves, turns = (ca.horzcat(*(columns[key][k] for key in causes)) for k in (0, 1))
    by_q, by_p = ca.jacobian(stack, q), ca.jacobian(stack, p)
    plain = {name: q[i] for i, name in enumerate(subject.axes)}
    nominal, nominal_direction, nominal_columns = _walk(machine, plain, {}, {}, ca.SX(3, 1), tool)
    nominal_by_q = ca.horzcat(*(nominal_columns[("axis", name)][0] for name in subject.axes))
    return Chain(
        q, tool, p, position, direction, moves @ by_q, turns @ by_q, moves @ by_p, turns @ by_p,
        nominal, nominal_direction, nominal_by_q,
    )  # fmt: skip


def _walk(
    machine: Machine, axis: Mapping[str, Symbol], location: Mapping[str, Symbol], motion: Mapping[str, Symbol],
    shift: Symbol, ball: Symbol,
) -> tuple[Symbol, Symbol, Columns]:  # fmt: skip
    """Tool point, tool direction, and what a unit of each elementary motion adds to both."""
    poses = {
        name: axis_pose(machine.axes[name], machine.structure.carries(name), axis[name], location, motion)
        for name in machine.axis_names
    }
    parents: dict[str, Pose] = {}
    frame = Pose.identity()
    for name in machine.structure.workpiece:  # from the workpiece to the bed: the parent is the child times A⁻¹
        rotation = frame.rotation @ poses[name].rotation.T
        frame = Pose(rotation, frame.translation - rotation @ poses[name].translation)
        parents[name] = frame
    bed = frame
    frame = Pose(bed.rotation, bed.translation + bed.rotation @ shift)
    for name in machine.structure.tool:
        parents[name] = frame
        frame = frame @ poses[name]
    point, direction = frame.apply(ball), frame.rotation @ ca.DM(TOOL_AXIS)
    columns: Columns = {("shift", "xyz"[i]): (bed.rotation[:, i], ca.SX(3, 1)) for i in range(3)}
    columns |= {("tool", "xyz"[i]): (frame.rotation[:, i], ca.SX(3, 1)) for i in range(3)}
    for name in machine.axis_names:
        columns |= _axis_columns(machine, name, axis[name], location, motion, parents[name], point, direction)
    return point, direction, columns


def _axis_columns(
    machine: Machine, name: str, position: Symbol, location: Mapping[str, Symbol], motion: Mapping[str, Symbol],
    parent: Pose, point: Symbol, direction: Symbol,
) -> Columns:  # fmt: skip
    """The elementary motions of one axis: its coordinate, its location errors and its error motions."""
    axis = machine.axes[name]
    sign = -1.0 if machine.structure.carries(name) == "workpiece" else 1.0
    tilt, tilts = _turn([location.get(f"E{c}0{name}", ca.SX(0)) for c in "ABC"])
    turn, turns = _turn([motion.get(f"E{c}{name}", ca.SX(0)) for c in "ABC"])
    shift = ca.vertcat(*(motion.get(f"E{c}{name}", ca.SX(0)) for c in "XYZ"))
    none = ca.SX(3, 1)
    found: Columns = {}

    def about(vector: Symbol, centre: Symbol) -> tuple[Symbol, Symbol]:
        arm = parent.rotation @ vector
        return ca.cross(arm, point - centre), ca.cross(arm, direction)

    for i, c in enumerate("XYZ"):
        found["motion", f"E{c}{name}"] = sign * parent.rotation[:, i], none
    if axis.rotary:
        offset = ca.vertcat(*(location.get(f"E{c}0{name}", ca.SX(0)) for c in "XYZ"))
        centre = parent.apply(ca.DM(axis.origin) + offset + shift)
        for i, c in enumerate("ABC"):
            found["location", f"E{'XYZ'[i]}0{name}"] = sign * parent.rotation[:, i], none
            found["location", f"E{c}0{name}"] = _scaled(sign, about(tilts[i], centre))
            found["motion", f"E{c}{name}"] = _scaled(sign, about(tilt @ turns[i], centre))
        found["axis", name] = about(tilt @ turn @ ca.DM(axis.direction), centre)
        return found
    travel = tilt @ ca.DM(axis.direction)
    path = travel * (sign * position)
    centre = parent.apply(path + shift)
    for i, c in enumerate("ABC"):
        found["location", f"E{c}0{name}"] = sign * (parent.rotation @ ca.cross(tilts[i], path)), none
        found["motion", f"E{c}{name}"] = _scaled(sign, about(turns[i], centre))
    found["axis", name] = parent.rotation @ travel, none
    return found


def _scaled(sign: float, pair: tuple[Symbol, Symbol]) -> tuple[Symbol, Symbol]:
    return sign * pair[0], sign * pair[1]


def _turn(abc: list[Symbol]) -> tuple[Symbol, list[Symbol]]:
    """Rx(a) Ry(b) Rz(c) and the unit vectors about which a, b and c turn, in the parent's frame."""
    a, b, c = abc
    zero = ca.SX(0)
    vectors = [ca.SX([1.0, 0.0, 0.0]), angles(a, zero, zero)[:, 1], angles(a, b, zero)[:, 2]]
    return angles(a, b, c), vectors
