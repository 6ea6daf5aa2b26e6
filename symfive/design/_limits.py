"""What keeps a pose of a static plan clear: travel, a way out of the nest, and the distances of table, post, bar, tool, nose."""

from __future__ import annotations

import math
from typing import Any

import casadi as ca

from symfive.arrays import Array
from symfive.design._pose import SAME_VOLUME, UNIT_MM, PoseGeometry, follow, spanned
from symfive.kinematics import ball_in_workpiece, chain_poses
from symfive.machine import Machine
from symfive.moves import (
    BALL_RADIUS,
    RAPID_MM,
    SMOOTH,
    angle_clearance,
    least_retract,
    least_upright,
    nose_may_reach_post,
    nose_over_table,
    off_obstacles,
    out_of_nest_clearance,
    post_clearance,
)
from symfive.nc import at_the_top, touch_reach

LEAST_VOLUME = 0.1
"""Where a rotary axis turns linear axes against each other: they keep at least so far from lying in one plane (a sine, 6°);
nearer, any of many positions of the axes would do for a pose."""
PARALLEL = "linear axes in one plane"
TO_POST, DRAWN_BACK = "tool and post", "travel to draw the tool back"
KINKED = (TO_POST, DRAWN_BACK)
"""The limits that are no sum of places: a distance of two bodies, whose derivatives are nine tenths of all limits', and the
better of two directions."""
MOST_PROBE_TILT_DEG = 50.0
"""Between the probe and the sphere's post, so that a touch square to the probe is at least 40° off the post; less where the tip
would meet a thick post there."""


def _around_sphere(machine: Machine, geometry: PoseGeometry) -> dict[str, Any]:
    """What each linear axis needs at most, mm, while the tip goes around the sphere of a pose."""
    place = ca.SX.sym("place", 3)
    moved = follow(machine, geometry.turned, geometry.tool_ball, place)
    return {name: touch_reach(machine) * ca.norm_2(ca.jacobian(moved[name], place)) for name in machine.linear_axes}


def _left_to_draw_back(machine: Machine, geometry: PoseGeometry, mm: float) -> Any:
    """mm of travel that the linear axes have left with the tool drawn back by the least retract from a pose in the direction of
    `symfive.nc.lifts` that leaves most and does not lead down: without it there is no way out of a nest."""
    place = ca.SX.sym("place", 3)
    moved = follow(machine, geometry.turned, geometry.tool_ball, place)
    by_place = {name: ca.jacobian(moved[name], place) for name in machine.linear_axes}
    workpiece, _ = chain_poses(machine, geometry.position, {}, {})
    along, up = geometry.tool_axis, ca.DM([0.0, 0.0, 1.0])
    between = (along + up) / ca.sqrt(ca.sumsqr(along + up) + SMOOTH)

    def left(way: Any) -> Any:
        drawn = mm * way
        least = drawn[2]
        for name in machine.linear_axes:
            (low, high), at = machine.reach(name), geometry.position[name] + by_place[name] @ drawn
            least = ca.fmin(least, ca.fmin(at - low, high - at))
        return least

    return ca.fmax(ca.fmax(left(up), left(along)), ca.fmax(left(workpiece.rotation.T @ up), left(between)))


