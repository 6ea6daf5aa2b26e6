"""The expected information of a plan about effects: the mutual information of their parameters and the readings.

    I = E[log p(y | θ) - log p(y)],  θ from the priors, y the readings that it would give,

in nats. A linear design at one guess is right only where the readings answer alike to every size. Errors of the machine and the
set-up are Gaussian and act as at the effects' typical sizes, so that p(y | θ) is a normal density; p(y) is an average over θ, of
which every estimate from finitely many draws is biased, one way or the other. With draws θ₁…θ_L from a proposal q(θ | y) that
knows the readings but not the truth θ₀, and w = p(y, θ)/q(θ | y),

    E[log p(y | θ₀) - log mean(w₀, w₁…w_L)]  ≤  I  ≤  E[log p(y | θ₀) - log mean(w₁…w_L)]

(A. Foster et al. 2019, 2020: variational nested and adaptive contrastive estimation). q is Student's t about the posterior mode
with the curvature there, so that few draws bring the two together.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
import scipy  # its parts are loaded where they are used: of a static plan none is

from symfive.arrays import Array
from symfive.campaign import Campaign
from symfive.design._circles import typical_values
from symfive.effects import Effect
from symfive.errors import EvaluationError, InputError
from symfive.model import Model
from symfive.threads import one_thread

DRAWS, SAMPLES = 16, 8
STARTS, ITERATIONS, HALVINGS, SETTLED = 3, 20, 8, 0.01
"""Of the search for the posterior mode; nats within which it has settled. A worse mode makes the bounds wider, not wrong."""
FREEDOM = 5.0
"""Degrees of freedom of the proposal: tails that are wider than those of the posterior, so that weights stay bounded."""


@dataclass(frozen=True)
class Information:
    """Expected information of a plan about `parameters`, nats: it lies between `lower` and `upper`, each with the standard error
    of its mean over `draws`; `linear`: by the slopes at the effects' typical sizes."""

    parameters: tuple[str, ...]
    lower: tuple[float, float]
    upper: tuple[float, float]
    linear: float
    draws: int

    def to_data(self) -> dict[str, Any]:
        """`information` of plan.json."""
        (lower, lower_error), (upper, upper_error) = self.lower, self.upper
        return {
            "parameters": list(self.parameters), "draws": self.draws, "lower_nats": lower, "lower_standard_error": lower_error,
            "upper_nats": upper, "upper_standard_error": upper_error, "linear_nats": self.linear,
        }  # fmt: skip

    @property
    def says(self) -> str:
        """The result in a sentence."""
        low, high = (max(bound, 0.0) for bound in sorted((self.lower[0], self.upper[0])))
        error, factor = max(self.lower[1], self.upper[1]), math.exp(0.5 * (low + high) / len(self.parameters))
        times = f"{factor:,.0f}" if factor >= 10.0 else f"{factor:.1f}"
        return (
            f"expected information {low:.2f} to {high:.2f} nats (± {error:.2f} from {self.draws} draws of the effects' sizes; "
            f"{self.linear:.2f} at typical sizes): each 1σ becomes {times} times smaller (geometric mean)"
        )


@one_thread
def expected_information(
    plan: Campaign,
    effects: Sequence[Effect],
    *,
    for_: Iterable[str] = (),
    draws: int = DRAWS,
    samples: int = SAMPLES,
    seed: int = 0,
) -> Information:
    """Bounds of the information that the readings of a `plan` (campaign without readings) are expected to give about the
    parameters of `effects` (or those named in `for_`); errors of the machine, its drives and the set-up are unknown within their
    priors.

    `draws` of the effects' parameters and readings, `samples` from each proposal. Raises `InputError` where a parameter is
    unknown or none is meant.
    """
    model = Model(plan, effects)
    names = tuple(for_) or tuple(p.name for p in model.parameters if p.kind == "effect")
    strange = [name for name in names if name not in model.index]
    if strange or not names:
        problem = f"there is no parameter {', '.join(strange)}" if strange else "no parameter is meant"
        raise InputError(problem, remedy="name parameters of the effects")
    if min(draws, samples) < 2:
        raise InputError("draws and samples have to be at least 2", remedy="leave them out")
    readings = _Readings(model, [model.index[name] for name in names])
    generator = np.random.default_rng(seed)
    drawn = readings.drawn(generator, draws)
    clean = [readings.predicted(theta) for theta in drawn]
    bounds = []
    for number, (truth, plain) in enumerate(zip(drawn, clean, strict=True)):
        y = plain + readings.noise(generator)
        others = [(theta, at) for k, (theta, at) in enumerate(zip(drawn, clean, strict=True)) if k != number]
        bounds.append(_bounds(readings, truth, plain, y, others, samples, generator))
    means, errors = np.mean(bounds, axis=0), np.std(bounds, axis=0, ddof=1) / math.sqrt(draws)
    lower, upper = zip(means.tolist(), errors.tolist(), strict=True)
    return Information(names, lower, upper, readings.linear, draws)


