"""Names that the readings do not tell apart: which they are, and what decides between them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from symfive.campaign import Campaign
from symfive.diagnose._locate import UNUSUAL
from symfive.diagnose._refit import Trial, amplitudes
from symfive.effects import Effect

__all__ = ["SAME", "alike", "levelled"]

SAME = 4.0
"""What changes χ² by less than this, 2σ, fits as well."""


def alike(campaign: Campaign, trials: Sequence[Trial], one: Trial) -> list[Trial]:
    """Names that the readings cannot tell from `one`: all with no more amplitudes that fit as well, however improbable; but for
    those that would have to be far larger than anything that is looked for, as a carriage that turns by a quarter of a radian."""

    def freedom(of: Effect) -> int:
        return sum(map(len, amplitudes(campaign, of)))

    most = max(UNUSUAL[-1], one.effect.times_usual(campaign, one.values))
    return [
        t
        for t in trials
        if t.effect.id != "unknown"
        and t.misfit - one.misfit < SAME
        and freedom(t.effect) <= freedom(one.effect)
        and t.effect.times_usual(campaign, t.values) <= most
    ]


def levelled(campaign: Campaign, trials: Sequence[Trial]) -> list[Trial]:
    """The trials, those that the readings cannot tell from the most probable name sharing what they have together by the odds
    beforehand and by what the readings do say (χ²): not by how much room their priors leave them."""
    named = [t for t in trials if t.effect.id != "unknown"]
    if not named:
        return list(trials)
    first = max(named, key=lambda t: t.evidence)
    group = [t for t in alike(campaign, trials, first) if first.misfit - t.misfit < SAME]
    if len(group) < 2:
        return list(trials)
    together = np.logaddexp.reduce([t.evidence for t in group])
    odds = [t.prior - 0.5 * t.misfit for t in group]
    shared = {id(t): float(together + own - np.logaddexp.reduce(odds)) for t, own in zip(group, odds, strict=True)}
    return [replace(t, evidence=shared.get(id(t), t.evidence)) for t in trials]
