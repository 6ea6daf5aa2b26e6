"""A tool path from a file: by its ending a table of poses, one column for every axis as in the runs of a campaign, else an NC
program.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from symfive.errors import InputError, inside
from symfive.files import read_text, shown
from symfive.machine import Machine
from symfive.separated import Marks, cells_of, sign_of
from symfive.toolpath._path import ToolPath
from symfive.toolpath._program import read_program
from symfive.validation import finite, positive

TABLES = (".csv", ".tsv")
USUAL_TOOL_MM = (100.0, 200.0)
TIME = "t_s"


def read_tool_path(
    path: Path | str, machine: Machine, *, tool_length: float | None = None,
    zero: Sequence[float] = (0.0, 0.0, 0.0), tool_centre: bool = False, datum: bool = False,
) -> ToolPath:  # fmt: skip
    """The tool path of a part.

    A `.csv` or `.tsv` holds poses: one column for every axis of the machine, named as in a campaign (`X_mm`, `C_deg`), `t_s` if
    wanted. All else is an NC program in ISO or LinuxCNC words, of which G1, G2 and G3 cut. Its words are positions of the axes;
    where `G43.4` (or `tool_centre`, for a control that is in that mode anyway) is on they are the tool's tip in the workpiece.
    `tool_length` mm from the spindle nose to the tip (default: the middle of the machine file's range); `zero` the program's
    zero in the workpiece frame, mm; `datum`: that zero (of a table, the frame's origin) is touched on the part with the rotary
    axes at 0, so that the machine's error there drops out.

    Raises `InputError` naming file and line for a word that cannot be understood, an axis that the machine lacks, a
    number that is none, and a path that does not cut.
    """
    path = Path(path)
    low, high = machine.workspace.tool_length or USUAL_TOOL_MM
    length = 0.5 * (low + high) if tool_length is None else tool_length
    positive("part", tool_length=length)
    offset = dict(zip("XYZ", zero, strict=True))
    finite("part", **offset)
    if path.suffix.lower() not in TABLES:
        found = read_program(path, machine, length, offset, tool_centre=tool_centre)
        return replace(found, datum=(zero[0], zero[1], zero[2])) if datum else found
    if tool_centre or any(offset.values()):
        problem = "a table of poses holds positions of the axes: no zero and no tool-centre control apply to it"
        raise InputError(problem, path=path, remedy="leave them out, or give the NC program")
    found = read_poses(path, machine, length)
    return replace(found, datum=(0.0, 0.0, 0.0)) if datum else found


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
