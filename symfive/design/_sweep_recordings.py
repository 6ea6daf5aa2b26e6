"""Where and how often the instrument is mounted for sweeps, and the search for each recording: speed, stops on a grid, then off.

The mountings are the best ones for poses at rest (`best_setups`). In each the best weights on some random sweeps give what a
recording there tells (`relaxed_bound`), its own set-up errors and delay marginalised, so that recordings add up: another mounting
pays where ψ is lower although its set-up takes time from the recordings. Weights are not whole sweeps, so the last word has the
search (`_sweep_plan`).

The certificate compares recordings with optimal seconds on a dense set of sweeps in the same mountings (`_optimal_weights`).
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from symfive.arrays import Array, Flags
from symfive.design._candidates import best_setups, pose_grid
from symfive.design._circles import Goal
from symfive.design._digits import down, six_digits
from symfive.design._optimal_weights import Offered, optimal_weights, relaxed_bound
from symfive.design._reach import Reach
from symfive.design._space import Space
from symfive.design._sweep_search import Grid, best_way, draw, grid_of, positions_of, refined_way
from symfive.design._sweeps import Sweep, Sweeps
from symfive.errors import InputError
from symfive.inference import Noise
from symfive.moves import Moves
from symfive.nc import addressed
from symfive.optimal import Task
from symfive.screen import plural

SAMPLE = 60
"""Sweeps by which speeds are compared."""
SLACK = 0.01
"""Share of the time that is left to moving the stops off the grid."""
SLOWEST = 0.1
"""degree/s at which a turn takes an hour."""
REMEDY = "what helps: a longer tool, more travel, a lower sigma of the errors"
MOST = 4
"""Mountings at most where nobody says how many."""
READINGS = 200
"""With which mountings are compared."""
COMPARED, TRIES = 60, 600
"""Sweeps by which numbers of mountings are compared, and how many are tried for them."""


class Recording:
    """A recording in one mounting at the best of some `speeds`, whose `stops` every round improves; `drawn` sweeps at random
    beside those of the grid."""

    def __init__(self, sweeps: Sweeps, goal: Goal, speeds: Sequence[float], seconds: float, drawn: int) -> None:
        self.sweeps, self.speed = sweeps, best_speed(sweeps, goal, speeds, seconds)
        self._positions = positions_of(sweeps)
        for _ in draw(sweeps, drawn, self.speed):
            pass
        self.stops: list[Array] = []

    def improve(self, goal: Goal, seconds: float) -> Array:
        """Search stops for at most so many seconds, `goal` knowing what the others tell; what the recording then tells of the
        parameters that are shared (k, k). Raises `InputError` where no sweep is possible."""
        sweeps, positions, speed = self.sweeps, self._positions, self.speed
        grid = grid_of(sweeps, positions, _ends(sweeps, positions), speed)
        if not np.isfinite(grid.seconds[np.ix_(grid.ends, grid.ends)]).any():
            raise InputError("no sweep joins two positions with a clear exit path", remedy=REMEDY)
        self.stops = _clear_way(sweeps, goal, grid, self.stops, speed, seconds)
        self._positions = _about(sweeps, goal, self.stops, seconds, len(positions))
        found = [sweeps.between(*pair, speed) for pair in itertools.pairwise(self.stops)]
        return sweeps.shared(np.sum([sweep.matrix for sweep in found if sweep is not None], axis=0))


def _sample(positions: Array) -> Array:
    """Some pairs of positions (n, 2, axes)."""
    pairs = np.array(list(itertools.permutations(range(len(positions)), 2))).reshape(-1, 2)
    drawn: Array = positions[np.random.default_rng(0).permutation(pairs)[:SAMPLE]]
    return drawn


def best_speed(sweeps: Sweeps, goal: Goal, speeds: Sequence[float], seconds: float) -> float:
    """The speed on which the best weights spend most of the time, of some sweeps at every speed. Raises `InputError` where no
    sweep is possible."""
    pairs = [(a, b) for a, b in _sample(positions_of(sweeps))]
    for speed in speeds:
        sweeps.all_between(pairs, speed)
    offered = sweeps.offered
    if not offered:
        slower = itertools.takewhile(lambda v: v >= SLOWEST, (min(speeds) * 0.5**i for i in itertools.count(1)))
        works = next((f"{v:g} °/s works" for v in slower if any(sweeps.all_between(pairs, v))), REMEDY)
        raise InputError(f"no sweep is clear of all limits at {min(speeds):g} °/s and more", remedy=works)
    weights, _ = _weighed(goal, [sweep for _, _, sweep in offered], seconds)
    spent = {speed: sum(w for w, (_, own, _) in zip(weights, offered, strict=True) if own == speed) for speed in speeds}
    return max(spent, key=lambda speed: spent[speed])


def _weighed(goal: Goal, offered: Sequence[Sweep], seconds: float) -> tuple[Array, float]:
    return relaxed_bound(goal, offered, np.array([sweep.seconds for sweep in offered]), seconds)


def _ends(sweeps: Sweeps, positions: Array) -> Flags:
    """Positions (n,) with an exit path, in which the instrument can be mounted."""
    if not addressed(sweeps.machine):
        return np.ones(len(positions), dtype=bool)
    return np.array([not what for what in Reach(sweeps.space).in_the_way(*sweeps.poses(positions))])


def _clear_way(
    sweeps: Sweeps, goal: Goal, grid: Grid, stops: Sequence[Array], speed: float, seconds: float
) -> list[Array]:  # fmt: skip
    """The best stops on a grid, then off it; a sweep on which bodies meet is no longer offered."""
    start = [int(np.argmin(np.abs(grid.positions - stop).max(axis=1))) for stop in stops]
    while True:
        way = best_way(grid, goal, (1.0 - SLACK) * seconds, start)
        found = refined_way(sweeps, goal, [grid.positions[i] for i in way], speed, seconds)
        blocked = _blocked(sweeps, found, speed)
        if not blocked:
            return found
        start = []
        for pair in blocked:
            sweeps.blocked(*pair, speed)
            grid.without(
                [(a, b) for a, b in itertools.pairwise(way) if np.all(grid.positions[[a, b]] == np.stack(pair))]
            )


def _blocked(sweeps: Sweeps, stops: Sequence[Array], speed: float) -> list[tuple[Array, Array]]:
    """Sweeps between stops on which something meets."""
    pairs = list(itertools.pairwise(stops))
    runs = [sweeps.run(np.stack(pair), speed) for pair in pairs]
    paths = [np.stack([run.commands[name] for name in sweeps.machine.axis_names], axis=1) for run in runs]
    clear = Moves(sweeps.machine, runs[0]).clear(paths)
    return [pair for pair, free in zip(pairs, clear, strict=True) if not free]


def _about(sweeps: Sweeps, goal: Goal, stops: Sequence[Array], seconds: float, count: int) -> Array:
    """The stops, and as many ends of the sweeps on which the best weights spend their time as make `count` positions."""
    offered = sweeps.offered
    weights, _ = _weighed(goal, [sweep for _, _, sweep in offered], seconds)
    spent: dict[tuple[float, ...], float] = {}
    for weight, (ends, _, _) in zip(weights, offered, strict=True):
        for end in ends:
            spent[tuple(end)] = spent.get(tuple(end), 0.0) + weight
    own = list(dict.fromkeys(tuple(stop) for stop in stops))
    others = sorted(spent.keys() - set(own), key=lambda end: -spent[end])
    return np.array([*own, *others[: max(count - len(own), count // 2)]])


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
        setups, lengths = best_setups(space, task, count, READINGS, pose_grid(space, poses))[-1]
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
    found = [*itertools.islice(draw(sweeps, TRIES, speed), COMPARED), *(sweep for *_, sweep in sweeps.offered)]
    costs = np.array([sweep.seconds for sweep in found])
    weights, _ = relaxed_bound(goal, found, costs, seconds)
    return sweeps.shared(np.tensordot(weights / costs, np.stack([sweep.matrix for sweep in found]), 1))


@dataclass(frozen=True)
class SweepCertificate:
    """`efficiency` of recordings: at least this share of the best that weights of any size on `candidates` sweeps of these
    mountings can do in the same time (in variance, per parameter); `bound` the lowest ψ these have, `speeds` degree/s."""

    efficiency: float
    bound: float
    candidates: int
    speeds: tuple[float, ...]
    mountings: int = 1

    @property
    def says(self) -> str:
        """The certificate in one sentence."""
        share = down(self.efficiency)
        speeds = ", ".join(f"{speed:g}" for speed in self.speeds)
        where = "this mounting" if self.mountings == 1 else f"these {self.mountings} mountings"
        return (
            f"efficiency ≥ {share} in the same recording time over {self.candidates} candidate sweeps in {where} at "
            f"{speeds} °/s (searched over a dense set, not proved)"
        )

    def to_data(self) -> dict[str, Any]:
        """The certificate in plan.json."""
        return {
            "says": self.says, "efficiency": six_digits(self.efficiency), "bound": six_digits(self.bound),
            "candidates": self.candidates, "speeds_deg_per_s": list(self.speeds), "rigour": "searched over a dense set",
        }  # fmt: skip


def certified(
    mounted: Sequence[Sweeps], goal: Goal, value: float, seconds: float, speeds: tuple[float, ...]
) -> SweepCertificate:
    """The certificate of recordings with ψ `value` in `seconds` altogether, against all sweeps that were evaluated."""
    bound, count = bound_of(mounted, goal, seconds), sum(len(sweeps.offered) for sweeps in mounted)
    return SweepCertificate(min(1.0, math.exp(bound - value)), bound, count, speeds, len(mounted))


def bound_of(mounted: Sequence[Sweeps], goal: Goal, seconds: float) -> float:
    """The lowest ψ of optimal seconds on all sweeps that were evaluated."""
    offered = [[sweep for _, _, sweep in sweeps.offered] for sweeps in mounted]
    offers = [
        Offered.of(some, np.array([sweep.seconds for sweep in some]), sweeps.own, sweeps.shared)
        for some, sweeps in zip(offered, mounted, strict=True)
    ]
    return optimal_weights(goal, offers, seconds)[1]
