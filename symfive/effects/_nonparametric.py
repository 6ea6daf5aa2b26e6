"""A nonparametric term: functions over named coordinates, as shift of the tool, of an axis, or of a force."""

from __future__ import annotations

import math
import re
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from types import SimpleNamespace
from typing import Any, Self

import casadi as ca
import numpy as np

from symfive.arrays import Array
from symfive.effects._base import DRIVE, Campaign, Covariance, Parameter, Quantity, Row, Run, Values
from symfive.effects._contact import Contact
from symfive.effects._coordinates import (
    ACCELERATION,
    FINEST,
    ROW,
    SIGN,
    SINCE,
    VELOCITY,
    coordinate_in,
    coordinate_values,
    owner,
    steps,
    usual_span,
)
from symfive.effects._force import FORCE_SHARE, usual_force
from symfive.effects._quantity import known_part, propagate, propagated
from symfive.errors import InputError
from symfive.instruments.drive_force import DriveForce, driven_axis
from symfive.kinematics import Basis
from symfive.machine import Axis, ErrorTerm, Machine
from symfive.motion import Acceleration, Direction, Position, ReversalDistance, Signal, Velocity

PLACES = ("axis", "structure", "force")
_ORDER = re.compile(r"(?:P|T|cos|sin)(\d+)(?![\d.^])")
_QUANTITIES = f'"{VELOCITY}", "{ACCELERATION}", "{SIGN}" or "{SINCE}"'


