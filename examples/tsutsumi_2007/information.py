"""What a circle tells about the servo mismatch and the play of C, the eccentricity marginalised, over X_T/r."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from examples.claims import Claim
from symfive.design import CirclePlan, circle_information, plan_circles
from symfive.effects import Effect, make_effect
from symfive.machine import Machine

from .twin import paper_machine

Array = NDArray[np.float64]
GAIN, PLAY = "servo_mismatch.C.position_gain", "backlash.C.width"
RADIUS, FEED = 50.0, 1000.0


def _effects() -> list[Effect]:
    return [make_effect("servo_mismatch", "C", gains=("position_gain",)), make_effect("backlash", "C")]


def limits_of_ratio(machine: Machine, feed: float = FEED) -> tuple[float, float]:
    """The X_T/r below and above 1 beyond which C would have to turn faster than it can, by (8)."""
    fastest = machine.axes["C"].max_feed or math.inf
    gap = feed / math.radians(fastest) / RADIUS
    return 1.0 - gap, 1.0 + gap


@dataclass(frozen=True)
class Curve:
    """Expected 1σ of C's position gain `gain` (N,) 1/s and play `play` (N,) µrad over X_T/r `ratio` (N,) at `feed` mm/min."""

    feed: float
    ratio: Array
    gain: Array
    play: Array

    def at(self, ratio: float) -> tuple[float, float]:
        """(gain, play) at the ratio of the list that is nearest."""
        k = int(np.argmin(np.abs(self.ratio - ratio)))
        return float(self.gain[k]), float(self.play[k])


def curve(feed: float = FEED, *, points: int = 9) -> Curve:
    """Circles of r = 50 mm in both directions, 0.3 µm noise, balls set to 20 µm, dx and dy of the C axis unknown to 30 µm."""
    machine = paper_machine()
    low, high = limits_of_ratio(machine, feed)
    # a hair inside the limits, where C just follows
    ratios = np.concatenate([np.linspace(0.3, low - 3e-4, points), np.linspace(high + 3e-4, 1.8, points), [0.9, 1.1]])
    ratios = np.unique(ratios[(ratios <= low) | (ratios >= high)])
    sigma = [circle_information(machine, _effects(), ratio=float(u), radius=RADIUS, feed=feed).sigma for u in ratios]
    return Curve(feed, ratios, np.array([s[GAIN] for s in sigma]), np.array([s[PLAY] for s in sigma]))


@dataclass(frozen=True)
class Gain:
    """The paper's two circles (X_T/r = 0.9 and 1.1) beside the two that tell most, same radius and feed."""

    paper: CirclePlan
    best: CirclePlan

    def times(self, parameter: str) -> float:
        """1σ of the paper's circles over 1σ of the chosen ones."""
        return self.paper.sigma[parameter] / self.best.sigma[parameter]


def gain() -> Gain:
    """Chosen from nine ratios, then refined."""
    machine, effects = paper_machine(), _effects()

    def chosen(ratios: tuple[float, ...], *, refine: bool) -> CirclePlan:
        return plan_circles(machine, effects, count=2, radii=(RADIUS,), feeds=(FEED,), ratios=ratios, refine=refine)

    return Gain(
        chosen((0.9, 1.1), refine=False),
        chosen((0.5, 0.7, 0.8, 0.9, 1.1, 1.25, 1.4, 1.6, 1.8), refine=False),
    )


def claims_of_the_plan(found: Curve, plans: Gain) -> list[Claim]:
    """Beyond the paper: its 0.9 beside the best ratio."""
    below, above = found.ratio < 1.0, found.ratio > 1.0
    (gain_09, play_09), best = found.at(0.9), float(found.ratio[np.argmin(found.gain)])
    edge = float(found.ratio[below][np.argmin(found.gain[below])])
    words = " and ".join(f"{circle.ratio:.2g}" for circle in plans.best.circles)
    return [
        Claim(
            id="+8", statement="best X_T/r below 1 for the gain of C", where="4.3", paper="as near to one as possible",
            ours=edge, low=found.ratio[below][-1] - 1e-9, high=found.ratio[below][-1] + 1e-9,
            note="the last that C can follow; the paper's 0.9 is just inside",
        ),
        Claim(
            id="+9", statement="1σ of the gain at 0.9 over that at the best X_T/r", where="4.2",
            paper="1 (0.9 is better than 1.1)",
            ours=gain_09 / float(found.gain.min()), low=1.0, high=1.05, refuted=True,
            note=f"the best is {best:.2f}: a model that holds the play need not avoid it",
        ),
        Claim(
            id="+10", statement="1σ of the play at 0.9 over that at the best X_T/r", where="-", paper="-",
            ours=play_09 / float(found.play.min()), low=3.0, high=math.inf,
            note=f"best at {found.ratio[above][np.argmin(found.play[above])]:.2g}: the step grows as √(X_T² - r²)",
        ),
        Claim(
            id="+11", statement=f"1σ of the play, 0.9 and 1.1 over {words}", where="-", paper="-", ours=plans.times(PLAY),
            low=1.5, high=math.inf, note=f"of the gain {plans.times(GAIN):.2f} times; same radius, feed and time",
        ),
    ]  # fmt: skip
