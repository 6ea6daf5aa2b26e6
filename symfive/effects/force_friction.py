"""Friction as the drive's force shows it: a level for each direction of motion (A. Janot, M. Gautier & M. Brunot 2019)."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Self

import casadi as ca

from symfive.effects._base import DRIVE, Effect
from symfive.effects._form import Form, Scan, Tone
from symfive.errors import InputError
from symfive.instruments.drive_force import DriveForce, FilteredMotion, driven_axis
from symfive.motion import Velocity
from symfive.parameters import Parameter

if TYPE_CHECKING:
    from symfive.motion import Signal
    from symfive.row import Row
    from symfive.runs import Campaign, Run

__all__ = ["ForceFriction"]


@dataclass(frozen=True, kw_only=True)
class ForceFriction(Effect):
    """F += coulomb·sgn(v) + offset in the recording of an axis' drive force, N or Nm.

    `offset` is half of what the two directions differ in size (a counterweight, gravity, the amplifier's zero). A run whose
    baseline already holds either (`force_terms`) is left alone. Typical 10–500 N.
    """

    id = "force_friction"
    stage = "reading"
    says = "friction in the drive force"
    hidden_by = "viscous friction and mass, where an axis moves at one speed"
    coordinate = "{axis} velocity sign"
    reported_as = "friction"
    needs_axis = True
    dynamic_only = True
    cut_off_hz: float = 0.0
    rest: float = 0.0

    @property
    def link(self) -> str:
        """The drive is to blame."""
        return DRIVE

    def prepare(self, campaign: Campaign) -> Self:
        prepared = super().prepare(campaign)
        runs = [run for run in campaign.runs if self._seen(run)]
        if not runs:
            raise InputError(
                f"{self.key}: no run records the drive force of {self.axis} without friction in its baseline",
                remedy='record drive_force, or write force_terms = ["mass", "viscous"]',
            )
        unit = self.its_axis(campaign).to_internal
        first = runs[0].options
        return replace(
            prepared, cut_off_hz=float(first.get("low_pass_hz", 0.0)), rest=float(first.get("v_rest", 0.1)) * unit
        )

    def _seen(self, run: Run) -> bool:
        terms = run.options.get("force_terms", ("coulomb", "offset"))
        return driven_axis(run) == self.axis and not {"coulomb", "offset"} & set(terms)

    def applies(self, run: Run) -> bool:
        return super().applies(run) and self._seen(run)

    @classmethod
    def candidates(cls, campaign: Campaign) -> Iterable[Form | Scan | Tone]:
        driven = {axis for run in campaign.runs if (axis := driven_axis(run)) is not None}
        yield from (Form(effect=cls(axis=axis)) for axis in sorted(driven))

    def parameters(self, campaign: Campaign) -> tuple[Parameter, ...]:
        unit = "Nm" if self.its_axis(campaign).rotary else "N"
        return (self.own("coulomb", unit, 100.0), self.own("offset", unit, 100.0))

    def _motion(self) -> Signal:
        if self.cut_off_hz:
            return FilteredMotion(str(self.axis), "direction", self.cut_off_hz, self.rest)
        return Velocity(str(self.axis))

    def signals(self) -> tuple[Signal, ...]:
        return (self._motion(),)

    def apply(self, row: Row) -> None:
        motion = row.signal(self._motion())
        sign = motion if self.cut_off_hz else ca.fmin(ca.fmax(motion / self.rest, -1.0), 1.0)
        for i, source in enumerate(row.sources):
            if source == DriveForce.name:
                row.readings[i] += self.parameter(row, "coulomb") * sign + self.parameter(row, "offset")
