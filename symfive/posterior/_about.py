"""The moments of a fit with all that may join it."""

from __future__ import annotations

from symfive.posterior._fit import WHITE, Expansion
from symfive.posterior._moments import Moments, moments_of
from symfive.posterior._scan import placed
from symfive.posterior._terms import Candidates, variations_of

__all__ = ["moments_about"]


def moments_about(here: Expansion, candidates: Candidates) -> Moments:
    """With forms of other keys than the fit holds, that free no quantity which is free, the best place of every scan, and the
    variations of what it holds."""
    taken = {effect.key for effect in here.fit.model.effects}
    freed = {place for effect in here.fit.model.effects for place in effect.frees()}
    scanned = placed(here.fit, candidates.scans, (here.node, WHITE))
    fresh = [
        f for f in (*candidates.forms, *scanned) if f.effect.key not in taken and not freed & set(f.effect.frees())
    ]
    varied = variations_of(here.held, here.fit.model.campaign) if candidates.vary else []
    return moments_of(here.fit, here.held, [*fresh, *varied])
