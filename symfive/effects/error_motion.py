"""Error motion that the baseline lacks or has in too low an order (ISO 230-1, 3.4; ISO 230-7)."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any, Self

import casadi as ca
import numpy as np

from symfive.effects._axes import component_of, goes_round, moving, own_component
from symfive.effects._base import Campaign, Covariance, Effect, Form, Forms, Parameter, Quantity, Row, Values
from symfive.effects._quantity import amplitude_and_phase
from symfive.errors import InputError
from symfive.kinematics import Basis, basis_of
from symfive.machine import ErrorTerm, Machine, unknown_axis

FINER = (6, 12)
"""Orders of finer forms of the same name."""
DISTINCT = 1e-12
"""Of the Gram matrix of polynomials over a part of the travel: below this reciprocal condition number its double precision no
longer separates them."""
ABOUT, GUIDES = "ABC", "guideway or bearing"
"""Rotary axes by their ISO 841 letters; what guides an axis."""
SMALLEST_SHARE = 0.05
"""Less of a travel than this says nothing about a polynomial over all of it."""


@dataclass(frozen=True, kw_only=True)
class ErrorMotion(Effect):
    """`component` (`EAC`) += Σ coefficient_k·function_k(q), µm or µrad, over the coordinates `over` (default
    its axis).

    `basis` and `order` as in the machine file, one per axis in `over` (a single one holds for all); `knots`
    for `bspline`. `sigma` is the prior 1σ of a coefficient; by default it allows for motions of typical size over the
    part of the travel that is in use. Functions that the baseline already has are left out, so a higher order adds the higher
    ones only. A polynomial is taken less its value at the axis' zero (and its slope there, where a squareness or the baseline
    has that): however large an error motion is, the location errors stay what they are at zero. Typical straightness
    1–10 µm, angular error motions 5–20 µrad, radial and axial error motions of a rotary axis 0.5–5 µm.
    """

    id = "error_motion"
    says = "an error motion missing from the machine file"
    hidden_by = (
        "others with the same readings on one circle (straightness, pitch); a second position or height separates them"
    )
    action = "enter it in the error table of the axis; if it exceeds the tolerance, check guideway or bearing"
    coordinate = "{axis}"
    component: str
    basis: str | tuple[str, ...] = "fourier"
    order: int | tuple[int, ...] = 2
    over: tuple[str, ...] = ()
    knots: tuple[tuple[float, ...], ...] = ()
    sigma: float | None = None

    def advice(self, sizes: Mapping[str, Quantity]) -> tuple[str, str]:
        """What to check: the measuring system of the axis for its positioning error (`EXX`, `ECC`), else what guides it."""
        letter, axis = self.component[1], self.component[2:]
        part = "the bearing" if axis in ABOUT else GUIDES
        if letter == axis:
            part = (
                "the mounting of its encoder (an eccentric scale: one wave a revolution)"
                if axis in ABOUT
                else "scale or screw"
            )
        return self.says, self.action.replace(GUIDES, part)

    def prepare(self, campaign: Campaign) -> Self:
        machine = campaign.machine
        component_of(self.component, machine)
        for axis in self._term.over:
            if axis not in machine.axes:
                raise unknown_axis(f"error motion {self.component}", axis, machine.axes)
        held = machine.errors.get(self.component)
        term = self._term
        if (
            held is not None
            and set(held.over) == set(term.over)
            and {*held.basis, *term.basis} >= {"bspline", "polynomial"}
        ):
            raise InputError(
                f"the baseline holds {self.component} as {', '.join(held.basis)}",
                remedy="use its basis with a higher order",
            )
        if not self._functions(machine)[1]:
            raise InputError(f"the baseline already holds {self.component} to this order", remedy="raise the order")
        return super().prepare(campaign)

    @property
    def _term(self) -> ErrorTerm:
        over = self.over or (self.component[2:],)
        basis = (self.basis,) * len(over) if isinstance(self.basis, str) else self.basis
        order = (self.order,) * len(over) if isinstance(self.order, int) else self.order
        return ErrorTerm(name=self.component, sigma=1.0, basis=basis, order=order, over=over, knots=self.knots)

    def _functions(self, machine: Machine) -> tuple[Basis, tuple[str, ...]]:
        """The basis and the names of those of its functions that the baseline lacks."""
        basis, held = basis_of(self._term, machine), machine.errors.get(self.component)
        same = held is not None and held.over == self._term.over and "bspline" not in held.basis
        known = basis_of(held, machine).names if held is not None and same else ()
        if held is not None and held.over == self._term.over and held.basis == self._term.basis == ("bspline",):
            known = basis.names if (held.order, held.knots) == (self._term.order, self._term.knots) else ()
        return basis, tuple(name for name in basis.names if name not in known)

    @classmethod
    def candidates(cls, campaign: Campaign) -> Forms:
        for axis in moving(campaign):
            round_ = goes_round(campaign, axis)
            basis, order = ("fourier", 3) if round_ else ("polynomial", 3)
            share = 1.0 if round_ else _share_in_use(campaign, axis)
            for letter in "XYZABC":
                symbol = f"E{letter}{axis}"
                finer = tuple(cls(component=symbol, basis=basis, order=n) for n in FINER if share ** (2 * n) > DISTINCT)
                motion = cls(component=symbol, basis=basis, order=order)
                yield Form(effect=motion, shapes=finer, partner=_partner(campaign.machine, letter, axis))

    def parameters(self, campaign: Campaign) -> tuple[Parameter, ...]:
        component = component_of(self.component, campaign.machine)
        usual = 10.0 if component.angular else 5.0
        return tuple(
            self.own(name, component.unit, self.sigma or usual * self._reach(name, campaign))
            for name in self._functions(campaign.machine)[1]
        )

    def describe(self, campaign: Campaign, values: Values, covariance: Covariance) -> dict[str, Quantity]:
        """Its coefficients; of a harmonic also `amplitude1` and `phase1`, of A·sin(q + φ)."""
        found = super().describe(campaign, values, covariance)
        for order in [name[3:] for name in found if re.fullmatch(r"sin\d+", name)]:
            pair = f"sin{order}", f"cos{order}"
            unit = str(found[pair[0]].unit)
            sine, cosine = (f"{self.key}.{name}" for name in pair)
            size, phase = amplitude_and_phase(sine, cosine, unit, values, covariance)
            found |= {name: replace(found[name], aside=True) for name in pair}
            found |= {f"amplitude{order}": size, f"phase{order}": phase}
        return found

    def _reach(self, function: str, campaign: Campaign) -> float:
        """By how much a Legendre polynomial over the whole travel must be larger to have its size over the part in use."""
        factor = 1.0
        for part in function.split("*"):
            order, axis = re.match(r"P(\d+)(?:\((\w+)\))?$", part), self._term.over[0]
            if order:
                factor *= max(_share_in_use(campaign, order[2] or axis), SMALLEST_SHARE) ** -int(order[1])
        return factor

    def apply(self, row: Row) -> None:
        basis, names = self._functions(row.machine)
        values = basis.values(*(row.axis[name] for name in basis.over))
        for name, value in zip(basis.names, self._from_zero(row, basis, values, names), strict=True):
            if name in names:
                row.add_motion(self.component, self.parameter(row, name) * value)

    def _from_zero(self, row: Row, basis: Basis, values: list[Any], names: tuple[str, ...]) -> list[Any]:
        """Polynomials less their tangent at the axis' zero, to which location errors refer; its slope stays where `P1` has it."""
        if self._term.basis != ("polynomial",):
            return values
        axis, q = row.machine.axes[basis.over[0]], ca.SX.sym("q")
        low, high = axis.travel
        zero = min(max(0.0, low), high) * (np.pi / 180.0 if axis.rotary else 1.0)
        functions = ca.vertcat(*basis.values(q))
        tangent = ca.Function("tangent", [q], [functions, ca.jacobian(functions, q)])
        constant, slope = (np.asarray(part, dtype=float).ravel() for part in tangent(zero))
        if "P1" in names:
            slope = np.zeros(len(slope))
        along = row.axis[axis.name] - zero
        return [value - c - k * along for value, c, k in zip(values, constant, slope, strict=True)]


def _partner(machine: Machine, letter: str, axis: str) -> str:
    """The key of the other component of a rotary axis' radial or tilt error motion (ISO 230-7), a vector across the axis."""
    kind, place = ("XYZ" if letter in "XYZ" else "ABC"), "ABC".find(own_component(machine, axis))
    others = [other for k, other in enumerate(kind) if k != place and other != letter]
    return f"{ErrorMotion.id}.E{others[0]}{axis}" if place >= 0 and len(others) == 1 else ""


def _share_in_use(campaign: Campaign, axis: str) -> float:
    """The share (0…1) of an axis' travel over which a campaign moves it."""
    low, high = campaign.machine.axes[axis].travel
    used = np.concatenate([run.commands[axis] for run in campaign.runs])
    return min(float(np.ptp(used)) / (high - low), 1.0)
