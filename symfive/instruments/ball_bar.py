"""Double ball bar: `|d - table_ball| - length` (ISO 230-4)."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np

from symfive.arrays import Array
from symfive.errors import InputError
from symfive.instruments._base import BallInstrument, Column, Machine, Parameter, Run, setup_parameter, setup_vector

if TYPE_CHECKING:
    from symfive.row import Row


class BallBar(BallInstrument):
    """Change of the distance between two balls, µm; nuisances: both balls and the bar's length."""

    name = "ball_bar"
    stands = "table ball"
    seated = "bar"
    bar = True
    limit = "bar_stroke"
    imported = (("dL", "um", "um"),)

    def check(self, run: Run, machine: Machine) -> None:
        if run.length is None:
            problem = f"run {run.id}: a ball bar needs its length"
            raise InputError(problem, remedy="add length = … in mm", keys=("length",))

    def columns(self, run: Run, machine: Machine) -> tuple[Column, ...]:
        return (Column("dL_um", "um", 1e-3),)

    def parameters(self, run: Run, machine: Machine) -> tuple[Parameter, ...]:
        sigma = run.setup_sigma_um
        length = (setup_parameter(run, "length", "um", sigma.length, called="bar length"),) if sigma.length else ()
        return (
            *setup_vector(run, "table_ball", sigma.table_ball),
            *setup_vector(run, "tool_ball", sigma.tool),
            *length,
        )

    def constants(self, run: Run, machine: Machine) -> Mapping[str, float]:
        return {**super().constants(run, machine), "length": float(run.length or 0.0)}

    def turns(self, run: Run, machine: Machine) -> bool:
        return True

    def designed(self, run: Run, away: Array) -> Array:
        return np.asarray(np.linalg.norm(away, axis=1, keepdims=True) - (run.length or 0.0))

    def zeroed(self, run: Run) -> bool:
        return False  # its readings count from the calibrated length

    def reading(self, row: Row, run: Run) -> list[Any]:
        import casadi as ca

        error = row.parameter("setup.length") if row.has("setup.length") else 0.0
        return [ca.norm_2(row.ball - row.table_ball) - (row.constant("length") + error)]
