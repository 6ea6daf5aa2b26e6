"""One row of a run, symbolically: what effects and instruments see and change while the model is put together."""

from __future__ import annotations

from collections.abc import Mapping
from functools import cached_property
from typing import Any

import casadi as ca

from symfive.kinematics import Pose, ball_in_workpiece, chain_poses
from symfive.machine import Machine
from symfive.motion import Signal, SpindleAngle
from symfive.runs import Column

Symbol = Any


class Row:
    """The symbols of one row, all in mm, rad, s.

    `clock` is the campaign's, `time` the run's own (`Run.course`: of a run without a clock the row's number).
    `axis` coordinate of each axis; axis effects (play, worm error) change it in place. `location` and `motion` errors
    by ISO 230-1 name; structural effects add to them with `add_motion`. `shift` displacement of the tool in the
    machine frame; `table_ball` (workpiece frame) and `tool_ball` (tool frame) with their set-up errors. `ball` is the
    tool ball in the workpiece frame. It is computed when first asked for, which an instrument does after all effects
    on axes and structure have been applied; `readings` are what the instruments read, changed by reading effects:
    `columns` what they are, `sources` whose they are and `sensed` the indices of those that the control does not
    record.
    """

    def __init__(
        self, machine: Machine, axis: Mapping[str, Symbol], clock: Symbol, time: Symbol,
        signals: Mapping[Signal, Symbol], parameters: Mapping[str, Symbol], constants: Mapping[str, Symbol],
    ) -> None:  # fmt: skip
        self.machine = machine
        self.axis = dict(axis)
        self.clock = clock
        self.time = time
        self.location: dict[str, Symbol] = {}
        self.motion: dict[str, Symbol] = {}
        self.shift = ca.SX(3, 1)
        self.readings: list[Symbol] = []
        self.columns: tuple[Column, ...] = ()
        self.sources: tuple[str, ...] = ()
        self.sensed: tuple[int, ...] = ()
        self._signals = signals
        self._parameters = parameters
        self._constants = constants
        self.table_ball = self.vector("table_ball") + self.setup("table_ball")
        self.tool_ball = self.vector("tool_ball") + self._turned(self.setup("tool_ball"))

    def signal(self, signal: Signal) -> Symbol:
        """The value of a signal that the effect or instrument has declared."""
        return self._signals[signal]

    def parameter(self, name: str) -> Symbol:
        """A parameter in internal units; a run's own ones are named without the run, as `setup.length`."""
        return self._parameters[name]

    def has(self, name: str) -> bool:
        """Whether the parameter exists in this run."""
        return name in self._parameters

    def constant(self, name: str) -> Symbol:
        """A number of the run, as `length`."""
        return self._constants[name]

    def vector(self, name: str) -> Symbol:
        """A constant with three components, `name.x` … (zero where the run has none)."""
        return ca.vertcat(*(self._constants.get(f"{name}.{c}", ca.SX(0)) for c in "xyz"))

    def setup(self, name: str) -> Symbol:
        """A set-up error with three components, `setup.name.x` … (zero where the run has none)."""
        return ca.vertcat(*(self._parameters.get(f"setup.{name}.{c}", ca.SX(0)) for c in "xyz"))

    def _turned(self, offset: Symbol) -> Symbol:
        """An offset of what the spindle holds, in the tool frame, by the spindle's angle; z is its axis."""
        angle = self._signals.get(SpindleAngle())
        if angle is None:
            return offset
        c, s = ca.cos(angle), ca.sin(angle)
        return ca.vertcat(c * offset[0] - s * offset[1], s * offset[0] + c * offset[1], offset[2])

    def add_motion(self, name: str, value: Symbol) -> None:
        """Add to an error motion (mm or rad)."""
        self.motion[name] = self.motion.get(name, ca.SX(0)) + value

    def add_reading(self, instrument: str, value: Symbol) -> None:
        """Add to every reading of an instrument (internal units)."""
        for i, source in enumerate(self.sources):
            if source == instrument:
                self.readings[i] += value

    @cached_property
    def ball(self) -> Symbol:
        """The tool ball in the workpiece frame, mm."""
        return self.ball_at(self.tool_ball)

    def ball_at(self, tool_ball: Symbol) -> Symbol:
        """A ball that stands elsewhere in the tool frame (mm), in the workpiece frame, mm."""
        return ball_in_workpiece(
            self.machine, self.axis, tool_ball, location=self.location, motion=self.motion, shift=self.shift
        )

    @cached_property
    def poses(self) -> tuple[Pose, Pose]:
        """(W, T) of the real machine, without `shift`."""
        return chain_poses(self.machine, self.axis, self.location, self.motion)

    def nominal_poses(self, position: Mapping[str, Symbol]) -> tuple[Pose, Pose]:
        """(W, T) of the machine without errors at other axis positions (mm, rad)."""
        return chain_poses(self.machine, position, {}, {})
