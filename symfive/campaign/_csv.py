"""A run's CSV: fast where it is right, exact about line, column and remedy where it is wrong."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np

from symfive.campaign._data import Array, Run
from symfive.errors import InputError
from symfive.files import read_text, shown, write_text
from symfive.machine import Machine

__all__ = ["read_columns", "write_columns"]

MOST_GAPS = 20
_UNITS = ("_mm", "_deg", "_um", "_urad", "_s", "_N", "_Nm", "_rad", "_m", "_ms")


def read_columns(
    path: Path, machine: Machine, readings: tuple[str, ...], *, dynamic: bool = False
) -> tuple[Array, dict[str, Array], dict[str, Array]]:
    """Time, commands and readings of a CSV. `readings` are the columns that the run's instruments write.

    Either all reading columns are there or none (a plan). Raises `InputError` with line and column.
    """
    text = read_text(path)
    lines = text.split("\n")
    while lines and not lines[-1].strip():
        lines.pop()
    if not lines:
        raise InputError("the file is empty", path=path, line=1, remedy="write a header row and at least one row")
    header = [name.strip() for name in lines[0].split(",")]
    commands = {axis.column: axis.name for axis in machine.axes.values()}
    measured = _check_header(path, header, tuple(commands), readings)
    if len(lines) == 1:
        raise InputError("the run has a header and no rows", path=path, line=1, remedy="record at least one row")
    table = _numbers(path, lines, header)
    column = {name: table[:, i] for i, name in enumerate(header)}
    time = column["t_s"]
    _check_time(path, time, header.index("t_s") + 1, dynamic)
    for name, axis_name in commands.items():
        axis = machine.axes[axis_name]
        low, high = axis.travel
        slack = 1e-9 * max(1.0, abs(low), abs(high))
        outside = np.flatnonzero((column[name] < low - slack) | (column[name] > high + slack))
        if outside.size:
            row = int(outside[0])
            limits = f"outside its travel {low:g}…{high:g}"
            problem = f"axis {axis.name} is commanded to {column[name][row]:g} {axis.unit}, {limits}"
            remedy = f"correct the command or the travel of {axis.name} in the machine file"
            raise InputError(problem, path=path, line=row + 2, column=header.index(name) + 1, remedy=remedy)
    return time, {axis: column[name] for name, axis in commands.items()}, {name: column[name] for name in measured}


def _check_header(
    path: Path, header: list[str], commands: tuple[str, ...], readings: tuple[str, ...]
) -> tuple[str, ...]:
    expected = ("t_s", *commands, *readings)
    for i, name in enumerate(header):
        if name == "":
            raise InputError(
                f"column {i + 1} has no name", path=path, line=1, column=i + 1, remedy="name it or remove it"
            )
        if header.index(name) != i:
            raise InputError(f"column {shown(name)} stands twice", path=path, line=1, column=i + 1, remedy="remove one")
        if name not in expected:
            raise _unknown_column(path, header, i, expected)
    for name in ("t_s", *commands):
        if name not in header:
            raise InputError(
                f'column "{name}" is missing', path=path, line=1, remedy=f"the file needs {', '.join(expected)}"
            )
    present = tuple(name for name in readings if name in header)
    if present and len(present) != len(readings):
        missing = next(name for name in readings if name not in present)
        raise InputError(
            f'reading column "{missing}" is missing',
            path=path,
            line=1,
            remedy=f"write {', '.join(readings)} or none of them",
        )
    return present


def _unknown_column(path: Path, header: list[str], i: int, expected: tuple[str, ...]) -> InputError:
    name = header[i]
    other = next((sign for sign in (";", "\t") if sign in name), None)
    if other is not None:
        sign = {";": "semicolons", "\t": "tabs"}[other]
        raise InputError(f"the columns are separated by {sign}", path=path, line=1, remedy="separate them by commas")
    stem = name.rsplit("_", 1)[0]
    twin = next((e for e in expected if e.rsplit("_", 1)[0] == stem), None)
    if twin is not None:
        return InputError(
            f"column {shown(name)} has the wrong unit", path=path, line=1, column=i + 1, remedy=f"it must be {twin}"
        )
    if name.replace(".", "").replace("-", "").replace("e", "").isdigit():
        return InputError(
            f"the first row begins with numbers ({shown(name)})", path=path, line=1, column=i + 1,
            remedy=f"write a header row: {','.join(expected)}",
        )  # fmt: skip
    axis = next((stem for unit in _UNITS if name.endswith(unit) and len(stem) <= 2), None)
    problem = f"column {shown(name)} is unknown" + (
        f": the machine has no axis {axis}" if axis and axis.isalnum() else ""
    )
    return InputError(problem, path=path, line=1, column=i + 1, remedy=f"the file may hold {', '.join(expected)}")


def _numbers(path: Path, lines: list[str], header: list[str]) -> Array:
    width = len(header)
    try:
        table = np.loadtxt(lines[1:], delimiter=",", comments=None, ndmin=2, dtype=float)
        if table.shape == (len(lines) - 1, width) and np.isfinite(table).all():
            return np.asarray(table)
    except ValueError:
        pass
    rows = []
    for number, line in enumerate(lines[1:], start=2):
        cells = line.split(",")
        if not line.strip():
            raise InputError("the row is empty", path=path, line=number, remedy="remove it")
        if len(cells) != width:
            raise InputError(
                f"the row has {len(cells)} cells, the header {width}",
                path=path,
                line=number,
                remedy="the file may be truncated",
            )
        rows.append([_number(path, cell, number, i, header[i]) for i, cell in enumerate(cells)])
    return np.array(rows)


def _number(path: Path, cell: str, line: int, i: int, name: str) -> float:
    text = cell.strip()
    try:
        if not text.isascii() or "_" in text:
            raise ValueError
        value = float(text)
    except ValueError:
        raise InputError(
            f"{shown(text)} in column {name} is not a number",
            path=path,
            line=line,
            column=i + 1,
            remedy="write a number",
        ) from None
    if not math.isfinite(value):
        raise InputError(
            f"{shown(text)} in column {name} is not a finite number", path=path, line=line, column=i + 1,
            remedy="remove the row or write the reading",
        )  # fmt: skip
    return value


def _check_time(path: Path, time: Array, column: int, dynamic: bool) -> None:
    steps = np.diff(time)
    backwards = np.flatnonzero(steps <= 0.0)
    if backwards.size:
        row = int(backwards[0]) + 1
        problem = f"time does not increase: {time[row]:g} s after {time[row - 1]:g} s"
        raise InputError(problem, path=path, line=row + 2, column=column, remedy="put the rows in time order")
    if dynamic and steps.size:
        row = int(np.argmax(steps)) + 1
        usual = float(np.median(steps))
        if (time[-1] - time[0]) > MOST_GAPS * usual * time.size + 1000.0 * usual:
            problem = f"the recording pauses {steps[row - 1]:g} s, its rate is one row in {usual:g} s"
            remedy = 'split the run there, or write sampling = "static"'
            raise InputError(problem, path=path, line=row + 2, column=column, remedy=remedy)


def write_columns(path: Path, run: Run, machine: Machine) -> None:
    """Write a run's CSV, whole or not at all; numbers in the shortest form that reads back exactly."""
    names = ["t_s", *(machine.axes[a].column for a in machine.axis_names), *run.readings]
    columns = [run.time, *(run.commands[a] for a in machine.axis_names), *run.readings.values()]
    rows = zip(*(column.tolist() for column in columns), strict=True)
    write_text(path, "\n".join([",".join(names), *(",".join(map(repr, row)) for row in rows)]) + "\n")
