"""Clearances of a run's bodies at any position of the axes, each a distance of convex bodies from below."""

from __future__ import annotations

import itertools
import math
from typing import Any

import casadi as ca
import numpy as np

from symfive.arrays import Array
from symfive.campaign import Run
from symfive.compiled import Mapped
from symfive.instruments import has_bar, has_post
from symfive.kinematics import ball_in_workpiece, chain_poses
from symfive.machine import Machine
from symfive.moves._bodies import (
    BALL_RADIUS,
    KEPT_OFF,
    NOSE_LENGTH,
    POST_TOP,
    TABLE_EDGE,
    least_elevation,
    post_under_sphere,
)
from symfive.moves._distance import Box, Rod, apart

TABLE_DEPTH = 2000.0
"""mm of the table as a body: nobody says what is under it."""
ON_THE_BAR = ("spindle nose and bar", "bar and post", "bar and table", "bar and cup")
"""Pairs that exist only while the bar is on."""
NEST, OBSTACLE = "tool and nest", "obstacle"
NEAR = (*ON_THE_BAR[1:], "tool and table ball", "tip and post", NEST)
"""Pairs that come near while the instrument reads."""


class Clearances:
    """Clearances of a run's bodies at any position of the axes; `names` (m,) of the pairs; `reach` mm from the tool ball to the
    farthest point of what moves with the tool."""

    def __init__(self, machine: Machine, run: Run) -> None:
        q: Any = ca.SX.sym("q", len(machine.axis_names))
        position = {name: machine.axes[name].to_internal * q[i] for i, name in enumerate(machine.axis_names)}
        workpiece, spindle = chain_poses(machine, position, {}, {})
        place = ball_in_workpiece(machine, position, ca.DM(run.tool_ball))
        axis = workpiece.rotation.T @ spindle.rotation[:, 2]
        self._frame = Mapped(ca.Function("frame", [q], [ca.densify(place), ca.densify(axis)]))
        self.machine, self.table_ball = machine, np.asarray(run.table_ball, dtype=float)
        self.bar, self.stands = has_bar(run), has_post(run)
        workspace = machine.workspace
        self.probe = "touch_probe" in run.instrument
        self.end = "tip" if self.probe else "tool ball" if self.bar else ""
        self.sphere, self.tip = BALL_RADIUS, BALL_RADIUS
        self.stem, self.post = workspace.tool_radius or 0.0, workspace.post_radius or 0.0
        self.under = POST_TOP
        if self.probe:  # the stem of a stylus is no thicker than its tip
            self.sphere, self.tip = workspace.sphere_radius, workspace.tip_radius
            self.stem = min(self.stem, self.tip)
            self.under = post_under_sphere(workspace)
        nose = workspace.spindle_nose
        self.nose = None if nose is None else float(nose["radius"])
        self.above = float(nose["above_ball"]) if nose is not None else -float(run.tool_ball[2])
        self.reach = math.hypot(self.above + NOSE_LENGTH, self.nose) if self.nose is not None else self.above
        self.obstacles = workspace.obstacles or {}
        self.opening = None
        if "r_test" in run.instrument and workspace.nest_opening is not None:
            self.opening = math.radians(workspace.nest_opening)
        self.names = self._names()

    def _names(self) -> tuple[str, ...]:
        bodies = ["tool"] if self.nose is None else ["tool", "spindle nose"]
        others = ["table", "post", "table ball"] if self.stands else ["table"]
        found = [f"{body} and {other}" for body in bodies for other in others]
        found += ON_THE_BAR[self.nose is None :] if self.bar else ()
        found += [f"{self.end} and post", f"{self.end} and table"] if self.end else ()
        bodies += [self.end or "tool ball", *(("bar",) if self.bar else ())]
        found += [f"{body} and {OBSTACLE} {name}" for name in self.obstacles for body in bodies]
        found += [NEST] if self.opening is not None else ()
        return (*found, *(f"travel of {name}" for name in self.machine.axis_names))

    def __call__(self, commands: Array, *, bar: bool = True, enough: float = math.inf) -> Array:
        """(N, m) at commands (N, axes) in mm and degree, infinite where a pair does not exist (without its bar a ball bar's nose
        meets none); those above `enough` only at least so large."""
        place, axis = self.frames(commands)
        workspace, count = self.machine.workspace, len(commands)
        stem = Rod(place, axis, np.full(count, self.above), self.stem)
        bodies = {"tool": stem}
        if self.nose is not None:
            bodies["spindle nose"] = Rod(place + self.above * axis, axis, np.full(count, NOSE_LENGTH), self.nose)
        x, y, z = self.table_ball
        post = self._upright(count, (x, y, 0.0), max(z - self.under, 0.0), self.post)
        ball = self._upright(count, (x, y, z), 0.0, 0.0)
        pairs: dict[str, tuple[Rod, Rod]] = {}
        for name, body in bodies.items():
            pairs |= {f"{name} and post": (body, post), f"{name} and table ball": (body, ball)}
        if self.end:
            bodies[self.end] = Rod(place, axis, np.zeros(count))
            pairs[f"{self.end} and post"] = bodies[self.end], post
        way = place - self.table_ball
        size = np.linalg.norm(way, axis=1)
        if self.bar and bar:
            rod = Rod(ball.start, way / np.maximum(size, 1e-9)[:, None], size, workspace.bar_radius or 0.0)
            bodies["bar"] = rod
            pairs["bar and post"] = rod, post
            if self.nose is not None:
                pairs["spindle nose and bar"] = bodies["spindle nose"], rod
        found = self._apart(pairs, bodies, enough) | self._off_obstacles(
            {self.end or "tool ball": Rod(place, axis, np.zeros(count)), **bodies}, enough
        )
        if not self.probe:  # in its nest
            found["tool and table ball"] = np.where(size > 2.0 * BALL_RADIUS, found["tool and table ball"], np.inf)
        if self.opening is not None:  # of the tool's upper end from the cone of the opening
            lean = np.arccos(np.clip(axis[:, 2], -1.0, 1.0))
            found[NEST] = np.where(size <= KEPT_OFF, self.above * np.sin(self.opening - lean), np.inf)
        if "bar" in bodies:
            least = math.sin(math.radians(least_elevation(workspace)))
            found["bar and cup"] = (way[:, 2] - least * size) / (
                1.0 - least
            )  # so that it changes no more than the ball moves
        for i, name in enumerate(self.machine.axis_names):
            low, high = self.machine.reach(name)
            found[f"travel of {name}"] = np.minimum(commands[:, i] - low, high - commands[:, i])
        nothing = np.full(count, np.inf)
        return np.stack([found.get(name, nothing) for name in self.names], axis=1)

    def frames(self, commands: Array) -> tuple[Array, Array]:
        """Tool ball and unit vector of the tool's axis in the workpiece frame, (N, 3) each."""
        place, axis = self._frame(commands)
        return place, axis

    def _apart(self, pairs: dict[str, tuple[Rod, Rod]], bodies: dict[str, Rod], enough: float) -> dict[str, Array]:
        """Distances (N,) of the pairs, and of the bodies from the table, a plane where nobody says how wide it is: one search for
        all."""
        radius, found = self.machine.workspace.table_radius, {}
        if radius is None:
            found = {f"{name} and table": body.lowest - self._round(name) for name, body in bodies.items()}
        else:
            foot = (*self.machine.table_centre, -TABLE_DEPTH)
            table = self._upright(len(bodies["tool"].start), foot, TABLE_DEPTH, radius + TABLE_EDGE)
            pairs = pairs | {f"{name} and table": (body, table) for name, body in bodies.items()}
        balls = np.array([[self._round(name)] for name in pairs])
        a, b = (Rod.joined(rods) for rods in zip(*pairs.values(), strict=True))
        far = np.broadcast_to(enough + balls, (len(pairs), len(bodies["tool"].start)))
        gaps = apart(a, b, far.ravel()).reshape(far.shape) - balls
        return found | dict(zip(pairs, gaps, strict=True))

    def _off_obstacles(self, bodies: dict[str, Rod], enough: float) -> dict[str, Array]:
        """Distances (N,) of the bodies from the boxes on the table."""
        pairs = list(itertools.product(self.obstacles, bodies))
        if not pairs:
            return {}
        count = len(bodies["tool"].start)
        low, high = (np.repeat([self.obstacles[name][end] for name, _ in pairs], count, axis=0) for end in (0, 1))
        balls = np.array([[self._round(body)] for _, body in pairs])
        far = np.broadcast_to(enough + balls, (len(pairs), count))
        gaps = (
            apart(Rod.joined([bodies[body] for _, body in pairs]), Box(low, high), far.ravel()).reshape(far.shape)
            - balls
        )
        return {f"{body} and {OBSTACLE} {name}": gap for (name, body), gap in zip(pairs, gaps, strict=True)}

    def _round(self, names: str) -> float:
        """Radius of the ball that is one of two bodies, whose centre alone is a rod."""
        if names.endswith("table ball"):
            return self.sphere
        return self.tip if names.startswith(self.end or "tool ball") else 0.0

    @staticmethod
    def _upright(count: int, foot: tuple[float, float, float], height: float, radius: float) -> Rod:
        up = np.broadcast_to([0.0, 0.0, 1.0], (count, 3))
        return Rod(np.broadcast_to(np.array(foot), (count, 3)), up, np.full(count, height), radius)
