"""A machine's state along each direction: a dynamic linear model with level, rate and temperature, which learns its own scale.

    reading = level + (T - 20 °C)·slope_T + noise,   level grows by rate·dt,   noise ~ N(0, s²·v),

v the variance that the identification states. s² is estimated from the model's own one-step errors, so that a forecast is
Student's t with as many degrees of freedom as visits were used. The past is discounted by exp(-dt/M); of a table of
memories M each direction uses the one whose forecasts were the most probable so far (A. P. Dawid 1984, prequential).
M. West & J. Harrison 1997, Bayesian Forecasting and Dynamic Models, sections 4.5, 6.3, 10.8 (discount, variance learning) and
11.2 (intervention). The same with M fixed, without rate, is the EWMA of the level.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy.special import gammaln

from symfive.arrays import Array, Flags

MEMORIES = (np.inf, 8.0, 4.0, 2.0, 1.0, 0.5, 0.25)
"""Years, by octaves: from a machine that never forgets to one that a season renews."""
REFERENCE, SPAN = 20.0, 10.0
"""Temperature at which errors count (ISO 1), and the unit of its slope, °C."""
ROW, COLUMN = np.triu_indices(3)


@dataclass(frozen=True)
class State:
    """The state along r directions after a visit, for M memories: `mean` (3, M, r) of level, rate and slope, `covariance` (6, M,
    r) of them over s², the upper triangle row by row, `scale` s² and `evidence` (M, r); `count` (r,) visits used;
    `begun` (r,); `gain` (3, M, r) used at the visit."""

    mean: Array
    covariance: Array
    scale: Array
    evidence: Array
    count: Array
    begun: Flags
    gain: Array

    @classmethod
    def new(cls, count: int) -> State:
        """Before the first visit: a prior 1σ as level, in a year, in ten degrees."""
        shape = (len(MEMORIES), count)
        covariance = np.zeros((6, *shape))
        covariance[[0, 3, 5]] = 1.0
        flat = np.zeros((3, *shape))
        return cls(
            flat, covariance, np.ones(shape), np.zeros(shape), np.zeros(count), np.zeros(count, dtype=bool), flat
        )

    def chosen(self) -> tuple[Array, Array, Array]:
        """Mean (r, 3), covariance (r, 3, 3) in scaled units, and memory (r,) of each direction's best."""
        best, each = self.evidence.argmax(axis=0), np.arange(len(self.count))
        covariance = np.empty((len(each), 3, 3))
        covariance[:, ROW, COLUMN] = covariance[:, COLUMN, ROW] = (self.covariance * self.scale)[:, best, each].T
        return self.mean[:, best, each].T, covariance, np.array(MEMORIES)[best]

    def ahead(self, years: Array, warmth: float) -> tuple[Array, Array]:
        """Levels (n, r) and their variances so many years (n,) from now, scaled units, at a `warmth`."""
        mean, covariance, memory = self.chosen()
        regressors = np.stack([np.ones_like(years), years, np.full_like(years, warmth)], axis=1)
        variance = np.einsum("ni,rij,nj->nr", regressors, covariance, regressors)
        grown = variance * np.exp(np.minimum(years[:, None] / memory, 50.0))
        return regressors @ mean.T, np.minimum(grown, np.maximum(variance, 1.0))


@dataclass(frozen=True)
class Steps:
    """n visits against their forecasts along r directions: `error` over `spread`, what the stated uncertainties make of the
    forecast, in scaled units (0 and infinity where nothing was read); `kept` the share of a step one visit ago that the
    forecast has not yet followed; `reading` the reading's share of the forecast's variance, small where the level itself was
    hardly known; `variance` the reading's, infinite where there is none. All (n, r)."""

    error: Array
    spread: Array
    kept: Array
    reading: Array
    variance: Array


@dataclass(frozen=True)
class Course:
    """n visits through the filter: the `states` after each, `steps`, and levels with their variances at each visit's
    temperature (n, r)."""

    states: tuple[State, ...]
    steps: Steps
    level: Array
    level_variance: Array
    begun: Flags


