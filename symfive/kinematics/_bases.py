"""Function bases of error motions, each without the constant that a location error already holds.

`polynomial` Legendre P1…Pn on the travel; `fourier` cos kq, sin kq; `bspline` cubic (or lower where knots are few)
B-splines minus their value averaged over the travel. Products over several axes keep every mixed term and the pure
terms of each axis, never the constant. A polynomial in several axes without the constant is orthogonal on the box
of travels (Abramowitz & Stegun 22.2.10).
"""

from __future__ import annotations

import itertools
import math
import operator
import re
from collections.abc import Callable, Mapping
from functools import cached_property, lru_cache, reduce
from itertools import pairwise
from typing import Any, Protocol

import casadi as ca
import numpy as np

from symfive.arrays import Array
from symfive.compiled import Mapped
from symfive.errors import InputError
from symfive.machine import Axis, ErrorTerm, Machine

Symbol = Any
Functions = list[tuple[str, Symbol]]
"""Names, and values at one coordinate."""


class HasAxes(Protocol):
    """Whatever knows the travel of the coordinates by name: a machine, or a few axes."""

    @property
    def axes(self) -> Mapping[str, Axis]:
        """Axes by name."""
        ...


class Basis:
    """The functions of one error motion: `names` and, for coordinates, their values (internal units)."""

    def __init__(self, term: ErrorTerm, machine: HasAxes, drop: tuple[str, ...] = ()) -> None:
        self.over = term.over
        self._families = []
        for i, (name, basis, order) in enumerate(zip(term.over, term.basis, term.order, strict=True)):
            axis, knots = machine.axes[name], term.knots[i] if i < len(term.knots) else ()
            try:
                self._families.append(_family(basis, axis.rotary, tuple(axis.travel), order, tuple(knots)))
            except ValueError as error:
                raise InputError(f"axis {name}: {error}", remedy="write at least two ascending knots") from None
        self._products = []
        for combination in itertools.product(*(range(len(names) + 1) for names, _ in self._families)):
            found = [
                (names[k - 1], axis)
                for k, (names, _), axis in zip(combination, self._families, self.over, strict=True)
                if k
            ]
            name = "*".join(f"{name}({axis})" if len(self.over) > 1 else name for name, axis in found)
            if name and name not in drop:
                self._products.append((name, combination))

    @property
    def names(self) -> tuple[str, ...]:
        """One name per function, as `P2`, `cos1` or `P1(B)*cos1(C)`."""
        return tuple(name for name, _ in self._products)

    def values(self, *coordinates: Symbol) -> list[Symbol]:
        """The functions at the coordinates (mm, rad), symbolic."""
        each = [ca.vertsplit(f(q)) for (_, f), q in zip(self._families, coordinates, strict=True)]
        return [
            reduce(operator.mul, (one[k - 1] for one, k in zip(each, chosen, strict=True) if k))
            for _, chosen in self._products
        ]

    def matrix(self, *coordinates: Array) -> Array:
        """The functions at N points: (N, number of functions)."""
        if not self.names:
            return np.zeros((len(coordinates[0]), 0))
        (values,) = self._function(*(np.asarray(c, dtype=float)[:, None] for c in coordinates))
        return values

    @cached_property
    def _function(self) -> Mapped:
        symbols = [ca.SX.sym("q") for _ in self.over]
        return Mapped(ca.Function("basis", symbols, [ca.densify(ca.horzcat(*self.values(*symbols)))]))


_FUNCTION = re.compile(r"(P|S|cos|sin)(\d+)(?:\((.+)\))?")
_FUNCTIONS = {"P": "order", "S": "spline", "cos": "cosine", "sin": "sine"}


def function_words(name: str, spoken: Callable[[str], str] = str) -> str:
    """The name of a function in words, as `cosine 1`, of order 1, or `order 1 in B × sine 2 in C`, with a polynomial of order 1;
    `spoken` says the coordinates. Another name as it is."""
    parts = [_FUNCTION.fullmatch(part) for part in name.split("*")]
    said = [f"{_FUNCTIONS[p[1]]} {p[2]}{f' in {spoken(p[3])}' if p[3] else ''}" for p in parts if p]
    return " × ".join(said) if len(said) == len(parts) else name


