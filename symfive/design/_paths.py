"""Circles as smooth functions of what is decided about them: commands, set-up and limits, symbolically.

Two families, each with the variables in the order given (mm, mm/min):

    synchronous  ratio X_T/r, radius, feed, height     a rotary and a linear axis together (`synchronous_circle`)
    planar       radius, feed, x, y, z of the centre   two linear axes (`planar_circle`)

A path is recorded at N rows; row i lies at the share i/(N - 1) of the recording, so that N stays the same while feed and
radius change, and the interval h between rows is a function of them.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from typing import Any

import casadi as ca
import numpy as np

from symfive.arrays import Array
from symfive.campaign import Run
from symfive.design._pose import follow
from symfive.errors import InputError
from symfive.machine import Machine
from symfive.procedures import (
    DIRECTIONS,
    DWELL_S,
    PLANES,
    Nominal,
    frame_within_travel,
    planar_circle,
    polar_angle,
    ramp_of,
    synchronous_circle,
    tool_ball_of,
)

FAMILIES = {"synchronous": ("ratio", "radius", "feed", "height"), "planar": ("radius", "feed", "x", "y", "z")}
RUN_UP_DEG = {"synchronous": 60.0, "planar": 180.0}
LIMIT_POINTS = 181
SLACK_MM = 1e-6
SMALLEST_GAP = 1e-3
"""How near X_T/r may come to 1, where the rotary axis would have to turn at F/|X_T - r|."""


@dataclass(frozen=True, kw_only=True)
class CircleShape:
    """Shape of a circle: `family`; `direction` ccw, cw or both; `plane` of a planar circle; and the `values` of the
    family's variables (mm, mm/min)."""

    family: str
    values: Mapping[str, float]
    direction: str = "both"
    plane: str = "XY"

    @property
    def vector(self) -> Array:
        """The values in the family's order."""
        return np.array([self.values[name] for name in FAMILIES[self.family]])

    def at(self, vector: Array) -> CircleShape:
        """The same circle with other values."""
        return replace(self, values=dict(zip(FAMILIES[self.family], map(float, vector), strict=True)))


def circle_runs(machine: Machine, shape: CircleShape, *, noise_um: float, rate_hz: float) -> tuple[Run, ...]:
    """The runs of a circle as the procedures make them. Raises `InputError` where an axis cannot follow or the table ball
    would stand beside the table."""
    v = shape.values
    if shape.family == "synchronous":
        runs = synchronous_circle(
            machine, x_t=v["ratio"] * v["radius"], radius=v["radius"], feed=v["feed"], height=v["height"],
            direction=shape.direction, rate_hz=rate_hz, noise_um=noise_um,
        )  # fmt: skip
    else:
        runs = planar_circle(
            machine, plane=shape.plane, radius=v["radius"], feed=v["feed"],
            centre=(v["x"], v["y"], v["z"]), direction=shape.direction, sweep_deg=360.0, rate_hz=rate_hz, noise_um=noise_um,
        )  # fmt: skip
    for run in runs:
        _check_on_table(machine, run)
    return runs


def _check_on_table(machine: Machine, run: Run) -> None:
    edge, (x, y, _), centre = machine.workspace.table_radius, run.table_ball, machine.table_centre
    if edge is not None and math.dist((x, y), centre) > edge + SLACK_MM:
        problem = f"run {run.id}: the table ball at x = {x:.5g}, y = {y:.5g} mm would be beside the table"
        about = f"table_radius = {edge:g} mm about ({centre[0]:g}, {centre[1]:g})"
        remedy = f"keep it within {about}: smaller ratio X_T/r, shorter bar or other centre"
        raise InputError(problem, remedy=remedy)


