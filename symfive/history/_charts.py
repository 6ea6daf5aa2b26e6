"""Small charts over time as inline SVG: points with their bars, the level with its band, events and alarms."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from typing import Any

import numpy as np

from symfive.arrays import Array
from symfive.history._forecast import YEAR, Forecast
from symfive.history._trend import Trend
from symfive.numbers import plain_number, rounded, unit_words

Place = Callable[[Any], Any]
"""Where a time or a value (any shape) stands in the drawing."""
WIDE, TALL = 340.0, 150.0
LEFT, RIGHT, TOP, BOTTOM = 44.0, 8.0, 10.0, 20.0
SPARK_WIDE, SPARK_TALL = 180.0, 36.0
WIDTH = 2.0
"""Bars and bands are ±2σ."""


@dataclass(frozen=True)
class Mark:
    """A line or a sign at x: its class and what hovering says."""

    x: float
    kind: str
    title: str


@dataclass(frozen=True)
class Chart:
    """One error over time: SVG paths, ticks as (place, text), and its title."""

    name: str
    unit: str
    now: str
    bars: str
    points: str
    band: str
    level: str
    limits: tuple[float, ...]
    marks: tuple[Mark, ...]
    across: tuple[tuple[float, str], ...]
    up: tuple[tuple[float, str], ...]
    wide: float = WIDE
    tall: float = TALL


@dataclass(frozen=True)
class Spark:
    """A line of a table: a band and a line, and marks."""

    name: str
    unit: str
    band: str
    line: str
    marks: tuple[Mark, ...]
    low: str
    high: str
    wide: float = SPARK_WIDE
    tall: float = SPARK_TALL


def charts_of(trend: Trend) -> list[Chart]:
    """A chart of every determined error, those with alarms first."""
    blamed = {name for alarm in trend.open_alarms for cause in alarm.causes for name in cause.names}
    return [_chart(trend, forecast) for forecast in sorted(trend.forecasts, key=lambda f: f.name not in blamed)]


def _chart(trend: Trend, forecast: Forecast) -> Chart:
    i = trend.data.names.index(forecast.name)
    unit, tolerance = trend.data.units[i], forecast.tolerance
    time = np.array([visit.time for visit in trend.visits])
    value, std, path, band = trend.data.value[:, i], trend.data.std[:, i], trend.path[:, i], trend.band[:, i]
    settled = band < 5.0 * np.nanmedian(band)  # right after a renewal the level is as open as the prior
    inside = [value - WIDTH * std, value + WIDTH * std, (path - band)[settled], (path + band)[settled]]
    limits = () if tolerance is None else (-tolerance, tolerance)
    low, high = _range(np.concatenate(inside), limits)
    x, y = _across(time), _up(low, high, TOP, TALL - BOTTOM)
    top, bottom = np.clip(path + WIDTH * band, low, high), np.clip(path - WIDTH * band, low, high)
    return Chart(
        name=trend.machine.said(forecast.name), unit=unit_words(unit),
        now=f"{rounded(forecast.level, forecast.level_std, unit)} {unit_words(unit)}",
        bars=_bars(x(time), y(value - WIDTH * std), y(value + WIDTH * std)),
        points="".join(f"M{pair}h0" for pair in _pairs(x(time), y(value))),
        band=_area(x(time), y(top), y(bottom)), level=_line(x(time), y(np.clip(path, low, high))),
        limits=tuple(round(float(y(np.array(limit))), 1) for limit in limits if low <= limit <= high),
        marks=tuple(_marks(trend, x)), across=_dates(time, x), up=tuple(_numbers(low, high, y)),
    )  # fmt: skip


def _marks(trend: Trend, x: Place) -> list[Mark]:
    found = [
        Mark(round(float(x(np.array(e.time))), 1), f"event {e.kind}", f"{e.when[:10]} {e.kind}: {e.text}")
        for e in trend.events
    ]
    for alarm in trend.alarms:
        visit = trend.visits[alarm.visit]
        names = ", ".join(" or ".join(map(trend.machine.said, cause.names[:3])) for cause in alarm.causes[:3])
        found.append(Mark(round(float(x(np.array(visit.time))), 1), "alarm", f"{visit.date} alarm: {names}"))
    return found


def spark(points: Sequence[Sequence[float]], name: str, unit: str, marks: Sequence[tuple[float, str, str]]) -> Spark:
    """A line from points (time s, value, 1σ) and marks (time, kind, title)."""
    time, value, std = np.array(points, dtype=float).reshape(-1, 3).T
    low, high = _range(np.concatenate([value - WIDTH * std, value + WIDTH * std]), ())
    begin, span = time[0], max(time[-1] - time[0], 1.0)

    def x(t: Array) -> Array:
        return np.asarray(2.0 + (t - begin) / span * (SPARK_WIDE - 4.0))

    y = _up(low, high, 3.0, SPARK_TALL - 3.0)
    shown = tuple(
        Mark(round(float(x(np.array(t))), 1), kind, title) for t, kind, title in marks if begin <= t <= time[-1]
    )
    return Spark(name, unit_words(unit), _area(x(time), y(value + WIDTH * std), y(value - WIDTH * std)),
                 _line(x(time), y(value)), shown, plain_number(low, unit), plain_number(high, unit))  # fmt: skip


def _range(values: Array, limits: Sequence[float]) -> tuple[float, float]:
    every = np.concatenate([values[np.isfinite(values)], np.asarray(limits, dtype=float)])
    low, high = (float(every.min()), float(every.max())) if every.size else (-1.0, 1.0)
    room = 0.06 * max(high - low, 1e-6)
    return low - room, high + room


def _across(time: Array) -> Place:
    begin, span = float(time[0]), max(float(time[-1] - time[0]), 1.0)
    return lambda t: LEFT + np.clip((t - begin) / span, 0.0, 1.0) * (WIDE - LEFT - RIGHT)


def _up(low: float, high: float, top: float, bottom: float) -> Place:
    return lambda v: bottom - (v - low) / (high - low) * (bottom - top)


def _pairs(x: Array, y: Array) -> list[str]:
    return [f"{a:.1f} {b:.1f}" for a, b in zip(x, y, strict=True) if math.isfinite(b)]


def _line(x: Array, y: Array) -> str:
    return "M" + "L".join(_pairs(x, y)) if len(x) else ""


def _area(x: Array, top: Array, bottom: Array) -> str:
    return f"M{'L'.join([*_pairs(x, top), *_pairs(x[::-1], bottom[::-1])])}Z" if len(x) else ""


def _bars(x: Array, low: Array, high: Array) -> str:
    both = zip(x, low, high, strict=True)
    return "".join(f"M{a:.1f} {b:.1f}V{c:.1f}" for a, b, c in both if math.isfinite(b) and math.isfinite(c))


def _numbers(low: float, high: float, y: Place) -> list[tuple[float, str]]:
    """Three to five round numbers."""
    step = 10.0 ** math.floor(math.log10((high - low) / 3.0))
    step *= next(m for m in (5.0, 2.0, 1.0) if (high - low) / (step * m) >= 2.5 or m == 1.0)
    first = math.ceil(low / step)
    values = [step * n for n in range(first, math.floor(high / step) + 1)]
    return [(round(float(y(np.array(v))), 1), plain_number(v)) for v in values]


def _dates(time: Array, x: Place) -> tuple[tuple[float, str], ...]:
    """Years, or days where the history is short."""
    first, last = (datetime.fromtimestamp(float(t), UTC) for t in (time[0], time[-1]))
    if time[-1] - time[0] < 2.0 * YEAR:
        count = 3 if time[-1] > time[0] else 1
        at = np.linspace(time[0], time[-1], count)
        middles = np.clip(x(at), LEFT + 18.0, WIDE - 34.0).round(1).tolist()  # so that no text is cut
        return tuple((m, f"{datetime.fromtimestamp(float(t), UTC):%Y-%m-%d}") for m, t in zip(middles, at, strict=True))
    step = -(-(last.year - first.year) // 5)
    years = [datetime(year, 1, 1, tzinfo=UTC) for year in range(first.year + 1, last.year + 1, step)]
    return tuple((round(float(x(np.array(y.timestamp()))), 1), f"{y.year}") for y in years)
