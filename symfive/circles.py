"""Which circle a run describes: the angle of each row, its radius, its direction and its feed."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from symfive.arrays import Array, Flags
from symfive.campaign import Run
from symfive.instruments import fitted_parts, has_bar
from symfive.machine import Machine, designed_ball

LEAST_SWEEP = np.radians(60.0)
INSTRUMENTS = ("ball_bar", "grid_encoder")


@dataclass(frozen=True)
class Circle:
    """A circular run. `angle` (N,) rad, unwrapped; `radius` mm; `sense` +1 counter-clockwise, -1 clockwise;
    `over` what the angle is, `marks` the names of 0° and 90° where these are directions of the frame; `feed` with unit.

    The radial deviation of readings `y` (N, ny) is `weights · (y - nominal)` over the instrument's `columns`.
    """

    run: Run
    angle: Array
    radius: float
    sense: int
    over: str
    marks: tuple[str, str] | None
    feed: float
    feed_unit: str
    columns: slice
    weights: Array
    nominal: Array
    normal: tuple[float, ...]

    @property
    def turns(self) -> float:
        """How much of a turn it covers."""
        return float(np.ptp(self.angle) / (2.0 * np.pi))

    @property
    def evaluated(self) -> Flags:
        """Rows (N,) of the complete turns amid the path, without what run-up and run-out go beyond them (ISO 230-4); all rows
        of less than one turn."""
        complete = np.floor(self.turns + 1e-3)
        if complete < 1.0:
            return np.ones(len(self.angle), dtype=bool)
        middle = 0.5 * (self.angle[0] + self.angle[-1])
        return np.asarray(np.abs(self.angle - middle) <= np.pi * complete + 1e-9)

    @property
    def whole(self) -> bool:
        """Whether it covers enough of the circle for its centre to be found."""
        return self.turns > 0.75

    def radial(self, readings: Array) -> Array:
        """Radial deviation (N,), µm, of readings or residuals (N, ny)."""
        return np.asarray(np.sum(self.weights * readings[:, self.columns], axis=1))

    def measured(self, readings: Array) -> Array:
        """Radial deviation (N,), µm, of readings from the commanded circle.

        Where a bar is read, an eccentricity counts by its sine and cosine alone, which a least-squares centre removes: what it
        adds at 2φ, e²/4R, would be a squareness.
        """
        deviation = np.asarray(np.sum(self.weights * (readings[:, self.columns] - self.nominal), axis=1))
        if not has_bar(self.run) or not self.whole:
            return deviation
        return deviation - self._beyond_first_order(deviation)

    def _beyond_first_order(self, deviation: Array) -> Array:
        """What the eccentricity of a bar's pivot adds to the radius beyond its sine and cosine (N,), µm."""
        used, cos, sin = self.evaluated & np.isfinite(deviation), np.cos(self.angle), np.sin(self.angle)
        waves, beyond = np.stack([cos, sin, np.ones_like(cos)], axis=1), np.zeros_like(deviation)
        for _ in range(2):  # the second time by the centre that is left without it
            a, b, _ = np.linalg.lstsq(waves[used], (deviation - beyond)[used], rcond=None)[0]
            along, across = 1e3 * self.radius + a * cos + b * sin, a * sin - b * cos
            beyond = np.hypot(along, across) - along
        return np.asarray(beyond)


