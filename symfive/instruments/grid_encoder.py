"""Grid (cross-grid) encoder: the tool's position in a plane fixed to the table (ISO 230-4; Wang & Li 2016)."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from symfive.errors import InputError
from symfive.instruments._base import Column, Instrument, Machine, Parameter, Run, setup_parameter, setup_vector

if TYPE_CHECKING:
    from symfive.row import Row

ZERO_SIGMA_UM = 1e6


class GridEncoder(Instrument):
    """`d` projected on `u` and `v`, µm, from an unknown zero.

    Nuisances: one zero per direction, the reading head's place on the tool and, where `setup_sigma_um.plate` (µrad) is
    given, the plate's orientation about `table_ball`; its yaw is what reads as roll of an axis when lines are joined
    (paper 1, (9)-(10)).
    """

    name = "grid_encoder"
    stands = "middle of the grid plate"
    held = "reading head"
    seated = "reading head"
    ball_drawn = True
    vectors = ("table_ball", "tool_ball", "u", "v")
    imported = (("du", "um", "um"), ("dv", "um", "um"))

    def check(self, run: Run, machine: Machine) -> None:
        if run.u is None or run.v is None:
            problem = f"run {run.id}: a grid encoder needs u and v"
            raise InputError(problem, remedy="add u = [1.0, 0.0, 0.0] and v = …")

    def columns(self, run: Run, machine: Machine) -> tuple[Column, ...]:
        return (Column("du_um", "um", 1e-3), Column("dv_um", "um", 1e-3))

    def parameters(self, run: Run, machine: Machine) -> tuple[Parameter, ...]:
        sigma = run.setup_sigma_um
        zeros = tuple(setup_parameter(run, f"zero.{c}", "um", ZERO_SIGMA_UM) for c in "uv")
        plate = tuple(setup_parameter(run, f"plate.{c}", "urad", sigma.plate) for c in "abc") if sigma.plate else ()
        return (*setup_vector(run, "tool_ball", sigma.tool_ball), *zeros, *plate)

    def place_sigma(self, run: Run) -> float | None:
        return None

    def reading(self, row: Row, run: Run) -> list[Any]:
        import casadi as ca

        ball = row.ball - (row.table_ball - row.vector("table_ball"))  # the plate moves with what shifts the artefact
        if row.has("setup.plate.a"):
            angles = ca.vertcat(*(row.parameter(f"setup.plate.{c}") for c in "abc"))
            ball = ball - ca.cross(angles, ball - row.vector("table_ball"))
        return [ca.dot(row.vector(name), ball) + row.parameter(f"setup.zero.{name}") for name in ("u", "v")]
