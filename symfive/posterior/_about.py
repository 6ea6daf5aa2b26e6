"""The moments of a fit with all that may join it."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

import numpy as np

from symfive.arrays import Array
from symfive.effects import Effect, Form
from symfive.identify import Identification
from symfive.model import Model
from symfive.motion import Play, PreSliding
from symfive.posterior._fit import WHITE, Expansion
from symfive.posterior._moments import Moments, moments_of
from symfive.posterior._scan import placed
from symfive.posterior._terms import Candidates, variations_of

__all__ = ["moments_about"]


def moments_about(here: Expansion, candidates: Candidates) -> Moments:
    """With forms of other keys than the fit holds, that free no quantity which is free, the best place of every scan, the others
    in the laws of what it holds, and the variations of that."""
    taken = {effect.key for effect in here.fit.model.effects}
    freed = {place for effect in here.fit.model.effects for place in effect.frees()}
    scanned = placed(here.fit, candidates.scans, (here.node, WHITE))
    fresh = [
        f
        for f in (*candidates.forms, *scanned, *_in_held_laws(here, candidates))
        if f.effect.key not in taken and not freed & set(f.effect.frees())
    ]
    varied = variations_of(here.held, here.fit.model.campaign) if candidates.vary else []
    return moments_of(here.fit, here.held, [*fresh, *varied], here.noises)


def _in_held_laws(here: Expansion, candidates: Candidates) -> Iterator[Form]:
    """Other effects, or components, in the laws that the fit holds: what may stand in the place of a held effect is looked at
    where the same contact gives way in the same shape, over the same distance, and where it moves the readings as much."""
    taken = {effect.key for effect in here.fit.model.effects}
    for held in here.held:
        laws = {(type(law), law.axis): law.parameters for law in _contacts(held.effect)}
        change = here.fit.model.contribution(held.effect, here.fit.values) if laws else {}
        for form in candidates.forms if laws else ():
            if form.at or form.effect.key in taken:
                continue
            for shape in (each for each in form.shapes if each.key not in taken):
                same = (
                    zip(law.parameters, laws.get((type(law), law.axis), ()), strict=False) for law in _contacts(shape)
                )
                pairs = {own: here.fit.named[its] for each in same for own, its in each if its in here.fit.named}
                at = {p.name: float(np.clip(pairs[p.name], p.lower, p.upper))
                      for p in shape.parameters(here.fit.model.campaign) if p.name in pairs}  # fmt: skip
                at = _as_large(here.fit, change, shape, at) if at else {}
                if at:
                    others = tuple(other for other in (form.effect, *form.shapes) if other != shape)
                    yield Form(effect=shape, shapes=others, at=at)


def _as_large(
    fit: Identification, change: Mapping[str, Array], effect: Effect, at: Mapping[str, float]
) -> dict[str, float]:
    """The parameters at which an effect comes nearest to a `change` of the readings, run id → (N, ny), by least squares in noise
    and the prior of its size; none where the readings do not depend on the law's, `at`."""
    campaign = fit.model.campaign
    model = Model(campaign, (*fit.model.added, effect))
    values = {**fit.named, **effect.typical(campaign), **at}
    its = model.contribution(effect, values)
    noise = {run.id: fit.model.noise(run) for run in campaign.runs}
    given, seen = (sum(float(np.sum(its[k] * other[k] / n**2)) for k, n in noise.items()) for other in (change, its))
    values |= {p.name: values[p.name] * given / (seen + 1.0) for p in effect.amplitudes(campaign)}
    numbers, vector = [model.index[name] for name in at], model.vector(values)
    lines = (model.linearise(run, vector, ahead=True) for run in campaign.runs)
    if not any(np.any(line.jacobian[:, :, np.isin(line.columns, numbers)]) for line in lines):
        return {}
    return {p.name: values[p.name] for p in effect.parameters(campaign)}


def _contacts(effect: Effect) -> list[Play | PreSliding]:
    """The laws by which contacts of an effect give way."""
    return [signal for signal in effect.signals() if isinstance(signal, Play | PreSliding)]