class CircleFinder:
    """Finds the circles of a machine's runs from its nominal kinematics."""

    def __init__(self, machine: Machine) -> None:
        self.machine = machine

    def find(self, run: Run) -> Circle | None:
        """The circle of a run of a ball bar or a grid encoder, None where it describes none.

        Where the ball goes round in the workpiece frame its own angle counts, else the coordinate of the axis that
        turns.
        """
        if run.rows < 8 or not set(run.instrument) & set(INSTRUMENTS):
            return None
        name, columns = next(part for part in fitted_parts(run, self.machine) if part[0] in INSTRUMENTS)
        ball = designed_ball(self.machine, run.commands, run.tool_ball)
        arm = ball - np.asarray(run.table_ball) if name == "ball_bar" else ball - _centre(ball)
        turned = _turned(arm)
        if turned is not None:
            return self._around(run, name, columns, ball, arm, *turned)
        return self._turning(run, columns) if name == "ball_bar" else None

    def _around(
        self, run: Run, name: str, columns: slice, ball: Array, arm: Array, angle: Array, frame: Array
    ) -> Circle:
        radius = float(np.median(np.hypot(arm @ frame[0], arm @ frame[1])))
        weights, nominal = np.ones((run.rows, 1)), np.zeros((run.rows, 1))
        if name == "grid_encoder":
            plane = np.stack([np.asarray(run.u, dtype=float), np.asarray(run.v, dtype=float)])
            weights = (arm / np.linalg.norm(arm, axis=1, keepdims=True)) @ plane.T
            nominal = 1e3 * ball @ plane.T
        rotary = any(np.ptp(run.commands[n]) > 1e-9 or run.commands[n][0] for n in self.machine.rotary_axes)
        marks = None if rotary else _marks(frame)
        over = "angle of the bar" if name == "ball_bar" else "angle on the plate"
        speed = np.linalg.norm(np.gradient(ball, run.time, axis=0), axis=1) * 60.0
        normal = tuple(np.round(frame[2], 2).tolist())
        return Circle(run, angle, radius, _sense(angle), over, marks, float(np.median(speed)), "mm/min",
                      columns, weights, nominal, normal)  # fmt: skip

    def _turning(self, run: Run, columns: slice) -> Circle | None:
        spans = {n: float(np.ptp(run.commands[n])) for n, axis in self.machine.axes.items() if axis.rotary}
        name = max(spans, key=lambda n: spans[n], default="")
        if not name or np.radians(spans[name]) < LEAST_SWEEP:
            return None
        axis = self.machine.axes[name]
        angle = np.radians(run.commands[name])
        offset = np.cross(np.asarray(run.table_ball) - np.asarray(axis.origin), np.asarray(axis.direction))
        radius = float(np.linalg.norm(offset))
        radius = radius if radius > 1.0 else float(run.length or 1.0)
        feed = float(np.median(np.abs(np.gradient(run.commands[name], run.time)))) * 60.0
        ones = np.ones((run.rows, 1))
        return Circle(run, angle, radius, _sense(angle), f"coordinate of {name}", None, feed, "°/min",
                      columns, ones, 0.0 * ones, (name,))  # type: ignore[arg-type]  # fmt: skip


def _centre(path: Array) -> Array:
    """The centre of a planar circle by linear least squares (Kåsa 1976)."""
    mean = path.mean(axis=0)
    local = path - mean
    plane = np.linalg.svd(local, full_matrices=False)[2][:2]
    flat = local @ plane.T
    matrix = np.column_stack([2.0 * flat, np.ones(len(flat))])
    solution = np.linalg.lstsq(matrix, np.sum(flat**2, axis=1), rcond=None)[0]
    return np.asarray(mean + solution[:2] @ plane)


def _turned(arm: Array) -> tuple[Array, Array] | None:
    """Angle (N,) of an arm (N, 3) that goes round, and the frame (3, 3) of zero, quarter and axis, else None."""
    area = np.cross(arm[:-1], arm[1:]).sum(axis=0)
    size, length = float(np.linalg.norm(area)), float(np.median(np.linalg.norm(arm, axis=1)))
    if length < 1e-6 or size < 0.1 * length**2 * LEAST_SWEEP:
        return None
    normal = area / size
    main = int(np.argmax(np.abs(normal)))
    normal = normal * np.sign(normal[main])
    zero = np.eye(3)[(main + 1) % 3]
    zero = zero - normal * (zero @ normal)
    zero = zero / np.linalg.norm(zero)
    quarter = np.cross(normal, zero)
    angle = np.unwrap(np.arctan2(arm @ quarter, arm @ zero))
    way = float(np.sum(np.abs(np.diff(angle))))
    if way < LEAST_SWEEP or abs(angle[-1] - angle[0]) < 0.9 * way:
        return None
    return angle, np.stack([zero, quarter, normal])


def _marks(frame: Array) -> tuple[str, str] | None:
    names = []
    for vector in frame[:2]:
        i = int(np.argmax(np.abs(vector)))
        if abs(vector[i]) < 0.999:
            return None
        names.append(("+" if vector[i] > 0 else "−") + "XYZ"[i])
    return names[0], names[1]


def _sense(angle: Array) -> int:
    return 1 if angle[-1] >= angle[0] else -1


def grouped(circles: Sequence[Circle]) -> list[list[Circle]]:
    """Circles of the same place, radius and feed together: both directions and their repetitions."""
    groups: list[list[Circle]] = []
    for circle in circles:
        home = next((group for group in groups if _same(group[0], circle)), None)
        if home is None:
            groups.append([circle])
        else:
            home.append(circle)
    return groups


def _same(a: Circle, b: Circle) -> bool:
    place = np.allclose(a.run.table_ball, b.run.table_ball, atol=1e-3) and np.isclose(a.radius, b.radius, atol=1e-2)
    alike = (a.over, a.normal, a.run.sampling) == (b.over, b.normal, b.run.sampling)
    feed = not a.run.dynamic or np.isclose(a.feed, b.feed, rtol=0.05)
    return bool(place and alike and feed)
