"""What a recording does not show of the motion between its rows, and what that is worth in each reading.

Drives and filters remember what happened between two rows, where the commands follow a curve of which the rows are all that is
known. How well they are known tell the predictions from every second and every fourth row: from spacing to spacing their
differences shrink as the next one, to what is true, would (A. C. Aitken 1926). On a circle that is nothing; where an axis starts
within a few rows, it can be a hundred times the noise.
"""

from __future__ import annotations

import numpy as np

from symfive.arrays import Array
from symfive.inference._windows import predicted
from symfive.model import Model
from symfive.motion import begun_before, is_told_by_rows, thinned
from symfive.runs import Run

__all__ = ["unresolved"]


def unresolved(model: Model, run: Run, values: Array, margins: dict[str, int]) -> Array | None:
    """Variance (N, ny) that covers what the motion between rows, or before the first, may add to each reading; None where the
    rows tell all of it."""
    if not is_told_by_rows(run):
        return None
    whole = predicted(model, run, values, margins)

    def spaced(rows: int) -> Array:
        """The prediction of each row from every `rows`-th about it."""
        found = np.empty_like(whole)
        for first, other in enumerate(thinned(run, rows)):
            found[first::rows] = predicted(model, other, values, margins)[first::rows]
        return found

    second = spaced(2)
    change, former = second - whole, np.abs(spaced(4) - second)
    error = change * np.minimum(1.0, np.abs(change) / np.maximum(former, np.finfo(float).tiny))
    variance = np.empty_like(whole)
    for first in (0, 1):  # told by other rows each, and two rows of one kind share what they are off by
        variance[first::2] = 2.0 * _covering(error[first::2])
    other = begun_before(run)
    if other is not None:
        variance += _covering(predicted(model, other, values, margins) - whole)
    return variance


def _covering(errors: Array) -> Array:
    """Variances (n, ny) of independent errors that cover those of a common cause, the pattern d between its changes of sign:
    |d_k|·Σ|d_j| make a diagonal matrix that is nowhere below d·dᵀ (diagonal dominance, S. Gershgorin 1931)."""
    size, found = np.abs(errors), np.empty_like(errors)
    for j, signs in enumerate(np.signbit(errors).T):
        begins = np.concatenate([[0], 1 + np.flatnonzero(np.diff(signs))])
        sums = np.add.reduceat(size[:, j], begins)
        found[:, j] = size[:, j] * np.repeat(sums, np.diff(begins, append=len(signs)))
    return found
