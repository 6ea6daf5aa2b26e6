"""What set-ups can tell about a wish at most, their own errors marginalised: many set-ups at once."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence

import numpy as np

from symfive.arrays import Array

INNER = 30
"""Multiplicative steps (D. M. Titterington 1976)."""
TOGETHER = 4000
"""Poses of all set-ups that are looked at together: an array operation costs as much as a hundred of them."""
Marginal = tuple[float, float, Array]
"""Of a set-up, as `marginal_sensitivity` returns it."""


def marginal_sensitivity(
    pull: Array, rows: Sequence[Array], prior: Array, points: Sequence[float], steps: int = INNER,
    enough: tuple[float, float] = (-math.inf, 0.0),
) -> list[Marginal]:  # fmt: skip
    """The poses of set-ups that are most informative about G = `pull` (shared, shared), the set-ups' own errors marginalised.

    Of each: the largest |(J + Jₒ B)ᵀ G^½|² over the poses and tr(G Bᵀ Pₒ B) at the best matrix B found (see `_anywhere`), and
    the weights (n,) of the poses, which add up to its `points`; of its `rows` (n, shared + own, ny), `prior` (own, own)
    information about any set-up. Once neither number is above `enough` no better B is sought.
    """
    values, vectors = np.linalg.eigh(pull)
    live = values > 1e-12 * values[-1]
    half = (vectors[:, live] * np.sqrt(values[live])).T
    found: dict[int, Marginal] = {}
    for some in _alike(rows):
        given = [rows[i] for i in some], prior, [points[i] for i in some]
        found |= zip(some, _marginal(half, *given, steps, enough), strict=True)
    return [found[i] for i in range(len(rows))]


def _alike(rows: Sequence[Array]) -> Iterator[list[int]]:
    """Which set-ups are looked at together: of as many readings a pose, and of about as many poses."""
    some: list[int] = []
    for i in sorted(range(len(rows)), key=lambda i: (rows[i].shape[2], len(rows[i]))):
        if some and (rows[some[0]].shape[2] != rows[i].shape[2] or (len(some) + 1) * len(rows[i]) > TOGETHER):
            yield some
            some = []
        some.append(i)
    if some:
        yield some


def _marginal(
    half: Array, rows: Sequence[Array], prior: Array, points: Sequence[float], steps: int, enough: tuple[float, float]
) -> list[Marginal]:  # fmt: skip
    """The same of a few set-ups at once, which are filled up with poses that tell nothing; G = halfᵀ half."""
    p, (count, longest), (_, width, ny) = half.shape[1], (len(rows), max(map(len, rows))), rows[0].shape
    sizes = np.array([len(some) for some in rows])
    whole = np.zeros((count, width, longest * ny))
    for filled, some in zip(whole, rows, strict=True):
        filled[:, : len(some) * ny] = some.transpose(1, 0, 2).reshape(width, -1)
    seen, own, readings = half @ whole[:, :p], whole[:, p:], np.array(points)
    weights = np.where(np.arange(longest) < sizes[:, None], (readings / sizes)[:, None], 0.0)
    still = np.einsum("mij,mij->mj", seen, seen)
    tops, fixed, best = np.full(count, math.inf), np.zeros(count), weights.copy()
    left = np.arange(count)
    for _ in range(steps):
        weighted = own * np.repeat(weights, ny, axis=1)[:, None]
        turned = own.swapaxes(1, 2)
        B = -np.linalg.solve(weighted @ turned + prior, weighted @ seen.swapaxes(1, 2))
        # |seen + Bᵀ own|² of every reading
        each = still + np.einsum("mij,mij->mj", own, 2.0 * (B @ seen) + (B @ B.swapaxes(1, 2)) @ own)
        gain = each.reshape(len(left), longest, ny).sum(axis=2)
        top, held = gain.max(axis=1), np.sum(B * (prior @ B), axis=(1, 2))
        better = readings * top + held < readings * tops[left] + fixed[left]
        now = left[better]
        tops[now], fixed[now], best[now] = top[better], held[better], weights[better]
        on = np.flatnonzero((tops[left] > enough[0]) | (fixed[left] > enough[1]))
        if not on.size:
            break
        weights = weights * np.sqrt(np.maximum(gain, 1e-300))
        weights *= (readings / weights.sum(axis=1))[:, None]
        if len(on) < len(left):
            weights, own, seen, still, readings = (part[on] for part in (weights, own, seen, still, readings))
            left = left[on]
    return [
        (float(top), float(held), part[:size]) for top, held, part, size in zip(tops, fixed, best, sizes, strict=True)
    ]
