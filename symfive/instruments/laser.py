"""Laser interferometer: positioning deviation of one linear axis (ISO 230-2)."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from symfive.errors import InputError
from symfive.instruments._base import ZERO_SIGMA_UM, Column, Instrument, setup_parameter, vector_constants
from symfive.parameters import Parameter

if TYPE_CHECKING:
    from symfive.machine import Machine
    from symfive.motion import Command
    from symfive.row import Row
    from symfive.runs import Run


class Laser(Instrument):
    """Deviation of the reflector (at `tool_ball` on the tool) from its command along the axis, µm, zero unknown.

    The run names the axis (`axis = "X"`). The whole chain enters, so an Abbe offset of the reflector is seen.
    """

    name = "laser"
    imported = (("dev", "um", "um"),)

    def check(self, run: Run, machine: Machine) -> None:
        axis = str(run.options.get("axis", ""))
        if axis not in machine.linear_axes:
            problem = f"run {run.id}: a laser measures one linear axis"
            raise InputError(problem, remedy='add axis = "X" to the run', keys=("axis",))

    def columns(self, run: Run, machine: Machine) -> tuple[Column, ...]:
        return (Column(f"{run.options['axis']}_dev_um", "um", 1e-3),)

    def parameters(self, run: Run, machine: Machine) -> tuple[Parameter, ...]:
        return (setup_parameter(run, "zero", "um", ZERO_SIGMA_UM),)

    def constants(self, run: Run, machine: Machine) -> dict[str, float]:
        return vector_constants("tool_ball", run.tool_ball)

    def signals(self, run: Run, machine: Machine) -> tuple[Command, ...]:
        from symfive.motion import Command

        return tuple(Command(name) for name in machine.axis_names)

    def reading(self, row: Row, run: Run) -> list[Any]:
        import casadi as ca

        from symfive.motion import Command

        commanded = {name: row.signal(Command(name)) for name in row.machine.axis_names}
        workpiece, tool = row.nominal_poses(commanded)
        nominal = workpiece.apply_inverse(tool.apply(row.vector("tool_ball")))
        direction = ca.DM(row.machine.axes[run.options["axis"]].direction)
        return [ca.dot(direction, row.ball - nominal) + row.parameter("setup.zero")]
