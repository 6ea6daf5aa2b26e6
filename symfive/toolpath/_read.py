"""A tool path from a file: a table of poses by its ending, else an NC program."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from symfive.errors import InputError
from symfive.machine import Machine
from symfive.toolpath._path import ToolPath
from symfive.toolpath._program import read_program
from symfive.toolpath._table import read_poses
from symfive.validation import finite, positive

TABLES = (".csv", ".tsv")
USUAL_TOOL_MM = (100.0, 200.0)


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
