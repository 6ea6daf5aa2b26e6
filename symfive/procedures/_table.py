"""The table of procedures: by name, by instrument, and whether a machine can do them."""

from __future__ import annotations

import inspect
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from symfive.campaign import Run
from symfive.errors import InputError
from symfive.machine import Machine
from symfive.procedures._cone_circle import cone_circle
from symfive.procedures._grid_encoder_lines import grid_encoder_lines
from symfive.procedures._linear_positioning import linear_positioning
from symfive.procedures._planar_circle import planar_circle
from symfive.procedures._r_test_grid import r_test_grid
from symfive.procedures._rotary_circle import rotary_circle
from symfive.procedures._static_ball_bar import static_ball_bar
from symfive.procedures._synchronous_circle import synchronous_circle

Make = Callable[..., tuple[Run, ...]]


@dataclass(frozen=True)
class Procedure:
    """A procedure of the table: what to call it, what it measures with, what it needs and one sentence about
    it.

    `rotary`: how many rotary axes the machine must have; `on_table`: one of them must carry the workpiece.
    """

    name: str
    instruments: tuple[str, ...]
    make: Make
    says: str
    rotary: int = 0
    on_table: bool = False

    def suits(self, machine: Machine) -> bool:
        """Whether the machine has the axes."""
        on_table = machine.table_axis is not None
        enough = bool(machine.linear_axes) and len(machine.rotary_axes) >= self.rotary
        return enough and (on_table or not self.on_table)


PROCEDURES: dict[str, Procedure] = {
    procedure.name: procedure
    for procedure in (
        Procedure("r_test_grid", ("r_test",), r_test_grid, "R-test at a grid of all rotary axes, two nests", 1),
        Procedure(
            "static_ball_bar", ("ball_bar",), static_ball_bar, "static ball bar, one revolution at two heights", 1
        ),
        Procedure("rotary_circle", ("ball_bar",), rotary_circle, "ball bar while one rotary axis turns", 1),
        Procedure(
            "synchronous_circle",
            ("ball_bar",),
            synchronous_circle,
            "ball bar, rotary and linear axis together",
            1,
            True,
        ),
        Procedure("cone_circle", ("ball_bar",), cone_circle, "ball bar around a cone frustum, all axes together", 2),
        Procedure(
            "planar_circle", ("ball_bar", "grid_encoder"), planar_circle, "circles in a plane of two linear axes"
        ),
        Procedure("grid_encoder_lines", ("grid_encoder",), grid_encoder_lines, "three lines along a linear axis"),
        Procedure("linear_positioning", ("laser",), linear_positioning, "targets of a linear axis from both sides"),
    )
}


def procedures_for(machine: Machine, instrument: str | None = None) -> tuple[Procedure, ...]:
    """The procedures that suit the machine, and the instrument where one is named."""
    return tuple(
        procedure
        for procedure in PROCEDURES.values()
        if procedure.suits(machine) and (instrument is None or instrument in procedure.instruments)
    )


def make_procedure(name: str, machine: Machine, **options: Any) -> tuple[Run, ...]:
    """The runs of a procedure by name. Raises `InputError` for a name, machine or option that does not fit."""
    if name not in PROCEDURES:
        raise InputError(f'there is no procedure "{name}"', remedy=f"use one of {', '.join(PROCEDURES)}")
    procedure = PROCEDURES[name]
    if not procedure.suits(machine):
        able = ", ".join(p.name for p in procedures_for(machine)) or "none"
        raise InputError(f"{machine.name} lacks the axes for {name}", remedy=f"it can do {able}")
    known = [option for option in inspect.signature(procedure.make).parameters if option != "machine"]
    for option in options:
        if option not in known:
            raise InputError(f"{name} has no option {option}", remedy=f"it takes {', '.join(known)}")
    return procedure.make(machine, **options)
