"""Relaxed designs: weights on poses instead of whole numbers, and the bound that follows from them.

For an information function h = exp(-ψ), concave and homogeneous, every plan with N readings has (Kiefer & Wolfowitz 1960;
Pukelsheim 1993, ch. 7)

    h(M*) ≤ ⟨∇h(M), M*⟩ ≤ h(M) · (⟨G, P⟩ + N · max over poses of ⟨G, F(pose)⟩),   G = C K ψ'(S) Kᵀ C,

whatever M = P + Σ wᵢ Fᵢ is, P being the prior information. The bound is tight at the relaxed optimum.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from symfive.design._exchange import Candidates
from symfive.design._information import Task, inverse

__all__ = ["Relaxed", "relax", "sensitivity"]

Array = NDArray[np.float64]
TOLERANCE = 1e-3
ITERATIONS = 2000
NEGLIGIBLE = 1e-5


@dataclass(frozen=True)
class Relaxed:
    """Weights (n,) that sum to the number of readings, ψ and the lowest ψ any design on these candidates can have."""

    weights: Array
    value: float
    bound: float
    pull: Array

    @property
    def efficiency(self) -> float:
        """exp(bound - value): 1 at the optimum."""
        return float(np.exp(self.bound - self.value))


def sensitivity(pull: Array, whole: Array) -> Array:
    """⟨G, F⟩ of rows in all columns (n, size, ny): (n,)."""
    n, size, ny = whole.shape
    flat = whole.transpose(0, 2, 1).reshape(n * ny, size)
    return np.asarray(np.einsum("ij,ij->i", flat @ pull, flat).reshape(n, ny).sum(axis=1))


def relax(
    task: Task, candidates: Candidates, groups: int, points: float, start: Array | None = None, tolerance: float = TOLERANCE
) -> Relaxed:
    """Multiplicative algorithm (D. M. Titterington 1976; square root for criteria that are no determinant).

    Stops when the bound is within `tolerance` of what is reached. Candidates with a negligible weight and a sensitivity
    below the mean are dropped on the way and looked at again at the end.
    """
    layout = task.layout(groups)
    whole = layout.embed(candidates.rows, candidates.group)
    prior = task.prior_information(groups)
    power = 1.0 if task.criterion.determinant else 0.5
    weights = np.full(len(candidates), points / len(candidates)) if start is None else start * points / start.sum()
    live = np.flatnonzero(weights > 0.0)
    best: Relaxed | None = None
    for iteration in range(ITERATIONS):
        if iteration % 200 == 0 and iteration:  # whatever has become worth a weight comes back
            weights[:] = np.where(weights > 0.0, weights, NEGLIGIBLE * points)
            live = np.arange(len(weights))
        flat, ny = whole[live].transpose(1, 0, 2).reshape(layout.size, -1), whole.shape[2]
        information = prior + (flat * np.repeat(weights[live], ny)) @ flat.T
        covariance = inverse(information)
        pull = task.pull(covariance)
        every = iteration % 20 == 0
        seen = sensitivity(pull, whole if every else whole[live])
        active = seen[live] if every else seen
        if every:
            value = task.criterion.value(task.of_interest(covariance))
            bound = value - float(np.log(np.sum(pull * prior) + points * seen.max()))
            if best is None or bound > best.bound or value < best.value:
                lowest = bound if best is None else max(bound, best.bound)
                best = Relaxed(weights.copy(), value, lowest, pull)
            if best.value - best.bound < tolerance:
                break
            fresh = np.flatnonzero((weights == 0.0) & (seen > active.max()))
            weights[fresh] = NEGLIGIBLE * points
            live, active = np.flatnonzero(weights > 0.0), seen[weights > 0.0]
        weights[live] *= active**power
        weights[live[(weights[live] < NEGLIGIBLE * weights[live].max()) & (active < active.mean())]] = 0.0
        live = np.flatnonzero(weights > 0.0)
        weights *= points / weights.sum()
    assert best is not None
    return best
