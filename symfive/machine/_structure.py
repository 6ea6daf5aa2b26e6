"""The structural code of ISO 10791-6: `w C' B' X' Y' b Z t`, read from workpiece to bed to tool."""

from __future__ import annotations

import re
from dataclasses import dataclass

from symfive.errors import InputError
from symfive.files import shown

DEFAULT_DIRECTION = {
    "X": (1.0, 0.0, 0.0), "Y": (0.0, 1.0, 0.0), "Z": (0.0, 0.0, 1.0),
    "U": (1.0, 0.0, 0.0), "V": (0.0, 1.0, 0.0), "W": (0.0, 0.0, 1.0),
    "A": (1.0, 0.0, 0.0), "B": (0.0, 1.0, 0.0), "C": (0.0, 0.0, 1.0),
}  # fmt: skip
_NAME = re.compile(r"[A-Za-z][A-Za-z0-9]*\Z")
MOST_AXES = 24
"""A five-axis machine that carries a robot of seven axes twice; the equations grow with the axes."""
_RESERVED = ("w", "b", "t")


def default_kind(axis: str) -> str | None:
    """`linear` for X Y Z U V W, `rotary` for A B C, otherwise None."""
    return "linear" if axis in tuple("XYZUVW") else "rotary" if axis in tuple("ABC") else None


@dataclass(frozen=True)
class Structure:
    """The order of the axes: `workpiece` from the workpiece to the bed, `tool` from the bed to the tool."""

    workpiece: tuple[str, ...]
    tool: tuple[str, ...]

    @classmethod
    def parse(cls, code: str) -> Structure:
        """Read a code such as `w C' B' X' Y' b Z t`. Raises `InputError` naming the first wrong token."""
        tokens = code.replace("’", "'").replace("′", "'").split()
        said = shown(code)
        form = "write it as in \"w C' B' X' Y' b Z t\", a prime on every axis that carries the workpiece"
        if len(tokens) < 4 or tokens[0] != "w" or tokens[-1] != "t" or tokens.count("b") != 1:
            raise InputError(f"the structural code {said} does not read from w over b to t", remedy=form)
        bed = tokens.index("b")
        for token in tokens[1:bed]:
            if not token.endswith("'"):
                raise InputError(f"axis {token} on the workpiece side of {said} has no prime", remedy=form)
        for token in tokens[bed + 1 : -1]:
            if token.endswith("'"):
                raise InputError(f"axis {token} on the tool side of {said} has a prime", remedy=form)
        if len(tokens) - 3 > MOST_AXES:
            problem = f"the structure has {len(tokens) - 3} axes, more than {MOST_AXES}"
            raise InputError(problem, remedy="write a chain of no more than that")
        names = [token.removesuffix("'") for token in tokens[1:-1] if token != "b"]
        for name in names:
            if not _NAME.match(name) or name in _RESERVED:
                problem = f"{shown(name)} in {said} is not an axis name"
                raise InputError(problem, remedy="use letters and digits, as X or J1")
            if names.count(name) > 1:
                raise InputError(f"axis {name} stands twice in {said}", remedy="name every axis once")
        return cls(tuple(names[: bed - 1]), tuple(names[bed - 1 :]))

    @property
    def code(self) -> str:
        """The structural code."""
        return " ".join(["w", *(f"{name}'" for name in self.workpiece), "b", *self.tool, "t"])

    @property
    def axes(self) -> tuple[str, ...]:
        """Every axis, from the bed outward: first the workpiece side, then the tool side."""
        return (*reversed(self.workpiece), *self.tool)

    def carries(self, axis: str) -> str:
        """`workpiece` or `tool`: what the axis moves."""
        return "workpiece" if axis in self.workpiece else "tool"
