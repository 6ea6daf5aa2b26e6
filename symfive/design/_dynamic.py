"""Dynamic paths: which circles tell most about drives and play, with centring errors and set-up as nuisances.

A synchronous circle (rotary and linear axis together, paper 3) has a radius r, a distance X_T of its centre from the rotary
axis, a feed and a direction. Near X_T/r = 1 the rotary axis must turn at F/|X_T - r|, so the drives' lag is seen well there,
up to the axis' limits; a backlash is seen only where the axis reverses, which needs X_T > r. The information of a run
with its set-up errors marginalised adds to that of the others, so circles are chosen like poses.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize_scalar

from symfive.campaign import Campaign, Run
from symfive.design._criteria import criterion_of
from symfive.design._information import inverse
from symfive.effects import Effect
from symfive.errors import InputError
from symfive.machine import Machine
from symfive.model import Model
from symfive.procedures import campaign_of, synchronous_circle

__all__ = ["Circle", "CirclePlan", "best_ratio", "circle_information", "plan_circles"]

Array = NDArray[np.float64]
RATIOS = (0.0, 0.3, 0.5, 0.7, 0.8, 0.85, 0.9, 1.1, 1.15, 1.2, 1.3, 1.5, 1.8)


@dataclass(frozen=True)
class Circle:
    """A circle in both directions: `ratio` X_T/r, `radius` mm, `feed` mm/min, its `runs`, the information `matrix` (k, k) it
    adds about the machine and the effects, and the expected 1σ by parameter of the effects."""

    ratio: float
    radius: float
    feed: float
    runs: tuple[Run, ...]
    matrix: Array
    sigma: dict[str, float]


@dataclass(frozen=True)
class CirclePlan:
    """Circles chosen together: the campaign, the `circles` in it, expected 1σ of the effects' parameters, and all circles
    that were considered."""

    campaign: Campaign
    circles: tuple[Circle, ...]
    sigma: dict[str, float]
    considered: tuple[Circle, ...]


def circle_information(
    machine: Machine, effects: Iterable[Effect], *, ratio: float, radius: float, feed: float, noise_um: float = 0.3,
    rate_hz: float = 50.0,
) -> Circle:  # fmt: skip
    """One circle in both directions. Raises `InputError` where an axis cannot follow."""
    runs = synchronous_circle(
        machine, x_t=ratio * radius, radius=radius, feed=feed, direction="both", rate_hz=rate_hz, noise_um=noise_um
    )
    model = Model(Campaign(machine=machine, runs=runs), effects)
    names, matrix = _marginal(model, runs)
    prior = np.diag([model.parameters[model.index[n]].sigma ** -2.0 for n in names])
    spread = np.sqrt(np.diag(inverse(matrix + prior)))
    chosen = {
        n: float(s) for n, s in zip(names, spread, strict=True) if model.parameters[model.index[n]].kind == "effect"
    }
    return Circle(ratio, radius, feed, runs, matrix, chosen)


def _marginal(model: Model, runs: Sequence[Run]) -> tuple[list[str], Array]:
    """Information about all that is not set-up, each run's set-up marginalised: names and matrix in file units."""
    shared = [i for i, p in enumerate(model.parameters) if p.kind != "setup"]
    place = {i: j for j, i in enumerate(shared)}
    vector = model.start
    for effect in model.effects:
        for name, value in effect.typical(model.campaign).items():
            if model.parameters[model.index[name]].mean == 0.0:
                vector[model.index[name]] = value  # a play of width zero has no derivative where the axis rests
    total = np.zeros((len(shared), len(shared)))
    for run in runs:
        line = model.linearise(run, vector)
        slopes = (line.jacobian / model.noise(run)[:, None]).reshape(-1, line.jacobian.shape[2])
        gram = slopes.T @ slopes
        inside = np.array([i in place for i in line.columns])
        own = line.columns[~inside]
        rest = gram[np.ix_(~inside, ~inside)] + np.diag(model.prior_sigma[own] ** -2.0)
        cross = gram[np.ix_(inside, ~inside)]
        index = [place[int(i)] for i in line.columns[inside]]
        total[np.ix_(index, index)] += gram[np.ix_(inside, inside)] - (
            cross @ inverse(rest) @ cross.T if own.size else 0.0
        )
    return [model.parameters[i].name for i in shared], total


