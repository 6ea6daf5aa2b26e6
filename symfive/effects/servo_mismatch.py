"""Servo mismatch: the real position loop of an axis is not the machine file's (ISO 230-4 Annex B; paper 3)."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING

from symfive.effects._base import Effect
from symfive.errors import InputError
from symfive.parameters import Parameter

if TYPE_CHECKING:
    from symfive.campaign import Campaign, Run

RELATIVE_SIGMA = 0.3
UNITS = {"position_gain": "1/s", "velocity_gain": "1/s", "integral_time": "s", "viscous": "1/s", "feedforward": "1"}


@dataclass(frozen=True, kw_only=True)
class ServoMismatch(Effect):
    """Gains of the drive become parameters (conventions, section 3); `gains` names which. In static runs it does nothing."""

    id = "servo_mismatch"
    stage = "drive"
    says = "the position loop differs from the machine file"
    gains: tuple[str, ...] = ("position_gain", "velocity_gain", "feedforward")

    def parameters(self, campaign: Campaign) -> tuple[Parameter, ...]:
        drive = campaign.machine.axes[str(self.axis)].drive
        if drive is None:
            raise InputError(f"{self.key} needs the drive of axis {self.axis}", remedy=f"add [axes.{self.axis}.drive]")
        found = []
        for gain in self.gains:
            nominal = float(getattr(drive, gain))
            if gain == "feedforward":
                found.append(self.own(gain, UNITS[gain], 0.3, mean=nominal))
            else:
                sigma = RELATIVE_SIGMA * max(nominal, 1.0)
                found.append(self.own(gain, UNITS[gain], sigma, mean=nominal, lower=1e-3 * max(nominal, 1.0)))
        return tuple(found)

    def frees(self) -> Mapping[tuple[str, str], str]:
        return {(str(self.axis), gain): f"{self.key}.{gain}" for gain in self.gains}

    def applies(self, run: Run) -> bool:
        return run.dynamic
