"""Where the rotary axes of a machine lie, as designed and as identified: what the parameters of a control describe."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from symfive.codegen._subject import Subject
from symfive.errors import InputError
from symfive.kinematics import Pose, axis_pose

__all__ = ["AxisLine", "axis_lines", "table_axes"]

Array = NDArray[np.float64]


@dataclass(frozen=True)
class AxisLine:
    """A rotary axis in the machine frame with all axes at zero: a point on it (mm) and its unit direction."""

    axis: str
    point: Array
    direction: Array


def table_axes(subject: Subject, purpose: str) -> tuple[str, str]:
    """The two rotary axes under the workpiece, the carrying one first. Raises `InputError` for other structures."""
    machine = subject.machine
    rotary = [name for name in machine.axis_names if machine.axes[name].rotary]
    carrying = [name for name in reversed(machine.structure.workpiece) if name in rotary]
    if len(rotary) != 2 or carrying != rotary:
        raise InputError(
            f'{purpose} describe two rotary axes under the workpiece, and "{machine.structure.code}" has others',
            remedy="use the target c or linuxcnc, which hold every structure",
        )
    return carrying[0], carrying[1]


def axis_lines(subject: Subject) -> dict[str, tuple[AxisLine, AxisLine]]:
    """Every rotary axis: its line by design and by the parameters' values."""
    machine = subject.machine
    row = subject.row(ca.SX.zeros(len(subject.axes)), ca.SX(ca.DM(list(subject.values))))
    found = {}
    for side in (tuple(reversed(machine.structure.workpiece)), machine.structure.tool):
        real = Pose.identity()
        for name in side:
            axis = machine.axes[name]
            pose = real @ axis_pose(axis, machine.structure.carries(name), row.axis[name], row.location, row.motion)
            if axis.rotary:
                design = AxisLine(name, np.asarray(axis.origin), np.asarray(axis.direction))
                point = _numbers(pose.apply(ca.DM(axis.origin)))
                found[name] = design, AxisLine(name, point, _numbers(pose.rotation @ ca.DM(axis.direction)))
            real = pose
    return {name: found[name] for name in subject.axes if name in found}


def _numbers(expression: Any) -> Array:
    return np.array(ca.evalf(expression).full()[:, 0], dtype=np.float64)
