"""Gravity sag: what a tilting axis carries bends as gravity turns in its frame (ISO 230-1, 3.4; ISO 10791-6)."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Self

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from symfive.effects._base import Effect
from symfive.effects._component import component_of
from symfive.effects._form import Form, Scan, Tone, moving
from symfive.effects._gravity import DOWN, carriers, gravity_seen
from symfive.effects._quantity import Covariance, Quantity, Values
from symfive.errors import InputError
from symfive.motion import Direction
from symfive.parameters import Parameter

if TYPE_CHECKING:
    from symfive.campaign import Campaign
    from symfive.machine import Machine
    from symfive.model._row import Row
    from symfive.motion import Signal

PARTS = ("sin", "one_minus_cos", "sin_cubed", "branch")
OTHERS = (("sin",), ("one_minus_cos",), ("sin", "sin_cubed"), ("sin", "branch"), ("sin", "one_minus_cos", "branch"))
"""Parts of other shapes."""
HORIZONTAL_SINE = 1e-6
FURTHER = 0.3
"""What makes a sag other than elastic and linear is the smaller part: prior 1σ of `sin_cubed` and `branch` over that of `sin`."""


@dataclass(frozen=True, kw_only=True)
class GravitySag(Effect):
    """`component` += sin·Δg_h + one_minus_cos·Δg_v, where Δg is the change of gravity's unit vector in the
    tilted body.

    With Rᵀ the rotation into the body that `axis` carries, Δg = Rᵀĝ - ĝ. Δg_h is its part along the
    horizontal across the axis, Δg_v its part against ĝ across the axis, both over the sine of the axis' angle to
    gravity: for an axis that no other one carries exactly sin q and 1 - cos q, with tilting axes in front of it
    their turning too. A vertical axis behind a tilting one has no such
    directions: there Δg is taken along its x and y. `component` is an error motion of this or another axis
    (`EZB`; µm or µrad at sin q = 1), `parts` which of the two are fitted, `down` gravity in the
    machine frame. Two further parts: `sin_cubed`, Δg_h³, is a structure that stiffens (or yields) under load, to first order;
    `branch`, -s of the axis' direction of motion, one that comes back by another way than it went (dry friction in it).
    Typical 2–20 µm, 5–50 µrad, growing with the load.
    """

    id = "gravity_sag"
    says = "what a tilting axis carries sags as gravity turns in its frame"
    hidden_by = "location errors of the rotary axes (99 % of it where the axis only tilts one way)"
    coordinate = "{axis}"
    needs_axis = True
    component: str
    parts: tuple[str, ...] = PARTS[:2]
    down: tuple[float, float, float] = DOWN

    @property
    def key(self) -> str:
        """`gravity_sag.B.EZB`."""
        return self._key(self.axis, self.component)

    def prepare(self, campaign: Campaign) -> Self:
        super().prepare(campaign)
        machine = campaign.machine
        component_of(self.component, machine)
        if not self.parts or any(part not in PARTS for part in self.parts):
            raise InputError(f"{self.key}: parts {self.parts!r} are unknown", remedy=f"use {' and '.join(PARTS)}")
        if not machine.axes[str(self.axis)].rotary:
            raise InputError(f"{self.key}: a linear axis does not tilt", remedy="name the tilting axis")
        tilts = (*carriers(machine, str(self.axis)), str(self.axis))
        if all(_sine(machine, name, self.down) < HORIZONTAL_SINE for name in tilts):
            raise InputError(f"{self.key}: gravity does not turn in its frame", remedy="name the tilting axis")
        held = machine.errors.get(self.component)
        if held is not None and held.over == (self.axis,) and held.basis == ("fourier",):
            raise InputError(
                f"the baseline already holds {self.component} as harmonics of {self.axis}, and sag is its first",
                remedy="choose another component",
            )
        return self

    @classmethod
    def candidates(cls, campaign: Campaign) -> Iterable[Form | Scan | Tone]:
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
        return (Direction(str(self.axis)),) if "branch" in self.parts else ()

    def apply(self, row: Row) -> None:
        across, against = self._directions(row.machine)
        change = gravity_seen(row, (*carriers(row.machine, str(self.axis)), str(self.axis)), self.down) - ca.DM(
            np.asarray(self.down) / np.linalg.norm(self.down)
        )
        horizontal, upright = ca.dot(ca.DM(across), change), ca.dot(ca.DM(against), change)
        sizes = dict(zip(PARTS, (horizontal, upright, horizontal**3), strict=False))
        if "branch" in self.parts:
            sizes["branch"] = -row.signal(self.signals()[0])
        for part in self.parts:
            row.add_motion(self.component, self.parameter(row, part) * sizes[part])

    def _directions(self, machine: Machine) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Vectors in the body whose products with Δg are sin q and 1 - cos q."""
        axis = machine.axes[str(self.axis)]
        direction, down = np.asarray(axis.direction), np.asarray(self.down) / np.linalg.norm(self.down)
        across = np.cross(direction, down)
        size = np.linalg.norm(across)
        if size < HORIZONTAL_SINE:
            first = np.eye(3)[np.argmin(np.abs(direction))]
            first = first - direction * (direction @ first)
            first /= np.linalg.norm(first)
            return first, np.cross(direction, first)
        sign = 1.0 if machine.structure.carries(axis.name) == "workpiece" else -1.0
        upright = direction * (direction @ down) - down
        return sign * across / size**2, upright / size**2

    def describe(self, campaign: Campaign, values: Values, covariance: Covariance) -> dict[str, Quantity]:
        """`amplitude` is that of sin (or of the only part), `amplitude_one_minus_cos` the other one."""
        found = super().describe(campaign, values, covariance)
        names = {part: "amplitude" if part == self.parts[0] else f"amplitude_{part}" for part in self.parts}
        return {"component": Quantity(self.component)} | {names[part]: found[part] for part in self.parts}


def _sine(machine: Machine, axis: str, down: tuple[float, float, float]) -> float:
    return float(np.linalg.norm(np.cross(machine.axes[axis].direction, down)) / np.linalg.norm(down))
