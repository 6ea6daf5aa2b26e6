"""Plans that do not depend on one pose, and plans for machines that are not quite the nominal one."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import lru_cache

import numpy as np

from symfive.arrays import Array, Indices
from symfive.design._candidates import rows_of, value_of
from symfive.design._space import Space, make_space
from symfive.optimal import Candidates, Rows, Task, inverse

SHORTLIST, WEAKEST, PASSES = 12, 3, 2


def lost_pose(task: Task, rows: Array, group: Indices, groups: int) -> tuple[float, int]:
    """ψ after the loss of the pose that hurts most, and which one (rows (n, width, ny))."""
    left = _each_lost(task, rows, group, groups)
    worst = int(np.argmax(left))
    return left[worst], worst


def _each_lost(task: Task, rows: Array, group: Indices, groups: int) -> list[float]:
    """ψ after the loss of each pose."""
    information = task.information(rows, group, groups)
    return [task.value(information - row @ row.T) for row in task.layout(groups).embed(rows, group)]


def survive_a_lost_pose(space: Space, task: Task, rows: Rows, candidates: Candidates) -> Rows:
    """Exchange that lowers ψ after the worst loss of one pose (instead of ψ itself).

    `candidates` in the same set-ups as the rows. Each pose in turn may be replaced by one of the few most informative in its
    absence.
    """
    current = rows_of(space, rows)
    layout = task.layout(rows.groups)
    whole = layout.embed(candidates.rows, candidates.group)
    value, worst = lost_pose(task, current.rows, current.group, rows.groups)
    for _ in range(PASSES * len(rows.z)):
        information = task.information(current.rows, current.group, rows.groups)
        lost = layout.embed(current.rows, current.group)[worst]
        pull = task.pull(inverse(information - lost @ lost.T))
        seen = np.einsum("npy,pq,nqy->n", whole, pull, whole, optimize=True)
        weakest = np.argsort(_each_lost(task, current.rows, current.group, rows.groups))[:WEAKEST]
        best: Candidates | None = None
        for entering in np.argsort(seen)[::-1][:SHORTLIST]:
            for leaving in weakest:
                trial = _swapped(current, candidates, int(entering), int(leaving))
                reached, place = lost_pose(task, trial.rows, trial.group, rows.groups)
                if reached < value - 1e-9:
                    value, worst, best = reached, place, trial
        if best is None:
            break
        current = best
    return Rows.of(current.z, current.k, current.group, rows.poses)


def _swapped(current: Candidates, candidates: Candidates, entering: int, leaving: int) -> Candidates:
    parts = []
    for name in ("z", "k", "group", "rows"):
        array = getattr(current, name).copy()
        array[leaving] = getattr(candidates, name)[entering]
        parts.append(array)
    return Candidates(*parts)


@lru_cache(maxsize=8)
def drawn_spaces(space: Space, draws: int) -> list[Space]:
    """The same space on machines whose location errors are drawn from their priors instead of standing at their means."""
    machine, generator, found = space.machine, np.random.default_rng(0), []
    for _ in range(draws):
        errors = {
            name: replace(term, mean=term.mean + term.sigma * float(generator.standard_normal()))
            if term.is_location
            else term
            for name, term in machine.errors.items()
        }
        drawn = replace(machine, errors=errors)
        found.append(
            make_space(
                drawn, space.instrument, noise_um=space.noise_um, setup_sigma=space.setup_sigma, options=space.options
            )
        )  # fmt: skip
    return found


def over_prior(spaces: Sequence[Space], task: Task, rows: Rows) -> tuple[float, float]:
    """Mean and worst ψ over drawn machines."""
    values = [value_of(space, task, rows) for space in spaces]
    return float(np.mean(values)), float(np.max(values))


def robust_exchange(spaces: Sequence[Space], task: Task, rows: Rows, candidates: Candidates, how: str) -> Rows:
    """Exchange that lowers the `mean` or the `worst` ψ over drawn machines.

    `candidates` in the same set-ups as the rows. A pose enters by its information on the machines that count: all of them
    alike, or the one that is worst off.
    """
    layout = task.layout(rows.groups)
    offered = [layout.embed(space.kernel.rows(candidates.z, candidates.k), candidates.group) for space in spaces]
    z, k, group = rows.z.copy(), rows.k.copy(), rows.group.copy()
    current = [layout.embed(space.kernel.rows(z, k), group) for space in spaces]
    informations = [task.prior_information(rows.groups) + np.einsum("npy,nqy->pq", own, own) for own in current]

    def joined(trial: list[Array]) -> float:
        values = [task.value(information) for information in trial]
        return max(values) if how == "worst" else float(np.mean(values))

    value = joined(informations)
    for place in range(PASSES * len(z)):
        leaving = place % len(z)
        without = [
            information - own[leaving] @ own[leaving].T for information, own in zip(informations, current, strict=True)
        ]
        worst = int(np.argmax([task.value(information) for information in without]))
        counted = [worst] if how == "worst" else range(len(spaces))
        seen = np.zeros(len(candidates.z))
        for d in counted:
            seen += np.einsum("npy,pq,nqy->n", offered[d], task.pull(inverse(without[d])), offered[d], optimize=True)
        best = -1
        for entering in np.argsort(seen)[::-1][:SHORTLIST]:
            reached = joined([w + o[entering] @ o[entering].T for w, o in zip(without, offered, strict=True)])
            if reached < value - 1e-9:
                value, best = reached, int(entering)
        if best >= 0:
            z[leaving], k[leaving], group[leaving] = candidates.z[best], candidates.k[best], candidates.group[best]
            for d, own in enumerate(current):
                own[leaving] = offered[d][best]
                informations[d] = without[d] + own[leaving] @ own[leaving].T
    return Rows.of(z, k, group, rows.poses)
