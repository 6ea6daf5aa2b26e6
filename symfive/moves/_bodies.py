"""Collision bodies: table, post, bar, tool and spindle nose as simple bodies, in the workpiece frame.

    table   a cylinder under the plane z = 0 of the workpiece frame, `TABLE_EDGE` mm wider than where a ball can stand, about the
            table's centre; where nobody says how wide it is, everything under that plane
    post    a cylinder from the table to `POST_TOP` mm below the table ball or nest
    ball    the table ball (half an inch); with the tool ball in its nest the tool does not count against it
    nest    of an R-test: the tool does not leave the cone about its upright axis in which it is open (`nest_opening`); not tested
            where nobody says how wide that is
    bar     a cylinder from the table ball to the tool ball, kept off the cup by its least elevation
    obstacles   boxes on the table (`obstacles`); a ball, its post or nest stands beside them
    tool    a cylinder about the tool's axis from the tool ball to the spindle nose
    nose    a cylinder about the tool's axis that begins `above_ball` over the tool ball and is `NOSE_LENGTH` long

Radii of post, tool and bar are 0 where the machine file does not say (`post_radius`, `tool_radius`, `bar_radius`). Each
clearance is in mm and ≥ 0 where the bodies keep apart. While a plan is sought the clearances are the smooth functions of this
file: the table is its plane, the post's end a half ball inside it, tested at `POST_POINTS` points of its axis. Along the ways
of the plan the bodies themselves are tested (`Clearances`).
"""

from __future__ import annotations

import math
from typing import Any

import casadi as ca
import numpy as np

from symfive.machine import Workspace
from symfive.nc import Probing

NOSE_LENGTH = 300.0
"""mm of the spindle nose and housing above its lower end that are kept off everything."""
TABLE_EDGE = 50.0
POST_TOP = 15.0
POST_POINTS = 17
BALL_RADIUS = 6.35
KEPT_OFF, RAPID_MM = 15.0, 5.0
"""What the tool ball keeps off the nest and all bodies, a probe's tip and sphere among them, off each other on rapid moves, mm:
the operator's tool is a little longer or shorter than planned."""
LEAST_ELEVATION = -45.0
"""Degree: a bar may lean below the table ball this far before it meets the cup (ISO 230-4 magnetic cups)."""
SMOOTH = 1e-6


def least_elevation(workspace: Workspace) -> float:
    """How far a bar may lean below the table ball, degree (negative), before it meets the cup or the rim of the post's top."""
    post, bar = workspace.post_radius or 0.0, workspace.bar_radius or 0.0
    rim = math.atan2(post, POST_TOP) - math.acos(min(bar / math.hypot(post, POST_TOP), 1.0))
    return max(LEAST_ELEVATION, math.degrees(rim))


def post_under_sphere(workspace: Workspace) -> float:
    """How far under the centre of a touch probe's sphere its post ends, mm: in the sphere, or below it where it is thicker."""
    sphere, post = workspace.sphere_radius, workspace.post_radius or 0.0
    return math.sqrt(sphere**2 - post**2) if post < sphere else max(sphere, POST_TOP)


def least_upright(workspace: Workspace) -> float:
    """Cosine of the largest tilt at which a tip that touches the sphere's equator, and stands off it before, passes beside the
    post or above its end, and the end of the stem, no thicker than the tip, keeps the workspace's clearance off it."""
    tip, post = workspace.tip_radius, workspace.post_radius or 0.0
    touching = workspace.sphere_radius + tip
    stem = min(workspace.tool_radius or 0.0, tip)
    off = np.linspace(touching, touching + Probing.clearance, POST_POINTS)
    place, kept = np.append(off, touching - stem), np.append(np.full(POST_POINTS, tip), workspace.clearance)
    tilt = np.radians(np.arange(0.0, 90.0, 0.01))[:, None]
    beside, above = place * np.cos(tilt) - post, post_under_sphere(workspace) - place * np.sin(tilt)
    fits = np.all(np.hypot(np.maximum(beside, 0.0), np.maximum(above, 0.0)) >= kept, axis=1)
    return float(np.cos(tilt[max(int(fits.sum()) - 1, 0), 0]))


