"""Alarms of one machine: what stepped or drifts, when, which error is the cause.

The standardised errors x (r,) of a visit's forecast have a covariance of which a mixture is learnt (`Usual`), one visit late: a
step is judged without itself. An error j moves x along a_j = U_j / spread. With Σ the mixture's mean scale its most powerful
combination is h_j = Σ⁻¹ a_j; the mixture says how probable an h_j·x as large is, and that becomes a standard normal score. All
directions together are asked likewise. Of a visit that raised an alarm no more is learnt than its limit (R. A. Maronna 1976).

The cause is the error that explains the most; equal prior probabilities make its probability proportional to exp(½ score²), and
errors with the same a_j share it: the visits cannot distinguish these.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.special import gammainccinv, ndtr, ndtri, softmax

from symfive.arrays import Array
from symfive.history._filter import Steps
from symfive.history._limits import WEIGHT, Limits
from symfive.history._usual import Predictive, Usual

PRESENT = 0.05
"""An error with a smaller share in the determined directions is no candidate: the visits hardly determine it."""
NAMED = 0.05
"""Less probable causes are not reported."""
MOST_CAUSES = 4
KNOWN = 1.0 / 3.0
"""The 1σ of a learnt standard deviation's square, sqrt(2/n) of n readings, below which it is used for comparisons."""
CLEAR = 0.01
"""Chance at which what is left beside the causes counts as nothing."""


