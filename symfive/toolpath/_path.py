"""Places along a tool path, as plain data."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from symfive.arrays import Array, Flags, Indices
from symfive.errors import InputError
from symfive.files import shown
from symfive.screen import OnScreen
from symfive.separated import LARGEST
from symfive.validation import finite, positive

PROGRAM_LINEAR = ("X", "Y", "Z")
STEP_MM, STEP_DEG = 2.0, 2.0
"""Between two places: a second harmonic of a turn, sampled every 2°, has its maximum within (2°)²/2 = 0.06 % of a place's."""


@dataclass(frozen=True, repr=False)
class ToolPath(OnScreen):
    """Places (N) where the tool cuts.

    `path` the file; `line` (N,) where it says so, from 1; `position` axis → (N,), mm and degree: positions of the axes, but
    where `tip` (N,) holds X, Y and Z are the tool's tip in the workpiece frame and the linear axes follow; `tool_length` mm
    from the spindle nose to the tip; `step` of the places, in units of 2 mm and 2° (above 1 where the path is long); `datum` the
    place, mm in the workpiece frame, that is touched with the rotary axes at 0 before cutting, so that the error there drops out
    everywhere (None: none is); `notes` in plain words. Raises `InputError` for arrays of different lengths, no place, and numbers
    that are not finite.
    """

    path: Path
    line: Indices
    position: Mapping[str, Array]
    tip: Flags
    tool_length: float
    step: float = 1.0
    datum: tuple[float, float, float] | None = None
    notes: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        positive("tool path", tool_length=self.tool_length)
        finite("tool path", step=self.step)
        if not len(self.line):
            raise InputError("the tool path has no place", path=self.path, remedy="give a path that cuts")
        for name, column in self.position.items():
            if np.shape(column) != np.shape(self.line):
                raise InputError(f"axis {name} has {np.size(column)} places, the path {len(self.line)}", path=self.path)
            if not np.all(np.abs(column) <= LARGEST):
                row = int(np.flatnonzero(~(np.abs(column) <= LARGEST))[0])
                problem = f"axis {name} stands at {shown(float(column[row]))}, which is no finite number"
                raise InputError(problem, path=self.path, line=int(self.line[row]), remedy="write a number")

    def __len__(self) -> int:
        return len(self.line)

    def __str__(self) -> str:
        lines = f"lines {int(self.line.min())} to {int(self.line.max())}"
        return f"tool path {self.path}: {len(self)} places, {lines}, tool of {self.tool_length:g} mm"

    def at(self, row: int) -> str:
        """Where a place is, in words: its line and what stands there."""
        names = sorted(self.position, key=lambda name: (name not in PROGRAM_LINEAR, name))
        words = " ".join(f"{name}{round(float(self.position[name][row]), 1) + 0.0:g}" for name in names)
        return f"line {int(self.line[row])}: {words}"