def best_ratio(
    machine: Machine, effects: Sequence[Effect], parameter: str, *, radius: float, feed: float, low: float, high: float,
    noise_um: float = 0.3,
) -> Circle:  # fmt: skip
    """The ratio X_T/r between `low` and `high` at which `parameter` comes out best (Brent's bounded search)."""

    def spread(ratio: float) -> float:
        try:
            circle = circle_information(
                machine, effects, ratio=float(ratio), radius=radius, feed=feed, noise_um=noise_um
            )
        except InputError:
            return 1e9
        return math.log(circle.sigma[parameter])

    grid = np.linspace(low, high, 7)
    start = int(np.argmin([spread(r) for r in grid]))
    bounds = (grid[max(start - 1, 0)], grid[min(start + 1, len(grid) - 1)])
    found = minimize_scalar(spread, bounds=bounds, method="bounded", options={"xatol": 2e-3, "maxiter": 12})
    best = float(found.x) if found.fun <= spread(grid[start]) else float(grid[start])
    return circle_information(machine, effects, ratio=best, radius=radius, feed=feed, noise_um=noise_um)


def plan_circles(
    machine: Machine, effects: Sequence[Effect], *, count: int = 2, radii: Sequence[float] = (50.0,),
    ratios: Sequence[float] = RATIOS, feeds: Sequence[float] = (500.0, 1000.0), for_: Iterable[str] = (),
    criterion: str = "D", noise_um: float = 0.3,
) -> CirclePlan:  # fmt: skip
    """The `count` circles (each in both directions) that together tell most about the effects' parameters.

    `for_` names of the parameters that count (default: all of the effects'); circles that an axis cannot follow are left
    out. Raises `InputError` where none is left or a name is unknown.
    """
    circles: list[Circle] = []
    reason = ""
    for radius in radii:
        for ratio in ratios:
            for feed in feeds:
                try:
                    circles.append(
                        circle_information(machine, effects, ratio=ratio, radius=radius, feed=feed, noise_um=noise_um)
                    )
                except InputError as error:
                    reason = str(error)
    if not circles:
        raise InputError(f"no circle can be run ({reason})", remedy="lower the feeds, or take ratios further from 1")
    model = Model(Campaign(machine=machine, runs=circles[0].runs), effects)
    shared = [p for p in model.parameters if p.kind != "setup"]
    wanted = [p.name for p in shared if p.kind == "effect"]
    for name in for_:
        if name not in {p.name for p in shared}:
            raise InputError(f"there is no parameter {name}", remedy=f"use one of {', '.join(wanted)}")
    interest = [i for i, p in enumerate(shared) if p.name in (tuple(for_) or wanted)]
    scale = np.array([p.sigma for p in shared])
    scaled = [c.matrix * np.outer(scale, scale) for c in circles]
    measure = criterion_of(criterion, len(interest), np.zeros((0, 3, len(interest))))

    def value(chosen: list[int]) -> float:
        covariance = inverse(np.eye(len(shared)) + sum((scaled[i] for i in chosen), np.zeros((len(shared),) * 2)))
        return measure.value(covariance[np.ix_(interest, interest)])

    chosen: list[int] = []
    while len(chosen) < count:
        chosen.append(min(range(len(circles)), key=lambda i: value([*chosen, i])))
    for place in range(count):
        others = chosen[:place] + chosen[place + 1 :]
        chosen[place] = min(range(len(circles)), key=lambda i: value([*others, i]))
    covariance = inverse(np.eye(len(shared)) + sum((scaled[i] for i in chosen), np.zeros((len(shared),) * 2)))
    spread = np.sqrt(np.diag(covariance)) * scale
    sigma = {p.name: float(s) for p, s in zip(shared, spread, strict=True) if p.kind == "effect"}
    runs = [
        replace(run, id=f"{i + 1}-{run.id}", file=f"{i + 1}-{run.id}.csv")
        for i, c in enumerate(chosen)
        for run in circles[c].runs
    ]
    return CirclePlan(campaign_of(machine, runs, "circles"), tuple(circles[i] for i in chosen), sigma, tuple(circles))
