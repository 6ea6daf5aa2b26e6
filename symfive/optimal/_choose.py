"""Whole numbers of readings from a relaxed design.

Poses chosen one at a time begin badly where set-up errors are unknown: the first readings in a set-up tell only where its ball
is, so that each of them gains nothing, and single exchanges do not mend that. The relaxed design shows which poses work together
and how many belong into which set-up: exchange begins with the poses of its largest weights.
"""

from __future__ import annotations

import numpy as np

from symfive.arrays import Array, Indices
from symfive.optimal._exchange import PASSES, Candidates, exchange
from symfive.optimal._information import Task
from symfive.optimal._relaxed import relax

ROUGH = 0.02
"""How near its optimum, in ψ, the relaxed design is whose weights are made whole."""


def choose(task: Task, candidates: Candidates, groups: int, points: int, passes: int = PASSES) -> Indices:
    """`points` candidates, a repeated reading listed as often, by exchange from the relaxed design."""
    weights = relax(task, candidates, groups, points, tolerance=ROUGH).weights
    return exchange(task, candidates, groups, apportioned(weights, points), passes)


def apportioned(weights: Array, points: int) -> Indices:
    """`points` candidates, each as often as its weight (n,) says, rounded by the largest remainders."""
    shares = weights * points / weights.sum()
    counts = np.floor(shares).astype(np.int64)
    remainders = np.argsort(counts - shares, kind="stable")
    counts[remainders[: points - int(counts.sum())]] += 1
    return np.repeat(np.arange(len(weights)), counts)
