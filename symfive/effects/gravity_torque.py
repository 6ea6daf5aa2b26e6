"""Gravity torque: the weight of what a rotary axis carries loads its drive (W. Khalil & E. Dombre 2002, section 9.4)."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Self

import casadi as ca
import numpy as np

from symfive.arrays import Array
from symfive.effects._base import FORCE, Campaign, Covariance, Parameter, Quantity, Row, Values
from symfive.effects._force import DOWN, ForceEffect, carriers, gravity_seen, turned_bodies, upright, usual_force
from symfive.effects._quantity import propagated
from symfive.errors import InputError
from symfive.instruments.drive_force import DriveForce
from symfive.kinematics import axis_pose

USUAL = 0.5
"""Prior 1σ of a weight moment as a share of the recorded torque (rms): that of a tilted axis is mostly weight and inertia."""


@dataclass(frozen=True, kw_only=True)
class GravityTorque(ForceEffect):
    """F += Σ_k s_k·(ĝ_k × e_k) in the recording of a rotary axis' drive torque, Nm.

    Over this axis and the rotary axes that it carries, k: ĝ_k is gravity's unit vector and e_k the direction of this axis, both
    in the frame of the body that axis k turns; s_k (3) the weight moment of that body and of what stands on it as if it did not
    turn, N m (weight times place of the centre of mass). What gravity does to the axis is linear in these. `down` gravity in the
    machine frame. Prior 1σ `sigma_torque`: a share of the recorded torque's rms.
    """

    id = "gravity_torque"
    says = "the weight of its load acts on the drive of an axis"
    hidden_by = "Coulomb friction and offset, where the axis moves in one direction over a short path"
    action = "set the weight compensation (torque feed-forward) of the drive; check the counterbalance"
    coordinate = "{axis}"
    reported_as = "gravity_sag"
    down: tuple[float, float, float] = DOWN
    sigma_torque: float = 0.0

    @property
    def answers(self) -> tuple[str, str] | None:
        """A course of the torque over the axis that is a little off."""
        return FORCE, str(self.axis)

    def prepare(self, campaign: Campaign) -> Self:
        prepared = super().prepare(campaign)
        machine, axis = campaign.machine, self.its_axis(campaign)
        if not axis.rotary:
            raise InputError(f"{self.key}: the weight on a linear axis is constant", remedy="name a rotary axis")
        if all(upright(machine, name, self.down) for name in (*carriers(machine, axis.name), axis.name)):
            raise InputError(f"{self.key}: the axis stands upright, no weight loads it", remedy="name a tilted axis")
        if not any(map(self.applies, campaign.runs)):
            raise InputError(f"{self.key}: no run records the drive torque of {self.axis}", remedy="record drive_force")
        return replace(prepared, sigma_torque=self.sigma_torque or usual_force(campaign, str(self.axis), USUAL))

    def parameters(self, campaign: Campaign) -> tuple[Parameter, ...]:
        bodies = turned_bodies(campaign.machine, str(self.axis))
        return tuple(self.own(f"{body}.{c}", "Nm", self.sigma_torque or 1.0) for body in bodies for c in "xyz")

    def apply(self, row: Row) -> None:
        carried = carriers(row.machine, str(self.axis))
        along = ca.DM(row.machine.axes[str(self.axis)].direction)
        torque = ca.SX(0)
        for body in turned_bodies(row.machine, str(self.axis)):
            carried = (*carried, body)
            if body != self.axis:
                side = row.machine.structure.carries(body)
                along = axis_pose(row.machine.axes[body], side, row.axis[body], {}, {}).rotation.T @ along
            arm = ca.cross(gravity_seen(row, carried, self.down), along)
            torque += ca.dot(ca.vertcat(*(self.parameter(row, f"{body}.{c}") for c in "xyz")), arm)
        row.add_reading(DriveForce.name, torque)

    def describe(self, campaign: Campaign, values: Values, covariance: Covariance) -> dict[str, Quantity]:
        """`amplitude`: of the weight moment about the axis of all that it carries, all later axes at zero; and each body's."""
        axis, bodies = self.its_axis(campaign), turned_bodies(campaign.machine, str(self.axis))
        across = np.eye(3) - np.outer(axis.direction, axis.direction)
        names = [f"{self.key}.{body}.{c}" for body in bodies for c in "xyz"]

        def whole(p: Array) -> float:
            return float(np.linalg.norm(across @ p.reshape(-1, 3).sum(axis=0)))

        size = propagated(whole, names, "Nm", values, covariance)
        own = super().describe(campaign, values, covariance)
        return {"component": Quantity(f"torque of {self.axis}"), "amplitude": size, **own}
