"""Gravity sag: what a tilting axis carries bends as gravity turns in its frame (ISO 230-1, 3.4; ISO 10791-6)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Self

import casadi as ca
import numpy as np

from symfive.arrays import Array
from symfive.effects._axes import component_of, moving
from symfive.effects._base import Campaign, Covariance, Form, Forms, Parameter, Quantity, Row, Run, Values
from symfive.effects._contact import Contact
from symfive.effects._force import DOWN, across, carriers, gravity_seen, sine_to_gravity, upright
from symfive.errors import InputError
from symfive.machine import Machine
from symfive.motion import Direction, Signal

PARTS = ("sin", "one_minus_cos", "sin_cubed", "branch")
OTHERS = (("sin",), ("one_minus_cos",), ("sin", "sin_cubed"), ("sin", "branch"), ("sin", "one_minus_cos", "branch"))
"""Parts of other shapes."""
FURTHER = 0.3
"""What makes a sag other than elastic and linear is the smaller part: prior 1σ of `sin_cubed` and `branch` over that of `sin`."""


@dataclass(frozen=True, kw_only=True)
class GravitySag(Contact):
    """`component` += sin·Δg_h + one_minus_cos·Δg_v, where Δg is the change of gravity's unit vector in the
    tilted body.

    With Rᵀ the rotation into the body that `axis` carries, Δg = Rᵀĝ - ĝ. Δg_h is its part along the
    horizontal across the axis, Δg_v its part against ĝ across the axis (unit vectors): for an axis that no other one
    carries s·sin q and s·(1 - cos q), s the sine of its angle to gravity; with tilting axes in front of it
    their turning too. A vertical axis behind a tilting one has no such
    directions: there Δg is taken along its x and y. `component` is an error motion of this or another axis
    (`EZB`; µm or µrad for a change by 1 g), `parts` which of the two are fitted, `down` gravity in the
    machine frame. Two further parts: `sin_cubed`, Δg_h³, is a structure that stiffens (or yields) under load, to first order;
    `branch`, -s of the axis' direction of motion, one that comes back by another way than it went (dry friction in it).
    Typical 2–20 µm, 5–50 µrad, growing with the load: an axis that is nearly vertical sags by as much less as gravity
    turns less in its frame.
    """

    id = "gravity_sag"
    says = "the part carried by a tilting axis sags as gravity turns in its frame"
    hidden_by = "location errors of the rotary axes (99 % of it where the axis only tilts one way)"
    action = (
        "enter a compensation over the position of the tilting axis in the control; check its clamping and bearings"
    )
    terms = (
        ("sin", "sine part"),
        ("one_minus_cos", "1 − cos part"),
        ("sin_cubed", "sin³ part"),
        ("branch", "hysteresis"),
    )
    coordinate = "{axis}"
    needs_axis = True
    component: str
    parts: tuple[str, ...] = PARTS[:2]
    down: tuple[float, float, float] = DOWN

    def prepare(self, campaign: Campaign) -> Self:
        super().prepare(campaign)
        machine = campaign.machine
        component_of(self.component, machine)
        if not self.parts or any(part not in PARTS for part in self.parts):
            raise InputError(f"{self.key}: parts {self.parts!r} are unknown", remedy=f"use {' and '.join(PARTS)}")
        if not machine.axes[str(self.axis)].rotary:
            raise InputError(f"{self.key}: a linear axis does not tilt", remedy="name the tilting axis")
        if not self._tilted(campaign) and upright(machine, str(self.axis), self.down):
            raise InputError(f"{self.key}: gravity does not turn in its frame", remedy="name the tilting axis")
        held = machine.errors.get(self.component)
        if held is not None and held.over == (self.axis,) and held.basis == ("fourier",):
            raise InputError(
                f"the baseline already holds {self.component} as harmonics of {self.axis}, and sag is its first",
                remedy="choose another component",
            )
        return self

    @classmethod
    def candidates(cls, campaign: Campaign) -> Forms:
        for axis in moving(campaign):
            for letter in "XYZABC":
                symbol = f"E{letter}{axis}"
                others = tuple(cls(axis=axis, component=symbol, parts=parts) for parts in OTHERS)
                yield Form(effect=cls(axis=axis, component=symbol), shapes=others)
                yield Form(effect=cls(axis=axis, component=symbol, parts=PARTS, tag="yielding"), shapes=others)

    def parameters(self, campaign: Campaign) -> tuple[Parameter, ...]:
        component = component_of(self.component, campaign.machine)
        usual = 20.0 if component.angular else 10.0
        return tuple(
            self.own(part, component.unit, usual * (FURTHER if part in PARTS[2:] else 1.0)) for part in self.parts
        )

    def signals(self) -> tuple[Signal, ...]:
        return (Direction(str(self.axis), self.started),) if "branch" in self.parts else ()

    def starts(self, run: Run) -> tuple[Parameter, ...]:
        return self.start_of_contact(run, str(self.axis), memory=False) if "branch" in self.parts else ()

    def apply(self, row: Row) -> None:
        level, against = self._directions(row.machine)
        change = gravity_seen(row, (*carriers(row.machine, str(self.axis)), str(self.axis)), self.down) - ca.DM(
            np.asarray(self.down) / np.linalg.norm(self.down)
        )
        horizontal, vertical = ca.dot(ca.DM(level), change), ca.dot(ca.DM(against), change)
        sizes = dict(zip(PARTS, (horizontal, vertical, horizontal**3), strict=False))
        if "branch" in self.parts:
            sizes["branch"] = -row.signal(self.signals()[0])
        for part in self.parts:
            row.add_motion(self.component, self.parameter(row, part) * sizes[part])

    def _directions(self, machine: Machine) -> tuple[Array, Array]:
        """Unit vectors in the body across the axis: the horizontal one, and the one against gravity."""
        axis = machine.axes[str(self.axis)]
        direction, down = np.asarray(axis.direction), np.asarray(self.down) / np.linalg.norm(self.down)
        if upright(machine, axis.name, self.down):
            return across(direction)
        horizontal = np.cross(direction, down)
        horizontal *= (1.0 if machine.structure.carries(axis.name) == "workpiece" else -1.0) / np.linalg.norm(
            horizontal
        )
        against = direction * (direction @ down) - down
        return horizontal, against / np.linalg.norm(against)

    def _tilted(self, campaign: Campaign) -> bool:
        """Whether an axis in front of it turns gravity in its frame."""
        machine = campaign.machine
        tilting = [name for name in carriers(machine, str(self.axis)) if not upright(machine, name, self.down)]
        return any(np.any(run.commands[name]) for run in campaign.runs for name in tilting)

    def describe(self, campaign: Campaign, values: Values, covariance: Covariance) -> dict[str, Quantity]:
        """`amplitude` is that of sin (or of the only part), `amplitude_one_minus_cos` the other one, both at sin q = 1: of an
        axis that no tilting one carries the sine of its angle to gravity times that of 1 g."""
        machine, found = campaign.machine, super().describe(campaign, values, covariance)
        reach = 1.0 if self._tilted(campaign) else sine_to_gravity(machine, str(self.axis), self.down)
        times = dict(zip(PARTS, (reach, reach, reach**3, 1.0), strict=True))
        names = {part: "amplitude" if part == self.parts[0] else f"amplitude_{part}" for part in self.parts}
        sizes = {names[part]: found[part].times(times[part]) for part in self.parts}
        return {"component": Quantity(self.component)} | sizes
