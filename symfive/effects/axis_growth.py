"""Growth of a linear axis as its screw or scale warms up: a scale error that comes with time (ISO 230-3)."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Self

import numpy as np

from symfive.effects._axes import positioned
from symfive.effects._base import Campaign, Covariance, Forms, Parameter, Quantity, Row, Values
from symfive.effects._warming import AxisWarming
from symfive.errors import InputError
from symfive.motion import Position

PPM = 20.0
"""1σ of the growth: a steel screw (11.5 ppm/K) that is some two kelvins warmer than its scale."""


@dataclass(frozen=True, kw_only=True)
class AxisGrowth(AxisWarming):
    """q → q + growth·(q - held)·g(t), t on the campaign's clock.

    g and `shape` as of any `AxisWarming`: a rise with its time constant, or in proportion to t. A screw or scale grows away from
    where it is `held`, anywhere on the travel: a shift that is the same everywhere is no growth, but a drift of the tool. Typical
    10–100 µm/h at the free end of a steel screw, τ of 5–60 min.
    """

    id = "axis_growth"
    says = "the axis grows as its screw or scale warms up"
    hidden_by = "a drift of the tool along the axis, where all positions are close together; the other axes' growth in a ball bar"
    action = "warm the axis up before you measure or machine; enter thermal compensation of the axis in the control"
    terms = (("growth", ""), ("held", "fixed point"))
    coordinate = "{axis}, t"

    def prepare(self, campaign: Campaign) -> Self:
        effect = super().prepare(campaign)
        if self.its_axis(campaign).rotary:
            raise InputError(f"{self.key}: a rotary axis has no length that grows", remedy="use axis_turn")
        return effect

    @classmethod
    def candidates(cls, campaign: Campaign) -> Forms:
        """Of axes that a positioning test measures: elsewhere it takes the place of any drift of the tool along an axis."""
        for axis in positioned(campaign):
            if axis in campaign.machine.linear_axes:
                effect = cls(axis=axis)
                for form in effect.at_time_constants(campaign, cls(axis=axis, shape="linear")):
                    yield form
                    for end in (0.0, np.ptp(effect.its_axis(campaign).travel)):
                        yield replace(form, at={**form.at, f"{effect.key}.held": float(end)})

    def parameters(self, campaign: Campaign) -> tuple[Parameter, ...]:
        way = float(np.ptp(self.its_axis(campaign).travel))
        # anywhere on the travel, counted from its lower end
        held = self.own("held", "mm", way / math.sqrt(12.0), mean=0.5 * way)
        found = (self.own("growth", "ppm", PPM), held)
        return found if self.shape == "linear" else (*found, self.time_constant(0.5 * self.clock_span(campaign)))

    def apply(self, row: Row) -> None:
        axis = str(self.axis)
        far = row.signal(Position(axis)) - row.machine.axes[axis].travel[0] - self.parameter(row, "held")
        row.axis[axis] += self.parameter(row, "growth") * far * self.grown(row)

    def describe(self, campaign: Campaign, values: Values, covariance: Covariance) -> dict[str, Quantity]:
        """Its parameters, `held` as a position of the axis, and `reached`, the growth at the end of the campaign."""
        found = super().describe(campaign, values, covariance)
        held = found["held"]
        assert isinstance(held.value, float)
        return {**found, "held": replace(held, value=self.its_axis(campaign).travel[0] + held.value)}
