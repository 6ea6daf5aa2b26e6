"""A bound for plans with any set-ups, not only those of the plan at hand.

The information that a run adds, its own set-up errors marginalised, is a minimum over matrices B (own × shared):

    S(M) = min over B of Σ (J + Jₒ B)ᵀ (J + Jₒ B) + Bᵀ Pₒ B,

so for any B at all  ⟨G, S⟩ ≤ N max over poses |(J + Jₒ B) G^½|² + tr(G Bᵀ Pₒ B).  Summed over the runs of a plan and put into
h(I*) ≤ h(I) ⟨G, I*⟩ this bounds every plan with N poses in at most K runs, wherever the balls stand. The best B of a set-up
belongs to the most informative poses there for G; it is found by the multiplicative algorithm. Set-ups in which the
bound is exceeded join the relaxed design until none does. Set-ups and poses are taken from grids: numerically global only.
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from symfive.design._candidates import candidates_in, pose_grid, rows_of, setup_options
from symfive.design._space import Space
from symfive.optimal import Candidates, Marginal, Rows, Task, marginal_sensitivity, relax

POSES = 200
ROUNDS, JOINING = 4, 2
GAP = 5e-3


def bound_anywhere(space: Space, task: Task, rows: Rows, runs: int) -> float:
    """The lowest ψ that any plan with as many poses as `rows` in at most `runs` set-ups can have."""
    points = len(rows.z)
    own = [np.flatnonzero(rows.group == g)[0] for g in range(rows.groups)]
    setups, lengths = setup_options(space, (0.5, 1.0))
    setups = np.concatenate([rows.z[own][:, rows.poses :], setups])
    lengths = np.concatenate([rows.k[own], lengths])
    grid = candidates_in(space, setups, lengths, pose_grid(space, POSES))
    active = list(range(rows.groups))
    bound = -math.inf
    prior = np.diag(task.own_sigma**-2.0)
    for _ in range(ROUNDS):
        columns = _columns(space, rows, grid, active)
        relaxed = relax(task, columns, len(active), points, tolerance=0.5 * GAP, whole_poses=True)
        pull = relaxed.pull[: len(task.prior), : len(task.prior)]
        places = np.unique(grid.group).tolist()
        each: dict[int, Marginal] = {}
        for some in ([s for s in places if s in active], [s for s in places if s not in active]):
            enough = max((top for top, *_ in each.values()), default=-math.inf)
            kept = max((fixed for _, fixed, _ in each.values()), default=0.0)
            rows_in = [grid.rows[grid.group == s] for s in some]
            found = marginal_sensitivity(pull, rows_in, prior, [points] * len(some), enough=(enough, kept))
            each |= zip(some, found, strict=True)
        most = max(top for top, *_ in each.values())
        extra = runs * max(fixed for _, fixed, _ in each.values())
        bound = max(bound, relaxed.lowest(float(np.sum(pull * task.prior)) + points * most + extra))
        if relaxed.value - bound < GAP:
            break
        best = sorted((s for s in each if s not in active), key=lambda s: each[s][0])
        active += best[-JOINING:]
    return bound


def _columns(space: Space, rows: Rows, grid: Candidates, active: list[int]) -> Candidates:
    """The plan's own rows and the grid's in the active set-ups, numbered in the order of `active`."""
    picked = grid.take(np.flatnonzero(np.isin(grid.group, active)))
    number = np.array([active.index(int(g)) for g in picked.group], dtype=np.int64)
    return rows_of(space, rows).joined(replace(picked, group=number))
