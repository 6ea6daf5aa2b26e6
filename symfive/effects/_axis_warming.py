"""What comes with time in the position of one axis as it warms up (ISO 230-3)."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Any, Self

import numpy as np

from symfive.arrays import Array
from symfive.effects._base import Campaign, Covariance, Effect, Quantity, Row, Values
from symfive.effects._quantity import propagated
from symfive.errors import InputError

SHAPES = ("exponential", "linear")


@dataclass(frozen=True, kw_only=True)
class AxisWarming(Effect):
    """Its first parameter times g(t), t on the campaign's clock.

    `shape`: `exponential`, g = 1 - exp(-t/time_constant_s), its last parameter; `linear`, g = t/span_s, of which only the first
    part is seen and `span_s` is how long the campaign runs.
    """

    stage = "axis"
    over_time = True
    reported_as = "thermal_drift"
    needs_axis = True
    choices = (("shape", SHAPES),)
    shape: str = "exponential"
    span_s: float = 0.0

    def prepare(self, campaign: Campaign) -> Self:
        effect = super().prepare(campaign)
        if not 0.0 <= self.span_s < math.inf:
            raise InputError(
                f"{self.key}: span_s = {self.span_s} is no time", remedy="write span_s = …, in s, or leave it out"
            )
        return replace(effect, span_s=(self.span_s or self.clock_span(campaign)) if self.shape == "linear" else 0.0)

    def grown(self, row: Row) -> Any:
        """g(t)."""
        return row.clock / self.span_s if self.shape == "linear" else self.risen(row, row.clock)

    def describe(self, campaign: Campaign, values: Values, covariance: Covariance) -> dict[str, Quantity]:
        """Its parameters, and `reached`, the first of them as far as it has come at the end of the campaign: well known where it
        and the time constant are not, because only the first part of the rise was seen."""
        end, own = self.clock_span(campaign), self.parameters(campaign)

        def size(p: Array) -> float:
            return float(p[0] * (end / self.span_s if self.shape == "linear" else 1.0 - np.exp(-end / p[-1])))

        reached = propagated(size, [p.name for p in own], own[0].unit, values, covariance)
        return {**super().describe(campaign, values, covariance), "reached": reached}
