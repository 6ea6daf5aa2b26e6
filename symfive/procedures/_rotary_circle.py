"""A rotary axis turning with the ball bar radial, tangential or axial to it (ISO 230-4 Annex C, ISO 10791-6
BK)."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from symfive.arrays import Array
from symfive.campaign import Run, SetupSigma
from symfive.errors import InputError, among
from symfive.machine import Axis, Machine
from symfive.procedures._limits import checked
from symfive.procedures._nominal import Commands, Nominal
from symfive.procedures._path import DIRECTIONS, along, check_spacing, senses
from symfive.procedures._setting import (
    BALL_SETUP,
    Vector,
    bar_length,
    one_after_another,
    table_ball_of,
    tool_ball_of,
    turning_axis,
    vector,
    whole_turn,
)

ARRANGEMENTS = ("radial", "tangential", "axial")
ON_AXIS_MM = 1e-6


def rotary_circle(
    machine: Machine, *, axis: str | None = None, arrangement: str = "radial", linear: str = "following",
    length: float | None = None, table_ball: Sequence[float] | None = None, tool_ball: Sequence[float] | None = None,
    start_deg: float | None = None, end_deg: float | None = None, run_up_deg: float = 15.0, feed: float = 1800.0,
    direction: str = "both", hold: Mapping[str, float] | None = None, rate_hz: float = 50.0, noise_um: float = 0.3,
    setup_sigma_um: SetupSigma = BALL_SETUP,
) -> tuple[Run, ...]:  # fmt: skip
    """One rotary axis of the table or the head turns from `start_deg` to `end_deg`, one run per direction.

    `linear="following"`: the linear axes carry the tool ball around with it, so the bar (of `length` mm)
    keeps its direction to the axis: `radial`, `tangential` or `axial`. `linear="standing"`: they rest. Then
    either the ball that the axis carries is off the axis and the other one on it (radial; the length of the bar
    is the ball's distance from the axis, paper 1, (14)-(15)), or it is on the axis and the bar keeps its
    direction in the machine frame (paper 1, (16)-(18)). `table_ball` mm in the workpiece frame, by default
    within the workspace; `feed` degree/min; `hold` the positions of the other axes; `run_up_deg` is added at
    both ends. Raises `InputError` where an axis cannot follow.
    """
    among(arrangement, ARRANGEMENTS, f'arrangement "{arrangement}" is unknown')
    if linear not in ("following", "standing"):
        raise InputError(f'linear "{linear}" is unknown', remedy='use "following" or "standing"')
    name = turning_axis(machine, axis)
    first, last = _range(machine.axes[name], start_deg, end_deg, run_up_deg)
    reach = float(np.radians(last - first + 2.0 * run_up_deg))
    speed = float(np.radians(feed / 60.0))
    time, turned = along(reach, speed, float(np.radians(run_up_deg)), rate_hz)
    way = np.degrees(turned)
    geometry = _Geometry(machine, name, dict(hold or {}), tool_ball_of(machine, tool_ball))
    following = linear == "following"
    ball = geometry.table_ball(table_ball, arrangement, following, bar_length(machine, length))
    size = geometry.length(ball, arrangement, following, length, bar_length(machine, length))
    runs = []
    for sense in senses(direction):
        angle = first - run_up_deg + way if DIRECTIONS[sense] > 0 else last + run_up_deg - way
        what = f"{arrangement} circle of {name}"
        commands = geometry.commands(angle, ball, size, arrangement, following, what)
        run = Run(
            id=f"{name.lower()}-{arrangement}-{linear}-{sense}", instrument=("ball_bar",), sampling="dynamic",
            time=time, commands=commands, table_ball=ball, tool_ball=geometry.tool_ball, length=size, noise_um=noise_um,
            setup_sigma_um=setup_sigma_um,
        )  # fmt: skip
        place = "start_deg, end_deg, run_up_deg, the table ball or the tool length"
        runs.append(checked(machine, run, feed=feed, unit="degree/min", place=place))
    check_spacing(speed, rate_hz)
    return one_after_another(runs)


def _range(axis: Axis, start: float | None, end: float | None, run_up: float) -> tuple[float, float]:
    low, high = axis.travel[0] + run_up, axis.travel[1] - run_up
    once_around = whole_turn(axis) and low <= 0.0 and high >= 360.0
    first = start if start is not None else 0.0 if once_around else max(low, -90.0)
    last = end if end is not None else 360.0 if once_around else min(high, first + 180.0)
    if first >= last:
        raise InputError(f"axis {axis.name} would turn from {first:g}° to {last:g}°", remedy="give start_deg < end_deg")
    return first, last


@dataclass
class _Geometry:
    """Where axis and balls lie in the machine frame while one rotary axis turns and the others are held."""

    machine: Machine
    axis: str
    hold: dict[str, float | Array]
    tool_ball: Vector

    def __post_init__(self) -> None:
        self.nominal = Nominal(self.machine)
        self.on_table = self.machine.structure.carries(self.axis) == "workpiece"
        self.point, self.along = self.nominal.axis_line(self.axis, self.hold)
        self.zero = self.nominal.commands(self.hold, 1)
        self.rotation = self.nominal.workpiece_rotation(self.zero)[0]

    def radius(self, ball: Vector) -> tuple[Array, float]:
        """Direction from the axis to the ball that it carries, in the machine frame at the zero pose, and
        distance, mm.

        For a ball on the axis the direction is the first of the machine's x, y, z that leads away from the
        axis.
        """
        carried = np.asarray(ball) if self.on_table else self.nominal.ball(self.zero, self.tool_ball)[0]
        offset = self.nominal.workpiece_origin(self.zero)[0] + self.rotation @ carried - self.point
        across = offset - (offset @ self.along) * self.along
        distance = float(np.linalg.norm(across))
        if distance < ON_AXIS_MM:
            tries = np.eye(3) - np.outer(self.along, self.along)
            across = next(row for row in tries if np.linalg.norm(row) > 0.5)
        return across / np.linalg.norm(across), distance if distance >= ON_AXIS_MM else 0.0

    def table_ball(self, wanted: Sequence[float] | None, arrangement: str, following: bool, length: float) -> Vector:
        """The wanted table ball or one on the table that suits the arrangement."""
        middle = table_ball_of(self.machine, wanted)
        if wanted is not None or not self.on_table:
            return middle
        direction, distance = self.radius(middle)
        if distance > 0.0:
            return middle
        away = 0.0
        if following:
            away = (self.machine.workspace.table_radius or 150.0) / 2.0
        elif arrangement == "radial":
            away = length
        return vector(np.asarray(middle) + away * (self.rotation.T @ direction))

    def length(self, ball: Vector, arrangement: str, following: bool, wanted: float | None, usual: float) -> float:
        """The bar's length, mm. With resting linear axes and a ball off the axis it is the ball's distance
        from it."""
        _, distance = self.radius(ball)
        if following or distance == 0.0:
            return usual
        carried = "table ball" if self.on_table else "tool ball"
        if arrangement != "radial":
            problem = (
                f"the {carried} stands {distance:.6g} mm off axis {self.axis}: a resting bar cannot stay {arrangement}"
            )
            raise InputError(problem, remedy='put it on the axis or choose linear = "following"')
        if wanted is not None and abs(wanted - distance) > ON_AXIS_MM:
            problem = f"the {carried} stands {distance:.6g} mm off axis {self.axis}, the bar is {wanted:g} mm long"
            raise InputError(problem, remedy="make the two equal, or leave the length out")
        return distance

    def commands(
        self, angle: Array, ball: Vector, length: float, arrangement: str, following: bool, what: str
    ) -> Commands:
        """Commands of all axes while this one goes through `angle` (N,) degree."""
        outward = 1.0 if self.on_table else -1.0
        direction, distance = self.radius(ball)
        if following:
            turned: dict[str, float | Array] = {**self.hold, self.axis: angle}
            commands = self.nominal.commands(turned, len(angle))
            bar = outward * length * self._turned(direction, arrangement, commands)
            target = np.asarray(ball) + self.nominal.seen_from_workpiece(commands, bar)
            return self.nominal.follow(target, self.tool_ball, turned, what)
        inward = -1.0 if distance > 0.0 else 1.0
        bar = inward * outward * length * self._turned(direction, arrangement, self.zero)
        target = np.asarray(ball) + self.nominal.seen_from_workpiece(self.zero, bar)
        rest = self.nominal.follow(target, self.tool_ball, self.hold, what)
        commands = self.nominal.commands({name: values[0] for name, values in rest.items()}, len(angle))
        commands[self.axis] = np.array(angle)
        reached = np.linalg.norm(self.nominal.ball(commands, self.tool_ball) - np.asarray(ball), axis=1)
        if np.abs(reached - length).max() > ON_AXIS_MM:
            problem = f"{what}: with resting linear axes the bar would change by {np.ptp(reached):.3g} mm"
            raise InputError(problem, remedy='choose linear = "following" or another table ball')
        return commands

    def _turned(self, direction: Array, arrangement: str, commands: Commands) -> Array:
        """The arrangement's direction (N, 3), machine frame, as it turns with what the axis carries."""
        rotation = self.nominal.workpiece_rotation if self.on_table else self.nominal.tool_rotation
        turn = rotation(commands) @ rotation(self.zero)[0].T
        radial = turn @ direction
        if arrangement == "radial":
            return np.asarray(radial)
        if arrangement == "tangential":
            return np.cross(self.along, radial)
        # the tool's ball stands over the table's, whichever of them turns
        up = round(float(self.along[2]), 9) * (1.0 if self.on_table else -1.0)
        return np.broadcast_to(-self.along if up < 0.0 else self.along, radial.shape)
