"""How often the instrument is mounted for sweeps, and where.

The mountings are the best ones for poses at rest (`best_setups`). In each the best weights on some random sweeps give what a
recording there tells (`relaxed_bound`), its own set-up errors and delay marginalised, so that recordings add up: another mounting
pays where ψ is lower although its set-up takes time from the recordings. Weights are not whole sweeps, so the last word has the
search (`_sweep_plan`).
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable

import numpy as np

from symfive.arrays import Array
from symfive.design._candidates import best_setups, pose_grid
from symfive.design._circles import Goal
from symfive.design._optimal_weights import relaxed_bound
from symfive.design._space import Space
from symfive.design._sweep_recordings import best_speed
from symfive.design._sweep_search import draw
from symfive.design._sweeps import Sweeps
from symfive.inference import Noise
from symfive.optimal import Task
from symfive.screen import plural

MOST = 4
"""Mountings at most where nobody says how many."""
READINGS = 200
"""With which mountings are compared."""
SAMPLE, TRIES = 60, 600
"""Sweeps by which numbers of mountings are compared, and how many are tried for them."""


def mountings_that_pay(
    space: Space, task: Task, goal: Goal, noise: Noise, rate_hz: float, poses: int, speeds: tuple[float, ...],
    seconds: Callable[[int], float], most: int, progress: Callable[[str], None],
) -> list[tuple[float, list[tuple[Sweeps, Array]]]]:  # fmt: skip
    """One mounting, two and more, `most` at most, as long as ψ falls: this ψ and, each for a recording of `seconds(count)`, the
    mountings with what this tells of the shared parameters (k, k). `poses` at rest are compared. Raises `InputError` where no
    sweep is possible."""
    found: list[tuple[float, list[tuple[Sweeps, Array]]]] = []
    value = math.inf
    for count in itertools.takewhile(lambda count: seconds(count) > 0.0, range(1, 1 + most)):
        progress(f"comparing {plural(count, 'mounting')}")
        setups, lengths = best_setups(space, task, count, READINGS, pose_grid(space, poses))
        tried = [
            Sweeps(space, setup, float(length), noise, rate_hz)
            for setup, (length,) in zip(setups, lengths, strict=True)
        ]
        told = [
            _told(sweeps, goal, best_speed(sweeps, goal, speeds, seconds(count)), seconds(count)) for sweeps in tried
        ]
        reached = goal.psi(sum(told, np.zeros_like(told[0])))
        if reached >= value:
            break
        value = reached
        found.append((value, list(zip(tried, told, strict=True))))
    return found


def _told(sweeps: Sweeps, goal: Goal, speed: float, seconds: float) -> Array:
    """What the best weights on some sweeps of a recording tell of the shared parameters (k, k)."""
    found = [*itertools.islice(draw(sweeps, TRIES, speed), SAMPLE), *(sweep for *_, sweep in sweeps.offered)]
    costs = np.array([sweep.seconds for sweep in found])
    weights, _ = relaxed_bound(goal, found, costs, seconds)
    return sweeps.shared(np.tensordot(weights / costs, np.stack([sweep.matrix for sweep in found]), 1))
