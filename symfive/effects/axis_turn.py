"""Drift of a rotary axis in its own angle, against the polygon or the indexer, as table and encoder warm up (ISO 230-3)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Self

from symfive.effects._axes import positioned
from symfive.effects._base import Campaign, Forms, Parameter, Row
from symfive.effects._warming import AxisWarming
from symfive.errors import InputError

TURN = 50.0
"""1σ, µrad: a drift of 5 µm at a radius of 100 mm."""


@dataclass(frozen=True, kw_only=True)
class AxisTurn(AxisWarming):
    """q → q + turn·g(t), t on the campaign's clock.

    g and `shape` as of any `AxisWarming`. An instrument that reads angles does not see `thermal_drift`, which shifts the tool.
    Typical 10–100 µrad, τ of 5–60 min.
    """

    id = "axis_turn"
    says = "the angle of a rotary axis drifts with time"
    hidden_by = "backlash and a slow wave over the axis, where it goes through its targets once"
    action = "let axis and instrument warm up, then repeat the test"
    terms = (("turn", ""),)
    coordinate = "t"

    def prepare(self, campaign: Campaign) -> Self:
        effect = super().prepare(campaign)
        if not self.its_axis(campaign).rotary:
            raise InputError(f"{self.key}: a linear axis does not turn", remedy="use axis_growth or thermal_drift")
        return effect

    @classmethod
    def candidates(cls, campaign: Campaign) -> Forms:
        """Of axes whose angle a positioning test measures."""
        for axis in positioned(campaign):
            if axis not in campaign.machine.linear_axes:
                yield from cls(axis=axis).at_time_constants(campaign, cls(axis=axis, shape="linear"))

    def parameters(self, campaign: Campaign) -> tuple[Parameter, ...]:
        turn = self.own("turn", "urad", TURN)
        return (turn,) if self.shape == "linear" else (turn, self.time_constant(0.5 * self.clock_span(campaign)))

    def apply(self, row: Row) -> None:
        row.axis[str(self.axis)] += self.parameter(row, "turn") * self.grown(row)
