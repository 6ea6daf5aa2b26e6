"""Step or dent at one place of an axis: a wrong node of its compensation table, a joint of its scale or guide."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Self

import casadi as ca

from symfive.effects._base import Effect
from symfive.effects._quantity import Covariance, Quantity, Values
from symfive.errors import InputError
from symfive.motion import Position
from symfive.parameters import Parameter

if TYPE_CHECKING:
    from symfive.campaign import Campaign
    from symfive.model._row import Row

SHAPES = ("step", "dent")


@dataclass(frozen=True, kw_only=True)
class TableStep(Effect):
    """`shape` `step`: q → q + height·clip((q - at)/ramp, 0, 1); `dent`: q → q + height·max(0, 1 - |q -
    at|/ramp).

    `at` and `ramp` (the distance between two nodes) in mm or degree; they are found by a scan. Typical 1–20
    µm.
    """

    id = "table_step"
    stage = "axis"
    says = "a step of the positioning error at one place of the axis"
    hidden_by = "straightness of the other axis and scale where the place is passed only once or twice"
    reported_as = "error_motion"
    needs_axis = True
    at: float
    ramp: float = 0.1
    shape: str = "step"

    def prepare(self, campaign: Campaign) -> Self:
        self.choose("shape", SHAPES)
        if not (math.isfinite(self.at) and self.ramp > 0.0):
            raise InputError(f"effect {self.id} needs a place and a ramp above 0", remedy="write at = …, ramp = 0.1")
        return super().prepare(campaign)

    def parameters(self, campaign: Campaign) -> tuple[Parameter, ...]:
        rotary = self.its_axis(campaign).rotary
        return (self.own("height", "urad" if rotary else "um", 30.0 if rotary else 5.0),)

    def apply(self, row: Row) -> None:
        unit = row.machine.axes[str(self.axis)].to_internal
        place = (row.signal(Position(str(self.axis))) - self.at * unit) / (self.ramp * unit)
        form = ca.fmin(ca.fmax(place, 0.0), 1.0) if self.shape == "step" else ca.fmax(1.0 - ca.fabs(place), 0.0)
        row.axis[str(self.axis)] += self.parameter(row, "height") * form

    def describe(self, campaign: Campaign, values: Values, covariance: Covariance) -> dict[str, Quantity]:
        """`component` is the error motion along or about the axis itself, `at` the middle of the ramp."""
        axis = self.its_axis(campaign)
        main = max(range(3), key=lambda i: abs(axis.direction[i]))
        component = f"E{('ABC' if axis.rotary else 'XYZ')[main]}{axis.name}"
        middle = self.at + (0.5 * self.ramp if self.shape == "step" else 0.0)
        place = Quantity(middle, self.ramp / math.sqrt(12.0), axis.unit)
        return {
            "component": Quantity(component),
            "at": place,
            **super().describe(campaign, values, covariance),
        }
