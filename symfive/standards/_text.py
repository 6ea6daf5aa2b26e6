"""The numbers of the standards as text and as JSON."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from symfive.numbers import plain_number, unit_words
from symfive.standards._value import StandardValue

SCHEMA = "symfive.standards/1"
NONE = "No number of a standard can be evaluated from these readings (a circle, a positioning test, a rotary test)."
Decisions = Mapping[int, tuple[float, str]]


def standards_text(values: Sequence[StandardValue], decisions: Decisions | None = None) -> str:
    """The values as text, by runs: conditions, each value with U (k = 2) and its decision, and limits."""
    groups: dict[tuple[Any, ...], list[int]] = {}
    for i, value in enumerate(values):
        key = (value.standard, value.runs, tuple(value.conditions.items()), value.limits)
        groups.setdefault(key, []).append(i)
    lines = []
    for (standard, runs, conditions, limits), places in groups.items():
        some = f"{', '.join(runs[:4])}{f' and {len(runs) - 4} more' if len(runs) > 4 else ''}"
        lines.append(f"{standard}, {some}: {'; '.join(f'{key} {said}' for key, said in conditions)}")
        lines += [f"  {values[i].words}{_decided(values[i], (decisions or {}).get(i))}" for i in places]
        lines += [f"  note: {limit}" for limit in limits]
    return "\n".join(lines) if lines else NONE


def _decided(value: StandardValue, found: tuple[float, str] | None) -> str:
    if found is None:
        return ""
    limit, verdict = found
    return f"; tolerance {plain_number(limit)} {unit_words(value.unit)}: {verdict}"


def standards_data(values: Sequence[StandardValue], decisions: Decisions | None = None) -> dict[str, Any]:
    """The values as data for JSON, with `tolerance` and `decision` where one was given."""
    rows = []
    for i, value in enumerate(values):
        row = value.to_data()
        if decisions and i in decisions:
            row |= dict(zip(("tolerance", "decision"), decisions[i], strict=True))
        rows.append(row)
    return {"schema": SCHEMA, "coverage_factor": 2, "values": rows}
