"""Force vibration: a periodic force in time that the drive holds against, whatever the motion (a fan, a pump, a resonance)."""

from __future__ import annotations

from dataclasses import dataclass

from symfive.effects._base import FORCE, Campaign, Covariance, Forms, Parameter, Quantity, Row, Values
from symfive.effects._force import SizedForce, driven_axes
from symfive.effects._periodic import Tonal
from symfive.instruments.drive_force import DriveForce, driven_axis


@dataclass(frozen=True, kw_only=True)
class ForceVibration(Tonal, SizedForce):
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

    @classmethod
    def candidates(cls, campaign: Campaign) -> Forms:
        for axis in driven_axes(campaign):
            runs = [run for run in campaign.runs if driven_axis(run) == axis and run.dynamic and run.has_clock]
            yield from cls.tones(runs, FORCE, axis)

    def parameters(self, campaign: Campaign) -> tuple[Parameter, ...]:
        return (*self.pairs(campaign, self.force_unit(campaign), self.sigma_force or 1.0), self.frequency(campaign))

    def apply(self, row: Row) -> None:
        row.add_reading(DriveForce.name, self.swing(row))

    def describe(self, campaign: Campaign, values: Values, covariance: Covariance) -> dict[str, Quantity]:
        """Frequency, amplitude and phase."""
        return self.tone(campaign, self.parameters(campaign), 1, values, covariance)[0]
