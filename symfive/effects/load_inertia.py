"""Load inertia: a drive feels the inertia of all that its axis carries, as it stands and moves (W. Khalil & E. Dombre 2002,
chapter 9)."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any, Self

import casadi as ca
import numpy as np

from symfive.arrays import Array
from symfive.effects._base import Campaign, Covariance, Parameter, Quantity, Row, Run, Values
from symfive.effects._force import ForceEffect, side_of, turned_bodies, usual_force
from symfive.effects._quantity import propagated
from symfive.errors import InputError
from symfive.instruments.drive_force import DriveForce, FilteredMotion
from symfive.kinematics import axis_pose
from symfive.machine import Machine
from symfive.motion import Acceleration, Signal, Velocity

FIRST, SECOND = ("x", "y", "z"), ("xx", "yy", "zz", "xy", "xz", "yz")
USUAL = 0.5
"""Prior rms of what all moments together add to the recorded force, as a share of its rms: that of an axis which carries others
is mostly weight and inertia."""
LEVER = 0.1
"""Distance of axes that intersect, m."""
SEEN = 1e-3
"""A combination of moments that adds less than this share of what all together add does not matter."""


@dataclass(frozen=True, kw_only=True)
class LoadInertia(ForceEffect):
    """F += Σ_k ∂r_k/∂q · ∫ r̈_k dm in the recording of an axis' drive force, N or Nm.

    Over the rotary axes from this axis outward, k: the body that k turns has the moments ∫x dm (3, kg m) and ∫x xᵀ dm (6, kg m²),
    x from the origin of k; r̈ is the acceleration that all axes from the bed to k give it. So the inertia that a drive feels
    changes with the pose of what its axis carries, and their motion acts back on it; what does not change is the baseline's.
    Only some combinations of the moments matter (M. Gautier & W. Khalil 1990): the rows of `combined`, found from the commanded
    motion, each with its amplitude, the rms of the force that it adds, of prior 1σ `usual`. `moved`: the axes of the chain that
    move.
    """

    id = "load_inertia"
    says = "the inertia of what an axis carries changes with the pose, and couples the axes"
    hidden_by = "constant inertia and friction of the axis, where the others hardly accelerate"
    action = "enter masses and centres of gravity of the load in the control (torque feed-forward)"
    dynamic_only = True
    moved: tuple[str, ...] = ()
    cut_off_hz: float = 0.0
    combined: tuple[tuple[float, ...], ...] = ()
    usual: tuple[float, ...] = ()

    def prepare(self, campaign: Campaign) -> Self:
        prepared, machine = super().prepare(campaign), campaign.machine
        runs = [run for run in campaign.runs if self.applies(run)]
        if not runs:
            raise InputError(f"{self.key}: no run records the drive force of {self.axis}", remedy="record drive_force")
        moved = tuple(axis for axis in self._chain(machine) if any(np.ptp(run.commands[axis]) > 0.0 for run in runs))
        turning = [axis for axis in moved if machine.axes[axis].rotary]
        if not turned_bodies(machine, str(self.axis)) or not set(turning) - {self.axis}:
            raise InputError(f"{self.key}: no other rotary axis of its chain moves", remedy="move one in the recording")
        prepared = replace(prepared, moved=moved, cut_off_hz=float(runs[0].options.get("low_pass_hz", 0.0)))
        if self.usual:
            return prepared
        shares = self._shares(machine)
        each = self._along(campaign) * shares
        _, size, turn = np.linalg.svd(each / np.sqrt(len(each)), full_matrices=False)
        together = float(np.linalg.norm(size))
        seen = size > SEEN * together
        usual = usual_force(campaign, str(self.axis), USUAL) / together * size[seen]
        rows = turn[seen] * shares / size[seen, None]
        return replace(prepared, combined=tuple(tuple(map(float, row)) for row in rows), usual=tuple(map(float, usual)))

    def _chain(self, machine: Machine) -> tuple[str, ...]:
        """From the bed to the last rotary axis."""
        side = side_of(machine, str(self.axis))
        return side[: max((n for n, name in enumerate(side) if machine.axes[name].rotary), default=-1) + 1]

    def _moments(self, machine: Machine) -> tuple[str, ...]:
        """Of a linear axis the moments of order 1 alone: turning masses shake it."""
        orders = (*FIRST, *SECOND) if machine.axes[str(self.axis)].rotary else FIRST
        return tuple(f"{body}.{moment}" for body in turned_bodies(machine, str(self.axis)) for moment in orders)

    def _shares(self, machine: Machine) -> Array:
        """Usual sizes of the moments (n,) in units of those of order 2."""
        origins = [np.array(machine.axes[name].origin) * 1e-3 for name in turned_bodies(machine, str(self.axis))]
        lever = max([LEVER, *(float(np.linalg.norm(a - b)) for a in origins for b in origins)])
        return np.array([1.0 / lever if name.rpartition(".")[2] in FIRST else 1.0 for name in self._moments(machine)])

    def parameters(self, campaign: Campaign) -> tuple[Parameter, ...]:
        unit = self.force_unit(campaign)
        return tuple(self.own(f"{number}", unit, sigma) for number, sigma in enumerate(self.usual, start=1))

    def _signals(self, axis: str) -> tuple[Signal, Signal]:
        if self.cut_off_hz:
            velocity, acceleration = (FilteredMotion(axis, q, self.cut_off_hz) for q in ("velocity", "acceleration"))
            return velocity, acceleration
        return Velocity(axis), Acceleration(axis)

    def signals(self) -> tuple[Signal, ...]:
        return tuple(signal for axis in self.moved for signal in self._signals(axis))

    def apply(self, row: Row) -> None:
        motion = {axis: (row.axis[axis], *map(row.signal, self._signals(axis))) for axis in self.moved}
        still = {axis: (row.axis[axis], 0.0, 0.0) for axis in self._chain(row.machine)}
        sizes = ca.vertcat(*(self.parameter(row, f"{number}") for number in range(1, len(self.usual) + 1)))
        row.add_reading(
            DriveForce.name, ca.dot(ca.DM(self.combined) @ self._slopes(row.machine, still | motion), sizes)
        )

    def _slopes(self, machine: Machine, motion: dict[str, tuple[Any, Any, Any]]) -> Any:
        """The force (n,) of a unit of each moment, from position, velocity and acceleration of the axes of the chain (mm, rad,
        s)."""
        own, side = machine.axes[str(self.axis)], machine.structure.carries(str(self.axis))
        # of the body: attitude and place of its point `mark` (m), angular rate and acceleration, acceleration of that point
        turn, at, mark = ca.DM.eye(3), ca.DM(3, 1), ca.DM(3, 1)
        spin, swing, push = ca.DM(3, 1), ca.DM(3, 1), ca.DM(3, 1)
        along, foot, found = ca.DM(3, 1), ca.DM(3, 1), []
        sign, bodies = (-1.0 if side == "workpiece" else 1.0), turned_bodies(machine, str(self.axis))
        for name in self._chain(machine):
            axis = machine.axes[name]
            position, rate, change = (sign * part * (1.0 if axis.rotary else 1e-3) for part in motion[name])
            outward = turn @ ca.DM(axis.direction)
            if axis.rotary:
                arm = turn @ (ca.DM(axis.origin) * 1e-3 - mark)
                at, push, mark = at + arm, push + _field(spin, swing) @ arm, ca.DM(axis.origin) * 1e-3
                swing = swing + outward * change + ca.cross(spin, outward) * rate
                spin = spin + outward * rate
            else:
                push = push + outward * change + 2.0 * ca.cross(spin, outward) * rate
                push = push + _field(spin, swing) @ (outward * position)
                at = at + outward * position
            if name == self.axis:
                along, foot = sign * outward, at
            turn = turn @ axis_pose(axis, side, motion[name][0], {}, {}).rotation
            if name not in bodies:
                continue
            grows = _field(spin, swing) @ turn
            if not own.rotary:
                found += [ca.dot(along, grows[:, i]) for i in range(3)]
                continue
            found += [ca.dot(along, ca.cross(at - foot, grows[:, i]) + ca.cross(turn[:, i], push)) for i in range(3)]
            for word in SECOND:
                i, j = ("xyz".index(letter) for letter in word)
                torque = ca.cross(turn[:, i], grows[:, j]) + (i != j) * ca.cross(turn[:, j], grows[:, i])
                found.append(ca.dot(along, torque))
        return ca.vertcat(*found)

    def _along(self, campaign: Campaign) -> Array:
        """The force of a unit of each moment along the commanded motion of all runs (N, n)."""
        machine, chain = campaign.machine, self._chain(campaign.machine)
        symbols = ca.SX.sym("motion", 3 * len(chain))
        each = {axis: (symbols[3 * n], symbols[3 * n + 1], symbols[3 * n + 2]) for n, axis in enumerate(chain)}
        slopes = ca.Function("slopes", [symbols], [self._slopes(machine, each)])
        ways = [
            np.concatenate([_motion(run, machine, axis) for axis in chain])
            for run in campaign.runs
            if self.applies(run)
        ]
        return np.concatenate([np.asarray(slopes.map(way.shape[1])(way)) for way in ways], axis=1).T

    def describe(self, campaign: Campaign, values: Values, covariance: Covariance) -> dict[str, Quantity]:
        """`amplitude`: rms of what it adds to the force along the commanded motion."""
        names = [p.name for p in self.parameters(campaign)]
        quantity, unit = ("torque", "Nm") if self.its_axis(campaign).rotary else ("force", "N")
        size = propagated(lambda p: float(np.linalg.norm(p)), names, unit, values, covariance)
        return {"component": Quantity(f"{quantity} of {self.axis}"), "amplitude": size}


def _field(spin: Any, swing: Any) -> Any:
    """The matrix (3, 3) by which a place of a turning body is accelerated."""
    return ca.skew(swing) + ca.skew(spin) @ ca.skew(spin)


def _motion(run: Run, machine: Machine, axis: str) -> Array:
    """Commanded position, velocity and acceleration of an axis along a run (3, N), mm or rad, s."""
    position = run.commands[axis] * machine.axes[axis].to_internal
    velocity = np.gradient(position, run.time)
    return np.stack([position, velocity, np.gradient(velocity, run.time)])
