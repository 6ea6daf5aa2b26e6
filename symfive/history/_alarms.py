"""Alarms of one machine: what stepped or drifts, when, which error is the cause.

The standardised errors x (r,) of a visit's forecast have an unknown covariance: the readings' own, and whatever the machine does
from visit to visit. It is learnt from the n visits before, S = Σ w x xᵀ, n = Σ w, w the reading's share
of the forecast's variance: where the level was hardly known, x tells nothing of the scatter. A visit that raised an alarm
counts with no more than its limit (R. A. Maronna 1976). An error j moves x along a_j = U_j / spread. Its score

    F = ν (a' S⁻¹ x)² / (a' S⁻¹ a) / (1 + x' S⁻¹ x - (a' S⁻¹ x)² / (a' S⁻¹ a)),    ν = n - r + 1,

has Fisher's distribution with 1 and ν degrees of freedom whatever the covariance is (C. R. Rao 1973, 8c.4; E. J. Kelly 1986), and
becomes a standard normal score by its probability. T² = x' S⁻¹ x asks all directions together (H. Hotelling 1931).

The cause is the error that explains the most; equal chances beforehand make its probability proportional to exp(½ score²), and
errors with the same a_j share it: that is what the visits cannot tell apart.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.special import fdtrc, gammainccinv, ndtri, stdtr

from symfive.history._filter import Step
from symfive.history._limits import WEIGHT, Limits

__all__ = ["Alarm", "Cause", "Watch", "causes_of"]

Array = NDArray[np.float64]
PRESENT = 0.05
"""An error with a smaller share in the determined directions is no candidate: the visits hardly see it."""
NAMED = 0.05
"""Less probable causes are not spoken of."""
MOST_CAUSES = 4
CLEAR = 0.01
"""Chance at which what is left beside the causes counts as nothing."""


@dataclass(frozen=True)
class Cause:
    """An error (or several that cannot be told apart, with their probabilities) and by how much it changed, file units."""

    names: tuple[str, ...]
    probabilities: tuple[float, ...]
    change: float
    std: float
    unit: str


@dataclass(frozen=True)
class Alarm:
    """An alarm: `kind` is `step`, `several` (errors at once) or `drift`; `visit` the number of the visit that raised it, `since`
    that of the first visit after the change; `score` against its `limit`."""

    kind: str
    visit: int
    since: int
    score: float
    limit: float
    causes: tuple[Cause, ...]


class Watch:
    """Watches the steps of a filter; `basis` (k, r), `names`, `units` and `scale` (k,) of the errors."""

    def __init__(self, basis: Array, names: Sequence[str], units: Sequence[str], scale: Array) -> None:
        self.basis, self.names, self.units, self.scale = basis, tuple(names), tuple(units), scale
        self._candidates = np.flatnonzero((basis**2).sum(axis=1) >= PRESENT)
        self._patterns = basis[self._candidates]
        self._sum, self._count = np.zeros((2, basis.shape[1], basis.shape[1]))
        self._pending: tuple[Array, Array] | None = None
        self.first: int | None = None  # the visit at which the scatter was known
        self.forget()

    def forget(self) -> None:
        """Begin anew: the machine was changed, or an alarm was raised."""
        self._drift, self._looks = np.zeros(len(self._candidates)), 0
        self._before: tuple[Array, Array, Array, Array] | None = None

    def learn(self, step: Step, alarm: Alarm | None) -> None:
        """Take the visit into the machine's scatter, one visit late: a step is judged without itself. Of an alarm's visits what
        its limit allows."""
        share = 1.0 if alarm is None else min(alarm.limit / alarm.score, 1.0)
        if self._pending is not None:
            x, weight = self._pending
            x = x * (share if alarm is not None and alarm.since < alarm.visit else 1.0)
            self._sum += x[:, None] * x
            self._count += weight[:, None] * weight
        weight = np.sqrt(step.reading)
        self._pending = weight * share * step.error / step.spread, weight

    def excess(self, variance: Array) -> Array | None:
        """Covariance (r, r) of the machine's scatter beyond stated variances (r,); None before it is known."""
        count = float(self._count.min(initial=np.inf))
        if count - len(self._sum) < 1.0:
            return None
        size, axes = np.linalg.eigh(self._sum / np.maximum(self._count, 1.0) - np.eye(len(self._sum)))
        known = (axes * np.maximum(size, 0.0)) @ axes.T
        std = np.sqrt(variance)
        return np.asarray(known * np.outer(std, std))

    def look(self, step: Step, rate: float, years: float, number: int) -> Alarm | None:
        """The alarm that this visit raises, if any."""
        seen = np.flatnonzero(np.isfinite(step.spread))
        if not seen.size or not self._candidates.size:
            return None
        limits = Limits.of(rate, years, len(self._candidates))
        whiten, dof = self._whitening(seen)
        if dof < 1.0:
            return None
        self.first = number if self.first is None else self.first
        x = whiten @ (step.error / step.spread)[seen]
        pattern = self._patterns[:, seen] / step.spread[seen]
        both = np.concatenate([pattern, pattern * step.kept[seen]]) @ whiten.T
        scores, weights = _scores(both, x, dof)
        half = len(pattern)
        score, weight, now, later = scores[:half], weights[:half], both[:half], both[half:]
        self._drift, self._looks = (1.0 - WEIGHT) * self._drift + WEIGHT * score, self._looks + 1
        tests = [(float(np.abs(score).max()), number, now, x)]
        if self._before is not None:
            first, heavy, shape, errors = self._before
            two = np.abs(heavy * first + weights[half:] * scores[half:]) / np.maximum(
                np.hypot(heavy, weights[half:]), 1e-300
            )
            stacked = np.concatenate([shape, later], axis=1), np.concatenate([errors, x])
            tests.append((float(two.max()), number - 1, *stacked))
        self._before = score, weight, now, x
        size, since, shape, errors = max(tests, key=lambda test: test[0])
        if size > limits.step:
            return Alarm("step", number, since, size, limits.step, self._causes(shape, errors))
        chance = _together(x, dof)
        if chance < limits.together:
            said = -float(ndtri(max(chance, 1e-300)))
            return Alarm("several", number, number, said, -float(ndtri(limits.together)), self._causes(now, x))
        spread = np.sqrt(WEIGHT / (2.0 - WEIGHT) * (1.0 - (1.0 - WEIGHT) ** (2 * self._looks)))
        worst = int(np.abs(self._drift).argmax())
        if abs(self._drift[worst]) > limits.drift * np.sqrt(WEIGHT / (2.0 - WEIGHT)):
            errors = self._drift[worst] / spread * now[worst] / np.maximum(np.linalg.norm(now[worst]), 1e-300)
            size = abs(float(self._drift[worst])) / np.sqrt(WEIGHT / (2.0 - WEIGHT))
            since = number - min(self._looks, round(1.0 / WEIGHT)) + 1
            return Alarm("drift", number, since, size, limits.drift, self._causes(now, errors)[:1])
        return None

    def _whitening(self, seen: NDArray[np.intp]) -> tuple[Array, float]:
        """W with W R Wᵀ = 1 for the learnt covariance R of the directions seen, and the degrees of freedom ν."""
        count = self._count[seen][:, seen]
        learnt, dof = self._sum[seen][:, seen] / np.maximum(count, 1.0), float(count.min()) - len(seen) + 1.0
        if dof < 1.0:
            return learnt, dof
        try:
            return np.linalg.inv(np.linalg.cholesky(learnt)), dof
        except np.linalg.LinAlgError:  # directions seen at different visits may leave no covariance
            size, axes = np.linalg.eigh(learnt)
            return np.asarray((axes / np.sqrt(np.maximum(size, 1e-12 * size[-1]))).T), dof

    def _causes(self, pattern: Array, errors: Array) -> tuple[Cause, ...]:
        where = self._candidates
        found = causes_of(pattern, errors, len(errors))
        return tuple(
            Cause(tuple(self.names[where[i]] for i in which), shares, change * float(self.scale[where[which[0]]]),
                  std * float(self.scale[where[which[0]]]), self.units[where[which[0]]])
            for which, shares, change, std in found
        )  # fmt: skip


