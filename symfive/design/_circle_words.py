"""What a plan of circles says in plain words."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

import numpy as np

from symfive.campaign import Campaign
from symfive.design._assess import assess
from symfive.design._circles import Circle
from symfive.design._paths import CircleShape, limits_met
from symfive.design._sweeps import SLOW_S, nuisances, recording_noise
from symfive.effects import Effect
from symfive.errors import InputError
from symfive.machine import Machine
from symfive.numbers import plain_number, unit_words
from symfive.parameters import Parameter
from symfive.screen import aligned

UNSEEN = 0.9
"""A parameter whose 1σ stays above this share of its prior 1σ is not determined."""
NOTHING = 0.05
"""Gains below this, per cent, are none."""
STILL = 1e-6
AT_LIMIT = 0.02
"""Share of a limit left where a circle counts as limited by it: twice the margin of the refinement."""
NEAR_END = 1e-3
"""Share of a list's range within which a refined value stands at its end."""
NOTICED = 1.1
"""Times by which an expected 1σ is larger before it is said."""
NAMES = {"ratio": "X_T/r", "radius": "radius r"}
UNITS = {"ratio": "", "feed": " mm/min"}


def circle_words(circle: Circle) -> str:
    """A circle's variables with their units, and where its ball stands."""
    values = ", ".join(_valued(name, value) for name, value in circle.shape.values.items())
    x, y, _ = (round(v, 3) + 0.0 for v in circle.runs[0].table_ball)
    return f"{circle.shape.family}, {circle.shape.direction}: {values}; ball at ({x:g}, {y:g}) mm on the table"


def _valued(name: str, value: float) -> str:
    return f"{NAMES.get(name, name)} {value:g}{UNITS.get(name, ' mm')}"


def sigma_words(parameters: Sequence[Parameter], sigma: Mapping[str, float]) -> list[str]:
    """Of every parameter sought the 1σ expected after the measurement, with its unit, and that before."""
    if not parameters:
        return []
    rows = [(f"  {p.what}", plain_number(sigma[p.name], p.unit), f"{unit_words(p.unit)} ({plain_number(p.sigma)})")
            for p in parameters]  # fmt: skip
    return ["expected 1σ after the measurement (prior):", *aligned(rows, right=(1,))]


def gain_words(psi_of_list: float, psi: float) -> str:
    """What the refinement gained."""
    gain = 100.0 * math.expm1(0.5 * (psi_of_list - psi))
    if gain < NOTHING:
        return "refinement: no better than the best circles of the list"
    return f"refined: 1σ {gain:.2g} % smaller than with the best circles of the list"


def limit_words(machine: Machine, circles: Sequence[Circle]) -> list[str]:
    """Limits of the machine that keep circles where they are."""
    notes = []
    for i, circle in enumerate(circles):
        try:
            met = limits_met(machine, circle.shape, AT_LIMIT)
        except InputError:
            continue  # no smooth path: it was not refined
        if met:
            notes.append(f"circle {i + 1} is limited by the machine: {', '.join(met)}")
    return notes


def list_end_words(
    circles: Sequence[Circle], listed: Sequence[CircleShape], most: Mapping[str, float] | None = None
) -> list[str]:  # fmt: skip
    """Variables in which circles stand at an end of what was offered, so that a longer list may give better ones; `most` is the
    largest value that the machine allows, by variable (mm, mm/min)."""
    notes = []
    for name in circles[0].shape.values:
        offered = [shape.values[name] for shape in listed]
        low, high = min(offered), max(offered)
        ends = {
            end
            for circle in circles
            for end in (low, high)
            if abs(circle.shape.values[name] - end) <= NEAR_END * (high - low)
        }
        for end in sorted(ends) if high > low else ():
            side = "smallest" if end == low else "largest"
            says = (
                f"the {side} value offered, not a limit of the machine; offer more values if your machine allows them"
            )
            if end == high and end >= (most or {}).get(name, math.inf):
                says = "the largest value the machine allows"
            notes.append(f"{_valued(name, end)} is {says}")
    return notes


def slow_noise_words(campaign: Campaign, effects: Sequence[Effect], sought: Sequence[Parameter]) -> list[str]:
    """Effect on the expected 1σ of slow noise as large as the white noise, and of drives known only to their priors."""
    known = {(effect.id, effect.axis) for effect in effects}
    lags = [lag for lag in nuisances(campaign.machine, delay=False) if (lag.id, lag.axis) not in known]
    white = campaign.runs[0].noise(campaign.runs[0].instrument[0])
    here, there = (
        assess(campaign, effects=own, noise=noise).sigma
        for own, noise in ((effects, None), ([*effects, *lags], recording_noise(white, None, SLOW_S)))
    )
    worst = max(sought, key=lambda p: there[p.name] / here[p.name], default=None)
    if worst is None or there[worst.name] < NOTICED * here[worst.name]:
        return []
    return [
        f"the expected 1σ assume white noise: slow noise of {white:g} µm ({SLOW_S:g} s) and the drives' priors in the machine "
        f"file make them up to {there[worst.name] / here[worst.name]:.2g} times as large ({worst.words})"
    ]


def warnings_of(
    circles: Sequence[Circle], effects: Sequence[Effect], parameters: Sequence[Parameter], sigma: Mapping[str, float]
) -> list[str]:
    """Circles that repeat an earlier one, and parameters that the circles do not determine."""
    shapes = [circle.shape for circle in circles]
    notes = [
        f"circle {i + 1} is a repeat of circle {shapes.index(shape) + 1}: no other candidate adds more"
        for i, shape in enumerate(shapes)
        if shapes.index(shape) < i
    ]
    unseen = [p for p in parameters if sigma[p.name] > UNSEEN * p.sigma]
    moving = {name for c in circles for run in c.runs for name, q in run.commands.items() if np.ptp(q) > STILL}
    for p in unseen:
        idle = [e.axis for e in effects if e.axis and p.name.startswith(f"{e.key}.") and e.axis not in moving]
        why = f"axis {idle[0]} does not move in them" if idle else "its 1σ stays near the prior"
        notes.append(
            f"WARNING: these circles do not determine {p.words}: {why}; use another family of circles or another test"
        )
    return notes
