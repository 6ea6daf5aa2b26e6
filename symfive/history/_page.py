"""One self-contained HTML page of a machine, one of the fleet: no network, light and dark, narrow and on paper."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from importlib.resources import files
from typing import Any

from symfive.drawing import page, templates
from symfive.history._change import Change, change_between
from symfive.history._charts import Spark, charts_of, spark
from symfive.history._forecast import YEAR
from symfive.history._trend import Trend, alarm_data
from symfive.history._visit import Finding, MachineId, Visit, instant
from symfive.history._words import (
    MachineRow,
    MachineTable,
    advice,
    alarm_sentence,
    alarm_words,
    conditions,
    forecast_sentence,
    last_value,
    smallest_step,
)
from symfive.numbers import plain_number, with_std, with_unit
from symfive.screen import plural

SHOWN = 60
"""Visits in the open table; the older ones are folded away."""


def machine_page(trend: Trend) -> str:
    """The page of one machine's trend as HTML."""
    last, count = trend.visits[-1], len(trend.open_alarms)
    newest = [trend.alarms.index(alarm) for alarm in trend.open_alarms][-3:][::-1]
    headline = f"{plural(count, 'open alarm')}" if count else "No open alarm"
    if last.temperature is not None:
        headline += f"; last visit {last.date} at {plain_number(last.temperature)} °C"
    sentences = [f"{alarm_sentence(trend, number)}." for number in newest]
    sentences += [forecast_sentence(f, trend) for f in trend.forecasts if f.tolerance is not None]
    sentences += [advice(trend)] if trend.come_back is not None else []
    stated = f"False alarms expected: at most {plain_number(10 * trend.rate)} in ten years."
    return _filled(
        "machine.html", f"History of {trend.machine.name}", machine=trend.machine, visits=trend.visits, open=count,
        headline=f"{headline}.", sentences=sentences, changes=_changes(trend), charts=charts_of(trend),
        undetermined=[trend.machine.said(n) for n in trend.data.names if n not in trend.determined], errors=_errors(trend),
        alarms=[_alarm(trend, number) for number in range(len(trend.alarms))][::-1], stated=stated,
        findings=_findings(trend.visits), events=list(trend.events)[::-1], visit_parts=_visits(trend.visits),
    )  # fmt: skip


def fleet_page(
    table: MachineTable, states: Sequence[Mapping[str, Any]], *, link: Mapping[str, str] | None = None
) -> str:
    """The page of all machines; `states` as the index keeps them, in the order of the rows; `link` key → address."""
    order = sorted(range(len(table.rows)), key=lambda i: (-table.rows[i].open, table.rows[i].machine.name))
    rows = [_row(table.rows[i], states[i], (link or {}).get(table.rows[i].machine.key)) for i in order]
    alarmed = [row for row in table.rows if row.open]
    tiles = [("machines", len(table.rows)), ("visits", sum(row.visits for row in table.rows)),
             ("with an open alarm", len(alarmed)),
             ("last visit", max((row.last[:10] for row in table.rows), default=""))]  # fmt: skip
    headline = f"{plural(len(alarmed), 'machine')} with an open alarm." if alarmed else "No machine has an open alarm."
    return _filled("fleet.html", f"History of {plural(len(table.rows), 'machine')}", tiles=tiles, alarmed=alarmed, rows=rows,
                   headline=headline, sentences=[])  # fmt: skip


def _filled(name: str, title: str, **values: Any) -> str:
    body = templates("symfive.history", "pages").get_template(name).render(title=title, **values)
    return page(title, body, style=(files("symfive.history") / "pages" / "history.css").read_text(encoding="utf-8"))


def _changes(trend: Trend) -> list[dict[str, Any]]:
    """Since the visit before, and since the one a year before."""
    visits = trend.visits
    if len(visits) < 2:
        return []
    pairs = {"Since the visit before": visits[-2]}
    year = [visit for visit in visits[:-1] if visit.time <= visits[-1].time - 0.95 * YEAR]
    if year and year[-1] is not visits[-2]:
        pairs["Since a year before"] = year[-1]
    return [_change(title, change_between(first, visits[-1], trend.scatter)) for title, first in pairs.items()]


