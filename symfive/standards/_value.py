"""A number that a standard asks for, with its uncertainty and all that ISO 230-1 wants said beside it: the place of the
test, as text, as JSON, and its decision by a tolerance (ISO 14253-1): pass, fail, or not to be decided.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from symfive.campaign import Run
from symfive.disk import release
from symfive.errors import InputError
from symfive.instruments import positioning_instrument
from symfive.machine import Machine
from symfive.numbers import plain_number, rounded, unit_words
from symfive.screen import first_of, wrapped

COVERAGE = 2.0
"""Coverage factor k of an expanded uncertainty U (ISO 14253-1 and ISO/TR 230-9)."""
PASS, FAIL, UNDECIDED = "pass", "fail", "cannot be decided at this uncertainty"
SCHEMA = "symfive.standards/1"
NONE = "No number of a standard can be evaluated from these readings (a circle, a positioning test, a rotary test)."
NOISE_ALONE = "U contains the noise of a reading only, not scale, alignment and temperature of the instrument"
"""What limits the declared noise propagated, and no longer the U of a user's own budget."""
Decisions = Mapping[int, tuple[float, str]]
STILL = 1e-6
"""An axis that moves less (mm, degree) stands still."""


@dataclass(frozen=True, kw_only=True)
class StandardValue:
    """`value` and expanded uncertainty `u` (k = 2), both in `unit`, of the quantity `name` (`G`, `E`, …) of a `standard`.

    `what` says which of its kind (`CCW`, `X up`, `dx`), `runs` the ids that it was evaluated from, `conditions` what the
    number holds for (feed, diameter, direction, place …), `limits` in which points the test differs from the standard and what a
    comparison must know. `u` is NaN where it is unknown.
    """

    standard: str
    name: str
    what: str
    value: float
    u: float
    unit: str
    runs: tuple[str, ...]
    conditions: Mapping[str, str] = field(default_factory=dict)
    limits: tuple[str, ...] = ()

    @property
    def words(self) -> str:
        """Name, value and U in one line."""
        spread = (
            f", U = {rounded(self.u, self.u, self.unit)} {unit_words(self.unit)}"
            if math.isfinite(self.u)
            else ", U unknown"
        )
        number = (
            rounded(self.value, self.u, self.unit) if math.isfinite(self.u) else rounded(self.value, 0.0, self.unit)
        )
        return f"{self.title} = {number} {unit_words(self.unit)}{spread}"

    @property
    def title(self) -> str:
        """The name, and which of its kind."""
        return f"{self.name} {self.what}".strip()

    def to_data(self) -> dict[str, Any]:
        """As JSON, `U` null where it is unknown."""
        return {
            "standard": self.standard, "name": self.name, "what": self.what, "value": self.value,
            "U": self.u if math.isfinite(self.u) else None, "unit": self.unit, "runs": list(self.runs),
            "conditions": dict(self.conditions), "limits": list(self.limits),
        }  # fmt: skip


def decision(value: float, u: float, tolerance: float) -> str:
    """`pass` where |value| + U is within the tolerance, `fail` where |value| - U is beyond it, else neither.

    `u` expanded uncertainty (k = 2); NaN, where it is unknown, decides nothing.
    """
    if abs(value) + u <= tolerance:
        return PASS
    return FAIL if abs(value) - u > tolerance else UNDECIDED


def matching(values: Sequence[StandardValue], name: str) -> list[int]:
    """Places of the values that a name means: `G`, `G XY CCW`, or either with a run, `G@circle-1`.

    Raises `InputError` listing the names that there are.
    """
    wanted, _, run = name.partition("@")
    found = [
        i for i, value in enumerate(values)
        if wanted in (value.name, value.title) and (not run or run in value.runs)
    ]  # fmt: skip
    if not found:
        there = ", ".join(dict.fromkeys(value.name for value in values)) or "none"
        raise InputError(f'no number of a standard is called "{name}"', remedy=f"use one of {there}")
    return found


def decided(values: Sequence[StandardValue], tolerances: Mapping[str, float]) -> dict[int, tuple[float, str]]:
    """Index of a value → (tolerance in the value's unit, decision). The last of several tolerances for one value holds."""
    return {
        i: (limit, decision(values[i].value, values[i].u, limit))
        for name, limit in tolerances.items() for i in matching(values, name)
    }  # fmt: skip


def with_uncertainties(values: Sequence[StandardValue], known: Mapping[str, float]) -> tuple[StandardValue, ...]:
    """The values, with expanded uncertainties (k = 2, the value's unit) from the user's own budget where it has them."""
    new = list(values)
    for name, u in known.items():
        if not (math.isfinite(u) and u >= 0.0):
            raise InputError(f"the uncertainty of {name} is {u:g}", remedy="give U (k = 2) of at least 0")
        for i in matching(values, name):
            new[i] = replace(new[i], u=u, limits=tuple(s for s in new[i].limits if s != NOISE_ALONE))
    return tuple(new)


def standards_text(values: Sequence[StandardValue], decisions: Decisions | None = None) -> str:
    """The values as text, by runs: conditions, those of all first, each value with U (k = 2) and its decision, and limits."""
    groups: dict[tuple[Any, ...], list[int]] = {}
    for i, value in enumerate(values):
        key = (value.standard, value.runs, tuple(value.conditions.items()), value.limits)
        groups.setdefault(key, []).append(i)
    if not groups:
        return NONE
    each = [dict.fromkeys(conditions) for _, _, conditions, _ in groups]
    shared = [one for one in each[0] if all(one in other for other in each)] if len(each) > 1 else []
    lines = ["U: expanded uncertainty (k = 2)"]
    lines += wrapped("all: ", _conditions(shared)) if shared else []
    for (standard, runs, conditions, limits), places in groups.items():
        own = _conditions([one for one in conditions if one not in shared])
        lines += wrapped("", f"{standard}, {first_of(runs, 4)}{f': {own}' if own else ''}")
        lines += [f"  {values[i].words}{_decided(values[i], (decisions or {}).get(i))}" for i in places]
        lines += [line for limit in limits for line in wrapped("  note: ", limit)]
    return "\n".join(lines)


def _conditions(pairs: Sequence[tuple[str, str]]) -> str:
    return "; ".join(f"{key} {said}" for key, said in pairs)


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


def moved(run: Run) -> set[str]:
    """The axes that a run moves; a column that lies on disk is in memory by itself."""
    found = set[str]()
    for name, way in run.commands.items():
        if float(np.ptp(way)) > STILL:
            found.add(name)
        release(way)
    return found


def place_of(machine: Machine, run: Run) -> dict[str, str]:
    """The axes that moved, the place of the balls or the reflector, the positions of all axes that stood."""
    moving = moved(run)
    standing = [f"{n} {plain_number(run.commands[n][0])}" for n in machine.axis_names if n not in moving]
    place = {"axes moved": ", ".join(n for n in machine.axis_names if n in moving) or "none"}
    if not positioning_instrument(run):
        place["centre"] = f"({_listed(run.table_ball)}) mm in the workpiece frame"
    place["tool reference"] = f"({_listed(run.tool_ball)}) mm in the tool frame"
    return place | ({"axes at rest": f"{', '.join(standing)} (mm, °)"} if standing else {})


def _listed(vector: Iterable[float]) -> str:
    return ", ".join(plain_number(value) for value in vector)
