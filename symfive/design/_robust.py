"""Plans that do not depend on one pose, and plans for machines that are not quite the nominal one."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from symfive.design._exchange import Candidates
from symfive.design._information import Task, inverse
from symfive.design._refine import Rows
from symfive.design._space import Space, make_space
from symfive.machine import Machine

__all__ = ["lost_pose", "over_prior", "survive_a_lost_pose"]

Array = NDArray[np.float64]
SHORTLIST = 12


def lost_pose(task: Task, rows: Array, group: NDArray[np.int64], groups: int) -> tuple[float, int]:
    """ψ after the loss of the pose that hurts most, and which one (rows (n, width, ny))."""
    whole = task.layout(groups).embed(rows, group)
    information = task.information(rows, group, groups)
    left = [task.value(information - row @ row.T) for row in whole]
    worst = int(np.argmax(left))
    return left[worst], worst


def survive_a_lost_pose(space: Space, task: Task, rows: Rows, candidates: Candidates, passes: int = 2) -> Rows:
    """Exchange that lowers ψ after the worst loss of one pose (instead of ψ itself).

    `candidates` in the same set-ups as the rows. Each pose in turn may give way to one of the few that tell most in its
    absence.
    """
    current = Candidates(rows.z, rows.k, rows.group, space.kernel.rows(rows.z, rows.k))
    layout = task.layout(rows.groups)
    whole = layout.embed(candidates.rows, candidates.group)
    value, worst = lost_pose(task, current.rows, current.group, rows.groups)
    for _ in range(passes * len(rows.z)):
        information = task.information(current.rows, current.group, rows.groups)
        lost = layout.embed(current.rows, current.group)[worst]
        pull = task.pull(inverse(information - lost @ lost.T))
        seen = np.einsum("npy,pq,nqy->n", whole, pull, whole, optimize=True)
        best: Candidates | None = None
        for entering in np.argsort(seen)[::-1][:SHORTLIST]:
            for leaving in _weakest(task, current, rows.groups):
                trial = _swapped(current, candidates, int(entering), leaving)
                reached, place = lost_pose(task, trial.rows, trial.group, rows.groups)
                if reached < value - 1e-9:
                    value, worst, best = reached, place, trial
        if best is None:
            break
        current = best
    return Rows.of(current.z, current.k, current.group, rows.poses)


def _weakest(task: Task, current: Candidates, groups: int) -> list[int]:
    """The few poses whose loss hurts least."""
    whole = task.layout(groups).embed(current.rows, current.group)
    information = task.information(current.rows, current.group, groups)
    return [int(i) for i in np.argsort([task.value(information - row @ row.T) for row in whole])[:3]]


def _swapped(current: Candidates, candidates: Candidates, entering: int, leaving: int) -> Candidates:
    parts = []
    for name in ("z", "k", "group", "rows"):
        array = getattr(current, name).copy()
        array[leaving] = getattr(candidates, name)[entering]
        parts.append(array)
    return Candidates(*parts)


def over_prior(
    machine: Machine, space: Space, task: Task, rows: Rows, *, draws: int = 8, seed: int = 0
) -> tuple[float, float]:
    """Mean and worst ψ when the machine's location errors are drawn from their priors instead of standing at their means."""
    generator = np.random.default_rng(seed)
    values = []
    for _ in range(draws):
        errors = {
            name: replace(term, mean=term.mean + term.sigma * float(generator.standard_normal()))
            if term.is_location
            else term
            for name, term in machine.errors.items()
        }
        drawn = make_space(
            replace(machine, errors=errors), space.instrument, noise_um=space.noise_um, setup_sigma=space.setup_sigma
        )
        values.append(task.value(task.information(drawn.kernel.rows(rows.z, rows.k), rows.group, rows.groups)))
    return float(np.mean(values)), float(np.max(values))
