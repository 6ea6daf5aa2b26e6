"""What rises with a time constant, and what of it shows in the position of one axis that warms up (ISO 230-3)."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Any, Self

import casadi as ca
import numpy as np

from symfive.arrays import Array
from symfive.effects._base import Campaign, Covariance, Effect, Form, Parameter, Quantity, Row, Values
from symfive.effects._quantity import propagated
from symfive.errors import InputError

SHAPES = ("exponential", "linear")
SHORTER = (0.3, 0.1)
"""Shares of its usual time constant about which an effect is looked at too: half a decade apart."""


@dataclass(frozen=True, kw_only=True)
class Rising(Effect):
    """An effect that rises as 1 - exp(-t/τ)."""

    def time_constant(self, tau: float, name: str = "time_constant_s") -> Parameter:
        """A parameter for a time constant, s, that usually is about `tau`."""
        return self.own(name, "s", 2.0 * tau, mean=tau, lower=1e-2 * tau)

    def risen(self, row: Row, since: Any, name: str = "time_constant_s") -> Any:
        """1 - exp(-t/τ): what has come of a rise with its time constant `name`, a time `since` (s) after it began."""
        return 1.0 - ca.exp(-since / self.parameter(row, name))

    def at_time_constants(self, campaign: Campaign, *shapes: Effect) -> Iterator[Form]:
        """Its form about its usual time constant, and about shorter ones: while it has no size, readings cannot separate them."""
        usual = next(p for p in self.parameters(campaign) if p.name == f"{self.key}.time_constant_s")
        yield from self.forms_about(usual, [share * usual.mean for share in SHORTER], *shapes)

    def clock_span(self, campaign: Campaign) -> float:
        """How long the campaign's clock runs, s (at least 1)."""
        return max([1.0, *(run.start_s + float(run.time[-1]) for run in campaign.runs if run.has_clock)])


@dataclass(frozen=True, kw_only=True)
class AxisWarming(Rising):
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