def _scores(pattern: Array, x: Array, dof: float) -> tuple[Array, Array]:
    """Standard normal score of each candidate (c,) and its weight |a|; `pattern` (c, m) and `x` (m,) whitened."""
    norm = np.sqrt((pattern**2).sum(axis=1))
    along = pattern @ x / np.where(norm > 0.0, norm, np.inf)
    total = dof + len(x) - 1.0  # degrees of freedom of the covariance that whitened them
    t = along * np.sqrt(dof / (total + x @ x - along**2))
    tail = np.maximum(stdtr(dof, -np.abs(t)), 1e-300)
    return -np.sign(t) * ndtri(tail), norm


def _together(x: Array, dof: float) -> float:
    """The chance of a T² as large while nothing changes."""
    total = dof + len(x) - 1.0
    return float(fdtrc(len(x), dof, dof / len(x) * (x @ x) / total))


def causes_of(
    pattern: Array, errors: Array, count: int
) -> list[tuple[tuple[int, ...], tuple[float, ...], float, float]]:
    """The fewest candidates that explain standardised `errors` (m,), the clearest first, fitted together.

    `pattern` (c, m) is what one unit of each candidate does to them. Each entry: the candidates that explain it alike, by
    their probabilities, the change and its 1σ in units of the candidates. Forward selection until what is left is noise of
    `count` normal scores.
    """
    chosen: list[int] = []
    told: list[tuple[tuple[int, ...], tuple[float, ...]]] = []
    left = errors
    while len(chosen) < min(MOST_CAUSES, len(pattern)):
        free = pattern if not chosen else pattern - pattern @ np.linalg.pinv(pattern[chosen]) @ pattern[chosen]
        size = (free**2).sum(axis=1)
        open_ = size > 1e-9 * np.maximum((pattern**2).sum(axis=1), 1e-300)
        explained = np.where(open_, (free @ left) ** 2 / np.where(open_, size, 1.0), -np.inf)
        best = int(explained.argmax())
        if not np.isfinite(explained[best]):
            break
        odds = np.exp(0.5 * (explained - explained[best]))
        odds /= odds.sum()
        alike = [best, *(int(i) for i in np.argsort(-odds) if i != best and odds[i] >= NAMED)]
        chosen.append(best)
        told.append((tuple(alike), tuple(float(odds[i]) for i in alike)))
        coefficients, *_ = np.linalg.lstsq(pattern[chosen].T, errors, rcond=None)
        left = errors - coefficients @ pattern[chosen]
        if left @ left <= 2.0 * float(gammainccinv(0.5 * max(count - len(chosen), 1), CLEAR)):
            break
    if not chosen:
        return []
    spread = np.sqrt(np.maximum(np.diag(np.linalg.pinv(pattern[chosen] @ pattern[chosen].T)), 0.0))
    return [(*entry, float(c), float(s)) for entry, c, s in zip(told, coefficients, spread, strict=True)]