@dataclass(frozen=True)
class CirclePath:
    """A circle's path in symbols.

    `rows` maps (variables v, share) to the commands of all axes (mm, rad) and their derivatives in the variables `free`
    (indices), column by column; `setting` maps v to (table ball 3, length, duration s) and its derivatives; `limits` maps
    v to what must be ≥ 0: at every point of the path the limits of these `limit_names`.
    """

    free: tuple[int, ...]
    rows: Any
    setting: Any
    limits: Any
    limit_names: tuple[str, ...]

    def at(self, values: Array, count: int) -> tuple[Array, Array]:
        """Commands (N, axes) and their derivatives (N, axes, nv) at N rows."""
        shares = np.arange(count) / (count - 1.0)
        commands, slopes = self.rows.map(count)(np.repeat(values[:, None], count, axis=1), shares[None, :])
        axes = self.rows.size1_out(0)
        slopes = np.asarray(slopes).reshape(axes, count, len(self.free)).transpose(1, 0, 2)
        return np.asarray(commands).T.copy(), slopes

    def setup(self, values: Array) -> tuple[Array, Array]:
        """(table ball, length, duration) (5,) and derivatives (5, nv)."""
        value, slopes = self.setting(values)
        return np.asarray(value).ravel(), np.asarray(slopes)


def make_path(machine: Machine, circle: CircleShape, direction: str, free: Iterable[str] | None = None) -> CirclePath:
    """The path of a circle in one direction, with derivatives in the variables `free` (default: all).

    Raises `InputError` where it is not a smooth function of its variables (X_T = r).
    """
    names = FAMILIES[circle.family]
    chosen = [i for i, name in enumerate(names) if free is None or name in free]
    v: Any = ca.SX.sym("v", len(names))
    share, part = ca.SX.sym("share"), ca.SX.sym("part")
    by_name = {name: v[i] for i, name in enumerate(names)}
    run_up = math.radians(RUN_UP_DEG[circle.family])
    reach = 2.0 * math.pi + 2.0 * run_up
    speed = by_name["feed"] / 60.0 / by_name["radius"]
    planar = circle.family == "planar"
    ramp = ramp_of(machine, speed, by_name["radius"], run_up) if planar else run_up
    end = reach + 2.0 * ramp  # the angle that the full speed would cover in the same time
    duration = end / speed
    way = _way(end * part, ramp, reach, end)
    phi = -run_up + way if DIRECTIONS[direction] > 0 else reach - run_up - way
    place = _synchronous if circle.family == "synchronous" else _planar
    commands, ball = place(machine, circle, by_name, phi)
    at_share = ca.fmin(share * (duration + DWELL_S) / duration, 1.0)
    in_rows = ca.substitute([commands], [part], [at_share])[0]
    setting = ca.vertcat(ball, by_name["radius"], duration + DWELL_S)
    rows = ca.Function(
        "rows", [v, share], [ca.densify(in_rows), ca.densify(ca.jacobian(in_rows, v[chosen]))], {"cse": True}
    )  # fmt: skip
    at = ca.Function("setting", [v], [ca.densify(setting), ca.densify(ca.jacobian(setting, v[chosen]))])
    limit_names, bounded = zip(*_limits(machine, commands, ball, part, speed / end), strict=True)
    limits = ca.Function("limits", [v, part], [ca.vertcat(*bounded)], {"cse": True})
    points = np.linspace(0.0, 1.0, LIMIT_POINTS)
    vector = ca.MX.sym("v", len(names))
    every = limits.map(LIMIT_POINTS)(ca.repmat(vector, 1, LIMIT_POINTS), points[None, :])
    return CirclePath(tuple(chosen), rows, at, ca.Function("all_limits", [vector], [ca.vec(every)]), limit_names)


def _way(angle: Any, run_up: Any, reach: float, end: Any) -> Any:
    """`procedures._path.along` in symbols: the way after `angle` = speed · time."""

    def from_rest(a: Any) -> Any:
        x = ca.fmin(ca.fmax(a / (2.0 * run_up), 0.0), 1.0)
        return 2.0 * run_up * (x**3 - x**4 / 2.0) + ca.fmax(a - 2.0 * run_up, 0.0)

    return ca.if_else(angle < end / 2.0, from_rest(angle), reach - from_rest(ca.fmax(end - angle, 0.0)))


