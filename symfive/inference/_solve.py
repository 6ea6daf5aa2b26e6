"""Maximum a posteriori by Gauss–Newton on exact Jacobians, with noise and outliers found along the way."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress
from typing import TypeVar

import numpy as np

from symfive.arrays import Array, Indices
from symfive.errors import EvaluationError
from symfive.inference._information import Information
from symfive.inference._problem import Problem

T = TypeVar("T")
Progress = Callable[[str], None]
MAX_STEPS = 40
MAX_NOISE_ROUNDS = 5
STEP_TOLERANCE = 1e-6
"""A step Δ is small when no combination of parameters moves by more than this share of its posterior 1σ, √(ΔᵀHΔ) with H the
information (1e-3 before the last round). The parameters one by one would not do: two that the readings do not separate have a
large 1σ each, while their sum is known."""
FIRST_DAMPING, LEAST_DAMPING = 1e-3, 1e-7
"""Of the diagonal. Where readings are far finer than priors, a curved valley that priors alone lead along is as much flatter
than its walls: a step with less damping than the least is not held back along it."""
PATIENCE, STILL = 8, 0.01
"""Where so many steps, each shortened until it lowers -2 log posterior, together lower it by less than the second, a tenth of 1σ
of any parameter, the fit has converged: readings that stick and slip, or a play that is hardly seen, have a cost with kinks."""
COST_TOLERANCE = 1e-4
"""Or when -2 log posterior falls by no more than this, in a whole step or in so many shortened ones: it says nothing about any
parameter."""
HALVINGS = 30
POOR, LEAST_PRODUCT = 0.25, 1e-8
"""A whole step that gains less than this share of what was predicted is followed by damped ones; an update by a product smaller
than that share of the largest possible is left out (both J. Nocedal & S. J. Wright 2006, ch. 4 and 6.2)."""


def halved(evaluate: Callable[[Array], T], values: Array, origin: Array) -> tuple[Array, T]:
    """What `evaluate` makes of the values and these; where the model has no readings at them, of those half as far from `origin`,
    and so on. Raises `EvaluationError` where it has none at `origin` either."""
    for _ in range(HALVINGS):
        try:
            return values, evaluate(values)
        except EvaluationError:
            values = 0.5 * (values + origin)
    return origin, evaluate(origin)


def gauss_newton(problem: Problem, values: Array, tolerance: float, steps: int = MAX_STEPS) -> tuple[Array, bool]:
    """Gauss–Newton iteration to the maximum for the present noise, at most `steps` times. Returns the best values at which
    the model was evaluated and whether they are the maximum.

    A whole step that does not lower the cost is first followed by another from where it led: where a valley is curved, the step
    along it ends up on the wall, and straight down from there lies the valley again (R. Fletcher 1982, second-order correction).
    If that does not help, or a whole step gains much less than predicted, steps are shortened by Levenberg's damping, which
    follows how well the cost was predicted (H. B. Nielsen 1999). Where readings are bent and priors pull far, the Hessian is not
    Gauss–Newton's alone: a secant estimate of the rest is added while it predicts gradients better (J. E. Dennis, D. M. Gay &
    R. E. Welsch 1981). A parameter that would leave its bounds stays at the bound. A step to where the model has no readings is
    one that does not lower the cost; a start without any is brought nearer to the prior means.
    """
    model = problem.model
    precision = problem.prior_precision
    lower = np.array([p.lower for p in model.parameters])
    upper = np.array([p.upper for p in model.parameters])
    free = np.flatnonzero(problem.free)
    damping, growth, last = 0.0, 2.0, np.inf
    values, begins = halved(problem.information_at, values, np.where(problem.free, model.prior_mean, values))
    information: Information | None = begins
    best = values.copy()
    matrix, gradient, expected = np.zeros((0, 0)), np.zeros(0), 0.0
    plain, lacking = matrix, np.zeros((len(values), len(values)))
    history: list[float] = []
    corrected = False  # by a second step; if that did not help, none is again before a whole step has succeeded
    for number in range(steps):
        if number > 0:
            information = _information(problem, values)
        departure = values - model.prior_mean
        pulled = float(np.sum((departure**2 * precision)[free]))
        total = np.inf if information is None else information.square + pulled
        accepted = np.isfinite(total) and total <= last * (1 + 1e-12) + 1e-9
        if accepted:
            history.append(total)
            gained = history[-1 - PATIENCE] - total if len(history) > PATIENCE else np.inf
            if damping > 0.0 and gained < STILL:
                return values, True
        if information is not None:
            here, pull = information.matrix + np.diag(precision), information.gradient - departure * precision
            if not accepted and damping == 0.0 and not corrected:
                corrected = True
                values = values + _step(here, pull, 0.0, free, lower - values, upper - values)
                continue
        if not accepted and damping == 0.0 and matrix is not plain:
            matrix, lacking = plain, np.zeros_like(lacking)
        elif not accepted:
            damping, growth = max(growth * damping, FIRST_DAMPING), 2.0 * growth
            if damping > 1e9 or not matrix.size:
                return best, bool(matrix.size)  # no lower in steps of any length: a kink
        else:
            settled = last - total < max(COST_TOLERANCE, 1e-12 * total) and damping == 0.0
            ratio = (last - total) / max(expected, 1e-300)
            if damping > 0.0 or ratio < POOR:
                damping = max(damping, LEAST_DAMPING) * max(1.0 / 3.0, 1.0 - (2.0 * min(ratio, 1.0) - 1.0) ** 3)
                damping, growth = (damping if damping > LEAST_DAMPING else 0.0), 2.0
            matrix = plain = here
            if number > 0:
                lacking, trusted = _secant(lacking, here, values - best, gradient - pull, free)
                matrix = here + lacking if trusted else here
            best, last = values.copy(), total
            corrected &= damping > 0.0
            gradient = pull
        step = _step(matrix, gradient, damping, free, lower - best, upper - best)
        square = float(step @ matrix @ step)
        expected = 2.0 * float(gradient @ step) - square
        values = best + step
        if accepted and (settled or square < tolerance**2):
            return best, True
    return best, False


def _information(problem: Problem, values: Array) -> Information | None:
    """The information at the values of a step; None where the model has no readings there."""
    try:
        return problem.information_at(values)
    except EvaluationError:
        return None


def _secant(lacking: Array, matrix: Array, step: Array, change: Array, free: Indices) -> tuple[Array, bool]:
    """What the Gauss–Newton `matrix` lacks of the Hessian, updated by the `change` of the gradient over a step (symmetric rank
    one; begun anew where the sum would not be positive definite), and whether the estimate so far predicted that change better
    than the matrix alone does."""
    inner, over = np.ix_(free, free), step[free]
    size = np.sqrt(np.diag(matrix)[free])
    bare = change[free] - matrix[inner] @ over
    better = float(np.linalg.norm((bare - lacking[inner] @ over) / size)) < float(np.linalg.norm(bare / size))
    for start in (lacking[inner], np.zeros((len(free), len(free)))):
        left = bare - start @ over
        product = float(left @ over)
        if abs(product) > LEAST_PRODUCT * float(np.linalg.norm(left / size) * np.linalg.norm(over * size)):
            found = start + np.outer(left, left) / product
            with suppress(np.linalg.LinAlgError):
                np.linalg.cholesky((matrix[inner] + found) / np.outer(size, size))
                whole = np.zeros_like(matrix)
                whole[inner] = found
                return whole, better
    return np.zeros_like(matrix), False


def _step(matrix: Array, gradient: Array, damping: float, free: Indices, lowest: Array, highest: Array) -> Array:
    """The damped step of the free parameters. Those that it would take beyond `lowest` or `highest` go there, and the others
    make the best of it."""
    step = np.zeros(len(gradient))
    inner = free
    while inner.size:
        pull = gradient[inner] - matrix[inner] @ np.where(np.isin(np.arange(len(step)), inner), 0.0, step)
        part = matrix[np.ix_(inner, inner)]
        size = np.sqrt(np.diag(part))  # where a drive is unstable, 1e43 beside 1e2
        step[inner] = np.linalg.solve(part / size / size[:, None] + damping * np.eye(len(part)), pull / size) / size
        bounded = np.clip(step, lowest, highest)
        beyond = bounded[inner] != step[inner]
        step[inner[beyond]] = bounded[inner[beyond]]
        if not beyond.any():
            break
        inner = inner[~beyond]
    return step


def solve(problem: Problem, values: Array, *, noise: str, progress: Progress) -> tuple[Array, bool]:
    """Estimate parameters, noise and outliers in turn until none of them changes."""
    problem.weigh(values)
    values, _ = gauss_newton(problem, values, 1e-2)
    if noise == "declared":
        problem.weigh(values)
        return gauss_newton(problem, values, STEP_TOLERANCE)
    for number in range(MAX_NOISE_ROUNDS):
        before = dict(problem.noises)
        problem.weigh(values)
        survey = problem.survey(values)
        problem.estimate_noises(survey, values)
        changed = problem.flag_outliers(survey, values)
        progress(f"noise estimate {number + 1}: {len(problem.outliers)} outliers")
        values, _ = gauss_newton(problem, values, 1e-3)
        settled = all(abs(np.log(problem.noises[k].total / before[k].total)) < 0.01 for k in before)
        if settled and not changed:
            break
    return gauss_newton(problem, values, STEP_TOLERANCE)
