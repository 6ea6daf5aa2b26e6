"""Gravity as the bodies of the chain see it when rotary axes tilt them."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import casadi as ca

from symfive.kinematics import axis_pose

if TYPE_CHECKING:
    from symfive.machine import Machine
    from symfive.row import Row

__all__ = ["DOWN", "carriers", "gravity_seen"]

DOWN = (0.0, 0.0, -1.0)
"""Direction of gravity in the machine frame where nothing else is said."""


def carriers(machine: Machine, axis: str) -> tuple[str, ...]:
    """The rotary axes that stand between the bed and `axis`, from the bed outward."""
    structure = machine.structure
    side = structure.tool if structure.carries(axis) == "tool" else tuple(reversed(structure.workpiece))
    return tuple(name for name in side[: side.index(axis)] if machine.axes[name].rotary)


def gravity_seen(row: Row, names: tuple[str, ...], down: tuple[float, float, float]) -> Any:
    """Gravity's unit vector (3) in the frame of the body that the rotary axes `names` carry, nominal geometry."""
    vector = ca.DM(down) / ca.norm_2(ca.DM(down))
    for name in names:
        pose = axis_pose(row.machine.axes[name], row.machine.structure.carries(name), row.axis[name], {}, {})
        vector = pose.rotation.T @ vector
    return vector
