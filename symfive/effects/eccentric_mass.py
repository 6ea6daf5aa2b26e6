"""Eccentric mass: a load beside a rotary axis tilts the table under it as it turns (ISO 10791-6; ISO 230-7)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Self

import casadi as ca
import numpy as np

from symfive.effects._base import Campaign, Covariance, Effect, Parameter, Quantity, Row, Values
from symfive.effects._force import DOWN, across, carriers, gravity_seen
from symfive.effects._quantity import amplitude_and_phase
from symfive.errors import InputError
from symfive.kinematics import axis_pose


@dataclass(frozen=True, kw_only=True)
class EccentricMass(Effect):
    """(EAj, EBj, ECj) += (R·r) × ĝ without its part along the axis, µrad: moment of a mass at r across the axis, over the
    tilting stiffness of its bearing. The moment about the axis itself is held by the drive.

    R turns with the axis, ĝ is gravity in the frame of what carries the axis, so a tilting axis in front of
    it enters. r = cos·u + sin·w, u and w across the axis (x and y for C). Typical 5–50 µrad, 1–10 µm at the
    rim.
    """

    id = "eccentric_mass"
    says = "an eccentric mass tilts the table as it turns"
    hidden_by = "axis tilt and tilt error motion; moving the mass by half a revolution separates them"
    action = "balance or move the mass on the table; check the bearing of the table"
    coordinate = "{axis}"
    reported_as = "error_motion"
    needs_axis = True
    down: tuple[float, float, float] = DOWN

    def prepare(self, campaign: Campaign) -> Self:
        super().prepare(campaign)
        machine = campaign.machine
        if not self.its_axis(campaign).rotary:
            raise InputError(f"{self.key}: a linear axis does not turn a mass", remedy="name the rotary axis")
        held = [machine.errors.get(f"E{c}{self.axis}") for c in "ABC"]
        alone = not carriers(machine, str(self.axis))
        if alone and any(t is not None and t.over == (self.axis,) and t.basis == ("fourier",) for t in held):
            raise InputError(
                f"the baseline already holds the tilt of {self.axis} once per revolution", remedy="leave it there"
            )
        return self

    def parameters(self, campaign: Campaign) -> tuple[Parameter, ...]:
        return (self.own("cos", "urad", 10.0), self.own("sin", "urad", 10.0))

    def apply(self, row: Row) -> None:
        axis = row.machine.axes[str(self.axis)]
        along = np.asarray(axis.direction)
        first, second = across(along)
        arm = self.parameter(row, "cos") * ca.DM(first) + self.parameter(row, "sin") * ca.DM(second)
        turned = axis_pose(axis, row.machine.structure.carries(axis.name), row.axis[axis.name], {}, {}).rotation @ arm
        moment = ca.cross(turned, gravity_seen(row, carriers(row.machine, axis.name), self.down))
        tilt = moment - ca.DM(along) * ca.dot(ca.DM(along), moment)
        for i, letter in enumerate("ABC"):
            row.add_motion(f"E{letter}{axis.name}", tilt[i])

    def describe(self, campaign: Campaign, values: Values, covariance: Covariance) -> dict[str, Quantity]:
        """`amplitude`, and `place`: the angle of the mass from u at zero of the axis."""
        amplitude, place = amplitude_and_phase(f"{self.key}.cos", f"{self.key}.sin", "urad", values, covariance)
        return {"component": Quantity(f"EA{self.axis}, EB{self.axis}"), "amplitude": amplitude, "place": place}
