"""What the readings say about the parameters, added up block by block, and combinations of these that they cannot separate, by
noise and prior alone, with their names.

In units of the prior (x = θ/σ_prior) the data's information has eigenvalues λ. A direction with λ < 1 has learnt less
from the data than was known before: its posterior variance is more than half its prior variance. The number of the
others is the rank; no numerical tolerance enters.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np

from symfive.arrays import Array, Flags
from symfive.inference._noise import Block
from symfive.numbers import enumerated
from symfive.parameters import Parameter, said_together


@dataclass(frozen=True)
class Information:
    """Information of the data, without the priors: `matrix` (k, k), `gradient` (k,) towards the readings, `square` Σ of whitened
    residuals squared, `count` readings that entered."""

    matrix: Array
    gradient: Array
    square: float
    count: int


class NormalEquations:
    """Whitened blocks, added up: all that is kept of their rows."""

    def __init__(self, size: int) -> None:
        self._gram, self._count = np.zeros((size + 1, size + 1)), 0

    def add(self, block: Block, white: Array) -> None:
        """A block and its whitened table (n, ny, k + 1)."""
        flat = white.reshape(-1, white.shape[2])
        where = np.append(block.columns, len(self._gram) - 1)
        self._gram[np.ix_(where, where)] += flat.T @ flat
        self._count += block.kept

    @property
    def information(self) -> Information:
        """The sum."""
        gram = self._gram
        return Information(gram[:-1, :-1], gram[:-1, -1], float(gram[-1, -1]), self._count)


SHARE = 0.05


@dataclass(frozen=True)
class Confounding:
    """Parameters that the readings cannot separate.

    A change of the `parameters` by their `coefficients` (per 1σ of the prior), all together, does not change the readings by
    more than the noise: of this combination only the prior is known.
    `of_machine`: one of them is of the machine or an effect, not of the set-up.
    """

    parameters: tuple[Parameter, ...]
    coefficients: tuple[float, ...]
    information: float
    of_machine: bool

    @property
    def names(self) -> tuple[str, ...]:
        """Their names."""
        return tuple(p.name for p in self.parameters)

    @property
    def words(self) -> str:
        """The combination in one sentence."""
        first, *rest = self.parameters
        others = said_together(sorted(rest, key=lambda p: p.owner or ""))
        if not others:
            return f"{first.words} is not determined by these readings"
        shown = others if len(others) <= 6 else [*others[:5], f"{len(others) - 5} more"]
        return f"{first.words} cannot be separated from {enumerated(shown)}"


def not_separated(found: Iterable[Confounding]) -> list[str]:
    """Combinations in sentences, all parameters that are not determined in one."""
    several, alone = list[str](), list[Confounding]()
    for each in found:
        if len(each.parameters) == 1:
            alone.append(each)
        else:
            several.append(each.words)
    if len(alone) < 2:
        return [*several, *(each.words for each in alone)]
    names = said_together(each.parameters[0] for each in alone)
    return [*several, f"These readings do not determine {enumerated(names)}"]


def _scaled_eigen(matrix: Array, sigma: Array) -> tuple[Array, Array]:
    values, vectors = np.linalg.eigh(matrix * np.outer(sigma, sigma))
    return np.maximum(values, 0.0), vectors


def data_rank(matrix: Array, sigma: Array) -> int:
    """Number of directions of the parameter space in which the data outweigh the prior."""
    return int(np.sum(_scaled_eigen(matrix, sigma)[0] >= 1.0))


def confounded_combinations(matrix: Array, parameters: Sequence[Parameter]) -> tuple[Confounding, ...]:
    """The undetermined directions as combinations with few names.

    The subspace λ < 1 is brought to reduced row-echelon form, the machine's and the effects' parameters as pivots
    first, so that each combination is led by one of them as far as possible. `matrix` (k, k) is the data's information.
    """
    sigma = np.array([p.sigma for p in parameters])
    values, vectors = _scaled_eigen(matrix, sigma)
    weak = values < 1.0
    if not weak.any():
        return ()
    basis, scaled = vectors[:, weak].T, matrix * np.outer(sigma, sigma)
    machine_first = np.array([p.kind != "setup" for p in parameters])
    found = []
    for row in _echelon(basis, machine_first):
        share = row**2 / np.sum(row**2)
        order = np.argsort(~machine_first * 10.0 - share)
        least = SHARE / max(1, np.sum(share > 1e-12) / 4)
        kept = [int(i) for i in order if share[i] >= least]
        unit = row / np.linalg.norm(row)
        information = float(unit @ scaled @ unit)
        of_machine = bool(machine_first[kept].any())
        own = tuple(parameters[i] for i in kept)
        found.append(Confounding(own, tuple(float(row[i]) for i in kept), information, of_machine))
    return tuple(sorted(found, key=lambda c: (not c.of_machine, c.names)))


def _echelon(basis: Array, preferred: Flags) -> Array:
    """Reduced row-echelon form with complete pivoting, `preferred` columns first as long as they carry enough."""
    rows = basis.copy()
    free = np.ones(rows.shape[1], dtype=bool)
    for i in range(len(rows)):
        size = np.abs(rows[i:]) * free
        best = size * preferred
        if best.max() < 0.3 * size.max():
            best = size
        at, pivot = divmod(int(np.argmax(best)), best.shape[1])
        rows[[i, i + at]] = rows[[i + at, i]]
        rows[i] /= rows[i, pivot]
        others = np.arange(len(rows)) != i
        rows[others] -= np.outer(rows[others, pivot], rows[i])
        free[pivot] = False
    return rows