def limits_of(machine: Machine, instrument: str, geometry: PoseGeometry, most: Array) -> tuple[Any, tuple[str, ...]]:
    """What must be ≥ 0, in units of 100 mm (the bar's angle: its cosine), and what each means; `most` mm of ball height and tool
    length (2,)."""
    limits, names = [], []
    margins = _around_sphere(machine, geometry) if instrument == "touch_probe" else {}
    for name in machine.linear_axes:
        (low, high), at, margin = machine.reach(name), geometry.position[name], margins.get(name, 0.0)
        limits += [(at - low - margin) / UNIT_MM, (high - at - margin) / UNIT_MM]
        names += [f"travel of {name}"] * 2
    if instrument != "ball_bar":  # which leaves sideways, too
        least = least_retract(machine.workspace, probe=instrument == "touch_probe")
        limits.append(_left_to_draw_back(machine, geometry, least) / UNIT_MM)
        names.append(DRAWN_BACK)
    volume = spanned(machine, geometry)
    if volume is not None:
        limits.append(volume - LEAST_VOLUME)
        names.append(PARALLEL)
    workspace, place, axis = machine.workspace, geometry.place, geometry.tool_axis
    if workspace.spindle_nose is not None:
        limits += [(height - workspace.clearance) / UNIT_MM for height in nose_over_table(workspace, place, axis)]
        names += ["spindle nose and table"] * 2
        if instrument == "ball_bar":
            thick = workspace.bar_radius or 0.0
            limits.append(angle_clearance(workspace, axis, -geometry.bar, geometry.length, thick, BALL_RADIUS))
            gap = post_clearance(workspace, geometry.table_ball, place, axis)
            limits.append((gap - workspace.clearance) / UNIT_MM)
            names += ["spindle nose and bar", TO_POST]
        elif nose_may_reach_post(workspace):
            down = ca.DM([0.0, 0.0, -1.0])
            limits.append(angle_clearance(workspace, axis, down, place[2], workspace.post_radius or 0.0))
            names.append("spindle nose and post")
    if instrument == "r_test" and workspace.nest_opening is not None:
        limits.append(axis[2] - math.cos(math.radians(workspace.nest_opening)))
        names.append("tool and nest")
    if instrument == "touch_probe":  # the touches at the equator stay off the sphere's post
        limits.append(axis[2] - max(math.cos(math.radians(MOST_PROBE_TILT_DEG)), least_upright(workspace)))
        names.append("touch and post")
    if instrument == "ball_bar":
        limits.append((geometry.place[2] - BALL_RADIUS - workspace.clearance) / UNIT_MM)
        names.append("tool ball and table")
    for name, gap in off_obstacles(workspace, geometry.table_ball, instrument == "touch_probe").items():
        limits.append(gap / UNIT_MM)
        names.append(f"ball and obstacle {name}")
    gap, least = _out_of_nest(machine, geometry, instrument == "touch_probe", most)
    if least < 0.0:
        limits.append(gap / UNIT_MM)
        names.append("tool over the workpiece's origin")
    return ca.vertcat(*limits), tuple(names)


def _out_of_nest(machine: Machine, geometry: PoseGeometry, probe: bool, most: Array) -> tuple[Any, float]:
    """Clearance (mm) of the tool where every way out of the nest leads: the upright axis at its top, all others at home; and at
    least how large it is with a height of the ball and a tool length of at most so many (2,) mm: above all balls it has no part
    lower than its own ball where it stands upright."""
    end = at_the_top(machine, {name: machine.home(name) for name in machine.axes})
    position = {name: ca.SX(machine.axes[name].to_internal * value) for name, value in end.items()}
    workpiece, spindle = chain_poses(machine, position, {}, {})
    axis = workpiece.rotation.T @ spindle.rotation[:, 2]
    workspace = machine.workspace

    (height, tool), least = most, -math.inf
    place = ca.evalf(ball_in_workpiece(machine, position, ca.DM([0.0, 0.0, -tool])))
    upright = float(ca.evalf(axis)[2]) > 1.0 - SAME_VOLUME
    off = math.dist(place.full().ravel()[:2], machine.table_centre)
    above_table = upright and off <= (workspace.table_radius or math.inf)

    def gap(table_ball: Any, tool_ball: Any) -> Any:
        place = ball_in_workpiece(machine, position, tool_ball)
        free = out_of_nest_clearance(workspace, table_ball, place, axis, probe)
        return ca.fmin(free, place[2] - BALL_RADIUS - RAPID_MM) if above_table else free

    if upright and float(place[2]) > height:
        least = float(ca.evalf(gap(ca.vertcat(place[0], place[1], height), ca.DM([0.0, 0.0, -tool]))))
    return gap(geometry.table_ball, geometry.tool_ball), least
