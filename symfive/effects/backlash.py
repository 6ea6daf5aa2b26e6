"""Backlash: play between the drive and the axis (ISO 230-1, 3.4.10 reversal value; ISO 230-4 Annex B)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from symfive.effects._base import Effect
from symfive.motion import Play
from symfive.parameters import Parameter

if TYPE_CHECKING:
    from symfive.campaign import Campaign
    from symfive.model._row import Row
    from symfive.motion import Signal


@dataclass(frozen=True, kw_only=True)
class Backlash(Effect):
    """q → q - (width/2)·s with the play's state s: the output lags the motion by half the width and stands in between.

    Static rows: s is the direction from which the axis came. Typical 1–20 µm, 10–100 µrad.
    """

    id = "backlash"
    stage = "axis"
    says = "play behind the drive"

    def parameters(self, campaign: Campaign) -> tuple[Parameter, ...]:
        rotary = campaign.machine.axes[str(self.axis)].rotary
        return (self.own("width", "urad" if rotary else "um", 100.0 if rotary else 20.0, start=1.0),)

    def signals(self) -> tuple[Signal, ...]:
        return (Play(str(self.axis), f"{self.key}.width"),)

    def apply(self, row: Row) -> None:
        state = row.signal(self.signals()[0])
        row.axis[str(self.axis)] -= 0.5 * self.parameter(row, "width") * state
