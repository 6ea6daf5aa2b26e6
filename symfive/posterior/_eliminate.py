"""Elimination of set-up and geometry from Gram matrices, or from the rows of which these are the products.

With M the Gram matrix of columns s, which have a prior N(0, 1), and others t: M_tt - M_ts (M_ss + I)⁻¹ M_st, and log|M_ss + I|
for the evidence. How far columns are from their prior means, `departure`, is (s,), or (J, s) of every matrix. Where there are
fewer rows than columns the rows are kept: (S·Sᵀ + I)^(-½) times the other columns.
"""

from __future__ import annotations

import numpy as np

from symfive.arrays import Array, Indices

__all__ = ["Total", "eliminated", "eliminated_rows"]


class Total:
    """A sum over runs of Gram matrices (J, m, m) of which each has some of the m columns. Runs of few readings are kept as rows
    (J, n, m) until there are as many as columns: one product serves them all."""

    def __init__(self, nodes: int, size: int) -> None:
        self._nodes, self._size = nodes, size
        self._rows = list[Array]()
        self._gram: Array | None = None

    def add(self, gram: Array, where: Indices) -> None:
        """The Gram matrices (J, k, k) of one run, whose columns stand at `where` (k,)."""
        if self._gram is None:
            self._gram = np.zeros((self._nodes, self._size, self._size))
        self._gram[:, where[:, None], where] += gram

    def add_rows(self, rows: Array, where: Indices) -> None:
        """The rows (J, n, k) of one run."""
        placed = np.zeros((rows.shape[0], rows.shape[1], self._size))
        placed[:, :, where] = rows
        self._rows.append(placed)
        if sum(each.shape[1] for each in self._rows) >= self._size:
            self._multiplied()

    def _multiplied(self) -> Array:
        """The sum, of all rows too."""
        if self._rows:
            rows = np.concatenate(self._rows, axis=1)
            product = products(rows)
            self._gram, self._rows = product if self._gram is None else self._gram + product, []
        assert self._gram is not None
        return self._gram

    def without(self, first: int, departure: Array) -> tuple[Array, Array | None, Array]:
        """The sum without its `first` columns (`eliminated`), the rows of which it is the product where there are fewer of
        these than columns, and log|A| (J,)."""
        if self._gram is None and self._rows:
            rows, logs = eliminated_rows(np.concatenate(self._rows, axis=1), first, departure)
            return products(rows), rows, logs
        gram, logs = eliminated(self._multiplied(), first, departure)
        return gram, None, logs


def products(rows: Array) -> Array:
    """Gram matrices (J, m, m) of rows (J, n, m), one by one: so BLAS computes half of each and no more."""
    found = np.empty((rows.shape[0], rows.shape[2], rows.shape[2]))
    for own, out in zip(rows, found, strict=True):
        np.matmul(own.T, own, out=out)
    return found


def eliminated_rows(rows: Array, first: int, departure: Array) -> tuple[Array, Array]:
    """Rows (J, n, m) whose products are those of `rows` without their `first` columns S, and log|A| (J,): of S = UΣVᵀ, the
    covariance SSᵀ + I of what these columns and the noise make has the root U·(√(Σ² + I) - I)·Uᵀ + I."""
    own, rest = rows[:, :, :first], rows[:, :, first:].copy()
    if first == 0:
        return rest, np.zeros(len(rows))
    rest[:, :, -1] += np.sum(own * np.expand_dims(departure, -2), axis=2)
    axes, sizes, _ = np.linalg.svd(own, full_matrices=False)
    for one, size, right in zip(axes, sizes, rest, strict=True):
        right -= one @ ((1.0 - 1.0 / np.sqrt(1.0 + size**2))[:, None] * (one.T @ right))
    return rest, np.log1p(sizes**2).sum(axis=1)


def eliminated(gram: Array, first: int, departure: Array) -> tuple[Array, Array]:
    """Gram matrices (J, m, m) without their `first` columns, whose prior is N(0, 1) about -departure, and log|A| (J,).

    The last column is the residual: the prior reads as further rows, 1·x = -departure.
    """
    if first == 0:
        return gram, np.zeros(len(gram))
    a = gram[:, :first, :first] + np.eye(first)
    cross = gram[:, :first, first:].copy()
    cross[:, :, -1] -= departure
    factor = np.linalg.cholesky(a)
    solved = np.linalg.solve(factor, cross)
    rest = gram[:, first:, first:] - np.swapaxes(solved, 1, 2) @ solved
    rest[:, -1, -1] += np.sum(departure**2, axis=-1)
    return rest, 2.0 * np.log(np.diagonal(factor, axis1=1, axis2=2)).sum(axis=1)
