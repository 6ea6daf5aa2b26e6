"""Force vibration: a periodic force in time that the drive holds against, whatever the motion (a fan, a pump, a resonance)."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Self

import casadi as ca
import numpy as np

from symfive.effects._force import FORCE_SHARE, ForceEffect, driven_axes, usual_force
from symfive.effects._form import FORCE, Form, Forms, Tone
from symfive.effects._quantity import Covariance, Quantity, Values, amplitude_and_phase, own_quantity
from symfive.effects.vibration import LEAST_CYCLES
from symfive.errors import InputError
from symfive.instruments.drive_force import DriveForce, driven_axis
from symfive.parameters import Parameter
from symfive.row import Row
from symfive.runs import Campaign


@dataclass(frozen=True, kw_only=True)
class ForceVibration(ForceEffect):
    """F += amplitude·sin(2πf·t + phase) in the recording of an axis' drive force, N or Nm; t on the campaign's clock, f near
    `frequency_hz`.

    Estimated as amplitudes of sine and cosine, whose prior 1σ is `sigma_force`: a share of the recorded force's rms.
    """

    id = "force_vibration"
    says = "the drive holds against a periodic force in time"
    hidden_by = "a ripple of the force along the path, where only one feed was run"
    action = "find the source by its frequency (fan, pump, spindle, a part that resonates)"
    coordinate = "t"
    over_time = True
    reported_as = "vibration"
    dynamic_only = True
    frequency_hz: float
    sigma_force: float = 0.0

    def prepare(self, campaign: Campaign) -> Self:
        if not (self.frequency_hz > 0.0 and math.isfinite(self.frequency_hz)):
            raise InputError(f"{self.key} needs a frequency above 0", remedy="write frequency_hz = …")
        prepared = super().prepare(campaign)
        if not any(map(self.applies, campaign.runs)):
            raise InputError(f"{self.key}: no run records the drive force of {self.axis}", remedy="record drive_force")
        return replace(prepared, sigma_force=self.sigma_force or usual_force(campaign, str(self.axis), FORCE_SHARE))

    @classmethod
    def candidates(cls, campaign: Campaign) -> Forms:
        for axis in driven_axes(campaign):
            runs = [run for run in campaign.runs if driven_axis(run) == axis and run.dynamic and run.has_clock]
            longest = max((run.duration for run in runs), default=0.0)
            shortest = max((2.0 * run.interval for run in runs), default=1.0)

            def form(frequency: float, resolution: float, places: int, axis: str = axis) -> Form:
                return Form(effect=cls(axis=axis, frequency_hz=frequency), places=places)

            if longest > LEAST_CYCLES * shortest:
                yield Tone(
                    channel=FORCE, axis=axis, coordinate=lambda run: run.start_s + np.asarray(run.time),
                    lowest=LEAST_CYCLES / longest, highest=0.98 / shortest, form=form, runs=tuple(run.id for run in runs),
                )  # fmt: skip

    def parameters(self, campaign: Campaign) -> tuple[Parameter, ...]:
        unit = "Nm" if self.its_axis(campaign).rotary else "N"
        span = max([1.0, *(float(run.time[-1] - run.time[0]) for run in campaign.runs if self.applies(run))])
        return (
            *(self.own(part, unit, self.sigma_force or 1.0) for part in ("sin", "cos")),
            self.own("frequency_hz", "Hz", 1.0 / span, mean=self.frequency_hz, lower=0.5 * self.frequency_hz),
        )

    def apply(self, row: Row) -> None:
        angle = 2.0 * math.pi * self.parameter(row, "frequency_hz") * row.clock
        force = self.parameter(row, "sin") * ca.sin(angle) + self.parameter(row, "cos") * ca.cos(angle)
        row.add_reading(DriveForce.name, force)

    def describe(self, campaign: Campaign, values: Values, covariance: Covariance) -> dict[str, Quantity]:
        """Frequency, amplitude and phase."""
        sine, cosine, frequency = self.parameters(campaign)
        amplitude, phase = amplitude_and_phase(sine.name, cosine.name, sine.unit, values, covariance)
        return {
            "frequency_hz": own_quantity(frequency, values, covariance),
            "amplitude": amplitude,
            "phase": phase,
        }
