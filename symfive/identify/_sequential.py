"""The papers' own schemes beside the joint estimate: stage by stage, and position by position."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from symfive.campaign import Campaign
from symfive.errors import InputError, among
from symfive.given import campaign_given
from symfive.identify._identify import identify, summarise
from symfive.identify._result import Identification
from symfive.inference import Problem
from symfive.machine import ErrorTerm
from symfive.model import Model


@dataclass(frozen=True)
class Stage:
    """One step of a sequential scheme: `parameters` estimated from `runs`, everything found before held fixed.

    A name ending in `*` stands for every parameter that begins so (`EXX*`).
    """

    runs: tuple[str, ...]
    parameters: tuple[str, ...]


def identify_sequentially(campaign: Campaign | Path | str, stages: Sequence[Stage], **options: Any) -> Identification:
    """Identify in stages as in Wang & Li 2016: each stage takes earlier results as exact and all other errors as zero.

    The uncertainties are those of each stage alone: they ignore the uncertainty of earlier stages and the errors
    identified later. Compare with `identify`, which estimates all at once. `options` go to `identify`.
    """
    campaign = campaign_given(campaign)
    model = Model(campaign)
    found: dict[str, float] = {}
    variances = np.zeros(len(model.parameters))
    for stage in stages:
        part = Model(campaign.select(*stage.runs))
        wanted = _expand(part, stage.parameters)
        shared = {p.name: p.mean for p in part.parameters if not p.of_setup and p.name not in wanted}
        fixed = {name: found.get(name, value) for name, value in shared.items()}
        result = identify(part, fixed=fixed, **options)
        for i, p in enumerate(result.parameters):
            if p.name in wanted or p.of_setup:
                found[p.name] = float(result.values[i])
                variances[model.index[p.name]] = result.covariance[i, i]
    missing = [p.name for p in model.parameters if not p.of_setup and p.name not in found]
    values = model.vector(found)
    summary = summarise(Problem.of(model), values, True, method="sequential")
    notes = (f"no stage estimates {', '.join(missing)}: they stand at their prior mean",) if missing else ()
    return replace(summary, covariance=np.diag(variances), notes=notes)


def _expand(model: Model, patterns: Iterable[str]) -> set[str]:
    names: set[str] = set()
    for pattern in patterns:
        hits = {n for n in model.index if n == pattern or (pattern.endswith("*") and n.startswith(pattern[:-1]))}
        if not hits:
            raise InputError(f'no parameter is called "{pattern}"', remedy=f"use {', '.join(list(model.index)[:8])}, …")
        names |= hits
    return names


def identify_by_position(
    campaign: Campaign | Path | str,
    axis: str,
    components: Sequence[str] = ("X", "Y", "Z", "A", "B", "C"),
    *,
    sigma: float = 50.0,
    **options: Any,
) -> Identification:
    """Identify the errors of one axis as a free value at each commanded position (Oyama, Ibaraki & Otsubo 2010, (10)–(15)).

    Every component becomes a linear B-spline with a knot at every position: one value per position and straight
    lines between. `sigma` µm or µrad is the prior 1σ of each value. The location errors of the machine file hold the constant
    part. The two gauge freedoms that the paper does not mention are listed in `confounded`.
    """
    campaign = campaign_given(campaign)
    machine = campaign.machine
    among(axis, machine.axis_names, f"the machine has no axis {axis}")
    positions = np.unique(np.concatenate([np.round(run.commands[axis], 6) for run in campaign.runs]))
    if not 2 <= len(positions) <= 200:
        raise InputError(
            f"axis {axis} stands at {len(positions)} positions",
            remedy="this scheme needs from 2 to 200; use a basis instead",
        )
    errors = dict(machine.errors)
    for component in components:
        name = f"E{component}{axis}"
        errors[name] = ErrorTerm(
            name=name, sigma=sigma, basis=("bspline",), order=(1,), knots=(tuple(positions.tolist()),)
        )
    free = campaign.with_machine(replace(machine, errors=errors))
    return replace(identify(free, **options), method=f"by position of {axis}")
