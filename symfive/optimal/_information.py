"""The information of a plan: machine parameters shared by all runs, set-up errors of each run, priors of both."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from symfive.arrays import Array, Indices
from symfive.optimal._criteria import Criterion


def inverse(matrix: Array) -> Array:
    """Inverse of a symmetric positive definite matrix, equilibrated first (its parameters' sizes differ by 10⁴)."""
    scale = 1.0 / np.sqrt(np.diag(matrix))
    return np.asarray(np.linalg.inv(matrix * np.outer(scale, scale)) * np.outer(scale, scale))


def marginal(information: Array, kept: Indices) -> Array:
    """Information (m, m) about the parameters `kept` (m,) of those of an information matrix, all others marginalised."""
    others = np.setdiff1d(np.arange(len(information)), kept)
    own = information[np.ix_(others, others)]
    scale = 1.0 / np.sqrt(np.diag(own))
    cross = information[np.ix_(kept, others)] * scale
    return np.asarray(information[np.ix_(kept, kept)] - cross @ np.linalg.solve(own * np.outer(scale, scale), cross.T))


@dataclass(frozen=True)
class Layout:
    """Which columns a row of group g touches: `shared` parameters first, then `own` set-up errors for each group."""

    shared: int
    own: int
    groups: int

    @property
    def size(self) -> int:
        """Number of all parameters."""
        return self.shared + self.groups * self.own

    def embed(self, rows: Array, group: Indices) -> Array:
        """Rows (n, …, shared + own, ny) in all columns: (n, …, size, ny)."""
        whole = np.zeros((*rows.shape[:-2], self.size, rows.shape[-1]))
        whole[..., : self.shared, :] = rows[..., : self.shared, :]
        for g in range(self.groups):
            first = self.shared + g * self.own
            whole[group == g, ..., first : first + self.own, :] = rows[group == g, ..., self.shared :, :]
        return whole


@dataclass(frozen=True)
class Task:
    """What is sought: a criterion of some parameters, given what is known.

    `prior` (shared, shared) information about the machine before the plan (priors and earlier campaigns, per prior 1σ),
    `own_sigma` (own,) prior 1σ of a run's set-up errors, `interest` indices of the parameters that count.
    """

    criterion: Criterion
    prior: Array
    own_sigma: Array
    interest: Indices

    def layout(self, groups: int) -> Layout:
        """The columns of a plan with that many runs."""
        return Layout(len(self.prior), len(self.own_sigma), groups)

    def prior_information(self, groups: int) -> Array:
        """Information before the first reading (size, size)."""
        layout = self.layout(groups)
        matrix = np.zeros((layout.size, layout.size))
        matrix[: layout.shared, : layout.shared] = self.prior
        own = np.tile(self.own_sigma**-2.0, groups)
        matrix[range(layout.shared, layout.size), range(layout.shared, layout.size)] = own
        return matrix

    def information(self, rows: Array, group: Indices, groups: int, weights: Array | None = None) -> Array:
        """Prior and Σ w JᵀJ (size, size) of rows (n, shared + own, ny)."""
        whole = self.layout(groups).embed(rows, group)
        flat = whole.transpose(1, 0, 2).reshape(whole.shape[1], -1)
        weighted = flat if weights is None else flat * np.repeat(weights, rows.shape[2])
        return np.asarray(self.prior_information(groups) + weighted @ flat.T)

    def of_interest(self, covariance: Array) -> Array:
        """The block of the parameters that count (s, s)."""
        return covariance[np.ix_(self.interest, self.interest)]

    def value(self, information: Array) -> float:
        """ψ of an information matrix (size, size), or of the machine's alone (shared, shared)."""
        return self.criterion.value(self.of_interest(inverse(information)))

    def pull(self, covariance: Array) -> Array:
        """G = C K ψ'(S) Kᵀ C: the row F changes ψ by -⟨G, F⟩ (size, size)."""
        columns = covariance[:, self.interest]
        return np.asarray(columns @ self.criterion.slope(self.of_interest(covariance)) @ columns.T)

    def marginal(self, information: Array, layout: Layout) -> Array:
        """Information about the machine with all set-up errors marginalised (shared, shared), prior included."""
        return marginal(information, np.arange(layout.shared))
