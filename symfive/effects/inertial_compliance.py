"""Inertial compliance: deflection proportional to an axis' acceleration (cross-talk compensation of controls)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import casadi as ca

from symfive.effects._base import Effect
from symfive.effects._quantity import Covariance, Quantity, Values, length_and_direction, seen_length
from symfive.motion import Acceleration
from symfive.parameters import Parameter

if TYPE_CHECKING:
    from symfive.campaign import Campaign
    from symfive.model._row import Row
    from symfive.motion import Signal


@dataclass(frozen=True, kw_only=True)
class InertialCompliance(Effect):
    """shift of the tool = compliance·a in the machine frame, a the acceleration of the axis, three
    components.

    µm per m/s² (linear) or per rad/s² (rotary axis). Typical 1–10 µm per m/s².
    """

    id = "inertial_compliance"
    says = "deflection proportional to an axis' acceleration"
    hidden_by = "squareness and scale at one feed (all of it), a missing acceleration feed-forward at two"
    needs_axis = True
    dynamic_only = True

    @property
    def _names(self) -> tuple[str, ...]:
        return tuple(f"{self.key}.compliance.{c}" for c in "xyz")

    def _unit(self, campaign: Campaign) -> str:
        return "um/(rad/s^2)" if self.its_axis(campaign).rotary else "um/(m/s^2)"

    def parameters(self, campaign: Campaign) -> tuple[Parameter, ...]:
        return tuple(self.own(f"compliance.{c}", self._unit(campaign), 5.0) for c in "xyz")

    def signals(self) -> tuple[Signal, ...]:
        return (Acceleration(str(self.axis)),)

    def apply(self, row: Row) -> None:
        row.shift += ca.vertcat(*(row.parameter(name) for name in self._names)) * row.signal(self.signals()[0])

    def describe(self, campaign: Campaign, values: Values, covariance: Covariance) -> dict[str, Quantity]:
        unit = self._unit(campaign)
        compliance, direction = length_and_direction(self._names, unit, values, covariance)
        seen = seen_length(self._names, unit, values, covariance)
        return {"compliance": compliance, "direction": direction, **seen}