class _Readings:
    """The whitened readings of a plan as functions of the parameters `wanted` (indices), θ in prior 1σ off the prior means; all
    other parameters act linearly."""

    def __init__(self, model: Model, wanted: Sequence[int]) -> None:
        self.model, self.wanted = model, np.array(wanted)
        self.mean, self.sigma = model.prior_mean[self.wanted], model.prior_sigma[self.wanted]
        bounds = np.array([(model.parameters[i].lower, model.parameters[i].upper) for i in wanted])
        self.lower, self.upper = ((bounds - self.mean[:, None]) / self.sigma[:, None]).T
        self.typical = typical_values(model)
        self.slopes = self._slopes(self.typical)
        others = np.setdiff1d(np.arange(len(model.parameters)), self.wanted)
        self.other = self.slopes[:, others] * model.prior_sigma[others]
        self.factor = np.linalg.cholesky(np.eye(len(others)) + self.other.T @ self.other)

    def _slopes(self, values: Array) -> Array:
        """Whitened Jacobian of all readings (N, parameters)."""
        tables = []
        for run in self.model.campaign.runs:
            line = self.model.linearise(run, values)
            table = np.zeros((line.prediction.size, len(values)))
            table[:, line.columns] = (line.jacobian / self.model.noise(run)[:, None]).reshape(len(table), -1)
            tables.append(table)
        return np.concatenate(tables)

    def _vector(self, theta: Array) -> Array:
        vector = self.typical.copy()
        vector[self.wanted] = self.mean + self.sigma * theta
        return vector

    def predicted(self, theta: Array) -> Array:
        """Whitened readings without noise and without what the other parameters add (N,)."""
        vector = self._vector(theta)
        runs = self.model.campaign.runs
        return np.concatenate([(self.model.predict_run(r, vector) / self.model.noise(r)).ravel() for r in runs])

    def slopes_at(self, theta: Array) -> Array:
        """Change of `predicted` with θ (N, k)."""
        return np.asarray(self._slopes(self._vector(theta))[:, self.wanted] * self.sigma)

    def noise(self, generator: np.random.Generator) -> Array:
        """One draw of the noise and of what the other parameters add (N,)."""
        rows, columns = self.other.shape
        return np.asarray(generator.standard_normal(rows) + self.other @ generator.standard_normal(columns))

    def drawn(self, generator: np.random.Generator, count: int) -> list[Array]:
        """Draws from the prior within its bounds."""
        low, high = scipy.special.ndtr(self.lower), scipy.special.ndtr(self.upper)
        return list(scipy.special.ndtri(low + (high - low) * generator.random((count, len(self.sigma)))))

    def log_prior(self, theta: Array) -> float:
        """Log of the prior density."""
        if np.any((theta < self.lower) | (theta > self.upper)):
            return -math.inf
        share = scipy.special.ndtr(self.upper) - scipy.special.ndtr(self.lower)
        return -0.5 * float(np.sum(theta**2 + np.log(2.0 * math.pi * share**2)))

    def inner(self, a: Array, b: Array) -> Array:
        """aᵀ Σ⁻¹ b, Σ the covariance of noise and of what the other parameters add: of slopes (N, k) the information about θ, of
        slopes and a residual (N,) the slope of the log likelihood, of a residual -2 times that but for a constant."""
        given = [self.other.T @ each for each in ((a,) if b is a else (a, b))]
        seen = [scipy.linalg.solve_triangular(self.factor, each, lower=True) for each in given]
        return np.asarray(a.T @ b - seen[0].T @ seen[-1])

    def log_likelihood(self, residual: Array) -> float:
        """Log of p(y | θ) but for a constant, of whitened readings less those predicted."""
        return -0.5 * float(self.inner(residual, residual))

    @cached_property
    def linear(self) -> float:
        """Information at the typical sizes, by the slopes there, nats."""
        return 0.5 * float(np.linalg.slogdet(self.precision(self.slopes[:, self.wanted] * self.sigma))[1])

    def precision(self, slopes: Array) -> Array:
        """Of θ, from its prior and readings of such slopes (k, k)."""
        return np.eye(slopes.shape[1]) + self.inner(slopes, slopes)


