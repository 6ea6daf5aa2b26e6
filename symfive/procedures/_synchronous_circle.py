"""Circle about a table ball off the rotary axis by a linear and a rotary axis together (Tsutsumi et al.
2007)."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from symfive.arrays import Array
from symfive.campaign import Run, SetupSigma
from symfive.errors import InputError, among
from symfive.machine import Machine
from symfive.procedures._limits import checked
from symfive.procedures._nominal import Nominal
from symfive.procedures._path import DIRECTIONS, along, check_spacing, senses
from symfive.procedures._setting import (
    BALL_SETUP,
    bar_length,
    heights,
    one_after_another,
    tool_ball_of,
    turning_axis,
    vector,
)

SAME_MM = 1e-9
LOOKED_AT = 721
"""Points of a circle at which the range of its rotary axis is looked for."""


def synchronous_circle(
    machine: Machine, *, x_t: float | None = None, radius: float | None = None, feed: float = 1000.0,
    direction: str = "both", linear: str | None = None, rotary: str | None = None, height: float | None = None,
    run_up_deg: float = 60.0, sweep_deg: float = 360.0, hold: Mapping[str, float] | None = None,
    tool_ball: Sequence[float] | None = None, rate_hz: float = 100.0, noise_um: float = 0.3,
    setup_sigma_um: SetupSigma = BALL_SETUP,
) -> tuple[Run, ...]:  # fmt: skip
    """Circles of `radius` about the table ball at `x_t` from the rotary axis (default 0.9·radius), one run
    per direction.

    The tool stays on the line of the `linear` axis through the rotary axis, so for the path point P at polar
    angle θ the rotary axis is commanded to θ and the linear one to |P| (paper 3, (2)-(4)); at x_t = radius
    the continuous branch θ = φ/2 is kept. `rotary` must carry the workpiece and `linear` be square to it; by
    default C-like and X-like. Where θ leaves the travel of the rotary axis, ball and path are turned about that axis to its
    middle. `feed` mm/min along the circle; φ runs from -`run_up_deg` over 0…`sweep_deg` to
    its run-out; `height` mm above the workpiece frame's origin. Raises `InputError` where an axis cannot
    follow: near x_t = radius the rotary axis has to turn at feed/|x_t - radius| (paper 3, (8)).
    """
    size = bar_length(machine, radius, near=50.0)
    x_t = 0.9 * size if x_t is None else float(x_t)
    if not (size > 0.0 and np.isfinite(x_t)):
        raise InputError("the circle has no radius or no centre", remedy="give a radius above 0 and a finite x_t")
    start, reach = -np.radians(run_up_deg), np.radians(sweep_deg + 2.0 * run_up_deg)
    angles = polar_angle(np.linspace(start, start + reach, LOOKED_AT), x_t, size)
    frame, turned = frame_within_travel(machine, angles, linear=linear, rotary=rotary, hold=hold)
    foot = frame.foot(height if height is not None else sum(heights(machine)) / 2.0)
    table, nominal, u, v = frame.rotary, Nominal(machine), frame.u, frame.v
    ball = tool_ball_of(machine, tool_ball)
    speed = feed / 60.0 / size
    time, way = along(reach, speed, np.radians(run_up_deg), rate_hz)
    runs = []
    for sense in senses(direction):
        phi = start + way if DIRECTIONS[sense] > 0 else start + reach - way
        x, y = x_t + size * np.cos(phi), size * np.sin(phi)
        fixed: dict[str, float | Array] = {**(hold or {}), table: turned + np.degrees(polar_angle(phi, x_t, size))}
        target = foot + np.outer(x, u) + np.outer(y, v)
        run = Run(
            id=f"{table.lower()}-x{x_t:g}-f{feed:g}-{sense}", instrument=("ball_bar",), sampling="dynamic", time=time,
            commands=nominal.follow(target, ball, fixed, "synchronous circle"), table_ball=vector(foot + x_t * u),
            tool_ball=ball, length=size, noise_um=noise_um, setup_sigma_um=setup_sigma_um,
        )  # fmt: skip
        runs.append(checked(machine, run, feed=feed, place="x_t, the radius, the run-up or the tool length"))
    check_spacing(speed, rate_hz)
    return one_after_another(runs)


@dataclass(frozen=True)
class CircleFrame:
    """Frame of a machine's circles: its `rotary` axis, a point on that axis (`middle`, mm) and the directions `u` of
    the linear axis, `v` across and `n` along the rotary axis, upwards, all in the workpiece frame (3,)."""

    rotary: str
    middle: Array
    u: Array
    v: Array
    n: Array

    def foot(self, height: float) -> Array:
        """The point of the rotary axis `height` mm above the workpiece frame's origin."""
        return self.middle + (height - self.middle @ self.n) * self.n


