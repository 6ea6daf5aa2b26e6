"""Counterbalance asymmetry: a vertical axis hangs back in one direction only, more or less so along its travel."""

from __future__ import annotations

from dataclasses import dataclass

from symfive.effects._axes import reversing
from symfive.effects._base import Campaign, Covariance, Form, Forms, Parameter, Quantity, Row, Run, Values
from symfive.effects._contact import Contact
from symfive.motion import Direction, Position, Signal

UPRIGHT = 0.7
"""Cosine to the vertical from which an axis carries its weight."""


@dataclass(frozen=True, kw_only=True)
class Counterbalance(Contact):
    """q → q - (drop + slope·q)·(1 + s)/2 with the direction s of the last motion: a drop on the way up, none
    downwards.

    `drop` µm, `slope` µm/mm. A part of it, (drop + slope·q)/2, does not depend on the direction and reads as
    scale and zero. Typical 1–10 µm.
    """

    id = "counterbalance"
    stage = "axis"
    says = "a vertical axis drops in one direction of motion"
    hidden_by = "backlash growing along the axis and its scale; the drive current separates up from down"
    action = "check the counterbalance (pressure, chain) of the axis and its backlash"
    coordinate = "{axis} velocity sign"
    reported_as = "backlash"
    needs_axis = True

    @classmethod
    def candidates(cls, campaign: Campaign) -> Forms:
        for axis in reversing(campaign):
            if abs(campaign.machine.axes[axis].direction[2]) > UPRIGHT and not campaign.machine.axes[axis].rotary:
                yield Form(effect=cls(axis=axis))

    def parameters(self, campaign: Campaign) -> tuple[Parameter, ...]:
        if self.its_axis(campaign).rotary:
            return (self.own("drop", "urad", 30.0), self.own("slope", "urad/deg", 1.0))
        return (self.own("drop", "um", 10.0), self.own("slope", "um/mm", 0.05))

    def signals(self) -> tuple[Signal, ...]:
        return (Direction(str(self.axis), self.started),)

    def starts(self, run: Run) -> tuple[Parameter, ...]:
        return self.start_of_contact(run, str(self.axis), memory=False)

    def describe(self, campaign: Campaign, values: Values, covariance: Covariance) -> dict[str, Quantity]:
        """`width` is the backlash at zero of the axis that it amounts to: the drop."""
        found = super().describe(campaign, values, covariance)
        return {"width": found["drop"], **found}

    def apply(self, row: Row) -> None:
        up = 0.5 * (1.0 + row.signal(self.signals()[0]))
        drop = self.parameter(row, "drop") + self.parameter(row, "slope") * row.signal(Position(str(self.axis)))
        row.axis[str(self.axis)] -= drop * up
