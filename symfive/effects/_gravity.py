"""Gravity as the bodies of the chain see it when rotary axes tilt them."""

from __future__ import annotations

from typing import Any

import casadi as ca

from symfive.kinematics import axis_pose
from symfive.machine import Machine
from symfive.row import Row

DOWN = (0.0, 0.0, -1.0)
"""Direction of gravity in the machine frame where nothing else is said."""


def side_of(machine: Machine, axis: str) -> tuple[str, ...]:
    """The axes on the same side of the chain as `axis`, from the bed outward."""
    structure = machine.structure
    return structure.tool if structure.carries(axis) == "tool" else tuple(reversed(structure.workpiece))


def carriers(machine: Machine, axis: str) -> tuple[str, ...]:
    """The rotary axes that stand between the bed and `axis`, from the bed outward."""
    side = side_of(machine, axis)
    return tuple(name for name in side[: side.index(axis)] if machine.axes[name].rotary)


def later_axes(machine: Machine, axis: str) -> tuple[str, ...]:
    """The axes that `axis` carries, from the bed outward."""
    side = side_of(machine, axis)
    return tuple(side[side.index(axis) + 1 :])


def rotary_chain(machine: Machine, axis: str) -> tuple[str, ...]:
    """The rotary axes on the same side of the chain as `axis`, from the bed outward."""
    return tuple(name for name in side_of(machine, axis) if machine.axes[name].rotary)


def gravity_seen(row: Row, names: tuple[str, ...], down: tuple[float, float, float]) -> Any:
    """Gravity's unit vector (3) in the frame of the body that the rotary axes `names` carry, nominal geometry."""
    vector = ca.DM(down) / ca.norm_2(ca.DM(down))
    for name in names:
        pose = axis_pose(row.machine.axes[name], row.machine.structure.carries(name), row.axis[name], {}, {})
        vector = pose.rotation.T @ vector
    return vector
