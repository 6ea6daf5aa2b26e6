"""Friction in the drive: lag and spike at reversal (H. Olsson et al. 1998; Stribeck 1902)."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from symfive.effects._axes import reversing
from symfive.effects._base import Campaign, Effect, Forms, Parameter
from symfive.motion import FRICTION

SHAPES = ("coulomb", "stribeck", "lugre")
SIZES = (0.3, 1.0, 3.0)
"""Of friction in usual ones, half a decade apart."""
FAR = 5.0
"""Where the search for the way begins, in usual ones: a way too short to be seen has hardly a slope."""


@dataclass(frozen=True, kw_only=True)
class Friction(Effect):
    """dv/dt = u - F(v)·sgn(v) inside the position loop, F inertia-normalised (mm/s² or rad/s²), set-valued at
    rest.

    `shape`: `coulomb`, F = coulomb; `stribeck`, F = coulomb + stiction·exp(-(v/speed)²): what it has more at
    rest fades over `stribeck_speed`; `lugre`, the same after the contact has yielded over about `pre_sliding`
    (C. Canudas de Wit et al. 1995). The axis stands at a reversal until the integrator has built up twice
    the force: a spike of about coulomb/(position_gain·velocity_gain), 1–15 µm; 10 µm at 40 1/s and 300 1/s is
    120 mm/s².
    """

    id = "friction"
    stage = "drive"
    says = "friction: lag and spike at reversal"
    hidden_by = "a reversal spike of a compensation that comes too late; pre-sliding behind the drive"
    action = "check the lubrication; set the friction compensation of the control"
    terms = (("coulomb", "Coulomb"), ("stribeck_speed", "Stribeck speed"))
    coordinate = "{axis} velocity sign"
    needs_axis = True
    needs_drive = True
    dynamic_only = True
    choices = (("shape", SHAPES),)
    shape: str = "coulomb"

    @classmethod
    def candidates(cls, campaign: Campaign) -> Forms:
        """The longer the axis stands, the less the readings have the shape of little friction: they are looked at about several
        sizes."""
        for axis in reversing(campaign):
            others = tuple(cls(axis=axis, shape=shape) for shape in SHAPES[1:])
            coulomb = cls(axis=axis).parameters(campaign)[0]
            yield from cls(axis=axis).forms_about(coulomb, [share * coulomb.sigma for share in SIZES], *others)

    def parameters(self, campaign: Campaign) -> tuple[Parameter, ...]:
        rotary = self.its_axis(campaign).rotary
        unit, sigma = ("rad/s^2", 2.0) if rotary else ("mm/s^2", 200.0)
        found = [self.own("coulomb", unit, sigma, lower=0.0, start=0.05 * sigma)]
        if self.shape != "coulomb":
            speed = 0.05 if rotary else 2.0
            found.append(self.own("stiction", unit, sigma, lower=0.0, start=0.05 * sigma))
            unit = "rad/s" if rotary else "mm/s"
            found.append(self.own("stribeck_speed", unit, speed, mean=speed, lower=0.05 * speed))
        if self.shape == "lugre":
            way = 10.0 if rotary else 2.0
            unit = self.its_axis(campaign).error_unit
            found.append(self.own("pre_sliding", unit, way, mean=way, lower=0.02 * way, start=FAR * way))
        return tuple(found)

    def frees(self) -> Mapping[tuple[str, str], str]:
        names = FRICTION[: 1 if self.shape == "coulomb" else 3 if self.shape == "stribeck" else 4]
        return {(str(self.axis), name): f"{self.key}.{name}" for name in names}
