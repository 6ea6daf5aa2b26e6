"""A run's CSV: fast where it is right, exact about line, column and remedy where it is wrong; a long file block by block."""

from __future__ import annotations

import itertools
import os
import stat
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from symfive.arrays import Array
from symfive.disk import Spool, release
from symfive.errors import InputError
from symfive.files import decoded, read_text, shown
from symfive.machine import Axis, Machine
from symfive.outputs import Reading, write_parts
from symfive.runs import Run
from symfive.separated import LARGEST, SIGNS, Marks, cells_of, sign_of

BLOCK_BYTES = 1 << 22
MOST_BYTES = 100_000_000_000
SPINDLE = "spindle_deg"
"""The column that says how far the spindle is turned; a file may leave it out."""

MOST_GAPS = 20
_UNITS = ("_mm", "_deg", "_um", "_urad", "_s", "_N", "_Nm", "_rad", "_m", "_ms")
WRITTEN_ROWS = 1 << 14


def lines_of(path: Path, block: int | None = None) -> Iterator[tuple[int, list[str]]]:
    """Blocks of lines, each with the number of its first line (from 1), without blank lines at the end of the file.

    Files of more than `block` bytes are never held whole. Raises `InputError` as `read_text` does.
    """
    block = block or BLOCK_BYTES
    try:
        status = os.stat(path)
        long = stat.S_ISREG(status.st_mode) and block < status.st_size <= MOST_BYTES
    except (OSError, ValueError):
        long = False  # and `read_text` says why
    number, blank = 1, 0
    for text in _texts(path, block) if long else [read_text(path, at_most=MOST_BYTES)]:
        lines = text.split("\n")
        if text.endswith("\n"):
            lines.pop()
        lines = [""] * blank + lines
        count = len(lines)
        while lines and not lines[-1].strip():
            lines.pop()
        blank = count - len(lines)
        if lines:
            yield number, lines
            number += len(lines)


def _texts(path: Path, block: int) -> Iterator[str]:
    """The file's text in blocks that end with a line."""
    before, rest = 0, b""
    try:
        reading = Reading(path)
        with path.open("rb") as stream:
            while True:
                fresh = stream.read(block)
                reading.update(fresh)
                data = rest + fresh
                if not data:
                    reading.end()
                    return
                end = len(data) if not fresh else 1 + max(data.rfind(b"\n"), data.rfind(b"\r", 0, len(data) - 1))
                text = decoded(path, data[:end] or data, before)
                if not end:
                    problem = f"the line has more than {len(data)} bytes"
                    raise InputError(problem, path=path, line=before + 1, remedy="check that it is the right file")
                rest = data[end:]
                before += text.count("\n")
                yield text
    except OSError as error:
        problem = f"the file cannot be read ({error.strerror or error})"
        raise InputError(problem, path=path, remedy="check its name and rights") from None


def read_columns(
    path: Path, machine: Machine, readings: tuple[str, ...], *, dynamic: bool = False
) -> tuple[Array, dict[str, Array], dict[str, Array], Array | None]:
    """Time, commands, readings and spindle angles (None where no column has them) of a CSV.

    `readings` are the columns that the run's instruments write.

    Semicolons or tabs may separate the columns instead of commas; a comma in a cell is then a decimal comma.
    Either all reading columns are there or none (a plan). Columns of files above `BLOCK_BYTES` lie on disk.

    Raises `InputError` with line and column.
    """
    blocks = lines_of(path)
    _, lines = next(blocks, (1, []))
    if not lines:
        raise InputError("the file is empty", path=path, line=1, remedy="write a header row and at least one row")
    sign = sign_of(lines[0])
    header, marks = cells_of(lines[0], sign), Marks(sign)
    commands = {axis.column: axis.name for axis in machine.axes.values()}
    measured = _check_header(path, header, tuple(commands), readings)
    clock = _Clock(path, header.index("t_s"))

    def tables() -> Iterator[Array]:
        for first, rows in itertools.chain([(2, lines[1:])], blocks):
            if rows:
                table = _numbers(path, rows, header, first, sign, marks)
                clock.check(table, first)
                for name, axis in commands.items():
                    _check_travel(path, table, header.index(name), machine.axes[axis], first)
                yield table

    columns = _turned(tables())
    if columns is None:
        raise InputError("the run has a header and no rows", path=path, line=1, remedy="record at least one row")
    if dynamic:
        clock.check_pauses()
    column = dict(zip(header, columns, strict=True))
    moved = {a: column[name] for name, a in commands.items()}
    return column["t_s"], moved, {name: column[name] for name in measured}, column.get(SPINDLE)


