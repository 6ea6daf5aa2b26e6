"""Candidate set-ups and poses: where balls, nests, tools and bars may stand, and which poses each of them allows."""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence

import numpy as np

from symfive.arrays import Array, Indices
from symfive.design._space import Space
from symfive.errors import InputError
from symfive.instruments import INSTRUMENTS
from symfive.optimal import Candidates, Rows, Task, exchanged_options, inverse, marginal_sensitivity

LEVELS = {"rotary": 13, "turn": 24, "bar azimuth": 12, "bar elevation": 7}
PER_SETUP = 500
ROUNDS, INNER = 4, 8


def rows_of(space: Space, rows: Rows) -> Candidates:
    """The rows of a design with what they tell."""
    return Candidates(rows.z, rows.k, rows.group, space.kernel.rows(rows.z, rows.k))


def information_of(space: Space, task: Task, rows: Rows) -> Array:
    """Information of a design, prior included (size, size)."""
    return task.information(space.kernel.rows(rows.z, rows.k), rows.group, rows.groups)


def value_of(space: Space, task: Task, rows: Rows) -> float:
    """ψ of a design."""
    return task.value(information_of(space, task, rows))


def setup_options(space: Space, radii: Sequence[float] = (1.0,)) -> tuple[Array, Array]:
    """Set-ups (m, 4) as in `SETUP_VARIABLES` and their constants (m, 1): at the table's centre and at these shares of its radius,
    at the ends of heights and tool lengths, each with each bar."""
    low, high = space.lower[space.poses :], space.upper[space.poses :]
    places = [(0.0, 0.0)]
    for radius in radii if high[0] > 0.0 else ():
        places += [(radius * high[0], angle) for angle in (0.0, math.pi / 2.0, math.pi, -math.pi / 2.0)]
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
    rows = space.kernel.rows(z, k)
    fits = space.feasible(z, k, rows)
    if not fits.any():
        raise _no_pose(space, z, k)
    return Candidates(z[fits], k[fits], group[fits], rows[fits])


def _no_pose(space: Space, z: Array, k: Array) -> InputError:
    """Which limit keeps most poses out, in words."""
    limits = space.kernel.limits(z, k)
    violated = (limits < -1e-9).mean(axis=0)
    where = INSTRUMENTS[space.instrument].limit
    if not space.in_range(z, k).any():
        return InputError(
            f"the errors expected by the priors leave the {where} at every pose",
            remedy=f"raise {where} in [workspace] or lower the sigma of the errors",
        )
    worst = space.limit_names[int(np.argmax(violated))]
    higher = "raise ball_height in [workspace] (the table is z = 0 of the workpiece frame)"
    zero = "with all axes at 0 the spindle nose stands at the origin of the workpiece frame, on the table"
    remedies = {
        "travel": "move the nest or balls nearer to the centre (table_radius, ball_height), use a shorter bar or tool, or "
        f"correct the travel: {zero}",
        "spindle nose and table": f"{higher} or use a slimmer spindle_nose",
        "spindle nose and bar": "add a longer bar to bar_lengths",
        "spindle nose and post": "raise ball_height in [workspace] or use a slimmer spindle_nose",
        "tool and post": "raise ball_height in [workspace] or add a longer bar to bar_lengths",
        "tool and nest": "use a nest that opens wider (nest_opening in [workspace])",
        "tool ball and table": higher,
        "tool over": f"use a shorter tool, lower balls, or more travel of the upright axis, or correct its travel: {zero}",
        "touch and post": "use a larger sphere or a slimmer post (sphere_radius, post_radius in [workspace])",
    }
    remedy = next(text for key, text in remedies.items() if worst.startswith(key))
    shortest = min(space.lengths)
    longer = f" (the shortest bar is {shortest:g} mm)" if space.bar else ""
    verb = "are" if " and " in worst else "is"
    return InputError(f"no pose can be reached: {worst} {verb} in the way everywhere{longer}", remedy=remedy)


def best_setups(
    space: Space, task: Task, most: int, points: int, poses: Array, among: Indices | None = None
) -> list[tuple[Array, Array]]:
    """The most informative set-ups, one of them, two and so on up to `most`: places (count, 4) and constants (count, 1).

    The information of a run, its set-up errors marginalised, adds to that of the others, so set-ups compare at once.
    """
    setups, lengths = setup_options(space)
    tried = np.arange(len(setups)) if among is None else np.sort(among)
    try:
        candidates = candidates_in(space, setups[tried], lengths[tried], poses)
    except InputError:
        if among is None:
            raise
        return best_setups(space, task, most, points, poses)  # none of these holds a pose
    available, place = np.unique(candidates.group, return_inverse=True)
    rows = [candidates.rows[place.ravel() == i] for i in range(len(available))]
    # one place twice: mounted anew, which averages its set-up errors
    picked = [tried[available[_most_informative(task, rows, count, points)]] for count in range(1, most + 1)]
    return [(setups[some], lengths[some]) for some in picked]


def _most_informative(task: Task, rows: list[Array], count: int, points: int) -> list[int]:
    """Greedy and exchange over set-ups, first with the poses spread evenly in each, then with those that are most informative
    about what the chosen set-ups leave uncertain."""
    weights = [np.full(len(r), points / count / len(r)) for r in rows]
    own = np.diag(task.own_sigma**-2.0)
    best: tuple[float, list[int]] = (math.inf, [])
    for _ in range(ROUNDS):
        gains = [_sensitivity(task, r, w) for r, w in zip(rows, weights, strict=True)]
        chosen = _best_of(task, gains, count)
        information = task.prior + sum((gains[i] for i in chosen), np.zeros_like(task.prior))
        value = task.value(information)
        if value >= best[0] - 1e-6:
            break
        best = (value, chosen)
        pull = task.pull(inverse(information))
        weights = [best for *_, best in marginal_sensitivity(pull, rows, own, [points / count] * len(rows), INNER)]
    return sorted(best[1])


def _sensitivity(task: Task, rows: Array, weights: Array) -> Array:
    """What weighted poses in one set-up add to the information about the machine."""
    information = task.information(rows, np.zeros(len(rows), dtype=np.int64), 1, weights)
    return task.marginal(information, task.layout(1)) - task.prior


def _best_of(task: Task, gains: list[Array], count: int) -> list[int]:
    """Greedy and exchange over set-ups."""
    stacked = np.stack(gains)

    def values(others: list[int], place: int) -> list[float]:
        information = task.prior + stacked[others].sum(axis=0) + stacked
        return [task.criterion.value(task.of_interest(S)) for S in np.linalg.inv(information)]

    return exchanged_options(min(count, len(gains)), values)[1]
