"""Limits from a stated rate of false alarms: nothing in them is tuned.

A machine may raise `rate` false alarms a year. At a visit `dt` years after the one before the chance is rate·dt, shared by three
questions in equal parts: did one error step (each error, at this visit or the last: Bonferroni over these tests), did several
together (Hotelling's T²), does one drift (an EWMA for each error). All are asked of scores that are standard normal while
nothing changes, by what was learnt of the machine's own scatter.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from scipy.special import ndtr, ndtri

from symfive.arrays import Array

RATE = 0.1
"""False alarms of a machine and year: one in ten years."""
WEIGHT = 0.2
"""Weight of the newest visit in the EWMA (J. M. Lucas & M. S. Saccucci 1990: 0.05 to 0.25; the larger, the sooner)."""
MOST = 0.05
"""Chance at one visit, however long nobody came."""
STATES = 61


@dataclass(frozen=True)
class Limits:
    """Alarm limits of one visit: the largest standard normal score of a `step`, the least probability of all errors
    `together`, the largest EWMA of scores of a `drift`, in units of its own standard deviation."""

    step: float
    together: float
    drift: float

    @classmethod
    def of(cls, rate: float, years: float, errors: int) -> Limits:
        """The limits of a visit `years` after the last one, for so many errors."""
        return _limits(max(min(rate * years, MOST), 1e-12) / 3.0, max(errors, 1))


@lru_cache(maxsize=4096)
def _limits(chance: float, errors: int) -> Limits:
    step = -float(ndtri(chance / (4.0 * errors)))  # two sides, two visits
    limits, lengths = _run_lengths()  # the limit at which the chain passes once in errors/chance visits
    return Limits(step, chance, float(np.interp(-np.log(chance / errors), lengths, limits)))


def ewma_run_length(limit: float, weight: float = WEIGHT) -> float:
    """Average number of visits until the EWMA of standard normal scores passes ±limit·σ, σ² = weight/(2 - weight).

    From zero, by the Markov chain of D. Brook & D. A. Evans 1972 with 61 states.
    """
    reach = limit * np.sqrt(weight / (2.0 - weight))
    edges = np.linspace(-reach, reach, STATES + 1)
    middle = 0.5 * (edges[1:] + edges[:-1])
    below = ndtr((edges[None, :] - (1.0 - weight) * middle[:, None]) / weight)
    stays = np.diff(below, axis=1)
    return float(np.linalg.solve(np.eye(STATES) - stays, np.ones(STATES))[STATES // 2])


@lru_cache
def _run_lengths() -> tuple[Array, Array]:
    limits = np.linspace(1.0, 7.0, 25)
    return limits, np.log([ewma_run_length(float(limit)) for limit in limits])
