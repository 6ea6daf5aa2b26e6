"""What the axes can do: travel, feed and acceleration of a run, and how long a move between poses takes."""

from __future__ import annotations

import numpy as np

from symfive.arrays import Array, Flags
from symfive.campaign import Run
from symfive.errors import InputError
from symfive.machine import Axis, Machine

TOLERANCE = 1e-6


def checked(machine: Machine, run: Run, *, place: str, feed: float | None = None, unit: str = "mm/min") -> Run:
    """The run itself if every axis can follow it; otherwise raises `InputError` with what to change.

    `place` names the caller's options that move the poses (for the remedy); `feed` in `unit` is that of
    a dynamic run. A path scaled in time keeps its shape: speeds scale with the feed, accelerations with its
    square.
    """
    within_travel(machine, run, place=place)
    if run.rows < 2:
        return run
    if not np.all(np.diff(run.time) > 0.0):
        raise InputError(f"run {run.id}: time does not increase", remedy="give seconds_per_pose above 0")
    if run.dynamic:
        _check_rates(machine, run, feed, unit)
    else:
        _check_moves(machine, run)
    return run


def within_travel(machine: Machine, run: Run, *, place: str) -> Run:
    """The run itself if no axis leaves its travel; otherwise raises `InputError` as `checked` does."""
    for name, axis in machine.axes.items():
        _check_travel(run, axis, run.commands[name], place)
    return run


def followed(machine: Machine, run: Run) -> Flags:
    """Rows (N,) that every axis reaches within its travel, feed and acceleration, judged by the two steps before each;
    `checked` does so for all rows."""
    found, steps = np.ones(run.rows, dtype=bool), np.diff(run.time)
    for name, axis in machine.axes.items():
        values = run.commands[name]
        low, high = _reach(axis)
        found &= (values >= low) & (values <= high)
        pace = np.diff(values) / steps
        if axis.max_feed is not None:
            found[1:] &= 60.0 * np.abs(pace) <= axis.max_feed * (1.0 + TOLERANCE)
        if axis.max_acceleration is not None:
            found[2:] &= np.abs(np.diff(pace) / steps[1:]) <= axis.max_acceleration * (1.0 + TOLERANCE)
    return found


def _reach(axis: Axis) -> tuple[float, float]:
    low, high = axis.travel
    slack = TOLERANCE * max(1.0, abs(low), abs(high)) * 1e-3
    return low - slack, high + slack


def _check_travel(run: Run, axis: Axis, values: Array, place: str) -> None:
    if not np.isfinite(values).all():
        raise InputError(f"run {run.id}: a position of axis {axis.name} is not finite", remedy=f"correct {place}")
    low, high = axis.travel
    least, most = _reach(axis)
    worst = int(np.argmax(np.maximum(low - values, values - high)))
    if values[worst] < least or values[worst] > most:
        problem = (
            f"run {run.id}: axis {axis.name} would go to {values[worst]:.6g} {axis.unit} at {run.time[worst]:.4g} s"
        )
        raise InputError(f"{problem}, its travel is {low:g}…{high:g}", remedy=f"change {place}")


def _check_rates(machine: Machine, run: Run, feed: float | None, unit: str) -> None:
    steps = np.diff(run.time)
    factor, culprit = 1.0, ""
    for name, axis in machine.axes.items():
        speed = np.abs(np.diff(run.commands[name]) / steps).max(initial=0.0) * 60.0
        pace = np.diff(run.commands[name]) / steps
        push = np.abs(np.diff(pace) / steps[1:]).max(initial=0.0)
        if axis.max_feed is not None and speed * factor > axis.max_feed * (1.0 + TOLERANCE):
            factor = axis.max_feed / speed
            culprit = f"axis {name} would move at {speed:.5g} {axis.unit}/min, its limit is {axis.max_feed:g}"
        if axis.max_acceleration is not None and push * factor**2 > axis.max_acceleration * (1.0 + TOLERANCE):
            factor = float(np.sqrt(axis.max_acceleration / push))
            limit = f"its limit is {axis.max_acceleration:g}"
            culprit = f"axis {name} would accelerate at {push:.5g} {axis.unit}/s², {limit}"
    if culprit:
        most = f"lower the feed to at most {_below(feed * factor):g} {unit}" if feed is not None else "go slower"
        raise InputError(f"run {run.id}: {culprit}", remedy=most)


def _check_moves(machine: Machine, run: Run) -> None:
    given = np.diff(run.time)
    for name, axis in machine.axes.items():
        way = np.abs(np.diff(run.commands[name]))
        needed = _move_time(way, axis)
        late = int(np.argmax(needed - given))
        if needed[late] > given[late] * (1.0 + TOLERANCE):
            problem = f"run {run.id}: axis {name} needs {needed[late]:.3g} s for {way[late]:.4g} {axis.unit}"
            remedy = f"give at least {np.ceil(needed[late] * 10.0) / 10.0:g} seconds_per_pose"
            raise InputError(f"{problem}, the plan gives {given[late]:.3g} s", remedy=remedy)


def _move_time(way: Array, axis: Axis) -> Array:
    """Time of a move from rest to rest with the axis' greatest feed and acceleration, s."""
    speed = np.inf if axis.max_feed is None else axis.max_feed / 60.0
    push = np.inf if axis.max_acceleration is None else axis.max_acceleration
    triangle = 2.0 * np.sqrt(way / push)
    trapezium = way / speed + speed / push if np.isfinite(speed) else triangle
    reaches = way * push > speed**2 if np.isfinite(push) else np.full(way.shape, True)
    return np.where(reaches, trapezium, triangle) if np.isfinite(speed) else triangle


def _below(value: float) -> float:
    """Three digits, rounded down from 0.2 % less, since rows see a little less than the greatest acceleration."""
    value *= 0.998
    scale = 10.0 ** (np.floor(np.log10(value)) - 2.0)
    return float(np.floor(value / scale) * scale)
