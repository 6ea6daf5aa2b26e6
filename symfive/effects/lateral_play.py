"""Lateral play: the carriage moves sideways or turns when it reverses (ISO 230-4 Annex B; Ballbar diagnosis)."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Self

from symfive.effects._axes import across, component_of, reversing
from symfive.effects._base import Campaign, Form, Forms, Parameter, Quantity, Row, Run
from symfive.effects._contact import Contact
from symfive.errors import InputError
from symfive.motion import Direction, Play, PreSliding, Signal

SHAPES = ("step", "pre_sliding", "play")


@dataclass(frozen=True, kw_only=True)
class LateralPlay(Contact):
    """`component` (`EYX`) -= (width/2)·s of the direction of motion s of the component's axis, µm or µrad.

    `shape`: `step`, s = ±1 at once; `pre_sliding`, s = ±(1 - 2·exp(-ξ/distance)), ξ the distance since the
    reversal; `play`, s changes in proportion to ξ until `distance`. Static rows: s is the direction from which the
    axis came. Typical 1–10 µm.
    """

    id = "lateral_play"
    says = "the carriage moves sideways when it reverses"
    hidden_by = "radius and scale (99 % of it) where circles run in one direction only"
    action = "adjust the gibs or the preload of the guideway"
    coordinate = "{axis} velocity sign"
    choices = (("shape", SHAPES),)
    component: str
    shape: str = "step"

    @property
    def _moving(self) -> str:
        return self.component[2:]

    def prepare(self, campaign: Campaign) -> Self:
        component = component_of(self.component, campaign.machine)
        axis = campaign.machine.axes[component.axis]
        along = dict(zip("XYZ", axis.direction, strict=True)).get(component.component, 0.0)
        if not axis.rotary and abs(along) > 0.999:
            raise InputError(f"{self.component} lies along the motion", remedy="that is backlash")
        return super().prepare(campaign)

    @classmethod
    def candidates(cls, campaign: Campaign) -> Forms:
        for axis in reversing(campaign):
            for symbol in across(campaign.machine, axis):
                yield Form(
                    effect=cls(component=symbol), shapes=tuple(cls(component=symbol, shape=s) for s in SHAPES[1:])
                )

    def advice(self, sizes: Mapping[str, Quantity]) -> tuple[str, str]:
        tilts = self.component[1] in "ABC"
        return "the carriage tilts when it reverses" if tilts else self.says, self.action

    def parameters(self, campaign: Campaign) -> tuple[Parameter, ...]:
        component = component_of(self.component, campaign.machine)
        width = self.own("width", component.unit, 30.0 if component.angular else 10.0)
        if self.shape == "step":
            return (width,)
        axis = campaign.machine.axes[component.axis]
        distance = 300.0 if axis.rotary else 50.0
        if self.shape == "play":
            distance *= 0.1
        return (width, self.own("distance", axis.error_unit, distance, mean=distance, lower=0.02 * distance))

    def starts(self, run: Run) -> tuple[Parameter, ...]:
        return self.start_of_contact(run, self._moving, memory=self.shape != "step")

    def signals(self) -> tuple[Signal, ...]:
        if self.shape == "step":
            return (Direction(self._moving, start=self.started),)
        contact = Play if self.shape == "play" else PreSliding
        return (contact(self._moving, f"{self.key}.distance", start=self.started),)

    def apply(self, row: Row) -> None:
        row.add_motion(self.component, -0.5 * self.parameter(row, "width") * row.signal(self.signals()[0]))