def circle_frame(
    machine: Machine, *, linear: str | None = None, rotary: str | None = None, hold: Mapping[str, float] | None = None
) -> CircleFrame:
    """The frame of `synchronous_circle` with the same options. Raises `InputError` where the axes do not suit."""
    table = turning_axis(machine, rotary)
    nominal = Nominal(machine)
    point, axle = nominal.axis_line(table, hold or {})
    if machine.structure.carries(table) != "workpiece":
        raise InputError(f"axis {table} carries the tool", remedy="choose a rotary axis of the table")
    radial = np.asarray(machine.axes[_linear_axis(machine, linear, axle)].direction)
    at_zero = nominal.commands(hold or {}, 1)
    upright = nominal.workpiece_rotation(at_zero)[0]
    middle = upright.T @ (point - nominal.workpiece_origin(at_zero)[0])
    n = upright.T @ axle
    if round(float(n[2]), 9) < 0.0:  # heights count up from the table, whichever way the control counts the angle
        n = -n
    return CircleFrame(table, middle, upright.T @ radial, upright.T @ np.cross(axle, radial), n)


def frame_within_travel(
    machine: Machine, theta: Array, *, linear: str | None = None, rotary: str | None = None,
    hold: Mapping[str, float] | None = None,
) -> tuple[CircleFrame, float]:  # fmt: skip
    """The frame of a circle whose rotary axis goes through the angles `theta` (N,) rad, and by how many whole degrees that axis
    stands turned at θ = 0: 0 where the angles lie within its travel, else so many that they lie in the middle of it."""
    frame = circle_frame(machine, linear=linear, rotary=rotary, hold=hold)
    (low, high), angles = machine.axes[frame.rotary].travel, np.degrees(theta)
    if low <= angles.min() and angles.max() <= high:
        return frame, 0.0
    turned = float(np.round(0.5 * (low + high - angles.min() - angles.max())))
    there = {**(hold or {}), frame.rotary: turned}
    return circle_frame(machine, linear=linear, rotary=rotary, hold=there), turned


def polar_angle(phi: Array, x_t: float, radius: float) -> Array:
    """θ (N,) rad of the points (x_t + r cos φ, r sin φ) about the origin, continuous in φ (paper 3, (3))."""
    if abs(x_t - radius) < SAME_MM:
        return phi / 2.0
    turns = np.round(phi / (2.0 * np.pi))
    theta = np.arctan2(radius * np.sin(phi), x_t + radius * np.cos(phi))
    if abs(x_t) > radius:
        return theta if x_t > 0.0 else np.unwrap(theta)
    return theta + 2.0 * np.pi * turns


def _linear_axis(machine: Machine, wanted: str | None, axle: Array) -> str:
    square = [
        name for name, axis in machine.axes.items()
        if not axis.rotary and abs(np.asarray(axis.direction) @ axle) < 1e-9
    ]  # fmt: skip
    if wanted is not None:
        among(wanted, square, f"{wanted} is not a linear axis square to the rotary axis")
    if not square:
        raise InputError("no linear axis is square to the rotary axis", remedy="hold the tilting axis at 0")
    return wanted or ("X" if "X" in square else square[0])
