"""Candidate set-ups and poses: where balls, nests, tools and bars may stand, and which poses each of them allows."""

from __future__ import annotations

import itertools
import math

import numpy as np
from numpy.typing import NDArray

from symfive.design._exchange import Candidates
from symfive.design._information import Task
from symfive.design._space import Space
from symfive.errors import InputError

__all__ = ["best_setups", "candidates_in", "pose_grid", "setup_options"]

Array = NDArray[np.float64]
Indices = NDArray[np.int64]
LEVELS = {"rotary": 13, "turn": 24, "bar azimuth": 12, "bar elevation": 7}
PER_SETUP = 500


def setup_options(space: Space) -> tuple[Array, Array]:
    """Set-ups (m, 4) as in `SETUP_VARIABLES` and their constants (m, 1): corners of the workspace, each with each bar."""
    low, high = space.lower[space.poses :], space.upper[space.poses :]
    places = [(0.0, 0.0)]
    if high[0] > 0.0:
        places += [(high[0], angle) for angle in (0.0, math.pi / 2.0, math.pi, -math.pi / 2.0)]
    ends = [sorted({low[i], high[i]}) for i in (2, 3)]
    options = [(*place, *rest) for place in places for rest in itertools.product(*ends)]
    setups = np.array([option for option in options for _ in space.lengths])
    lengths = np.array([[length] for _ in options for length in space.lengths])
    return setups, lengths


def pose_grid(space: Space, count: int, seed: int = 0) -> Array:
    """At most `count` poses (n, poses) on a grid that holds the ends of every range; a random part where it is larger."""
    levels = []
    for i, name in enumerate(space.names[: space.poses]):
        low, high = space.lower[i], space.upper[i]
        turns = high - low >= 2.0 * math.pi - 1e-9
        number = LEVELS.get(name, LEVELS["turn" if turns else "rotary"])
        levels.append(np.linspace(low, high, number, endpoint=not turns))
    total = math.prod(len(level) for level in levels)
    picked = np.arange(total)
    if total > count:
        picked = np.sort(np.random.default_rng(seed).choice(total, count, replace=False))
    places = np.unravel_index(picked, [len(level) for level in levels])
    return np.stack([level[place] for level, place in zip(levels, places, strict=True)], axis=1)


def candidates_in(space: Space, setups: Array, lengths: Array, poses: Array) -> Candidates:
    """Every feasible pose in every set-up. Raises `InputError` where there is none, naming the limit that is in the way."""
    m, n = len(setups), len(poses)
    z = np.concatenate([np.tile(poses, (m, 1)), np.repeat(setups, n, axis=0)], axis=1)
    k = np.repeat(lengths, n, axis=0)
    group = np.repeat(np.arange(m), n)
    fits = space.feasible(z, k)
    if not fits.any():
        raise _no_pose(space, z, k)
    z, k, group = z[fits], k[fits], group[fits]
    return Candidates(z, k, group, space.kernel.rows(z, k))


def _no_pose(space: Space, z: Array, k: Array) -> InputError:
    """Which limit keeps most poses out, in words."""
    limits = space.kernel.limits(z, k)
    violated = (limits < -1e-9).mean(axis=0)
    where = "sensor_range" if space.instrument == "r_test" else "bar_stroke"
    if not space.in_range(z, k).any():
        return InputError(
            f"the errors expected by the priors leave the {where} at every pose",
            remedy=f"raise {where} in [workspace] or lower the sigma of the errors",
        )
    worst = space.limit_names[int(np.argmax(violated))]
    remedies = {
        "travel": "move the nest or balls nearer to the centre (table_radius, ball_height), use a shorter bar or tool",
        "spindle nose and table": "raise ball_height in [workspace] or use a slimmer spindle_nose",
        "spindle nose and bar": "add a longer bar to bar_lengths",
        "tool ball and table": "raise ball_height in [workspace]",
    }
    remedy = next(text for key, text in remedies.items() if worst.startswith(key))
    shortest = min(space.lengths)
    longer = f" (the shortest bar is {shortest:g} mm)" if space.instrument == "ball_bar" else ""
    return InputError(f"no pose can be reached: {worst} is in the way everywhere{longer}", remedy=remedy)


def best_setups(
    space: Space, task: Task, count: int, points: int, poses: Array, among: Indices | None = None
) -> tuple[Array, Array]:
    """The `count` set-ups that together tell most if their poses are spread evenly: greedy and exchange.

    The information of a run, its set-up errors marginalised, adds to that of the others, so set-ups compare at once.
    """
    setups, lengths = setup_options(space)
    candidates = candidates_in(space, setups, lengths, poses)
    gains = []
    available = [int(g) for g in np.unique(candidates.group)]
    if among is not None:
        available = [g for g in available if g in among] or available
    nothing = np.zeros_like(task.prior)
    layout = task.layout(1)
    for g in available:
        mine = candidates.take(np.flatnonzero(candidates.group == g))
        share = np.full(len(mine), points / count / len(mine))
        information = task.information(mine.rows, np.zeros(len(mine), dtype=np.int64), 1, share)
        gains.append(task.marginal(information, layout) - task.prior)

    def value(chosen: list[int]) -> float:
        return task.value_of_marginal(task.prior + sum((gains[i] for i in chosen), nothing))

    chosen: list[int] = []
    while len(chosen) < min(count, len(available)):
        chosen.append(min(range(len(available)), key=lambda i: value([*chosen, i])))
    improved = len(chosen) > 1
    while improved:
        improved = False
        for place in range(len(chosen)):
            others = chosen[:place] + chosen[place + 1 :]
            best = min(range(len(available)), key=lambda i: value([*others, i]))  # noqa: B023
            if value([*others, best]) < value(chosen) - 1e-9:
                chosen[place] = best
                improved = True
    picked = [available[i] for i in sorted(set(chosen))]
    return setups[picked], lengths[picked]
