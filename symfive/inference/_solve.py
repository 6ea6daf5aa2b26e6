"""Maximum a posteriori by Gauss–Newton on exact Jacobians, with noise and outliers found along the way."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from symfive.inference._problem import Problem

__all__ = ["gauss_newton", "solve"]

Array = NDArray[np.float64]
Progress = Callable[[str], None]
MAX_STEPS = 40
MAX_NOISE_ROUNDS = 5
STEP_TOLERANCE = 1e-6
"""A step is small when no parameter moves by more than this share of its posterior 1σ (1e-3 before the last round)."""
COST_TOLERANCE = 1e-4
"""Or when -2 log posterior falls by no more than this: it says nothing about any parameter."""


def gauss_newton(problem: Problem, values: Array, tolerance: float) -> tuple[Array, bool]:
    """Iterate to the maximum for the present noise. Returns the values and whether it converged.

    A step that does not lower the cost is shortened by Levenberg's damping; bounds stop a step at the bound.
    """
    model = problem.model
    precision = problem.prior_precision
    lower = np.array([p.lower for p in model.parameters])
    upper = np.array([p.upper for p in model.parameters])
    free = np.flatnonzero(problem.free)
    damping, last = 0.0, np.inf
    best = values.copy()
    matrix, gradient = np.zeros((0, 0)), np.zeros(0)
    for _ in range(MAX_STEPS):
        with np.errstate(over="ignore", invalid="ignore"):  # a trial step may make a drive unstable
            information = problem.information(problem.blocks(values))
        departure = values - model.prior_mean
        total = information.square + float(np.sum((departure**2 * precision)[free]))
        if not total <= last * (1 + 1e-12) + 1e-9:
            damping = max(10.0 * damping, 1e-3)
            if damping > 1e9 or not matrix.size:
                return best, False
            values = np.clip(best + _step(matrix, gradient, damping, free), lower, upper)
            continue
        settled = last - total < max(COST_TOLERANCE, 1e-12 * total) and damping == 0.0
        best, last = values.copy(), total
        matrix = information.matrix + np.diag(precision)
        gradient = information.gradient - departure * precision
        damping = damping / 10.0 if damping > 1e-6 else 0.0
        step = _step(matrix, gradient, damping, free)
        sigma = np.sqrt(np.diag(np.linalg.inv(matrix[np.ix_(free, free)])))
        small = float(np.max(np.abs(step[free]) / sigma, initial=0.0)) < tolerance
        values = np.clip(values + step, lower, upper)
        if small or settled:
            return values, True
    return best, False


def _step(matrix: Array, gradient: Array, damping: float, free: NDArray[np.int64]) -> Array:
    step = np.zeros(len(gradient))
    part = matrix[np.ix_(free, free)]
    step[free] = np.linalg.solve(part + damping * np.diag(np.diag(part)), gradient[free])
    return step


def solve(problem: Problem, values: Array, *, noise: str, progress: Progress) -> tuple[Array, bool]:
    """Alternate between parameters, noise and outliers until none of them moves."""
    values, converged = gauss_newton(problem, values, STEP_TOLERANCE if noise == "declared" else 1e-2)
    if noise == "declared":
        return values, converged
    for number in range(MAX_NOISE_ROUNDS):
        before = dict(problem.noises)
        blocks = problem.blocks(values)
        problem.estimate_noises(blocks)
        changed = problem.flag_outliers(blocks)
        progress(f"noise round {number + 1}: {len(problem.outliers)} outliers")
        values, converged = gauss_newton(problem, values, 1e-3)
        settled = all(abs(np.log(problem.noises[k].total / before[k].total)) < 0.01 for k in before)
        if settled and not changed:
            break
    return gauss_newton(problem, values, STEP_TOLERANCE)
