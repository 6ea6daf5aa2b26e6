"""Unknown: a term without physics over named coordinates, where no effect of the vocabulary explains the readings."""

from __future__ import annotations

from dataclasses import dataclass, replace
from types import SimpleNamespace
from typing import TYPE_CHECKING, Any, Self

import numpy as np
from numpy.typing import NDArray

from symfive.effects._base import Effect
from symfive.effects._quantity import Covariance, Quantity, Values, propagate
from symfive.errors import InputError
from symfive.instruments import instruments_of
from symfive.kinematics import Basis
from symfive.machine import Axis, ErrorTerm, Machine
from symfive.motion import Position, Velocity
from symfive.parameters import Parameter

if TYPE_CHECKING:
    from symfive.campaign import Campaign, Run
    from symfive.model._row import Row
    from symfive.motion import Signal

Array = NDArray[np.float64]
PLACES = ("structure", "reading")
VELOCITY = " velocity"


@dataclass(frozen=True, kw_only=True)
class Unknown(Effect):
    """Σ coefficient·function over the coordinates `over`: a shift of the tool, or of each reading column.

    A coordinate is an axis (`B`), its velocity (`B velocity`) or `t` (the campaign's clock). Functions as in
    the machine file: `basis` and `order` one per coordinate (a single one holds for all), products for
    several; `bspline` of order n has n intervals. They have no constant part, which zeros and set-ups hold.
    `span` (lowest, highest per coordinate; mm, degree, s) is where they live, by default what the campaign
    covers. `place` `structure` acts along `directions` of the machine frame, `reading` on each column. Prior
    1σ of a coefficient: `sigma_um`.
    """

    id = "unknown"
    says = "none of the known effects explains it"
    hidden_by = "nothing names it; error motions over the same coordinates take its place"
    over: tuple[str, ...]
    basis: str | tuple[str, ...] = "bspline"
    order: int | tuple[int, ...] = 8
    span: tuple[tuple[float, float], ...] = ()
    place: str = "structure"
    directions: str = "xyz"
    sigma_um: float = 5.0

    @property
    def key(self) -> str:
        """`unknown.B`, `unknown.B,C`."""
        return self._key(",".join(self.over))

    @property
    def stage(self) -> str:  # type: ignore[override]
        """Where it enters."""
        return self.place

    def prepare(self, campaign: Campaign) -> Self:
        self.choose("place", PLACES)
        machine = campaign.machine
        for name in self.over:
            if name != "t" and name.removesuffix(VELOCITY) not in machine.axes:
                raise InputError(
                    f'{self.key}: coordinate "{name}" is unknown',
                    remedy=f'use "t", an axis ({", ".join(machine.axis_names)}) or its "velocity", as "X velocity"',
                )
        if not self.over or not self.directions or any(c not in "xyz" for c in self.directions):
            raise InputError(
                f"{self.key} needs coordinates and directions",
                remedy='write over = ["B"], directions = "xyz"',
            )
        spans = self.span
        if not spans:
            values = [np.concatenate([_values(name, run, machine) for run in campaign.runs]) for name in self.over]
            spans = tuple((float(v.min()), float(v.max())) for v in values)
        if len(spans) != len(self.over) or any(low >= high for low, high in spans):
            raise InputError(f"{self.key}: the campaign does not move there", remedy="choose a coordinate that changes")
        return replace(super().prepare(campaign), span=spans)

    def applies(self, run: Run) -> bool:
        return run.dynamic or not any(name.endswith(VELOCITY) for name in self.over)

    def _basis(self, machine: Machine) -> Basis:
        axes = {}
        for name, span in zip(self.over, self.span, strict=True):
            owner = machine.axes.get(name.removesuffix(VELOCITY))
            kind = owner.kind if owner is not None and name in machine.axes else "linear"
            axes[name] = Axis(name=name, kind=kind, direction=(1.0, 0.0, 0.0), travel=span)
        count = len(self.over)
        basis = (self.basis,) * count if isinstance(self.basis, str) else self.basis
        order = (self.order,) * count if isinstance(self.order, int) else self.order
        term = ErrorTerm(name="EXunknown", sigma=1.0, basis=basis, order=order, over=self.over)
        return Basis(term, SimpleNamespace(axes=axes))

    def _channels(self, campaign: Campaign) -> dict[str, float]:
        """Directions or columns it moves, with µm (or µrad) per unit of the column."""
        if self.place == "structure":
            return dict.fromkeys(self.directions, 1.0)
        found: dict[str, float] = {}
        for run in filter(self.applies, campaign.runs):
            for instrument in instruments_of(run):
                if not instrument.on_control:
                    found |= {c.name: 1e-3 / c.scale for c in instrument.columns(run, campaign.machine)}
        return found

    def parameters(self, campaign: Campaign) -> tuple[Parameter, ...]:
        names = self._basis(campaign.machine).names
        return tuple(self.own(f"{c}.{name}", "um", self.sigma_um) for c in self._channels(campaign) for name in names)

    def signals(self) -> tuple[Signal, ...]:
        return tuple(Velocity(name.removesuffix(VELOCITY)) for name in self.over if name.endswith(VELOCITY))

    def apply(self, row: Row) -> None:
        basis = self._basis(row.machine)
        functions = dict(
            zip(basis.names, basis.values(*(self._coordinate(row, name) for name in self.over)), strict=True)
        )

        def term(channel: str) -> Any:
            return sum(self.parameter(row, f"{channel}.{name}") * value for name, value in functions.items())

        if self.place == "structure":
            for c in self.directions:
                row.shift["xyz".index(c)] += term(c)
        else:
            for i in row.sensed:
                row.readings[i] += term(row.columns[i].name)

    @staticmethod
    def _coordinate(row: Row, name: str) -> Any:
        if name == "t":
            return row.clock
        if name.endswith(VELOCITY):
            axis = name.removesuffix(VELOCITY)
            return row.signal(Velocity(axis)) / row.machine.axes[axis].to_internal
        return row.signal(Position(name))

    def describe(self, campaign: Campaign, values: Values, covariance: Covariance) -> dict[str, Quantity]:
        """`over`, its `rms` over the campaign's rows and the main `direction` (for a shift of the tool)."""
        machine, basis = campaign.machine, self._basis(campaign.machine)
        runs = [run for run in campaign.runs if self.applies(run)]
        points = []
        for name, axis in zip(self.over, self.over, strict=True):
            unit = machine.axes[axis].to_internal if name in machine.axes else 1.0
            points.append(unit * np.concatenate([_values(name, run, machine) for run in runs]))
        matrix = basis.matrix(*points)
        names = [p.name for p in self.parameters(campaign)]

        def shape(p: Array) -> Array:
            return np.asarray(matrix @ p.reshape(-1, len(basis.names)).T)

        def rms(p: Array) -> list[float]:
            return [float(np.sqrt(np.mean(np.sum(shape(p) ** 2, axis=1))))]

        (value,), (std,) = propagate(rms, names, values, covariance)
        found = {"over": Quantity(self.over), "rms": Quantity(float(value), float(std), "um")}
        if self.place == "structure":
            _, _, right = np.linalg.svd(shape(np.array([values[name] for name in names])), full_matrices=False)
            main = right[0] * (1.0 if right[0][np.argmax(np.abs(right[0]))] > 0.0 else -1.0)
            full = dict(zip(self.directions, map(float, main), strict=True))
            found["direction"] = Quantity(tuple(full.get(c, 0.0) for c in "xyz"), None, "1")
        return found


def _values(name: str, run: Run, machine: Machine) -> Array:
    """A coordinate along the commands of a run, in file units (mm, degree, s)."""
    if name == "t":
        return run.start_s + np.asarray(run.time)
    command = np.asarray(run.commands[name.removesuffix(VELOCITY)])
    if not name.endswith(VELOCITY):
        return command
    return np.asarray(np.gradient(command, run.time)) if run.dynamic and run.rows > 1 else np.zeros(run.rows)
