"""What effects in the recorded force of a drive share; gravity as the bodies of the chain see it when rotary axes tilt them."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any, Self

import casadi as ca
import numpy as np

from symfive.arrays import Array
from symfive.effects._base import DRIVE, Campaign, Effect, Form, Forms, Row, Run
from symfive.errors import InputError
from symfive.instruments.drive_force import DriveForce, FilteredMotion, driven_axis
from symfive.kinematics import axis_pose
from symfive.machine import Machine
from symfive.motion import Signal, Velocity

FORCE_SHARE = 0.05
"""The share of a drive's force (rms) that a term is expected to have."""
DOWN = (0.0, 0.0, -1.0)
"""Direction of gravity in the machine frame where nothing else is said."""


def driven_axes(campaign: Campaign) -> tuple[str, ...]:
    """The axes whose drive force is recorded, by name."""
    return tuple(sorted({axis for run in campaign.runs if (axis := driven_axis(run)) is not None}))


def usual_force(campaign: Campaign, axis: str, share: float) -> float:
    """A share of the rms of the recorded force of an axis, N or Nm; 1 in a plan."""
    force, machine = DriveForce(), campaign.machine
    runs = [run for run in campaign.runs if driven_axis(run) == axis]
    seen = [(run, column.name) for run in runs for column in force.columns(run, machine)]
    read = [run.readings[name] for run, name in seen if name in run.readings]
    return share * float(np.sqrt(np.mean(np.concatenate(read) ** 2))) if read else 1.0


@dataclass(frozen=True, kw_only=True)
class ForceEffect(Effect):
    """An effect in the recording of an axis' drive force; by itself, one form for every axis whose force is recorded."""

    stage = "reading"
    acts_in = DRIVE
    needs_axis = True

    def _seen(self, run: Run) -> bool:
        """Whether a run records the force that it changes."""
        return driven_axis(run) == self.axis

    def applies(self, run: Run) -> bool:
        return super().applies(run) and self._seen(run)

    @classmethod
    def candidates(cls, campaign: Campaign) -> Forms:
        yield from (Form(effect=cls(axis=axis)) for axis in driven_axes(campaign))

    def force_unit(self, campaign: Campaign) -> str:
        """The unit of the force of its axis: N, or Nm of a rotary one."""
        return "Nm" if self.its_axis(campaign).rotary else "N"


@dataclass(frozen=True, kw_only=True)
class SizedForce(ForceEffect):
    """One whose amplitudes have the prior 1σ `sigma_force`: by default a share of the recorded force's rms."""

    sigma_force: float = 0.0

    def prepare(self, campaign: Campaign) -> Self:
        prepared = super().prepare(campaign)
        if not any(map(self.applies, campaign.runs)):
            raise InputError(f"{self.key}: no run records the drive force of {self.axis}", remedy="record drive_force")
        return replace(prepared, sigma_force=self.sigma_force or usual_force(campaign, str(self.axis), FORCE_SHARE))


def motion_signal(axis: str, quantity: str, cut_off_hz: float, rest: float = 0.0) -> Signal:
    """`velocity` or `direction` of an axis (linear within ±`rest`, mm/s or rad/s) behind the low-pass of its force's recording;
    where there is none, its velocity."""
    if not cut_off_hz:
        return Velocity(axis)
    return FilteredMotion(axis, quantity, cut_off_hz, rest if quantity == "direction" else 0.0)


def direction(row: Row, axis: str, cut_off_hz: float, rest: float) -> Any:
    """sgn(v) of an axis, linear within ±`rest` (mm/s or rad/s), as the recording of its force shows it."""
    motion = row.signal(motion_signal(axis, "direction", cut_off_hz, rest))
    return motion if cut_off_hz else ca.fmin(ca.fmax(motion / rest, -1.0), 1.0)


def side_of(machine: Machine, axis: str) -> tuple[str, ...]:
    """The axes on the same side of the chain as `axis`, from the bed outward."""
    structure = machine.structure
    return structure.tool if structure.carries(axis) == "tool" else tuple(reversed(structure.workpiece))


def carriers(machine: Machine, axis: str) -> tuple[str, ...]:
    """The rotary axes that stand between the bed and `axis`, from the bed outward."""
    side = side_of(machine, axis)
    return tuple(name for name in side[: side.index(axis)] if machine.axes[name].rotary)


def later_axes(machine: Machine, axis: str) -> tuple[str, ...]:
    """The axes that `axis` carries, from the bed outward."""
    side = side_of(machine, axis)
    return tuple(side[side.index(axis) + 1 :])


def turned_bodies(machine: Machine, axis: str) -> tuple[str, ...]:
    """The rotary axes from `axis` outward, each of which turns a body."""
    return tuple(name for name in (axis, *later_axes(machine, axis)) if machine.axes[name].rotary)


def sine_to_gravity(machine: Machine, axis: str, down: tuple[float, float, float]) -> float:
    """Sine of the angle between the direction of an axis and gravity."""
    return float(np.linalg.norm(np.cross(machine.axes[axis].direction, down)) / np.linalg.norm(down))


def upright(machine: Machine, axis: str, down: tuple[float, float, float]) -> bool:
    """Whether an axis stands along gravity, to rounding."""
    return bool(sine_to_gravity(machine, axis, down) ** 2 < np.finfo(float).eps)


def across(direction: Array) -> tuple[Array, Array]:
    """Two unit vectors across a unit vector, right-handed with it; (x, y) for z."""
    seed = np.eye(3)[0] if abs(direction[0]) < 0.9 else np.eye(3)[1]
    first = seed - direction * (direction @ seed)
    first /= np.linalg.norm(first)
    return first, np.cross(direction, first)


def gravity_seen(row: Row, names: tuple[str, ...], down: tuple[float, float, float]) -> Any:
    """Gravity's unit vector (3) in the frame of the body that the rotary axes `names` carry, nominal geometry."""
    vector = ca.DM(down) / ca.norm_2(ca.DM(down))
    for name in names:
        pose = axis_pose(row.machine.axes[name], row.machine.structure.carries(name), row.axis[name], {}, {})
        vector = pose.rotation.T @ vector
    return vector
