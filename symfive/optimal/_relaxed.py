"""Relaxed designs: weights on poses instead of whole numbers, and the bound that follows from them.

For an information function h = exp(-ψ), concave and homogeneous, every plan with N readings has (Kiefer & Wolfowitz 1960;
Pukelsheim 1993, ch. 7)

    h(M*) ≤ ⟨∇h(M), M*⟩ ≤ h(M) · (⟨G, P⟩ + N · max over poses of ⟨G, F(pose)⟩),   G = C K ψ'(S) Kᵀ C,

whatever M = P + Σ wᵢ Fᵢ is, P being the prior information. The bound is tight at the relaxed optimum.

Poses chosen one at a time begin badly where set-up errors are unknown: the first readings in a set-up tell only where its ball
is, so that each of them gains nothing, and single exchanges do not mend that. The relaxed design shows which poses work together
and how many belong into which set-up: whole numbers of readings (`choose`) begin with the poses of its largest weights.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from symfive.arrays import Array, Indices
from symfive.optimal._exchange import PASSES, Candidates, exchange
from symfive.optimal._information import Task, inverse
from symfive.optimal._rank import LimitedRank

TOLERANCE = 1e-3
NEGLIGIBLE = 1e-6
MULTIPLICATIVE, FRESH = 10, 40
LIVE, LEAST_LIVE, MOST_LIVE = 5, 60, 240
"""Candidates on which the interior point begins: so many per parameter, within these limits."""
ROUNDS, INTERIOR = 12, 40


@dataclass(frozen=True)
class Relaxed:
    """Weights (n,) that sum to the number of readings, ψ and the lowest ψ any design on these candidates can have; G = `pull`
    and ⟨G, M⟩ = `held`, 1 of a criterion that is homogeneous."""

    weights: Array
    value: float
    bound: float
    pull: Array
    held: float = 1.0

    def lowest(self, told: float) -> float:
        """The lowest ψ of any design of which ⟨G, M⟩ is at most `told`."""
        more = told - self.held
        return self.value - (math.log1p(more) if self.held == 1.0 else more)


def _at(task: Task, information: Array, prior: Array, rank: int | None) -> tuple[float, Array, float]:
    """ψ, G and ⟨G, M⟩ at an information matrix."""
    if rank is not None:
        limited = LimitedRank.at(task, information, prior, rank)
        return limited.value, limited.pull, limited.held
    covariance = inverse(information)
    return task.criterion.value(task.of_interest(covariance)), task.pull(covariance), 1.0


def sensitivity(pull: Array, whole: Array) -> Array:
    """⟨G, F⟩ of rows in all columns (n, size, ny): (n,)."""
    n, size, ny = whole.shape
    flat = whole.transpose(0, 2, 1).reshape(n * ny, size)
    return np.asarray(np.einsum("ij,ij->i", flat @ pull, flat).reshape(n, ny).sum(axis=1))


def relax(
    task: Task,
    candidates: Candidates,
    groups: int,
    points: float,
    start: Array | None = None,
    tolerance: float = TOLERANCE,
    whole_poses: bool = False,
) -> Relaxed:
    """Weights on the candidates, optimal to `tolerance` in ψ; for `whole_poses` of ψ_r (`_rank`).

    Few multiplicative steps (D. M. Titterington 1976) find the candidates that matter; an interior point with exact second
    derivatives finishes on them; candidates whose sensitivity exceeds the bound come back until none does.
    """
    layout = task.layout(groups)
    whole = layout.embed(candidates.rows, candidates.group)
    prior = task.prior_information(groups)
    n = len(candidates)
    readings = math.floor(points) * whole.shape[2]
    limited = whole_poses and task.criterion.determinant and readings < len(task.interest)
    rank = readings if limited else None
    weights = np.full(n, points / n) if start is None else 0.9 * start * points / start.sum() + 0.1 * points / n
    first = min(max(LIVE * len(prior), LEAST_LIVE), MOST_LIVE)
    if n > first:
        weights = _multiplied(task, whole, prior, points, weights, rank)
    live = np.sort(np.argsort(weights)[::-1][:first])
    best: Relaxed | None = None
    for _ in range(ROUNDS):
        inner = weights[live] / weights[live].sum() * points
        inner = _interior(task, whole[live], prior, points, inner, 0.2 * tolerance, rank)
        value, pull, held = _at(task, prior + _gathered(whole[live], inner), prior, rank)
        seen = sensitivity(pull, whole)
        weights = np.zeros(n)
        weights[live] = inner
        found = Relaxed(weights, value, -math.inf, pull, held)
        bound = found.lowest(float(np.sum(pull * prior) + points * seen.max()))
        best = replace(found, bound=bound if best is None else max(bound, best.bound))
        if value - best.bound < tolerance:
            break
        fresh = np.setdiff1d(np.argsort(seen)[::-1][:FRESH], live)
        kept = live[inner > NEGLIGIBLE * points]
        live = np.concatenate([kept, fresh])
        weights[fresh] = 0.02 * points / max(len(fresh), 1)
    assert best is not None
    return best


def _gathered(whole: Array, weights: Array) -> Array:
    """Σ w JᵀJ of rows in all columns (n, size, ny)."""
    flat = whole.transpose(1, 0, 2).reshape(whole.shape[1], -1)
    return np.asarray((flat * np.repeat(weights, whole.shape[2])) @ flat.T)


def _multiplied(
    task: Task, whole: Array, prior: Array, points: float, weights: Array, rank: int | None
) -> Array:  # fmt: skip
    """w ← w·⟨G, F⟩ (square root for criteria that are no determinant), normalised, a few times."""
    power = 1.0 if task.criterion.determinant else 0.5
    live = np.arange(len(weights))
    for _ in range(MULTIPLICATIVE):
        pull = _at(task, prior + _gathered(whole[live], weights[live]), prior, rank)[1]
        seen = sensitivity(pull, whole[live])
        gain = weights[live] * np.maximum(seen, 0.0) ** power  # rounding leaves some below 0
        if not gain.any():
            break  # no pose is informative about what is known worst
        weights[live] = gain
        weights *= points / weights.sum()
        floor = NEGLIGIBLE * weights.max()
        live = live[weights[live] > floor]
    return weights


def _interior(
    task: Task, whole: Array, prior: Array, points: float, weights: Array, tolerance: float, rank: int | None
) -> Array:  # fmt: skip
    """Primal-dual interior point for min exp ψ(w), Σw = points, w ≥ 0 (exp ψ is convex)."""
    weights = np.maximum(weights, 1e-4 * points / len(weights))
    weights *= points / weights.sum()
    multiplier = 0.0
    duals = np.full(len(weights), 0.0)
    for iteration in range(INTERIOR):
        slope, bent = _derivatives(task, whole, prior, weights, rank)
        if iteration == 0:
            multiplier = float(-slope @ weights / points)
            duals = np.maximum(slope + multiplier, 0.1 * multiplier / len(weights) ** 0.5 + 1e-9)
        gap = float(duals @ weights)
        residual = slope + multiplier - duals
        if gap < tolerance and np.abs(residual).max() * points < tolerance:
            break
        barrier = 0.15 * gap / len(weights)
        matrix = bent + np.diag(duals / weights + 1e-12)
        right = np.stack([-(slope + multiplier) + barrier / weights, -np.ones(len(weights))], axis=1)
        solved = np.linalg.solve(matrix, right)
        change = -solved[:, 0].sum() / solved[:, 1].sum()
        step = solved[:, 0] + change * solved[:, 1]
        dual_step = (barrier - duals * step) / weights - duals
        length = min(1.0, 0.99 / max(float((-step / weights).max()), 1e-12))
        dual_length = min(1.0, 0.99 / max(float((-dual_step / duals).max()), 1e-12))
        weights = weights + length * step
        duals = duals + dual_length * dual_step
        multiplier += dual_length * change
        weights *= points / weights.sum()
    return weights


def _derivatives(
    task: Task, whole: Array, prior: Array, weights: Array, rank: int | None
) -> tuple[Array, Array]:  # fmt: skip
    """Slope (n,) and second derivatives (n, n) of exp ψ, divided by its value."""
    information = prior + _gathered(whole, weights)
    if rank is not None:
        slope, bent = LimitedRank.at(task, information, prior, rank).derivatives(whole)
        return slope, bent + np.outer(slope, slope)
    if task.criterion.determinant:
        slope, bent = _of_log_det(whole, information)
        others = np.setdiff1d(np.arange(len(prior)), task.interest)
        if others.size:
            less = _of_log_det(whole[:, others], information[np.ix_(others, others)])
            slope, bent = slope - less[0], bent - less[1]
        slope, bent = -slope / len(task.interest), bent / len(task.interest)
        return slope, bent + np.outer(slope, slope)
    root = np.linalg.inv(np.linalg.cholesky(information))
    covariance = root.T @ root
    S = task.of_interest(covariance)
    weight = task.criterion.slope(S)
    values, vectors = np.linalg.eigh(weight)
    half = vectors * np.sqrt(np.maximum(values, 0.0))
    seen = whole.transpose(0, 2, 1) @ covariance[:, task.interest]
    slope = -np.einsum("nya,ab,nyb->n", seen, weight, seen, optimize=True)
    changes = -(seen.transpose(0, 2, 1) @ seen)
    flat = ((root @ whole) @ (seen @ half)).reshape(len(weights), -1)
    return slope, task.criterion.curvature(S, changes) + 2.0 * (flat @ flat.T) + np.outer(slope, slope)


def _of_log_det(whole: Array, information: Array) -> tuple[Array, Array]:
    """tr(C Fᵢ) (n,) and tr(C Fᵢ C Fⱼ) = |Jᵢᵀ C Jⱼ|² (n, n), C the inverse of the information."""
    seen = whole.transpose(2, 0, 1) @ np.linalg.inv(np.linalg.cholesky(information)).T
    slope = np.einsum("ynp,ynp->n", seen, seen)
    own, mixed = np.zeros((2, len(whole), len(whole)))
    for i, part in enumerate(seen):
        own += (part @ part.T) ** 2
        for other in seen[:i]:
            mixed += (part @ other.T) ** 2
    return slope, own + mixed + mixed.T


ROUGH = 0.02
"""How near its optimum, in ψ, the relaxed design is whose weights are made whole."""


def choose(task: Task, candidates: Candidates, groups: int, points: int, passes: int = PASSES) -> Indices:
    """`points` candidates, a repeated reading listed as often, by exchange from the relaxed design."""
    weights = relax(task, candidates, groups, points, tolerance=ROUGH, whole_poses=True).weights
    return exchange(task, candidates, groups, apportioned(weights, points), passes)


def apportioned(weights: Array, points: int) -> Indices:
    """`points` candidates, each as often as its weight (n,) says, rounded by the largest remainders."""
    shares = weights * points / weights.sum()
    counts = np.floor(shares).astype(np.int64)
    remainders = np.argsort(counts - shares, kind="stable")
    counts[remainders[: points - int(counts.sum())]] += 1
    return np.repeat(np.arange(len(weights)), counts)
