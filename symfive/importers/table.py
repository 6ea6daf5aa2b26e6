"""A table of numbers as any instrument's software or spreadsheet writes it.

Encoding, separator, decimal mark and the length of the head are guessed: they can be seen to be right. What the columns mean
and their units are not; names and units are taken from the head where it has them. Instants (08:00:30.5, 2026-03-02T08:00:30) are
read as seconds.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from datetime import datetime
from pathlib import Path

import numpy as np

from symfive.arrays import Array
from symfive.errors import InputError, inside
from symfive.files import one_line, read_bytes, shown
from symfive.screen import plural
from symfive.separated import SIGNS, Marks, are_numbers, cells_of, signs_of

MAX_BYTES = 200_000_000
_UNIT = re.compile(
    r"^(.*?)\s*(?:[\[(]\s*([^\])]*?)\s*[\])]|/\s*(\S+)|[_ ](um|nm|mm|m|in|mil|uin|deg|rad|s|ms|N|Nm|urad|arcsec))?$"
)
_INSTANT = re.compile(r"(\d{4}-\d\d-\d\d[T ])?\d\d:\d\d:\d\d([.,]\d{1,6})?(Z|[+-]\d\d:\d\d)?")
_BEGIN = datetime(2000, 1, 1)
_BLANKS = re.compile(r",?\s+(?![\[(])")
_SPELT = {
    "µm": "um", "μm": "um", "âµm": "um", "micron": "um", "microns": "um", "°": "deg", "degree": "deg",
    "degrees": "deg", "inch": "in", "inches": "in", '"': "in", "mils": "mil", "thou": "mil", "µin": "uin", "μin": "uin",
    "sec": "s", "µrad": "urad", "μrad": "urad", "gon": "gon", "arcseconds": "arcsec", "″": "arcsec", "''": "arcsec",
}  # fmt: skip
"""Units as they are found in heads."""


@dataclass(frozen=True)
class Table:
    """`numbers` (N, k) below a head, each row on its line of `lines` (N,); `names` and `units` (k,) as the head has them, ""
    where it has none; `guessed` what was taken for granted, in words. `texts` column → the error of its first cell that is no
    number (NaN in `numbers`)."""

    path: Path
    names: tuple[str, ...]
    units: tuple[str, ...]
    numbers: Array
    lines: tuple[int, ...]
    guessed: str
    texts: Mapping[int, InputError] = field(default_factory=dict)

    def column(self, name: str) -> int:
        """The place of a column by its number from 1 or by its name. Raises `InputError` listing those that there are."""
        if name.isdecimal() and 1 <= int(name) <= len(self.names):
            return int(name) - 1
        found = [i for i, own in enumerate(self.names) if own and own.casefold() == name.casefold()]
        if len(found) != 1:
            problem = f"{'no' if not found else 'more than one'} column is called {shown(name)}"
            there = ", ".join(f"{i + 1} {own}".strip() for i, own in enumerate(self.names[:12]))
            raise InputError(problem, path=self.path, remedy=f"use a number or a name of {there}")
        return found[0]

    def values(self, column: int) -> Array:
        """The numbers (N,) of a column. Raises `InputError` for a text in it."""
        if column in self.texts:
            raise self.texts[column]
        return self.numbers[:, column]


def read_table(path: Path | str) -> Table:
    """The numbers of a file and its head. Raises `InputError` naming file and line for a row of another length; a text counts
    where its column is used."""
    path = Path(path)
    text, encoding = _decoded(path)
    lines = text.replace("\r\n", "\n").replace("\r", "\n").split("\n")
    sign, first = _begin(path, lines)
    count = len(_cells(lines[first], sign))
    marks, rows, numbers, texts = Marks(sign), list[list[float]](), list[int](), dict[int, InputError]()
    with inside(path=path):
        for number, line in enumerate(lines[first:], start=first + 1):
            if not line.strip():
                continue
            cells = _cells(line, sign)
            if len(cells) == count - 1 and line.rstrip(" ").endswith(sign):
                cells = [*cells, ""]
            if len(cells) != count:
                problem = f"the row has {len(cells)} cells, the first one has {count}"
                raise InputError(problem, line=number, remedy="remove what is no row of the table")
            rows.append([])
            numbers.append(number)
            for column, cell in enumerate(cells):
                try:
                    rows[-1].append(_number(cell, marks, number))
                except InputError as error:
                    texts.setdefault(column, error.at(path))
                    rows[-1].append(np.nan)
    names, units = _head(lines[:first], sign, count)
    instants = [bool(_INSTANT.fullmatch(cell)) for cell in _cells(lines[first], sign)]
    units = tuple("s" if instant else unit for instant, unit in zip(instants, units, strict=True))
    decimal = "comma" if sign != "," and any("," in line for line in lines[first : first + 50]) else "point"
    head = f"{plural(first, 'line')} of head" if first else "no head"
    guessed = f"{encoding}, {SIGNS[sign]}, decimal {decimal}, {head}"
    return Table(path, names, units, np.array(rows), tuple(numbers), guessed, texts)


def check_time(time: Array, path: Path, lines: Sequence[int], remedy: str) -> None:
    """Raise `InputError` where the time (N,), s, of rows on these lines of a file does not increase."""
    if len(back := np.flatnonzero(np.diff(time) <= 0.0)):
        row = int(back[0])
        problem = f"the time does not increase: {time[row + 1]:.10g} s after {time[row]:.10g} s"
        raise InputError(problem, path=path, line=lines[row + 1], remedy=remedy)


def _decoded(path: Path) -> tuple[str, str]:
    data = read_bytes(path, at_most=MAX_BYTES)
    if data.startswith((b"\xff\xfe", b"\xfe\xff")):
        return data.decode("utf-16", errors="replace"), "UTF-16"
    if b"\0" in data:
        raise InputError("a NUL byte stands in the text", path=path, remedy="give a text file")
    try:
        return data.decode("utf-8-sig"), "UTF-8"
    except UnicodeDecodeError:
        return data.decode("cp1252", errors="replace"), "Windows-1252"


def _cells(line: str, sign: str) -> list[str]:
    """The cells; one separator at the end of a row parts nothing."""
    cells = cells_of(line, sign)
    return cells[:-1] if len(cells) > 1 and not cells[-1] else cells


def _number(cell: str, marks: Marks, line: int) -> float:
    """The number of a cell; of an instant the seconds since midnight, with a date since 2000."""
    if not (match := _INSTANT.fullmatch(cell)):
        return marks.number(cell, line)
    try:
        instant = datetime.fromisoformat(cell if match[1] else f"{_BEGIN:%Y-%m-%d}T{cell}")
    except ValueError:
        raise InputError(f"{shown(cell)} is no instant", line=line, remedy="write hours:minutes:seconds") from None
    return (instant.replace(tzinfo=None) - _BEGIN).total_seconds()


def _are_numbers(cells: list[str], sign: str) -> bool:
    """Whether the cells are numbers or instants."""
    return are_numbers([cell for cell in cells if not _INSTANT.fullmatch(cell)], sign)


def _begin(path: Path, lines: list[str]) -> tuple[str, int]:
    """Separator and first line of the table: the first two rows in a row that hold as many numbers, two or more, and no text; in
    a file without such rows the first that hold two or more in the same columns.

    Rows of as many cells just above that begin with a number, or of one more, belong to it, though they hold a text: no head
    begins so.
    """
    for text in (False, True):
        for first, line in enumerate(lines):
            after = next((later for later in lines[first + 1 :] if later.strip()), line)
            for sign in signs_of(line):
                cells, below = ([_are_numbers([cell], sign) for cell in _cells(row, sign)] for row in (line, after))
                if cells == below and sum(cells) > 1 and (text or all(cells)):
                    while (
                        first
                        and len(above := _cells(lines[first - 1], sign)) - len(cells) in (0, 1)
                        and _are_numbers(above[:1], sign)
                    ):
                        first -= 1
                    return sign, first
    _refuse_unreadable(path, lines)
    raise InputError("the file holds no table of numbers", path=path, remedy="export text with at least two columns")


def _refuse_unreadable(path: Path, lines: list[str]) -> None:
    """Raises `InputError` for the cell that is no number in rows of which half are: 1.234,5 has a mark between thousands."""
    for number, line in enumerate(lines[:-1], start=1):
        for sign in signs_of(line):
            cells, below = _cells(line, sign), _cells(lines[number], sign)
            most = (2 * sum(_are_numbers([cell], sign) for cell in row) >= len(row) for row in (cells, below))
            if len(cells) == len(below) > 1 and all(most):
                with inside(path=path):
                    for cell in cells:
                        _number(cell, Marks(sign), number)


def _head(lines: list[str], sign: str, count: int) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """Names and units from the last line of the head that has as many cells; a line of units may follow the names."""
    blanks = sign == " "  # those before a unit in brackets part nothing
    parted = (_BLANKS.split(line.strip()) if blanks else _cells(line, sign) for line in lines)
    rows = [cells for cells in parted if len(cells) == count and any(cell.strip("-: ") for cell in cells)]
    if not rows:
        return ("",) * count, ("",) * count
    below = [_spelt(cell.strip("[]() ")) for cell in rows[-1]]
    if len(rows) > 1 and all(unit in _KNOWN or not unit for unit in below):
        return tuple(one_line(cell.strip('"')) for cell in rows[-2]), tuple(below)
    split = [_UNIT.match(one_line(cell.strip('"'))) for cell in rows[-1]]
    names = tuple(match[1] if match else "" for match in split)
    return names, tuple(_spelt(next((u for u in match.groups()[1:] if u), "")) if match else "" for match in split)


_KNOWN = {
    "um", "nm", "mm", "m", "in", "mil", "uin", "deg", "rad", "gon", "s", "ms", "min", "N", "Nm", "urad", "arcsec", "kN",
}  # fmt: skip


def _spelt(unit: str) -> str:
    return _SPELT.get(unit.strip().casefold(), unit.strip())
