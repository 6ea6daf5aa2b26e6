"""A machine over the years: its errors at every visit, alarms, where they go from here, and when to come back."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.special import stdtrit

from symfive.errors import InputError
from symfive.files import shown
from symfive.history._alarms import Alarm, Watch
from symfive.history._directions import readings_of
from symfive.history._filter import REFERENCE, SPAN, Filter
from symfive.history._information import Said, said_by
from symfive.history._limits import RATE
from symfive.history._visit import Event, MachineId, Visit

__all__ = ["BAND", "YEAR", "Forecast", "Trend", "trend_of"]

Array = NDArray[np.float64]
YEAR = 365.25 * 86400.0
BAND = 0.95
GRID = 400
FARTHEST = 10.0
"""Years ahead that are looked at, and never more than the history is long."""
ITSELF = 0.9
"""An error is forecast where so much of it lies in the determined directions."""


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


@dataclass(frozen=True)
class Trend:
    """The history of one machine: `said` what each visit says, (n, k); `alarms`; `forecasts` of the determined errors;
    `come_back` the date (s) until which all tolerances hold with 95 %, None without tolerances; `horizon` the last date
    looked at; `rate` false alarms a year that the limits allow. `path` and `band` (n, k) are the level and its 1σ after each
    visit, at its temperature; forecasts hold at `temperature`, the visits' average, °C."""

    machine: MachineId
    visits: tuple[Visit, ...]
    events: tuple[Event, ...]
    said: Said
    determined: tuple[str, ...]
    alarms: tuple[Alarm, ...]
    forecasts: tuple[Forecast, ...]
    path: Array
    band: Array
    ahead: Array
    rate: float
    horizon: float
    come_back: float | None = None
    temperature: float = REFERENCE

    @property
    def open_alarms(self) -> tuple[Alarm, ...]:
        """Alarms since the last repair or adjustment."""
        renewed = [event.time for event in self.events if event.renews]
        renewed += [visit.time for visit in self.visits if visit.stage == "as-left"]
        last = max(renewed, default=-np.inf)
        return tuple(alarm for alarm in self.alarms if self.visits[alarm.visit].time > last)

    def state(self) -> dict[str, Any]:
        """What the fleet's table needs."""
        last = self.visits[-1] if self.visits else None
        return {
            "visits": len(self.visits), "first": self.visits[0].when if last else None, "last": last.when if last else None,
            "alarms": [alarm_data(alarm, self) for alarm in self.alarms[-20:]], "alarm_count": len(self.alarms),
            "open": len(self.open_alarms), "rms": last.rms if last else None, "rms_unit": last.rms_unit if last else "um",
            "findings": [finding.words for finding in last.findings] if last else [],
            "forecasts": [
                {"name": f.name, "unit": f.unit, "level": f.level, "level_std": f.level_std, "rate": f.rate,
                 "rate_std": f.rate_std} for f in self.forecasts
            ],
        }  # fmt: skip


def alarm_data(alarm: Alarm, trend: Trend) -> dict[str, Any]:
    """An alarm as JSON."""
    causes = [{"names": list(c.names), "probabilities": list(c.probabilities), "change": c.change, "std": c.std,
               "unit": c.unit} for c in alarm.causes]  # fmt: skip
    when, since = trend.visits[alarm.visit].when, trend.visits[alarm.since].when
    return {"kind": alarm.kind, "when": when, "since": since, "score": alarm.score, "limit": alarm.limit, "causes": causes}


