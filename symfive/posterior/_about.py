"""The moments of a fit with all that may join it."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

from symfive.effects import Effect, Form
from symfive.posterior._fit import WHITE, Expansion
from symfive.posterior._moments import Moments, moments_of
from symfive.posterior._scan import placed
from symfive.posterior._terms import Candidates, variations_of

__all__ = ["moments_about"]


def moments_about(here: Expansion, candidates: Candidates) -> Moments:
    """With forms of other keys than the fit holds, that free no quantity which is free, also in the shapes of what it holds, the
    best place of every scan, and the variations of what it holds."""
    taken = {effect.key for effect in here.fit.model.effects}
    freed = {place for effect in here.fit.model.effects for place in effect.frees()}
    scanned = placed(here.fit, candidates.scans, (here.node, WHITE))
    joined = (*candidates.forms, *_alike(here, candidates), *scanned)
    fresh = [f for f in joined if f.effect.key not in taken and not freed & set(f.effect.frees())]
    varied = variations_of(here.held, here.fit.model.campaign) if candidates.vary else []
    return moments_of(here.fit, here.held, [*fresh, *varied])


def _alike(here: Expansion, candidates: Candidates) -> Iterator[Form]:
    """Shapes of the forms that follow the same function of the motion as what the fit holds, about the place that it has there:
    a contact that creeps may be that of another direction instead."""
    campaign = here.fit.model.campaign
    for effect in (form.effect for form in here.held):
        for form in candidates.forms:
            for shape in form.shapes:
                at = _place_of(effect, shape)
                sizes = {p.name for p in shape.amplitudes(campaign)}
                known = {name: here.fit[held] for name, held in at.items() if held in here.fit.model.index}
                if known and not sizes & set(known):
                    yield replace(form, effect=shape, shapes=(), at=shape.typical(campaign) | known, instead=effect.key)


def _place_of(held: Effect, shape: Effect) -> dict[str, str]:
    """The parameters of the signals of one effect, each with that of another one's which does the same in the same function of
    the motion; none where they do not follow the same one."""
    mine, others = shape.signals(), held.signals()
    if [(type(s), getattr(s, "axis", None)) for s in mine] != [(type(s), getattr(s, "axis", None)) for s in others]:
        return {}
    if any(len(s.parameters) != len(o.parameters) for s, o in zip(mine, others, strict=True)):
        return {}
    return {a: b for s, o in zip(mine, others, strict=True) for a, b in zip(s.parameters, o.parameters, strict=True)}
