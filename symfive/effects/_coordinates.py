"""Coordinates of a nonparametric term, by name: an axis, what its motion does, time, or the row."""

from __future__ import annotations

from typing import Any

import numpy as np

from symfive.arrays import Array
from symfive.machine import Machine
from symfive.motion import Acceleration, Direction, Position, Signal, Velocity, approach
from symfive.row import Row
from symfive.runs import Run

VELOCITY, ACCELERATION = " velocity", " acceleration"
SINCE = " since reversal"
SIGN = " velocity sign"
ROW = "row"
"""The number of a row, which replaces time in a run whose clock was not recorded."""
RARE = 0.01
"""The share of a run that starts and stops, and above that of its ends, take at most."""
FINEST = 1e-3
"""Distances since a reversal below this share of the travel are one."""


def owner(name: str) -> str:
    """The axis that a coordinate speaks of."""
    for quantity in (VELOCITY, ACCELERATION, SINCE, SIGN):
        name = name.removesuffix(quantity)
    return name


def steps(share: Any, library: Any, finest: float = FINEST) -> Any:
    """A distance as a share of the travel, 0…1 and beyond, in equal steps of its logarithm down to `finest`."""
    return library.log1p(share / finest) / float(np.log1p(1.0 / finest))


def coordinate_values(name: str, run: Run, machine: Machine) -> Array:
    """A coordinate along the commands of a run, in file units (mm, degree, s; rows from 1)."""
    if name == "t":
        return run.start_s + np.asarray(run.time)
    if name == ROW:
        return run.course
    if run.pieces:
        return np.concatenate([coordinate_values(name, piece.run, machine)[piece.own] for piece in run.pieces])
    command = np.asarray(run.commands[owner(name)])
    if name.endswith(SINCE):
        return _since_reversal(command)
    if name.endswith(SIGN):
        return approach(command)
    for _ in range(1 if name.endswith(VELOCITY) else 2 if name.endswith(ACCELERATION) else 0):
        command = np.gradient(command, run.time) if run.dynamic and run.rows > 1 else np.zeros(run.rows)
    return command


def usual_span(name: str, values: Array) -> tuple[float, float]:
    """From the lowest to the highest; of an acceleration without the jerks at starts and stops; of a way since reversal as far to
    either side, also where the axis moves to one side only."""
    if name.endswith(SINCE):
        reach = float(np.max(np.abs(values)))
        return -reach, reach
    low, high = np.quantile(values, (RARE, 1.0 - RARE) if name.endswith(ACCELERATION) else (0.0, 1.0))
    return float(low), float(high)


def _since_reversal(command: Array) -> Array:
    """Way since the last reversal with the sign of the motion (before the first one: since the start)."""
    sign = approach(command)
    turned = np.flatnonzero(np.diff(sign))
    origin = np.concatenate([[0], turned])[np.searchsorted(turned + 1, np.arange(len(command)), side="right")]
    return np.asarray(sign * np.abs(command - command[origin]))


def signals_of(name: str) -> tuple[Signal, ...]:
    """What a row needs beside the positions to know a coordinate: of an axis, its velocity, acceleration or side."""
    kinds = ((VELOCITY, Velocity), (ACCELERATION, Acceleration), (SIGN, Direction))
    return tuple(kind(owner(name)) for ending, kind in kinds if name.endswith(ending))


def coordinate_in(name: str, row: Row) -> Any:
    """A coordinate of a row: of an axis mm or rad, of what its motion does in file units, of time s."""
    if name == "t":
        return row.clock
    for signal in signals_of(name):
        unit = 1.0 if name.endswith(SIGN) else row.machine.axes[owner(name)].to_internal
        return row.signal(signal) / unit
    return row.signal(Position(name))
