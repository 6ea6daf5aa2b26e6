"""Friction as the drive's force shows it: a level for each direction of motion (A. Janot, M. Gautier & M. Brunot 2019)."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Self

import casadi as ca

from symfive.effects._base import FORCE, Campaign, Form, Forms, Parameter, Quantity, Row, Run
from symfive.effects._force import ForceEffect, direction, driven_axes, motion_signal
from symfive.errors import InputError
from symfive.instruments.drive_force import DriveForce, driven_axis, rest_speed
from symfive.motion import Position, Signal

OF_SPEED = ("coulomb", "offset", "skew", "stribeck")
PARTS = (*OF_SPEED, "along")
OTHERS = (OF_SPEED[:3], ("coulomb", "offset", "stribeck"))
"""Parts of other shapes of one that depends on the speed."""
USUAL_SPEED = 0.1
"""Characteristic speed, prior mean and 1σ, as a share of the highest."""


@dataclass(frozen=True, kw_only=True)
class ForceFriction(ForceEffect):
    """F += (coulomb + along·q)·sgn(v) + offset + skew·|v| + stribeck·sgn(v)·exp(-|v|/speed) in the recording of an axis' drive
    force, N or Nm.

    `parts` are those of the five that are fitted: Coulomb friction and `offset`, half of what the two directions differ in size
    (a counterweight, gravity, the amplifier's zero); `skew` (N s/m or Nm s/rad), by which viscous friction differs between them;
    `along` (N/m or Nm/rad), Coulomb friction that changes along the axis, as with the preload of a screw or a guideway;
    `stribeck`, friction that fades (or, below 0, builds up) within a characteristic `speed` (mm/s or degree/s; B.
    Armstrong-Hélouvry, P. Dupont & C. Canudas de Wit 1994). A run whose baseline already holds one of them (`force_terms`) is
    left alone. Typical 10–500 N.
    """

    id = "force_friction"
    says = "friction in the drive force"
    hidden_by = "viscous friction and mass, where an axis moves at one speed"
    action = "compare with an earlier recording; if friction has risen, check lubrication and preload"
    terms = (
        ("coulomb", "Coulomb"),
        ("skew", "difference of the directions"),
        ("along", "change along the axis"),
        ("stribeck", "Stribeck"),
        ("speed", "Stribeck speed"),
    )
    coordinate = "{axis} velocity sign"
    reported_as = "friction"
    dynamic_only = True
    parts: tuple[str, ...] = PARTS[:2]
    cut_off_hz: float = 0.0
    rest: float = 0.0
    usual: float = 0.0

    @property
    def answers(self) -> tuple[str, str] | None:
        """Where the speed counts, a course over the speed that is a little off."""
        return (FORCE, f"{self.axis} velocity") if self._fast else None

    def prepare(self, campaign: Campaign) -> Self:
        prepared = super().prepare(campaign)
        runs = [run for run in campaign.runs if self._seen(run)]
        if not runs:
            raise InputError(
                f"{self.key}: no run records the drive force of {self.axis} without friction in its baseline",
                remedy='record drive_force, or write force_terms = ["mass", "viscous"]',
            )
        if not self.parts or any(part not in PARTS for part in self.parts):
            raise InputError(f"{self.key}: parts {self.parts!r} are unknown", remedy=f"use some of {', '.join(PARTS)}")
        unit = self.its_axis(campaign).to_internal
        fastest = max(run.fastest(run.commands[str(self.axis)]) / 60.0 for run in runs)
        return replace(
            prepared, cut_off_hz=float(runs[0].options.get("low_pass_hz", 0.0)), rest=rest_speed(runs[0]) * unit,
            usual=self.usual or USUAL_SPEED * fastest,
        )  # fmt: skip

    def _seen(self, run: Run) -> bool:
        held, own = set(run.options.get("force_terms", PARTS[:2])) & set(PARTS[:2]), set(self.parts) & set(PARTS[:2])
        return driven_axis(run) == self.axis and not held & own and bool(held | own)

    @classmethod
    def candidates(cls, campaign: Campaign) -> Forms:
        for axis in driven_axes(campaign):
            others = tuple(cls(axis=axis, parts=parts, tag="speed") for parts in OTHERS)
            yield Form(effect=cls(axis=axis))
            yield Form(effect=cls(axis=axis, parts=OF_SPEED, tag="speed"), shapes=others)
            more = tuple(cls(axis=axis, parts=(part,), tag="speed") for part in OF_SPEED[2:])
            yield Form(effect=cls(axis=axis, parts=OF_SPEED[2:], tag="speed"), shapes=more)  # beside the baseline's own
            yield Form(effect=cls(axis=axis, parts=("along",), tag="place"))

    def advice(self, sizes: Mapping[str, Quantity]) -> tuple[str, str]:
        if "along" in sizes:
            return (
                "friction that changes along the axis",
                "check preload, alignment and lubrication of screw and guideway where the friction is larger",
            )
        return self.says, self.action

    def parameters(self, campaign: Campaign) -> tuple[Parameter, ...]:
        axis = self.its_axis(campaign)
        unit, rate, slope = ("Nm", "Nm s/rad", "Nm/rad") if axis.rotary else ("N", "N s/m", "N/m")
        units = {"skew": rate, "along": slope}
        found = [self.own(part, units.get(part, unit), 100.0) for part in self.parts]
        if "stribeck" in self.parts:
            speed = self.usual or 1.0
            found.append(self.own("speed", f"{axis.unit}/s", speed, mean=speed, lower=1e-2 * speed))
        return tuple(found)

    def signals(self) -> tuple[Signal, ...]:
        wanted = ("direction", "velocity") if self._fast else ("direction",)
        found = [motion_signal(str(self.axis), quantity, self.cut_off_hz, self.rest) for quantity in wanted]
        return tuple(dict.fromkeys([*found, *([Position(str(self.axis))] if "along" in self.parts else [])]))

    @property
    def _fast(self) -> bool:
        """Whether the speed counts, and not the direction alone."""
        return bool({"skew", "stribeck"} & set(self.parts))

    def apply(self, row: Row) -> None:
        sign = direction(row, str(self.axis), self.cut_off_hz, self.rest)
        functions = {"coulomb": sign, "offset": 1.0}
        metre = 1.0 if row.machine.axes[str(self.axis)].rotary else 1e-3
        if "along" in self.parts:
            functions["along"] = sign * row.signal(Position(str(self.axis))) * metre
        if self._fast:
            speed = ca.fabs(row.signal(motion_signal(str(self.axis), "velocity", self.cut_off_hz)))
            functions["skew"] = speed * metre
            if "stribeck" in self.parts:
                functions["stribeck"] = sign * ca.exp(-speed / self.parameter(row, "speed"))
        force = sum(self.parameter(row, part) * functions[part] for part in self.parts)
        row.add_reading(DriveForce.name, force)
