"""What a static plan may decide, with its limits: rotary poses, bar direction, balls and nests, tool length.

The variables of one row, `z`, in this order (rad; lengths of the set-up in 100 mm):

    pose     every rotary axis; for a ball bar the bar's azimuth and elevation in the workpiece frame
    set-up   the table ball's distance from the table's centre, its polar angle and its height; the tool's length

The linear axes follow: they bring the tool ball onto the nest, or to the other end of the bar. A bar's length is a
constant `k` (mm) of its set-up, chosen from the list the user owns.

Collisions of table, post, bar, tool and spindle nose are kept out by the clearances of `_bodies`; the bar is kept off the
post by its least elevation.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import casadi as ca
import numpy as np

from symfive.arrays import Array, Flags
from symfive.campaign import Campaign, Run, SetupSigma
from symfive.compiled import Mapped
from symfive.errors import InputError
from symfive.kinematics import ball_in_workpiece, chain_poses
from symfive.machine import Machine
from symfive.model import Model, assemble
from symfive.motion import Position
from symfive.moves import (
    BALL_RADIUS,
    RETRACTS_MM,
    angle_clearance,
    least_elevation,
    least_upright,
    nose_may_reach_post,
    nose_over_table,
    out_of_nest_clearance,
    post_clearance,
)
from symfive.nc import at_the_top, top_of, touch_reach, upright_axis
from symfive.optimal import Kernel
from symfive.parameters import Parameter
from symfive.procedures import home

SETUP_VARIABLES = ("table_ball.radius", "table_ball.angle", "table_ball.height", "tool.length")
UNIT_MM = 100.0
DIGITS = 6
"""Digits behind the point to which positions are written, so that what is tested is what is driven."""
MOST_ELEVATION = 90.0
LEAST_VOLUME = 0.1
"""Where a rotary axis turns linear axes against each other: they keep at least so far from lying in one plane (a sine, 6°);
nearer, any of many positions of the axes would do for a pose."""
PARALLEL = "linear axes in one plane"
TO_POST, DRAWN_BACK = "tool and post", "travel to draw the tool back"
KINKED = (TO_POST, DRAWN_BACK)
"""The limits that are no sum of places: a distance of two bodies, whose derivatives are nine tenths of all limits', and the
better of two directions."""
SAME_VOLUME = 1e-9
SIGMAS_IN_RANGE = 3.0
MOST_PROBE_TILT_DEG = 50.0
"""Between the probe and the sphere's post, so that a touch square to the probe is at least 40° off the post; less where the tip
would meet a thick post there."""


@dataclass(frozen=True)
class Space:
    """One instrument on one machine: variables, bounds, kernel.

    `names` of the variables, `lower` and `upper` (nz,), `poses` how many belong to the pose; `shared` the machine's
    parameters, `own` the set-up errors of a run and `own_sigma` their prior 1σ in units of the noise (inf where a zero is
    wholly unknown stays finite as declared); `centre` J of the tool centre point, (3, shared), µm per prior 1σ; `options` of the
    instrument, as the `frame` of an R-test head.
    """

    machine: Machine
    instrument: str
    names: tuple[str, ...]
    lower: Array
    upper: Array
    poses: int
    lengths: tuple[float, ...]
    shared: tuple[Parameter, ...]
    own: tuple[str, ...]
    own_sigma: Array
    noise_um: float
    setup_sigma: SetupSigma
    kernel: Kernel
    centre: Mapped
    axes: Mapped
    limit_names: tuple[str, ...]
    options: Mapping[str, Any] = field(default_factory=dict)

    @cached_property
    def pose_kernel(self) -> Kernel:
        """The kernel with derivatives in the pose alone; its constants are the set-up's variables and `k`."""
        return self.kernel.of_first(self.poses)

    @property
    def smooth_limits(self) -> list[int]:
        """Numbers of the limits without kinks."""
        return [i for i, name in enumerate(self.limit_names) if name not in KINKED]

    @cached_property
    def smooth_kernel(self) -> Kernel:
        """The pose kernel with these limits alone."""
        return self.pose_kernel.limited_to(self.smooth_limits)

    def commands(self, z: Array, k: Array) -> dict[str, Array]:
        """Commands of every axis, mm and degree."""
        values = self.axes(z, k)[0]
        return {name: np.round(values[:, i], DIGITS) + 0.0 for i, name in enumerate(self.machine.axis_names)}

    def feasible(self, z: Array, k: Array, rows: Array | None = None) -> Flags:
        """Rows (n,) inside all limits, whose expected reading (3σ of the priors) stays within the sensor's range; `rows` their
        sensitivities where they are at hand."""
        inside = np.all((z >= self.lower - 1e-9) & (z <= self.upper + 1e-9), axis=1)
        inside &= np.all(self.kernel.limits(z, k) >= -1e-9, axis=1)
        return np.asarray(inside & self.in_range(z, k, rows))

    def in_range(self, z: Array, k: Array, rows: Array | None = None) -> Flags:
        """Whether 3σ of the priors keep the reading inside the sensor's range or the bar's stroke."""
        limit = self.machine.workspace.stroke(bar=self.instrument == "ball_bar")
        seen = (self.kernel.rows(z, k) if rows is None else rows)[:, : len(self.shared), :]
        expected = self.noise_um * 1e-3 * np.sqrt(np.einsum("npy,npy->ny", seen, seen)).max(axis=1)
        return np.asarray(SIGMAS_IN_RANGE * expected <= limit)

    def table_ball(self, z: Array) -> tuple[float, float, float]:
        """The table ball or nest, mm in the workpiece frame, of one row."""
        (x, y), (radius, angle, height) = self.machine.table_centre, z[self.poses : self.poses + 3]
        across, along = UNIT_MM * radius * np.cos(angle), UNIT_MM * radius * np.sin(angle)
        return _written(x + across), _written(y + along), _written(UNIT_MM * height)

    def polar(self, x: float, y: float) -> tuple[float, float]:
        """Distance from the table's centre, in 100 mm, and polar angle about it of a place in the workpiece frame, mm."""
        across, along = (v - c for v, c in zip((x, y), self.machine.table_centre, strict=True))
        return math.hypot(across, along) / UNIT_MM, math.atan2(along, across)

    def tool_ball(self, z: Array) -> tuple[float, float, float]:
        """The tool ball, mm in the tool frame, of one row."""
        return (0.0, 0.0, -_written(UNIT_MM * z[self.poses + 3]))


