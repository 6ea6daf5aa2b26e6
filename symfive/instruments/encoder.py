"""Encoder of the drive: the position that the control itself sees, before play and gear (ISO 230-4 Annex E)."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from symfive.errors import InputError
from symfive.instruments._base import Column, Instrument, Machine, Parameter, Run, setup_parameter

if TYPE_CHECKING:
    from symfive.row import Row


class Encoder(Instrument):
    """Actual positions `X_act_mm`, `C_act_deg` of the axes in `encoder_axes` (default: every driven axis).

    With `motion_from = "encoder"` in the run the recording is not fitted but taken as the motion of the axes. An
    encoder whose zero is arbitrary (a second one, not the control's) has a prior for it: `encoder_zero_sigma`, mm or
    degree.
    """

    name = "encoder"
    wired = False
    imported = (("act", "mm", "deg"),)
    on_control = True

    def axes(self, run: Run, machine: Machine) -> tuple[str, ...]:
        """The axes whose positions were recorded."""
        names = run.options.get("encoder_axes") or [n for n in machine.axis_names if machine.axes[n].drive is not None]
        return tuple(names)

    def check(self, run: Run, machine: Machine) -> None:
        names = self.axes(run, machine)
        if not names or any(name not in machine.axes for name in names):
            problem = f"run {run.id}: the encoder's axes are not known"
            raise InputError(problem, remedy='add encoder_axes = ["X"] to the run', keys=("encoder_axes",))

    def columns(self, run: Run, machine: Machine) -> tuple[Column, ...]:
        axes = [machine.axes[name] for name in self.axes(run, machine)]
        return tuple(Column(f"{axis.name}_act_{axis.unit}", axis.unit, axis.to_internal) for axis in axes)

    def parameters(self, run: Run, machine: Machine) -> tuple[Parameter, ...]:
        sigma = float(run.options.get("encoder_zero_sigma", 0.0))
        if sigma == 0.0:
            return ()
        axes = [machine.axes[name] for name in self.axes(run, machine)]
        return tuple(setup_parameter(run, f"zero.{axis.name}", axis.unit, sigma) for axis in axes)

    def reading(self, row: Row, run: Run) -> list[Any]:
        from symfive.motion import Position

        readings = []
        for name in self.axes(run, row.machine):
            zero = row.parameter(f"setup.zero.{name}") if row.has(f"setup.zero.{name}") else 0.0
            readings.append(row.signal(Position(name)) + zero)
        return readings
