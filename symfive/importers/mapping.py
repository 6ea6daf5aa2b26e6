"""What the columns of a table mean: guessed from its head, said by the user, shown before anything is written.

The meaning of a column by its name and its unit in the head may be guessed; a unit is never.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from symfive.arrays import Array
from symfive.errors import InputError, among
from symfive.files import shown
from symfive.importers.table import Table, check_time
from symfive.machine import Machine

SCALES = {
    "length": {"mm": 1.0, "um": 1e-3, "nm": 1e-6, "m": 1e3, "in": 25.4, "mil": 0.0254, "uin": 25.4e-6},
    "angle": {"deg": 1.0, "rad": 180.0 / np.pi, "gon": 0.9, "urad": 1.8e-4 / np.pi, "arcsec": 1.0 / 3600.0},
    "time": {"s": 1.0, "ms": 1e-3, "min": 60.0},
    "force": {"N": 1.0, "kN": 1e3},
    "torque": {"Nm": 1.0},
}
"""Quantity → unit → what multiplies it to mm, degree, s, N or Nm."""
ALIASES = {
    "time": ("time", "t", "zeit", "timestamp"),
    "angle": ("angle", "phi", "winkel", "theta"),
    "deviation": ("deviation", "dev", "error", "abweichung", "dl", "delta"),
    "radius": ("radius", "r"),
    "ccw": ("ccw",),
    "cw": ("cw",),
    "target": ("target", "soll", "ziel", "nominal", "target position", "tgt"),
    "measured": ("measured", "ist", "actual", "measured position"),
    "up": ("up", "forward", "fwd", "auf", "vorwärts"),
    "down": ("down", "backward", "bwd", "reverse", "rev", "ab", "rückwärts"),
}
"""A meaning and the names in heads that it goes by."""
SMALL = ("deviation", "ccw", "cw", "up", "down")
"""What is mostly written in µm."""
TESTED = ("target", "measured", "deviation", "up", "down")
"""What a positioning test has in the unit of its axis."""
_READING = re.compile(r"(dL|d[xyz]|d[uv]|[A-Z]\w*_dev|[A-Z]\w*_act|[A-Z]\w*_force|[A-Z]\w*_torque)\Z")
_NUMBERED = re.compile(r"\W*\d+\Z")


@dataclass(frozen=True)
class Meaning:
    """The table's column number `column` (from 0) is `name`, in `unit`; `guessed` where nobody said so."""

    name: str
    column: int
    unit: str
    guessed: bool


def in_unit(table: Table, column: int, unit: str, given: str | None = None) -> Array:
    """A column's numbers (N,) in `unit`: in the file they are in the unit `given`, else that of its head, else in `unit`.

    Raises `InputError` where that is no unit of the same quantity.
    """
    units = next(units for units in SCALES.values() if unit in units)
    if given is not None:
        among(given, units, f'unit "{given}" is unknown')
    own = given or table.units[column] or unit
    if own not in units:
        called = " ".join([str(column + 1), table.names[column]]).strip()
        problem = f"column {shown(called)} has the unit {shown(own)} in the head"
        raise InputError(problem, path=table.path, remedy=f"write that of its numbers there: {', '.join(units)}")
    return table.values(column) * (1.0 if own == unit else units[own] / units[unit])


def _quantity(name: str, machine: Machine, axis: str) -> str:
    """What a column's values are; in a positioning test those of `axis`."""
    own = name.partition("_")[0] if name.partition("_")[2] in ("act", "found", "dev") else name
    if name == "time":
        return "time"
    if name == "angle" or (axis if name in TESTED else own) in machine.rotary_axes:
        return "angle"
    return "force" if name.endswith("_force") else "torque" if name.endswith("_torque") else "length"


def _known(name: str, machine: Machine) -> bool:
    axis, _, what = name.partition("_")
    found = what == "found" and axis in machine.linear_axes
    return name in ALIASES or name in machine.axes or found or bool(_READING.match(name))


def guessed_meanings(table: Table, machine: Machine) -> tuple[Meaning, ...]:
    """Meanings that the names in the header give: an axis, a reading by its name in a campaign, or a common word."""
    found = []
    for i, (name, unit) in enumerate(zip(table.names, table.units, strict=True)):
        plain = _NUMBERED.sub("", name).strip().casefold()
        word = next((key for key, words in ALIASES.items() if plain in words or name.casefold() in words), None)
        meaning = name if name in machine.axes or _READING.match(name) else word
        if name.endswith("_found") and _known(name, machine):
            meaning = name
        if meaning is not None:
            found.append(Meaning(meaning, i, unit, guessed=True))
    return tuple(found)


