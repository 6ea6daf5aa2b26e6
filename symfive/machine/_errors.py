"""The errors that a machine's baseline model may vary, by their names in ISO 230-1."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass, field
from itertools import pairwise
from typing import Any

from symfive.errors import InputError
from symfive.files import shown
from symfive.validation import finite, freeze, numbers, one_of, positive

_TERM = re.compile(r"E([XYZABC])(0?)([A-Za-z][A-Za-z0-9]*)\Z")
BASES = ("polynomial", "fourier", "bspline")
MAX_ORDER = 60


def axis_of_error(name: str) -> str | None:
    """The axis of an error's name; None where ISO 230-1 forms no name so."""
    match = _TERM.match(name)
    return None if match is None else match.group(3)


@dataclass(frozen=True, kw_only=True)
class ErrorTerm:
    """An error that the baseline model may vary: a location error (`EX0C`) or an error motion (`EXC`).

    `sigma` prior standard deviation (µm or µrad, of each coefficient of an error motion), `mean` prior mean,
    `over` the axes of whose coordinates it is a function, `basis` and `order` one entry per axis in `over`,
    `knots` the interior and end knots of a `bspline` basis (mm or degree), one tuple per axis in `over`.
    """

    name: str
    sigma: float
    mean: float = 0.0
    basis: tuple[str, ...] = ()
    order: tuple[int, ...] = ()
    over: tuple[str, ...] = ()
    knots: tuple[tuple[float, ...], ...] = ()
    extra: Mapping[str, Any] = field(default_factory=dict, repr=False)

    def __post_init__(self) -> None:
        object.__setattr__(self, "extra", freeze(self.extra))
        if axis_of_error(self.name) is None:
            problem = f"{shown(self.name)} is not an error of ISO 230-1"
            raise InputError(problem, remedy="write EX0C for a location error, EXC for an error motion")
        positive(self.name, sigma=self.sigma)
        finite(self.name, mean=self.mean)
        for name in ("over", "basis", "order", "knots"):
            if not isinstance(getattr(self, name), tuple):
                problem = f"{self.name}: {name} = {shown(getattr(self, name))} is not a list"
                raise InputError(problem, remedy=f"write {name} = [ … ], one entry per axis in over", keys=(name,))
        if not self.is_location:
            self._check_basis()
        elif self.basis or self.order or self.over or self.knots:
            problem = f"location error {self.name} takes no basis"
            raise InputError(problem, remedy=f"write {self.name} = {{ sigma = … }}")

    def _check_basis(self) -> None:
        if not self.over:
            object.__setattr__(self, "over", (self.axis,))
        if not self.basis:
            problem = f"error motion {self.name} has no basis"
            raise InputError(problem, remedy='add basis = "polynomial" and order = 3', keys=("basis",))
        if not len(self.basis) == len(self.order) == len(self.over):
            problem = f"error motion {self.name}: basis, order and over differ in length"
            raise InputError(problem, remedy="give one entry per axis in over", keys=("basis",))
        for axis in self.over:
            if not isinstance(axis, str) or self.over.count(axis) > 1:
                problem = f"error motion {self.name}: over = {shown(list(self.over))} is not a list of different axes"
                raise InputError(problem, remedy='write over = ["B", "C"]', keys=("over",))
        for basis in self.basis:
            one_of(f"error motion {self.name}", "basis", basis, BASES)
        for order in self.order:
            if isinstance(order, bool) or not isinstance(order, int) or not 1 <= order <= MAX_ORDER:
                problem = f"error motion {self.name}: order {shown(order)} is not a whole number from 1 to {MAX_ORDER}"
                raise InputError(problem, remedy="write order = 3", keys=("order",))
        for knots in self.knots:
            numbers(f"error motion {self.name}", "knots", knots, example="ascending numbers for each axis in over")
            if any(later <= earlier for earlier, later in pairwise(knots)) or len(knots) == 1:
                problem = f"error motion {self.name}: the knots {shown(list(knots))} do not ascend"
                raise InputError(problem, remedy="write at least two ascending numbers", keys=("knots",))

    @property
    def is_location(self) -> bool:
        """Whether it is a location error (position-independent)."""
        match = _TERM.match(self.name)
        return match is not None and match.group(2) == "0"

    @property
    def component(self) -> str:
        """`X Y Z` (a displacement) or `A B C` (a rotation)."""
        return self.name[1]

    @property
    def axis(self) -> str:
        """The axis it belongs to."""
        return self.name[3:] if self.is_location else self.name[2:]

    @property
    def angular(self) -> bool:
        """Whether it is a rotation (µrad) and not a displacement (µm)."""
        return self.component in "ABC"

    @property
    def unit(self) -> str:
        """`um`, or `urad` of a rotation."""
        return "urad" if self.angular else "um"
