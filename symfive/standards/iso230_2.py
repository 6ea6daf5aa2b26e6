"""Positioning of linear and rotary axes (ISO 230-2): A, E, R, M and B.

With x_ij the deviation at target i in approach j, from below (↑) or above (↓), n approaches each,

    x̄_i↑ = mean_j x_ij↑            s_i↑ = sqrt(Σ_j (x_ij↑ - x̄_i↑)² / (n - 1))
    B_i  = x̄_i↑ - x̄_i↓            B = max |B_i|
    R_i↑ = 4 s_i↑                  R_i = max(2 s_i↑ + 2 s_i↓ + |B_i|, R_i↑, R_i↓)        R = max R_i
    E↑   = max x̄_i↑ - min x̄_i↑    E = max(x̄_i↑, x̄_i↓) - min(x̄_i↑, x̄_i↓)
    M    = max x̄_i - min x̄_i,  x̄_i = (x̄_i↑ + x̄_i↓)/2
    A↑   = max(x̄_i↑ + 2 s_i↑) - min(x̄_i↑ - 2 s_i↑),  A the same over both directions

The expanded uncertainty is the declared noise of a reading, propagated: U = 2 σ |∂value/∂x|. It lacks the laser's scale, its
alignment, temperature and drift (ISO/TR 230-9).
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from symfive.arrays import Array
from symfive.campaign import Campaign, Run
from symfive.instruments import positioning_instrument
from symfive.numbers import unit_words
from symfive.standards._value import COVERAGE, NOISE_ALONE, StandardValue, place_of

STANDARD = "ISO 230-2"
SAME = 1e-3
"""Commands so near each other (mm or degree) are one target."""
LEAST, ASKED = 2, 5
"""Approaches from one side that a standard deviation needs, and that the standard asks for."""
STEP, BESIDE = 1e-6, 1e-3
"""Of the differences, and of what parts equal readings: far below what a laser resolves (µm, µrad)."""
Quantity = Callable[[Array, Array], float]


@dataclass(frozen=True)
class Approaches:
    """Deviations (µm, µrad) at `targets` (m,) mm or degree: `up` and `down` (m, n), (m, 0) of a side that was not measured."""

    targets: Array
    up: Array
    down: Array


def _spread(x: Array) -> Array:
    return np.asarray(np.std(x, axis=1, ddof=1))


def _range(*parts: Array) -> float:
    return float(max(part.max() for part in parts) - min(part.min() for part in parts))


def _repeatability(up: Array, down: Array) -> float:
    two_up, two_down = 2.0 * _spread(up), 2.0 * _spread(down)
    reversal = np.abs(up.mean(axis=1) - down.mean(axis=1))
    return float(np.max([two_up + two_down + reversal, 2.0 * two_up, 2.0 * two_down]))


def _accuracy(*sides: Array) -> float:
    bounds = [(x.mean(axis=1), 2.0 * _spread(x)) for x in sides]
    return _range(*(mean + two for mean, two in bounds), *(mean - two for mean, two in bounds))


BOTH: dict[str, Quantity] = {
    "A": _accuracy,
    "E": lambda up, down: _range(up.mean(axis=1), down.mean(axis=1)),
    "R": _repeatability,
    "M": lambda up, down: _range(0.5 * (up.mean(axis=1) + down.mean(axis=1))),
    "B": lambda up, down: float(np.max(np.abs(up.mean(axis=1) - down.mean(axis=1)))),
}
"""The bi-directional quantities of the readings up and down, (m, n) each."""
ONE: dict[str, Callable[[Array], float]] = {
    "A": _accuracy,
    "E": lambda x: _range(x.mean(axis=1)),
    "R": lambda x: float(4.0 * _spread(x).max()),
}
"""The unidirectional quantities of one side."""


def positioning_values(campaign: Campaign) -> tuple[StandardValue, ...]:
    """A, E, R of both directions together and of each, M and B, of every test of an axis with a laser at rest, µm or µrad. Runs
    that repeat each other are the cycles of one test."""
    groups = {id: group for group in campaign.repeats for id in group}
    tests = dict.fromkeys(
        groups.get(run.id, (run.id,)) for run in campaign.runs
        if run.measured and not run.dynamic and positioning_instrument(run)
    )  # fmt: skip
    return tuple(value for ids in tests for value in _of_test(campaign, [campaign.run(id) for id in ids]))


def _of_test(campaign: Campaign, runs: Sequence[Run]) -> list[StandardValue]:
    axis, noise = (
        campaign.machine.axes[str(runs[0].options["axis"])],
        runs[0].noise(positioning_instrument(runs[0]) or ""),
    )
    unit = "urad" if axis.rotary else "um"
    data = approaches_of(runs, axis.name, unit)
    ids = tuple(run.id for run in runs)
    sides = {"up": data.up, "down": data.down}
    counts = [side.shape[1] for side in sides.values() if side.shape[1]]
    if not counts:
        return []
    limits = []
    if min(counts) < ASKED:
        limits.append(f"{min(counts)} approaches per direction: ISO 230-2 requires {ASKED}")
    if len(data.targets) < ASKED and not axis.rotary:
        limits.append(f"{len(data.targets)} targets: ISO 230-2 requires at least {ASKED}")
    limits.append(NOISE_ALONE)
    conditions = {
        "axis": axis.name,
        "targets": f"{len(data.targets)} from {data.targets[0]:g} to {data.targets[-1]:g} {unit_words(axis.unit)}",
        "approaches": f"{min(counts)} per direction", "feed": "not recorded", **place_of(campaign.machine, runs[0]),
    }  # fmt: skip

    def value(name: str, what: str, of: Callable[..., float], *parts: Array) -> StandardValue:
        u = COVERAGE * noise * _slope(of, parts)
        return StandardValue(standard=STANDARD, name=name, what=f"{axis.name} {what}".strip(), value=of(*parts), u=u,
                             unit=unit, runs=ids, conditions=conditions, limits=tuple(limits))  # fmt: skip

    found = []
    if len(counts) == len(sides):
        found += [value(name, "", of, data.up, data.down) for name, of in BOTH.items()]
    found += [value(name, side, of, part) for side, part in sides.items() if part.shape[1] for name, of in ONE.items()]
    return found


def _slope(of: Callable[..., float], parts: Sequence[Array]) -> float:
    """The gradient's length, by central differences: the quantities are piecewise smooth in a few hundred readings. Where two
    targets are equally extreme (readings are rounded) there is no gradient, so it is taken a little beside."""
    square, beside = 0.0, np.random.default_rng(0)
    moved = [part + beside.uniform(-BESIDE, BESIDE, part.shape) for part in parts]
    for part in moved:
        for place in np.ndindex(part.shape):
            kept = part[place]
            part[place] = kept + STEP
            above = of(*moved)
            part[place] = kept - STEP
            square += ((above - of(*moved)) / (2.0 * STEP)) ** 2
            part[place] = kept
    return float(np.sqrt(square))


def approaches_of(runs: Sequence[Run], axis: str, unit: str) -> Approaches:
    """The deviations (in `unit`, um or urad) of static runs by target and side of approach.

    A row counts as approached from where the row before it stood, the first one like the second. Where some positions were
    approached from both sides the others are overruns and no targets; every side is cut to the least number of approaches.
    """
    found: dict[int, tuple[list[float], list[float]]] = defaultdict(lambda: ([], []))
    for run in runs:
        way = run.commands[axis]
        if len(way) < 2:
            continue
        steps = np.diff(way)
        for at, step, reading in zip(way, [steps[0], *steps], run.readings[f"{axis}_dev_{unit}"], strict=True):
            if step != 0.0:
                found[round(float(at) / SAME)][0 if step > 0.0 else 1].append(float(reading))
    enough = {key: (len(up) >= LEAST, len(down) >= LEAST) for key, (up, down) in found.items()}
    wanted = (True, True)
    if wanted not in enough.values():
        one_sided = [pair for pair in enough.values() if any(pair)]
        wanted = max(one_sided, key=one_sided.count, default=(False, False))
    keys = sorted(key for key, pair in enough.items() if pair == wanted)
    cut = []
    for side in (0, 1):
        count = min((len(found[key][side]) for key in keys), default=0) if wanted[side] else 0
        cut.append(np.array([found[key][side][:count] for key in keys]).reshape(len(keys), count))
    return Approaches(np.array(keys) * SAME, *cut)
