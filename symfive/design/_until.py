"""Plans with a target uncertainty: the fewest poses that reach it for every requested error.

The criterion is the largest of the expected variances over those asked for (G of as many directions). Bisection over the number
of poses makes a plan for each and looks at its own expected 1σ, return poses included.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from symfive.campaign import Campaign, SetupSigma
from symfive.design._assess import assess
from symfive.design._plan import plan
from symfive.design._plan_notes import NOISE_HARDLY, SETUP_ERRORS
from symfive.design._request import interest_of
from symfive.design._result import Plan
from symfive.design._space import make_space
from symfive.errors import InputError
from symfive.given import campaign_given, machine_given
from symfive.machine import Machine
from symfive.numbers import plain_number, unit_words
from symfive.optimal import Worst
from symfive.validation import positive

LEAST = 2
NO_NOISE = 1e-3
"""Of the declared noise, and of a set-up error's 1σ, in place of none."""


def plan_until(
    machine: Machine | Path | str, asked: Mapping[str, float], *, points: int | None = None,
    progress: Callable[[str], None] = lambda message: None, **options: Any,
) -> Plan:  # fmt: skip
    """The plan with the fewest poses, at most `points`, after which every error of `asked` is expected to be known.

    `asked` name → 1σ, µm or µrad; a name as `EXC` stands for all its terms. Further `options` as of `plan`, but `criterion`,
    `for_` and `part`; with `given` the earlier campaign counts.

    Raises `InputError` that names an error which cannot be known so well, what limits it, and what helps.
    """
    machine = machine_given(machine)
    positive("until", **dict(asked))
    if clash := next((name for name in ("criterion", "for_", "part") if options.get(name)), None):
        raise InputError(f"a plan until a 1σ is reached has no {clash} of its own", remedy=f"leave out {clash}")
    if options.get("given") is not None:
        options["given"] = campaign_given(options["given"])
    space = make_space(machine, options.get("instrument", "r_test"))
    sigma = {p.name: p.sigma for p in space.shared}
    limits = {full: asked[name] for name in asked for full in interest_of(tuple(sigma), (name,))}
    _refuse_known(machine, limits, sigma, options.get("given"))
    scale = np.array([sigma[name] / limit for name, limit in limits.items()])
    criterion = Worst(np.einsum("i,ij,ik->ijk", scale**2, np.eye(len(scale)), np.eye(len(scale))), name="until")
    options |= {"criterion": criterion, "for_": tuple(limits)}
    quick = options | {"starts": 1, "anywhere": False, "prove": False}

    def reached(count: int) -> bool:
        progress(f"planning with {count} poses")
        return not _unmet(plan(machine, points=count, **quick), limits)

    most = plan(machine, points=points, **quick)
    if _unmet(most, limits):
        raise _out_of_reach(most, limits, options.get("given"))
    low, high = LEAST - 1, most.certificate.points
    while high - low > 1:
        middle = (low + high) // 2
        low, high = (low, middle) if reached(middle) else (middle, high)
    while True:
        found = plan(machine, points=high, **(options | {"progress": progress}))
        if not _unmet(found, limits) or high >= most.certificate.points:
            break
        high += 1
    return replace(found, notes=(_says(found, limits, high), *found.notes))


def _unmet(made: Plan, limits: Mapping[str, float]) -> dict[str, float]:
    """Names whose expected 1σ is above what is asked, by how many times."""
    sigma = made.assessment.sigma
    return {name: sigma[name] / limit for name, limit in limits.items() if sigma[name] > limit}


def _refuse_known(
    machine: Machine, limits: Mapping[str, float], sigma: Mapping[str, float], given: Campaign | None
) -> None:
    """Refuse what is known well enough, by the priors `sigma` or the campaign given, before anything is measured."""
    known = dict(sigma)
    if given is not None:
        known |= {name: s for name, s in assess(given).sigma.items() if name in known}
    if all(known[name] <= limit for name, limit in limits.items()):
        where = "by its prior" if given is None else "by the campaign given"
        name = max(limits, key=lambda n: known[n] / limits[n])
        unit = "µrad" if machine.errors[name.partition(".")[0]].angular else "µm"
        problem = f"{name} is already known to {plain_number(known[name])} {unit} {where}, as required"
        raise InputError(problem, remedy="no measurement is needed")


def _out_of_reach(most: Plan, limits: Mapping[str, float], given: Campaign | None) -> InputError:
    """What cannot be reached, and whether noise or the set-up limits it."""
    unmet = _unmet(most, limits)
    name = max(unmet, key=lambda n: unmet[n])
    unit = unit_words(next(p.unit for p in most.assessment.parameters if p.name == name))
    asked, count = f"{plain_number(limits[name])} {unit} (1σ)", most.certificate.points
    here = f"{plain_number(most.assessment.sigma[name])} {unit}"
    still = _without(most.campaign, given, name, noise=NO_NOISE)
    if still <= limits[name]:
        problem = f"{name} needs more than {count} poses for {asked}: {count} leave {here}, and the noise limits it"
        return InputError(problem, remedy="allow more poses (--points), or repeat readings (--repeats)")
    known = {error: _without(most.campaign, given, name, noise=NO_NOISE, exact=error.sigma) for error in SETUP_ERRORS}
    best = min(known, key=lambda error: known[error])
    least = f"{plain_number(still)} {unit}"
    words = f"{name} cannot be known to {asked} by these set-ups: {count} poses leave {here}, any number {least}"
    if known[best] > NOISE_HARDLY * still:
        problem = f"{words}, since the readings cannot separate it from other errors"
        return InputError(problem, remedy="use another instrument, or more set-ups (--setups)")
    problem = f"{words}; {best.name} limits it; known exactly, it leaves {plain_number(known[best])} {unit}"
    return InputError(problem, remedy=f"{best.remedy}, or allow more set-ups (--setups)")


def _without(campaign: Campaign, given: Campaign | None, name: str, *, noise: float, exact: str = "") -> float:
    """The expected 1σ of an error at the poses of a plan with less noise and one set-up error known."""
    runs = []
    for run in campaign.runs:
        setup: SetupSigma = run.setup_sigma_um
        if exact == "tool_ball":
            setup = replace(setup, tool_ball=NO_NOISE * setup.tool_ball, tool_length=setup.tool[2])
        elif exact:
            known: dict[str, Any] = {exact: NO_NOISE * (getattr(setup, exact) or setup.tool[2])}
            setup = replace(setup, **known)
        runs.append(replace(run, setup_sigma_um=setup, noise_um=noise * run.noise(run.instrument[0])))
    return assess(replace(campaign, runs=tuple(runs)), given=given).sigma[name]


def _says(made: Plan, limits: Mapping[str, float], count: int) -> str:
    """What is reached, in one sentence."""
    sigma, units = made.assessment.sigma, {p.name: unit_words(p.unit) for p in made.assessment.parameters}
    closest = max(limits, key=lambda n: sigma[n] / limits[n])
    reached = f"{plain_number(sigma[closest])} of {plain_number(limits[closest])} {units[closest]}"
    return f"{count} poses are the fewest found with the required 1σ; closest to its limit is {closest}, {reached}"