def _written(value: float) -> float:
    """mm as a campaign's files hold it."""
    return round(float(value), DIGITS) + 0.0


def make_space(
    machine: Machine, instrument: str, *, noise_um: float = 0.3, setup_sigma: SetupSigma | None = None,
    options: Mapping[str, Any] | None = None,
) -> Space:  # fmt: skip
    """The space of `r_test`, `touch_probe` or `ball_bar` on a machine. Raises `InputError` where there is nothing to decide."""
    if instrument not in ("r_test", "touch_probe", "ball_bar"):
        raise InputError(f"plans with {instrument} are not designed", remedy="use r_test, touch_probe or ball_bar")
    rotary = [name for name in machine.axis_names if machine.axes[name].rotary]
    if not rotary and instrument != "ball_bar":
        called = "an R-test" if instrument == "r_test" else "a touch probe"
        raise InputError(f"{called} needs a rotary axis and the machine has none", remedy="use instrument ball_bar")
    lengths = tuple(machine.workspace.bar_lengths)
    if instrument == "ball_bar" and not lengths:
        raise InputError("the workspace lists no bar", remedy="add bar_lengths = [100.0, 150.0] to [workspace]")
    sigma = setup_sigma or SetupSigma()
    names = (*rotary, *(("bar azimuth", "bar elevation") if instrument == "ball_bar" else ()), *SETUP_VARIABLES)
    lower, upper = _bounds(machine, rotary, instrument)
    z, k = ca.SX.sym("z", len(names)), ca.SX.sym("k", 1)
    geometry = _geometry(machine, rotary, instrument, z, k)
    rows, shared, own, own_sigma = _rows(machine, instrument, geometry, noise_um, sigma, options or {})
    limits, limit_names = _limits(machine, instrument, geometry, k, UNIT_MM * upper[-2:])
    centre, *_ = _rows(machine, "r_test", geometry, 1.0, sigma, {})
    scale = [1.0 / machine.axes[name].to_internal for name in machine.axis_names]
    commands = ca.vertcat(*(s * geometry.position[name] for s, name in zip(scale, machine.axis_names, strict=True)))
    return Space(
        machine, instrument, names, lower, upper, len(names) - len(SETUP_VARIABLES),
        lengths if instrument == "ball_bar" else (0.0,), shared, own, own_sigma, noise_um, sigma,
        Kernel(z, k, rows, limits), Mapped(ca.Function("centre", [z, k], [ca.densify(centre[:, : len(shared)])])),
        Mapped(ca.Function("axes", [z, k], [ca.densify(commands)])), limit_names, dict(options or {}),
    )  # fmt: skip


