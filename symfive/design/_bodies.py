"""What may not meet: table, post, bar, tool and spindle nose as simple bodies, in the workpiece frame.

    table   the half space z ≤ 0 of the workpiece frame; out of the nest, where the plane says nothing, a cylinder under it that
            is `TABLE_EDGE` mm wider than where a ball can stand, about the table's centre
    post    a cylinder from the table to `POST_TOP` mm below the table ball or nest
    ball    the table ball (half an inch); with the tool ball in its nest the tool does not count against it
    bar     a line from the table ball to the tool ball, kept off the post by its least elevation
    tool    a cylinder about the tool's axis from the tool ball to the spindle nose
    nose    a cylinder about the tool's axis that begins `above_ball` over the tool ball and is `NOSE_LENGTH` long

Radii of post and tool are 0 where the machine file does not say (`post_radius`, `tool_radius` in [workspace]). Each clearance is
in mm and ≥ 0 where the bodies keep apart. While a plan is sought the post's end is a half ball inside it, tested at `POST_POINTS`
points of its axis; along the ways of the plan the cylinders themselves are tested (`Clearances`).
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from symfive.campaign import Run
from symfive.kinematics import ball_in_workpiece, chain_poses
from symfive.machine import Machine, Workspace

__all__ = [
    "NOSE_LENGTH", "Clearances", "angle_clearance", "least_elevation", "nose_may_reach_post", "nose_over_table",
    "post_clearance",
]  # fmt: skip

Array = NDArray[np.float64]
NOSE_LENGTH = 300.0
"""mm of the spindle nose and housing above its lower end that are kept off everything."""
TABLE_EDGE = 50.0
POST_TOP = 15.0
POST_POINTS, PROJECTIONS, NEAR_MM = 17, 60, 6.0
"""Points of the post, projections by which the nearest ones are found, and below which distance they are sought."""
TOUCH_MM = 1e-2
BALL_RADIUS = 6.35
LEAST_ELEVATION = -45.0
"""Degree: a bar may lean below the table ball this far before it meets the cup (ISO 230-4 magnetic cups)."""
SMOOTH = 1e-6


def least_elevation(workspace: Workspace) -> float:
    """How far a bar may lean below the table ball, degree (negative), before it meets the cup or the rim of the post's top."""
    radius = workspace.post_radius or 0.0
    return max(LEAST_ELEVATION, -math.degrees(math.atan2(POST_TOP, radius)))


def nose_over_table(workspace: Workspace, place: Any, axis: Any) -> list[Any]:
    """Height of the lowest point of either end of the nose over the table; `place` of the tool ball, `axis` of the tool."""
    radius, above = _nose(workspace)
    reach = radius * ca.sqrt(1.0 - axis[2] ** 2 + SMOOTH)
    return [place[2] + height * axis[2] - reach for height in (above, above + NOSE_LENGTH)]


def angle_clearance(workspace: Workspace, axis: Any, direction: Any, length: Any, thick: float = 0.0) -> Any:
    """Of the nose and a rod of some length and radius that begins at the tool ball and points along `direction`.

    The rod passes under the nose where it is too short or too far from the tool's axis: given as a difference of cosines.
    """
    radius, above = _nose(workspace)
    return ca.fmax(above / length, above / math.hypot(above, radius + thick)) - ca.dot(direction, axis)


def nose_may_reach_post(workspace: Workspace) -> bool:
    """Whether a tool that begins on the post's top could bring the nose to the post before its other end meets the table."""
    radius, above = _nose(workspace)
    steepest = above / math.hypot(above, radius + (workspace.post_radius or 0.0)) if above > 0.0 else 0.0
    highest = max(workspace.ball_height or (0.0, 150.0))
    return highest > (above + NOSE_LENGTH) * steepest


def post_clearance(workspace: Workspace, table_ball: Any, place: Any, axis: Any) -> Any:
    """Distance of tool and nose from the post under the table ball."""
    nearest: Any = math.inf
    for share in np.linspace(0.0, 1.0, POST_POINTS):
        nearest = ca.fmin(nearest, _at_post(workspace, table_ball, place, axis, share))
    return nearest


