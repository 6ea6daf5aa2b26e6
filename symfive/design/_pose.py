"""One pose as symbols: balls, tool axis and bar in the workpiece frame, and where the linear axes follow the rotary ones."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import casadi as ca
import numpy as np

from symfive.errors import InputError
from symfive.kinematics import ball_in_workpiece, chain_poses
from symfive.machine import Machine
from symfive.procedures import Nominal

UNIT_MM = 100.0
"""mm in which a plan's lengths are decided, so that they are about as large as its angles."""
SAME_VOLUME = 1e-9


@dataclass(frozen=True)
class PoseGeometry:
    """Symbols of one row: positions (mm, rad) of the axes that are `turned` and of all; balls, tool axis and bar direction in the
    workpiece frame."""

    turned: dict[str, Any]
    position: dict[str, Any]
    table_ball: Any
    tool_ball: Any
    place: Any
    tool_axis: Any
    bar: Any
    length: Any


def pose_geometry(machine: Machine, rotary: Sequence[str], instrument: str, z: Any, k: Any) -> PoseGeometry:
    """The symbols of one row, `z` as in `SETUP_VARIABLES` behind the pose and `k` the length of a bar, mm."""
    radius, angle, height, tool = (z[z.numel() - 4 + i] for i in range(4))
    centre = ca.vertcat(*machine.table_centre, 0.0)
    table_ball = centre + UNIT_MM * ca.vertcat(radius * ca.cos(angle), radius * ca.sin(angle), height)
    tool_ball = ca.vertcat(0.0, 0.0, -UNIT_MM * tool)
    bar = ca.SX(3, 1)
    if instrument == "ball_bar":
        azimuth, elevation = z[len(rotary)], z[len(rotary) + 1]
        flat = ca.cos(elevation)
        bar = ca.vertcat(flat * ca.cos(azimuth), flat * ca.sin(azimuth), ca.sin(elevation))
    place = table_ball + k[0] * bar if instrument == "ball_bar" else table_ball
    turned = {name: z[i] for i, name in enumerate(rotary)}
    position = follow(machine, turned, tool_ball, place)
    workpiece, spindle = chain_poses(machine, position, {}, {})
    axis = workpiece.rotation.T @ spindle.rotation[:, 2]
    return PoseGeometry(turned, position, table_ball, tool_ball, place, axis, bar, k[0])


def follow(machine: Machine, position: dict[str, Any], tool_ball: Any, place: Any) -> dict[str, Any]:
    """Axis positions that bring the tool ball to `place` (workpiece frame): the ball is linear in the linear axes.

    Where there are more than three linear axes those that stand first from the bed follow and the others rest at home.
    """
    linear, moving, ball, vector = _followers(machine, position, tool_ball)
    rest = {n: machine.home(n) for i, n in enumerate(linear) if i not in moving}
    home = [ca.SX(0.0) if i in moving else ca.SX(rest[n]) for i, n in enumerate(linear)]
    start = ca.substitute([ball], [vector], [ca.vertcat(*home)])[0]
    solved = ca.inv_minor(ca.jacobian(ball, vector)[:, moving]) @ (place - start)
    found = {linear[i]: ca.simplify(solved[j]) for j, i in enumerate(moving)}
    return {name: position.get(name, found.get(name, ca.SX(rest.get(name, 0.0)))) for name in machine.axis_names}


def _followers(machine: Machine, position: dict[str, Any], tool_ball: Any) -> tuple[Sequence[str], list[int], Any, Any]:
    """The linear axes, which three of them follow, and the tool ball (workpiece frame) as a function of a vector of all of them.
    Raises `InputError` where no three span space."""
    linear = machine.linear_axes
    symbols = {name: ca.SX.sym(name) for name in linear}
    whole = {name: position.get(name, symbols.get(name)) for name in machine.axis_names}
    ball = ball_in_workpiece(machine, whole, tool_ball)
    vector = ca.vertcat(*symbols.values())
    moving = [linear.index(name) for name in Nominal(machine).following()]
    if len(moving) < 3:
        raise InputError("the linear axes do not span space", remedy="plans need three linear axes that do")
    return linear, moving, ball, vector


def spanned(machine: Machine, geometry: PoseGeometry) -> Any | None:
    """The volume that the directions of the linear axes that follow span, where that changes because a rotary axis turns one of
    them against the others; else None."""
    _, moving, ball, vector = _followers(machine, geometry.turned, geometry.tool_ball)
    q = ca.vertcat(*geometry.turned.values(), ca.SX(0, 1))
    volume = ca.fabs(ca.det(ca.jacobian(ball, vector)[:, moving]))
    at = ca.Function("volume", [q], [volume])
    places = (turn * np.arange(1.0, q.numel() + 1.0) for turn in (0.3, 0.7, 1.1))
    return volume if np.ptp([float(at(place)) for place in places]) > SAME_VOLUME else None
