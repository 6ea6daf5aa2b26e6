"""A machine's state along each direction: a dynamic linear model with level, rate and temperature, which learns its own scale.

    reading = level + (T - 20 °C)·slope_T + noise,   level grows by rate·dt,   noise ~ N(0, s²·v),

v the variance that the identification states. s² is learnt from the model's own one-step errors, so that a forecast is
Student's t with as many degrees of freedom as visits were learnt from. The past is discounted by exp(-dt/M); of a table of
memories M each direction uses the one whose forecasts were the most probable so far (A. P. Dawid 1984, prequential).
M. West & J. Harrison 1997, Bayesian Forecasting and Dynamic Models, sections 4.5, 6.3, 10.8 (discount, variance learning) and
11.2 (intervention). The same with M fixed, without rate, is the EWMA of the level.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.special import gammaln

__all__ = ["MEMORIES", "Filter", "Step"]

Array = NDArray[np.float64]
MEMORIES = (np.inf, 8.0, 4.0, 2.0, 1.0, 0.5, 0.25)
"""Years, by octaves: from a machine that never forgets to one that a season renews."""
REFERENCE, SPAN = 20.0, 10.0
"""Temperature at which errors count (ISO 1), and the unit of its slope, °C."""


@dataclass(frozen=True)
class Step:
    """One visit against its forecast along r directions: `error` (r,) over `spread` (r,), what the stated uncertainties make of
    the forecast, in scaled units (0 and infinity where nothing was read); `kept` (r,) the share of a step one visit ago that
    the forecast has not yet followed; `reading` (r,) the reading's share of the forecast's variance, small where the level
    itself was hardly known."""

    error: Array
    spread: Array
    kept: Array
    reading: Array


class Filter:
    """The state along r directions, for every memory: mean (M, r, 3) and covariance (M, r, 3, 3) over s², s² (M, r);
    `best` (r,) the memory that each direction uses."""

    def __init__(self, count: int) -> None:
        shape = (len(MEMORIES), count)
        self.mean, self.covariance = np.zeros((*shape, 3)), np.zeros((*shape, 3, 3))
        self.covariance[...] = np.eye(3)  # a prior 1σ as level, in a year, in ten degrees
        self.scale, self.evidence = np.ones(shape), np.zeros(shape)
        self.count, self.begun = np.zeros(count), np.zeros(count, dtype=bool)
        self._each, self.best = np.arange(count), np.zeros(count, dtype=np.intp)
        self._forecast: tuple[Array, Array, Array] | None = None  # of this visit, until the state follows it
        self._memories = np.array(MEMORIES)[:, None, None, None]

    def chosen(self) -> tuple[Array, Array, Array]:
        """Mean (r, 3), covariance (r, 3, 3) in scaled units, and memory (r,) of those."""
        best, each = self.best, self._each
        covariance = self.covariance[best, each] * self.scale[best, each][:, None, None]
        return self.mean[best, each], covariance, np.array(MEMORIES)[best]

    def now(self, warmth: float) -> tuple[Array, Array]:
        """Levels (r,) and their variances now, scaled units, at a `warmth`."""
        best, each = self.best, self._each
        regressor, covariance = np.array([1.0, 0.0, warmth]), self.covariance[best, each]
        return self.mean[best, each] @ regressor, (covariance @ regressor @ regressor) * self.scale[best, each]

    def ahead(self, years: Array, warmth: float) -> tuple[Array, Array]:
        """Levels (n, r) and their variances so many years (n,) from now, scaled units, at a `warmth`."""
        mean, covariance, memory = self.chosen()
        regressors = np.stack([np.ones_like(years), years, np.full_like(years, warmth)], axis=1)
        variance = np.einsum("ni,rij,nj->nr", regressors, covariance, regressors)
        grown = variance * np.exp(np.minimum(years[:, None] / memory, 50.0))
        return regressors @ mean.T, np.minimum(grown, np.maximum(variance, 1.0))

    def elapse(self, years: float) -> None:
        """Time goes by: levels follow their rates, the past counts less."""
        self.mean[..., 0] += years * self.mean[..., 1]
        c = self.covariance
        c[..., 0, :] += years * c[..., 1, :]
        c[..., :, 0] += years * c[..., :, 1]
        widest = np.maximum(c[..., 0, 0], c[..., 1, 1])
        most = np.maximum(1.0 / (self.scale * widest), 1.0)  # nothing is known less than the priors know it
        c[..., :2, :2] *= np.minimum(np.exp(np.minimum(years / self._memories, 50.0)), most[..., None, None])

    def renew(self) -> None:
        """The levels may have changed by as much as the priors allow."""
        self.covariance[..., 0, 0] += 1.0 / self.scale
        self._forecast = None

    def forecast(self, value: Array, variance: Array, warmth: float, before: Array | None) -> Step:
        """The visit's readings (r,) against the forecast; `before` the gain by which the state followed the visit before."""
        seen = np.isfinite(value)
        self._begin(value, seen)
        self._forecast = _, size, error = self._expected(value, variance, warmth)
        best, each = self.best, self._each
        kept = np.ones(len(each)) if before is None else 1.0 - before[best, each] @ np.array([1.0, 0.0, warmth])
        own = size[best, each]
        return Step(error[best, each], np.where(seen, np.sqrt(own), np.inf), kept, np.where(seen, variance / own, 0.0))

    def follow(self, value: Array, variance: Array, warmth: float, *, learn: bool = True) -> Array:
        """Take the visit's readings in; `learn` the scale and the memory from it, too. Returns the gain used (M, r, 3)."""
        towards, size, error = self._forecast or self._expected(value, variance, warmth)
        self._forecast = None
        gain = towards / size[..., None]
        self.mean += gain * error[..., None]
        root = towards / np.sqrt(size)[..., None]
        self.covariance -= (
            root[..., :, None] * root[..., None, :]
        )  # exactly symmetric: what is not grows by the discount
        if learn:
            self._learn(error**2 / (size * self.scale), size, np.isfinite(value))
        return gain

    def _expected(self, value: Array, variance: Array, warmth: float) -> tuple[Array, Array, Array]:
        """Covariance of state and forecast (M, r, 3), the forecast's variance over s² and its error (M, r); a direction that is
        not read has an infinite variance and no error."""
        seen = np.isfinite(value)
        towards = self.covariance[..., 0] + warmth * self.covariance[..., 2]  # times the regressor (1, 0, warmth)
        size = towards[..., 0] + warmth * towards[..., 2] + np.where(seen, variance, np.inf)
        error = np.where(seen, value - self.mean[..., 0] - warmth * self.mean[..., 2], 0.0)
        return towards, size, error

    def _begin(self, value: Array, seen: NDArray[np.bool_]) -> None:
        """A direction that is seen for the first time begins at its reading."""
        new = seen & ~self.begun
        if new.any():
            self.mean[:, new, 0] = value[new]
            self.begun |= new

    def _learn(self, square: Array, size: Array, seen: NDArray[np.bool_]) -> None:
        learnt = seen & (self.count > 0.0)  # the first reading forecasts nothing
        if learnt.any():
            n, square = self.count[learnt], square[:, learnt]
            density = _half_steps(n) - 0.5 * np.log(n * size[:, learnt] * self.scale[:, learnt])
            self.evidence[:, learnt] += density - 0.5 * (n + 1.0) * np.log1p(square / n)
            self.scale[:, learnt] *= (n + square) / (n + 1.0)
            self.best = self.evidence.argmax(axis=0)
        self.count += seen


def _half_steps(n: Array) -> Array:
    """ln Γ((n + 1)/2) - ln Γ(n/2), of Student's density."""
    return np.asarray(gammaln(0.5 * (n + 1.0)) - gammaln(0.5 * n))
