"""Inertial compliance: deflection proportional to an axis' acceleration (cross-talk compensation of controls)."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Self

import casadi as ca
import numpy as np

from symfive.effects._axes import moving
from symfive.effects._base import Campaign, Covariance, Effect, Form, Forms, Parameter, Quantity, Row, Values
from symfive.effects._quantity import length_and_direction, own_quantity, seen_length
from symfive.machine import Axis
from symfive.motion import Acceleration, Signal

FEWEST = 3
SHAPES = ("linear", "softening")


@dataclass(frozen=True, kw_only=True)
class InertialCompliance(Effect):
    """shift of the tool = compliance·a in the machine frame, a the acceleration of the axis, three
    components.

    µm per m/s² (linear) or per rad/s² (rotary axis). Typical 1–10 µm per m/s². `shape`: `linear`, or `softening`,
    a/√(1 + (a/knee)²), where something slips or ends at a stop; the prior of the knee is about `usual`, the
    amplitude of what was commanded (mm/s² or rad/s²).
    """

    id = "inertial_compliance"
    says = "deflection proportional to an axis' acceleration"
    hidden_by = "squareness and scale at one feed (all of it), a missing acceleration feed-forward at two"
    action = "reduce acceleration or jerk for accurate contours; check the stiffness of the axis and the mounting of its scale"
    coordinate = "{axis} acceleration"
    needs_axis = True
    dynamic_only = True
    choices = (("shape", SHAPES),)
    shape: str = "linear"
    usual: float = 0.0

    def prepare(self, campaign: Campaign) -> Self:
        prepared = super().prepare(campaign)
        if self.shape == "linear" or self.usual:
            return prepared
        return replace(prepared, usual=commanded_acceleration(campaign, self.its_axis(campaign)))

    @property
    def _names(self) -> tuple[str, ...]:
        return tuple(f"{self.key}.compliance.{c}" for c in "xyz")

    def _unit(self, campaign: Campaign) -> str:
        return "um/(rad/s^2)" if self.its_axis(campaign).rotary else "um/(m/s^2)"

    @classmethod
    def candidates(cls, campaign: Campaign) -> Forms:
        for axis in moving(campaign):
            yield Form(effect=cls(axis=axis), shapes=tuple(cls(axis=axis, shape=shape) for shape in SHAPES[1:]))

    def parameters(self, campaign: Campaign) -> tuple[Parameter, ...]:
        found = tuple(self.own(f"compliance.{c}", self._unit(campaign), 5.0) for c in "xyz")
        if self.shape == "linear":
            return found
        unit = "rad/s^2" if self.its_axis(campaign).rotary else "mm/s^2"
        return (*found, self.own("knee", unit, self.usual, mean=self.usual, lower=0.02 * self.usual))

    def signals(self) -> tuple[Signal, ...]:
        return (Acceleration(str(self.axis)),)

    def apply(self, row: Row) -> None:
        a = row.signal(self.signals()[0])
        if self.shape == "softening":
            a /= ca.sqrt(1.0 + (a / self.parameter(row, "knee")) ** 2)
        row.shift += ca.vertcat(*(row.parameter(name) for name in self._names)) * a

    def describe(self, campaign: Campaign, values: Values, covariance: Covariance) -> dict[str, Quantity]:
        unit = self._unit(campaign)
        compliance, direction = length_and_direction(self._names, unit, values, covariance)
        seen = seen_length(self._names, unit, values, covariance)
        found = {"compliance": compliance, "direction": direction, **seen}
        for p in self.parameters(campaign)[len(self._names) :]:
            found["knee"] = own_quantity(p, values, covariance)
        return found


def commanded_acceleration(campaign: Campaign, axis: Axis) -> float:
    """The amplitude that a sine with the mean square of an axis' commanded acceleration has, mm/s² or rad/s²."""
    square, rows = 0.0, 0
    for run in campaign.runs:
        if run.dynamic and run.rows > FEWEST:
            change = np.gradient(np.gradient(run.commands[axis.name], run.time), run.time) * axis.to_internal
            square, rows = square + float(np.sum(change**2)), rows + run.rows
    return float(np.sqrt(2.0 * square / max(rows, 1))) or 1.0
