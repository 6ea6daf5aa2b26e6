"""Where the errors go from here: level, rate, and when a tolerance is passed, with the band of the forecast."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
from scipy.special import stdtrit

from symfive.arrays import Array, Flags
from symfive.history._filter import State
from symfive.history._information import Information, Readings
from symfive.history._visit import time_text

YEAR = 365.25 * 86400.0
BAND = 0.95
POINTS = 400
FARTHEST, NEAREST = 10.0, 1.0 / 12.0
"""Years ahead that are looked at: as many as the history is long, between these."""


@dataclass(frozen=True)
class Forecast:
    """An error from the last visit on: `level` and `rate` a year with 1σ, file units; the dates (s) at which it passes the
    `tolerance` at the earliest and the latest (95 % band) and by the most probable path, None where not within the horizon."""

    name: str
    unit: str
    level: float
    level_std: float
    rate: float
    rate_std: float
    tolerance: float | None = None
    earliest: float | None = None
    likely: float | None = None
    latest: float | None = None
    beyond: bool = False

    def to_data(self) -> dict[str, Any]:
        """The forecast as JSON, dates in ISO 8601."""
        dates = {key: getattr(self, key) for key in ("earliest", "likely", "latest")}
        return {**asdict(self), **{key: None if date is None else time_text(date) for key, date in dates.items()}}


def years_ahead(length: float) -> Array:
    """The years after the last visit that a history of this `length` (years) is forecast to."""
    return np.linspace(0.0, max(min(FARTHEST, length), NEAREST), POINTS)


def errors_at(
    readings: Readings, scale: Array, known: Array, mean: Array, covariance: Array, begun: Flags
) -> tuple[Array, Array]:
    """Errors (n, k) and their 1σ, file units, from n levels (n, r) and their variances (n, r) along the readings' directions.

    What no direction tells stays where it is `known` (n, k); a direction that has not `begun` (n, r) is as open as its prior.
    """
    basis = readings.basis
    level, variance = np.where(begun, mean, known @ basis), np.where(begun, covariance, 1.0)
    rest = np.maximum(1.0 - (basis**2).sum(axis=1), 0.0)
    value = level @ basis.T + known - (known @ basis) @ basis.T
    return value * scale, np.sqrt(variance @ (basis**2).T + rest) * scale


def forecasts_of(
    state: State, readings: Readings, data: Information, *, which: Flags, warmth: float, ahead: Array, now: float,
    tolerances: Mapping[str, float],
) -> tuple[Forecast, ...]:  # fmt: skip
    """The forecast of errors `which` (k,) from the instant `now` over the years `ahead`, at one temperature."""
    basis, known = readings.basis, readings.known[-1]
    mean, covariance, _ = state.chosen()
    slope, slope_std = basis @ mean[:, 1] * data.scale, np.sqrt((basis**2) @ covariance[:, 1, 1]) * data.scale
    years = ahead if tolerances else ahead[:1]
    levels, variances = state.ahead(years, warmth)
    every = np.broadcast_to(state.begun, levels.shape)
    paths, spreads = errors_at(readings, data.scale, np.tile(known, (len(years), 1)), levels, variances, every)
    factor = float(stdtrit(max(float(np.min(state.count, initial=np.inf)), 1.0), 0.5 + 0.5 * BAND))
    found = []
    for i in np.flatnonzero(which):
        name, value, std = data.names[i], paths[:, i], spreads[:, i]
        tolerance = tolerances.get(name)
        dates: dict[str, float | None] = {}
        if tolerance is not None:
            size = np.abs(value)
            curves = {"earliest": size + factor * std, "likely": size, "latest": size - factor * std}
            dates = {key: _crossing(curve, tolerance, ahead, now) for key, curve in curves.items()}
        found.append(
            Forecast(
                name=name, unit=data.units[i], level=float(value[0]), level_std=float(std[0]), rate=float(slope[i]),
                rate_std=float(slope_std[i]), tolerance=tolerance,
                beyond=tolerance is not None and abs(float(value[0])) > tolerance,
                earliest=dates.get("earliest"), likely=dates.get("likely"), latest=dates.get("latest"),
            )
        )  # fmt: skip
    return tuple(found)


def _crossing(curve: Array, tolerance: float, ahead: Array, now: float) -> float | None:
    """When the curve first passes the tolerance, s; None where it stays within."""
    over = np.flatnonzero(curve > tolerance)
    if not over.size:
        return None
    i = int(over[0])
    if i == 0:
        return now
    share = (tolerance - curve[i - 1]) / (curve[i] - curve[i - 1])
    return now + float(ahead[i - 1] + share * (ahead[i] - ahead[i - 1])) * YEAR
