"""Where no effect of the library explains the readings: a term without physics over the coordinate that does."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import combinations
from typing import Any

import numpy as np

from symfive.campaign import Campaign
from symfive.diagnose._catalogue import moving_axes, reversing_axes
from symfive.effects import Effect, make_effect
from symfive.errors import InputError

__all__ = ["unknowns"]

INTERVALS = 8
FINE = 32
SIDES = 16
ACCELERATION_ORDER = 3
ALONG = 0.9
"""A direction of space is an axis' own where its cosine is at least this."""
MOST_ROTARY = 3
"""Terms over two rotary axes together are looked for up to so many; an arm of seven has 21 pairs."""


def unknowns(campaign: Campaign, held: tuple[Effect, ...]) -> Iterator[Effect]:
    """Terms over every axis that moves, its velocity, its acceleration, the side it comes from, its way since it reversed, two
    rotary axes together, which of two linear axes is the faster, and time.

    They move the axis itself, the tool in the machine frame or in what a rotary axis carries, the readings, or the force of
    a drive.
    """
    taken = {effect.key for effect in held}
    for options in _terms(campaign):
        try:
            effect = make_effect("unknown", **options).prepare(campaign)
        except InputError:
            continue
        if effect.key not in taken and any(effect.applies(run) for run in campaign.runs):
            yield effect


def _terms(campaign: Campaign) -> Iterator[dict[str, Any]]:
    turning = reversing_axes(campaign)
    moving = moving_axes(campaign)
    dynamic = any(run.dynamic for run in campaign.runs)
    for axis in moving:
        places = len(np.unique(np.concatenate([np.round(run.commands[axis], 6) for run in campaign.runs])))
        if places > INTERVALS // 2:
            yield _spline(axis, "structure")
            yield _spline(axis, "reading")
        if places > 2 * FINE:
            yield _spline(axis, "axis", FINE)
        if dynamic:
            yield _spline(f"{axis} velocity", "structure")
            yield _spline(f"{axis} velocity", "reading")
            yield {"over": (f"{axis} acceleration",), "basis": "polynomial", "order": ACCELERATION_ORDER}
        for over in (axis, f"{axis} velocity"):
            yield _spline(over, "force")
        if dynamic and axis in turning:
            yield _spline(f"{axis} since reversal", "axis", SIDES)
        if axis in turning:
            yield from _from_both_sides(campaign, axis)
    rotary = [axis for axis in moving if campaign.machine.axes[axis].rotary]
    for pair in combinations(rotary, 2) if len(rotary) <= MOST_ROTARY else ():
        shapes = [_smooth(campaign, axis) for axis in pair]
        term = {"over": pair, "basis": tuple(b for b, _ in shapes), "order": tuple(n for _, n in shapes)}
        yield term
        yield from ({**term, "carrier": axis, "tag": f"carried-{axis}"} for axis in pair)
    linear = [axis for axis in moving if not campaign.machine.axes[axis].rotary]
    for pair in combinations(linear, 2) if dynamic else ():
        yield {"over": tuple(f"{axis} velocity" for axis in pair), "basis": "faster", "order": 1}
    for place in ("structure", "reading"):
        yield _spline("t", place)
        if campaign.rows > 4 * FINE:
            yield _spline("t", place, FINE)


def _from_both_sides(campaign: Campaign, axis: str) -> Iterator[dict[str, Any]]:
    """What differs between the sides from which an axis comes: of what it carries, across its own motion; of the axis itself.

    A carriage that turns is left out: on a circle in one plane that reads like its backlash.
    """
    sign = f"{axis} velocity sign"
    side: dict[str, Any] = {"over": (sign,), "basis": "polynomial", "order": 1, "carrier": axis}
    found = campaign.machine.axes[axis]
    across = [i for i, share in enumerate(found.direction) if abs(share) < ALONG]
    if found.rotary:
        yield {**side, "tag": "shifted"}
        yield {**side, "directions": "".join("abc"[i] for i in across), "tag": "turned"}
    else:
        yield {**side, "directions": "".join("xyz"[i] for i in across), "tag": "shifted"}
    basis, order = _smooth(campaign, axis)
    yield {"over": (sign, axis), "basis": ("polynomial", basis), "order": (1, order), "place": "axis"}


def _spline(over: str, place: str, intervals: int = INTERVALS) -> dict[str, Any]:
    plain = place == "structure" and intervals == INTERVALS
    return {"over": (over,), "order": intervals, "place": place, "tag": "" if plain else f"{place}-{intervals}"}


def _smooth(campaign: Campaign, axis: str) -> tuple[str, int]:
    """Harmonics of an axis that turns all the way round, else polynomials."""
    turn = max(float(np.ptp(run.commands[axis])) for run in campaign.runs)
    return ("fourier", 3) if campaign.machine.axes[axis].rotary and turn > 200.0 else ("polynomial", 4)