@dataclass(frozen=True)
class Cause:
    """An error (or several that cannot be distinguished, with their probabilities) and by how much it changed, file units."""

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
        self.names, self.units, self.scale = tuple(names), tuple(units), scale
        self.usual = Usual(basis, np.array([unit == "urad" for unit in units], dtype=bool))
        self._candidates = np.flatnonzero((basis**2).sum(axis=1) >= PRESENT)
        self._patterns = basis[self._candidates]
        self._pending: tuple[Array, Array, Array] | None = None
        self._late_density: Array | None = None  # by the visit that is pending
        self._last: tuple[_Scores, Limits] | None = None
        self.restart()

    def restart(self) -> None:
        """Begin anew: the machine was changed, or an alarm was raised."""
        self._drift, self._visits = np.zeros(len(self._candidates)), 0
        self._before: _Scores | None = None

    def first_alarm(self, steps: Steps, rate: float, years: Array, first: int) -> Alarm | None:
        """The first alarm that the visits raise, if any; the scatter is estimated from those up to it.

        n visits with their steps (n, r) and the `years` (n,) since the one before each, numbered from `first`. A visit is learnt
        from one visit late: a step is judged without itself.
        """
        if not self._candidates.size:
            return None
        x = steps.error / steps.spread
        chain = [x, steps.reading, steps.variance]
        late = self._pending is not None
        if self._pending is not None:
            chain = [np.concatenate([old[None], new]) for old, new in zip(self._pending, chain, strict=True)]
        updates, visits = self.usual.updates(*chain), np.arange(len(x)) + late
        states = np.maximum(visits - 1, 0)
        visited, evidence = self._scored(updates.predictive(states, visits), steps, x, states)
        alarm = None
        for number, scores in enumerate(visited):
            limits = Limits.of(rate, float(years[number]), len(self._candidates))
            alarm = self._judged(scores, limits, first + number)
            self._before = scores
            if alarm is not None:
                break
        at = number + late
        if alarm is None:
            self.usual.learn(updates, at, evidence[at])
            self._pending = (chain[0][at], chain[1][at], chain[2][at])
            self._late_density = evidence[at + 1] - evidence[at]
        else:
            self._censored(chain, at, evidence, alarm)
        self._last = scores, limits
        return alarm

    def _scored(
        self, expected: Predictive, steps: Steps, x: Array, states: NDArray[np.intp]
    ) -> tuple[list[_Scores], Array]:
        """Score of each error at each visit, also that of a step one visit before, and the evidence of the degrees at each state.

        The evidence is that of each error by itself, as many of them as there are directions.
        """
        pattern, half = self._patterns / steps.spread[:, None], len(self._candidates)  # (n, c, r)
        both = np.concatenate([pattern, pattern * steps.kept[:, None]], axis=1)
        combined = both @ expected.inverse
        norm = np.sqrt(np.maximum((combined * both).sum(axis=2), 1e-300))
        value = (combined @ x[..., None])[..., 0]
        seen = np.maximum(expected.seen.sum(axis=1), 1)
        power = steps.reading.sum(axis=1) / seen * np.minimum(seen / half, 1.0)
        density = power[:, None] * expected.densities(combined[:, :half], value[:, :half]).sum(axis=1)
        density = density if self._late_density is None else np.concatenate([self._late_density[None], density])
        evidence = self.usual.evidence + np.concatenate([np.zeros_like(density[:1]), np.cumsum(density, axis=0)])
        weights = softmax(evidence[states], axis=1)
        chance = np.maximum(expected.chance(combined, value, weights), 1e-300)
        score = -np.sign(value) * ndtri(0.5 * chance)
        together = expected.together(x, weights)
        visited = [
            _Scores(score[i], norm[i], both[i], combined[i], x[i], float(together[i]), weights[i], expected, i)
            for i in range(len(x))
        ]
        return visited, evidence

    def _judged(self, scores: _Scores, limits: Limits, number: int) -> Alarm | None:
        """The alarm of one visit, if any: a step at it or at the one before, several errors at once, a drift."""
        half, before = len(self._candidates), self._before
        score = scores.score[:half]
        self._drift, self._visits = (1.0 - WEIGHT) * self._drift + WEIGHT * score, self._visits + 1
        worst, since = float(np.abs(score).max()), number
        if before is not None:
            two = before.norm[:half] * before.score[:half] + scores.norm[half:] * scores.score[half:]
            two = np.abs(two) / np.maximum(np.hypot(before.norm[:half], scores.norm[half:]), 1e-300)
            if two.max() > worst:
                worst, since = float(two.max()), number - 1
        if worst > limits.step:
            shapes = [scores.whitened(scores.pattern[half:] if since < number else scores.pattern[:half])]
            errors = [scores.whitened(scores.x)]
            if since < number and before is not None:
                shapes.insert(0, before.whitened(before.pattern[:half]))
                errors.insert(0, before.whitened(before.x))
            causes = self._causes(np.concatenate(shapes, axis=1), np.concatenate(errors))
            return Alarm("step", number, since, worst, limits.step, causes)
        if scores.together < limits.together:
            said = -float(ndtri(max(scores.together, 1e-300)))
            limit = -float(ndtri(limits.together))
            causes = self._causes(scores.whitened(scores.pattern[:half]), scores.whitened(scores.x))
            return Alarm("several", number, number, said, limit, causes)
        return self._drifting(scores, limits, number)

    def _drifting(self, scores: _Scores, limits: Limits, number: int) -> Alarm | None:
        size = np.sqrt(WEIGHT / (2.0 - WEIGHT))
        worst = int(np.abs(self._drift).argmax())
        if abs(self._drift[worst]) <= limits.drift * size:
            return None
        pattern = scores.whitened(scores.pattern[: len(self._candidates)])
        spread = size * np.sqrt(1.0 - (1.0 - WEIGHT) ** (2 * self._visits))
        errors = self._drift[worst] / spread * pattern[worst] / np.maximum(np.linalg.norm(pattern[worst]), 1e-300)
        since = number - min(self._visits, round(1.0 / WEIGHT)) + 1
        score = abs(float(self._drift[worst])) / size
        return Alarm("drift", number, since, score, limits.drift, self._causes(pattern, errors)[:1])

    def _censored(self, chain: list[Array], at: int, evidence: Array, alarm: Alarm) -> None:
        """Learn from the visits before an alarm, and of those that it blames what its limit allows."""
        share = min(alarm.limit / alarm.score, 1.0)
        before = max(at - 1, 0)
        self.usual.learn(self.usual.updates(*(entry[: at + 1] for entry in chain)), before, evidence[before])
        if at:
            blamed = alarm.since < alarm.visit
            x, weight, variance = (entry[at - 1 : at] for entry in chain)
            density = evidence[at - 1 if blamed else at]
            self.usual.learn(self.usual.updates(x * (share if blamed else 1.0), weight, variance), 1, density)
        self._pending = (chain[0][at] * share, chain[1][at], chain[2][at])
        self._late_density = np.zeros(evidence.shape[1])

    def smallest(self) -> dict[str, float]:
        """The smallest step of each error that raises an alarm at a next visit like the last one; file units. One
        that only steps beyond the prior's 1σ would raise an alarm for is left out."""
        if self._last is None:
            return {}
        scores, limits = self._last
        half = len(self._candidates)
        combined, square = scores.combined[None, :half], scores.norm[None, :half] ** 2
        expected, chance = scores.expected.of(scores.place), 2.0 * ndtr(-limits.step)
        low, high = np.full((1, half), -12.0), np.full((1, half), 1.0)  # decades of the prior's 1 sigma
        for _ in range(40):
            middle = 0.5 * (low + high)
            missed = expected.chance(combined, 10.0**middle * square, scores.weights[None]) > chance
            low, high = np.where(missed, middle, low), np.where(missed, high, middle)
        return {
            self.names[i]: float(self.scale[i] * 10.0**size)
            for i, size in zip(self._candidates, high[0], strict=True)
            if size < 0.0
        }

    def excess(self, variance: Array) -> Array | None:
        """Covariance (r, r) of the machine's scatter beyond stated variances (r,); None before it is known to a third."""
        if self.usual.visits * len(variance) < 2.0 / KNOWN**2:
            return None
        return self.usual.excess(variance)

    def _causes(self, pattern: Array, errors: Array) -> tuple[Cause, ...]:
        names, units = ([all_[i] for i in self._candidates] for all_ in (self.names, self.units))
        return causes_of(pattern, errors, len(errors), names, units, self.scale[self._candidates])


