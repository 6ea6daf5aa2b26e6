"""A table of poses as a tool path: one column for every axis, as in the runs of a campaign."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from symfive.errors import InputError, inside
from symfive.files import read_text, shown
from symfive.machine import Machine
from symfive.separated import Marks, cells_of, sign_of
from symfive.toolpath._path import ToolPath

TIME = "t_s"


def read_poses(path: Path, machine: Machine, tool_length: float) -> ToolPath:
    """The poses of a table. Raises `InputError` with line and column."""
    lines = read_text(path).splitlines()
    if not lines or not lines[0].strip():
        raise InputError("the file is empty", path=path, line=1, remedy="write a header row and at least one pose")
    sign = sign_of(lines[0])
    header, marks = cells_of(lines[0], sign), Marks(sign)
    _check_header(path, header, machine)
    rows, numbers = [], []
    with inside(path=path):
        for number, text in enumerate(lines[1:], start=2):
            if not text.strip():
                continue
            cells = cells_of(text, sign)
            if len(cells) != len(header):
                problem = f"the row has {len(cells)} cells, the header {len(header)}"
                raise InputError(problem, line=number, remedy="the file may be truncated")
            rows.append([marks.number(cell, number, name) for cell, name in zip(cells, header, strict=True)])
            numbers.append(number)
    if not rows:
        raise InputError("the table has a header and no poses", path=path, line=1, remedy="write at least one pose")
    table = np.array(rows)
    position = {axis.name: table[:, header.index(axis.column)] for axis in machine.axes.values()}
    line = np.array(numbers, dtype=np.int64)
    return ToolPath(path, line, position, np.zeros(len(line), dtype=bool), tool_length)


def _check_header(path: Path, header: list[str], machine: Machine) -> None:
    """Every axis once, time if wanted, nothing else."""
    expected = [axis.column for axis in machine.axes.values()]
    remedy = f"the table needs {', '.join(expected)}"
    for i, name in enumerate(header, start=1):
        if name not in (*expected, TIME):
            stem = name.rpartition("_")[0]
            known = next((e for e in expected if e.rpartition("_")[0] == stem), None)
            why = f"it must be {known}" if known else f"the machine has no axis {stem}" if stem else "no axis has it"
            raise InputError(f"column {shown(name)} is unknown: {why}", path=path, line=1, column=i, remedy=remedy)
        if header.index(name) != i - 1:
            raise InputError(f"column {shown(name)} stands twice", path=path, line=1, column=i, remedy="remove one")
    if missing := next((name for name in expected if name not in header), None):
        raise InputError(f'column "{missing}" is missing', path=path, line=1, remedy=remedy)