def _bounds(machine: Machine, rotary: Sequence[str], instrument: str) -> tuple[Array, Array]:
    lower, upper = [], []
    for name in rotary:
        low, high = machine.axes[name].travel
        if high - low >= 360.0:  # one turn is enough, the one about zero where the travel has it
            low = min(max(low, -180.0), high - 360.0)
            high = low + 360.0
        lower.append(math.radians(low))
        upper.append(math.radians(high))
    if instrument == "ball_bar":
        lower += [-math.pi, math.radians(least_elevation(machine.workspace))]
        upper += [math.pi, math.radians(MOST_ELEVATION)]
    workspace = machine.workspace
    heights = workspace.ball_height or (50.0, 150.0)
    tools = workspace.tool_length or (150.0, 150.0)
    lower += [0.0, -math.pi, heights[0] / UNIT_MM, tools[0] / UNIT_MM]
    upper += [(workspace.table_radius or 0.0) / UNIT_MM, math.pi, heights[1] / UNIT_MM, tools[1] / UNIT_MM]
    return np.array(lower), np.array(upper)


@dataclass(frozen=True)
class _Geometry:
    """Symbols of one row: axis positions (mm, rad), balls, tool axis and bar direction in the workpiece frame."""

    position: dict[str, Any]
    table_ball: Any
    tool_ball: Any
    place: Any
    tool_axis: Any
    bar: Any
    length: Any


def _geometry(machine: Machine, rotary: Sequence[str], instrument: str, z: Any, k: Any) -> _Geometry:
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
    position = {name: z[i] for i, name in enumerate(rotary)}
    position = follow(machine, position, tool_ball, place)
    workpiece, spindle = chain_poses(machine, position, {}, {})
    axis = workpiece.rotation.T @ spindle.rotation[:, 2]
    return _Geometry(position, table_ball, tool_ball, place, axis, bar, k[0])


def follow(machine: Machine, position: dict[str, Any], tool_ball: Any, place: Any) -> dict[str, Any]:
    """Axis positions that bring the tool ball to `place` (workpiece frame): the ball is linear in the linear axes.

    Where there are more than three linear axes those that stand first from the bed follow and the others rest at home.
    """
    linear, moving, ball, vector = _followers(machine, position, tool_ball)
    rest = {n: float(np.clip(0.0, *machine.axes[n].travel)) for i, n in enumerate(linear) if i not in moving}
    home = [ca.SX(0.0) if i in moving else ca.SX(rest[n]) for i, n in enumerate(linear)]
    start = ca.substitute([ball], [vector], [ca.vertcat(*home)])[0]
    solved = ca.inv_minor(ca.jacobian(ball, vector)[:, moving]) @ (place - start)
    found = {linear[i]: ca.simplify(solved[j]) for j, i in enumerate(moving)}
    return {name: position.get(name, found.get(name, ca.SX(rest.get(name, 0.0)))) for name in machine.axis_names}


def _followers(machine: Machine, position: dict[str, Any], tool_ball: Any) -> tuple[list[str], list[int], Any, Any]:
    """The linear axes, which three of them follow, and the tool ball (workpiece frame) as a function of a vector of all of them.
    Raises `InputError` where no three span space."""
    linear = [name for name in machine.axis_names if not machine.axes[name].rotary]
    symbols = {name: ca.SX.sym(name) for name in linear}
    whole = {name: position.get(name, symbols.get(name)) for name in machine.axis_names}
    ball = ball_in_workpiece(machine, whole, tool_ball)
    vector = ca.vertcat(*symbols.values())
    somewhere = ca.vertcat(*position.values(), ca.SX(1, 1))  # the directions are independent anywhere or nowhere
    free = ca.symvar(somewhere)
    slope = ca.Function("slope", [ca.vertcat(*free)], [ca.densify(ca.jacobian(ball, vector))])
    at_zero = np.asarray(slope([0.1] * len(free)))
    moving: list[int] = []
    for i in range(len(linear)):
        if len(moving) < 3 and np.linalg.matrix_rank(at_zero[:, [*moving, i]], tol=1e-6) == len(moving) + 1:
            moving.append(i)
    if len(moving) < 3:
        raise InputError("the linear axes do not span space", remedy="plans need three linear axes that do")
    return linear, moving, ball, vector