@dataclass(frozen=True, kw_only=True)
class NonparametricTerm(Contact):
    """Functions over coordinates, as `Unknown` says, which also says what its fields mean."""

    choices = (("place", PLACES),)
    over: tuple[str, ...]
    basis: str | tuple[str, ...] = "bspline"
    order: int | tuple[int, ...] = 8
    span: tuple[tuple[float, float], ...] = ()
    place: str = "structure"
    directions: str = "xyz"
    carrier: str = ""
    sigma_um: float = 5.0
    period: float = 0.0
    period_sigma: float = 0.0
    less: tuple[tuple[float, ...], ...] = ()
    sigma_force: float = 0.0
    finest: float = FINEST
    knots: tuple[float, ...] = ()
    run: str | None = None

    @property
    def key(self) -> str:
        """`unknown.B`, `unknown.B,C`, `unknown.row.RUN`."""
        return self._key(",".join(self.over), self.run)

    @property
    def stage(self) -> str:  # type: ignore[override]
        """Where it enters."""
        return "reading" if self.place == "force" else self.place

    @property
    def link(self) -> str:
        """The affected link: of a force, the drive."""
        return DRIVE if self.place == "force" else super().link

    @property
    def coordinate(self) -> str:  # type: ignore[override]
        """Its coordinates, separated by commas."""
        return ", ".join(f"{name} in {self.run}" if name == ROW else name for name in self.over)

    @property
    def over_time(self) -> bool:  # type: ignore[override]
        """Whether a coordinate of it is time."""
        return "t" in self.over

    def prepare(self, campaign: Campaign) -> Self:
        machine = campaign.machine
        for name in self.over:
            if name not in ("t", ROW) and owner(name) not in machine.axes:
                raise InputError(
                    f'{self.key}: coordinate "{name}" is unknown',
                    remedy=f'use "t", "{ROW}", an axis ({", ".join(machine.axis_names)}) or one of them with {_QUANTITIES}',
                )
        if self.place in ("axis", "force") and owner(self.over[0]) not in machine.axes:
            raise InputError(f"{self.key}: time moves no axis", remedy='write place = "structure"')
        if self.place == "force" and not any(map(self.applies, campaign.runs)):
            raise InputError(
                f"{self.key}: no run records the drive force of {owner(self.over[0])}",
                remedy='record drive_force, or write place = "structure"',
            )
        if self.carrier and (self.carrier not in machine.axes or self.place != "structure"):
            raise InputError(
                f"{self.key}: no axis {self.carrier} carries it", remedy='name an axis, with place = "structure"'
            )
        if not self.over or not self.directions or not set(self.directions) <= set("abc" if self._turns else "xyz"):
            raise InputError(
                f"{self.key} needs coordinates and directions", remedy='write over = ["B"], directions = "xyz"'
            )
        if self.period and not (self.basis == "fourier" and self.over in {("t",), *((name,) for name in machine.axes)}):
            raise InputError(
                f"{self.key}: only an axis or time has a cycle", remedy='write over = ["t"], basis = "fourier"'
            )
        if (ROW in self.over) != (self.run is not None):
            raise InputError(f"{self.key}: rows count within one run", remedy=f'write over = ["{ROW}"], run = …')
        spans, runs = self.span, [run for run in campaign.runs if self._counts(run)]
        if not spans:
            if not runs:
                raise InputError(
                    f"{self.key}: no run has these coordinates",
                    remedy=f'use "t" where the clock was recorded, "{ROW}" where it was not',
                )
            values = [np.concatenate([coordinate_values(name, run, machine) for run in runs]) for name in self.over]
            spans = tuple(usual_span(name, v) for name, v in zip(self.over, values, strict=True))
        if len(spans) != len(self.over) or any(low >= high for low, high in spans):
            raise InputError(f"{self.key}: the campaign does not move there", remedy="choose a coordinate that changes")
        axis = owner(self.over[0]) if self.place in ("axis", "force") else None
        prepared = replace(super().prepare(campaign), span=spans, axis=axis)
        if self.place != "force" or len(self.less) == len(prepared.functions(machine).names):
            return prepared  # what was prepared for a campaign stays so for some of its runs
        less = replace(prepared, less=())._held_by_the_drive(campaign)
        return replace(
            prepared, less=less, sigma_force=self.sigma_force or usual_force(campaign, str(axis), FORCE_SHARE)
        )

    @property
    def _turns(self) -> bool:
        """Whether it turns what an axis carries, and does not shift it."""
        return bool(self.carrier) and self.directions[:1] in ("a", "b", "c")

    def _held_by_the_drive(self, campaign: Campaign) -> tuple[tuple[float, ...], ...]:
        """Least-squares coefficients of each function on offset, direction and speed, over the campaign's rows."""
        runs = [run for run in campaign.runs if self.applies(run)]
        functions, own = self.table(campaign.machine, runs), self._of_the_drive(runs, campaign.machine)
        return tuple(tuple(map(float, part)) for part in np.linalg.lstsq(own, functions, rcond=None)[0].T)

    def _of_the_drive(self, runs: Sequence[Run], machine: Machine) -> Array:
        """Offset, direction and speed in all rows of some runs (N, 3)."""
        axis = str(self.axis)
        columns = [
            np.concatenate([coordinate_values(f"{axis}{what}", run, machine) for run in runs])
            for what in (SIGN, VELOCITY)
        ]
        return np.column_stack([np.ones(len(columns[0])), *columns])

    def applies(self, run: Run) -> bool:
        if self.place == "force":
            return driven_axis(run) == owner(self.over[0])
        rates = any(name.endswith((VELOCITY, ACCELERATION)) for name in self.over)
        return self._counts(run) and (run.dynamic or not rates)

    def _counts(self, run: Run) -> bool:
        """Whether a run has the time or the rows over which it acts."""
        return super().applies(run) and (self.run is None or (run.id == self.run and not run.has_clock))

    def functions(self, machine: Machine) -> Basis:
        """The functions of its coordinates, without a constant one."""
        kinds = tuple(machine.axes[name].kind if name in machine.axes else "linear" for name in self.over)
        if self.period:
            kinds = ("rotary",)
        travels = tuple(
            (-1.0, 1.0) if n.endswith((SINCE, SIGN)) else s for n, s in zip(self.over, self.span, strict=True)
        )
        order = (self.order,) * len(self.over) if isinstance(self.order, int) else self.order
        return _basis_over(self.over, kinds, travels, self._bases, order, self.knots)

    def parameters(self, campaign: Campaign) -> tuple[Parameter, ...]:
        names = self.functions(campaign.machine).names
        rotary = self._turns or (self.axis is not None and self.its_axis(campaign).rotary)
        unit, sigma = ("urad", 10.0 * self.sigma_um) if rotary else ("um", self.sigma_um)
        if self.place == "force":
            unit, sigma = "Nm" if rotary else "N", self.sigma_force
        channels = self.directions if self.place == "structure" else (self.place,)
        found = [self.own(f"{c}.{name}", unit, sigma * share_of(name)) for c in channels for name in names]
        if self.period_sigma:
            own = self._period_unit(campaign.machine)
            found.append(self.own("period", own, self.period_sigma, mean=self.period, lower=0.5 * self.period))
        return tuple(found)

    def _period_unit(self, machine: Machine) -> str:
        return machine.axes[self.over[0]].unit if self.over[0] in machine.axes else "s"

    def signals(self) -> tuple[Signal, ...]:
        over = (
            self.over if self.place != "force" else (*self.over, *(f"{self.axis}{what}" for what in (SIGN, VELOCITY)))
        )
        found: list[Signal] = [Velocity(owner(name)) for name in over if name.endswith(VELOCITY)]
        found += [Acceleration(owner(name)) for name in over if name.endswith(ACCELERATION)]
        found += [Direction(owner(name), self.started) for name in over if name.endswith((SINCE, SIGN))]
        found += [ReversalDistance(owner(name)) for name in self.over if name.endswith(SINCE)]
        return tuple(found)

    def starts(self, run: Run) -> tuple[Parameter, ...]:
        sides = {owner(name) for name in self.over if name.endswith((SINCE, SIGN))}
        return self.start_of_contact(run, sides.pop(), memory=False) if len(sides) == 1 else ()

    def apply(self, row: Row) -> None:
        basis = self.functions(row.machine)
        functions = ca.vertcat(*basis.values(*(self._held(row, number) for number in range(len(self.over)))))
        if self.less:
            motion = [1.0, *(self._coordinate(row, f"{self.axis}{what}") for what in (SIGN, VELOCITY))]
            functions -= ca.DM(self.less) @ ca.vertcat(*motion)

        def term(channel: str) -> Any:
            amplitudes = ca.vertcat(*(self.parameter(row, f"{channel}.{name}") for name in basis.names))
            return ca.dot(amplitudes, functions)

        if self.place == "axis":
            row.axis[str(self.axis)] += term("axis")
        elif self.place == "structure":
            for c in self.directions:
                if self.carrier:
                    row.add_motion(f"E{c.upper()}{self.carrier}", term(c))
                else:
                    row.shift["xyz".index(c)] += term(c)
        else:
            row.add_reading(DriveForce.name, term("force"))

    def _held(self, row: Row, number: int) -> Any:
        """A coordinate; for polynomials, which would run away, no further than the span."""
        q = self._coordinate(row, self.over[number])
        if self._bases[number] != "polynomial":
            return q
        name, (low, high) = self.over[number], self.span[number]
        unit = row.machine.axes[name].to_internal if name in row.machine.axes else 1.0
        return ca.fmin(ca.fmax(q, low * unit), high * unit)

    @property
    def _bases(self) -> tuple[str, ...]:
        """One per coordinate."""
        return (self.basis,) * len(self.over) if isinstance(self.basis, str) else self.basis

    def _coordinate(self, row: Row, name: str) -> Any:
        if self.period:
            unit, along = 1.0, row.clock
            if name != "t":
                unit, along = row.machine.axes[name].to_internal, row.signal(Position(name))
            return 2.0 * np.pi * along / (self.parameter(row, "period") if self.period_sigma else self.period * unit)
        if name == ROW:
            return row.time
        if name.endswith(SINCE):
            axis = owner(name)
            reach = self.span[self.over.index(name)][1] * row.machine.axes[axis].to_internal
            since = row.signal(ReversalDistance(axis)) / reach
            return row.signal(Direction(axis, self.started)) * steps(since, ca, self.finest)
        if name.endswith(SIGN):
            return row.signal(Direction(owner(name), self.started))
        return coordinate_in(name, row)

    def table(self, machine: Machine, runs: Sequence[Run], period: float = 0.0) -> Array:
        """The functions (N, number of functions) in all N rows of `runs`."""
        points = []
        for number, (name, (low, high)) in enumerate(zip(self.over, self.span, strict=True)):
            there = np.concatenate([coordinate_values(name, run, machine) for run in runs])
            unit = machine.axes[name].to_internal if name in machine.axes else 1.0
            if period:
                unit = 2.0 * np.pi / period
            there = unit * (np.clip(there, low, high) if self._bases[number] == "polynomial" else there)
            points.append(
                np.sign(there) * steps(np.abs(there) / high, np, self.finest) if name.endswith(SINCE) else there
            )
        table = self.functions(machine).matrix(*points)
        return table - self._of_the_drive(runs, machine) @ np.array(self.less).T if self.less else table

    def describe(self, campaign: Campaign, values: Values, covariance: Covariance) -> dict[str, Quantity]:
        """`over`, its `rms` over the campaign's rows as far as the readings determine it, the main `direction` of a shift, and
        the `carrier` in whose frame it is."""
        machine, basis = campaign.machine, self.functions(campaign.machine)
        runs = [run for run in campaign.runs if self.applies(run)]
        period = values[f"{self.key}.period"] if self.period_sigma else self.period
        matrix = self.table(machine, runs, period)
        amplitudes = self.parameters(campaign)[: -1 if self.period_sigma else None]
        names = [p.name for p in amplitudes]

        def shape(p: Array) -> Array:
            return np.asarray(matrix @ p.reshape(-1, len(basis.names)).T)

        def rms(p: Array) -> float:
            return float(np.sqrt(np.mean(np.sum(shape(p) ** 2, axis=1))))

        size = propagated(rms, names, amplitudes[0].unit, *known_part(amplitudes, values, covariance))
        found = {"over": Quantity(self.over, aside=True), "rms": size}
        if self.period:
            at = f"{self.key}.period"
            std = covariance[at, at] ** 0.5 if self.period_sigma else None
            found["period"] = Quantity(period, std, self._period_unit(machine))
        if self.carrier:
            found["carrier"] = Quantity(self.carrier)
        if self.place == "structure":

            def heading(p: Array) -> Array:
                _, _, right = np.linalg.svd(shape(p), full_matrices=False)
                return np.asarray(right[0] * (1.0 if right[0][np.argmax(np.abs(right[0]))] > 0.0 else -1.0))

            both = propagate(heading, names, *known_part(amplitudes, values, covariance))
            full, spread = (dict(zip(self.directions, part.tolist(), strict=True)) for part in both)
            letters = "abc" if self._turns else "xyz"
            found["direction"] = Quantity(
                tuple(full.get(c, 0.0) for c in letters), tuple(min(spread.get(c, 0.0), 1.0) for c in letters), "1"
            )
        return found


@lru_cache(maxsize=256)
def _basis_over(
    over: tuple[str, ...], kinds: tuple[str, ...], travels: tuple[tuple[float, float], ...], basis: tuple[str, ...],
    order: tuple[int, ...], knots: tuple[float, ...],
) -> Basis:  # fmt: skip
    """Functions of coordinates that are no axes of a machine."""
    axes = {
        name: Axis(name=name, kind=kind, direction=(1.0, 0.0, 0.0), travel=travel)
        for name, kind, travel in zip(over, kinds, travels, strict=True)
    }
    given = (knots, *((),) * (len(over) - 1)) if knots else ()
    term = ErrorTerm(name="EXunknown", sigma=1.0, basis=basis, order=order, over=over, knots=given)
    return Basis(term, SimpleNamespace(axes=axes))


def share_of(name: str) -> float:
    """Prior 1σ of a coefficient, as `P3` or `P1(B)*cos2(C)`, over that of the first two of its series.

    Curves with a slope that is bounded in the mean have coefficients that fall like k^(-3/2), in every factor; 1 for what is
    in no series.
    """
    return math.prod(min(1.0, (2.0 / int(order)) ** 1.5) for order in _ORDER.findall(name))