def _synchronous(machine: Machine, circle: CircleShape, v: Mapping[str, Any], phi: Any) -> tuple[Any, Any]:
    ratio, radius = v["ratio"], v["radius"]
    start = circle.values["ratio"]
    run_up = math.radians(RUN_UP_DEG["synchronous"])
    angles = polar_angle(np.linspace(-run_up, 2.0 * math.pi + run_up, LIMIT_POINTS), start, 1.0)
    frame, turned = frame_within_travel(machine, angles)
    if abs(start - 1.0) < SMALLEST_GAP or start < 0.0:
        raise InputError(f"X_T/r = {start:g} is not refined", remedy="use a ratio of at least 0 that is not 1")
    if start > 1.0:
        theta = ca.atan2(ca.sin(phi), ratio + ca.cos(phi))
    else:
        theta = phi - ca.atan2(ratio * ca.sin(phi), 1.0 + ratio * ca.cos(phi))
    u, across, n = (ca.DM(part) for part in (frame.u, frame.v, frame.n))
    foot = ca.DM(frame.middle) + (v["height"] - float(frame.middle @ frame.n)) * n
    target = foot + radius * ((ratio + ca.cos(phi)) * u + ca.sin(phi) * across)
    return _commands(machine, {frame.rotary: theta + math.radians(turned)}, target), foot + ratio * radius * u


def _planar(machine: Machine, circle: CircleShape, v: Mapping[str, Any], phi: Any) -> tuple[Any, Any]:
    nominal = Nominal(machine)
    at_rest = nominal.commands({}, 1)
    u, across = (ca.DM(nominal.seen_from_workpiece(at_rest, np.eye(3)[i])[0]) for i in PLANES[circle.plane])
    centre = ca.vertcat(v["x"], v["y"], v["z"])
    target = centre + v["radius"] * (ca.cos(phi) * u + ca.sin(phi) * across)
    return _commands(machine, {}, target), centre


def _commands(machine: Machine, turning: Mapping[str, Any], target: Any) -> Any:
    """Commands of all axes (mm, rad): rotary ones as given or at home, the linear ones follow."""
    rotary = {
        name: turning.get(name, ca.SX(machine.home(name) * axis.to_internal))
        for name, axis in machine.axes.items()
        if axis.rotary
    }
    position = follow(machine, rotary, ca.DM(tool_ball_of(machine, None)), target)
    return ca.vertcat(*(position[name] for name in machine.axis_names))


def _limits(machine: Machine, commands: Any, ball: Any, part: Any, rate: Any) -> list[tuple[str, Any]]:
    """Name and what is left, as a share of it, of every limit at one point of the path: travel, feed and acceleration of each
    axis, the edge of the table; `rate` of `part`."""
    pace = ca.jacobian(commands, part) * rate
    push = ca.jacobian(pace, part) * rate
    found = []
    for i, name in enumerate(machine.axis_names):
        axis = machine.axes[name]
        if commands[i].is_constant():
            continue  # it stands still whatever the circle
        low, high = (value * axis.to_internal for value in machine.reach(name))
        travel = (commands[i] - low) / (high - low), (high - commands[i]) / (high - low)
        found += [(f"the travel of {name}", left) for left in travel]
        if axis.max_feed is not None:
            used = pace[i] / (axis.max_feed * axis.to_internal / 60.0)
            found.append((f"the feed of {name}", 1.0 - used**2))
        if axis.max_acceleration is not None:
            used = push[i] / (axis.max_acceleration * axis.to_internal)
            found.append((f"the acceleration of {name}", 1.0 - used**2))
    radius, (x, y) = machine.workspace.table_radius, machine.table_centre
    if radius is not None:
        found.append(("the edge of the table", 1.0 - ((ball[0] - x) ** 2 + (ball[1] - y) ** 2) / radius**2))
    return found


def limits_met(machine: Machine, circle: CircleShape, share: float) -> list[str]:
    """Limits of which less than `share` is left along a circle, in words. Raises `InputError` as `make_path`."""
    path = make_path(machine, circle, "cw" if circle.direction == "cw" else "ccw", ())
    left = np.asarray(path.limits(circle.vector)).reshape(LIMIT_POINTS, -1).min(axis=0)
    return list(dict.fromkeys(name for name, some in zip(path.limit_names, left, strict=True) if some < share))