def _spanned(machine: Machine, position: dict[str, Any], tool_ball: Any) -> Any | None:
    """The volume that the directions of the linear axes that follow span, where that changes because a rotary axis turns one of
    them against the others; else None."""
    rotary = {name: q for name, q in position.items() if machine.axes[name].rotary}
    _, moving, ball, vector = _followers(machine, rotary, tool_ball)
    q = ca.vertcat(*rotary.values(), ca.SX(0, 1))
    volume = ca.fabs(ca.det(ca.jacobian(ball, vector)[:, moving]))
    at = ca.Function("volume", [q], [volume])
    places = (turn * np.arange(1.0, q.numel() + 1.0) for turn in (0.3, 0.7, 1.1))
    return volume if np.ptp([float(at(place)) for place in places]) > SAME_VOLUME else None


def _rows(
    machine: Machine,
    instrument: str,
    geometry: _Geometry,
    noise_um: float,
    sigma: SetupSigma,
    options: Mapping[str, Any],
) -> tuple[Any, tuple[Parameter, ...], tuple[str, ...], Array]:
    """J (ny, shared + own) at the prior means, from the model's own row function: shared per prior 1σ, own per noise."""
    commands = {name: np.zeros(1) for name in machine.axis_names}
    run = Run(
        id="pose", instrument=(instrument,), sampling="static", time=np.zeros(1), commands=commands,
        length=100.0 if instrument == "ball_bar" else None, noise_um=noise_um, setup_sigma_um=sigma, options=options,
    )  # fmt: skip
    model = Model(Campaign(machine=machine, runs=(run,)))
    effects = tuple(effect for effect in model.effects if effect.applies(run))
    function = assemble(machine, run, effects, model.parameters, False)
    inputs = [ca.SX(0), ca.SX(0)]
    inputs += [geometry.position[s.axis] if isinstance(s, Position) else ca.SX(0) for s in function.inputs]
    known = {"length": geometry.length}
    for name, vector in (("table_ball", geometry.table_ball), ("tool_ball", geometry.tool_ball)):
        known |= {f"{name}.{c}": vector[i] for i, c in enumerate("xyz")}
    shared = tuple(model.parameters[model.index[name]] for name in function.shared)
    own = tuple(name.removeprefix("setup.") for name in function.own)
    own_parameters = [model.parameters[model.index[f"setup.pose.{name}"]] for name in own]
    constants = ca.vertcat(*(known[name] for name in function.constants))
    means = [ca.DM([p.mean for p in group]) for group in (shared, own_parameters)]
    _, by_shared, by_own, *_ = function.slopes.call([ca.vertcat(*inputs), *means, constants])
    if not shared:
        raise InputError("the machine file varies no error", remedy="add [errors], as EX0C = { sigma = 50.0 }")
    prior = np.array([p.sigma for p in shared])
    scaled = ca.horzcat(by_shared @ ca.diag(ca.DM(prior / noise_um)), by_own)
    return scaled, shared, own, np.array([p.sigma / noise_um for p in own_parameters])


def _around_sphere(machine: Machine, geometry: _Geometry) -> dict[str, Any]:
    """What each linear axis needs at most, mm, while the tip goes around the sphere of a pose."""
    place = ca.SX.sym("place", 3)
    turned = {name: q for name, q in geometry.position.items() if machine.axes[name].rotary}
    moved = follow(machine, turned, geometry.tool_ball, place)
    linear = [name for name in machine.axis_names if not machine.axes[name].rotary]
    return {name: touch_reach(machine) * ca.norm_2(ca.jacobian(moved[name], place)) for name in linear}


def _left_to_draw_back(machine: Machine, geometry: _Geometry) -> Any:
    """mm of travel that the upright axis has left at a pose, the tool drawn back up from the table or, where that does not lead
    down, along itself, whichever leaves more: without it there is no way out of a nest."""
    upright = upright_axis(machine)
    turned = {name: q for name, q in geometry.position.items() if machine.axes[name].rotary}
    sign = math.copysign(1.0, machine.axes[upright].direction[2])

    def left(way: Any) -> Any:
        drawn = follow(machine, turned, geometry.tool_ball, geometry.place + RETRACTS_MM[0] * way)
        return sign * (top_of(machine) - drawn[upright])

    along = geometry.tool_axis
    return ca.fmax(left(ca.DM([0.0, 0.0, 1.0])), ca.fmin(left(along), RETRACTS_MM[0] * along[2]))


