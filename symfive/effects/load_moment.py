"""Load moment: an axis gives way under the moment of the weight that it holds out (ISO 230-1, 3.4; ISO 10791-6)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Self

import casadi as ca
import numpy as np

from symfive.effects._base import Campaign, Covariance, Effect, Form, Forms, Parameter, Quantity, Row, Values
from symfive.effects._force import DOWN, carriers, gravity_seen, later_axes
from symfive.effects._quantity import propagated
from symfive.errors import InputError
from symfive.kinematics import axis_pose

TOOL = "tool"


@dataclass(frozen=True, kw_only=True)
class LoadMoment(Effect):
    """(EAj, EBj, ECj) += Σ_k w_k·(p_k - o_j) × ĝ, µrad: the moment of what axis j carries over its tilting stiffness.

    k runs over the axes that j carries and the tool; p_k is where k's origin (the tool's ball) is as the axes stand, o_j the
    origin of j, ĝ gravity's unit vector, all in the frame of what j carries; w_k (µrad/m) the weight there over the stiffness
    of j. So it follows the reach of the later axes, not only the turning of gravity. A linear axis that slides along a
    column, q from its zero, also has h_k (µrad/m²): the column bends as a beam clamped at zero, by h_k·q and with half of it as
    shift across, q²/2·h_k (S. Timoshenko 1955, §20). `down` gravity in the machine frame. Typical 5–50 µrad/m.
    """

    id = "load_moment"
    says = "an axis bends under the moment of its overhanging load"
    hidden_by = "squareness and error motions of the later axes, where only one of them moves"
    action = "enter a compensation over the positions of both axes in the control; check the preload of the guideway"
    terms = (("w", "tilt by the load at {}"), ("h", "bending by the load at {}"), ("tool", "the tool"))
    coordinate = "pose"
    reported_as = "gravity_sag"
    needs_axis = True
    down: tuple[float, float, float] = DOWN

    def prepare(self, campaign: Campaign) -> Self:
        prepared = super().prepare(campaign)
        later = later_axes(campaign.machine, str(self.axis))
        if not any(np.ptp(run.commands[name]) > 0.0 for run in campaign.runs for name in later):
            raise InputError(f"{self.key}: the axes that it carries do not move", remedy="name an axis before them")
        return prepared

    @classmethod
    def candidates(cls, campaign: Campaign) -> Forms:
        yield from (Form(effect=cls(axis=axis)) for axis in campaign.machine.axis_names)

    def parameters(self, campaign: Campaign) -> tuple[Parameter, ...]:
        loads = (*later_axes(campaign.machine, str(self.axis)), TOOL)
        found = [self.own(f"w.{load}", "urad/m", 10.0) for load in loads]
        if not self.its_axis(campaign).rotary:
            found += [self.own(f"h.{load}", "urad/m^2", 10.0) for load in loads]
        return tuple(found)

    def apply(self, row: Row) -> None:
        machine, name = row.machine, str(self.axis)
        own = machine.axes[name]
        names = carriers(machine, name) if not own.rotary else (*carriers(machine, name), name)
        down = gravity_seen(row, names, self.down)
        hinge, beam = ca.SX(3, 1), ca.SX(3, 1)
        for load, place in self._load_positions(row).items():
            moment = ca.cross(place - ca.DM(own.origin), down)
            hinge += self.parameter(row, f"w.{load}") * moment
            if not own.rotary:
                beam += self.parameter(row, f"h.{load}") * moment
        along, q = ca.DM(own.direction), row.axis[name]
        tilt = hinge if own.rotary else hinge + beam * q
        for i, letter in enumerate("ABC"):
            row.add_motion(f"E{letter}{name}", tilt[i])
        if not own.rotary:
            shift = ca.cross(hinge * q + 0.5 * beam * q**2, along)
            for i, letter in enumerate("XYZ"):
                row.add_motion(f"E{letter}{name}", shift[i])

    def _load_positions(self, row: Row) -> dict[str, Any]:
        """Where the loads stand in the frame of what the axis carries, mm."""
        machine, name = row.machine, str(self.axis)
        later, side = later_axes(machine, name), machine.structure.carries(name)
        poses = {k: axis_pose(machine.axes[k], side, row.axis[k], {}, {}) for k in later}
        found = {}
        for number, load in enumerate((*later, TOOL)):
            held = row.tool_ball if side == "tool" else row.table_ball
            place = held if load == TOOL else ca.DM(machine.axes[load].origin)
            for k in reversed(later[: number + (load != TOOL)]):
                place = poses[k].apply(place)
            found[load] = place
        return found

    def describe(self, campaign: Campaign, values: Values, covariance: Covariance) -> dict[str, Quantity]:
        """`amplitude`: w of all loads together, µrad for 1 m of reach; and each load's."""
        names = [p.name for p in self.parameters(campaign) if f"{self.key}.w." in p.name]
        size = propagated(lambda p: float(p.sum()), names, "urad/m", values, covariance)
        own = super().describe(campaign, values, covariance)
        return {"component": Quantity(f"tilt of {self.axis}"), "amplitude": size, **own}
