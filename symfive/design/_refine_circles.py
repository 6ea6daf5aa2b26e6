"""Continuous refinement of circles as they would be run: one after the other by the simplex of J. A. Nelder & R. Mead 1965.

A circle has a few variables and is evaluated in hundredths of a second, so no derivatives are needed; a circle that cannot be run
has ψ = ∞, and the simplex slides along such limits.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace

import numpy as np

from symfive.arrays import Array
from symfive.design._circles import Circle, CircleShape, Goal, check_clear, limits_met, measured
from symfive.effects import Effect
from symfive.errors import InputError
from symfive.machine import Machine

TO_RUN = {"ratio": 1e-4, "radius": 1e-3, "feed": 1.0, "height": 1.0, "x": 1.0, "y": 1.0, "z": 1.0}
"""To what a refined value is rounded, mm and mm/min."""
MARGIN = 0.01
"""Share of every limit of the machine that is kept free: what the axes do between two rows."""
SIMPLEX = 0.1
"""Size of the first simplex, of the variables' ranges."""
SETTLED, LEAST_GAIN = 1e-3, 1e-4
"""Of the ranges, and in ψ: where a simplex ends."""
EVALUATIONS, ROUNDS = 40, 3
"""At most: of a simplex by its variables, and of how often every circle is moved."""
BACK = (1.0, 0.7, 0.4)
"""Shares of the way to the circle that was found: the first along which no bodies meet is taken."""


def refined_circles(
    machine: Machine, effects: Sequence[Effect], goal: Goal, circles: Sequence[Circle],
    bounds: Mapping[str, tuple[float, float]], *, noise_um: float, rate_hz: float, draws: int,
) -> list[Circle]:  # fmt: skip
    """The circles, each moved within `bounds` (variable → least and most, mm and mm/min) as long as ψ of all falls."""
    known: dict[tuple[object, ...], Circle | None] = {}

    def measure(shape: CircleShape) -> Circle | None:
        """The circle as it would be recorded; None where it cannot be."""
        key = (shape.direction, shape.plane, *shape.values.values())
        if key not in known:
            try:
                found = measured(machine, effects, shape, noise_um=noise_um, rate_hz=rate_hz, draws=draws)
                known[key] = None if limits_met(machine, found.runs, MARGIN) else found
            except InputError:
                known[key] = None
        return known[key]

    best, free = list(circles), {name: ends for name, ends in bounds.items() if ends[0] < ends[1]}
    for _ in range(ROUNDS if free else 0):
        before = goal.value(best)
        for i, circle in enumerate(best):
            best[i] = _moved(machine, goal, circle, best[:i] + best[i + 1 :], free, measure)
        if goal.value(best) > before - LEAST_GAIN:
            break
    return best


def _moved(
    machine: Machine, goal: Goal, circle: Circle, others: Sequence[Circle], free: Mapping[str, tuple[float, float]],
    measure: Callable[[CircleShape], Circle | None],
) -> Circle:  # fmt: skip
    """The best circle near one of several."""
    from scipy.optimize import minimize

    low, high = np.array(list(free.values())).T

    def at(x: Array) -> Circle | None:
        """The circle at x, each 0…1 of its range."""
        wanted = zip(free, low + np.clip(x, 0.0, 1.0) * (high - low), strict=True)
        values = {name: round(float(value) / TO_RUN[name]) * TO_RUN[name] for name, value in wanted}
        return measure(replace(circle.shape, values={**circle.shape.values, **values}))

    def psi(x: Array) -> float:
        found = at(x)
        return math.inf if found is None else goal.value([*others, found])

    start = np.clip((np.array([circle.shape.values[name] for name in free]) - low) / (high - low), 0.0, 1.0)
    simplex = start + np.vstack([0.0 * start, np.diag(np.where(start > 0.5, -SIMPLEX, SIMPLEX))])
    options = {"xatol": SETTLED, "fatol": LEAST_GAIN, "maxfev": EVALUATIONS * len(start), "initial_simplex": simplex}
    with np.errstate(invalid="ignore"):  # ∞ - ∞ of a simplex that cannot be run
        way = minimize(psi, start, method="Nelder-Mead", options=options).x - start
    for share in BACK:
        near = at(start + share * way)
        if near is not None and goal.value([*others, near]) < goal.value([*others, circle]) - LEAST_GAIN:
            try:
                check_clear(machine, near.runs)
                return near
            except InputError:
                continue
    return circle
