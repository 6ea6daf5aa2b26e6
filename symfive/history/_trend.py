"""A machine over the years: its errors at every visit, alarms, where they go from here, and when to come back."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field
from typing import Any

import numpy as np

from symfive.arrays import Array
from symfive.errors import InputError
from symfive.files import shown
from symfive.history._alarms import Alarm
from symfive.history._change import ITSELF, Scatter
from symfive.history._filter import REFERENCE, SPAN
from symfive.history._forecast import YEAR, Forecast, errors_at, forecasts_of, years_ahead
from symfive.history._information import Information, Readings, information_of, readings_of
from symfive.history._limits import RATE
from symfive.history._visit import Event, MachineId, Visit, time_text
from symfive.history._watched import Watched, watch_visits
from symfive.validation import as_lists

SPARK_POINTS = 60


@dataclass(frozen=True)
class Trend:
    """The history of one machine: `data` the information of each visit, (n, k); `alarms`; `forecasts` of the determined errors;
    `come_back` the date (s) until which all tolerances hold with 95 %, None without tolerances; `horizon` the last date
    looked at; `rate` false alarms a year that the limits allow. `path` and `band` (n, k) are the level and its 1σ after each
    visit, at its temperature; forecasts hold at `temperature`, the visits' average, °C (None where none was recorded); `watched`
    all that was watched; `scatter` what the machine does from visit to visit, None before it is known; `smallest` the
    smallest step of each error that would raise an alarm at the next visit, file units."""

    machine: MachineId
    visits: tuple[Visit, ...]
    events: tuple[Event, ...]
    data: Information
    determined: tuple[str, ...]
    alarms: tuple[Alarm, ...]
    forecasts: tuple[Forecast, ...]
    path: Array
    band: Array
    rate: float
    horizon: float
    watched: Watched
    come_back: float | None = None
    temperature: float | None = None
    scatter: Scatter | None = None
    smallest: Mapping[str, float] = field(default_factory=dict)

    @property
    def open_alarms(self) -> tuple[Alarm, ...]:
        """Alarms since the last repair or adjustment."""
        renewed = [event.time for event in self.events if event.renews]
        renewed += [visit.time for visit in self.visits if visit.stage == "as-left"]
        last = max(renewed, default=-np.inf)
        return tuple(alarm for alarm in self.alarms if self.visits[alarm.visit].time > last)

    def to_data(self) -> dict[str, Any]:
        """The trend as JSON."""
        return {
            "schema": "symfive.trend/1", "machine": self.machine.to_data(), "key": self.machine.key, "visits": len(self.visits),
            "first": self.visits[0].when, "last": self.visits[-1].when, "false_alarms_a_year": self.rate,
            "alarms": [alarm_data(alarm, self) for alarm in self.alarms], "open_alarms": len(self.open_alarms),
            "errors": [forecast.to_data() for forecast in self.forecasts], "temperature_C": self.temperature,
            "not_determined": [name for name in self.data.names if name not in self.determined],
            "smallest_steps_alarmed": dict(self.smallest), "horizon": time_text(self.horizon),
            "measure_again_by": None if self.come_back is None else time_text(self.come_back),
        }  # fmt: skip

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
            "spark": self._spark(),
            "events": [{"when": event.when, "kind": event.kind, "text": event.text} for event in self.events[-20:]],
        }  # fmt: skip

    def _spark(self) -> dict[str, Any] | None:
        """The error that deserves a look, thinned: of the newest open alarm, else the one whose rate stands out most."""
        if not self.forecasts:
            return None
        by_name = {forecast.name: forecast for forecast in self.forecasts}
        blamed = [cause.names[0] for alarm in self.open_alarms[-1:] for cause in alarm.causes]
        restless = max(self.forecasts, key=lambda f: abs(f.rate) / max(f.rate_std, 1e-12)).name
        name = next((name for name in blamed if name in by_name), restless)
        i = self.data.names.index(name)
        which = np.unique(np.linspace(0, len(self.visits) - 1, SPARK_POINTS).round().astype(int))
        which = which[np.isfinite(self.data.value[which, i])]
        points = [
            [self.visits[v].time, float(f"{self.data.value[v, i]:.5g}"), float(f"{self.data.std[v, i]:.3g}")]
            for v in which
        ]
        return {"name": name, "unit": by_name[name].unit, "points": points}


def alarm_data(alarm: Alarm, trend: Trend) -> dict[str, Any]:
    """An alarm as JSON."""
    when, since = trend.visits[alarm.visit].when, trend.visits[alarm.since].when
    causes = [as_lists(asdict(cause)) for cause in alarm.causes]
    return {
        "kind": alarm.kind,
        "when": when,
        "since": since,
        "score": alarm.score,
        "limit": alarm.limit,
        "causes": causes,
    }


def trend_of(
    visits: Sequence[Visit], events: Sequence[Event], *, rate: float = RATE, tolerances: Mapping[str, float] | None = None,
    watched: Watched | None = None,
) -> Trend:  # fmt: skip
    """The trend of one machine's visits, in the order of their dates. `tolerances` ± of errors by name, file units. What is
    already `watched` of the same visits and events at the same `rate` is not watched again.

    Raises `InputError` where there is no visit, or a tolerance is of an error that no visit holds or not above 0.
    """
    if not visits:
        raise InputError("the machine has no visits", remedy="add results with symfive history add")
    visits = sorted(visits, key=lambda visit: visit.order)
    data = information_of(visits)
    for name, value in (tolerances or {}).items():
        if name not in data.names:
            problem = f"no visit identified {shown(name)}"
            raise InputError(problem, remedy=f"use one of {', '.join(data.names[:12])}")
        if not value > 0.0:
            raise InputError(f"the tolerance of {name} is {value:g}", remedy="write how far it may be from zero")
    readings, warmth = readings_of(data), _warmth(visits)
    if watched is None:
        watched = watch_visits(visits, events, data, readings, warmth, rate)
    path, band = errors_at(readings, data.scale, readings.known, watched.levels, watched.variances, watched.begun)
    determined = (readings.basis**2).sum(axis=1) >= ITSELF
    usual, last = float(warmth.mean()), visits[-1].time
    ahead = years_ahead((last - visits[0].time) / YEAR)
    forecasts = forecasts_of(
        watched.state,
        readings,
        data,
        which=determined,
        warmth=usual,
        ahead=ahead,
        now=last,
        tolerances=tolerances or {},
    )
    horizon = last + float(ahead[-1]) * YEAR
    dates = [f.earliest if f.earliest is not None else horizon for f in forecasts if f.tolerance is not None]
    return Trend(
        machine=visits[-1].machine, visits=tuple(visits), events=tuple(events), data=data,
        determined=tuple(n for n, is_ in zip(data.names, determined, strict=True) if is_), alarms=tuple(watched.alarms),
        forecasts=forecasts, path=path, band=band, rate=rate, horizon=horizon, watched=watched,
        come_back=min(dates) if dates else None,
        temperature=REFERENCE + SPAN * usual if any(visit.temperature is not None for visit in visits) else None,
        scatter=_scatter(watched, readings, data), smallest=watched.smallest,
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


def _scatter(watched: Watched, readings: Readings, data: Information) -> Scatter | None:
    """What the machine does beyond the stated uncertainties, in file units; the newest visit states them."""
    if watched.excess is None:
        return None
    mean, covariance, _ = watched.state.chosen()
    basis, scale = readings.basis, data.scale
    slopes = (basis * covariance[:, 2, 2]) @ basis.T / SPAN**2
    both = np.outer(scale, scale)
    return Scatter(
        data.names, basis @ watched.excess @ basis.T * both, basis @ mean[:, 2] * scale / SPAN, slopes * both
    )
