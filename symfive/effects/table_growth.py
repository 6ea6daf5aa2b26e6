"""Table growth: a rotary table, or what stands on it, warms and carries the ball away with it (ISO 230-3)."""

from __future__ import annotations

from dataclasses import dataclass

import casadi as ca

from symfive.effects._base import Campaign, Covariance, Forms, Parameter, Quantity, Row, Values
from symfive.effects._warming import Rising


@dataclass(frozen=True, kw_only=True)
class TableGrowth(Rising):
    """table ball → table ball + (ε·(x - x_c), ε·(y - y_c), rise)·(1 - exp(-t/time_constant_s)) in the workpiece frame,
    ε the `expansion`, (x_c, y_c) the table's centre, t on the campaign's clock.

    It turns with the table, where a drift of the structure does not; on a machine whose table does not turn it is a
    `thermal_drift`. Typical 5–40 µm with 5–60 min; steel grows by 11.5 µm/m a kelvin.
    """

    id = "table_growth"
    over_time = True
    says = "the table, or the post on it, grows as it warms and carries the ball away"
    hidden_by = "the table ball's position, a location error, the bar's length"
    action = "warm the rotary table up before you measure or machine; steady the temperature of what stands on it"
    coordinate = "t"
    reported_as = "thermal_drift"

    @classmethod
    def candidates(cls, campaign: Campaign) -> Forms:
        # where no rotary axis turns the table it is a drift of the structure
        if any(campaign.machine.axes[axis].rotary for axis in campaign.machine.structure.workpiece):
            yield from cls().at_time_constants(campaign)

    def parameters(self, campaign: Campaign) -> tuple[Parameter, ...]:
        tau = 0.5 * self.clock_span(campaign)
        return (self.own("rise", "um", 20.0), self.own("expansion", "ppm", 20.0), self.time_constant(tau))

    def apply(self, row: Row) -> None:
        x, y = row.machine.table_centre
        expansion = self.parameter(row, "expansion")
        grown = ca.vertcat(
            expansion * (row.table_ball[0] - x), expansion * (row.table_ball[1] - y), self.parameter(row, "rise")
        )
        row.table_ball += grown * self.risen(row, row.clock)

    def describe(self, campaign: Campaign, values: Values, covariance: Covariance) -> dict[str, Quantity]:
        """`direction` of the rise in the workpiece frame."""
        return {"direction": Quantity((0.0, 0.0, 1.0), None, "1"), **super().describe(campaign, values, covariance)}