def _at_post(workspace: Workspace, table_ball: Any, place: Any, axis: Any, share: Any) -> Any:
    """Distance of tool and nose from the post at one point of its axis, `share` of the way down."""
    radius, above = _nose(workspace)
    tool, post = workspace.tool_radius or 0.0, workspace.post_radius or 0.0
    height = (1.0 - share) * ca.fmax(table_ball[2] - POST_TOP - post, 0.0)
    offset = ca.vertcat(table_ball[0], table_ball[1], height) - place
    along = ca.dot(offset, axis)
    away = ca.sqrt(ca.sumsqr(offset - along * axis) + SMOOTH)
    nose = _outside(away - radius, ca.fabs(along - above - NOSE_LENGTH / 2.0) - NOSE_LENGTH / 2.0)
    stem = _outside(away - tool, ca.fabs(along - above / 2.0) - above / 2.0)
    return ca.fmin(nose, stem) - post


def off_the_table(machine: Machine, point: Any, radius: float) -> Any:
    """Distance of a sphere from the table as a cylinder of unknown depth."""
    wide = (machine.workspace.table_radius or math.inf) + TABLE_EDGE
    if math.isinf(wide):
        return point[2] - radius
    x, y = machine.table_centre
    away = ca.sqrt((point[0] - x) ** 2 + (point[1] - y) ** 2 + SMOOTH)
    return _outside(away - wide, point[2]) - radius


def _table_ball(workspace: Workspace, table_ball: Any, place: Any, axis: Any) -> list[Any]:
    """Distances of the nose and, with the tool ball out of its nest, of the tool from the table ball."""
    radius, above = _nose(workspace)
    tool = workspace.tool_radius or 0.0
    offset = table_ball - place
    along = ca.dot(offset, axis)
    away = ca.sqrt(ca.sumsqr(offset - along * axis) + SMOOTH)
    nose = _outside(away - radius, ca.fabs(along - above - NOSE_LENGTH / 2.0) - NOSE_LENGTH / 2.0)
    stem = _outside(away - tool, ca.fabs(along - above / 2.0) - above / 2.0)
    out = ca.sumsqr(offset) > (2.0 * BALL_RADIUS) ** 2
    return [nose - BALL_RADIUS, ca.if_else(out, stem - BALL_RADIUS, above)]


def _nose_beside_table(machine: Machine, place: Any, axis: Any) -> Any:
    """The nose as spheres along its axis, so wide that they hold it, against the table as a cylinder."""
    radius, above = _nose(machine.workspace)
    heights, apart = np.linspace(above, above + NOSE_LENGTH, 16, retstep=True)
    nearest: Any = math.inf
    for height in heights:
        nearest = ca.fmin(nearest, off_the_table(machine, place + height * axis, math.hypot(radius, 0.5 * apart)))
    return nearest


def _outside(a: Any, b: Any) -> Any:
    """Distance to a cylinder from the distances to its mantle and to its ends' planes; negative inside."""
    return ca.sqrt(ca.fmax(a, 0.0) ** 2 + ca.fmax(b, 0.0) ** 2 + SMOOTH**2) + ca.fmin(ca.fmax(a, b), 0.0) - SMOOTH


def _nose(workspace: Workspace) -> tuple[float, float]:
    nose = workspace.spindle_nose or {}
    return float(nose.get("radius", 0.0)), float(nose.get("above_ball", 0.0))


