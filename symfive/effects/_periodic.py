"""What effects that come back along the way of an axis share: a series of sines in its position."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from typing import TYPE_CHECKING, Any

import casadi as ca

from symfive.effects._base import Effect
from symfive.effects._quantity import Covariance, Quantity, Values, amplitude_and_phase, own_quantity
from symfive.errors import InputError
from symfive.motion import Position
from symfive.parameters import Parameter

if TYPE_CHECKING:
    from symfive.row import Row

READINGS = 2.5
"""Readings per cycle, at least (H. Nyquist 1928: 2)."""


def check_period(effect: Effect, period: float, harmonics: int) -> None:
    """Raise `InputError` where a period or a number of harmonics is none."""
    if not (period > 0.0 and math.isfinite(period)):
        raise InputError(f"effect {effect.id} needs its period", remedy="write period = … in mm or degree")
    if not 1 <= harmonics <= 20:
        raise InputError(f"effect {effect.id}: harmonics {harmonics} is not from 1 to 20", remedy="correct it")


def _orders(harmonics: int) -> tuple[tuple[int, str], ...]:
    """Harmonics with the ending of their parameters' names; the first has none."""
    return tuple((n, "" if n == 1 else str(n)) for n in range(1, harmonics + 1))


def series_parameters(
    effect: Effect, harmonics: int, unit: str, sigma: float, period: tuple[float, float, str]
) -> tuple[Parameter, ...]:
    """Amplitudes of sine and cosine, so that it is linear but for the `period` (value, 1σ, unit), a parameter unless 1σ is 0."""
    found = [effect.own(f"{f}{end}", unit, sigma) for _, end in _orders(harmonics) for f in ("sin", "cos")]
    value, spread, own_unit = period
    if spread:
        found.append(effect.own("period", own_unit, spread, mean=value, lower=0.5 * value))
    return tuple(found)


def sines(effect: Effect, row: Row, harmonics: int, period: float | None) -> Iterator[Any]:
    """The terms of the series at a row; `period` file units where it is known, None where it is a parameter."""
    axis = row.machine.axes[str(effect.axis)]
    length = effect.parameter(row, "period") if period is None else period * axis.to_internal
    angle = 2.0 * math.pi * row.signal(Position(axis.name)) / length
    for order, end in _orders(harmonics):
        yield effect.parameter(row, f"sin{end}") * ca.sin(order * angle)
        yield effect.parameter(row, f"cos{end}") * ca.cos(order * angle)


def described(
    parameters: Mapping[str, Parameter], period: Quantity, harmonics: int, values: Values, covariance: Covariance
) -> dict[str, Quantity]:
    """Period, amplitudes and phases, of `parameters` by the effect's own names; `period` where it is none of these."""
    found = {"period": own_quantity(parameters["period"], values, covariance) if "period" in parameters else period}
    for _, end in _orders(harmonics):
        sine, cosine = parameters[f"sin{end}"], parameters[f"cos{end}"]
        amplitude, phase = amplitude_and_phase(sine.name, cosine.name, sine.unit, values, covariance)
        found |= {f"amplitude{end}": amplitude, f"phase{end}": phase}
    return found
