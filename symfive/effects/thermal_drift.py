"""Thermal drift: the tool moves relative to the table with time (ISO 230-3)."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Any, Self

import casadi as ca
import numpy as np

from symfive.arrays import Array
from symfive.effects._base import TOOL, Campaign, Form, Forms, Parameter, Row, Run, Scan
from symfive.effects._quantity import Covariance, Quantity, Values, length_and_direction, own_quantity, propagated
from symfive.effects._warming import Rising
from symfive.errors import InputError

SHAPES = ("exponential", "mixture", "linear", "delayed")
ONSETS = 9
"""Onset times of a late drift that are tried, a tenth of the campaign apart: closer than a time constant can be resolved."""
SHORTEST = 0.1
"""Share of the campaign that is left after the onset, at least: of a part of the runs the onset may lie beyond their end."""


@dataclass(frozen=True, kw_only=True)
class ThermalDrift(Rising):
    """A shift of the tool in the machine frame, t on the campaign's clock.

    `shape`: `exponential`, amplitude·(1 - exp(-t/τ)); `mixture`, that and slow·(1 - exp(-t/τ_slow)), a
    second, slower body; `linear`, rate·t, of which only the first part is seen; `delayed`, the first with the heat coming at
    about `onset_s` (prior 1σ `onset_sigma_s`; 0: a quarter of the campaign), from where t counts. Vectors x, y, z. Typical
    5–60 µm with τ of 5–60 min.
    """

    id = "thermal_drift"
    stage = "structure"
    over_time = True
    says = "tool relative to table drifts with time"
    hidden_by = (
        "location errors (89 % of it) and thermal growth of the bar; the first pose repeated at the end separates them"
    )
    action = "warm the machine up or steady its temperature, then repeat the test"
    coordinate = "t"
    choices = (("shape", SHAPES),)
    shape: str = "exponential"
    onset_s: float = 0.0
    onset_sigma_s: float = 0.0

    def prepare(self, campaign: Campaign) -> Self:
        effect = super().prepare(campaign)
        if self.shape != "delayed":
            return replace(effect, onset_s=0.0, onset_sigma_s=0.0)
        if not (0.0 <= self.onset_s < math.inf and 0.0 <= self.onset_sigma_s < math.inf):
            raise InputError(
                f"effect {self.id}: its onset is no time", remedy="write onset_s = …, in s from the campaign's start"
            )
        usual = 0.25 * self.clock_span(campaign)
        return replace(effect, onset_s=self.onset_s or usual, onset_sigma_s=self.onset_sigma_s or usual)

    @classmethod
    def candidates(cls, campaign: Campaign) -> Forms:
        yield from cls().at_time_constants(campaign, cls(shape="mixture"))
        yield Form(effect=cls(shape="linear", tag="linear"), shapes=(cls(), cls(shape="mixture")))
        span = cls().clock_span(campaign)
        step = span / (ONSETS + 1)

        def form(place: int) -> Form:
            late = cls(shape="delayed", onset_s=(place + 1) * step, onset_sigma_s=step, tag="delayed")
            return Form(effect=late, places=ONSETS, once=True)

        def courses(run: Run) -> Array:
            since = run.start_s + np.asarray(run.time)[:, None] - step * np.arange(1, ONSETS + 1)
            tau = 0.5 * np.maximum(span - step * np.arange(1, ONSETS + 1), SHORTEST * span)
            return np.asarray(run.has_clock * (1.0 - np.exp(-np.maximum(since, 0.0) / tau)))

        yield Scan(channel=TOOL, count=ONSETS, courses=courses, form=form)

    def parameters(self, campaign: Campaign) -> tuple[Parameter, ...]:
        if self.shape == "linear":
            return tuple(self.own(f"rate.{c}", "um/h", 30.0) for c in "xyz")
        span = self.clock_span(campaign)
        tau = (0.15 if self.shape == "mixture" else 0.5) * max(span - self.onset_s, SHORTEST * span)
        found = [self.own(f"amplitude.{c}", "um", 20.0) for c in "xyz"]
        found.append(self.time_constant(tau))
        if self.shape == "mixture":
            found += [self.own(f"slow.{c}", "um", 20.0) for c in "xyz"]
            slow = self.own("slow_time_constant_s", "s", 5.0 * tau, mean=5.0 * tau, lower=tau)
            found.append(slow)
        if self.shape == "delayed":
            found.append(self.own("onset_s", "s", self.onset_sigma_s, mean=self.onset_s, lower=0.0))
        return tuple(found)

    def apply(self, row: Row) -> None:
        def vector(name: str) -> Any:
            return ca.vertcat(*(self.parameter(row, f"{name}.{c}") for c in "xyz"))

        if self.shape == "linear":
            row.shift += vector("rate") * row.clock
            return
        late = self.shape == "delayed"
        since = ca.fmax(row.clock - self.parameter(row, "onset_s"), 0.0) if late else row.clock
        row.shift += vector("amplitude") * self.risen(row, since)
        if self.shape == "mixture":
            row.shift += vector("slow") * self.risen(row, since, "slow_time_constant_s")

    def describe(self, campaign: Campaign, values: Values, covariance: Covariance) -> dict[str, Quantity]:
        found: dict[str, Quantity] = {}
        for p in self.parameters(campaign):
            name = p.name.removeprefix(self.key + ".")
            if name.endswith(".x"):
                stem = name.removesuffix(".x")
                names = [f"{self.key}.{stem}.{c}" for c in "xyz"]
                label = "direction" if stem != "slow" else "slow_direction"
                found["slow_amplitude" if stem == "slow" else stem], found[label] = length_and_direction(
                    names, p.unit, values, covariance
                )
            elif name.endswith("_s"):
                found[name] = own_quantity(p, values, covariance)
        found["reached"] = self._reached(campaign, values, covariance)
        return found

    def _reached(self, campaign: Campaign, values: Values, covariance: Covariance) -> Quantity:
        """How far it has gone at the end of the campaign: well known where amplitude and time constant are not, because only
        the first part of the rise was seen."""
        end, names = self.clock_span(campaign), [p.name for p in self.parameters(campaign)]

        def length(p: Array) -> float:
            if self.shape == "linear":
                return float(np.linalg.norm(p[:3])) * end / 3600.0
            lasts = max(end - p[4], 0.0) if self.shape == "delayed" else end
            bodies = [p[k : k + 3] * (1.0 - np.exp(-lasts / p[k + 3])) for k in range(0, len(p) - 1, 4)]
            return float(np.linalg.norm(sum(bodies)))

        return propagated(length, names, "um", values, covariance)
