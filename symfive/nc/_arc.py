"""The circle that a recording is, if it is one: two linear axes move, all others rest.

It is the one that the control interpolates, in the axes' words. The circle of the ball in the workpiece frame, whichever axes
drive it, is `symfive.circles`'.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from symfive.campaign import Run
from symfive.machine import Machine
from symfive.procedures import PLANES, feed_in

SAME_MM = 1e-5
"""What moves by less stands still, and lies on the circle: positions in a file have six decimals."""
LEAST_RAD = 0.1


@dataclass(frozen=True, kw_only=True)
class Circle:
    """A run's path as the control's circular interpolator drives it.

    `plane` two axes, positive sense from the first to the second; `centre` of the two, `radius` mm; `start` and `sweep` degree,
    negative clockwise, overshoot included; `out` mm by which a bar is pulled out at either end; `feed` mm/min between getting up
    to speed and coming to rest; `way` the rows at which it is looked at, a degree apart at most.
    """

    plane: str
    centre: Mapping[str, float]
    radius: float
    start: float
    sweep: float
    out: float
    feed: float
    way: tuple[int, ...]

    @property
    def seconds(self) -> float:
        """Time at the feed, s."""
        return float(np.radians(abs(self.sweep)) * self.radius / self.feed * 60.0)

    def at(self, angle: float, radius: float) -> dict[str, float]:
        """Positions of the two axes at an angle in degree and a distance from the centre in mm."""
        phi = np.radians(angle)
        return {n: self.centre[n] + radius * float(f(phi)) for n, f in zip(self.plane, (np.cos, np.sin), strict=True)}


def circle_of(machine: Machine, run: Run) -> Circle | None:
    """The circle of a recording in a plane of the axes X, Y and Z; None where it is something else."""
    moving = {name for name, q in run.commands.items() if np.ptp(q) > SAME_MM}
    plane = next((plane for plane in PLANES if set(plane) == moving), None)
    if not run.dynamic or plane is None or any(machine.axes[name].rotary for name in plane):
        return None
    a, b = (run.commands[name] for name in plane)
    columns = np.stack([2.0 * a, 2.0 * b, np.ones(run.rows)], axis=1)
    x, y, _ = np.linalg.lstsq(columns, a**2 + b**2, rcond=None)[0]  # (a-x)^2 + (b-y)^2 = r^2
    x, y = round(float(x), 6) + 0.0, round(float(y), 6) + 0.0
    size = np.hypot(a - x, b - y)
    radius = round(float(np.mean(size)), 6)
    phi = np.unwrap(np.arctan2(b - y, a - x))
    steps, sweep = np.diff(phi), float(phi[-1] - phi[0])
    if np.ptp(size) > SAME_MM or abs(sweep) < LEAST_RAD or np.any(steps * sweep < -SAME_MM / radius * abs(sweep)):
        return None
    speed = float(np.max(np.abs(steps) / np.diff(run.time))) * radius * 60.0
    marks = np.floor(np.degrees(np.abs(phi - phi[0])) + 1e-9)
    way = np.flatnonzero(np.diff(marks, prepend=-1.0))
    return Circle(
        plane=plane, centre={plane[0]: x, plane[1]: y}, radius=radius, start=_neat(phi[0]), sweep=_neat(sweep),
        out=feed_in(machine), feed=float(f"{speed:.6g}"), way=tuple(dict.fromkeys([*way[1:].tolist(), run.rows - 1])),
    )  # fmt: skip


def _neat(angle: float) -> float:
    return round(float(np.degrees(angle)), 6) + 0.0
