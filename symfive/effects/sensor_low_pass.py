"""Low-pass of the instrument: its filter rounds off and delays what changes fast."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from symfive.arrays import Array
from symfive.effects._base import Campaign, Covariance, Effect, Forms, Parameter, Quantity, Run, Values
from symfive.effects._quantity import own_quantity, propagated
from symfive.instruments import has_clock_of_its_own
from symfive.motion import first_order, first_order_slope

SIZES = (4.0, 16.0, 64.0)
"""In units of the usual one, up to a third of a second, at which the readings are looked at."""


@dataclass(frozen=True, kw_only=True)
class SensorLowPass(Effect):
    """τ·dy/dt + y = y_true, at rest on the first row, y_true linear between rows (first-order hold, exact).

    Estimated as the time constant τ, which is 0 for an ideal instrument; cut-off frequency 1/(2πτ). Typical
    100–250 Hz (0.6–1.6 ms); slow averaging 5–50 ms.
    """

    id = "sensor_low_pass"
    stage = "recording"
    says = "low-pass filter of the instrument"
    hidden_by = "a constant delay and servo mismatch at slow motion"
    action = "switch the filter of the instrument off, or measure at a lower feed; the machine needs no repair"
    coordinate = "t"
    reported_as = "latency"
    dynamic_only = True

    def applies(self, run: Run) -> bool:
        return super().applies(run) and has_clock_of_its_own(run)

    @classmethod
    def candidates(cls, campaign: Campaign) -> Forms:
        """Far from linear in a long time constant, the readings are looked at about several."""
        (tau,) = cls().parameters(campaign)
        yield from cls().forms_about(tau, [size * tau.sigma for size in SIZES])

    def parameters(self, campaign: Campaign) -> tuple[Parameter, ...]:
        return (self.own("time_constant_ms", "ms", 5.0, lower=0.0, start=0.5),)

    def record(
        self, run: Run, columns: tuple[int, ...], readings: Array, values: Values
    ) -> tuple[Array, dict[str, Array]]:
        name = f"{self.key}.time_constant_ms"
        ours = list(columns)
        steps, tau = np.diff(run.time), values[name]
        filtered, moved = readings.copy(), np.zeros(readings.shape[:2])
        filtered[:, ours] = first_order(readings[:, ours], steps, tau)
        moved[:, ours] = first_order_slope(readings[:, ours, 0], filtered[:, ours, 0], steps, tau)
        return filtered, {name: moved}

    def describe(self, campaign: Campaign, values: Values, covariance: Covariance) -> dict[str, Quantity]:
        """The time constant is also the delay of slow signals, `delay_ms`."""
        (tau,) = self.parameters(campaign)
        delay = own_quantity(tau, values, covariance)
        found = {"delay_ms": delay, "time_constant_ms": delay}
        if values[tau.name] > 0.0:
            rate = propagated(lambda x: 1e3 / (2.0 * math.pi * x[0]), (tau.name,), "Hz", values, covariance)
            found["cutoff_hz"] = rate
        return found
