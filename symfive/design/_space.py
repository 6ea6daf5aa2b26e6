"""What a static plan may decide, with its limits: rotary poses, bar direction, balls and nests, tool length.

The variables of one row, `z`, in this order (rad; lengths of the set-up in 100 mm):

    pose     every rotary axis; for a ball bar the bar's azimuth and elevation in the workpiece frame
    set-up   the table ball's distance from the table's centre, its polar angle and its height; the tool's length

The linear axes follow: they bring the tool ball onto the nest, or to the other end of the bar. A bar's length is a
constant `k` (mm) of its set-up, chosen from the list the user owns.

`_pose` has one row as symbols, `_limits` what keeps it clear; the bar is kept off the post by its least elevation.
"""

from __future__ import annotations

import math
import threading
from collections import OrderedDict
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import casadi as ca
import numpy as np

from symfive.arrays import Array, Flags
from symfive.campaign import Campaign, Run, SetupSigma
from symfive.compiled import Mapped
from symfive.design._limits import KINKED, limits_of
from symfive.design._pose import UNIT_MM, PoseGeometry, pose_geometry
from symfive.errors import InputError
from symfive.instruments import INSTRUMENTS
from symfive.machine import Machine
from symfive.model import Model, assemble
from symfive.motion import Position
from symfive.moves import least_elevation
from symfive.optimal import Kernel
from symfive.parameters import Parameter

SETUP_VARIABLES = ("table_ball.radius", "table_ball.angle", "table_ball.height", "tool.length")
DIGITS = 6
"""Digits behind the point to which positions are written, so that what is tested is what is driven."""
MOST_ELEVATION = 90.0
SIGMAS_IN_RANGE = 3.0


@dataclass(frozen=True, eq=False)
class Space:
    """One instrument on one machine: variables, bounds, kernel. It is equal to itself alone.

    `names` of the variables, `lower` and `upper` (nz,), `poses` how many belong to the pose; `shared` the machine's
    parameters, `own` the set-up errors of a run and `own_sigma` their prior 1σ in units of the noise (finite, as declared, even
    for an unknown zero); `centre` J of the tool centre point, (3, shared), µm per prior 1σ; `options` of the
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

    @property
    def bar(self) -> bool:
        """Whether a bar joins the two balls."""
        return INSTRUMENTS[self.instrument].bar

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
        limit = INSTRUMENTS[self.instrument].stroke(self.machine)
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


_KEPT: OrderedDict[tuple[object, ...], Space] = OrderedDict()
"""Spaces that were asked for, the latest last; each holds its machine, of which the key holds the identity only."""
MOST_KEPT = 32
_LOCK = threading.Lock()


def make_space(
    machine: Machine, instrument: str, *, noise_um: float = 0.3, setup_sigma: SetupSigma | None = None,
    options: Mapping[str, Any] | None = None,
) -> Space:  # fmt: skip
    """The space of `r_test`, `touch_probe` or `ball_bar` on a machine, made once: derivatives are made and compiled when first
    needed. Raises `InputError` if nothing is left to choose."""
    sigma, chosen = setup_sigma or SetupSigma(), dict(options or {})
    key = (id(machine), instrument, noise_um, repr(sigma), repr(sorted(chosen.items())))
    with _LOCK:
        if key not in _KEPT:
            _KEPT[key] = _made(machine, instrument, noise_um, sigma, chosen)
            if len(_KEPT) > MOST_KEPT:
                _KEPT.popitem(last=False)
        _KEPT.move_to_end(key)
        return _KEPT[key]


def _made(
    machine: Machine, instrument: str, noise_um: float, sigma: SetupSigma, options: Mapping[str, Any]
) -> Space:  # fmt: skip
    if instrument not in ("r_test", "touch_probe", "ball_bar"):
        raise InputError(f"plans with {instrument} are not designed", remedy="use r_test, touch_probe or ball_bar")
    rotary = machine.rotary_axes
    if not rotary and instrument != "ball_bar":
        called = "an R-test" if instrument == "r_test" else "a touch probe"
        raise InputError(f"{called} needs a rotary axis and the machine has none", remedy="use instrument ball_bar")
    lengths = tuple(machine.workspace.bar_lengths)
    if instrument == "ball_bar" and not lengths:
        raise InputError("the workspace lists no bar", remedy="add bar_lengths = [100.0, 150.0] to [workspace]")
    names = (*rotary, *(("bar azimuth", "bar elevation") if instrument == "ball_bar" else ()), *SETUP_VARIABLES)
    lower, upper = _bounds(machine, rotary, instrument)
    z, k = ca.SX.sym("z", len(names)), ca.SX.sym("k", 1)
    geometry = pose_geometry(machine, rotary, instrument, z, k)
    rows, shared, own, own_sigma = _rows(machine, instrument, geometry, noise_um, sigma, options)
    limits, limit_names = limits_of(machine, instrument, geometry, UNIT_MM * upper[-2:])
    centre, *_ = _rows(machine, "r_test", geometry, 1.0, sigma, {})
    scale = [1.0 / machine.axes[name].to_internal for name in machine.axis_names]
    commands = ca.vertcat(*(s * geometry.position[name] for s, name in zip(scale, machine.axis_names, strict=True)))
    return Space(
        machine, instrument, names, lower, upper, len(names) - len(SETUP_VARIABLES),
        lengths if instrument == "ball_bar" else (0.0,), shared, own, own_sigma, noise_um, sigma,
        Kernel(z, k, rows, limits), Mapped(ca.Function("centre", [z, k], [ca.densify(centre[:, : len(shared)])])),
        Mapped(ca.Function("axes", [z, k], [ca.densify(commands)])), limit_names, options,
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


def _rows(
    machine: Machine,
    instrument: str,
    geometry: PoseGeometry,
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
