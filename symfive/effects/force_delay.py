"""Force delay: the recorded force of a drive is older or newer than the recorded motion (M. Gautier 1997)."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Self

from symfive.effects._base import INSTRUMENT, Campaign, Parameter, Row, Run
from symfive.effects._force import ForceEffect
from symfive.errors import InputError
from symfive.instruments.drive_force import DriveForce, FilteredMotion, driven_axis
from symfive.motion import Signal


@dataclass(frozen=True, kw_only=True)
class ForceDelay(ForceEffect):
    """F += -delay·(mass·jerk + viscous·acceleration): the force of `delay` ago, to first order, in the recording of an axis'
    drive force.

    The motion is that of the encoder (`motion_from = "encoder"` with `low_pass_hz`). Below 0 where the force is recorded
    before the position that it moves, as by one sample of the control. Typical 0.1–5 ms.
    """

    id = "force_delay"
    acts_in = INSTRUMENT
    says = "a delay between recorded force and recorded motion"
    hidden_by = "mass, where the axis accelerates by steps only"
    action = "correct the time stamps of the recording; the machine needs no repair"
    coordinate = "{axis} acceleration"
    reported_as = "latency"
    dynamic_only = True
    cut_off_hz: float = 0.0

    def prepare(self, campaign: Campaign) -> Self:
        prepared = super().prepare(campaign)
        runs = [run for run in campaign.runs if self._seen(run)]
        if not runs:
            raise InputError(
                f"{self.key}: no run records the drive force of {self.axis} beside a filtered motion of the encoder",
                remedy='add motion_from = "encoder" and low_pass_hz',
            )
        return replace(prepared, cut_off_hz=float(runs[0].options["low_pass_hz"]))

    def _seen(self, run: Run) -> bool:
        terms = run.options.get("force_terms", ("mass",))
        return driven_axis(run) == self.axis and "low_pass_hz" in run.options and "mass" in terms

    def parameters(self, campaign: Campaign) -> tuple[Parameter, ...]:
        return (self.own("delay_ms", "ms", 1.0),)

    def signals(self) -> tuple[Signal, ...]:
        axis = str(self.axis)
        return (FilteredMotion(axis, "jerk", self.cut_off_hz), FilteredMotion(axis, "acceleration", self.cut_off_hz))

    def apply(self, row: Row) -> None:
        metre = 1.0 if row.machine.axes[str(self.axis)].rotary else 1e-3
        rate = 0.0
        for term, signal in zip(("mass", "viscous"), self.signals(), strict=True):
            name = f"drive_force.{self.axis}.{term}"
            if row.has(name):
                rate += row.parameter(name) * row.signal(signal) * metre
        row.add_reading(DriveForce.name, -self.parameter(row, "delay_ms") * rate)