@dataclass(frozen=True)
class _Scores:
    """One visit: scores and weights `norm` (2c,) of a step now and of one a visit before, of c errors with their `pattern` and
    the directions `combined` (2c, r); x (r,), and the chance of all of it; what was `expected` at this `place`, by which
    `weights` of the degrees."""

    score: Array
    norm: Array
    pattern: Array
    combined: Array
    x: Array
    together: float
    weights: Array
    expected: Predictive
    place: int

    def whitened(self, vectors: Array) -> Array:
        """Vectors (..., r) in units of what is usual."""
        return np.asarray(vectors @ np.linalg.inv(np.linalg.cholesky(self.expected.scale[self.place])).T)


def causes_of(
    pattern: Array, errors: Array, count: int, names: Sequence[str], units: Sequence[str], scale: Array
) -> tuple[Cause, ...]:
    """The fewest candidates that explain standardised `errors` (m,), the clearest first, fitted together.

    `pattern` (c, m) is what one `scale` of each candidate does to them, `names`, `units` and `scale` (c,) are the candidates'.
    Forward selection until what is left is noise of `count` normal scores.
    """
    chosen: list[int] = []
    entries: list[tuple[tuple[str, ...], tuple[float, ...]]] = []
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
        entries.append((tuple(names[i] for i in alike), tuple(float(odds[i]) for i in alike)))
        coefficients, *_ = np.linalg.lstsq(pattern[chosen].T, errors, rcond=None)
        left = errors - coefficients @ pattern[chosen]
        if left @ left <= 2.0 * float(gammainccinv(0.5 * max(count - len(chosen), 1), CLEAR)):
            break
    if not chosen:
        return ()
    spread = np.sqrt(np.maximum(np.diag(np.linalg.pinv(pattern[chosen] @ pattern[chosen].T)), 0.0))
    return tuple(
        Cause(*entry, float(change) * float(scale[i]), float(std) * float(scale[i]), units[i])
        for entry, i, change, std in zip(entries, chosen, coefficients, spread, strict=True)
    )
