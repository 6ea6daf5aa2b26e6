"""The certificate of several plans together: compared with any mix of instruments in the same minutes, set-up included."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from symfive.campaign import Campaign, SetupSigma
from symfive.design._assess import Assessment, assess
from symfive.design._digits import down, six_digits
from symfive.design._minutes import Mixes
from symfive.design._mountings import BAR, Mounting, mounting_of, mountings_of, with_circles
from symfive.design._request import interest_of, task_of, usual_setups
from symfive.design._result import Plan
from symfive.design._space import Space, make_space
from symfive.errors import InputError
from symfive.machine import Machine
from symfive.optimal import Task
from symfive.runs import instrument_words
from symfive.screen import plural
from symfive.threads import one_thread

INSTRUMENTS = ("r_test", "ball_bar", "touch_probe")
RATE_HZ = 50.0


@dataclass(frozen=True)
class JointCertificate:
    """Bound on how far a plan of several instruments is from the best one.

    `efficiency`: at least this share of the best with at most as many `mountings` of `instruments` in as many
    `minutes` (in variance, per parameter); `value` ψ of the plan, `bound` the lowest possible ψ; `gain`: upper bound of the ratio
    by which the variance is lower than with the relaxed design of the best single instrument; `candidates`: their number."""

    efficiency: float
    value: float
    bound: float
    gain: float
    minutes: float
    instruments: tuple[str, ...]
    candidates: int
    mountings: int

    @property
    def says(self) -> str:
        """The certificate in one sentence."""
        share, most = down(self.efficiency), math.ceil(self.gain * 1e3) / 1e3
        names = ", ".join(instrument_words(n) + (" (poses and circles)" if n == BAR else "") for n in self.instruments)
        return (
            f"efficiency ≥ {share} in {self.minutes:.3g} min with at most {plural(self.mountings, 'mounting')}, set-up "
            f"included, over {self.candidates} candidate poses and circles with {names}; together at most {most:.3f} × lower "
            "variance than the best one of them (searched over a dense set, not proved)"
        )

    def to_data(self) -> dict[str, Any]:
        """The certificate as nested mappings."""
        return {
            "says": self.says, "efficiency": six_digits(self.efficiency), "bound": six_digits(self.bound),
            "gain_over_one_instrument": six_digits(self.gain), "minutes": self.minutes,
            "instruments": list(self.instruments), "candidates": self.candidates, "mountings": self.mountings,
            "rigour": "searched over a dense set",
        }  # fmt: skip


@dataclass(frozen=True)
class Shared:
    """What instruments have in common: `spaces` by instrument, the `task`, whose set-up errors are per prior 1σ, the `mountings`
    of each and, where a ball bar is among them, of its `circles`; `refused` why the machine cannot use others; `most` mountings
    that a plan has in all."""

    spaces: dict[str, Space]
    task: Task
    mountings: tuple[Mounting, ...]
    circles: tuple[Mounting, ...]
    refused: dict[str, str]
    most: int

    @property
    def pace(self) -> float:
        """s a pose."""
        return next(iter(self.spaces.values())).machine.workspace.seconds_per_pose

    def alone(self, minutes: float) -> Mixes:
        """Mixes of poses at rest and, of their own, circles."""
        return Mixes(self.task, [*self.mountings, *self.circles], minutes, self.pace, self.most)

    def poses(self, minutes: float, progress: Callable[[str], None]) -> Mixes:
        """Mixes of poses at rest."""
        return Mixes(self.task, self.mountings, minutes, self.pace, self.most, progress)

    def joint(self, minutes: float, more: Sequence[Mounting] = ()) -> Mixes:
        """Mixes in which a mounted bar reads poses and circles; `more` mountings, of a plan."""
        bars = [m for m in self.mountings if m.kind == BAR]
        rest = [m for m in self.mountings if m.kind != BAR]
        return Mixes(self.task, [*rest, *with_circles(bars, self.circles), *more], minutes, self.pace, self.most)

    def value(self, expected: Assessment) -> float:
        """ψ of what is expected of a campaign."""
        first = next(iter(self.spaces.values()))
        index = {p.name: i for i, p in enumerate(expected.parameters)}
        place = [index[p.name] for p in first.shared]
        sigma = np.array([p.sigma for p in first.shared])
        S = expected.covariance[np.ix_(place, place)] / np.outer(sigma, sigma)
        return self.task.criterion.value(self.task.of_interest(S))


def shared_minutes(
    machine: Machine, instruments: Sequence[str] = INSTRUMENTS, *, criterion: str = "A", for_: Iterable[str] = (),
    given: Campaign | None = None, noise_um: float = 0.3, setup_sigma: SetupSigma | None = None, setups: int | None = None,
) -> Shared:  # fmt: skip
    """All mountings of these instruments on a machine; those that it cannot use are left out. `setups` mountings at most, by
    default as many as plans with each of them have. Raises `InputError` where none is left."""
    spaces: dict[str, Space] = {}
    refused: dict[str, InputError] = {}
    for name in dict.fromkeys(instruments):
        try:
            spaces[name] = make_space(machine, name, noise_um=noise_um, setup_sigma=setup_sigma)
        except InputError as error:
            refused[name] = error
    if not spaces:
        nothing = InputError("no instrument is named", remedy=f"use {', '.join(INSTRUMENTS)}")
        raise next(iter(refused.values()), nothing)
    first = next(iter(spaces.values()))
    own = max(len(space.own) for space in spaces.values())
    asked = task_of(first, criterion, interest_of(tuple(p.name for p in first.shared), tuple(for_)), given)
    mountings = [m for space in spaces.values() for m in mountings_of(space, own)]
    circles = mountings_of(spaces[BAR], own, rate_hz=RATE_HZ) if BAR in spaces else []
    why = {name: error.problem for name, error in refused.items()}
    most = setups or sum(map(usual_setups, spaces))
    return Shared(spaces, replace(asked, own_sigma=np.ones(own)), tuple(mountings), tuple(circles), why, most)


@one_thread
def certify_joint(
    plans: Sequence[Plan], *, instruments: Sequence[str] = INSTRUMENTS, criterion: str = "A", for_: Iterable[str] = (),
    given: Campaign | None = None,
) -> JointCertificate:  # fmt: skip
    """The certificate of plans that are measured one after the other, as of `first` and `plan(…, given=first.campaign)`.

    They are compared with every mix of `instruments`, and of their own, in the sum of their minutes; circles of a ball bar are
    among the candidates; `given` was measured before all of them. Raises `InputError` for plans of different machines, noise or
    set-up errors, or with options.
    """
    runs = tuple(run for made in plans for run in made.campaign.runs)
    if not runs:
        raise InputError("no plan is given", remedy="give the plans that plan() made")
    machine, first = plans[0].machine, runs[0]
    noise, names = first.noise(first.instrument[0]), tuple(made.instrument for made in plans)
    for made in plans:
        if made.machine.structure != machine.structure or made.machine.errors != machine.errors:
            raise InputError("the plans are of different machines", remedy="plan all of them for one machine")
    for run in runs:
        if run.noise(run.instrument[0]) != noise or run.setup_sigma_um != first.setup_sigma_um:
            raise InputError(f"run {run.id}: its noise or set-up errors differ", remedy="plan with the same ones")
        if run.spindle is not None or run.options:
            raise InputError(f"run {run.id}: indexing and frames are not compared", remedy="plan without them")
    shared = shared_minutes(
        machine,
        (*names, *instruments),
        setups=max(len(runs), sum(map(usual_setups, {*names, *instruments}))),
        criterion=criterion,
        for_=for_,
        given=given,
        noise_um=noise,
        setup_sigma=first.setup_sigma_um,
    )
    campaign = merged([made.campaign for made in plans])
    return certified(shared, assess(campaign, given=given), campaign, sum(made.minutes for made in plans))


def merged(campaigns: Sequence[Campaign]) -> Campaign:
    """One campaign of all, measured one after the other, each after the time of its set-up; where names of runs are taken, the
    later ones have a number before theirs."""
    whole = campaigns[0]
    for number, campaign in enumerate(campaigns[1:], start=2):
        end = max(run.start_s + run.duration for run in whole.runs)
        later = replace(campaign, runs=tuple(replace(run, start_s=end + run.start_s) for run in campaign.runs))
        taken = {run.id for run in whole.runs} & {run.id for run in later.runs}
        whole = whole.joined(later, prefix=f"{number}-" if taken else "")
    return whole


def certified(shared: Shared, expected: Assessment, campaign: Campaign, minutes: float) -> JointCertificate:
    """The certificate of a campaign of which so much is `expected`, its own mountings and poses among the candidates."""
    own, value = len(shared.task.own_sigma), shared.value(expected)
    mixes = shared.joint(minutes, [mounting_of(shared.spaces[run.instrument[0]], own, run) for run in campaign.runs])
    bound, candidates = mixes.lowest(), sum(len(m.rows) for m in mixes.mountings)
    best = min(mix.value for mix in shared.alone(minutes).single().values())
    gain = max(math.exp(best - bound), 1.0)
    return JointCertificate(
        min(1.0, math.exp(bound - value)), value, bound, gain, minutes, tuple(shared.spaces), candidates, shared.most
    )
