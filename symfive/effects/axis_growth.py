"""Growth of a linear axis as its screw or scale warms up: a scale error that comes with time (ISO 230-3)."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Any, Self

import numpy as np

from symfive.arrays import Array
from symfive.effects._base import Effect
from symfive.effects._form import Forms, positioned
from symfive.effects._quantity import Covariance, Quantity, Values, propagated
from symfive.errors import InputError
from symfive.motion import Position
from symfive.parameters import Parameter
from symfive.row import Row
from symfive.runs import Campaign

SHAPES = ("exponential", "linear")
PPM = 20.0
"""1σ of the growth: a steel screw (11.5 ppm/K) that is some two kelvins warmer than its scale."""


@dataclass(frozen=True, kw_only=True)
class AxisGrowth(Effect):
    """q → q + growth·(q - held)·g(t), t on the campaign's clock.

    `shape`: `exponential`, g = 1 - exp(-t/time_constant_s); `linear`, g = t/span_s, of which only the first part is seen and
    `span_s` is how long the campaign runs. A screw or scale grows away from where it is `held`, anywhere on the travel: a shift
    that is the same everywhere is no growth, but a drift of the tool. Typical 10–100 µm/h at the free end of a steel screw, τ of
    5–60 min.
    """

    id = "axis_growth"
    stage = "axis"
    over_time = True
    says = "the axis grows as its screw or scale warms up"
    hidden_by = "a drift of the tool along the axis, where all positions are close together; the other axes' growth in a ball bar"
    action = "warm the axis up before you measure or machine; enter thermal compensation of the axis in the control"
    coordinate = "{axis}, t"
    reported_as = "thermal_drift"
    needs_axis = True
    choices = (("shape", SHAPES),)
    shape: str = "exponential"
    span_s: float = 0.0

    def prepare(self, campaign: Campaign) -> Self:
        if super().prepare(campaign).its_axis(campaign).rotary:
            raise InputError(f"{self.key}: a rotary axis does not grow along its way", remedy="use axis_turn")
        return self.timed(campaign)

    def timed(self, campaign: Campaign) -> Self:
        """With its time taken from the campaign."""
        if not 0.0 <= self.span_s < math.inf:
            raise InputError(
                f"{self.key}: span_s = {self.span_s} is no time", remedy="write span_s = …, in s, or leave it out"
            )
        if self.shape != "linear":
            return replace(self, span_s=0.0)
        return replace(self, span_s=self.span_s or self.clock_span(campaign))

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

    def grown(self, row: Row) -> Any:
        """g(t)."""
        return row.clock / self.span_s if self.shape == "linear" else self.risen(row, row.clock)

    def describe(self, campaign: Campaign, values: Values, covariance: Covariance) -> dict[str, Quantity]:
        """Its parameters, `held` as a position of the axis, and `reached`, the growth at the end of the campaign: well known
        where growth and time constant are not, because only the first part of the rise was seen."""
        found = super().describe(campaign, values, covariance)
        held = found["held"]
        assert isinstance(held.value, float)
        found["held"] = replace(held, value=self.its_axis(campaign).travel[0] + held.value)
        return {**found, "reached": self.reached(campaign, values, covariance)}

    def reached(self, campaign: Campaign, values: Values, covariance: Covariance) -> Quantity:
        """Its first parameter as far as it has come at the end of the campaign."""
        end, own = self.clock_span(campaign), self.parameters(campaign)

        def size(p: Array) -> float:
            return float(p[0] * (end / self.span_s if self.shape == "linear" else 1.0 - np.exp(-end / p[-1])))

        return propagated(size, [p.name for p in own], own[0].unit, values, covariance)
