"""Following lag: an axis whose drive the machine file does not state does not follow its command exactly."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Self

import numpy as np

from symfive.effects._base import DRIVE, Campaign, Covariance, Effect, Forms, Parameter, Quantity, Run, Values
from symfive.effects._quantity import own_quantity, propagate, propagated
from symfive.errors import InputError
from symfive.motion import LAG, LAG_OF_ALL, LAGS

SIZES = (2.0, 8.0, 32.0)
"""In units of the usual one, up to a third of a second, at which the readings are looked at."""
SHAPES = ("lag", "loop")
INNER = {"velocity_gain": ("1/s", 300.0), "integral_time": ("s", 0.05), "viscous": ("1/s", 5.0)}
"""Unit and usual size of what the velocity loop has (conventions, section 3); each as uncertain as it is large."""
BEYOND = "lag_beyond_all_ms"
LEAST = 0.02
"""Share of its usual size that a gain of the loop has at least; the least lag of a loop, ms."""


@dataclass(frozen=True, kw_only=True)
class FollowingLag(Effect):
    """τ·dq/dt + q = command, at rest on the first row: what a position loop makes of slow motion, τ = 1/position_gain (M. Weck
    2006: velocity-proportional following error). Without an axis all that have no drive follow alike, as the position gains of
    axes that interpolate are set; the lag of one axis comes on top of that. Where a drive is declared its own gains say so
    (`ServoMismatch`).

    `shape`: `lag`, or `loop`: about a velocity loop, whose gains are found too, of each axis its own; a start or stop shows them.
    The loop of one axis has all of its lag: none of all axes joins it.

    Typical 5–60 ms, the loops of position gains from 1 to 10 m/min a millimetre.
    """

    id = "following_lag"
    reported_as = "servo_mismatch"
    stage = "drive"
    acts_in = DRIVE
    says = "the axis follows its command late, by its position loop"
    hidden_by = "latency where one axis moves, or all are late alike; location errors of a rotary axis"
    action = "declare the drive of the axis in the machine file, or switch its feed-forward on in the control"
    terms = (("lag_beyond_all", "lag beyond that of all axes"),)
    dynamic_only = True
    choices = (("shape", SHAPES),)
    shape: str = "lag"
    axes: tuple[str, ...] = ()

    @property
    def state(self) -> str:  # type: ignore[override]
        """Behind its name, where that has no axis."""
        return "" if self.axis else "of all axes"

    @property
    def coordinate(self) -> str:  # type: ignore[override]
        """Its axis' velocity; time where all are late alike."""
        return "t" if self.axis is None else "{axis} velocity"

    def prepare(self, campaign: Campaign) -> Self:
        prepared = super().prepare(campaign)
        axes = (self.axis,) if self.axis else _without_drive(campaign)
        driven = [name for name in axes if campaign.machine.axes[name].drive is not None]
        if driven:
            remedy = f'write effect = "servo_mismatch", axis = "{driven[0]}"'
            raise InputError(f"axis {driven[0]} has a drive", remedy=remedy)
        if not axes:
            raise InputError(f"{self.key}: every axis that moves has a drive", remedy='write effect = "servo_mismatch"')
        return replace(prepared, axes=axes)

    def applies(self, run: Run) -> bool:
        return super().applies(run) and not run.encoder_is_motion

    @classmethod
    def candidates(cls, campaign: Campaign) -> Forms:
        """Far from linear in a long lag, the readings are looked at about several."""
        axes = _without_drive(campaign)
        for axis in (*axes, *((None,) if axes[1:] else ())):
            effect = cls(axis=axis)
            lag, *_ = effect.parameters(campaign)
            yield from effect.forms_about(lag, [size * lag.sigma for size in SIZES], cls(axis=axis, shape="loop"))

    def parameters(self, campaign: Campaign) -> tuple[Parameter, ...]:
        lag = self.own("lag_ms", "ms", 10.0, lower=0.0 if self.shape == "lag" else LEAST, start=0.5)
        inner = {name: INNER[gain] for (_, gain), name in self._inner().items()}
        return lag, *(self.own(n, unit, size, mean=size, lower=LEAST * size) for n, (unit, size) in inner.items())

    def frees(self) -> Mapping[tuple[str, str], str]:
        lags = (LAG_OF_ALL,) if self.axis is None else (LAG,) if self.shape == "lag" else LAGS
        freed = {(axis, lag): "lag_ms" for axis in self.axes for lag in lags} | self._inner()
        return {place: f"{self.key}.{name}" for place, name in freed.items()}

    def _inner(self) -> dict[tuple[str, str], str]:
        """(axis, gain) of the velocity loops that are found → name of its parameter."""
        places = [(axis, gain) for axis in self.axes for gain in INNER] if self.shape == "loop" else []
        return {(axis, gain): gain if self.axis else f"{gain}_{axis}" for axis, gain in places}

    def beside(self, campaign: Campaign) -> tuple[Effect, ...]:
        """The lag of all axes, which one axis' own is beyond."""
        alone = self.axis is None or self.shape == "loop" or not _without_drive(campaign)[1:]
        return () if alone else (FollowingLag().prepare(campaign),)

    def describe(self, campaign: Campaign, values: Values, covariance: Covariance) -> dict[str, Quantity]:
        """The lag, what of it is beyond the one of all axes, and the position gain that has it where it is above 2σ."""
        lag, *inner = self.parameters(campaign)
        found = {p.name.removeprefix(f"{self.key}."): own_quantity(p, values, covariance) for p in (lag, *inner)}
        lags = tuple(dict.fromkeys(name for name in (lag.name, f"{self.id}.lag_ms") if name in values))
        (total,), (spread,) = propagate(lambda x: [np.sum(x)], lags, values, covariance)
        if lags[1:]:
            found |= {BEYOND: found["lag_ms"], "lag_ms": Quantity(float(total), float(spread), "ms")}
        if total > 2.0 * spread:
            found["position_gain"] = propagated(lambda x: 1e3 / np.sum(x), lags, "1/s", values, covariance)
        return found


def _without_drive(campaign: Campaign) -> tuple[str, ...]:
    """Axes that move in a dynamic run and have no drive."""
    dynamic = [run for run in campaign.runs if run.dynamic]
    axes = campaign.machine.axes
    return tuple(a for a in axes if axes[a].drive is None and any(np.ptp(run.commands[a]) > 0.0 for run in dynamic))
