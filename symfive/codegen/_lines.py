"""Where the rotary axes of a machine lie, as designed and as identified: what the parameters of a control describe."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import casadi as ca
import numpy as np

from symfive.arrays import Array
from symfive.codegen._subject import Subject
from symfive.errors import InputError
from symfive.kinematics import Pose, axis_pose


@dataclass(frozen=True)
class AxisLine:
    """A rotary axis in the machine frame with all axes at zero: a point on it (mm) and its unit direction."""

    axis: str
    point: Array
    direction: Array


def table_axes(subject: Subject, purpose: str) -> tuple[str, str]:
    """The two rotary axes under the workpiece, the carrying one first. Raises `InputError` for other structures."""
    machine = subject.machine
    carrying = tuple(name for name in reversed(machine.structure.workpiece) if machine.axes[name].rotary)
    if len(carrying) != 2 or carrying != machine.rotary_axes:
        raise InputError(
            f'{purpose} describe two rotary axes under the workpiece, and "{machine.structure.code}" has others',
            remedy="use the target c or linuxcnc, which hold every structure",
        )
    return carrying[0], carrying[1]


def axis_lines(subject: Subject) -> dict[str, tuple[AxisLine, AxisLine]]:
    """Every rotary axis: its line by design and by the parameters' values."""
    axes = subject.machine.axes
    real = _lines(subject, ca.SX(ca.DM(list(subject.values))))
    lines = {name: np.array(ca.evalf(line).full()[:, 0], dtype=np.float64) for name, line in real.items()}
    return {
        name: (
            AxisLine(name, np.asarray(axes[name].origin), np.asarray(axes[name].direction)),
            AxisLine(name, lines[name][:3], lines[name][3:]),
        )
        for name in subject.axes
        if name in lines
    }


def lines_by_parameters(subject: Subject, names: Sequence[str]) -> Array:
    """Derivatives of the points (mm) and directions of these axes (6 rows each) by the parameters in their own units."""
    p = ca.SX.sym("p", len(subject.parameters))
    lines = _lines(subject, p)
    slope = ca.jacobian(ca.vertcat(*(lines[name] for name in names)), p)
    return np.asarray(ca.Function("slope", [p], [ca.densify(slope)])(ca.DM(list(subject.values))).full())


def _lines(subject: Subject, p: Any) -> dict[str, Any]:
    """Point and direction (6) of every rotary axis."""
    machine = subject.machine
    row = subject.row(ca.SX.zeros(len(subject.axes)), p)
    found = {}
    for side in (tuple(reversed(machine.structure.workpiece)), machine.structure.tool):
        real = Pose.identity()
        for name in side:
            axis = machine.axes[name]
            pose = real @ axis_pose(axis, machine.structure.carries(name), row.axis[name], row.location, row.motion)
            if axis.rotary:
                found[name] = ca.vertcat(pose.apply(ca.DM(axis.origin)), pose.rotation @ ca.DM(axis.direction))
            real = pose
    return found
