"""The certificate of circles: how good they are, compared with the best that any circles can be at the same cost.

The cost is the number of runs or, for a plan per minute, the time they record. Weights of any size at the same cost bound what
circles can reach (`_optimal_weights`), at the prior's mean, in the mean over draws from the prior or in the worst case;
`_relaxed` has the nominal case only, over poses. The maximum is sought over a dense set: all families of the machine, ratios,
centres and heights that the table has room for, feeds up to the fastest linear axis, both directions; radii and planes are those
of the plan. It is a search: what lies between its circles is not proved.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from symfive.arrays import Array
from symfive.design._circles import Circle, Goal, measured
from symfive.design._digits import down, six_digits
from symfive.design._optimal_weights import GAP, relaxed_bound
from symfive.design._paths import FAMILIES, CircleShape
from symfive.effects import Effect
from symfive.errors import InputError
from symfive.machine import Machine
from symfive.procedures import circle_frame, heights

DENSE, NEAR = 6, 5
"""Powers of 2: circles of the dense set by family and radius, and in every round those near the circles that count."""
ROUNDS, NARROW = 8, 0.1
SUPPORT = 0.01


@dataclass(frozen=True)
class CircleCertificate:
    """`efficiency` of circles: at least this share of the best that the `candidates` can do at the same cost with weights of any
    size (in variance, per parameter); `bound` the lowest ψ these have, `feeds` the range searched, mm/min; `per_minute`: the cost
    is the recording time, not the number of runs."""

    efficiency: float
    bound: float
    candidates: int
    feeds: tuple[float, float]
    per_minute: bool = False

    @property
    def says(self) -> str:
        """The certificate in one sentence."""
        share = down(self.efficiency)
        low, high = self.feeds
        cost = "in the same recording time" if self.per_minute else "in as many runs"
        return (
            f"efficiency ≥ {share} {cost} over {self.candidates} candidate circles of these radii and planes, feeds "
            f"{low:g} to {high:g} mm/min, set-up errors new in every run (searched over a dense set, not proved)"
        )

    def to_data(self) -> dict[str, Any]:
        """The certificate in plan.json."""
        return {
            "says": self.says, "efficiency": six_digits(self.efficiency), "bound": six_digits(self.bound),
            "candidates": self.candidates, "feeds": list(self.feeds), "per_minute": self.per_minute,
            "rigour": "searched over a dense set",
        }  # fmt: skip


def fastest(machine: Machine) -> float | None:
    """Greatest feed of a linear axis, mm/min; None where the machine states none."""
    feeds = [axis.max_feed for axis in machine.axes.values() if not axis.rotary and axis.max_feed is not None]
    return max(feeds, default=None)


def farthest(machine: Machine) -> float:
    """How far from the table's centre a ball may stand, mm: its edge, or half the longest travel where none is stated."""
    spans = [float(np.ptp(axis.travel)) / 2.0 for axis in machine.axes.values() if not axis.rotary]
    return machine.workspace.table_radius or max(spans)


