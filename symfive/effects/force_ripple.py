"""Force ripple: the force of a drive that comes back along the way, of a screw's turn or a motor's poles (cogging)."""

from __future__ import annotations

from dataclasses import dataclass, replace

import casadi as ca
import numpy as np

from symfive.effects._base import FORCE, Campaign, Form, Forms, Parameter, Row, Tone
from symfive.effects._force import SizedForce, driven_axes
from symfive.effects._periodic import Periodic, reach_and_shortest
from symfive.instruments.drive_force import DriveForce, driven_axis

LEAST_CYCLES = 4.0
"""Cycles over the way, at least: fewer are a course along the axis, not a ripple."""
RICHER = (2, 4)
"""Numbers of harmonics of other shapes."""


@dataclass(frozen=True, kw_only=True)
class ForceRipple(Periodic, SizedForce):
    """F += Σ amplitude_n·sin(2πn·q/period + phase_n), n = 1…`harmonics`, in the recording of an axis' drive force, N or Nm.

    `period` (mm or degree) with its 1σ `period_sigma` (0: known and fixed). Prior 1σ of an amplitude `sigma_force`: a share of
    the recorded force's rms.
    """

    id = "force_ripple"
    says = "the drive force changes periodically along the path"
    hidden_by = "a periodic force in time, where only one feed was run"
    action = "check motor, screw and gear for a part with this period"
    coordinate = "{axis}"
    reported_as = "transmission_error"
    dynamic_only = True

    @classmethod
    def candidates(cls, campaign: Campaign) -> Forms:
        for axis in driven_axes(campaign):
            runs = [run for run in campaign.runs if driven_axis(run) == axis and run.dynamic]
            reach, shortest = reach_and_shortest(runs, axis)

            def form(cycles: float, resolution: float, places: int, axis: str = axis) -> Form:
                plain = cls(axis=axis, period=1.0 / cycles, period_sigma=0.5 * resolution / cycles**2)
                return Form(effect=plain, shapes=tuple(replace(plain, harmonics=n) for n in RICHER), places=places)

            if reach > LEAST_CYCLES * shortest:
                yield Tone(
                    channel=FORCE, axis=axis, coordinate=lambda run, axis=axis: np.asarray(run.commands[axis]),  # type: ignore[misc]
                    lowest=LEAST_CYCLES / reach, highest=1.0 / shortest, form=form, runs=tuple(run.id for run in runs),
                )  # fmt: skip

    def parameters(self, campaign: Campaign) -> tuple[Parameter, ...]:
        return self.series(campaign, self.force_unit(campaign), self.sigma_force or 1.0)

    def apply(self, row: Row) -> None:
        row.add_reading(DriveForce.name, sum(self.sines(row), ca.SX(0)))
