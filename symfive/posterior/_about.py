"""The moments of a fit with all that may join it."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from symfive.effects import Effect, Form
from symfive.motion import Play, PreSliding
from symfive.posterior._fit import WHITE, Expansion
from symfive.posterior._moments import Moments, moments_of
from symfive.posterior._scan import placed
from symfive.posterior._terms import Candidates, name_of, variations_of

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
    return moments_of(here.fit, here.held, [*fresh, *varied])


def _in_held_laws(here: Expansion, candidates: Candidates) -> Iterator[Form]:
    """Effects of other names in the laws that the fit holds: what may stand in the place of a held effect is looked at where the
    same contact gives way in the same shape, over the same distance."""
    campaign, found = here.fit.model.campaign, set[str]()
    for held in here.held:
        laws = {(type(law), law.axis): law.parameters for law in _contacts(held.effect)}
        others = [form for form in candidates.forms if laws and name_of(form.effect) != name_of(held.effect)]
        for shape in (shape for form in others for shape in form.shapes):
            effect = replace(shape, tag=str(getattr(shape, "shape", "")))
            bounds = {p.name: (p.lower, p.upper) for p in effect.parameters(campaign)}
            for law in _contacts(effect):
                names = zip(law.parameters, laws.get((type(law), law.axis), ()), strict=False)
                at = {
                    own: float(np.clip(here.fit[its], *bounds[own]))
                    for own, its in names
                    if own in bounds and its in here.fit.named
                }
                if at and effect.key not in found:
                    found.add(effect.key)
                    yield Form(effect=effect.prepare(campaign), at=at)


def _contacts(effect: Effect) -> list[Play | PreSliding]:
    """The laws by which contacts of an effect give way."""
    return [signal for signal in effect.signals() if isinstance(signal, Play | PreSliding)]
