"""Unidentified terms that a campaign can hold: which channel, over which coordinates."""

from __future__ import annotations

import math
import re
from collections.abc import Iterable
from dataclasses import replace
from itertools import combinations
from typing import TYPE_CHECKING

import numpy as np

from symfive.arrays import Array
from symfive.effects._coordinates import ACCELERATION, ROW, SIGN, SINCE, VELOCITY
from symfive.effects._force import driven_axes
from symfive.effects._form import (
    AXIS,
    CARRIED,
    FORCE,
    TOOL,
    Form,
    Scan,
    Tone,
    goes_round,
    moving,
    positioned,
    reversing,
    revisited,
)
from symfive.errors import InputError
from symfive.runs import Campaign, Run

if TYPE_CHECKING:
    from symfive.effects.unknown import Unknown

HARMONICS, LEAST_CYCLES = 3, 2.0
"""Of a cycle over time: number of harmonics, and the least number of periods in the recording."""
SIDES, CLOSEST = 16, 1e-5
"""Number of intervals over the distance since reversal, each twice as long as the one before, and the length of the first as a
share of the longest distance: a few µm, as of a backlash."""
_ORDER = re.compile(r"(?:P|T|cos|sin)(\d+)(?![\d.^])")


def unidentified_forms(kind: type[Unknown], campaign: Campaign) -> Iterable[Form | Scan | Tone]:
    """Unidentified terms for every channel and coordinate of a campaign, each prepared for it.

    Coordinates: each axis that moves, its velocity and acceleration (dynamic runs only), its distance since reversal, its
    position by direction of approach (a table of values where positions repeat, as in a test by ISO 230-2), each pair of rotary
    axes, and time, also as a cycle; the row of each run without a clock. Drive forces: over velocity, position, and position by
    direction. Coordinates that the campaign does not move are omitted.
    """
    machine, axes = campaign.machine, moving(campaign)
    unclocked = [run.id for run in campaign.runs if not run.has_clock]
    drafts = [kind(over=("t",)), *(kind(over=(ROW,), run=run) for run in unclocked)]
    for axis in axes:
        words = [axis, f"{axis}{SINCE}"]
        if any(run.dynamic for run in campaign.runs):
            words += [f"{axis}{VELOCITY}", f"{axis}{ACCELERATION}"]
        for word in words:
            order = SIDES if word.endswith(SINCE) else kind.order
            drafts += [
                kind(over=(word,), order=order, finest=CLOSEST),
                kind(over=(word,), order=order, finest=CLOSEST, place="axis", tag="axis"),
            ]
    for pair in combinations([axis for axis in axes if machine.axes[axis].rotary], 2):
        cyclic = [goes_round(campaign, axis) for axis in pair]
        basis, order = tuple("fourier" if r else "polynomial" for r in cyclic), tuple(3 if r else 4 for r in cyclic)
        pose = kind(over=pair, basis=basis, order=order)
        drafts += [pose, *(replace(pose, carrier=axis, tag=f"carried-{axis}") for axis in pair)]
    for axis in reversing(campaign):
        knots = revisited(campaign, axis)
        family, degree = ("fourier", 3) if goes_round(campaign, axis) else ("polynomial", 4)
        family, degree = ("bspline", 1) if knots else (family, degree)
        by_side = kind(over=(axis, f"{axis}{SIGN}"), basis=(family, "polynomial"), order=(degree, 1), knots=knots)
        drafts.append(replace(by_side, place="axis", tag="axis"))
        if axis in driven_axes(campaign):
            table = replace(by_side, basis=("bspline", "polynomial"), order=(SIDES, 1), knots=())
            drafts.append(replace(table, place="force", tag="force"))
    drafts += [kind(over=(f"{axis}{what}",), order=SIDES, place="force", tag="force")
               for axis in driven_axes(campaign) for what in (VELOCITY, "")]  # fmt: skip
    for draft in drafts:
        try:
            effect = draft.prepare(campaign)
        except InputError:
            continue  # the campaign does not move there
        yield replace(_form(effect, campaign), places=len(unclocked) if effect.run else 1.0)
    yield from _cycles(kind, campaign)


def _cycles(kind: type[Unknown], campaign: Campaign) -> Iterable[Tone]:
    """Periodic functions of time, as of a cooler; periods from two rows to half of the recording."""
    runs = [run for run in campaign.runs if run.has_clock]
    if not runs:
        return
    first, last = (end(run.start_s + float(run.time[k]) for run in runs) for end, k in ((min, 0), (max, -1)))
    lowest, highest = LEAST_CYCLES / max(last - first, 1e-9), 0.5 / max(run.interval for run in runs)
    if lowest >= highest:
        return

    def form(frequency: float, resolution: float, places: int) -> Form:
        sigma = resolution / frequency**2
        cycle = kind(
            over=("t",), basis="fourier", order=HARMONICS, period=1.0 / frequency, period_sigma=sigma, tag="cycle"
        )
        return Form(effect=cycle, places=places)

    yield Tone(
        channel=TOOL, coordinate=lambda run: run.start_s + np.asarray(run.time), lowest=lowest, highest=highest,
        form=form, runs=tuple(run.id for run in runs),
    )  # fmt: skip


def _form(effect: Unknown, campaign: Campaign) -> Form:
    """The form by which the search sees an effect: its functions in units of their priors."""

    def basis(run: Run) -> Array:
        shares = np.array([share_of(name) for name in effect.functions(campaign.machine).names])
        return (
            effect.table(campaign.machine, [run]) * shares if effect.applies(run) else np.zeros((run.rows, len(shares)))
        )

    channel = {"axis": AXIS, "force": FORCE}.get(effect.place, CARRIED if effect.carrier else TOOL)
    return Form(
        effect=effect,
        channel=channel,
        axis=effect.axis or effect.carrier or None,
        basis=basis,
        sigma=effect.parameters(campaign)[0].sigma,
        directions=len(effect.functions(campaign.machine).names) if effect.knots else 0,
        measured=_measured(effect, campaign),
    )


def _measured(effect: Unknown, campaign: Campaign) -> bool:
    """Whether it is the positioning deviation of an axis, by position and direction if it reverses, in a test by ISO 230-2."""
    axis = effect.axis
    if effect.place != "axis" or axis not in positioned(campaign):
        return False
    return effect.over == ((axis, f"{axis}{SIGN}") if axis in reversing(campaign) else (axis,))


def share_of(name: str) -> float:
    """Prior 1σ of a coefficient, as `P3` or `P1(B)*cos2(C)`, over that of the first two of its series.

    Curves with a slope that is bounded in the mean have coefficients that fall like k^(-3/2), in every factor; 1 for what is
    in no series.
    """
    return math.prod(min(1.0, (2.0 / int(order)) ** 1.5) for order in _ORDER.findall(name))
