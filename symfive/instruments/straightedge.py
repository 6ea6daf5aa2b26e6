"""Straightedge and displacement sensor: straightness error motion of a linear axis (ISO 230-1)."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from symfive.errors import InputError
from symfive.instruments._base import ZERO_SIGMA_UM, Column, Instrument, Machine, Parameter, Run, setup_parameter

if TYPE_CHECKING:
    from symfive.row import Row

SLOPE_SIGMA_URAD = 1e4
"""Prior 1σ of the edge's direction: 1 mm in 100 mm, so that the slope of a line says nothing of the machine."""


class Straightedge(Instrument):
    """`u·(d - table_ball)`, µm, of an edge that lies on the table along `v` through `table_ball`; zero and slope unknown.

    `u` and `v` are unit vectors of the workpiece frame at right angles. The sensor's tip is at `tool_ball`. The edge is
    taken as straight: its own form is read as the machine's.
    """

    name = "straightedge"
    stands = "straightedge"
    seated = "SENSOR"
    ball_drawn = True
    vectors = ("table_ball", "tool_ball", "u", "v")

    def check(self, run: Run, machine: Machine) -> None:
        if run.u is None or run.v is None or abs(sum(a * b for a, b in zip(run.u, run.v, strict=True))) > 1e-3:
            problem = f"run {run.id}: a straightedge needs u (sensed) and v (along the edge) at right angles"
            raise InputError(problem, remedy="add u = [0.0, 0.0, 1.0] and v = [1.0, 0.0, 0.0]")

    def columns(self, run: Run, machine: Machine) -> tuple[Column, ...]:
        return (Column("ds_um", "um", 1e-3),)

    def parameters(self, run: Run, machine: Machine) -> tuple[Parameter, ...]:
        slope = setup_parameter(run, "slope", "urad", SLOPE_SIGMA_URAD)
        return (setup_parameter(run, "zero", "um", ZERO_SIGMA_UM), slope)

    def place_sigma(self, run: Run) -> float | None:
        return None

    def reading(self, row: Row, run: Run) -> list[Any]:
        import casadi as ca

        away = row.ball - row.table_ball
        slope = row.parameter("setup.slope") * ca.dot(row.vector("v"), away)
        return [ca.dot(row.vector("u"), away) + slope + row.parameter("setup.zero")]
