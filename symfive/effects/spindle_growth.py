"""Spindle growth: the running spindle warms and grows along its axis (ISO 230-3, ETVE and spindle test)."""

from __future__ import annotations

from dataclasses import dataclass

import casadi as ca

from symfive.effects._base import Campaign, Covariance, Forms, Parameter, Quantity, Row, Values
from symfive.effects._warming import Rising


@dataclass(frozen=True, kw_only=True)
class SpindleGrowth(Rising):
    """tool ball → tool ball - (0, 0, amplitude·(1 - exp(-t/time_constant_s))) in the tool frame, t on the
    campaign's clock.

    It follows a swivelling head, where a drift of the structure does not; on a machine whose spindle only
    moves straight it is a `thermal_drift` along z. Typical 10–60 µm with 5–60 min.
    """

    id = "spindle_growth"
    over_time = True
    says = "the spindle grows along its axis as it warms"
    hidden_by = "the tool ball's height, a location error along the spindle, the bar's length"
    action = "warm the spindle up before you measure or machine; enter its thermal compensation in the control"
    coordinate = "t"
    reported_as = "thermal_drift"

    @classmethod
    def candidates(cls, campaign: Campaign) -> Forms:
        # where no rotary axis turns the spindle it is a drift along z
        if any(campaign.machine.axes[axis].rotary for axis in campaign.machine.structure.tool):
            yield from cls().at_time_constants(campaign)

    def parameters(self, campaign: Campaign) -> tuple[Parameter, ...]:
        tau = 0.5 * self.clock_span(campaign)
        return (self.own("amplitude", "um", 20.0), self.time_constant(tau))

    def apply(self, row: Row) -> None:
        growth = self.parameter(row, "amplitude") * self.risen(row, row.clock)
        row.tool_ball -= ca.vertcat(0.0, 0.0, growth)

    def describe(self, campaign: Campaign, values: Values, covariance: Covariance) -> dict[str, Quantity]:
        """`direction` in the tool frame."""
        return {"direction": Quantity((0.0, 0.0, -1.0), None, "1"), **super().describe(campaign, values, covariance)}
