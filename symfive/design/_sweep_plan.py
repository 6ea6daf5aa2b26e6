"""`plan_sweeps`: an R-test or a ball bar read on the way, as one recording of one mounting in given minutes.

The rotary axes turn straight from stop to stop at a constant speed, one alone or several together, and the linear axes keep the
ball in its nest, or the bar at its length; a bar swings with them in its azimuth and elevation. The mounting is the best one for
poses at rest. Decided are the stops, their order, and the speed (`_sweep_search`). The certificate compares the recording with
optimal seconds on a dense set of sweeps (`relaxed_bound`), as for circles: what lies between these is not proved.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from symfive.arrays import Array, Flags
from symfive.campaign import Campaign, SetupSigma
from symfive.design._assess import Assessment, assess
from symfive.design._assessment_data import assessment_data, six_digits
from symfive.design._candidates import best_setups, candidates_in, pose_grid
from symfive.design._circle_certificate import relaxed_bound
from symfive.design._circles import Goal
from symfive.design._reach import Reach
from symfive.design._request import check_counts, interest_of, task_of
from symfive.design._schedule import SETUP_S
from symfive.design._space import make_space
from symfive.design._sweep_search import Grid, best_way, draw, grid_of, positions_of, refined_way
from symfive.design._sweeps import SHORTEST, Sweep, Sweeps
from symfive.design._write import SCHEMA, write_recordings
from symfive.effects import Effect
from symfive.errors import InputError
from symfive.given import machine_given
from symfive.inference import Noise
from symfive.machine import Machine
from symfive.model import effect_to_data
from symfive.moves import Moves
from symfive.nc import LETTERS, Post
from symfive.optimal import Task, relax
from symfive.outputs import output_folder
from symfive.procedures import DWELL_S, campaign_of
from symfive.screen import OnScreen, listed
from symfive.threads import one_thread

__all__ = ["SweepCertificate", "SweepPlan", "plan_sweeps"]


@dataclass(frozen=True)
class _Kind:
    """An instrument: its `name`, the `poses` at rest by which its mounting is chosen and with which its sweeps are compared, and
    the sweeps `drawn` at random beside those of the grid, which is coarse where a bar adds two variables."""

    name: str
    poses: int
    drawn: int


INSTRUMENTS = {"r_test": _Kind("R-test", 200, 0), "ball_bar": _Kind("ball bar", 2000, 10_000)}
SPEEDS = (5.0, 10.0, 20.0)
SLOW_S = 1.0
"""Correlation time of the slow noise where none is given, s: `identify` finds 0.27 µm and 1.07 s, beside 0.30 µm of white noise,
in the circular tests of `tests/data/campaigns/planar-none`. State your own: it prints them for every recording."""
ROUNDS = 2
READINGS = 200
"""With which mountings are compared."""
SAMPLE = 60
"""Sweeps by which speeds are compared."""
REMEDY = "what helps: a lower speed, a longer tool, more travel, a lower sigma of the errors"
SLACK = 0.01
"""Share of the time that is left to moving the stops off the grid."""


@dataclass(frozen=True)
class SweepCertificate:
    """`efficiency` of a recording: at least this share of the best that weights of any size on `candidates` sweeps of this
    mounting can do in the same time (in variance, per parameter); `bound` the lowest ψ these have, `speeds` degree/s."""

    efficiency: float
    bound: float
    candidates: int
    speeds: tuple[float, ...]

    @property
    def says(self) -> str:
        """The certificate in one sentence."""
        share = math.floor(self.efficiency * 1e3) / 1e3
        speeds = ", ".join(f"{speed:g}" for speed in self.speeds)
        return (
            f"efficiency ≥ {share:.3f} in the same recording time over {self.candidates} candidate sweeps in this mounting at "
            f"{speeds} °/s (searched over a dense set, not proved)"
        )

    def to_data(self) -> dict[str, Any]:
        """The certificate in plan.json."""
        return {
            "says": self.says, "efficiency": six_digits(self.efficiency), "bound": six_digits(self.bound),
            "candidates": self.candidates, "speeds_deg_per_s": list(self.speeds), "rigour": "searched over a dense set",
        }  # fmt: skip


@dataclass(frozen=True, repr=False)
class SweepPlan(OnScreen):
    """Sweeps in one recording: the `campaign` without readings; `stops` (n, axes), degree, of the rotary `axes` and, of a ball
    bar, its azimuth and elevation in the workpiece frame, between which they turn at `speed` degree/s; `effects` that an
    identification has to free with the geometry (lag and delay); `value` the ψ of `criterion`; `at_rest` by how much the variance
    of poses at rest is larger in the same mounting and the same minutes, at least; the `assessment` with the correlated
    `noise`."""

    campaign: Campaign
    criterion: str
    axes: tuple[str, ...]
    stops: Array
    speed: float
    effects: tuple[Effect, ...]
    noise: Noise
    value: float
    certificate: SweepCertificate | None
    at_rest: float
    assessment: Assessment
    notes: tuple[str, ...] = ()

    @property
    def instrument(self) -> str:
        """What reads."""
        return self.campaign.runs[0].instrument[0]

    @property
    def minutes(self) -> float:
        """Time of the recording and the mounting."""
        return (SETUP_S + self.campaign.runs[0].duration) / 60.0

    def to_data(self) -> dict[str, Any]:
        """plan.json as nested mappings; `effects` as `symfive identify --effects` reads them."""
        noise = self.noise
        return {
            "schema": SCHEMA, "machine": self.campaign.machine.name, "instrument": self.instrument,
            "criterion": {"name": self.criterion, "value": six_digits(self.value)},
            "certificate": None if self.certificate is None else self.certificate.to_data(),
            "minutes": six_digits(self.minutes), "speed_deg_per_s": self.speed, "axes": list(self.axes),
            "stops_deg": self.stops.tolist(), "variance_at_rest": six_digits(self.at_rest),
            "noise": {"white_um": noise.white, "coloured_um": noise.coloured, "correlation_s": noise.time_constant},
            "effects": [effect_to_data(effect) for effect in self.effects],
            **assessment_data(self.assessment), "notes": list(self.notes),
        }  # fmt: skip

    def write(
        self, folder: Path | str, *, nc: Iterable[str] = ("iso",), post: Post | None = None, overwrite: bool = False
    ) -> None:
        """The campaign without readings, plan.json, NC programs and set-up sheet, whole or not at all."""
        worth = ". ".join(note[:1].upper() + note[1:] for note in self._says)
        with output_folder(Path(folder), overwrite=overwrite) as target:
            write_recordings(self.campaign, self.assessment, self.to_data(), target, tuple(nc), post, worth)

    @property
    def _says(self) -> list[str]:
        more = f"variance ({self.criterion}) at least {self.at_rest:.2f} times as large"
        rest = f"poses at rest in the same mounting and minutes: {more}"
        return [*([] if self.certificate is None else [f"certificate: {self.certificate.says}"]), rest, *self.notes]

    def __str__(self) -> str:
        run = self.campaign.runs[0]
        ball = tuple(round(v) for v in run.table_ball)
        bar = "" if run.length is None else f", bar {run.length:g} mm"
        head = [
            f"{INSTRUMENTS[self.instrument].name} in motion, {len(self.stops) - 1} sweeps at {self.speed:g} °/s in one "
            f"recording of {run.duration:.0f} s, {self.minutes:.1f} min with set-up",
            f"  ball at {ball} mm, tool {-run.tool_ball[2]:g} mm{bar}",
        ]
        stops = [" ".join(f"{n} {v:g}°" for n, v in zip(self.axes, stop, strict=True)) for stop in self.stops]
        ways = [f"  {before} to {after}" for before, after in itertools.pairwise(stops)]
        return "\n".join(
            [*head, *listed(ways, "plan.stops", 10), *listed(self._says, "plan.notes", 10), str(self.assessment)]
        )


@one_thread
def plan_sweeps(
    machine: Machine | Path | str, *, instrument: str = "r_test", minutes: float = 8.0, criterion: str = "D",
    for_: Iterable[str] = (), speeds: Sequence[float] = SPEEDS, noise_um: float = 0.3, coloured_um: float | None = None,
    correlation_s: float = SLOW_S, rate_hz: float = 50.0, setup_sigma: SetupSigma | None = None, certify: bool = True,
) -> SweepPlan:  # fmt: skip
    """The most informative sweeps of the rotary axes, and of a `ball_bar`'s direction, in `minutes`, 5 min of mounting included,
    and their certificate.

    `speeds` degree/s to choose from, of the axis (or angle of the bar) that turns most; `noise_um` 1σ of the white noise,
    `coloured_um` (default: as large) and `correlation_s` those of the slow one; `for_` the errors that count (default: all);
    `setup_sigma` as in `plan`; `certify` compares the recording with a dense set of sweeps. Lag of the drives and delay of the
    recording are nuisance parameters. Raises `InputError` where nothing can be planned.
    """
    machine, noise = machine_given(machine), _noise_of(noise_um, coloured_um, correlation_s)
    if instrument not in INSTRUMENTS:
        raise InputError(f"sweeps with {instrument} are not planned", remedy="use instrument r_test or ball_bar")
    if not speeds or not all(0.0 < speed < math.inf for speed in speeds):
        raise InputError("a speed of the sweeps is not positive", remedy="give speeds in degree/s, as 10")
    check_counts(machine, {})
    space = make_space(machine, instrument, noise_um=noise_um, setup_sigma=setup_sigma)
    names = [p.name for p in space.shared]
    task = task_of(space, criterion, interest_of(names, tuple(for_)), None)
    seconds = 60.0 * minutes - SETUP_S - DWELL_S
    if seconds < 2.0 * SHORTEST * correlation_s:
        raise InputError(
            f"{minutes:g} min leave no time beside the mounting, {SETUP_S / 60.0:g} min", remedy="give more minutes"
        )
    (setup,), ((length,),) = best_setups(space, task, 1, READINGS, pose_grid(space, INSTRUMENTS[instrument].poses))
    sweeps = Sweeps(space, setup, float(length), noise, rate_hz)
    goal = Goal(
        task.criterion, np.array([sweeps.model.index[names[i]] for i in task.interest]), sweeps.model.prior_sigma
    )
    speed, stops = _searched(sweeps, goal, sorted(speeds), seconds)
    run, information = sweeps.recorded(stops, speed)
    value = goal.psi(information)
    certificate = _certified(sweeps, goal, value, run.duration, tuple(sorted(speeds))) if certify else None
    campaign = campaign_of(machine, (run,), "sweeps")
    at_rest = _at_rest(sweeps, task, run.duration)
    return SweepPlan(
        campaign, criterion, sweeps.names, np.stack(stops), speed, sweeps.effects, noise, value, certificate,
        math.exp(at_rest - value), assess(campaign, effects=sweeps.effects, noise=noise), tuple(_notes(sweeps, speed, speeds)),
    )  # fmt: skip


def _noise_of(white: float, coloured: float | None, correlation_s: float) -> Noise:
    slow = white if coloured is None else coloured
    if not (white > 0.0 and slow >= 0.0 and correlation_s > 0.0):
        raise InputError("the noise is not described", remedy="give 1σ and correlation time above 0")
    return Noise(white, slow, correlation_s, white)


def _sample(positions: Array) -> Array:
    """Some pairs of positions (n, 2, axes)."""
    pairs = np.array(list(itertools.permutations(range(len(positions)), 2))).reshape(-1, 2)
    drawn: Array = positions[np.random.default_rng(0).permutation(pairs)[:SAMPLE]]
    return drawn


def _searched(sweeps: Sweeps, goal: Goal, speeds: Sequence[float], seconds: float) -> tuple[float, list[Array]]:
    """Speed and stops of the best recording found. Raises `InputError` where no sweep is possible."""
    positions, step = positions_of(sweeps)
    speed = _best_speed(sweeps, goal, positions, speeds, seconds)
    draw(sweeps, INSTRUMENTS[sweeps.space.instrument].drawn, speed)
    stops: list[Array] = []
    for _ in range(ROUNDS):
        grid = grid_of(sweeps, positions, step, _ends(sweeps, positions), speed)
        if not np.isfinite(grid.seconds[np.ix_(grid.ends, grid.ends)]).any():
            raise InputError("no sweep is clear of all limits", remedy=REMEDY)
        stops = _clear_way(sweeps, goal, grid, stops, speed, seconds)
        positions = _about(sweeps, goal, stops, seconds, len(positions))
    return speed, stops


def _best_speed(sweeps: Sweeps, goal: Goal, positions: Array, speeds: Sequence[float], seconds: float) -> float:
    """The speed on which the best weights spend most of the time, of some sweeps at every speed."""
    for a, b in _sample(positions):
        for speed in speeds:
            sweeps.between(a, b, speed)
    offered = sweeps.offered
    if not offered:
        raise InputError("no sweep is clear of all limits", remedy=REMEDY)
    weights, _ = _weighed(goal, [sweep for _, _, sweep in offered], seconds)
    spent = {speed: sum(w for w, (_, own, _) in zip(weights, offered, strict=True) if own == speed) for speed in speeds}
    return max(spent, key=lambda speed: spent[speed])


def _weighed(goal: Goal, offered: Sequence[Sweep], seconds: float) -> tuple[Array, float]:
    return relaxed_bound(goal, offered, np.array([sweep.seconds for sweep in offered]), seconds)


def _ends(sweeps: Sweeps, positions: Array) -> Flags:
    """Positions (n,) with an exit path, in which the instrument can be mounted."""
    if not set(sweeps.machine.axis_names) <= set(LETTERS):
        return np.ones(len(positions), dtype=bool)
    return np.array([not what for what in Reach(sweeps.space).in_the_way(*sweeps.poses(positions))])


def _clear_way(
    sweeps: Sweeps, goal: Goal, grid: Grid, stops: Sequence[Array], speed: float, seconds: float
) -> list[Array]:  # fmt: skip
    """The best stops on a grid, then off it; a sweep on which bodies meet is no longer offered."""
    start = [int(np.argmin(np.abs(grid.positions - stop).max(axis=1))) for stop in stops]
    while True:
        way = best_way(grid, goal, (1.0 - SLACK) * seconds, start)
        found = refined_way(sweeps, goal, [grid.positions[i] for i in way], grid.step, speed, seconds)
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


def _certified(
    sweeps: Sweeps, goal: Goal, value: float, seconds: float, speeds: tuple[float, ...]
) -> SweepCertificate:  # fmt: skip
    offered = [sweep for _, _, sweep in sweeps.offered]
    bound = _weighed(goal, offered, seconds)[1]
    return SweepCertificate(min(1.0, math.exp(bound - value)), bound, len(offered), speeds)


def _at_rest(sweeps: Sweeps, task: Task, seconds: float) -> float:
    """The lowest ψ of poses at rest in this mounting, with weights of any size, each in the workspace's `seconds_per_pose`."""
    space, length = sweeps.space, np.array([[sweeps.length]])
    candidates = candidates_in(space, sweeps.setup[None], length, pose_grid(space, INSTRUMENTS[space.instrument].poses))
    return relax(task, candidates, 1, seconds / space.machine.workspace.seconds_per_pose).bound


def _notes(sweeps: Sweeps, speed: float, speeds: Sequence[float]) -> Iterable[str]:
    without = [name for name, axis in sweeps.machine.axes.items() if axis.drive is None]
    if without:
        yield f"no lag of {', '.join(without)} is considered: the machine file has no drive of it"
    if len(speeds) > 1 and speed == max(speeds):
        yield f"{speed:g} °/s is the largest speed offered, not a limit of the machine"
    yield "identify with --effects plan.json: lag of the drives and delay of the recording are estimated with the geometry"
