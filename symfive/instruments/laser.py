"""Laser interferometer or autocollimator: positioning deviation of one linear or rotary axis (ISO 230-2)."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from symfive.errors import InputError
from symfive.instruments._base import ZERO_SIGMA_UM, Column, Instrument, Machine, Parameter, Run, setup_parameter

if TYPE_CHECKING:
    from symfive.kinematics import Pose
    from symfive.motion import Command
    from symfive.row import Row

ZERO_SIGMA_URAD = 1e6
"""Prior 1σ of the unknown zero of an angle: 1 rad, a polygon or a resolver is mounted at any angle."""


class Laser(Instrument):
    """Positioning deviation of one axis from its command, zero unknown; the run names the axis (`axis = "X"`).

    Linear axis: the component along it, µm, of the deviation of the reflector (at `tool_ball` on the tool). The whole chain
    enters, so an Abbe offset of the reflector is seen. Rotary axis: the angle, µrad, by which the tool is turned about it
    relative to the workpiece beyond the command, as a laser calibrator, an autocollimator on a polygon or a second encoder reads.
    """

    name = "laser"
    positions = True
    vectors = ("table_ball", "tool_ball")
    imported = (("dev", "um", "urad"),)

    def check(self, run: Run, machine: Machine) -> None:
        axis = str(run.options.get("axis", ""))
        if axis not in machine.axes:
            problem = f"run {run.id}: a laser measures one axis, and the run names none of the machine's"
            raise InputError(problem, remedy=f'add axis = "{machine.axis_names[0]}" to the run', keys=("axis",))

    def columns(self, run: Run, machine: Machine) -> tuple[Column, ...]:
        axis = machine.axes[run.options["axis"]]
        unit, scale = ("urad", 1e-6) if axis.rotary else ("um", 1e-3)
        return (Column(f"{axis.name}_dev_{unit}", unit, scale),)

    def parameters(self, run: Run, machine: Machine) -> tuple[Parameter, ...]:
        rotary = machine.axes[run.options["axis"]].rotary
        return (setup_parameter(run, "zero", *(("urad", ZERO_SIGMA_URAD) if rotary else ("um", ZERO_SIGMA_UM))),)

    def signals(self, run: Run, machine: Machine) -> tuple[Command, ...]:
        from symfive.motion import Command

        return tuple(Command(name) for name in machine.axis_names)

    def reading(self, row: Row, run: Run) -> list[Any]:
        import casadi as ca

        from symfive.motion import Command

        axis = row.machine.axes[run.options["axis"]]
        commanded = {name: row.signal(Command(name)) for name in row.machine.axis_names}
        workpiece, tool = row.nominal_poses(commanded)
        if axis.rotary:
            nominal = _relative(workpiece, tool)
            quarter = _relative(*row.nominal_poses({**commanded, axis.name: commanded[axis.name] + ca.pi / 2.0}))
            along = _sine(quarter @ nominal.T)  # of a quarter turn the axis itself
            turned = _relative(*row.poses) @ nominal.T
            angle = ca.atan2(ca.dot(along, _sine(turned)), 0.5 * (ca.trace(turned) - 1.0))
            return [angle + row.parameter("setup.zero")]
        nominal = workpiece.apply_inverse(tool.apply(row.vector("tool_ball")))
        ball = row.ball - (row.table_ball - row.vector("table_ball"))  # the laser moves with what shifts on the table
        return [ca.dot(ca.DM(axis.direction), ball - nominal) + row.parameter("setup.zero")]


def _relative(workpiece: Pose, tool: Pose) -> Any:
    return workpiece.rotation.T @ tool.rotation


def _sine(rotation: Any) -> Any:
    """Axis of a rotation times the sine of its angle."""
    import casadi as ca

    skew = 0.5 * (rotation - rotation.T)
    return ca.vertcat(skew[2, 1], skew[0, 2], skew[1, 0])