class _Student:
    """Student's t in k dimensions about a `mode`, of a precision matrix (k, k)."""

    def __init__(self, mode: Array, precision: Array) -> None:
        self._mode, self._root = mode, np.linalg.cholesky(precision)
        k = len(mode)
        self._log = math.lgamma(0.5 * (FREEDOM + k)) - math.lgamma(0.5 * FREEDOM)
        self._log += float(np.log(np.diag(self._root)).sum()) - 0.5 * k * math.log(FREEDOM * math.pi)

    def drawn(self, generator: np.random.Generator) -> Array:
        """One draw (k,)."""
        z = scipy.linalg.solve_triangular(self._root.T, generator.standard_normal(len(self._mode)), lower=False)
        return np.asarray(self._mode + z / math.sqrt(generator.chisquare(FREEDOM) / FREEDOM))

    def log_density(self, theta: Array) -> float:
        """Log of the density."""
        square = float(np.sum((self._root.T @ (theta - self._mode)) ** 2))
        return self._log - 0.5 * (FREEDOM + len(theta)) * math.log1p(square / FREEDOM)


def _bounds(
    readings: _Readings, truth: Array, plain: Array, y: Array, others: Sequence[tuple[Array, Array]], samples: int,
    generator: np.random.Generator,
) -> tuple[float, float]:  # fmt: skip
    """One term of the lower and of the upper mean."""
    proposal, own = _proposal(readings, y, others), readings.log_likelihood(y - plain)
    weights = [own + readings.log_prior(truth) - proposal.log_density(truth)]
    for theta in (proposal.drawn(generator) for _ in range(samples)):
        prior = readings.log_prior(theta)
        likelihood = _left(readings, theta, y)[0] if math.isfinite(prior) else 0.0
        weights.append(likelihood + prior - proposal.log_density(theta))
    lower = own - float(scipy.special.logsumexp(weights)) + math.log(samples + 1)
    upper = own - float(scipy.special.logsumexp(weights[1:])) + math.log(samples)
    return lower, upper


def _left(readings: _Readings, theta: Array, y: Array) -> tuple[float, Array]:
    """Log likelihood at θ, and the residual."""
    try:
        residual = y - readings.predicted(theta)
    except EvaluationError:
        return -math.inf, y  # a drive that is unstable gives no such readings
    return readings.log_likelihood(residual), residual


def _proposal(readings: _Readings, y: Array, others: Sequence[tuple[Array, Array]]) -> _Student:
    """Student's t about the posterior mode, the best that is found from the likeliest of `others`, draws but for the truth."""
    starts = [(_log_posterior(theta, readings.log_likelihood(y - at)), theta, y - at) for theta, at in others]
    ranked = sorted(starts, key=lambda each: -each[0])[:STARTS]
    theta = max((_mode(readings, y, *start) for start in ranked), key=lambda each: each[0])[1]
    return _Student(theta, readings.precision(readings.slopes_at(theta)))


def _log_posterior(theta: Array, log_likelihood: float) -> float:
    return log_likelihood - 0.5 * float(theta @ theta)


def _mode(readings: _Readings, y: Array, best: float, theta: Array, residual: Array) -> tuple[float, Array]:
    """The log posterior and θ that Gauss-Newton steps, halved where they are too long, reach from a θ with its log posterior
    `best` and its residual."""
    for _ in range(ITERATIONS):
        slopes = readings.slopes_at(theta)
        step = np.linalg.solve(readings.precision(slopes), readings.inner(slopes, residual) - theta)
        for halving in range(HALVINGS):
            tried = np.clip(theta + 0.5**halving * step, readings.lower, readings.upper)
            likelihood, left = _left(readings, tried, y)
            value = _log_posterior(tried, likelihood)
            if value > best:
                break
        else:
            return best, theta
        settled, best, theta, residual = value - best < SETTLED, value, tried, left
        if settled:
            break
    return best, theta