def _change(title: str, change: Change) -> dict[str, Any]:
    head, *lines = str(change).split("\n")
    warm = (change.first.temperature, change.second.temperature)
    if change.changed and not change.scatter_known and None not in warm and abs(warm[1] - warm[0]) >= 1.0:  # type: ignore[operator]
        head += f" Machine temperature {warm[0]:.1f} °C before, {warm[1]:.1f} °C now: it may explain a part."
    shown = [line.strip() for line in lines[: len(change.causes)]] if change.changed else []
    return {"title": title, "head": head, "lines": [*shown, *(f"{finding.says}." for finding in change.findings)]}


def _errors(trend: Trend) -> dict[str, Any]:
    """The table of errors now."""
    rows = []
    for f in trend.forecasts:
        cells = [_cell(trend.machine.said(f.name)), _cell(*last_value(trend, f)),
                 _cell(with_std(f.level, f.level_std, f.unit), f.level),
                 _cell(with_std(f.rate, f.rate_std, f.unit), f.rate),
                 _cell(smallest_step(trend, f), trend.smallest.get(f.name, float("inf")))]  # fmt: skip
        if any(other.tolerance is not None for other in trend.forecasts):
            cells.append(_cell(f"±{plain_number(f.tolerance)}" if f.tolerance is not None else "", f.tolerance or 0.0))
        rows.append(cells)
    heads = ["error", "last visit", "now", "a year", "alarm from", "tolerance"][: len(rows[0]) if rows else 5]
    return {"heads": heads, "rows": rows, "note": conditions(trend)}


def _cell(text: str, sort: float | None = None) -> dict[str, Any]:
    return {"text": text, "sort": sort}


def _alarm(trend: Trend, number: int) -> dict[str, Any]:
    alarm = trend.alarms[number]
    kind, _, cause = alarm_words(alarm_data(alarm, trend), trend.machine).partition(
        " of " if alarm.kind != "several" else ": "
    )
    return {"when": trend.visits[alarm.visit].date, "since": trend.visits[alarm.since].date, "kind": kind, "cause": cause,
            "score": alarm.score, "limit": alarm.limit, "score_text": plain_number(alarm.score),
            "limit_text": plain_number(alarm.limit), "open": alarm in trend.open_alarms}  # fmt: skip


def _findings(visits: Sequence[Visit]) -> list[dict[str, Any]]:
    """Every finding that any visit had."""
    found: dict[str, list[tuple[Visit, Finding]]] = {}
    for visit in visits:
        for finding in visit.findings:
            found.setdefault(finding.words, []).append((visit, finding))
    diagnosed = sum(visit.diagnosed for visit in visits)
    return [
        {"words": words, "first": entries[0][0].date, "last": entries[-1][0].date, "count": len(entries), "of": diagnosed,
         "size": entries[-1][1].size}
        for words, entries in found.items()
    ]  # fmt: skip


def _visits(visits: Sequence[Visit]) -> list[dict[str, Any]]:
    rows = [
        {"date": v.date, "stage": v.stage, "instrument": v.instrument, "temperature": v.temperature, "operator": v.operator,
         "rms": v.rms, "rms_text": with_unit(v.rms, v.rms_unit),
         "findings": ", ".join(f.words for f in v.findings), "note": v.note, "version": v.version, "manifest": v.manifest[:10]}
        for v in reversed(visits)
    ]  # fmt: skip
    parts: list[dict[str, Any]] = [{"summary": "", "rows": rows[:SHOWN]}]
    if len(rows) > SHOWN:
        parts.append({"summary": f"{len(rows) - SHOWN} earlier visits", "rows": rows[SHOWN:]})
    return parts


def _row(row: MachineRow, state: Mapping[str, Any], link: str | None) -> dict[str, Any]:
    return {
        "name": row.machine.name, "serial": row.machine.serial, "open": row.open, "says": row.says, "last": row.last[:10],
        "visits": row.visits, "rms": row.rms or 0.0, "findings": ", ".join(row.findings), "link": link,
        "rms_text": "" if row.rms is None else with_unit(row.rms, row.rms_unit),
        "spark": _spark(state, row.machine),
    }  # fmt: skip


def _spark(state: Mapping[str, Any], machine: MachineId) -> Spark | None:
    data = state.get("spark")
    if not data:
        return None
    marks = [
        (instant(a["when"]), "alarm", f"{a['when'][:10]} alarm: {alarm_words(a, machine)}") for a in state["alarms"]
    ]
    marks += [
        (instant(e["when"]), f"event {e['kind']}", f"{e['when'][:10]} {e['kind']}: {e['text']}")
        for e in state["events"]
    ]
    return spark(data["points"], machine.said(data["name"]), data["unit"], marks)
