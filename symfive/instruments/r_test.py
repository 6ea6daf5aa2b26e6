"""R-test: three displacements of the tool ball along the workpiece frame's axes (Oyama, Ibaraki & Otsubo 2010)."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from symfive.instruments._base import ZERO_SIGMA_UM, Column, Instrument, setup_parameter, setup_vector, vector_constants
from symfive.parameters import Parameter

if TYPE_CHECKING:
    from symfive.campaign import Run
    from symfive.machine import Machine
    from symfive.model._row import Row


class RTest(Instrument):
    """`d - table_ball` in µm; nuisances: the tool ball and one zero per direction.

    An error of the nest's position moves all readings by a constant: it is the zero, and not a second unknown.
    """

    name = "r_test"

    def columns(self, run: Run, machine: Machine) -> tuple[Column, ...]:
        return tuple(Column(f"d{c}_um", "um", 1e-3) for c in "xyz")

    def parameters(self, run: Run, machine: Machine) -> tuple[Parameter, ...]:
        zeros = tuple(setup_parameter(run, f"zero.{c}", "um", ZERO_SIGMA_UM) for c in "xyz")
        return (*setup_vector(run, "tool_ball", run.setup_sigma_um.tool_ball), *zeros)

    def constants(self, run: Run, machine: Machine) -> dict[str, float]:
        return {**vector_constants("table_ball", run.table_ball), **vector_constants("tool_ball", run.tool_ball)}

    def reading(self, row: Row, run: Run) -> list[Any]:
        deviation = row.ball - row.table_ball
        return [deviation[i] + row.parameter(f"setup.zero.{c}") for i, c in enumerate("xyz")]
