"""What periodic effects share: along the way of an axis a series of sines in its position, in time a tone."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any, Self

import casadi as ca
import numpy as np

from symfive.arrays import Array
from symfive.effects._base import Effect
from symfive.effects._form import Form, Tone
from symfive.effects._quantity import Covariance, Quantity, Values, amplitude_and_phase, own_quantity
from symfive.errors import InputError
from symfive.motion import Position
from symfive.parameters import Parameter
from symfive.row import Row
from symfive.runs import Campaign, Run

READINGS = 2.5
"""Readings per cycle, at least (H. Nyquist 1928: 2)."""
LEAST_CYCLES = 4.0
"""Cycles of a tone in the longest run, at least: fewer are a cycle over the campaign, not a vibration."""
CYCLES = 3.0
"""Cycles within its reach from which on an axis shows what comes back."""
FINER, MANY = 8.0, 500
"""By how much uneven targets (ISO 230-2) may resolve shorter periods than even ones; positions that are no targets any more."""
ALIKE = 0.999
"""Mean of exp(2πi·f·position), as a share of that at 0, from which on a frequency reads like 0: of even targets 1 at 1/step."""
ROUNDING = float(np.sqrt(np.finfo(float).eps))
"""Share of an axis' travel up to which a step is not motion but the rounding of computed positions: half the digits they have."""


@dataclass(frozen=True, kw_only=True)
class Periodic(Effect):
    """Σ amplitude_n·sin(2πn·q/period + phase_n), n = 1…`harmonics`, q the position of its axis.

    Estimated as amplitudes of sine and cosine, so that it is linear but for the `period` (mm or degree; 1σ `period_sigma`; 0:
    known and fixed).
    """

    needs_axis = True
    period: float = 0.0
    period_sigma: float | None = 0.0
    harmonics: int = 1

    def prepare(self, campaign: Campaign) -> Self:
        if not (self.period > 0.0 and math.isfinite(self.period)):
            raise InputError(f"effect {self.id} needs its period", remedy="write period = … in mm or degree")
        if not 1 <= self.harmonics <= 20:
            raise InputError(f"effect {self.id}: harmonics {self.harmonics} is not from 1 to 20", remedy="correct it")
        return super().prepare(campaign)

    @property
    def _sigma(self) -> float:
        return self.period_sigma or 0.0

    @property
    def _orders(self) -> tuple[tuple[int, str], ...]:
        """Harmonics with the ending of their parameters' names; the first has none."""
        return tuple((n, "" if n == 1 else str(n)) for n in range(1, self.harmonics + 1))

    def series(self, campaign: Campaign, unit: str, sigma: float) -> tuple[Parameter, ...]:
        """Its parameters, the amplitudes in `unit` with the prior 1σ `sigma`."""
        found = [self.own(f"{f}{end}", unit, sigma) for _, end in self._orders for f in ("sin", "cos")]
        if self._sigma:
            own_unit = self.its_axis(campaign).unit
            found.append(self.own("period", own_unit, self._sigma, mean=self.period, lower=0.5 * self.period))
        return tuple(found)

    def sines(self, row: Row) -> Iterator[Any]:
        """The terms of the series at a row."""
        axis = row.machine.axes[str(self.axis)]
        length = self.parameter(row, "period") if self._sigma else self.period * axis.to_internal
        angle = 2.0 * math.pi * row.signal(Position(axis.name)) / length
        for order, end in self._orders:
            yield self.parameter(row, f"sin{end}") * ca.sin(order * angle)
            yield self.parameter(row, f"cos{end}") * ca.cos(order * angle)

    def describe(self, campaign: Campaign, values: Values, covariance: Covariance) -> dict[str, Quantity]:
        """Period, amplitudes and phases."""
        own = {p.name.removeprefix(self.key + "."): p for p in self.parameters(campaign)}
        known = Quantity(self.period, 0.0, self.its_axis(campaign).unit)
        found = {"period": own_quantity(own["period"], values, covariance) if "period" in own else known}
        for _, end in self._orders:
            sine, cosine = own[f"sin{end}"], own[f"cos{end}"]
            amplitude, phase = amplitude_and_phase(sine.name, cosine.name, sine.unit, values, covariance)
            found |= {f"amplitude{end}": amplitude, f"phase{end}": phase}
        return found


@dataclass(frozen=True, kw_only=True)
class Tonal(Effect):
    """sin·sin(2πft) + cos·cos(2πft), t on the campaign's clock, f near `frequency_hz`."""

    frequency_hz: float

    def prepare(self, campaign: Campaign) -> Self:
        if not (self.frequency_hz > 0.0 and math.isfinite(self.frequency_hz)):
            raise InputError(f"{self.key} needs a frequency above 0", remedy="write frequency_hz = …")
        return super().prepare(campaign)

    @classmethod
    def tones(cls, runs: Sequence[Run], channel: str, axis: str | None = None) -> Iterator[Tone]:
        """Where in some runs to look for one."""
        longest = max((run.duration for run in runs), default=0.0)
        shortest = max((2.0 * run.interval for run in runs), default=1.0)

        def form(frequency: float, resolution: float, places: int) -> Form:
            return Form(effect=cls(axis=axis, frequency_hz=frequency), places=places)

        if longest >= LEAST_CYCLES * shortest:
            yield Tone(
                channel=channel, axis=axis, coordinate=lambda run: run.start_s + np.asarray(run.time),
                lowest=LEAST_CYCLES / longest, highest=0.98 / shortest, form=form, runs=tuple(run.id for run in runs),
            )  # fmt: skip

    def frequency(self, campaign: Campaign) -> Parameter:
        """f, known to the inverse of the longest run."""
        span = max([1.0, *(float(run.time[-1] - run.time[0]) for run in campaign.runs if self.applies(run))])
        return self.own("frequency_hz", "Hz", 1.0 / span, mean=self.frequency_hz, lower=0.5 * self.frequency_hz)

    def sine_and_cosine(self, row: Row) -> tuple[Any, Any]:
        """Of 2πft at a row."""
        angle = 2.0 * math.pi * self.parameter(row, "frequency_hz") * row.clock
        return ca.sin(angle), ca.cos(angle)


def reach_and_shortest(runs: Iterable[Run], axis: str) -> tuple[float, float]:
    """How far an axis goes in some runs, and the shortest period that their readings resolve; mm or degree, (0, 0) where it
    stands."""
    ways = [np.asarray(run.commands[axis]) for run in runs]
    reach = max(float(way.max()) for way in ways) - min(float(way.min()) for way in ways)
    steps = np.concatenate([np.abs(np.diff(way)) for way in ways])
    moved = steps[steps > ROUNDING * reach]
    if not len(moved):
        return 0.0, 0.0
    usual = float(np.median(moved))
    return reach, READINGS * usual / _uneven(np.unique(np.concatenate(ways)), usual)


def _uneven(targets: Array, step: float) -> float:
    """How many times shorter periods some targets resolve than even ones a `step` apart: until a frequency reads like 0
    (L. Eyer & P. Bartholdi 1999). Positions in clusters, with steps far below their mean distance, are no targets."""
    reach, count = float(np.ptp(targets)), len(targets)
    if count > MANY or not CYCLES * READINGS * step <= reach <= FINER * count * step:
        return 1.0
    frequencies = np.arange(0.5 / step, FINER / step, 0.1 / reach)
    window = np.abs(np.exp(2j * np.pi * np.outer(frequencies, targets)).mean(axis=1))
    alike = frequencies[window > ALIKE]
    return max(1.0, float(alike[0]) * step) if len(alike) else FINER
