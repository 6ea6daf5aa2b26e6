"""Servo mismatch: the real position loop of an axis is not the machine file's (ISO 230-4 Annex B; paper 3)."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Self

from symfive.effects._base import Campaign, Covariance, Effect, Form, Forms, Parameter, Quantity, Values
from symfive.effects._form import moving
from symfive.effects._quantity import determined, own_quantity
from symfive.errors import InputError

RELATIVE_SIGMA = 0.3
DAMPING = 0.1
"""1σ of what damps the velocity loop beside its gain, as a share of that gain. A dead time T of sampling and current loop takes
T·(position_gain + 1/integral_time) of it, to first order: 0.1 at 1 to 2 ms and usual gains."""
UNITS = {"position_gain": "1/s", "velocity_gain": "1/s", "integral_time": "s", "viscous": "1/s", "feedforward": "1"}


@dataclass(frozen=True, kw_only=True)
class ServoMismatch(Effect):
    """Gains of the drive become parameters (conventions, section 3), all of them unless `gains` names some: where a loop differs
    from what is stated of it, none of its gains is known. `viscous` below 0 is the dead time of the inner loop. In static runs it
    does nothing.

    Typical 0.1–2 ms of 1/position_gain against another axis: 16.7 µm per ms at 1 m/min.
    """

    id = "servo_mismatch"
    stage = "drive"
    says = "the position loop differs from the machine file"
    hidden_by = "squareness with one direction of travel, backlash with one feed, location errors of a rotary axis"
    action = "set equal position gains (Kv) of the axes in the control; correct the drives in the machine file"
    terms = (("viscous", "viscous friction"),)
    coordinate = "{axis} velocity"
    needs_axis = True
    needs_drive = True
    dynamic_only = True
    departs = True
    gains: tuple[str, ...] = tuple(UNITS)

    def prepare(self, campaign: Campaign) -> Self:
        for gain in self.gains:
            if gain not in UNITS:
                raise InputError(f'{self.id}: the drive has no gain "{gain}"', remedy=f"use {', '.join(UNITS)}")
        return super().prepare(campaign)

    @classmethod
    def candidates(cls, campaign: Campaign) -> Forms:
        for axis in moving(campaign):
            yield Form(effect=cls(axis=axis), shapes=tuple(cls(axis=axis, gains=(gain,)) for gain in cls.gains))

    def parameters(self, campaign: Campaign) -> tuple[Parameter, ...]:
        drive = self.its_axis(campaign).drive
        stated = {gain: float(getattr(drive, gain)) for gain in UNITS}
        found = []
        for gain in self.gains:
            nominal = stated[gain]
            size = stated["velocity_gain" if gain == "viscous" else gain] or 1.0
            sigma, lower = {
                "feedforward": (0.3, min(0.0, nominal)),
                "viscous": (DAMPING * size, -0.5 * size),
            }.get(gain, (RELATIVE_SIGMA * size, 1e-3 * size))
            found.append(self.own(gain, UNITS[gain], sigma, mean=nominal, lower=lower))
        return tuple(found)

    def describe(self, campaign: Campaign, values: Values, covariance: Covariance) -> dict[str, Quantity]:
        """Those gains that the readings determine; all where that is none."""
        gains = self.parameters(campaign)
        known = determined(gains, covariance) or gains
        return {p.name.removeprefix(f"{self.key}."): own_quantity(p, values, covariance) for p in known}

    def frees(self) -> Mapping[tuple[str, str], str]:
        return {(str(self.axis), gain): f"{self.key}.{gain}" for gain in self.gains}

    def typical(self, campaign: Campaign) -> dict[str, float]:
        return {p.name: p.mean + p.sigma / 3.0 for p in self.parameters(campaign)}
