"""Optimal weights on circles or sweeps, and the lowest ψ that any weights can have: what a certificate compares with.

Weights w, in units of cost, on what is `Offered` in every mounting m, Σ w = T, add Σ w M/c. Whatever w is (Kiefer & Wolfowitz
1960, Pukelsheim 1993, ch. 7; of draws d with λ ≥ 0, Σ λ = 1),

    ψ ≥ Σ λ ψ_d(w) - log(Σ λ ⟨G_d, P⟩ + T · max over all of Σ λ ⟨G_d, M_d⟩/c),   G_d = -dψ_d/dM, P the prior's,

and of several mountings each meets only the block of G of its own parameters, whose set-up errors are no other's. λ is 1/draws
for the mean, found by dual averaging for the worst case (max ψ ≥ Σ λ ψ; Y. Nesterov 2009). The weights move by multiplicative
steps (D. M. Titterington 1976); candidates whose weights have become small wait until one of the looks at all of them says that
they gain.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cache
from typing import Protocol

import numpy as np

from symfive.arrays import Array, Flags, Indices
from symfive.design._circles import Goal

STEPS, GAP = 1000, 2e-3
BETWEEN, LEAST = 25, 0.01
"""Steps between two looks at all candidates, and the share of an even weight below which one that loses is left out of these."""


class Informative(Protocol):
    """What adds information: `matrices` (k, k), file units, at every draw from the prior."""

    @property
    def matrices(self) -> tuple[Array, ...]: ...


@cache
def _upper(k: int) -> tuple[Indices, Indices]:
    """Rows and columns of the upper triangle of a matrix (k, k), row by row."""
    rows, columns = np.triu_indices(k)
    return rows, columns


@dataclass(frozen=True)
class Offered:
    """What may be recorded in one mounting: `rates` (n, k·(k + 1)/2) by draw, the upper triangles of the information per cost;
    `own` (k,) the parameters that no other mounting shares, `shared` what information (k, k) says of the others."""

    rates: tuple[Array, ...]
    own: Flags
    shared: Callable[[Array], Array]

    @classmethod
    def of(
        cls, some: Sequence[Informative], costs: Array, own: Flags | None = None,
        shared: Callable[[Array], Array] = lambda total: total, draws: int = 1,
    ) -> Offered:  # fmt: skip
        """Circles or sweeps of these costs (n,)."""
        k = len(some[0].matrices[0])
        upper = _upper(k)
        rates = tuple(
            np.array([each.matrices[d][upper] / cost for each, cost in zip(some, costs, strict=True)])
            for d in range(draws)
        )
        return cls(rates, np.zeros(k, dtype=bool) if own is None else own, shared)

    def __len__(self) -> int:
        return len(self.rates[0])

    def part(self, which: Indices) -> Offered:
        """Some of these."""
        return self if len(which) == len(self) else replace(self, rates=tuple(rates[which] for rates in self.rates))

    def total(self, weights: Array, draw: int) -> Array:
        """Information (k, k) of weights (n,)."""
        k = len(self.own)
        found = np.zeros((k, k))
        upper = _upper(k)
        found[upper] = found.T[upper] = weights @ self.rates[draw]
        return found

    def seen(self, pulls: Sequence[Array]) -> Array:
        """Σ over the draws of ⟨G, M⟩/c (n,)."""
        upper = _upper(len(self.own))
        twice = np.where(upper[0] == upper[1], 1.0, 2.0)
        return np.asarray(
            sum(rates @ (twice * pull[upper]) for rates, pull in zip(self.rates, pulls, strict=True))
        )  # fmt: skip


def together(shared: Sequence[Callable[[Array], Array]], goal: Goal, totals: Sequence[Array]) -> list[Goal]:
    """For every mounting the goal that knows what the recordings of the others tell, by their information `totals` (k, k) and
    what this says of the `shared` parameters."""
    told = [says(total) for says, total in zip(shared, totals, strict=True)]
    return [replace(goal, known=goal.known + sum(told[:i]) + sum(told[i + 1 :])) for i in range(len(told))]


def relaxed_bound(goal: Goal, some: Sequence[Informative], costs: Array, budget: float) -> tuple[Array, float]:
    """Weights (n,) on circles or sweeps of one mounting, of the costs (n,), that add up to a budget, and the lowest ψ that any
    such weights can have."""
    draws = 1 if goal.robust == "nominal" else len(some[0].matrices)
    (weights,), bound = optimal_weights(goal, [Offered.of(some, costs, draws=draws)], budget)
    return weights, bound


def optimal_weights(goal: Goal, offers: Sequence[Offered], budget: float) -> tuple[list[Array], float]:
    """Weights (n,) of every mounting, which add up to a budget altogether, and the lowest ψ that any such weights can have."""
    even = budget / sum(map(len, offers))
    weights = [np.full(len(offer), even) for offer in offers]
    if goal.robust == "worst":
        return _stepped(goal, offers, weights, budget, STEPS)
    bound = -math.inf
    for _ in range(STEPS // BETWEEN):
        point = _Point.at(goal, offers, weights, budget)
        seen = point.seen(offers)
        bound = max(bound, point.bound(seen, budget))
        if point.value - bound < GAP:
            break
        mean = sum(float(w @ s) for w, s in zip(weights, seen, strict=True)) / budget
        counts = [(w > LEAST * even) | (s > mean) for w, s in zip(weights, seen, strict=True)]
        some = [offer.part(np.flatnonzero(c)) for offer, c in zip(offers, counts, strict=True)]
        start = [np.maximum(w[c], LEAST * even) for w, c in zip(weights, counts, strict=True)]
        whole = sum(float(w.sum()) for w in start)
        found = _stepped(goal, some, [w * (budget / whole) for w in start], budget, BETWEEN)[0]
        weights = [np.zeros(len(offer)) for offer in offers]
        for w, c, part in zip(weights, counts, found, strict=True):
            w[c] = part
    return weights, bound


@dataclass(frozen=True)
class _Point:
    """Weights: ψ (draws,), the `share` of every draw in the bound, G by mounting and draw times this share, and Σ ⟨G, P⟩."""

    psi: Array
    share: Array
    pulls: list[list[Array]]
    prior: float
    value: float

    @classmethod
    def at(
        cls, goal: Goal, offers: Sequence[Offered], weights: Sequence[Array], budget: float,
        past: Array | float = 0.0, step: int = 1,
    ) -> _Point:  # fmt: skip
        """The point of some weights in a `step`; `past` (draws,) is Σ ψ of the steps before, by which the worst case shares."""
        draws = range(len(offers[0].rates))
        totals = [[offer.total(w, d) for offer, w in zip(offers, weights, strict=True)] for d in draws]
        goals = [together([offer.shared for offer in offers], goal, total) for total in totals]
        found = [own[0].psi_and_pull(total[0]) for own, total in zip(goals, totals, strict=True)]
        psi = np.array([value for value, _ in found])
        score = (past + psi) / math.sqrt(step) if goal.robust == "worst" else np.zeros(len(draws))
        share = np.exp(score - score.max())
        share /= share.sum()
        pulls = [[s * pull for s, (_, pull) in zip(share, found, strict=True)]]
        pulls += [
            [s * own[m].pull(total[m]) for s, own, total in zip(share, goals, totals, strict=True)]
            for m in range(1, len(offers))
        ]
        known = np.diag(goal.scale**-2.0) + goal.known
        prior = sum(float(np.sum(pull * known)) for pull in pulls[0])
        for offer, some in zip(offers[1:], pulls[1:], strict=True):
            prior += sum(float(np.diag(pull)[offer.own] @ goal.scale[offer.own] ** -2.0) for pull in some)
        return cls(psi, share, pulls, prior, goal.joined(psi.tolist(), budget))

    def seen(self, offers: Sequence[Offered]) -> list[Array]:
        """Σ over the draws of ⟨G, M⟩/c (n,) of what every mounting offers."""
        return [offer.seen(pulls) for offer, pulls in zip(offers, self.pulls, strict=True)]

    def bound(self, seen: Sequence[Array], budget: float) -> float:
        """The lowest ψ of any weights."""
        most = max(float(s.max(initial=0.0)) for s in seen)
        return float(self.share @ self.psi) - math.log(self.prior + budget * most)


def _stepped(
    goal: Goal, offers: Sequence[Offered], weights: list[Array], budget: float, steps: int
) -> tuple[list[Array], float]:  # fmt: skip
    """The best weights of multiplicative steps from some, and the bound."""
    power, bound = 1.0 if goal.criterion.determinant else 0.5, -math.inf
    best, lowest, past = weights, math.inf, np.zeros(len(offers[0].rates))
    for step in range(1, steps + 1):
        point = _Point.at(goal, offers, weights, budget, past, step)
        seen, past = point.seen(offers), past + point.psi
        bound = max(bound, point.bound(seen, budget))
        if point.value < lowest:
            best, lowest = weights, point.value
        if lowest - bound < GAP:
            break
        weights = [w * np.maximum(s, 0.0) ** power for w, s in zip(weights, seen, strict=True)]
        whole = sum(float(w.sum()) for w in weights)
        weights = [w * (budget / whole) for w in weights]
    return best, bound