def _turned(tables: Iterator[Array]) -> Array | None:
    """Tables of rows (n, columns) as one table of columns (columns, N), on disk if there are many; None without any."""
    first, second = next(tables, None), next(tables, None)
    if first is None or second is None:
        return None if first is None else first.T
    with Spool(first.shape[1]) as spool:
        for table in itertools.chain([first, second], tables):
            spool.append(table)
        return spool.finish()


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
        if name not in (*expected, SPINDLE):
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
    stem = name.rsplit("_", 1)[0]
    twin = next((e for e in expected if e.rsplit("_", 1)[0] == stem), None)
    if twin is not None:
        return InputError(
            f"column {shown(name)} has the wrong unit", path=path, line=1, column=i + 1,
            remedy=f"convert its values and name it {twin}",
        )  # fmt: skip
    same = next((e for e in expected if e.lower() == name.lower()), None)
    if same is not None:
        return InputError(
            f"column {shown(name)} is unknown", path=path, line=1, column=i + 1, remedy=f"write it {same}"
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


def _numbers(path: Path, lines: list[str], header: list[str], first: int, sign: str, marks: Marks) -> Array:
    """A block of rows (N, columns); `first` is the number of its first line."""
    width, plain = len(header), marks.plain(lines, first)
    if plain is not None:
        try:
            table = np.loadtxt(plain, delimiter=sign, comments=None, ndmin=2, dtype=float)
            if table.shape == (len(lines), width) and (np.abs(table) <= LARGEST).all():
                return np.asarray(table)
        except ValueError:
            pass
    rows = []
    for number, line in enumerate(lines, start=first):
        cells = cells_of(line, sign)
        if not any(cells):
            raise InputError("the row is empty", path=path, line=number, remedy="remove it")
        if len(cells) != width:
            problem = f"the row has {len(cells)} cells, the header {width}"
            raise InputError(problem, path=path, line=number, remedy=_remedy(line, len(cells), width, sign))
        row = []
        for i, cell in enumerate(cells):
            try:
                row.append(marks.number(cell, number, header[i]))
            except InputError as error:
                raise error.at(path, column=i + 1) from None
        rows.append(row)
    return np.array(rows)


def _remedy(line: str, cells: int, width: int, sign: str) -> str:
    """What may be wrong with a row of another number of cells."""
    other = sign_of(line)
    if other != sign and len(cells_of(line, other)) == width:
        return f"separate its cells by {SIGNS[sign]} as the header's are"
    if sign == "," and cells > width:
        return "with decimal commas separate the columns by semicolons, the header's too"
    return "the file may be truncated"


def _check_travel(path: Path, table: Array, i: int, axis: Axis, first: int) -> None:
    low, high = axis.travel
    slack = 1e-9 * max(1.0, abs(low), abs(high))
    outside = np.flatnonzero((table[:, i] < low - slack) | (table[:, i] > high + slack))
    if outside.size:
        row = int(outside[0])
        limits = f"outside its travel {low:g}…{high:g}"
        problem = f"axis {axis.name} is commanded to {table[row, i]:g} {axis.unit}, {limits}"
        remedy = f"correct the command or the travel of {axis.name} in the machine file"
        raise InputError(problem, path=path, line=first + row, column=i + 1, remedy=remedy)


class _Clock:
    """The time of a recording, block by block: it increases and, where the axes move, does not pause."""

    def __init__(self, path: Path, column: int) -> None:
        self._path, self._column = path, column
        self._rows = 0
        self._begin = self._last = self._usual = self._longest = 0.0
        self._longest_line = 0

    def check(self, table: Array, first: int) -> None:
        """A block whose first line has the number `first`."""
        time = table[:, self._column]
        known = np.concatenate([[self._last], time]) if self._rows else time
        steps, line = np.diff(known), first + len(time) - len(known) + 1
        backwards = np.flatnonzero(steps <= 0.0)
        if backwards.size:
            row = int(backwards[0])
            problem = f"time does not increase: {known[row + 1]:g} s after {known[row]:g} s"
            self._refuse(problem, line + row, "put the rows in time order")
        if steps.size:
            row = int(np.argmax(steps))
            if steps[row] > self._longest:
                self._longest, self._longest_line = float(steps[row]), line + row
            self._usual = self._usual or float(np.sort(steps)[steps.size // 2])
        if not self._rows:
            self._begin = float(time[0])
        self._last = float(time[-1])
        self._rows += len(time)

    def check_pauses(self) -> None:
        """At the end: the recording has a rate."""
        if self._last - self._begin > MOST_GAPS * self._usual * self._rows + 1000.0 * self._usual:
            problem = f"the recording pauses {self._longest:g} s, its rate is one row in {self._usual:g} s"
            self._refuse(problem, self._longest_line, 'split the run there, or write sampling = "static"')

    def _refuse(self, problem: str, line: int, remedy: str) -> None:
        raise InputError(problem, path=self._path, line=line, column=self._column + 1, remedy=remedy)


def write_columns(path: Path, run: Run, machine: Machine, *, to_edit: bool = False) -> None:
    """Write a run's CSV, whole or not at all; numbers in the shortest form that reads back exactly."""
    turned = {} if run.spindle is None else {SPINDLE: run.spindle}
    names = ["t_s", *(machine.axes[a].column for a in machine.axis_names), *turned, *run.readings]
    columns = [run.time, *(run.commands[a] for a in machine.axis_names), *turned.values(), *run.readings.values()]

    def parts() -> Iterator[bytes]:
        yield (",".join(names) + "\n").encode()
        for first in range(0, run.rows, WRITTEN_ROWS):
            rows = zip(*(column[first : first + WRITTEN_ROWS].tolist() for column in columns), strict=True)
            yield "".join(",".join(map(repr, row)) + "\n" for row in rows).encode()
            release(*columns)

    write_parts(path, parts(), to_edit=to_edit)
