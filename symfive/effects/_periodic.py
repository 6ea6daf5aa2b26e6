"""What periodic effects share: along an axis a series of sines in its position, in time a tone."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import product
from typing import Any, ClassVar, Self

import casadi as ca
import numpy as np

from symfive.arrays import Array
from symfive.effects._base import Campaign, Covariance, Effect, Form, Parameter, Quantity, Row, Run, Tone, Values
from symfive.effects._quantity import amplitude_and_phase, length_spread, own_quantity, propagate, seen_length
from symfive.errors import InputError
from symfive.motion import Position

READINGS = 2.5
"""Readings per cycle, at least (H. Nyquist 1928: 2)."""
LEAST_CYCLES = 4.0
"""Cycles of a tone in the longest run, at least: fewer are a cycle over the campaign, not a vibration."""
CYCLES = 3.0
"""Cycles within its reach from which on an axis shows what comes back."""
MANY = 500
"""Uneven targets (ISO 230-2) separate as many frequencies within their reach, at most; more positions are no targets."""
ALIKE = 0.999
"""Mean of exp(2πi·f·position), as a share of that at 0, from which on a frequency looks like 0: of even targets 1 at 1/step."""
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
        """Period, the four longest others that even targets cannot distinguish from it, amplitudes and phases."""
        own = {p.name.removeprefix(self.key + "."): p for p in self.parameters(campaign)}
        known = Quantity(self.period, 0.0, self.its_axis(campaign).unit)
        period = own_quantity(own["period"], values, covariance) if "period" in own else known
        found = {"period": period, **self._aliases(campaign, period)}
        for _, end in self._orders:
            sine, cosine = own[f"sin{end}"], own[f"cos{end}"]
            amplitude, phase = amplitude_and_phase(sine.name, cosine.name, sine.unit, values, covariance)
            found |= {f"amplitude{end}": amplitude, f"phase{end}": phase}
        return found

    def _aliases(self, campaign: Campaign, period: Quantity) -> dict[str, Quantity]:
        """`alias_periods` at even targets: C. E. Shannon 1949."""
        ways = [run.commands[str(self.axis)] for run in campaign.runs if self.applies(run)]
        rate = _like_zero(np.unique(np.concatenate(ways))) if ways else 0.0
        if not rate:
            return {}
        length = float(period.value)  # type: ignore[arg-type]
        periods = [1.0 / abs(n * rate + sign / length) for n in (1, 2) for sign in (-1.0, 1.0)]
        spread = float(period.std) / length**2  # type: ignore[arg-type]
        return {"alias_periods": Quantity(tuple(periods), tuple(p**2 * spread for p in periods), period.unit)}


@dataclass(frozen=True, kw_only=True)
class Tonal(Effect):
    """sin·sin(2πft) + cos·cos(2πft), f near `frequency_hz`, t on the campaign's clock.

    `phases`: `common` to all runs, or of each `run` its own, with amplitudes of its own: the start of a run is often not known
    to a fraction of a cycle, and what swings may change between runs.
    """

    choices: ClassVar[tuple[tuple[str, tuple[str, ...]], ...]] = (("phases", ("common", "run")),)
    terms = (("by_run", "by run"),)
    frequency_hz: float
    phases: str = "common"

    def _key(self, *parts: str | None) -> str:
        return super()._key(*parts, "by_run" if self.phases == "run" else None)

    def prepare(self, campaign: Campaign) -> Self:
        if not (self.frequency_hz > 0.0 and math.isfinite(self.frequency_hz)):
            raise InputError(f"{self.key} needs a frequency above 0", remedy="write frequency_hz = …")
        return super().prepare(campaign)

    @classmethod
    def tones(cls, runs: Sequence[Run], channel: str, axis: str | None = None, **options: Any) -> Iterator[Tone]:
        """Where in some runs to look for one of these `options`."""
        longest = max((run.duration for run in runs), default=0.0)
        shortest = max((2.0 * run.interval for run in runs), default=1.0)
        if longest < LEAST_CYCLES * shortest:
            return
        for phases in ("common", "run")[: len(runs)]:

            def form(frequency: float, resolution: float, places: int, phases: str = phases) -> Form:
                return Form(effect=cls(axis=axis, frequency_hz=frequency, phases=phases, **options), places=places)

            yield Tone(
                channel=channel, axis=axis, coordinate=lambda run: run.start_s + np.asarray(run.time),
                lowest=LEAST_CYCLES / longest, highest=0.98 / shortest, form=form, runs=tuple(run.id for run in runs),
                apart=phases == "run",
            )  # fmt: skip

    def frequency(self, campaign: Campaign) -> Parameter:
        """f, known to the inverse of the longest run."""
        span = max([1.0, *(float(run.time[-1] - run.time[0]) for run in self._runs(campaign))])
        return self.own("frequency_hz", "Hz", 1.0 / span, mean=self.frequency_hz, lower=0.5 * self.frequency_hz)

    def _runs(self, campaign: Campaign) -> list[Run]:
        return [run for run in campaign.runs if self.applies(run)]

    def pairs(self, campaign: Campaign, unit: str, sigma: float, channel: str = "") -> Iterator[Parameter]:
        """The amplitudes of sine and cosine, of every run if its phase is its own, of a `channel` (as `x.`)."""
        owners = self._runs(campaign) if self.phases == "run" else [None]
        for run, part in product(owners, ("sin", "cos")):
            found = self.own(channel + part, unit, sigma)
            yield found if run is None else replace(found, name=run.full_name(f"setup.{found.name}"), run=run.id)

    def swing(self, row: Row, channel: str = "") -> Any:
        """How far a channel is out at a row."""
        angle = 2.0 * math.pi * self.parameter(row, "frequency_hz") * row.clock
        own = f"{'setup.' if self.phases == 'run' else ''}{self.key}.{channel}"
        return row.parameter(f"{own}sin") * ca.sin(angle) + row.parameter(f"{own}cos") * ca.cos(angle)

    def tone(
        self, campaign: Campaign, parameters: Sequence[Parameter], channels: int, values: Values, covariance: Covariance
    ) -> tuple[dict[str, Quantity], Array, Array]:
        """Frequency, its two lowest aliases above half the sampling rate, `amplitude` along the main axis of the (in general
        elliptic) motion of all channels, what is `seen` of it, and its `phase` if it is common, else root mean
        squares over the runs; the direction of that axis and its 1σ (channels,).

        `parameters`: the pairs, channel by channel, and the frequency.
        """
        *pairs, frequency = parameters
        names = [p.name for p in pairs]

        def main(p: Array) -> tuple[float, Array, float]:
            left, sizes, right = np.linalg.svd(p.reshape(channels, -1))
            sign = 1.0 if left[np.argmax(np.abs(left[:, 0])), 0] > 0.0 else -1.0
            size = float(sizes[0]) * (right.shape[1] / 2.0) ** -0.5
            return size, sign * left[:, 0], math.atan2(sign * right[0, 1], sign * right[0, 0])

        amplitude, direction, phase = main(np.array([values[name] for name in names]))

        def heading(p: Array) -> Array:
            _, way, angle = main(p)
            return np.append(way, phase + math.remainder(angle - phase, 2.0 * math.pi))

        *ways, turn = propagate(heading, names, values, covariance)[1].tolist()
        spread = length_spread(lambda p: main(p)[0], names, values, covariance)
        unit, runs = pairs[0].unit, len({p.run for p in pairs})
        own = own_quantity(frequency, values, covariance)
        found = {
            "frequency_hz": own,
            **self._aliases(campaign, own),
            "amplitude": Quantity(amplitude, spread, unit),
            **{name: q.times(runs**-0.5) for name, q in seen_length(names, unit, values, covariance).items()},
        }
        if self.phases == "common":
            found["phase"] = Quantity(phase, min(turn, math.pi), "rad")
        return found, direction, np.minimum(ways, 1.0)

    def _aliases(self, campaign: Campaign, frequency: Quantity) -> dict[str, Quantity]:
        """`alias_frequencies_hz` where the rows are evenly spaced in time: C. E. Shannon 1949."""
        clocks = [run.start_s * (self.phases == "common") + np.asarray(run.time) for run in self._runs(campaign)]
        rate = 1.0 / min(run.interval for run in self._runs(campaign))
        together = [np.concatenate(clocks)] if self.phases == "common" else clocks
        if min(abs(np.mean(np.exp(2j * np.pi * rate * clock))) for clock in together) < ALIKE:
            return {}
        beyond = tuple(rate + sign * float(frequency.value) for sign in (-1.0, 1.0))  # type: ignore[arg-type]
        return {"alias_frequencies_hz": Quantity(beyond, (frequency.std, frequency.std), "Hz")}


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
    """How many times shorter periods some targets resolve than even ones a `step` apart: until a frequency looks like 0
    (L. Eyer & P. Bartholdi 1999). Positions in clusters, with steps far below their mean distance, are no targets."""
    reach, count = float(np.ptp(targets)), len(targets)
    if count > MANY or not CYCLES * READINGS * step <= reach <= CYCLES * count * step:
        return 1.0
    return max(1.0, (_like_zero(targets) or MANY / reach) * step)


def _like_zero(targets: Array) -> float:
    """The lowest frequency that looks like 0 at some targets, 1/step of even ones, per mm or degree; 0 where none does.

    It has the same value at the first and the last target: whole cycles lie between them.
    """
    reach = float(np.ptp(targets))
    if not reach or len(targets) > MANY:
        return 0.0
    cycles = np.arange(1, MANY + 1)
    alike = cycles[np.abs(np.exp(2j * np.pi / reach * np.outer(cycles, targets)).mean(axis=1)) > ALIKE]
    return float(alike[0]) / reach if len(alike) else 0.0