def nose_over_table(workspace: Workspace, place: Any, axis: Any) -> list[Any]:
    """Height of the lowest point of either end of the nose over the table; `place` of the tool ball, `axis` of the tool."""
    radius, above = _nose(workspace)
    reach = radius * ca.sqrt(1.0 - axis[2] ** 2 + SMOOTH)
    return [place[2] + height * axis[2] - reach for height in (above, above + NOSE_LENGTH)]


def angle_clearance(
    workspace: Workspace, axis: Any, direction: Any, length: Any, thick: float, end: float = 0.0
) -> Any:
    """Of the nose and a rod of some length and radius that begins at the tool ball and points along `direction`, with a ball of
    radius `end` at its other end; both are to keep the workspace's clearance.

    The rod passes under the nose where it is too short or too far from the tool's axis: given as a difference of cosines.
    Its mantle passes the rim of the nose, `rim` away, where its axis is turned away from it by asin(thick/rim).
    """
    radius, above = _nose(workspace)
    rim, kept = math.hypot(above, radius), workspace.clearance
    angle = math.atan2(radius, above) + math.asin(min((thick + kept) / rim, 1.0))
    return ca.fmax((above - end - kept) / length, math.cos(angle)) - ca.dot(direction, axis)


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


def off_obstacles(workspace: Workspace, table_ball: Any, probe: bool) -> dict[str, Any]:
    """How much further than it must the ball on the table, or its post, stands beside each obstacle, mm."""
    thick = max(workspace.sphere_radius if probe else BALL_RADIUS, workspace.post_radius or 0.0) + workspace.clearance
    found = {}
    for name, (low, high) in (workspace.obstacles or {}).items():
        x, y = (ca.fabs(table_ball[i] - 0.5 * (low[i] + high[i])) - 0.5 * (high[i] - low[i]) for i in (0, 1))
        found[name] = _outside(x, y) - thick
    return found


def kept_off_nest(workspace: Workspace, probe: bool) -> float:
    """mm that the tool ball keeps off the nest, or a probe's tip off the centre of its sphere, on ways out of it."""
    return workspace.sphere_radius + workspace.tip_radius + RAPID_MM if probe else KEPT_OFF


def out_of_nest_clearance(workspace: Workspace, table_ball: Any, place: Any, axis: Any, probe: bool) -> Any:
    """What tool ball, tool and nose are further off table ball and post than they must be out of the nest."""
    thick = max(workspace.sphere_radius if probe else BALL_RADIUS, workspace.post_radius or 0.0)
    gap = _of_tool_and_nose(workspace, table_ball - place, axis) - thick - RAPID_MM
    return ca.fmin(gap, ca.norm_2(table_ball - place) - kept_off_nest(workspace, probe))


def _at_post(workspace: Workspace, table_ball: Any, place: Any, axis: Any, share: Any) -> Any:
    """Distance of tool and nose from the post at one point of its axis, `share` of the way down."""
    post = workspace.post_radius or 0.0
    height = (1.0 - share) * ca.fmax(table_ball[2] - POST_TOP - post, 0.0)
    return _of_tool_and_nose(workspace, ca.vertcat(table_ball[0], table_ball[1], height) - place, axis) - post


def _of_tool_and_nose(workspace: Workspace, offset: Any, axis: Any) -> Any:
    """Distance of tool and nose from a point at an `offset` from the tool ball."""
    radius, above = _nose(workspace)
    tool = workspace.tool_radius or 0.0
    along = ca.dot(offset, axis)
    away = ca.sqrt(ca.sumsqr(offset - along * axis) + SMOOTH)
    nose = _outside(away - radius, ca.fabs(along - above - NOSE_LENGTH / 2.0) - NOSE_LENGTH / 2.0)
    stem = _outside(away - tool, ca.fabs(along - above / 2.0) - above / 2.0)
    return ca.fmin(nose, stem)


def _outside(a: Any, b: Any) -> Any:
    """Distance to a cylinder from the distances to its mantle and to its ends' planes; negative inside."""
    return ca.sqrt(ca.fmax(a, 0.0) ** 2 + ca.fmax(b, 0.0) ** 2 + SMOOTH**2) + ca.fmin(ca.fmax(a, b), 0.0) - SMOOTH


def _nose(workspace: Workspace) -> tuple[float, float]:
    nose = workspace.spindle_nose or {}
    return float(nose.get("radius", 0.0)), float(nose.get("above_ball", 0.0))
