"""What a circle is: two families, each with the variables in the order given (mm, mm/min).

synchronous  ratio X_T/r, radius, feed, height     a rotary and a linear axis together (`synchronous_circle`)
planar       radius, feed, x, y, z of the centre   two linear axes (`planar_circle`)
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass

import numpy as np

from symfive.campaign import Run
from symfive.errors import InputError
from symfive.machine import Machine
from symfive.procedures import planar_circle, synchronous_circle

FAMILIES = {
    "synchronous": ("ratio", "radius", "feed", "height"),
    "planar": ("radius", "feed", "x", "y", "z"),
}
SLACK_MM = 1e-6


@dataclass(frozen=True, kw_only=True)
class CircleShape:
    """What a circle is: `family`, `direction` ccw, cw or both, `plane` of a planar one, its `instrument`, and the `values`
    of the family's variables (mm, mm/min)."""

    family: str
    values: Mapping[str, float]
    direction: str = "both"
    plane: str = "XY"
    instrument: str = "ball_bar"


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
            machine, plane=shape.plane, instrument=shape.instrument, radius=v["radius"], feed=v["feed"],
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


def limits_met(machine: Machine, runs: Iterable[Run], share: float) -> list[str]:
    """Limits of which less than `share` is left along some runs, in words."""
    met = []
    for run in runs:
        steps = np.diff(run.time)
        for name, axis in machine.axes.items():
            (low, high), q = axis.travel, run.commands[name]
            pace = np.diff(q) / steps
            left = {"travel": min(q.min() - low, high - q.max()) / (high - low)}
            if axis.max_feed is not None:
                left["feed"] = 1.0 - (60.0 * np.abs(pace).max() / axis.max_feed) ** 2
            if axis.max_acceleration is not None:
                left["acceleration"] = 1.0 - (np.abs(np.diff(pace) / steps[1:]).max() / axis.max_acceleration) ** 2
            met += [f"the {limit} of {name}" for limit, some in left.items() if some < share]
        edge, (x, y, _) = machine.workspace.table_radius, run.table_ball
        if edge is not None and 1.0 - (math.dist((x, y), machine.table_centre) / edge) ** 2 < share:
            met.append("the edge of the table")
    return list(dict.fromkeys(met))
