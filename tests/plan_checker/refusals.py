"""Whether a machine that was refused could have been measured: poses drawn at random that can be reached and left."""

import numpy as np

from ._bodies import Cylinder, clearance
from ._path import NOSE_LENGTH, POST_TOP
from ._plan import Array, Machine

LIFT_MM = 50.0
DRAWN = 100


def share_with_a_way_out(machine: Machine) -> float:
    """Of random rotary positions with the ball in a nest at the table's edge, the share of those within the travel from which the
    ball goes 50 mm out along the tool and then to the top with nothing in the way; 0 where none is within the travel."""
    space, rng, (low, high) = machine.workspace, np.random.default_rng(0), machine.travel.T
    q = rng.uniform(low, high, (DRAWN, len(low))) * machine.rotary
    reached = left = 0
    for angle in np.linspace(0.0, 2.0 * np.pi, 5)[1:]:
        around = machine.table_centre + float(space["table_radius"]) * np.array([np.cos(angle), np.sin(angle)])
        for height in space["ball_height"]:
            nest, tool_ball = np.array([*around, height]), np.array([0.0, 0.0, -float(max(space["tool_length"]))])
            poses = machine.following(q, np.broadcast_to(nest, (DRAWN, 3)), tool_ball)
            poses = poses[((poses >= low) & (poses <= high)).all(axis=1)]
            reached += len(poses)
            left += int(_leaves(machine, poses, nest, tool_ball).sum()) if len(poses) else 0
    return left / max(reached, 1)


def _leaves(machine: Machine, poses: Array, nest: Array, tool_ball: Array) -> Array:
    """Whether each pose (n, axes) has that way out."""
    points = np.stack([tool_ball, tool_ball + np.array([0.0, 0.0, 1.0])])
    frame = machine.points(poses, points)
    lifted = machine.following(poses, frame[:, 0] + LIFT_MM * (frame[:, 1] - frame[:, 0]), tool_ball)
    up = lifted.copy()
    up[:, machine.tool_axis] = machine.top
    low, high = machine.travel.T
    clear = ((lifted >= low) & (lifted <= high)).all(axis=1)
    for start, end in ((poses, lifted), (lifted, up)):
        for share in np.linspace(0.0, 1.0, 6):
            clear &= _apart(machine, machine.points(start + share * (end - start), points), nest)
    return clear


def _apart(machine: Machine, frame: Array, nest: Array) -> Array:
    """Spindle nose and tool against the table's plane and what carries the nest."""
    space, n = machine.workspace, len(frame)
    ball, axis = frame[:, 0], frame[:, 1] - frame[:, 0]
    foot, upright = np.broadcast_to(nest * [1.0, 1.0, 0.0], (n, 3)), np.broadcast_to([0.0, 0.0, 1.0], (n, 3))
    post = Cylinder(foot, upright, np.full(n, max(nest[2] - POST_TOP, 0.0)), float(space.get("post_radius", 0.0)))
    nose = space.get("spindle_nose", {"radius": 0.0, "above_ball": 60.0})
    above = float(nose["above_ball"])
    stem = Cylinder(ball, axis, np.full(n, above), float(space.get("tool_radius", 0.0)))
    body = Cylinder(ball + above * axis, axis, np.full(n, NOSE_LENGTH), float(nose["radius"]))
    clear = np.ones(n, bool)
    for part in (stem, body):
        clear &= (part.lowest() > 0.0) & (clearance(part, post) >= 0.0)
    return clear
