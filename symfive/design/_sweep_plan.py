"""`plan_sweeps`: an R-test or a ball bar read on the way, one recording in every mounting, in given minutes.

The rotary axes turn straight from stop to stop at a constant speed, one alone or several together, and the linear axes keep the
ball in its nest, or the bar at its length; a bar swings with them in its azimuth and elevation. Decided are the mountings and
their number (`_sweep_recordings`), the speed, the stops and their order (`_sweep_recordings`, `_sweep_search`). The certificate
compares the recordings with optimal seconds on a dense set of sweeps (`_sweep_recordings`): what lies between these is not
proved.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from symfive.arrays import Array
from symfive.campaign import Campaign, Run, SetupSigma
from symfive.design._assess import Assessment, assess, assessment_data, machine_information
from symfive.design._candidates import candidates_in, pose_grid
from symfive.design._circles import Goal
from symfive.design._digits import six_digits
from symfive.design._optimal_weights import together
from symfive.design._request import check_counts, check_given, check_minutes, interest_of, task_of, with_bars
from symfive.design._schedule import SETUP_S
from symfive.design._space import Space, make_space
from symfive.design._sweep_recordings import (
    MOST,
    SLOWEST,
    Recording,
    SweepCertificate,
    bound_of,
    certified,
    mountings_that_pay,
)
from symfive.design._sweeps import (
    DELAY_MS,
    SHORTEST,
    SLOW_S,
    Sweeps,
    noise_data,
    nuisances,
    recording_noise,
    without_drive,
)
from symfive.design._write import SCHEMA, Written, write_recordings
from symfive.effects import Effect
from symfive.errors import InputError
from symfive.given import campaign_given, machine_given
from symfive.inference import Noise
from symfive.machine import Machine
from symfive.model import effect_to_data
from symfive.nc import Post
from symfive.optimal import Task, relax
from symfive.procedures import DWELL_S, campaign_of
from symfive.runs import instrument_words
from symfive.screen import listed, plural
from symfive.threads import one_thread


@dataclass(frozen=True)
class _Kind:
    """Of an instrument, the `poses` at rest with which its sweeps are compared, and the sweeps `drawn` at random beside those of
    the grid, which is coarse where a bar adds two variables."""

    poses: int
    drawn: int


INSTRUMENTS = {"r_test": _Kind(200, 0), "ball_bar": _Kind(2000, 10_000)}
SPEEDS = (5.0, 10.0, 20.0)
ROUNDS = 2
LONGEST_S = 3600.0
"""Of one recording: a plan in motion goes back to no first position, so drift (ISO 230-3 tests it over an hour) is not seen."""


@dataclass(frozen=True, repr=False)
class SweepPlan(Written):
    """Sweeps in one recording or several, each in a mounting of its own: the `campaign` without readings; of every run the
    `stops` (n, axes), degree, of the rotary `axes` and, of a ball bar, its azimuth and elevation in the workpiece frame, and the
    speed (`speeds`), degree/s, at which they turn; `effects` that an identification has to free with the geometry (lag, and the
    delay of a single recording: of several each has its own in its set-up); `value` the ψ of `criterion`; `at_rest` by how much
    the variance of poses at rest is larger in the same mountings and minutes, at least; the `assessment` with the correlated
    `noise`."""

    campaign: Campaign
    criterion: str
    axes: tuple[str, ...]
    stops: tuple[Array, ...]
    speeds: tuple[float, ...]
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
        """Time of the recordings and the mountings."""
        return sum(SETUP_S + run.duration for run in self.campaign.runs) / 60.0

    def to_data(self) -> dict[str, Any]:
        """plan.json as nested mappings; `effects` as `symfive identify --effects` reads them."""
        recordings = [
            {"run": run.id, "speed_deg_per_s": speed, "stops_deg": stops.tolist()}
            for run, speed, stops in zip(self.campaign.runs, self.speeds, self.stops, strict=True)
        ]
        return {
            "schema": SCHEMA, "machine": self.campaign.machine.name, "instrument": self.instrument,
            "criterion": {"name": self.criterion, "value": six_digits(self.value)},
            "certificate": None if self.certificate is None else self.certificate.to_data(),
            "minutes": six_digits(self.minutes), "axes": list(self.axes), "recordings": recordings,
            "variance_at_rest": six_digits(self.at_rest),
            "noise": noise_data(self.noise),
            "effects": [effect_to_data(effect) for effect in self.effects],
            **assessment_data(self.assessment), "notes": list(self.notes),
        }  # fmt: skip

    def _write_into(self, folder: Path, nc: tuple[str, ...], post: Post | None) -> None:
        worth = ". ".join(note[:1].upper() + note[1:] for note in self._says)
        write_recordings(self.campaign, self.assessment, self.to_data(), folder, nc, post, worth)

    @property
    def _says(self) -> list[str]:
        more = f"variance ({self.criterion}) at least {self.at_rest:.2f} times as large"
        where = "mounting" if len(self.stops) == 1 else "mountings"
        rest = f"poses at rest in the same {where} and minutes: {more}"
        return [*([] if self.certificate is None else [f"certificate: {self.certificate.says}"]), rest, *self.notes]

    def __str__(self) -> str:
        count = len(self.stops)
        several = "one recording" if count == 1 else f"{count} recordings, each in a mounting of its own"
        sweeps = sum(len(stops) - 1 for stops in self.stops)
        seconds = sum(run.duration for run in self.campaign.runs)
        head = (
            f"{instrument_words(self.instrument)} in motion, {sweeps} sweeps in {several}, {seconds:.0f} s, "
            f"{self.minutes:.1f} min with set-up"
        )
        return "\n".join([head, *self._ways(), *listed(self._says, "plan.notes", 10), str(self.assessment)])

    def _ways(self) -> Iterable[str]:
        """Mounting and sweeps of every recording."""
        for run, speed, stops in zip(self.campaign.runs, self.speeds, self.stops, strict=True):
            ball = tuple(round(v) for v in run.table_ball)
            bar = "" if run.length is None else f", bar {run.length:g} mm"
            yield f"  {run.id}: ball at {ball} mm, tool {-run.tool_ball[2]:g} mm{bar}, {speed:g} °/s"
            named = [" ".join(f"{n} {v:g}°" for n, v in zip(self.axes, stop, strict=True)) for stop in stops]
            ways = [f"  {before} to {after}" for before, after in itertools.pairwise(named)]
            yield from listed(ways, "plan.stops", 10)


@one_thread
def plan_sweeps(
    machine: Machine | Path | str, *, instrument: str = "r_test", minutes: float = 8.0, criterion: str = "D",
    for_: Iterable[str] = (), given: Campaign | Path | str | None = None, setups: int | None = None,
    lengths: Sequence[float] = (), speeds: Sequence[float] = SPEEDS, noise_um: float = 0.3, coloured_um: float | None = None,
    correlation_s: float = SLOW_S, rate_hz: float = 50.0, setup_sigma: SetupSigma | None = None, certify: bool = True,
    progress: Callable[[str], None] = lambda message: None,
) -> SweepPlan:  # fmt: skip
    """The most informative sweeps of the rotary axes, and of a `ball_bar`'s direction, in `minutes`, 5 min for every mounting
    included, and their certificate.

    `speeds` degree/s to choose from, of the axis (or angle of the bar) that turns most; `noise_um` 1σ of the white noise,
    `coloured_um` (default: as large) and `correlation_s` those of the slow one; `for_` the errors that count (default: all);
    `given` a campaign already measured on this machine; `setups` at most so many mountings (default: as many as pay); `lengths`
    the bars that the user owns, mm (default: the machine file's); `setup_sigma` as in `plan`; `certify` compares the recordings
    with a dense set of sweeps. A recording lasts an hour at most. Lag of the drives and the delay of every recording are nuisance
    parameters. Raises `InputError` where nothing can be planned.
    """
    machine, noise = with_bars(machine_given(machine), lengths), recording_noise(noise_um, coloured_um, correlation_s)
    if instrument not in INSTRUMENTS:
        raise InputError(f"sweeps with {instrument} are not planned", remedy="use instrument r_test or ball_bar")
    if not speeds or not all(SLOWEST <= speed < math.inf for speed in speeds):
        problem = f"a speed of the sweeps is below {SLOWEST:g} °/s, at which a turn takes an hour"
        raise InputError(problem, remedy="give speeds in degree/s, as 10")
    check_counts(machine, {"setups": setups})
    check_minutes(minutes)
    seconds = _seconds_in(minutes, SHORTEST * correlation_s, setups or MOST)
    speeds = tuple(sorted(speeds))
    space = make_space(machine, instrument, noise_um=noise_um, setup_sigma=setup_sigma)
    before = None if given is None else _given(given, machine)
    task, goal = _asked(space, criterion, tuple(for_), before, noise)
    recordings = _searched(space, task, goal, noise, rate_hz, speeds, seconds, setups, progress)
    mounted = [recording.sweeps for recording in recordings]
    apart = len(recordings) > 1 or before is not None
    found = [recording.sweeps.recorded(recording.stops, recording.speed) for recording in recordings]
    runs = tuple(_named(run, i, len(found), apart) for i, (run, _) in enumerate(found))
    totals, whole = [total for _, total in found], sum(run.duration for run in runs)
    value = together([sweeps.shared for sweeps in mounted], goal, totals)[0].psi(totals[0])
    progress("computing the certificate")
    certificate = certified(mounted, goal, value, whole, speeds) if certify else None
    campaign, effects = campaign_of(machine, runs, "sweeps"), nuisances(machine, delay=not apart)
    return SweepPlan(
        campaign, criterion, mounted[0].names, tuple(np.stack(recording.stops) for recording in recordings),
        tuple(recording.speed for recording in recordings), effects, noise, value, certificate,
        math.exp(_at_rest(mounted, task, whole) - value), assess(campaign, effects=effects, given=before, noise=noise),
        tuple(_notes(machine, recordings, speeds)),
    )  # fmt: skip


def _named(run: Run, i: int, count: int, apart: bool) -> Run:
    """The run of recording `i` of so many; its delay is its own where there are several."""
    name = "sweeps" if count == 1 else f"sweeps-{i + 1}"
    return replace(run, id=name, file=f"{name}.csv", clock_sigma_ms=DELAY_MS if apart else 0.0)


def _seconds_in(minutes: float, least: float, most: int) -> Callable[[int], float]:
    """Seconds that so many mountings, `most` of them, leave each recording, an hour at most and 0 where two sweeps do not fit.
    Raises `InputError` where one has no time, or all together have more."""

    def seconds(count: int) -> float:
        left = min(60.0 * minutes / count - SETUP_S - DWELL_S, LONGEST_S)
        return left if left >= 2.0 * least else 0.0

    if not seconds(1):
        raise InputError(
            f"{minutes:g} min leave no time beside the mounting, {SETUP_S / 60.0:g} min", remedy="give more minutes"
        )
    longest = most * (SETUP_S + DWELL_S + LONGEST_S) / 60.0
    if minutes > longest:
        problem = (
            f"{minutes:g} min are more than {plural(most, 'recording')} can use: one lasts an hour at most, since sweeps do not "
            "go back to a first position and so do not show drift"
        )
        raise InputError(problem, remedy=f"give at most {math.floor(longest)} minutes, or more setups")
    return seconds


def _given(given: Campaign | Path | str, machine: Machine) -> Campaign:
    """The campaign measured before, each of its recordings with a delay of its own. Raises `InputError`."""
    campaign = campaign_given(given)
    check_given(campaign, machine)
    runs = [replace(r, clock_sigma_ms=r.clock_sigma_ms or DELAY_MS) if r.dynamic else r for r in campaign.runs]
    return replace(campaign, runs=tuple(runs))


def _asked(
    space: Space, criterion: str, wanted: tuple[str, ...], given: Campaign | None, noise: Noise
) -> tuple[Task, Goal]:
    """The task of poses at rest and the goal of recordings, both with what a campaign `given` tells."""
    names = [p.name for p in space.shared]
    task = task_of(space, criterion, interest_of(names, wanted), None)
    model = Sweeps(space, space.lower[space.poses :], space.lengths[0], noise, 1.0).model
    goal = Goal(task.criterion, np.array([model.index[names[i]] for i in task.interest]), model.prior_sigma)
    if given is None:
        return task, goal
    effects = nuisances(space.machine, delay=False)
    shared = [i for i, p in enumerate(model.parameters) if p.kind != "setup" and not p.name.startswith("latency.")]
    known = np.zeros((len(model.parameters),) * 2)
    told = machine_information(given, [model.parameters[i].name for i in shared], effects, noise)
    known[np.ix_(shared, shared)] = told
    place = np.array([model.index[name] for name in names])
    sigma = np.array([p.sigma for p in space.shared])
    rested = replace(task, prior=task.prior + known[np.ix_(place, place)] * np.outer(sigma, sigma))
    return rested, replace(goal, known=known)


def _searched(
    space: Space, task: Task, goal: Goal, noise: Noise, rate_hz: float, speeds: tuple[float, ...],
    seconds: Callable[[int], float], most: int | None, progress: Callable[[str], None],
) -> list[Recording]:  # fmt: skip
    """The recordings in the best mountings: as many as pay by optimal seconds, or fewer as long as these lose less by it than
    whole sweeps had lost with more. Raises `InputError` where no sweep is possible."""
    poses = INSTRUMENTS[space.instrument].poses
    best: list[Recording] = []
    value = price = math.inf
    before = -math.inf
    for optimal, mountings in reversed(
        mountings_that_pay(space, task, goal, noise, rate_hz, poses, speeds, seconds, most or MOST, progress)
    ):
        if best and optimal - before >= price:
            break
        recordings, reached = _recorded(mountings, goal, speeds, seconds(len(mountings)), progress)
        if reached < value:
            value, best = reached, recordings
        whole = len(mountings) * seconds(len(mountings))
        price, before = reached - bound_of([sweeps for sweeps, _ in mountings], goal, whole), optimal
    return best


def _recorded(
    mountings: Sequence[tuple[Sweeps, Array]],
    goal: Goal,
    speeds: tuple[float, ...],
    seconds: float,
    progress: Callable[[str], None],
) -> tuple[list[Recording], float]:
    """A recording of so many seconds in each mounting, each searched with what the others tell, and ψ of all."""
    told = [mine for _, mine in mountings]
    recordings = [
        Recording(sweeps, goal, speeds, seconds, INSTRUMENTS[sweeps.space.instrument].drawn) for sweeps, _ in mountings
    ]
    for turn, i in itertools.product(range(ROUNDS), range(len(recordings))):
        progress(f"{seconds / 60.0:.0f} min, recording {i + 1} of {len(recordings)}: round {turn + 1} of {ROUNDS}")
        others = sum(told[:i]) + sum(told[i + 1 :])
        told[i] = recordings[i].improve(replace(goal, known=goal.known + others), seconds)
    return recordings, goal.psi(sum(told, np.zeros_like(told[0])))


def _at_rest(mounted: Sequence[Sweeps], task: Task, seconds: float) -> float:
    """The lowest ψ of poses at rest in these mountings, with weights of any size, each in the workspace's `seconds_per_pose`."""
    space, setups = mounted[0].space, np.stack([sweeps.setup for sweeps in mounted])
    lengths = np.array([[sweeps.length] for sweeps in mounted])
    candidates = candidates_in(space, setups, lengths, pose_grid(space, INSTRUMENTS[space.instrument].poses))
    return relax(task, candidates, len(mounted), seconds / space.machine.workspace.seconds_per_pose).bound


def _notes(machine: Machine, recordings: Sequence[Recording], speeds: Sequence[float]) -> Iterable[str]:
    yield from without_drive(machine)
    if len(speeds) > 1 and any(recording.speed == max(speeds) for recording in recordings):
        yield f"{max(speeds):g} °/s is the largest speed offered, not a limit of the machine"
    yield "identify with --effects plan.json: lag of the drives and delay of the recording are estimated with the geometry"