class Clearances:
    """Clearances of a run's bodies at any position of the axes; `names` (m,) of the pairs."""

    def __init__(self, machine: Machine, run: Run) -> None:
        workspace, bar = machine.workspace, "ball_bar" in run.instrument
        q: Any = ca.SX.sym("q", len(machine.axis_names))
        position = {name: machine.axes[name].to_internal * q[i] for i, name in enumerate(machine.axis_names)}
        place = ball_in_workpiece(machine, position, ca.DM(run.tool_ball))
        workpiece, spindle = chain_poses(machine, position, {}, {})
        axis = workpiece.rotation.T @ spindle.rotation[:, 2]
        table_ball = ca.DM(run.table_ball)
        found, names = [off_the_table(machine, place, 0.0)], ["tool ball and table"]
        if workspace.spindle_nose is not None:
            over = ca.mmin(ca.vertcat(*nose_over_table(workspace, place, axis)))
            found += [ca.fmax(over, _nose_beside_table(machine, place, axis))]
            found += [ca.SX(0.0)]
            names += ["spindle nose and table", "tool and post"]
            if bar:
                length = ca.norm_2(table_ball - place)
                found.append(angle_clearance(workspace, axis, (table_ball - place) / length, length) * length)
                found.append(place[2] - table_ball[2] - math.sin(math.radians(least_elevation(workspace))) * length)
                names += ["spindle nose and bar", "bar and post"]
            found += _table_ball(workspace, table_ball, place, axis)
            names += ["spindle nose and table ball", "tool and table ball"]
        for i, name in enumerate(machine.axis_names):
            low, high = machine.axes[name].travel
            found += [q[i] - low, high - q[i]]
            names += [f"travel of {name}"] * 2
        self.machine, self.names = machine, tuple(names)
        self._function: Any = ca.Function("clearances", [q], [ca.vertcat(*found)])
        self._place: Any = ca.Function("place", [q], [place])
        self._axis: Any = ca.Function("axis", [q], [axis])
        x, y, z = run.table_ball
        self._post = np.array([x, y, 0.0]), max(z - POST_TOP, 0.0), workspace.post_radius or 0.0

    def __call__(self, commands: Array, *, bar: bool = True) -> Array:
        """(N, m) at commands (N, axes) in mm and degree; without its bar a ball bar's nose meets none."""
        values = np.asarray(self._function.map(len(commands))(commands.T)).T.copy()
        if "tool and post" in self.names:
            values[:, self.names.index("tool and post")] = self._nearest_post(commands)
        if not bar:
            values[:, [name in ("spindle nose and bar", "bar and post") for name in self.names]] = np.inf
        return values

    def _nearest_post(self, commands: Array) -> Array:
        """Distance (N,) of tool and nose from the post."""
        radius, above = _nose(self.machine.workspace)
        place = self.places(commands)
        axis = np.asarray(self._axis.map(len(commands))(commands.T)).T
        stem = _Rod(place, axis, above, self.machine.workspace.tool_radius or 0.0)
        nose = _Rod(place + above * axis, axis, NOSE_LENGTH, radius)
        foot, height, thick = self._post
        up = np.broadcast_to([0.0, 0.0, 1.0], place.shape)
        post = _Rod(np.broadcast_to(foot, place.shape), up, height, thick)
        return np.minimum(_apart(stem, post), _apart(nose, post))

    def places(self, commands: Array) -> Array:
        """The tool ball in the workpiece frame (N, 3)."""
        return np.asarray(self._place.map(len(commands))(commands.T)).T


@dataclass(frozen=True)
class _Rod:
    """Cylinders with flat ends: `start` (N, 3) of their axes, unit vectors `axis` (N, 3), one length and one radius."""

    start: Array
    axis: Array
    length: float
    radius: float

    def at(self, rows: NDArray[Any]) -> _Rod:
        return _Rod(self.start[rows], self.axis[rows], self.length, self.radius)

    def nearest(self, points: Array) -> Array:
        """The nearest points (N, 3) of the cylinders."""
        offset = points - self.start
        along = np.sum(offset * self.axis, axis=1, keepdims=True)
        aside = offset - along * self.axis
        far = np.linalg.norm(aside, axis=1, keepdims=True)
        aside = aside * np.minimum(1.0, self.radius / np.maximum(far, 1e-12))
        return np.asarray(self.start + np.clip(along, 0.0, self.length) * self.axis + aside)


def _apart(rod: _Rod, post: _Rod) -> Array:
    """Distance (N,) of two cylinders: nearest points of two convex bodies, found by projecting from one to the other in turn;
    negative where they meet. Beyond `NEAR_MM` a lower bound, from points of the post's axis."""
    shares = np.linspace(0.0, 1.0, 9)
    tries = [post.start + share * post.length * post.axis for share in shares]
    far = np.array([np.linalg.norm(rod.nearest(points) - points, axis=1) for points in tries])
    best = np.argmin(far, axis=0)
    found = far[best, np.arange(len(best))] - post.length / 16.0 - post.radius
    near = np.flatnonzero(found < NEAR_MM)
    a, b = rod.at(near), post.at(near)
    there = np.asarray(tries)[best[near], near]
    for _ in range(PROJECTIONS if near.size else 0):
        here = a.nearest(there)
        there = b.nearest(here)
    distance = np.linalg.norm(a.nearest(there) - there, axis=1)
    found[near] = np.where(distance < TOUCH_MM, np.minimum(found[near], -TOUCH_MM), distance)
    return np.asarray(found)
