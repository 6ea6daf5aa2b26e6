"""Servo mismatch: the real position loop of an axis is not the machine file's (ISO 230-4 Annex B; paper 3)."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Self

from symfive.effects._axes import moving
from symfive.effects._base import Campaign, Effect, Form, Forms, Parameter
from symfive.errors import InputError

RELATIVE_SIGMA = 0.3
UNITS = {"position_gain": "1/s", "velocity_gain": "1/s", "integral_time": "s", "viscous": "1/s", "feedforward": "1"}


@dataclass(frozen=True, kw_only=True)
class ServoMismatch(Effect):
    """Gains of the drive become parameters (conventions, section 3); `gains` names which. In static runs it
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
    gains: tuple[str, ...] = ("position_gain", "velocity_gain", "feedforward")

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
        found = []
        for gain in self.gains:
            nominal = float(getattr(drive, gain))
            if gain == "feedforward":
                found.append(self.own(gain, UNITS[gain], 0.3, mean=nominal, lower=min(0.0, nominal)))
            else:
                size = nominal or 1.0
                lower = 0.0 if gain == "viscous" else 1e-3 * size
                found.append(self.own(gain, UNITS[gain], RELATIVE_SIGMA * size, mean=nominal, lower=lower))
        return tuple(found)

    def frees(self) -> Mapping[tuple[str, str], str]:
        return {(str(self.axis), gain): f"{self.key}.{gain}" for gain in self.gains}

    def typical(self, campaign: Campaign) -> dict[str, float]:
        return {p.name: p.mean + p.sigma / 3.0 for p in self.parameters(campaign)}