def _limits(
    machine: Machine, instrument: str, geometry: _Geometry, k: Any, most: Array
) -> tuple[Any, tuple[str, ...]]:  # fmt: skip
    """What must be ≥ 0, in units of 100 mm (the bar's angle: its cosine), and what each means; `most` mm of ball height and tool
    length (2,)."""
    limits, names = [], []
    margins = _around_sphere(machine, geometry) if instrument == "touch_probe" else {}
    for name in machine.axis_names:
        axis = machine.axes[name]
        if not axis.rotary:
            low, high = machine.reach(name)
            margin = margins.get(name, 0.0)
            limits += [
                (geometry.position[name] - low - margin) / UNIT_MM,
                (high - geometry.position[name] - margin) / UNIT_MM,
            ]
            names += [f"travel of {name}"] * 2
    if instrument != "ball_bar":  # which leaves sideways, too
        limits.append(_left_to_draw_back(machine, geometry) / UNIT_MM)
        names.append(DRAWN_BACK)
    volume = _spanned(machine, geometry.position, geometry.tool_ball)
    if volume is not None:
        limits.append(volume - LEAST_VOLUME)
        names.append(PARALLEL)
    workspace, place, axis = machine.workspace, geometry.place, geometry.tool_axis
    if workspace.spindle_nose is not None:
        limits += [(height - workspace.clearance) / UNIT_MM for height in nose_over_table(workspace, place, axis)]
        names += ["spindle nose and table"] * 2
        if instrument == "ball_bar":
            limits.append(
                angle_clearance(workspace, axis, -geometry.bar, k[0], workspace.bar_radius or 0.0, BALL_RADIUS)
            )
            gap = post_clearance(workspace, geometry.table_ball, place, axis)
            limits.append((gap - workspace.clearance) / UNIT_MM)
            names += ["spindle nose and bar", TO_POST]
        elif nose_may_reach_post(workspace):
            down = ca.DM([0.0, 0.0, -1.0])
            limits.append(angle_clearance(workspace, axis, down, place[2], workspace.post_radius or 0.0))
            names.append("spindle nose and post")
    if instrument == "touch_probe":  # the touches at the equator stay off the sphere's post
        limits.append(axis[2] - max(math.cos(math.radians(MOST_PROBE_TILT_DEG)), least_upright(workspace)))
        names.append("touch and post")
    if instrument == "ball_bar":
        limits.append((geometry.place[2] - BALL_RADIUS - workspace.clearance) / UNIT_MM)
        names.append("tool ball and table")
    gap, least = _out_of_nest(machine, geometry, instrument == "touch_probe", most)
    if least < 0.0:
        limits.append(gap / UNIT_MM)
        names.append("tool over the workpiece's origin and table ball")
    return ca.vertcat(*limits), tuple(names)


def _out_of_nest(machine: Machine, geometry: _Geometry, probe: bool, most: Array) -> tuple[Any, float]:
    """Clearance (mm) of the tool where every way out of the nest leads: the upright axis at its top, all others at home; and at
    least how large it is with a height of the ball and a tool length of at most so many (2,) mm: above all balls it has no part
    lower than its own ball where it stands upright."""
    end = at_the_top(machine, {name: home(axis) for name, axis in machine.axes.items()})
    position = {name: ca.SX(machine.axes[name].to_internal * value) for name, value in end.items()}
    workpiece, spindle = chain_poses(machine, position, {}, {})
    axis = workpiece.rotation.T @ spindle.rotation[:, 2]
    workspace = machine.workspace

    def gap(table_ball: Any, tool_ball: Any) -> Any:
        place = ball_in_workpiece(machine, position, tool_ball)
        return out_of_nest_clearance(workspace, table_ball, place, axis, probe)

    (height, tool), least = most, -math.inf
    place = ca.evalf(ball_in_workpiece(machine, position, ca.DM([0.0, 0.0, -tool])))
    if float(ca.evalf(axis)[2]) > 1.0 - SAME_VOLUME and float(place[2]) > height:
        least = float(ca.evalf(gap(ca.vertcat(place[0], place[1], height), ca.DM([0.0, 0.0, -tool]))))
    return gap(geometry.table_ball, geometry.tool_ball), least
