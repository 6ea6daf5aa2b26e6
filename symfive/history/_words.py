"""A machine's trend in words, for a screen, and the fleet's table: one row a machine, from the state that the index keeps."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from typing import Any

from symfive.history._alarms import Cause
from symfive.history._change import cause_words
from symfive.history._forecast import BAND, Forecast
from symfive.history._trend import Trend, alarm_data
from symfive.history._visit import MachineId, time_text
from symfive.numbers import plain_number, unit_words, with_std, with_unit
from symfive.screen import OnScreen, aligned, listed, plural

SCHEMA = "symfive.history/1"


@dataclass(frozen=True, kw_only=True)
class MachineRow:
    """One machine: how many visits from `first` to `last` (ISO 8601), alarms in all and `open` ones since the last repair, the
    newest of them as it stands in the state, findings of the last visit, and its errors now; `says` the newest open alarm in
    a few words, else that there are no visits."""

    machine: MachineId
    visits: int
    first: str = ""
    last: str = ""
    alarms: int = 0
    open: int = 0
    alarm: Mapping[str, Any] | None = None
    findings: tuple[str, ...] = ()
    rms: float | None = None
    rms_unit: str = "um"
    forecasts: tuple[Mapping[str, Any], ...] = field(default=())
    says: str = field(init=False)

    def __post_init__(self) -> None:
        said = "" if self.visits else "no visits"
        if self.open and self.alarm is not None:
            said = f"{alarm_words(self.alarm, self.machine)} ({self.alarm['when'][:10]})"
        object.__setattr__(self, "says", said)


def alarm_words(alarm: Mapping[str, Any], machine: MachineId) -> str:
    """An alarm as one says it: `step of EX0C +2.1 ± 0.3 µm`."""
    kind = {"step": "step", "several": "several errors stepped", "drift": "drift"}[alarm["kind"]]
    causes = [cause_words(Cause(**c), machine) for c in alarm["causes"][:3]]
    joint = ": " if alarm["kind"] == "several" else " of "
    return f"{kind}{joint}{', '.join(causes)}" if causes else kind


@dataclass(frozen=True, repr=False)
class MachineTable(OnScreen):
    """All machines of a history."""

    rows: tuple[MachineRow, ...]

    def to_data(self) -> dict[str, Any]:
        """The table as JSON."""
        return {"schema": SCHEMA, "machines": [{**asdict(row), "key": row.machine.key} for row in self.rows]}

    def __str__(self) -> str:
        alarmed = sum(row.open > 0 for row in self.rows)
        head = f"history of {plural(len(self.rows), 'machine')}, {alarmed} with an open alarm"
        order = sorted(self.rows, key=lambda row: (-row.open, str(row.machine)))
        cells = [["machine", "visits", "last", "alarms", "rms", "says"], *(_cells(row) for row in order)]
        heads, *lines = aligned(cells)
        return "\n".join([head, heads, *listed(lines, "history.fleet().rows", 40)])


def _cells(row: MachineRow) -> list[str]:
    rms = "" if row.rms is None else with_unit(row.rms, row.rms_unit)
    says = row.says or (", ".join(row.findings[:3]) and f"found: {', '.join(row.findings[:3])}")
    alarms = f"{row.open} open" if row.open else str(row.alarms)
    return [_short(str(row.machine), 30), str(row.visits), row.last[:10], alarms, rms, _short(says, 90)]


def _short(text: str, most: int) -> str:
    return text if len(text) <= most else f"{text[: most - 1]}…"


def row_of(machine: MachineId, state: Mapping[str, Any]) -> MachineRow:
    """The row that a state says."""
    alarms = state.get("alarms", [])
    return MachineRow(
        machine=machine, visits=int(state.get("visits", 0)), first=str(state.get("first") or ""),
        last=str(state.get("last") or ""),
        alarms=int(state.get("alarm_count", 0)), open=int(state.get("open", 0)), alarm=alarms[-1] if alarms else None,
        findings=tuple(map(str, state.get("findings", []))), rms=None if state.get("rms") is None else float(state["rms"]),
        rms_unit=str(state.get("rms_unit", "um")), forecasts=tuple(map(dict, state.get("forecasts", []))),
    )  # fmt: skip


def trend_text(trend: Trend) -> str:
    """The machine, its alarms, its errors now with their rates, and when to come back."""
    first, last = trend.visits[0], trend.visits[-1]
    head = f"{trend.machine}: {plural(len(trend.visits), 'visit')}, {first.date} to {last.date}"
    lines = [head, *(f"  {sentence}" for sentence in _alarms(trend))]
    rows = aligned([("error", "last visit", "now", "a year", "alarm from"), *(_row(trend, f) for f in trend.forecasts)])
    lines += ["", rows[0], *listed(rows[1:], "history.trend(machine).forecasts")]
    open_ = [name for name in trend.data.names if name not in trend.determined]
    if open_:
        lines.append(f"Not determined alone by these tests: {', '.join(map(trend.machine.said, open_[:12]))}.")
    lines += [forecast_sentence(f, trend) for f in trend.forecasts if f.tolerance is not None]
    said = advice(trend)
    if said:
        lines.append(said)
    lines.append(conditions(trend))
    return "\n".join(lines)


def conditions(trend: Trend) -> str:
    """What the errors of a trend hold for."""
    known = trend.temperature is not None
    warm = f", now and later at {plain_number(trend.temperature or 0.0)} °C, the visits' average" if known else ""
    return (
        f"± is 1σ; from the nominal machine of the first visit{warm}. Alarm from: the smallest step that raises an alarm at the "
        "next visit."
    )


def last_value(trend: Trend, forecast: Forecast) -> tuple[str, float]:
    """An error at the last visit, as text and as number; a dash where that had none."""
    i = trend.data.names.index(forecast.name)
    value = float(trend.data.value[-1, i])
    return (with_std(value, float(trend.data.std[-1, i]), forecast.unit) if math.isfinite(value) else "–"), value


def _row(trend: Trend, forecast: Forecast) -> tuple[str, ...]:
    """An error: at the last visit; now, its rate and the smallest step alarmed from the second visit on."""
    now = with_std(forecast.level, forecast.level_std, forecast.unit)
    rate = with_std(forecast.rate, forecast.rate_std, forecast.unit)
    later = (now, rate, smallest_step(trend, forecast)) if len(trend.visits) > 1 else ("", "", "")
    return trend.machine.said(forecast.name), last_value(trend, forecast)[0], *later


def smallest_step(trend: Trend, forecast: Forecast) -> str:
    """The smallest step that would raise an alarm at the next visit; "" where none is known."""
    size = trend.smallest.get(forecast.name)
    return "" if size is None else f"{size:.2g} {unit_words(forecast.unit)}"


def _alarms(trend: Trend) -> list[str]:
    stated = f"false alarms expected: at most {plain_number(trend.rate * 10)} in ten years"
    if not trend.alarms and not trend.smallest:
        return ["No alarm can be raised yet: too few visits. Compare two dates with --since."]
    if not trend.alarms:
        return [f"No alarm ({stated})."]
    shown = [alarm_sentence(trend, number) for number in range(len(trend.alarms))][::-1]
    return [f"{plural(len(trend.alarms), 'alarm')}, {len(trend.open_alarms)} open ({stated}), the newest first:",
            *listed(shown, "history.trend(machine).alarms", 8)]  # fmt: skip


def alarm_sentence(trend: Trend, number: int) -> str:
    """`2026-03-04: step of EX0C +2.1 ± 0.3 µm, since 2026-02-25`."""
    alarm = trend.alarms[number]
    when, since = trend.visits[alarm.visit].date, trend.visits[alarm.since].date
    later = f", since {since}" if since != when else ""
    return f"{when}: {alarm_words(alarm_data(alarm, trend), trend.machine)}{later}"


def forecast_sentence(forecast: Forecast, trend: Trend) -> str:
    """When an error passes its tolerance, with the band; "" for one without a tolerance."""
    if forecast.tolerance is None:
        return ""
    limit, name = f"±{plain_number(forecast.tolerance)} {unit_words(forecast.unit)}", trend.machine.said(forecast.name)
    if forecast.beyond:
        return f"{name} is beyond {limit} today."
    if forecast.earliest is None:
        return f"{name} stays within {limit} until {time_text(trend.horizon)[:10]}."
    likely = time_text(forecast.likely)[:10] if forecast.likely is not None else "not in sight"
    latest = time_text(forecast.latest)[:10] if forecast.latest is not None else "perhaps never"
    band = f"{100 * BAND:.0f} % band {time_text(forecast.earliest)[:10]} to {latest}"
    return f"{name} passes {limit}: {likely} ({band})."


def advice(trend: Trend) -> str:
    """When to measure again; "" without tolerances."""
    if trend.come_back is None:
        return ""
    if any(f.beyond for f in trend.forecasts):
        return "Correct the machine now: a tolerance is exceeded."
    if trend.come_back <= trend.visits[-1].time:
        return "Measure again now: with these uncertainties a tolerance may be exceeded already."
    days = (trend.come_back - trend.visits[-1].time) / 86400.0
    by = time_text(trend.come_back)[:10]
    if trend.come_back >= trend.horizon:
        return f"No tolerance is reached before {by}, as far as this history supports a forecast; a collision is not foreseen."
    return f"Measure again by {by} ({days:.0f} days after the last visit); a collision is not foreseen."
