"""Held friction: the force up to its level that friction holds while an axis stands between its motions, another in each rest."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Self

import casadi as ca
import numpy as np

from symfive.effects._base import Campaign, Covariance, Form, Forms, Parameter, Quantity, Row, Values
from symfive.effects._force import SizedForce, direction, driven_axes, motion_signal
from symfive.effects._quantity import own_quantity
from symfive.errors import InputError
from symfive.instruments.drive_force import DriveForce, moved, rest_counts, rest_speed, stands
from symfive.motion import RunMotion, Series, Signal

SHAPES = ("side", "each")
SHORTEST = 4
"""Intervals of a rest at least: the velocity of a row is taken over two, and that of its neighbours must be that at rest, too. A
reversal stands for less."""
Rest = tuple[str, float, float, float]
"""Run, begin and end (s on its clock), and the side (±1) to which the axis moved before."""


@dataclass(frozen=True)
class AtRest:
    """Number of the rest in which a row lies, from 1, or its side; 0 in motion."""

    rests: tuple[Rest, ...]
    number: bool

    @property
    def parameters(self) -> tuple[str, ...]:
        """None: the rests are known."""
        return ()

    def series(self, motion: RunMotion) -> Series:
        """Its values along the run."""
        time, found = motion.run.time, np.zeros(motion.run.rows)
        for number, (run, begin, end, side) in enumerate(self.rests, start=1):
            if run == motion.run.id:
                found[(time >= begin) & (time <= end)] = number if self.number else side
        return Series(found)


@dataclass(frozen=True, kw_only=True)
class HeldFriction(SizedForce):
    """F += hold·(1 - |s|) at rest, in the recording of an axis' drive force, N or Nm; s = v/`v_rest` within ±1, the share of the
    friction of the moving axis.

    Where an axis stands, its motion does not determine friction: that holds what the drive left there (D. Karnopp 1985). `shape`:
    `each`, another force in each rest; `side`, hold·(side - s), side ±1 that to which the axis moved before: as it came to rest.
    Rests are those of the recording (`v_rest`), written into the effect. A run whose rests count nowhere (`at_rest = "ignored"`)
    has none, nor has one that only rests.
    """

    id = "held_friction"
    says = "friction holds the axis at rest with a force that its motion does not determine"
    hidden_by = "gravity that changes with the pose, where every rest has a pose of its own"
    action = "none: every drive with friction does so, and the machine needs no repair"
    terms = (("each", "each rest by itself"),)
    coordinate = "t"
    reported_as = "friction"
    state = "at rest"
    dynamic_only = True
    choices = (("shape", SHAPES),)
    shape: str = "side"
    rests: tuple[Rest, ...] = ()
    cut_off_hz: float = 0.0
    v_rest: float = 0.0

    @property
    def key(self) -> str:
        """`held_friction.X`, `held_friction.X.each`."""
        return self._key(self.axis, "each" if self.shape == "each" else None)

    @classmethod
    def candidates(cls, campaign: Campaign) -> Forms:
        yield from (Form(effect=cls(axis=axis, shape=shape)) for axis in driven_axes(campaign) for shape in SHAPES)

    def prepare(self, campaign: Campaign) -> Self:
        prepared = super().prepare(campaign)
        if self.rests:
            return prepared  # what was prepared for a campaign stays so for some of its runs
        runs = [run for run in campaign.runs if self.applies(run) and rest_counts(run)]
        rests = list[Rest]()
        for run in runs:
            still, way = stands(run, campaign.machine), moved(run, campaign.machine)
            edges = np.flatnonzero(np.diff(np.concatenate([[False], still, [False]]))).reshape(-1, 2)
            edges = edges[np.diff(edges)[:, 0] >= SHORTEST]
            came = np.sign(way[edges[:, 0]] - way[np.append(0, edges[:-1, 1])])
            for (begin, end), side in zip(run.time[edges], came, strict=True):
                rests.append((run.id, float(begin), float(end), float(side)))
        if not rests:
            problem = f"{self.key}: axis {self.axis} never rests between motions, or its rests are ignored"
            raise InputError(problem, remedy="leave the effect away")
        unit = self.its_axis(campaign).to_internal
        cut_off = float(runs[0].options.get("low_pass_hz", 0.0))
        return replace(prepared, rests=tuple(rests), v_rest=rest_speed(runs[0]) * unit, cut_off_hz=cut_off)

    def parameters(self, campaign: Campaign) -> tuple[Parameter, ...]:
        names = ["hold"] if self.shape == "side" else [f"hold_{k}" for k in range(1, len(self.rests) + 1)]
        return tuple(self.own(name, self.force_unit(campaign), self.sigma_force or 1.0) for name in names)

    def signals(self) -> tuple[Signal, ...]:
        return (self._at_rest, motion_signal(str(self.axis), "direction", self.cut_off_hz, self.v_rest))

    @property
    def _at_rest(self) -> AtRest:
        return AtRest(self.rests, self.shape == "each")

    def apply(self, row: Row) -> None:
        where, share = row.signal(self._at_rest), direction(row, str(self.axis), self.cut_off_hz, self.v_rest)
        if self.shape == "side":
            force = self.parameter(row, "hold") * (where - share) * (where != 0.0)
        else:
            numbers = range(1, len(self.rests) + 1)
            holds = ca.vertcat(*(self.parameter(row, f"hold_{number}") for number in numbers))
            force = ca.dot(holds, where == ca.DM(list(numbers))) * (1.0 - ca.fabs(share))
        row.add_reading(DriveForce.name, force)

    def describe(self, campaign: Campaign, values: Values, covariance: Covariance) -> dict[str, Quantity]:
        """The largest, and in how many rests it was recorded."""
        if self.shape == "side":
            return super().describe(campaign, values, covariance)
        largest = max(self.parameters(campaign), key=lambda p: abs(values[p.name]))
        return {
            "largest_hold": own_quantity(largest, values, covariance),
            "rests": Quantity(float(len(self.rests)), None, "1"),
        }
