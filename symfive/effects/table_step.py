"""Step or dent at one place of an axis: a wrong node of its compensation table, a joint of its scale or guide."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Any, Self

import casadi as ca
import numpy as np

from symfive.effects._axes import moving
from symfive.effects._base import AXIS, Campaign, Effect, Form, Forms, Parameter, Row, Run, Scan
from symfive.effects._quantity import Covariance, Quantity, Values, own_quantity, propagated
from symfive.errors import InputError
from symfive.motion import Position

SHAPES = ("step", "dent", "late", "early", "gradual")
NEAREST = 1e-6
INNER, MOST_PLACES, FEWEST_PLACES = 0.05, 100, 5
"""A step is looked for with this share of the readings on either side, at so many places at most, if there are a few."""
WIDE = 0.05
"""Usual length of a ramp that is not known, as a share of the way that the axis goes."""


@dataclass(frozen=True, kw_only=True)
class TableStep(Effect):
    """`shape` `step`: q → q + height·clip((q - at)/ramp, 0, 1); `dent`: q → q + height·max(0, 1 - |q -
    at|/ramp).

    `at` and `ramp` (the distance between two nodes) in mm or degree; they are found by a scan. Where positions are as far
    apart as in a grid, one of them may lie on the step itself: `late` goes on with a second height to the next position
    beyond, `early` begins at the one before. Along a path that is recorded closely, `gradual` is the step with its middle and
    its ramp as parameters, both with the prior 1σ `about`. Typical 1–20 µm.
    """

    id = "table_step"
    stage = "axis"
    says = "a step of the positioning error at one position of the axis"
    hidden_by = "straightness of the other axis, and scale where the position is passed only once or twice"
    action = "check scale and guideway at this position, and the error table of the control"
    coordinate = "{axis}"
    reported_as = "error_motion"
    needs_axis = True
    choices = (("shape", SHAPES),)
    at: float
    ramp: float = 0.1
    shape: str = "step"
    beyond: float = 0.0
    about: float = 0.0

    def prepare(self, campaign: Campaign) -> Self:
        if not (math.isfinite(self.at) and self.ramp > 0.0):
            raise InputError(f"effect {self.id} needs a place and a ramp above 0", remedy="write at = …, ramp = 0.1")
        effect = super().prepare(campaign)
        if self.shape == "gradual":
            return replace(effect, about=self.about or effect._usual_ramp(campaign))
        if self.shape not in ("late", "early") or self.beyond:
            return effect  # what was prepared for a campaign stays so for some of its runs
        return replace(effect, beyond=effect._next_gap(campaign))

    def _next_gap(self, campaign: Campaign) -> float:
        """From the ramp to the next position on the side where the step goes on. Raises `InputError` where there is none."""
        used = np.unique(np.concatenate([run.commands[str(self.axis)] for run in campaign.runs]))
        end = self.at + self.ramp if self.shape == "late" else self.at
        ahead = used - end if self.shape == "late" else end - used
        ahead = ahead[ahead > NEAREST * self.ramp]
        if not ahead.size:
            raise InputError(f"effect {self.id}: nothing was read beyond the step", remedy='write shape = "step"')
        return float(ahead.min())

    def _usual_ramp(self, campaign: Campaign) -> float:
        """Prior 1σ of the middle and the ramp. Raises `InputError` where the axis was not read as it moved."""
        ways = [np.ptp(run.commands[str(self.axis)]) for run in campaign.runs if run.dynamic]
        if not max(ways, default=0.0) > 0.0:
            raise InputError(f"effect {self.id}: no run in which {self.axis} moves", remedy='write shape = "step"')
        return WIDE * float(max(ways))

    @classmethod
    def candidates(cls, campaign: Campaign) -> Forms:
        for axis in moving(campaign):
            ranked = np.sort(np.concatenate([run.commands[axis] for run in campaign.runs]))
            gaps = 1 + np.flatnonzero(np.diff(ranked) > NEAREST * np.ptp(ranked))  # first row after a step
            gaps = gaps[(gaps >= INNER * len(ranked)) & (gaps <= (1.0 - INNER) * len(ranked))]
            chosen = gaps[np.unique(np.linspace(0, len(gaps) - 1, min(len(gaps), MOST_PLACES)).astype(int))]
            middles = 0.5 * (ranked[chosen - 1] + ranked[chosen])

            def form(
                k: int, axis: str = axis, ranked: Any = ranked, chosen: Any = chosen, count: int = len(gaps)
            ) -> Form:
                at = float(ranked[chosen[k] - 1])
                ramp = max(float(ranked[chosen[k]]) - at, cls.ramp)
                plain = cls(axis=axis, at=at, ramp=ramp)
                return Form(effect=plain, shapes=tuple(replace(plain, shape=s) for s in SHAPES[2:]), places=count)

            def courses(run: Run, axis: str = axis, middles: Any = middles) -> Any:
                return np.asarray(run.commands[axis][:, None] > middles, dtype=float)

            if len(chosen) > FEWEST_PLACES:
                yield Scan(channel=AXIS, axis=axis, count=len(chosen), courses=courses, form=form)

    def parameters(self, campaign: Campaign) -> tuple[Parameter, ...]:
        axis = self.its_axis(campaign)
        unit, sigma = ("urad", 30.0) if axis.rotary else ("um", 5.0)
        names = ("height", "rest") if self.beyond else ("height",)
        heights = tuple(self.own(name, unit, sigma) for name in names)
        if self.shape != "gradual":
            return heights
        middle = self.own("middle", axis.unit, self.about, mean=self.at + 0.5 * self.ramp)
        return (*heights, middle, self.own("ramp", axis.unit, self.about, mean=self.about, lower=0.02 * self.about))

    def amplitudes(self, campaign: Campaign) -> tuple[Parameter, ...]:
        return tuple(p for p in self.parameters(campaign) if p.unit in ("um", "urad"))

    def _ramps(self) -> list[tuple[str, float, float]]:
        """Name of the height, beginning and length of each ramp, mm or degree."""
        first = [("height", self.at, self.ramp)]
        if not self.beyond:
            return first
        return [*first, ("rest", self.at + self.ramp if self.shape == "late" else self.at - self.beyond, self.beyond)]

    def apply(self, row: Row) -> None:
        unit, position = row.machine.axes[str(self.axis)].to_internal, row.signal(Position(str(self.axis)))
        for name, begin, length in self._ramps():
            place = (position - begin * unit) / (length * unit)
            if self.shape == "gradual":
                place = 0.5 + (position - self.parameter(row, "middle")) / self.parameter(row, "ramp")
            form = ca.fmax(1.0 - ca.fabs(place), 0.0) if self.shape == "dent" else ca.fmin(ca.fmax(place, 0.0), 1.0)
            row.axis[str(self.axis)] += self.parameter(row, name) * form

    def describe(self, campaign: Campaign, values: Values, covariance: Covariance) -> dict[str, Quantity]:
        """`component` is the error motion along or about the axis itself, `at` its middle, `height` the whole step; also its
        `ramp` where that is a parameter."""
        axis = self.its_axis(campaign)
        main = max(range(3), key=lambda i: abs(axis.direction[i]))
        component = f"E{('ABC' if axis.rotary else 'XYZ')[main]}{axis.name}"
        found = {"component": Quantity(component)}
        if self.shape == "gradual":
            height, middle, ramp = (own_quantity(p, values, covariance) for p in self.parameters(campaign))
            return {**found, "at": middle, "height": height, "ramp": ramp}
        ramps = self._ramps()
        heights = np.array([values[f"{self.key}.{name}"] for name, *_ in ramps])
        weights = np.abs(heights) / max(float(np.abs(heights).sum()), 1e-300)
        centres = [begin + (0.0 if self.shape == "dent" else 0.5 * length) for _, begin, length in ramps]
        spread = math.sqrt(sum(w * length**2 / 12.0 for w, (_, _, length) in zip(weights, ramps, strict=True)))
        names = [f"{self.key}.{name}" for name, *_ in ramps]
        unit = self.parameters(campaign)[0].unit
        return {
            **found,
            "at": Quantity(float(weights @ centres), spread, axis.unit),
            "height": propagated(lambda x: float(x.sum()), names, unit, values, covariance),
        }