def follow(
    state: State, years: Array, value: Array, variance: Array, warmth: Array, *, renewed: bool = False
) -> Course:
    """Follow n visits from a state: `years` since the visit before each and `warmth` (n,), readings `value` with `variance`
    (n, r), NaN where there are none. `renewed`: the level may have changed by as much as the priors allow; the visits are not
    used. Every memory is followed; which one is used is looked up afterwards."""
    seen = np.isfinite(value)
    variance, value = np.where(seen, variance, np.inf), np.where(seen, value, 0.0)
    discount = np.exp(np.minimum(years[:, None] / np.array(MEMORIES), 50.0))[..., None]
    states, errors, sizes = [state], [], []
    for visit in range(len(value)):
        own = (discount[visit], value[visit], variance[visit], seen[visit])
        after, error, size = _followed(states[-1], float(years[visit]), *own, float(warmth[visit]), renewed)
        states.append(after)
        errors.append(error)
        sizes.append(size)
    error, size = np.array(errors), np.array(sizes)
    if not renewed:
        states = _with_evidence(states, error, size, seen)
    return _course(states, error, size, variance, warmth)


def _followed(
    state: State, years: float, discount: Array, value: Array, variance: Array, seen: Flags, warmth: float,
    renewed: bool,
) -> tuple[State, Array, Array]:  # fmt: skip
    """The state after one visit, its error and the forecast's variance over s² (M, r); the evidence is still that of before."""
    mean, c, begun = state.mean.copy(), state.covariance.copy(), state.begun | seen
    mean[0] += years * mean[1]
    c[0] += years * (2.0 * c[1] + years * c[3])
    c[1:3] += years * c[3:5]
    most = np.maximum(
        1.0 / (state.scale * np.maximum(c[0], c[3])), 1.0
    )  # nothing is known less than the priors know it
    c[[0, 1, 3]] *= np.minimum(discount, most)
    if renewed:
        c[0] += 1.0 / state.scale
    if not state.begun.all():  # a direction that is seen for the first time begins at its reading
        mean[0] = np.where(begun & ~state.begun, value, mean[0])
    towards = c[:3] + warmth * c[[2, 4, 5]]  # times the regressor (1, 0, warmth)
    size = towards[0] + warmth * towards[2] + variance
    error = (value - mean[0] - warmth * mean[2]) * seen
    gain = towards / size
    mean += gain * error
    c -= gain[ROW] * towards[COLUMN]
    scale, count = state.scale, state.count
    if not renewed:
        learnt = seen & (count > 0.0)  # the first reading forecasts nothing
        scale = np.where(learnt, (count * scale + error**2 / size) / (count + 1.0), scale)
        count = count + seen
    return State(mean, c, scale, state.evidence, count, begun, gain), error, size


def _with_evidence(states: list[State], error: Array, size: Array, seen: Flags) -> list[State]:
    """The states with the evidence of each memory: Student's log density of every forecast error so far."""
    count = np.array([state.count for state in states[:-1]])[:, None]
    scale = np.array([state.scale for state in states[:-1]])
    n = np.maximum(count, 1.0)
    density = gammaln(0.5 * (n + 1.0)) - gammaln(0.5 * n) - 0.5 * np.log(n * np.where(seen[:, None], size, 1.0) * scale)
    density = density - 0.5 * (n + 1.0) * np.log1p(error**2 / (n * size * scale))
    evidence = states[0].evidence + np.cumsum(np.where(seen[:, None] & (count > 0.0), density, 0.0), axis=0)
    return [states[0], *(replace(state, evidence=e) for state, e in zip(states[1:], evidence, strict=True))]


def _course(states: list[State], error: Array, size: Array, variance: Array, warmth: Array) -> Course:
    """What the visits (n,) look like by the memory that was the best before each, and the levels by the best after it."""
    n, each, t = np.arange(len(error))[:, None], np.arange(error.shape[2]), warmth[:, None]
    evidence = np.array([state.evidence for state in states])
    before, after = evidence[:-1].argmax(axis=1), evidence[1:].argmax(axis=1)  # (n, r)
    gain = np.array([state.gain for state in states[:-1]])[n, :, before, each]
    own = size[n, before, each]
    share = np.where(np.isfinite(variance), variance / np.where(np.isfinite(own), own, 1.0), 0.0)
    steps = Steps(error[n, before, each], np.sqrt(own), 1.0 - gain[..., 0] - t * gain[..., 2], share, variance)
    mean = np.array([state.mean for state in states[1:]])[n, :, after, each]
    c = np.array([state.covariance for state in states[1:]])[n, :, after, each]
    scale = np.array([state.scale for state in states[1:]])[n, after, each]
    spread = (c[..., 0] + 2.0 * t * c[..., 2] + t**2 * c[..., 5]) * scale
    begun = np.array([state.begun for state in states[1:]])
    return Course(tuple(states[1:]), steps, mean[..., 0] + t * mean[..., 2], spread, begun)
