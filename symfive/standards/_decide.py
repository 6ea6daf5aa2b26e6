"""Pass, fail, or not to be decided: a value, its expanded uncertainty and a tolerance (ISO 14253-1)."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace

from symfive.errors import InputError
from symfive.standards._value import StandardValue

PASS, FAIL, UNDECIDED = "pass", "fail", "cannot be decided at this uncertainty"


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
            new[i] = replace(new[i], u=u, limits=tuple(s for s in new[i].limits if not s.startswith("U holds")))
    return tuple(new)
