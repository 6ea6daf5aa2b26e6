"""Function bases of error motions, each without the constant that a location error already holds.

`polynomial` Legendre P1…Pn on the travel; `fourier` cos kq, sin kq; `bspline` cubic (or lower where knots are few)
B-splines minus their value averaged over the travel. Products over several axes keep every mixed term and the pure
terms of each axis, never the constant. A polynomial in several axes without the constant is orthogonal on the box
of travels (Abramowitz & Stegun 22.2.10).
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Mapping
from itertools import pairwise
from typing import Any, Protocol

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from symfive.errors import InputError
from symfive.machine import Axis, ErrorTerm, Machine

__all__ = ["Basis", "basis_of"]

Symbol = Any
Function = tuple[str, Callable[[Symbol], Symbol]]


class HasAxes(Protocol):
    """Whatever knows the travel of the coordinates by name: a machine, or a few axes."""

    @property
    def axes(self) -> Mapping[str, Axis]:
        """Axes by name."""
        ...


class Basis:
    """The functions of one error motion: `names` and, for coordinates, their values (internal units)."""

    def __init__(self, term: ErrorTerm, machine: HasAxes, drop: tuple[str, ...] = ()) -> None:
        per_axis = []
        for i, (axis, basis, order) in enumerate(zip(term.over, term.basis, term.order, strict=True)):
            knots = term.knots[i] if i < len(term.knots) else ()
            make = _BASES[basis]
            constant: Function = ("", lambda q: ca.SX(1))
            per_axis.append([constant, *make(machine.axes[axis], order, knots)])
        self.over = term.over
        self._products = []
        for combination in itertools.product(*per_axis):
            parts = [f"{name}({axis})" if len(per_axis) > 1 else name
                     for (name, _), axis in zip(combination, term.over, strict=True) if name]  # fmt: skip
            name = "*".join(parts)
            if name and name not in drop:
                self._products.append((name, tuple(function for _, function in combination)))

    @property
    def names(self) -> tuple[str, ...]:
        """One name per function, as `P2`, `cos1` or `P1(B)*cos1(C)`."""
        return tuple(name for name, _ in self._products)

    def values(self, *coordinates: Symbol) -> list[Symbol]:
        """The functions at the coordinates (mm, rad), symbolic."""
        values = []
        for _, functions in self._products:
            value = ca.SX(1)
            for function, q in zip(functions, coordinates, strict=True):
                value = value * function(q)
            values.append(value)
        return values

    def matrix(self, *coordinates: NDArray[np.float64]) -> NDArray[np.float64]:
        """The functions at N points: (N, number of functions)."""
        symbols = [ca.SX.sym("q") for _ in coordinates]
        function = ca.Function("basis", symbols, [ca.horzcat(*self.values(*symbols))])
        n = len(coordinates[0])
        out = function.map(n)(*[ca.DM(np.asarray(c, dtype=float)).T for c in coordinates])
        return np.asarray(out, dtype=float).reshape(n, -1) if len(self.names) else np.zeros((n, 0))


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


def _legendre(axis: Any, order: int, knots: tuple[float, ...]) -> list[Function]:
    low, high = (t * axis.to_internal for t in axis.travel)

    def make(n: int) -> Callable[[Symbol], Symbol]:
        def value(q: Symbol) -> Symbol:
            x = (2.0 * q - (low + high)) / (high - low)
            previous, current = ca.SX(1), x
            for k in range(1, n):
                previous, current = current, ((2 * k + 1) * x * current - k * previous) / (k + 1)
            return current

        return value

    return [(f"P{n}", make(n)) for n in range(1, order + 1)]


def _fourier(axis: Any, order: int, knots: tuple[float, ...]) -> list[Function]:
    scale = 1.0
    if not axis.rotary:
        low, high = axis.travel
        scale = 2.0 * math.pi / (high - low)
    functions: list[Function] = []
    for k in range(1, order + 1):
        functions.append((f"cos{k}", lambda q, k=k: ca.cos(k * scale * q)))  # type: ignore[misc]
        functions.append((f"sin{k}", lambda q, k=k: ca.sin(k * scale * q)))  # type: ignore[misc]
    return functions


def _bspline(axis: Any, order: int, knots: tuple[float, ...]) -> list[Function]:
    """B-splines of degree `order` (at most 3) on the given knots (file units) or on order+3 equal ones."""
    degree = min(order, 3)
    low, high = axis.travel
    inner = np.asarray(knots if knots else np.linspace(low, high, max(order, 3) + 1), dtype=float)
    if len(inner) < 2 or np.any(np.diff(inner) <= 0):
        raise InputError(f"axis {axis.name}: B-spline knots must ascend", remedy="write at least two ascending knots")
    full = np.concatenate([[inner[0]] * degree, inner, [inner[-1]] * degree]) * axis.to_internal
    count = len(full) - degree - 1
    means = _spline_means(full, degree, count)
    known: dict[int, tuple[Symbol, list[Symbol]]] = {}

    def all_at(q: Symbol) -> list[Symbol]:
        symbol = ca.SX(q)
        key = symbol.element_hash()
        if key not in known:
            known.clear()  # one coordinate at a time
            known[key] = symbol, _cox_de_boor(full, degree, ca.fmin(ca.fmax(symbol, full[0]), full[-1]))
        return known[key][1]

    def make(i: int) -> Callable[[Symbol], Symbol]:
        return lambda q: all_at(q)[i] - means[i]

    # the functions sum to one, so after the mean is taken off one of them is redundant: the last is left out
    return [(f"S{i + 1}", make(i)) for i in range(count - 1)]


def _spline_means(knots: NDArray[np.float64], degree: int, count: int) -> NDArray[np.float64]:
    """Mean of each B-spline over the knots: its integral is the width of its support over degree + 1 (C. de Boor 1978, X)."""
    widths = knots[degree + 1 : degree + 1 + count] - knots[:count]
    return np.asarray(widths / ((degree + 1) * (knots[-1] - knots[0])))


def _cox_de_boor(knots: NDArray[np.float64], degree: int, q: Symbol) -> list[Symbol]:
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


_BASES: dict[str, Callable[[Any, int, tuple[float, ...]], list[Function]]] = {
    "polynomial": _legendre,
    "fourier": _fourier,
    "bspline": _bspline,
}
