"""Force ripple: the force of a drive that comes back along the way, of a screw's turn or a motor's poles (cogging)."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Self

import casadi as ca
import numpy as np

from symfive.effects._base import DRIVE, Effect
from symfive.effects._force import FORCE_SHARE, driven_axes, usual_force
from symfive.effects._form import FORCE, Form, Scan, Tone
from symfive.effects._quantity import Covariance, Quantity, Values, amplitude_and_phase, own_quantity
from symfive.errors import InputError
from symfive.instruments.drive_force import DriveForce, driven_axis
from symfive.motion import Position
from symfive.parameters import Parameter

if TYPE_CHECKING:
    from symfive.row import Row
    from symfive.runs import Campaign, Run

READINGS = 2.5
"""Readings per cycle, at least (H. Nyquist 1928: 2)."""
LEAST_CYCLES = 4.0
"""Cycles over the way, at least: fewer are a course along the axis, not a ripple."""
RICHER = (2, 4)
"""Numbers of harmonics of other shapes."""


@dataclass(frozen=True, kw_only=True)
class ForceRipple(Effect):
    """F += Σ amplitude_n·sin(2πn·q/period + phase_n), n = 1…`harmonics`, in the recording of an axis' drive force, N or Nm.

    `period` (mm or degree) with its 1σ `period_sigma` (0: known and fixed). Prior 1σ of an amplitude `sigma_force`: a share of
    the recorded force's rms.
    """

    id = "force_ripple"
    stage = "reading"
    says = "the force of the drive changes periodically along the way"
    hidden_by = "a periodic force in time, where only one feed was run"
    coordinate = "{axis}"
    reported_as = "transmission_error"
    needs_axis = True
    dynamic_only = True
    period: float
    period_sigma: float = 0.0
    harmonics: int = 1
    sigma_force: float = 0.0

    @property
    def link(self) -> str:
        """The drive is to blame."""
        return DRIVE

    def prepare(self, campaign: Campaign) -> Self:
        if not (self.period > 0.0 and math.isfinite(self.period)):
            raise InputError(f"effect {self.id} needs its period", remedy="write period = … in mm or degree")
        if not 1 <= self.harmonics <= 20:
            raise InputError(f"effect {self.id}: harmonics {self.harmonics} is not from 1 to 20", remedy="correct it")
        prepared = super().prepare(campaign)
        if not any(map(self.applies, campaign.runs)):
            raise InputError(f"{self.key}: no run records the drive force of {self.axis}", remedy="record drive_force")
        return replace(prepared, sigma_force=self.sigma_force or usual_force(campaign, str(self.axis), FORCE_SHARE))

    def applies(self, run: Run) -> bool:
        return super().applies(run) and driven_axis(run) == self.axis

    @property
    def _orders(self) -> tuple[tuple[int, str], ...]:
        return tuple((n, "" if n == 1 else str(n)) for n in range(1, self.harmonics + 1))

    @classmethod
    def candidates(cls, campaign: Campaign) -> Iterable[Form | Scan | Tone]:
        for axis in driven_axes(campaign):
            runs = [run for run in campaign.runs if driven_axis(run) == axis and run.dynamic]
            ways = [np.asarray(run.commands[axis]) for run in runs]
            steps = np.concatenate([np.abs(np.diff(way)) for way in ways])
            reach = max(float(way.max()) for way in ways) - min(float(way.min()) for way in ways)
            if not (steps > 0.0).any():
                continue
            shortest = READINGS * float(np.median(steps[steps > 0.0]))

            def form(cycles: float, resolution: float, places: int, axis: str = axis) -> Form:
                plain = cls(axis=axis, period=1.0 / cycles, period_sigma=0.5 * resolution / cycles**2)
                return Form(effect=plain, shapes=tuple(replace(plain, harmonics=n) for n in RICHER), places=places)

            if reach > LEAST_CYCLES * shortest:
                yield Tone(
                    channel=FORCE, axis=axis, coordinate=lambda run, axis=axis: np.asarray(run.commands[axis]),  # type: ignore[misc]
                    lowest=LEAST_CYCLES / reach, highest=1.0 / shortest, form=form, runs=tuple(run.id for run in runs),
                )  # fmt: skip

    def parameters(self, campaign: Campaign) -> tuple[Parameter, ...]:
        axis = self.its_axis(campaign)
        unit, sigma = "Nm" if axis.rotary else "N", self.sigma_force or 1.0
        found = [self.own(f"{f}{end}", unit, sigma) for _, end in self._orders for f in ("sin", "cos")]
        if self.period_sigma:
            found.append(self.own("period", axis.unit, self.period_sigma, mean=self.period, lower=0.5 * self.period))
        return tuple(found)

    def apply(self, row: Row) -> None:
        axis = row.machine.axes[str(self.axis)]
        period = self.parameter(row, "period") if self.period_sigma else self.period * axis.to_internal
        angle = 2.0 * math.pi * row.signal(Position(axis.name)) / period
        force = ca.SX(0)
        for order, end in self._orders:
            force += self.parameter(row, f"sin{end}") * ca.sin(order * angle)
            force += self.parameter(row, f"cos{end}") * ca.cos(order * angle)
        for i, source in enumerate(row.sources):
            if source == DriveForce.name:
                row.readings[i] += force

    def describe(self, campaign: Campaign, values: Values, covariance: Covariance) -> dict[str, Quantity]:
        parameters = {p.name.removeprefix(self.key + "."): p for p in self.parameters(campaign)}
        found = {"period": Quantity(self.period, 0.0, self.its_axis(campaign).unit)}
        if "period" in parameters:
            found["period"] = own_quantity(parameters["period"], values, covariance)
        for _, end in self._orders:
            names = parameters[f"sin{end}"].name, parameters[f"cos{end}"].name
            amplitude, phase = amplitude_and_phase(*names, parameters[f"sin{end}"].unit, values, covariance)
            found |= {f"amplitude{end}": amplitude, f"phase{end}": phase}
        return found
