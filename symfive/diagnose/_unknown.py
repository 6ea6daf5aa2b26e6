"""Where no effect of the library explains the readings: a term without physics over the coordinate that does."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from symfive.campaign import Campaign
from symfive.diagnose._catalogue import moving_axes
from symfive.effects import Effect, make_effect
from symfive.errors import InputError

__all__ = ["unknowns"]

INTERVALS = 8


def unknowns(campaign: Campaign, held: tuple[Effect, ...]) -> Iterator[Effect]:
    """Splines over every axis that moves, its velocity, and time, moving the tool in the machine frame or the readings."""
    taken = {effect.key for effect in held}
    for over in _coordinates(campaign):
        for place, tag in (("structure", ""), ("reading", "reading")):
            try:
                effect = make_effect("unknown", over=over, order=INTERVALS, place=place, tag=tag).prepare(campaign)
            except InputError:
                continue
            if effect.key not in taken and any(effect.applies(run) for run in campaign.runs):
                yield effect


def _coordinates(campaign: Campaign) -> Iterator[tuple[str, ...]]:
    moving = moving_axes(campaign)
    for axis in moving:
        if len(np.unique(np.concatenate([np.round(run.commands[axis], 6) for run in campaign.runs]))) > INTERVALS // 2:
            yield (axis,)
        if any(run.dynamic for run in campaign.runs):
            yield (f"{axis} velocity",)
    yield ("t",)
