"""Thermal drift: the tool moves relative to the table with time (ISO 230-3)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import casadi as ca

from symfive.effects._base import Effect
from symfive.parameters import Parameter

if TYPE_CHECKING:
    from symfive.campaign import Campaign
    from symfive.model._row import Row


@dataclass(frozen=True, kw_only=True)
class ThermalDrift(Effect):
    """shift = amplitude·(1 - exp(-t/τ)) in the machine frame, t on the campaign's clock.

    Three amplitudes (µm) and one time constant τ (s). Typical 5–60 µm with τ of 5–60 min.
    """

    id = "thermal_drift"
    stage = "structure"
    says = "tool relative to table drifts with time"

    def parameters(self, campaign: Campaign) -> tuple[Parameter, ...]:
        span = max(run.start_s + float(run.time[-1]) for run in campaign.runs)
        amplitudes = tuple(self.own(f"amplitude.{c}", "um", 20.0) for c in "xyz")
        tau = 0.5 * max(span, 1.0)
        return (*amplitudes, self.own("time_constant_s", "s", 2.0 * tau, mean=tau, lower=1e-2 * tau))

    def apply(self, row: Row) -> None:
        rise = 1.0 - ca.exp(-row.clock / self.parameter(row, "time_constant_s"))
        row.shift += ca.vertcat(*(self.parameter(row, f"amplitude.{c}") * rise for c in "xyz"))
