"""Varying: an effect whose size is not the same everywhere, as no law of the vocabulary says."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any, Self

import casadi as ca
import numpy as np

from symfive.arrays import Array
from symfive.effects._axes import goes_round, moving
from symfive.effects._base import Campaign, Covariance, Effect, Forms, Parameter, Quantity, Row, Run, Values
from symfive.effects._coordinates import SIGN, VELOCITY, coordinate_in, coordinate_values, owner, signals_of
from symfive.errors import InputError
from symfive.motion import Signal


def varies_over(campaign: Campaign) -> tuple[str, ...]:
    """Coordinates over which an effect may change in a campaign: time, and of every axis that moves its position, its side and,
    where motion is recorded, its velocity."""
    found = ["t"] if all(run.has_clock for run in campaign.runs) else []
    for axis in moving(campaign):
        found += [axis, f"{axis}{SIGN}"]
        if all(run.dynamic for run in campaign.runs):
            found.append(f"{axis}{VELOCITY}")
    return tuple(found)


@dataclass(frozen=True, kw_only=True)
class Varying(Effect):
    """What the effect `of` adds, times 1 + m1·z + m2·(3z² - 1)/2, z the coordinate `over` as -1…1 over its `span`.

    `over` is `t`, an axis (`B`), its velocity (`B velocity`) or the side from which it came (`B velocity sign`, m1 alone); of a
    rotary axis that goes round, m1·cos + m2·sin of its angle. `span` (mm, degree, s) is by default what the campaign covers. An
    effect that acts inside the position loop, or in the recorder, cannot vary. A `minor` one varies so little that it
    bears the name of the law.
    """

    id = "varying"
    reported_as = "unknown"
    says = "like a known effect, but its size changes along a coordinate"
    hidden_by = "the effect it resembles"
    terms = (("varies", "variation {}"),)
    action = "look for a cause that changes along this coordinate; correct it only in the range that was recorded"
    of: Effect
    over: str
    span: tuple[float, ...] = ()
    periodic: bool = False
    minor: bool = field(default=False, compare=False)

    @property
    def unidentified(self) -> bool:  # type: ignore[override]
        """Whether it is no law of the library: it varies by more than the share to which these are right."""
        return self.of.unidentified or not self.minor

    @property
    def vocabulary(self) -> str:
        """The law's word while it is right to that share."""
        return self.of.vocabulary if self.minor else self.reported_as

    def called(self, name: str) -> str:
        number = name.removeprefix(f"{self.key}.varies.")
        return self.of.words if number == name else f"{self.of.words} (variation {number})"

    def quantity_words(self, name: str, unit: str | None) -> str:
        return super().quantity_words(name, unit) if name.startswith("varies") else self.of.quantity_words(name, unit)

    def advice(self, sizes: Mapping[str, Quantity]) -> tuple[str, str]:
        return self.of.advice(sizes) if self.minor else super().advice(sizes)

    @property
    def belongs_to(self) -> str | None:
        """The axis of the effect."""
        return self.of.belongs_to

    @cached_property
    def _inner(self) -> Effect:
        return replace(self.of, spread=self.spread)

    @property
    def key(self) -> str:
        """That of the effect, whose parameters it has."""
        return self.of.key

    @property
    def stage(self) -> str:  # type: ignore[override]
        """Where it enters."""
        return self.of.stage

    @property
    def coordinate(self) -> str:  # type: ignore[override]
        """What its size is of, and what its course is of."""
        return ", ".join(dict.fromkeys((*self.of.coordinates, self.over)))

    @property
    def over_time(self) -> bool:  # type: ignore[override]
        """Whether time counts."""
        return self.over == "t" or self.of.over_time

    @property
    def dynamic_only(self) -> bool:  # type: ignore[override]
        """Whether only motion shows it."""
        return self.of.dynamic_only

    @classmethod
    def candidates(cls, campaign: Campaign) -> Forms:
        """None by itself: a diagnosis asks for those of the effects that it holds."""
        return ()

    @classmethod
    def of_effect(cls, effect: Effect, campaign: Campaign) -> tuple[Self, ...]:
        """The ways in which an effect may vary in a campaign; none where it cannot."""
        found = []
        own = effect.coordinate.split(", ") if effect.unidentified else []
        for over in varies_over(campaign):
            if over in own:
                continue  # its functions of that hold it already
            try:
                found.append(cls(of=effect, over=over, spread=effect.spread).prepare(campaign))
            except InputError:
                continue
        return tuple(found)

    def prepare(self, campaign: Campaign) -> Self:
        inner = self.of.prepare(campaign)
        if isinstance(inner, Varying) or inner.frees() or inner.stage == "recording":
            raise InputError(f"{inner.key} cannot vary over {self.over}", remedy="let an effect behind the drives vary")
        if self.over != "t" and owner(self.over) not in campaign.machine.axes:
            raise InputError(
                f'{inner.key} varies over "{self.over}", which is unknown',
                remedy=f'use "t", an axis ({", ".join(campaign.machine.axis_names)}), its velocity or velocity sign',
            )
        span = self.span
        if not span:
            values = np.concatenate([coordinate_values(self.over, run, campaign.machine) for run in campaign.runs])
            span = float(values.min()), float(values.max())
        if len(span) != 2 or not span[0] < span[1]:
            raise InputError(f"{inner.key}: {self.over} does not change", remedy="choose a coordinate that changes")
        axis = self.over in campaign.machine.axes
        return replace(self, of=inner, span=span, periodic=self.periodic or (axis and goes_round(campaign, self.over)))

    @property
    def _varied(self) -> tuple[str, ...]:
        names = ("varies.1",) if self.over.endswith(SIGN) else ("varies.1", "varies.2")
        return tuple(f"{self.key}.{name}" for name in names)

    def parameters(self, campaign: Campaign) -> tuple[Parameter, ...]:
        share = [Parameter(name=name, unit="1", sigma=1.0, kind="effect", called=self.called) for name in self._varied]
        return (*self._inner.parameters(campaign), *share)

    def amplitudes(self, campaign: Campaign) -> tuple[Parameter, ...]:
        return self._inner.amplitudes(campaign)

    def typical(self, campaign: Campaign) -> dict[str, float]:
        return {**self._inner.typical(campaign), **dict.fromkeys(self._varied, 0.5)}

    def starts(self, run: Run) -> tuple[Parameter, ...]:
        return self._inner.starts(run)

    def signals(self) -> tuple[Signal, ...]:
        return tuple(dict.fromkeys((*self._inner.signals(), *signals_of(self.over))))

    def applies(self, run: Run) -> bool:
        return super().applies(run) and self._inner.applies(run)

    def functions(self, run: Run, campaign: Campaign) -> Array:
        """What m1 and m2 are multiplied by, along a run (N, 1 or 2)."""
        unit = campaign.machine.axes[self.over].to_internal if self.over in campaign.machine.axes else 1.0
        found = self._of(unit * coordinate_values(self.over, run, campaign.machine), np, unit)
        return np.stack(found[: len(self._varied)], axis=1)

    def variation(self, campaign: Campaign, values: Values) -> float:
        """rms of what it changes by along the campaign's rows, as a share of the effect."""
        shares = np.array([values[name] for name in self._varied])
        along = np.concatenate([self.functions(run, campaign) for run in campaign.runs if self.applies(run)])
        return float(np.sqrt(np.mean((along @ shares) ** 2)))

    def _of(self, value: Any, library: Any, unit: float) -> tuple[Any, Any]:
        if self.periodic:
            return library.cos(value), library.sin(value)
        low, high = (unit * end for end in self.span)
        z = library.fmin(library.fmax(2.0 * (value - low) / (high - low) - 1.0, -1.0), 1.0)
        return z, 1.5 * z * z - 0.5

    def apply(self, row: Row) -> None:
        unit = row.machine.axes[self.over].to_internal if self.over in row.machine.axes else 1.0
        functions = self._of(coordinate_in(self.over, row), ca, unit)
        share = 1.0
        for name, function in zip(self._varied, functions, strict=False):
            share += row.parameter(name) * function
        shift, readings = ca.SX(row.shift), [*row.readings]
        tables = [(table, {**table}) for table in (row.axis, row.location, row.motion)]
        self._inner.apply(row)
        row.shift = shift + share * (row.shift - shift)
        row.readings = [old + share * (new - old) for new, old in zip(row.readings, readings, strict=True)]
        for table, old in tables:
            for name, value in table.items():
                if name not in old or value is not old[name]:
                    start = old.get(name, 0.0)
                    table[name] = start + share * (value - start)

    def describe(self, campaign: Campaign, values: Values, covariance: Covariance) -> dict[str, Quantity]:
        """What the effect describes, then `over` and the share by which it varies."""
        own = {
            name.removeprefix(f"{self.key}."): Quantity(values[name], max(covariance[name, name], 0.0) ** 0.5, "1")
            for name in self._varied
        }
        inner: Mapping[str, Quantity] = self._inner.describe(campaign, values, covariance)
        return {**inner, "over": Quantity(self.coordinates, aside=True), **own}
