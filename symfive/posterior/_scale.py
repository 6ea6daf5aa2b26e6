"""The scale κ² of the noise by a fixed point, and the symmetric equations that it asks to solve."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from scipy.linalg.lapack import dposv

from symfive.arrays import Array, Indices
from symfive.posterior._noise import NEGLIGIBLE

__all__ = ["STEPS", "least", "settled", "solved"]

STEPS = 3
"""Of the fixed point for κ², which contracts by the share of the prior in the evidence, 1e-1 or less."""
SMALL = 8
"""Columns up to which the LU factors of all matrices in one call cost less than a call of each one's Cholesky factor."""


def least(
    start: Array, count: int, columns: int, weigh: Callable[[Indices, Array], tuple[Array, Array]]
) -> tuple[Array, Array]:
    """The least cost (P,) of problems of `count` readings and so many `columns`, and κ² (P,) there.

    Where the columns could explain most readings, there are two minima: much noise and hardly an effect, or little noise. So the
    fixed point is sought from a first scale `start` (P,) on, and from the declared noise on.
    """
    cost, scale = settled(start, count, columns, weigh)
    if (scale > 1.0).any():
        other, lower = settled(np.ones(len(start)), count, columns, weigh)
        cost, scale = np.minimum(cost, other), np.where(other < cost, lower, scale)
    return cost, scale


def settled(
    start: Array, count: int, columns: int, weigh: Callable[[Indices, Array], tuple[Array, Array]]
) -> tuple[Array, Array]:
    """Cost (P,) of problems of `count` readings and so many `columns`, and their κ² (P,), from a first one `start` (P,) on.

    `weigh` says of some problems (p,) under such scales (p,) what is left (p,) and the rest of the cost (p,). Those that are at
    their fixed point, as all are whose noise is as declared, are not solved again: beside it the cost changes by no more than
    the columns times the share by which κ² does.
    """
    scale, cost, rows = np.maximum(1.0, start), np.empty(len(start)), np.arange(len(start))
    for step in range(STEPS):
        kappa2 = scale[rows]
        left, rest = weigh(rows, kappa2)
        cost[rows] = left / kappa2 + rest + count * np.log(kappa2)
        after = np.maximum(1.0, left / count)
        moves = columns * np.abs(after - kappa2) > 2.0 * NEGLIGIBLE * kappa2
        if step == STEPS - 1 or not moves.any():
            break
        rows = rows[moves]
        scale[rows] = after[moves]
    return cost, scale


def solved(h: Array, b: Array, kappa2: Array) -> tuple[Array, Array]:
    """(H + κ²)⁻¹·b (P, n) and log|H/κ² + I| (P,) of symmetric H (P, n, n), to whose diagonals κ² (P,) is added in place: of one
    Cholesky factor each; of small matrices, and where rounding leaves one that has no such factor, of LU factors."""
    n = b.shape[1]
    h.reshape(len(h), -1)[:, :: n + 1] += kappa2[:, None]
    if n > SMALL:
        x, pivots = np.empty(b.shape), np.empty(b.shape)
        for k, (matrix, right) in enumerate(zip(h, b, strict=True)):
            factor, x[k], failed = dposv(matrix.T, right)  # in LAPACK's order, which of a symmetric matrix is the same
            if failed:
                break
            pivots[k] = factor.diagonal()
        else:
            return x, 2.0 * np.log(pivots).sum(axis=1) - n * np.log(kappa2)
    return np.asarray(np.linalg.solve(h, b[..., None])[..., 0]), np.linalg.slogdet(h)[1] - n * np.log(kappa2)
