"""Several instruments in one plan: how often each is mounted in the given minutes, and what each then reads.

Relaxed designs (`_minutes`) divide the minutes. Where several instruments gain more than these are exact to, the plan of each is
made to complement those before it, and the first one once more when the others are known. The plan of the best single instrument
competes with that: whole poses may reach less than weights promise.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any

from symfive.campaign import Campaign, SetupSigma
from symfive.design._assess import Assessment, assess, assessment_data
from symfive.design._digits import six_digits
from symfive.design._joint_certificate import INSTRUMENTS, JointCertificate, certified, merged, shared_minutes
from symfive.design._minutes import GAP, Mix
from symfive.design._plan import plan
from symfive.design._request import MOST, check_counts, check_minutes
from symfive.design._result import Plan
from symfive.design._schedule import SETUP_S
from symfive.design._sheet import Sheet
from symfive.design._write import SCHEMA, Written, write_plan
from symfive.errors import InputError
from symfive.given import campaign_given, machine_given
from symfive.machine import Machine
from symfive.nc import Post
from symfive.runs import instrument_words
from symfive.screen import listed
from symfive.threads import one_thread


@dataclass(frozen=True, repr=False)
class JointPlan(Written):
    """Plans of different instruments for one machine: `parts` in the order of measurement; their `certificate`, None
    if not asked for; the `assessment` of all of their runs and of the campaign given before; `left_out`: why other
    instruments are not used."""

    parts: tuple[Plan, ...]
    certificate: JointCertificate | None
    assessment: Assessment
    left_out: tuple[str, ...] = ()

    @property
    def machine(self) -> Machine:
        """The machine of all parts."""
        return self.parts[0].machine

    @cached_property
    def campaign(self) -> Campaign:
        """All runs, one after the other, without readings."""
        return merged([part.campaign for part in self.parts])

    @property
    def minutes(self) -> float:
        """Time of all parts, set-up included."""
        return sum(part.minutes for part in self.parts)

    @property
    def steps(self) -> list[str]:
        """What is measured with which instrument, in this order."""
        return [_step(part) for part in self.parts]

    @property
    def notes(self) -> tuple[str, ...]:
        """Why instruments are not used, and what the parts say of themselves."""
        own = (f"{instrument_words(part.instrument)}: {note}" for part in self.parts for note in part.notes)
        return (*self.left_out, *own)

    def driven(self, post: Post | None) -> JointPlan:
        """The plan with the user's choices for its programs, and its times on their ways."""
        return self if post is None else replace(self, parts=tuple(part.driven(post) for part in self.parts))

    @property
    def post(self) -> Post:
        """The ways of all programs."""
        first, posts = self.parts[0].post, [part.post for part in self.parts]
        return replace(
            first, tested=all(p.tested for p in posts), retract_mm=max(p.retract_mm for p in posts),
            via=_all(p.via for p in posts), unsafe=_all(p.unsafe for p in posts), ways=_all(p.ways for p in posts),
        )  # fmt: skip

    def _write_into(self, folder: Path, nc: tuple[str, ...], post: Post | None) -> None:
        plan = self.driven(post)
        ways = [note for note in plan.notes if ": run " in note]
        certificate = [] if plan.certificate is None else [f"Certificate: {plan.certificate.says}"]
        worth = ". ".join([*certificate, *(note for note in plan.notes if note not in ways)])
        facts = f"{', then '.join(plan.steps)} with set-up"
        sheet = Sheet(
            campaign=plan.campaign, post=plan.post, facts=facts, worth=worth, assessment=plan.assessment, notes=ways
        )
        write_plan(sheet, plan.to_data(), folder, nc)

    def to_data(self) -> dict[str, Any]:
        """plan.json as nested mappings."""
        return {
            "schema": SCHEMA, "machine": self.machine.name, "structure": self.machine.structure.code,
            "instruments": [part.instrument for part in self.parts],
            "criterion": {"name": self.parts[0].criterion, "for": list(self.parts[0].interest)},
            "certificate": None if self.certificate is None else self.certificate.to_data(), **assessment_data(self.assessment),
            "minutes": six_digits(self.minutes),
            "parts": [
                {
                    "instrument": part.instrument, "runs": [run.id for run in part.campaign.runs],
                    "rows": part.campaign.rows, "minutes": six_digits(part.minutes),
                }
                for part in self.parts
            ],
            "notes": list(self.notes),
        }  # fmt: skip

    def __str__(self) -> str:
        says = "" if self.certificate is None else f": {self.certificate.says}"
        steps, notes = [f"  {step}" for step in self.steps], listed(self.notes, "plan.notes", 10)
        return "\n".join([f"Plan of {self.minutes:.0f} min{says}", *steps, str(self.assessment), *notes])


