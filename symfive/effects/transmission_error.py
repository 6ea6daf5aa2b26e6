"""Transmission error: a periodic error of worm, gear, ball screw or encoder (ISO 230-1, 8.3; ISO 230-2)."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Self

import casadi as ca
import numpy as np

from symfive.effects._base import Effect
from symfive.effects._form import AXIS, Form, Scan, Tone, moving
from symfive.effects._quantity import Covariance, Quantity, Values, amplitude_and_phase, own_quantity
from symfive.errors import InputError
from symfive.motion import Position
from symfive.parameters import Parameter

if TYPE_CHECKING:
    from symfive.row import Row
    from symfive.runs import Campaign

READINGS = 2.5
"""Readings per cycle, at least (H. Nyquist 1928: 2)."""
RICHER, MULTIPLES = (2, 3, 8, 16), ((2, 2), (2, 4), (3, 3))
"""Numbers of harmonics of other shapes; multiples of a period that was found (the largest harmonic need not be the first), each
with its harmonics."""


@dataclass(frozen=True, kw_only=True)
class TransmissionError(Effect):
    """q → q + Σ amplitude_n·sin(2πn·q/period + phase_n), n = 1…`harmonics`, at the output of the drive.

    Estimated as amplitudes of sine and cosine, so that it is linear but for the period, which is close to
    `period` (mm or degree; 1σ `period_sigma`, default 0.2 % of it; 0: known and fixed, as by the number of
    teeth).

    Typical 0.5–5 µm at the pitch of a screw, 15–100 µrad per tooth of a worm; an encoder's subdivision error
    is at most 1 % of its signal period (20 or 200 µm).
    """

    id = "transmission_error"
    stage = "axis"
    says = "periodic error of worm, gear, screw or encoder"
    hidden_by = "straightness where the period is near the circle's diameter; vibration where only one feed was run"
    coordinate = "{axis}"
    needs_axis = True
    period: float = 0.0
    period_sigma: float | None = None
    harmonics: int = 1

    def prepare(self, campaign: Campaign) -> Self:
        if not (self.period > 0.0 and math.isfinite(self.period)):
            raise InputError(f"effect {self.id} needs its period", remedy="write period = … in mm or degree")
        if not 1 <= self.harmonics <= 20:
            raise InputError(f"effect {self.id}: harmonics {self.harmonics} is not from 1 to 20", remedy="correct it")
        return super().prepare(campaign)

    @property
    def _sigma(self) -> float:
        return 2e-3 * self.period if self.period_sigma is None else self.period_sigma

    @property
    def _orders(self) -> tuple[tuple[int, str], ...]:
        """Harmonics with the ending of their parameters' names; the first has none."""
        return tuple((n, "" if n == 1 else str(n)) for n in range(1, self.harmonics + 1))

    @classmethod
    def candidates(cls, campaign: Campaign) -> Iterable[Form | Scan | Tone]:
        for axis in moving(campaign):
            ways = [np.asarray(run.commands[axis]) for run in campaign.runs]
            steps = np.concatenate([np.abs(np.diff(way)) for way in ways])
            reach = max(float(way.max()) for way in ways) - min(float(way.min()) for way in ways)
            shortest = READINGS * float(np.median(steps[steps > 0.0]))

            def form(cycles: float, resolution: float, places: int, axis: str = axis) -> Form:
                period, sigma = 1.0 / cycles, 0.5 * resolution / cycles**2
                plain = cls(axis=axis, period=period, period_sigma=sigma)
                richer = [replace(plain, harmonics=n) for n in RICHER]
                richer += [replace(plain, period=m * period, period_sigma=m * sigma, harmonics=n) for m, n in MULTIPLES]
                return Form(effect=plain, shapes=tuple(richer), places=places)

            if reach > 3.0 * shortest:
                yield Tone(
                    channel=AXIS, axis=axis, coordinate=lambda run, axis=axis: np.asarray(run.commands[axis]),  # type: ignore[misc]
                    lowest=1.0 / reach, highest=1.0 / shortest, form=form,
                )  # fmt: skip

    def parameters(self, campaign: Campaign) -> tuple[Parameter, ...]:
        axis = self.its_axis(campaign)
        small, sigma = ("urad", 100.0) if axis.rotary else ("um", 5.0)
        found = [self.own(f"{f}{end}", small, sigma) for _, end in self._orders for f in ("sin", "cos")]
        if self._sigma:
            found.append(self.own("period", axis.unit, self._sigma, mean=self.period, lower=0.5 * self.period))
        return tuple(found)

    def apply(self, row: Row) -> None:
        axis = row.machine.axes[str(self.axis)]
        period = self.parameter(row, "period") if self._sigma else self.period * axis.to_internal
        angle = 2.0 * math.pi * row.signal(Position(axis.name)) / period
        for order, end in self._orders:
            row.axis[axis.name] += self.parameter(row, f"sin{end}") * ca.sin(order * angle)
            row.axis[axis.name] += self.parameter(row, f"cos{end}") * ca.cos(order * angle)

    def describe(self, campaign: Campaign, values: Values, covariance: Covariance) -> dict[str, Quantity]:
        parameters = {p.name.removeprefix(self.key + "."): p for p in self.parameters(campaign)}
        found = {"period": Quantity(self.period, 0.0, self.its_axis(campaign).unit)}
        if "period" in parameters:
            found["period"] = own_quantity(parameters["period"], values, covariance)
        for _, end in self._orders:
            names = parameters[f"sin{end}"].name, parameters[f"cos{end}"].name
            unit = parameters[f"sin{end}"].unit
            amplitude, phase = amplitude_and_phase(*names, unit, values, covariance)
            found |= {f"amplitude{end}": amplitude, f"phase{end}": phase}
        return found
