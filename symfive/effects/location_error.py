"""Location error that the baseline holds at zero (ISO 230-1, 3.4; ISO 230-7)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Self

from symfive.effects._axes import location_of, own_component
from symfive.effects._base import Campaign, Form, Forms, Parameter, Row
from symfive.effects._warming import Rising
from symfive.errors import InputError


@dataclass(frozen=True, kw_only=True)
class LocationError(Rising):
    """`component` (`EY0C`) = value, µm or µrad, in the exact chain.

    With `drift` it grows on the campaign's clock, value·(1 - exp(-t/time_constant_s)): the thermal drift of a
    rotary axis' place (5–30 µm/h), which may join a baseline that holds the constant one. Typical centre
    offset 5–50 µm, tilt 10–50 µrad, squareness 5–30 µrad.
    """

    id = "location_error"
    says = "a location error missing from the machine file"
    hidden_by = "set-up errors and the instrument's zero where poses are few"
    action = "enter it in the control (symfive codegen), or align the axis"
    terms = (("value", ""),)
    coordinate = "pose"
    component: str
    drift: bool = False

    @property
    def over_time(self) -> bool:  # type: ignore[override]
        """Whether it grows with time."""
        return self.drift

    def prepare(self, campaign: Campaign) -> Self:
        location_of(self.component, campaign.machine)
        if self.component in campaign.machine.errors and not self.drift:
            raise InputError(f"the baseline already varies {self.component}", remedy="choose a component that it lacks")
        return super().prepare(campaign)

    @classmethod
    def candidates(cls, campaign: Campaign) -> Forms:
        for axis in campaign.machine.axis_names:
            own, rotary = own_component(campaign.machine, axis), campaign.machine.axes[axis].rotary
            for letter in "XYZABC" if rotary else "ABC":
                # a rotary axis has no place along itself, a linear one no tilt about itself
                if "XYZABC".index(letter) % 3 != "XYZABC".index(own) % 3 or (rotary and letter == own):
                    yield Form(effect=cls(component=f"E{letter}0{axis}"))

    def parameters(self, campaign: Campaign) -> tuple[Parameter, ...]:
        component = location_of(self.component, campaign.machine)
        value = self.own("value", component.unit, 50.0 if component.angular else 30.0)
        if not self.drift:
            return (value,)
        tau = 0.5 * self.clock_span(campaign)
        return (value, self.time_constant(tau))

    def apply(self, row: Row) -> None:
        grown = self.risen(row, row.clock) if self.drift else 1.0
        row.location[self.component] = row.location.get(self.component, 0.0) + self.parameter(row, "value") * grown