def trend_of(
    visits: Sequence[Visit], events: Sequence[Event], *, rate: float = RATE, tolerances: Mapping[str, float] | None = None,
) -> Trend:  # fmt: skip
    """The trend of one machine's visits, in the order of their dates. `tolerances` ± of errors by name, file units.

    Raises `InputError` where there is no visit, or a tolerance is of an error that no visit holds.
    """
    if not visits:
        raise InputError("the machine has no visits", remedy="add results with symfive history add")
    visits = sorted(visits, key=lambda visit: visit.order)
    said = said_by(visits)
    for name in tolerances or {}:
        if name not in said.names:
            problem = f"no visit identified {shown(name)}"
            raise InputError(problem, remedy=f"use one of {', '.join(said.names[:12])}")
    readings = readings_of(said)
    filter_, watch = Filter(readings.basis.shape[1]), Watch(readings.basis, said.names, said.units, said.scale)
    alarms, path, band = list[Alarm](), np.full_like(said.value, np.nan), np.full_like(said.value, np.nan)
    renewals, warmth = sorted(event.time for event in events if event.renews), _warmth(visits)
    gain: Array | None = None
    for number, visit in enumerate(visits):
        before = visits[number - 1] if number else visit
        years = (visit.time - before.time) / YEAR
        filter_.elapse(years)
        renewed = visit.stage == "as-left" or any(before.time < time <= visit.time for time in renewals)
        if renewed:
            filter_.renew()
            watch.forget()
            gain = None
        value, variance = readings.value[number], readings.variance[number]
        step = filter_.forecast(value, variance, warmth[number], gain)
        alarm = watch.look(step, rate, years, number) if number and not renewed else None
        if alarm is not None:
            alarms.append(alarm)
            filter_.renew()
            watch.forget()
        if number and not renewed:
            watch.learn(step, alarm)
        gain = filter_.follow(value, variance, warmth[number], learn=alarm is None and not renewed)
        if alarm is not None:
            gain = None
        path[number], band[number] = _at(filter_, readings.basis, readings.known[number], said.scale, warmth[number])
    determined = (readings.basis**2).sum(axis=1) >= ITSELF
    ahead = np.linspace(0.0, max(min(FARTHEST, (visits[-1].time - visits[0].time) / YEAR), 1.0 / 12.0), GRID)
    usual = float(warmth.mean())
    forecasts = _forecasts(filter_, readings.basis, readings.known[-1], said, determined, usual, ahead, visits[-1].time,
                           tolerances or {})  # fmt: skip
    horizon = visits[-1].time + float(ahead[-1]) * YEAR
    dates = [f.earliest if f.earliest is not None else horizon for f in forecasts if f.tolerance is not None]
    return Trend(
        machine=visits[-1].machine, visits=tuple(visits), events=tuple(events), said=said,
        determined=tuple(n for n, is_ in zip(said.names, determined, strict=True) if is_), alarms=tuple(alarms),
        forecasts=forecasts, path=path, band=band, ahead=ahead, rate=rate, horizon=horizon,
        come_back=min(dates) if dates else None, temperature=REFERENCE + SPAN * usual,
    )  # fmt: skip


def _warmth(visits: Sequence[Visit]) -> Array:
    """How far each visit was from 20 °C, in ten degrees; one that was not recorded as warm as those before it on average."""
    found, known = [], list[float]()
    for visit in visits:
        if visit.temperature is not None:
            known.append(visit.temperature)
        here = visit.temperature if visit.temperature is not None else (np.mean(known) if known else REFERENCE)
        found.append((float(here) - REFERENCE) / SPAN)
    return np.array(found)


def _at(
    filter_: Filter, basis: Array, known: Array, scale: Array, warmth: float, years: float = 0.0
) -> tuple[Array, Array]:
    """The errors (k,) so many years from now and their 1σ, file units; what is not determined stays where it is known."""
    mean, covariance, memory = filter_.chosen()
    regressor = np.array([1.0, years, warmth])
    level = mean @ regressor
    variance = covariance @ regressor @ regressor * np.exp(np.minimum(years / memory, 50.0))
    begun = filter_.begun
    level, variance = np.where(begun, level, basis.T @ known), np.where(begun, variance, 1.0)
    rest = np.maximum(1.0 - (basis**2).sum(axis=1), 0.0)
    value = basis @ level + known - basis @ (basis.T @ known)
    return value * scale, np.sqrt((basis**2) @ variance + rest) * scale


def _forecasts(
    filter_: Filter, basis: Array, known: Array, said: Said, determined: NDArray[np.bool_], warmth: float, ahead: Array,
    now: float, tolerances: Mapping[str, float],
) -> tuple[Forecast, ...]:  # fmt: skip
    mean, covariance, _ = filter_.chosen()
    slope, slope_std = basis @ mean[:, 1] * said.scale, np.sqrt((basis**2) @ covariance[:, 1, 1]) * said.scale
    years = ahead if tolerances else ahead[:1]
    paths = [_at(filter_, basis, known, said.scale, warmth, float(year)) for year in years]
    dof = float(np.min(filter_.count, initial=np.inf)) if filter_.count.size else 1.0
    factor = float(stdtrit(max(dof, 1.0), 0.5 + 0.5 * BAND))
    found = []
    for i, name in enumerate(said.names):
        if not determined[i]:
            continue
        value, std = np.array([p[0][i] for p in paths]), np.array([p[1][i] for p in paths])
        tolerance = tolerances.get(name)
        crossings: tuple[float | None, ...] = (None, None, None)
        if tolerance is not None:
            near, far = np.abs(value) - factor * std, np.abs(value) + factor * std
            crossings = tuple(_crossing(curve, tolerance, ahead, now) for curve in (far, np.abs(value), near))
        found.append(
            Forecast(name, said.units[i], float(value[0]), float(std[0]), float(slope[i]), float(slope_std[i]), tolerance,
                     *crossings, beyond=tolerance is not None and abs(float(value[0])) > tolerance)
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
