"""Force or torque of an axis' drive: inverse dynamics with mass, viscous and Coulomb friction and offset."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import casadi as ca

from symfive.errors import InputError
from symfive.instruments._base import Column, Instrument
from symfive.motion import Acceleration, Velocity
from symfive.parameters import Parameter

if TYPE_CHECKING:
    from symfive.campaign import Run
    from symfive.machine import Machine
    from symfive.model._row import Row
    from symfive.motion import Signal

TERMS = ("mass", "viscous", "coulomb", "offset")


class DriveForce(Instrument):
    """F = mass·a + viscous·v + coulomb·sgn(v) + offset (A. Janot, M. Gautier & M. Brunot 2019), N or Nm.

    The run names the axis; `force_terms` lists which of the four terms the baseline holds (default all). Units: kg and
    N s/m for a linear axis, kg m² and Nm s/rad for a rotary one. Within the velocity resolution `v_rest` (mm/s or
    degree/s, default 0.1) the friction force is not determined by the direction of motion and passes linearly through 0.
    """

    name = "drive_force"

    def check(self, run: Run, machine: Machine) -> None:
        if run.options.get("axis") not in machine.axes:
            raise InputError(f"run {run.id}: a drive force belongs to one axis", remedy='add axis = "X" to the run')
        unknown = [term for term in self.terms(run) if term not in TERMS]
        if unknown:
            raise InputError(f"run {run.id}: force term {unknown[0]!r} is unknown", remedy=f"use {', '.join(TERMS)}")

    def terms(self, run: Run) -> tuple[str, ...]:
        """The terms of the baseline."""
        return tuple(run.options.get("force_terms", TERMS))

    def columns(self, run: Run, machine: Machine) -> tuple[Column, ...]:
        name = run.options["axis"]
        return (Column(f"{name}_torque_Nm", "Nm", 1.0),) if machine.axes[name].rotary else (Column(f"{name}_force_N", "N", 1.0),)

    def parameters(self, run: Run, machine: Machine) -> tuple[Parameter, ...]:
        name = run.options["axis"]
        rotary = machine.axes[name].rotary
        units = {
            "mass": "kg m^2" if rotary else "kg", "viscous": "Nm s/rad" if rotary else "N s/m",
            "coulomb": "Nm" if rotary else "N", "offset": "Nm" if rotary else "N",
        }  # fmt: skip
        return tuple(
            Parameter(name=f"drive_force.{name}.{term}", unit=units[term], sigma=1e6, kind="drive") for term in self.terms(run)
        )

    def constants(self, run: Run, machine: Machine) -> dict[str, float]:
        rest = float(run.options.get("v_rest", 0.1))
        return {"v_rest": rest * machine.axes[run.options["axis"]].to_internal}

    def signals(self, run: Run, machine: Machine) -> tuple[Signal, ...]:
        return (Velocity(run.options["axis"]), Acceleration(run.options["axis"]))

    def reading(self, row: Row, run: Run) -> list[Any]:
        name = run.options["axis"]
        metre = 1.0 if row.machine.axes[name].rotary else 1e-3
        velocity, acceleration = row.signal(Velocity(name)), row.signal(Acceleration(name))
        sign = ca.fmin(ca.fmax(velocity / row.constant("v_rest"), -1.0), 1.0)
        factors = {"mass": acceleration * metre, "viscous": velocity * metre, "coulomb": sign, "offset": 1.0}
        force = ca.SX(0)
        for term in self.terms(run):
            force += row.parameter(f"drive_force.{name}.{term}") * factors[term]
        return [force]