@one_thread
def plan_together(
    machine: Machine | Path | str, instruments: Sequence[str] = INSTRUMENTS, *, minutes: float, criterion: str = "A",
    for_: Iterable[str] = (), given: Campaign | Path | str | None = None, noise_um: float = 0.3,
    setup_sigma: SetupSigma | None = None, setups: int | None = None, returns: int = 2, starts: int = 2, certify: bool = True,
    seed: int = 0, pool: Executor | None = None, progress: Callable[[str], None] = lambda message: None,
) -> JointPlan:  # fmt: skip
    """The plan that makes the uncertainty of what is sought smallest in so many `minutes`, set-up of every mounting included.

    `setups` mountings at most, of all instruments together (default: 2 for each and 3 for a ball bar, shared as suits best);
    poses that would lower the variance by less than 1 % are not read. `instruments` that may be used; those that the machine
    cannot use, and those that gain nothing, are left out. `certify`: the plan is compared with all mixes of them in the same
    minutes with as many mountings, circles of a ball bar included (up to a minute). `criterion`, `for_`, `given`, `noise_um`,
    `setup_sigma`, `returns`, `starts`, `seed` and `pool` as of `plan`.

    Raises `InputError` where no instrument can be used or the minutes are too short for one mounting.
    """
    machine = machine_given(machine)
    check_minutes(minutes)
    check_counts(machine, {"setups": setups, "returns": returns, "starts": starts})
    if unknown := next((name for name in instruments if name not in INSTRUMENTS), None):
        raise InputError(f'there is no instrument "{unknown}" to plan with', remedy=f"use {', '.join(INSTRUMENTS)}")
    earlier = None if given is None else campaign_given(given)
    wanted = tuple(for_)
    shared = shared_minutes(
        machine,
        instruments,
        criterion=criterion,
        for_=wanted,
        given=earlier,
        noise_um=noise_um,
        setup_sigma=setup_sigma,
        setups=setups,
    )
    mixes = shared.poses(minutes, lambda message: progress(f"dividing the minutes: {message}"))
    if not mixes.all:
        problem = f"{minutes:g} minutes are too short for one set-up ({SETUP_S / 60.0:g} min) and two poses"
        raise InputError(problem, remedy="give more minutes")

    before = [] if earlier is None else [earlier]

    def planned(kind: str, share: tuple[int, float, int], others: Sequence[Plan]) -> Plan:
        known = [*before, *(part.campaign for part in others)]
        return plan(
            machine, instrument=kind, criterion=criterion, for_=wanted, minutes=min(share[1], minutes), setups=share[0],
            points=min(max(2, share[2]), MOST["points"]), given=merged(known) if known else None, noise_um=noise_um,
            setup_sigma=setup_sigma, returns=returns, starts=starts, seed=seed, pool=pool, anywhere=False, prove=False,
            progress=lambda message: progress(f"{instrument_words(kind)}: {message}"),
        )  # fmt: skip

    def value(parts: Sequence[Plan]) -> float:
        return shared.value(assess(merged([part.campaign for part in parts]), given=earlier))

    def made(mix: Mix) -> Iterator[list[Plan]]:
        parts, shares = list[Plan](), _shares(mix, mixes.enough(mix), shared.pace)
        for kind, share in shares.items():
            parts.append(planned(kind, share, parts))
        yield parts
        if len(parts) > 1:
            kind, share = next(iter(shares.items()))
            yield [planned(kind, share, parts[1:]), *parts[1:]]

    single, mix = min(mixes.single().values(), key=lambda each: each.value), mixes.best()
    chosen = [single, mix] if mix.value < single.value - GAP else [single]
    parts = min((parts for each in chosen for parts in made(each)), key=value)
    campaign = merged([part.campaign for part in parts])
    expected, certificate = assess(campaign, given=earlier), None
    if certify:
        progress("computing the certificate")
        certificate = certified(shared, expected, campaign, sum(part.minutes for part in parts))
    why = f"in these minutes it lowers the variance by less than {100 * GAP:g} %"
    if len(chosen) > 1 and len(parts) == 1:
        why = "no plan that was found with it is better in these minutes"
    left_out = [f"{instrument_words(name)} not used: {reason}" for name, reason in shared.refused.items()]
    left_out += [
        f"{instrument_words(name)} not used: {why}"
        for name in shared.spaces
        if name not in {part.instrument for part in parts}
    ]
    return JointPlan(tuple(parts), certificate, expected, tuple(left_out))


def _shares(mix: Mix, enough: float, pace: float) -> dict[str, tuple[int, float, int]]:
    """How often each instrument is mounted, its minutes, and how many poses it reads if `enough` of the time is read."""
    found: dict[str, tuple[int, float, int]] = {}
    for mounting, weights in zip(mix.mountings, mix.weights, strict=True):
        count, minutes, poses = found.get(mounting.kind, (0, 0.0, 0))
        seconds = SETUP_S + float(weights.sum())
        found[mounting.kind] = count + 1, minutes + (seconds - pace) / 60.0, poses + math.ceil(enough * seconds / pace)
    return found


def _all(parts: Iterable[Mapping[str, Any]]) -> dict[str, Any]:
    return {name: value for part in parts for name, value in part.items()}


def _step(part: Plan) -> str:
    count = len(part.campaign.runs)
    mounted = "one mounting" if count == 1 else f"{count} mountings"
    return f"{instrument_words(part.instrument)}: {mounted}, {part.campaign.rows} rows, {part.minutes:.0f} min"
