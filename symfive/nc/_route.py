"""The way out of the nest and around: where the tool is drawn back to, and over the top to the next pose."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence

import numpy as np

from symfive.campaign import FIRST_LINE, Run
from symfive.errors import InputError
from symfive.machine import Machine
from symfive.procedures import Nominal

Positions = Mapping[str, float]
Way = tuple[Positions, ...]
"""Positions of all axes on a way out of the nest, one after the other, which differ in one axis: which way several take in a
rapid depends on the control. It begins and, between two poses, ends at a lifted one."""
FLAT = 0.2
"""Sine of the angle between tool and table below which drawing back along the tool would not lead away from the table."""
LEAST_LIFT_MM = 10.0


def upright_axis(machine: Machine) -> str:
    """The linear axis along the tool's axis with all axes at zero. Raises `InputError` where the machine has none."""
    if not machine.linear_axes:
        raise InputError(
            "the machine has no linear axis, so that no program can draw the tool back", remedy="move by hand"
        )
    return max(machine.linear_axes, key=lambda name: abs(machine.axes[name].direction[2]))


def top_of(machine: Machine) -> float:
    """Position of the upright axis at the upper end of what plans use of its travel, mm."""
    upright = upright_axis(machine)
    low, high = machine.reach(upright)
    return high if machine.axes[upright].direction[2] > 0.0 else low


def lifts(nominal: Nominal, run: Run, row: int, mm: float) -> Iterator[dict[str, float]]:
    """The pose with the tool drawn back by `mm`, rotary axes at rest, in every direction that the travel allows.

    Directions: along the tool and up from the table (first, where the tool lies flat), up in the machine, between the first
    two; along the bar, sideways from the table ball.
    """
    machine = nominal.machine
    pose = {name: np.array([run.commands[name][row]]) for name in machine.axis_names}
    place = nominal.ball(pose, run.tool_ball)[0]
    workpiece, tool = (f(pose)[0] for f in (nominal.workpiece_rotation, nominal.tool_rotation))
    along, up = workpiece.T @ tool[:, 2], np.array([0.0, 0.0, 1.0])
    ways = [along, up] if along[2] >= FLAT else [up, along]
    bar, above = place - np.asarray(run.table_ball), workpiece.T @ up
    ways += [above, along + up]
    ways += [] if run.length is None else [bar, bar - (bar @ above) * above]
    following = nominal.following()
    fixed = {name: q for name, q in pose.items() if name not in following}
    for way in ways:
        size = float(np.linalg.norm(way))
        if size < 1e-6:
            continue
        try:
            moved = nominal.follow((place + mm * way / size)[None, :], run.tool_ball, fixed, "the retract")
        except InputError:
            continue
        found = {name: float(q[0]) for name, q in moved.items()}
        reach = {name: machine.reach(name) for name in found}
        if all(reach[name][0] - 1e-9 <= value <= reach[name][1] + 1e-9 for name, value in found.items()):
            yield found


def usual_lift(nominal: Nominal, run: Run, row: int, mm: float, least: float) -> dict[str, float]:
    """The first of the lifts, shorter where the travel allows no more. Raises `InputError` where it allows not even the least."""
    for share in np.linspace(1.0, 0.0, 11):
        if share * mm >= min(least, mm):
            for found in lifts(nominal, run, row, float(share * mm)):
                return found
    problem = f"run {run.id}: at line {row + FIRST_LINE} no travel is left to draw the tool back by {least:g} mm"
    raise InputError(problem, remedy="move the ball or nest, or use another tool length")


def at_the_top(machine: Machine, place: Positions) -> dict[str, float]:
    """The place with the upright axis at the top, or where it is if that is higher."""
    upright, top = upright_axis(machine), top_of(machine)
    higher = max if machine.axes[upright].direction[2] > 0.0 else min
    return {**place, upright: higher(top, place[upright])}


def turned_home(machine: Machine, place: Positions) -> dict[str, float]:
    """The place with all rotary axes at home."""
    return {name: machine.home(name) if axis.rotary else place[name] for name, axis in machine.axes.items()}


def over_the_top(machine: Machine, before: Positions, after: Positions) -> Way:
    """From one lifted pose to another: up alone, the rotary axes one by one, then the other linear ones, down alone."""
    upright = upright_axis(machine)
    high, there = (at_the_top(machine, place) for place in (before, after))
    names = sorted((name for name in machine.axes if name != upright), key=lambda name: not machine.axes[name].rotary)
    return before, *one_by_one(high, there, names), there, after


def out_to_the_top(machine: Machine, lifted: Positions) -> Way:
    """From a lifted pose up alone, then the rotary axes home one by one."""
    top = at_the_top(machine, lifted)
    return lifted, *one_by_one(top, turned_home(machine, top), [n for n, axis in machine.axes.items() if axis.rotary])


def one_by_one(before: Positions, after: Positions, names: Sequence[str]) -> Way:
    """Places on the way from one to another on which these axes move one after the other; those that stand are left out."""
    found = [dict(before)]
    for name in names:
        if found[-1][name] != after[name]:
            found.append({**found[-1], name: after[name]})
    return tuple(found)