def meanings(table: Table, machine: Machine, entries: Sequence[str], axis: str = "") -> tuple[Meaning, ...]:
    """The meaning of every column: as the user gives it (`NAME=COLUMN[:UNIT]`, by number, range or name), else from the header.

    A given name replaces its guess. `axis` is that of a positioning test. Raises `InputError` for an unknown name,
    column or unit, for a column that is mapped twice, and for a text in one.
    """
    said: list[Meaning] = []
    for entry in entries:
        name, sign, rest = entry.partition("=")
        name, (place, _, unit) = name.strip(), rest.strip().partition(":")
        if not sign or not place:
            raise InputError(f"--map {shown(entry)} is not NAME=COLUMN:UNIT", remedy="write --map deviation=2:um")
        if not _known(name, machine):
            there = ", ".join([*machine.axes, *ALIASES, "X_found", "dL", "dx", "X_dev"])
            raise InputError(f"--map {shown(entry)}: {shown(name)} has no meaning", remedy=f"use one of {there}")
        for i in _column_numbers(table, place):
            if other := next((m.name for m in said if m.column == i), ""):
                problem = f"--map {shown(entry)}: column {i + 1} is mapped to {other} already"
                raise InputError(problem, remedy="map each column once")
            said.append(Meaning(name, i, unit or table.units[i], guessed=False))
    taken_names, taken_columns = {m.name for m in said}, {m.column for m in said}
    guesses = [
        m for m in guessed_meanings(table, machine) if m.name not in taken_names and m.column not in taken_columns
    ]
    found = tuple(sorted([*said, *guesses], key=lambda m: m.column))
    for m in found:
        table.values(m.column)
    _check_units(table, machine, found, axis)
    return found


def _check_units(table: Table, machine: Machine, found: Sequence[Meaning], axis: str) -> None:
    """Raises `InputError` that names all columns without a unit at once, and what to say."""
    problems, remedies = [], []
    for m in found:
        units = SCALES[_quantity(m.name, machine, axis)]
        if m.unit not in units:
            has = "no unit" if not m.unit else f"the unit {shown(m.unit)}"
            problems.append(f"column {m.column + 1} ({m.name}) has {has}")
            small = m.name in SMALL or _READING.match(m.name)
            example = "um" if small and "um" in units else next(iter(units))
            remedies.append(f"--map {m.name}={m.column + 1}:{example} (one of {', '.join(units)})")
    if problems:
        raise InputError(", ".join(problems), path=table.path, remedy=f"say it: {' and '.join(remedies)}")


def _column_numbers(table: Table, place: str) -> list[int]:
    first, dash, last = place.partition("-")
    if dash and first.isdecimal() and last.isdecimal() and int(first) <= int(last):
        return [table.column(str(i)) for i in range(int(first), int(last) + 1)]
    return [table.column(place)]


def shown_meanings(table: Table, found: Sequence[Meaning]) -> str:
    """One line a column: number, name in the head, first number, meaning and unit."""
    by_column = {m.column: m for m in found}
    lines = [f"{table.path.name}: {len(table.numbers)} rows; {table.guessed}"]
    for i, name in enumerate(table.names):
        m = by_column.get(i)
        what = "not used" if m is None else f"{m.name} in {m.unit}{' (guessed)' if m.guessed else ''}"
        first = "text" if i in table.texts else f"{table.numbers[0, i]:.6g}"
        lines.append(f"  {i + 1:>3}  {name[:30]:<30}  {first:>14}  {what}")
    return "\n".join(lines)


def taken(table: Table, found: Sequence[Meaning], machine: Machine, axis: str = "") -> Mapping[str, Array]:
    """Name → (N, n) of its columns, in mm, degree, s, N or Nm; `axis` is that of a positioning test.

    Raises `InputError` where the time does not increase.
    """
    names = dict.fromkeys(m.name for m in found)
    columns = {
        name: np.stack(
            [
                table.numbers[:, m.column] * SCALES[_quantity(name, machine, axis)][m.unit]
                for m in found
                if m.name == name
            ],
            axis=1,
        )
        for name in names
    }
    if "time" in columns:
        remedy = "put the rows in order of time, each instant once; import one recording per file"
        check_time(columns["time"][:, 0], table.path, table.lines, remedy)
    return columns