def certify_circles(
    machine: Machine, effects: Sequence[Effect], goal: Goal, circles: Sequence[Circle], considered: Sequence[Circle], *,
    noise_um: float, rate_hz: float,
) -> CircleCertificate:  # fmt: skip
    """The certificate of `circles`, against those `considered` and a dense set with their radii and planes."""
    draws = len(circles[0].matrices) - 1
    shapes = [circle.shape for circle in (*circles, *considered)]
    feeds = [shape.values["feed"] for shape in shapes]
    range_ = (min(feeds), max([*feeds, fastest(machine) or 0.0]))
    spaces = list(_spaces(machine, shapes, range_))
    known = [*circles, *considered]
    alone = replace(goal, per_minute=False)

    def costs(some: Sequence[Circle]) -> Array:
        return np.array([c.seconds if goal.per_minute else float(len(c.runs)) for c in some])

    budget = float(costs(circles).sum())
    wanted = [space.at(place) for space in spaces for place in _points(space.size, DENSE)]
    bound, width = math.inf, 1.0
    for _ in range(ROUNDS):
        for shape in wanted:
            try:
                known.append(measured(machine, effects, shape, noise_um=noise_um, rate_hz=rate_hz, draws=draws))
            except InputError:
                continue  # an axis cannot follow
        before = bound
        weights, bound = relaxed_bound(alone, known, costs(known), budget)
        width *= 0.5
        support = [known[i].shape for i in np.flatnonzero(weights > SUPPORT * budget)]
        places = [(space, space.place(shape)) for shape in support for space in spaces if space.holds(shape)]
        share = max(NEAR - math.ceil(math.log2(max(len(places), 1))), 1)
        wanted = [
            space.at(np.clip(place + width * (shift - 0.5), 0.0, 1.0))
            for space, place in places
            for shift in _points(space.size, share)
        ]
        if before - bound < GAP and width < NARROW:
            break
    efficiency = min(1.0, math.exp(bound - alone.value(circles)))
    return CircleCertificate(efficiency, bound, len(known), range_, goal.per_minute)


@dataclass(frozen=True)
class _Space:
    """Circles of one family, plane, direction and radius; the others between `low` and `high`, the feed as a logarithm."""

    shape: CircleShape
    low: Array
    high: Array

    @property
    def size(self) -> int:
        return len(self.low)

    def holds(self, shape: CircleShape) -> bool:
        """Whether a circle, or one of its two directions, is one of these."""
        own = self.shape
        same = (shape.family, shape.plane, shape.values["radius"]) == (own.family, own.plane, own.values["radius"])
        return same and shape.direction in (own.direction, "both")

    def place(self, shape: CircleShape) -> Array:
        """The place of a circle in the unit cube."""
        names = _free(shape.family)
        values = np.array([math.log(shape.values[n]) if n == "feed" else shape.values[n] for n in names])
        return np.asarray((values - self.low) / np.maximum(self.high - self.low, 1e-12))

    def at(self, place: Array) -> CircleShape:
        """The circle at a place of the unit cube."""
        values = self.low + place * (self.high - self.low)
        found = dict(zip(_free(self.shape.family), map(float, values), strict=True))
        found["feed"] = math.exp(found["feed"])
        return replace(self.shape, values={**self.shape.values, **found})


def _free(family: str) -> list[str]:
    """Variables of a family that differ within a space."""
    return [name for name in FAMILIES[family] if name != "radius"]


def _spaces(machine: Machine, shapes: Sequence[CircleShape], feeds: tuple[float, float]) -> Iterator[_Space]:
    """Every family, radius, plane and direction with the room that the machine has."""
    reach, (x, y) = farthest(machine), machine.table_centre
    room = {"feed": np.log(feeds), "height": heights(machine), "z": heights(machine)}
    room |= {"x": (x - reach, x + reach), "y": (y - reach, y + reach)}
    families = ["planar"]
    try:
        circle_frame(machine)
        families.append("synchronous")
    except InputError:
        pass
    for family in families:
        planes = sorted({shape.plane for shape in shapes}) if family == "planar" else ["XY"]
        for radius in sorted({shape.values["radius"] for shape in shapes}):
            ranges = {**room, "ratio": (0.0, reach / radius)}
            low, high = np.array([ranges[name] for name in _free(family)], dtype=float).T
            for plane in planes:
                for direction in ("ccw", "cw"):
                    values = {"radius": radius}
                    yield _Space(CircleShape(family=family, direction=direction, plane=plane, values=values), low, high)


def _points(size: int, power: int) -> Array:
    """2^power quasi-random places in the unit cube (I. M. Sobol 1967, scrambled with a fixed seed)."""
    from scipy.stats import qmc

    return np.asarray(qmc.Sobol(size, seed=0).random_base2(power))