def basis_of(term: ErrorTerm, machine: Machine) -> Basis:
    """The basis of an error motion in this machine's baseline.

    A straightness of a linear axis (`EYX`) has no slope of its own where the squareness `EC0X` is varied too: ISO
    230-1 takes straightness from the least-squares line, so P1 belongs to the location error and is left out.
    """
    axis = machine.axes[term.axis]
    drop: tuple[str, ...] = ()
    if not axis.rotary and not term.angular and term.over == (axis.name,):
        along = np.abs(np.asarray(axis.direction))
        component = "XYZ".index(term.component)
        tilts = [t.component for t in machine.location_errors if t.axis == axis.name]
        moved = {"X": (2, 1), "Y": (0, 2), "Z": (1, 0)}[term.component]  # EC0j moves y along x, EB0j moves z, …
        names = {"X": ("B", "C"), "Y": ("C", "A"), "Z": ("A", "B")}[term.component]
        swept = any(along[m] > 0.5 and name in tilts for m, name in zip(moved, names, strict=True))
        if along[component] < 0.5 and swept and term.basis == ("polynomial",):
            drop = ("P1",)
    return Basis(term, machine, drop)


@lru_cache(maxsize=256)
def _family(
    basis: str, rotary: bool, travel: tuple[float, float], order: int, knots: tuple[float, ...]
) -> tuple[tuple[str, ...], Any]:
    """Names of the functions along one coordinate, and the CasADi function of their values, made once for all models."""
    q = ca.SX.sym("q")
    functions = _BASES[basis](q, math.pi / 180.0 if rotary else 1.0, travel, order, knots)
    values = ca.vertcat(*(value for _, value in functions)) if functions else ca.SX(0, 1)
    return tuple(name for name, _ in functions), ca.Function("basis", [q], [values])


def _legendre(q: Symbol, unit: float, travel: tuple[float, float], order: int, knots: tuple[float, ...]) -> Functions:
    low, high = (t * unit for t in travel)
    x = (2.0 * q - (low + high)) / (high - low)
    values = [ca.SX(1), x]
    for k in range(1, order):
        values.append(((2 * k + 1) * x * values[k] - k * values[k - 1]) / (k + 1))
    return [(f"P{n}", values[n]) for n in range(1, order + 1)]


def _fourier(q: Symbol, unit: float, travel: tuple[float, float], order: int, knots: tuple[float, ...]) -> Functions:
    scale = 1.0 if unit != 1.0 else 2.0 * math.pi / (travel[1] - travel[0])
    functions: Functions = []
    for k in range(1, order + 1):
        functions += [(f"cos{k}", ca.cos(k * scale * q)), (f"sin{k}", ca.sin(k * scale * q))]
    return functions


def _bspline(q: Symbol, unit: float, travel: tuple[float, float], order: int, knots: tuple[float, ...]) -> Functions:
    """B-splines of degree `order` (at most 3) on the given knots (file units) or on order+3 equal ones."""
    degree = min(order, 3)
    inner = np.asarray(knots if knots else np.linspace(*travel, max(order, 3) + 1), dtype=float)
    if len(inner) < 2 or np.any(np.diff(inner) <= 0):
        raise ValueError("B-spline knots must ascend")
    full = np.concatenate([[inner[0]] * degree, inner, [inner[-1]] * degree]) * unit
    count = len(full) - degree - 1
    # the integral of a B-spline is the width of its support over degree + 1 (C. de Boor 1978, X)
    means = (full[degree + 1 :] - full[:count]) / ((degree + 1) * (full[-1] - full[0]))
    values = _cox_de_boor(full, degree, ca.fmin(ca.fmax(q, full[0]), full[-1]))
    # the functions sum to one, so without the mean one of them is redundant: the last is left out
    return [(f"S{i + 1}", values[i] - means[i]) for i in range(count - 1)]


def _cox_de_boor(knots: Array, degree: int, q: Symbol) -> list[Symbol]:
    """All B-splines of a degree at q, from those of the degree below (C. de Boor 1972)."""
    if degree == 0:
        values = []
        for low, high in pairwise(knots):
            upper = q <= high if high == knots[-1] else q < high
            values.append(ca.if_else(ca.logic_and(q >= low, upper), 1.0, 0.0) if low < high else ca.SX(0))
        return values
    below = _cox_de_boor(knots, degree - 1, q)
    found = []
    for i in range(len(knots) - degree - 1):
        value = ca.SX(0)
        left, right = knots[i + degree] - knots[i], knots[i + degree + 1] - knots[i + 1]
        if left > 0:
            value += (q - knots[i]) / left * below[i]
        if right > 0:
            value += (knots[i + degree + 1] - q) / right * below[i + 1]
        found.append(value)
    return found


_BASES: dict[str, Callable[[Symbol, float, tuple[float, float], int, tuple[float, ...]], Functions]] = {
    "polynomial": _legendre,
    "fourier": _fourier,
    "bspline": _bspline,
}
