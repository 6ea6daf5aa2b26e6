"""What the readings say about the parameters, added up block by block."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from symfive.arrays import Array
from symfive.inference._noise import Block


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
