"""Tables as text: what separates the columns, and a decimal comma or point, the same throughout a file."""

from __future__ import annotations

import math
import re
from collections.abc import Sequence
from typing import Any

from symfive.errors import InputError
from symfive.files import shown

LARGEST = 1e12
"""No number in a file or an option is larger, in its unit: beside 1e12 µm a double resolves no nanometre any more."""
SMALLEST = 1e-12
"""What has to be positive is at least this, in its unit."""
SIGNS = {";": "semicolons", "\t": "tabs", "|": "bars", ",": "commas", " ": "spaces"}
_SPLIT = {sign: re.compile(re.escape(sign)) for sign in SIGNS} | {" ": re.compile(r",?\s+")}
_ENDS = {" ": None, "|": " |"}
"""What a row of cells may begin and end with besides."""


def sign_of(head: str) -> str:
    """What separates the names of a head: semicolons, else tabs, else commas."""
    return next((sign for sign in ";\t" if sign in head), ",")


def signs_of(row: str) -> tuple[str, ...]:
    """What may separate a row of numbers, the likeliest first: a comma may as well be the decimal mark."""
    return tuple(sign for sign in ";\t|" if sign in row) or (" ", ",")


def cells_of(row: str, sign: str) -> list[str]:
    """The cells of a row without the space around them."""
    return [cell.strip() for cell in _SPLIT[sign].split(row.strip(_ENDS[sign]) if sign in _ENDS else row)]


def plain_cell(value: Any) -> Any:
    """A cell that no spreadsheet calculates (OWASP, CSV injection); numbers stay numbers."""
    formula = isinstance(value, str) and value.lstrip().startswith(("=", "+", "-", "@"))
    return f"'{value}" if formula else value


class Marks:
    """Numbers of one file. Where commas do not separate its columns they are decimal commas, and then all are."""

    def __init__(self, sign: str) -> None:
        self._comma = sign != ","
        self._mark = ""
        self._first = 0

    def plain(self, lines: list[str], first: int) -> list[str] | None:
        """A block of rows, its first line the number `first`, with decimal points; None where each cell has to be looked at."""
        if not self._comma:
            return lines
        found = {mark: next((n for n, line in enumerate(lines, first) if mark in line), 0) for mark in ",."}
        marks = [mark for mark, line in found.items() if line]
        if len(marks) > 1 or (marks and self._mark not in ("", marks[0])):
            return None
        if marks and not self._mark:
            self._mark, self._first = marks[0], found[marks[0]]
        return [line.replace(",", ".") for line in lines] if "," in marks else lines

    def number(self, text: str, line: int, name: str = "") -> float:
        """The number of a cell, of the column `name`. Raises `InputError` for text, infinity, and another decimal mark."""
        said = f"{shown(text)} in column {name}" if name else shown(text)
        try:
            if not text.isascii() or "_" in text:
                raise ValueError
            value = float(self._pointed(text, line))
        except ValueError as error:
            if isinstance(error, InputError):
                raise
            if not text.strip():
                problem = f"the cell of column {name} is empty" if name else "a cell is empty"
                remedy = "write the reading, or delete the row of a pose that was not read"
                raise InputError(problem, line=line, remedy=remedy) from None
            raise InputError(f"{said} is not a number", line=line, remedy="write a number") from None
        if not abs(value) <= LARGEST:
            remedy = "remove the row or write the reading"
            problem = f"{said} is not a finite number" if not math.isfinite(value) else f"{said} is beyond {LARGEST:g}"
            raise InputError(problem, line=line, remedy=remedy)
        return value

    def _pointed(self, text: str, line: int) -> str:
        if not self._comma:
            return text
        marks = [mark for mark in ",." if mark in text]
        if len(marks) > 1:
            remedy = "write one decimal mark and none between the thousands"
            raise InputError(f"{shown(text)} has a comma and a point", line=line, remedy=remedy)
        if marks and self._mark not in ("", marks[0]):
            words = {",": "comma", ".": "point"}
            problem = f"{shown(text)} has a decimal {words[marks[0]]}, line {self._first} a decimal {words[self._mark]}"
            raise InputError(problem, line=line, remedy="write the same decimal mark everywhere")
        if marks and not self._mark:
            self._mark, self._first = marks[0], line
        return text.replace(",", ".")


def are_numbers(cells: Sequence[str], sign: str) -> bool:
    """Whether each cell of a row that `sign` separates is a number."""
    marks = Marks(sign)
    try:
        for cell in cells:
            marks.number(cell, 0)
    except InputError:
        return False
    return True
