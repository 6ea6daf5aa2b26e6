"""`plan_joint`: several instruments in given minutes, mounted as often as is most informative, with a certificate."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from symfive.campaign import Campaign, SetupSigma
from symfive.design._assess import Assessment, assess
from symfive.design._assessment_data import assessment_data, six_digits
from symfive.design._information import Task
from symfive.design._minutes import Mixes
from symfive.design._mountings import BAR, Mounting, mounting_of, mountings_of, with_circles
from symfive.design._plan import Plan, plan
from symfive.design._request import interest_of, task_of, with_bars
from symfive.design._schedule import SETUP_S, on_ways
from symfive.design._space import Space, make_space
from symfive.errors import InputError
from symfive.given import campaign_given, machine_given
from symfive.machine import Machine
from symfive.nc import Post
from symfive.outputs import output_folder
from symfive.screen import OnScreen, listed
from symfive.threads import one_thread

__all__ = ["JointCertificate", "JointPlan", "Shared", "plan_joint", "shared_minutes"]

Array = NDArray[np.float64]
INSTRUMENTS = ("r_test", "ball_bar", "touch_probe")
RATE_HZ = 50.0
WORDS = {"r_test": "R-test", "ball_bar": "ball bar (poses and circles)", "touch_probe": "touch probe"}
SCHEMA = "symfive.joint_plan/1"


@dataclass(frozen=True)
class JointCertificate:
    """`efficiency` of a plan: at least this share of the best that any mountings of `instruments` in as many `minutes` can do
    (in variance, per parameter); `value` ψ of the plan, `bound` the lowest ψ there is; `gain` at most so many times lower is the
    variance than with the relaxed design of the best single instrument; over so many `candidates`."""

    efficiency: float
    value: float
    bound: float
    gain: float
    minutes: float
    instruments: tuple[str, ...]
    candidates: int

    @property
    def says(self) -> str:
        """The certificate in one sentence."""
        share, most = math.floor(self.efficiency * 1e3) / 1e3, math.ceil(self.gain * 1e3) / 1e3
        names = ", ".join(WORDS[name] for name in self.instruments)
        return (
            f"efficiency ≥ {share:.3f} in {self.minutes:g} min over {self.candidates} candidate poses and circles with {names}, "
            f"set-up included; together at most {most:.3f} × lower variance than the best one of them (searched over a dense "
            "set, not proved)"
        )

    def to_data(self) -> dict[str, Any]:
        """The certificate in plan.json."""
        return {
            "says": self.says, "efficiency": six_digits(self.efficiency), "bound": six_digits(self.bound),
            "gain_over_one_instrument": six_digits(self.gain), "minutes": self.minutes,
            "instruments": list(self.instruments), "candidates": self.candidates, "rigour": "searched over a dense set",
        }  # fmt: skip


@dataclass(frozen=True, repr=False)
class JointPlan(OnScreen):
    """Plans of several instruments, measured one after the other in `minutes`: their common `campaign` without readings, its
    `assessment`, the `certificate`, the single `plans` and the `post` of all programs."""

    plans: tuple[Plan, ...]
    campaign: Campaign
    assessment: Assessment
    certificate: JointCertificate
    minutes: float
    post: Post

    def to_data(self) -> dict[str, Any]:
        """plan.json as nested mappings."""
        return {
            "schema": SCHEMA, "machine": self.campaign.machine.name, "minutes": six_digits(self.minutes),
            "instruments": [made.instrument for made in self.plans], "certificate": self.certificate.to_data(),
            **assessment_data(self.assessment), "notes": [note for made in self.plans for note in made.notes],
        }  # fmt: skip

    def write(
        self, folder: Path | str, *, nc: Iterable[str] = ("iso",), post: Post | None = None, overwrite: bool = False
    ) -> None:
        """The common campaign without readings, plan.json, NC programs and set-up sheet, whole or not at all."""
        from symfive.design._write import write_joint

        with output_folder(Path(folder), overwrite=overwrite) as target:
            write_joint(self, target, tuple(nc), post)

    def __str__(self) -> str:
        names = ", ".join(made.instrument for made in self.plans)
        head = f"plan of {len(self.campaign.runs)} runs with {names}, {self.minutes:.1f} min"
        runs = [f"  {run.id}: {run.rows} rows" for run in self.campaign.runs]
        return "\n".join([head, self.certificate.says, *listed(runs, "plan.campaign.runs", 10), str(self.assessment)])


@dataclass(frozen=True)
class Shared:
    """What instruments have in common: `spaces` by instrument, the `task`, whose set-up errors are per prior 1σ, the `mountings`
    of each and, where a ball bar is among them, of its `circles`."""

    spaces: dict[str, Space]
    task: Task
    mountings: tuple[Mounting, ...]
    circles: tuple[Mounting, ...]

    @property
    def pace(self) -> float:
        """s a pose."""
        return next(iter(self.spaces.values())).machine.workspace.seconds_per_pose

    def alone(self, minutes: float) -> Mixes:
        """Mixes of poses at rest and, of their own, circles."""
        return Mixes(self.task, [*self.mountings, *self.circles], minutes, self.pace)

    def joint(self, minutes: float, more: Sequence[Mounting] = ()) -> Mixes:
        """Mixes in which a mounted bar reads poses and circles; `more` mountings, of a plan."""
        bars = [m for m in self.mountings if m.kind == BAR]
        rest = [m for m in self.mountings if m.kind != BAR]
        return Mixes(self.task, [*rest, *with_circles(bars, self.circles), *more], minutes, self.pace)


def shared_minutes(
    machine: Machine, instruments: Sequence[str] = INSTRUMENTS, *, criterion: str = "A", for_: Iterable[str] = (),
    given: Campaign | None = None, noise_um: float = 0.3, setup_sigma: SetupSigma | None = None,
) -> Shared:  # fmt: skip
    """All mountings of these instruments on a machine; those that it cannot use are left out. Raises `InputError` where none is
    left."""
    spaces: dict[str, Space] = {}
    refused: InputError | None = None
    for name in dict.fromkeys(instruments):
        try:
            spaces[name] = make_space(machine, name, noise_um=noise_um, setup_sigma=setup_sigma)
        except InputError as error:
            refused = error
    if not spaces:
        raise refused or InputError("no instrument is named", remedy=f"use {', '.join(INSTRUMENTS)}")
    first = next(iter(spaces.values()))
    own = max(len(space.own) for space in spaces.values())
    asked = task_of(first, criterion, interest_of(tuple(p.name for p in first.shared), tuple(for_)), given)
    mountings = [m for space in spaces.values() for m in mountings_of(space, own)]
    circles = mountings_of(spaces[BAR], own, rate_hz=RATE_HZ) if BAR in spaces else []
    return Shared(spaces, replace(asked, own_sigma=np.ones(own)), tuple(mountings), tuple(circles))


@one_thread
def plan_joint(
    machine: Machine | Path | str, *, minutes: float, instruments: Sequence[str] = INSTRUMENTS, criterion: str = "A",
    for_: Iterable[str] = (), given: Campaign | Path | str | None = None, lengths: Sequence[float] = (),
    noise_um: float = 0.3, setup_sigma: SetupSigma | None = None, returns: int = 2, starts: int = 2, seed: int = 0,
    progress: Callable[[str], None] = lambda message: None,
) -> JointPlan:  # fmt: skip
    """The static plan of one or several of `instruments` that makes the uncertainty smallest in `minutes`, set-up included.

    Which instrument is mounted how often follows from relaxed designs of all mixes; each is then planned as by `plan`, with what
    was planned before as known. The certificate compares with every mix of the instruments, circles of the bar included. Options
    as of `plan`; instruments that a machine cannot use are left out.

    Raises `InputError` where no instrument is left or the time is too short.
    """
    machine = with_bars(machine_given(machine), lengths)
    given = None if given is None else campaign_given(given)
    asked: dict[str, Any] = {
        "criterion": criterion,
        "for_": tuple(for_),
        "noise_um": noise_um,
        "setup_sigma": setup_sigma,
    }
    shared = shared_minutes(machine, instruments, given=given, **asked)
    alone = shared.alone(minutes)
    if not alone.all:
        raise InputError(
            f"{minutes:g} minutes are too short for one set-up and two poses",
            remedy=f"give at least {math.ceil((SETUP_S + 2.0 * shared.pace) / 60.0)} minutes",
        )
    still = Mixes(shared.task, shared.mountings, minutes, shared.pace).best()
    progress(f"mounted: {', '.join(still.kinds)}")
    plans: list[Plan] = []
    left, known = minutes, given
    for kind, count in Counter(still.kinds).items():
        read = sum(float(w.sum()) for m, w in zip(still.mountings, still.weights, strict=True) if m.kind == kind)
        last = len(plans) == len(set(still.kinds)) - 1
        share = left if last else (count * (SETUP_S - shared.pace) + read) / 60.0
        plans.append(plan(
            machine, instrument=kind, minutes=share, setups=count, points=max(2, int(60.0 * minutes / shared.pace)), given=known,
            returns=returns, starts=starts, seed=seed, anywhere=False, prove=False, progress=progress, **asked,
        ))  # fmt: skip
        left -= plans[-1].minutes
        runs = (*(() if known is None else known.runs), *plans[-1].campaign.runs)
        known = replace(plans[-1].campaign, runs=runs)
    post = _joined([made.post for made in plans])
    campaign, seconds = on_ways(
        replace(plans[0].campaign, runs=tuple(run for made in plans for run in made.campaign.runs)), post
    )
    progress("computing the certificate")
    expected = assess(campaign, given=given)
    return JointPlan(
        tuple(plans), campaign, expected, certified(shared, campaign, expected, minutes), seconds / 60.0, post
    )


def certified(shared: Shared, campaign: Campaign, expected: Assessment, minutes: float) -> JointCertificate:
    """The certificate of a campaign in `minutes`, its own mountings and poses among the candidates."""
    first = next(iter(shared.spaces.values()))
    names, own = [p.name for p in first.shared], len(shared.task.own_sigma)
    index = {p.name: i for i, p in enumerate(expected.parameters)}
    place = [index[name] for name in names]
    sigma = np.array([p.sigma for p in first.shared])
    S = expected.covariance[np.ix_(place, place)] / np.outer(sigma, sigma)
    value = shared.task.criterion.value(shared.task.of_interest(S))
    mixes = shared.joint(minutes, [mounting_of(shared.spaces[run.instrument[0]], own, run) for run in campaign.runs])
    bound = mixes.lowest()
    alone = shared.alone(minutes)
    gain = math.exp(min(alone.single().values(), key=lambda mix: mix.value).value - bound)
    candidates = sum(len(m.rows) for m in mixes.mountings)
    return JointCertificate(
        min(1.0, math.exp(bound - value)), value, bound, max(gain, 1.0), minutes, tuple(shared.spaces), candidates
    )


def _joined(posts: Sequence[Post]) -> Post:
    """The paths of the programs of several plans."""
    via = {run: ways for post in posts for run, ways in post.via.items()}
    unsafe = {run: rows for post in posts for run, rows in post.unsafe.items()}
    around = {run: ways for post in posts for run, ways in post.ways.items()}
    return replace(posts[0], via=via, unsafe=unsafe, ways=around, tested=all(post.tested for post in posts))
