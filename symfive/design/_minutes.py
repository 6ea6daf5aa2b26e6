"""What several instruments can do together in given minutes, and what each can do alone: relaxed designs and their bound.

A mix is how often each instrument is mounted. Each mounting costs its set-up; the seconds left are divided among poses at rest
and circles by weights of any size. With G = -dψ/dM at any information M of the machine, set-up errors marginalised (see
`_anywhere`), every plan of a mix with K_i mountings of instrument i in t seconds of reading has

    ψ ≥ ψ(M) - log(⟨G, P⟩ + λ t + Σ K_i max over mountings m of i of f_m(λ)),
    f_m(λ) = min over B of tr(G Bᵀ Pₒ B) + t max(0, max over readings of |(J + Jₒ B)ᵀ G^½|² - λ),

for any λ ≥ 0 and any matrices B, J and Jₒ per second of reading. M is the best design with fractions of mountings of the mix
whose bound is lowest, by column generation, until bound and design meet. Set-ups, poses and circles are on grids: between
these nothing is proved.
"""

from __future__ import annotations

import itertools
import math
from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from symfive.arrays import Array
from symfive.design._mountings import Mounting
from symfive.design._schedule import SETUP_S
from symfive.optimal import Candidates, Task, exchanged_options, inverse, marginal_sensitivity, relax

Kinds = tuple[str, ...]
GAP = 1e-2
SHARES = (0.02, 0.1, 0.35, 1.0)
"""Of the seconds of reading: what a mounting might get, for which its B is sought."""
FRESH = 0.1
"""Share of a design that mountings which join it get at first: what only they tell is then no longer unknown."""
LEAST_POSES = 2
WORTH = 1e-3
"""What another mix must lower ψ by."""
JOINING, ROUNDS = 6, 25
"""Mountings of a kind that join a design at a time, and how often at most."""


@dataclass(frozen=True)
class Mix:
    """One instrument a mounting, `kinds` in order; `value` the ψ that a relaxed design reaches, `weights` s of every
    reading in each of `mountings`."""

    kinds: Kinds
    value: float
    mountings: tuple[Mounting, ...]
    weights: tuple[Array, ...]


class Mixes:
    """All mixes of at most `most` mountings in `minutes`, for a `task` whose set-up errors are per prior 1σ; `pace` s a pose."""

    def __init__(
        self, task: Task, mountings: Sequence[Mounting], minutes: float, pace: float, most: int,
        progress: Callable[[str], None] = lambda message: None,
    ) -> None:  # fmt: skip
        self.task, self.mountings, self.minutes, self.pace = task, mountings, minutes, pace
        self.most, self.progress = most, progress
        self.of_kind = {kind: [m for m in mountings if m.kind == kind] for kind in sorted({m.kind for m in mountings})}
        self._reached: dict[Kinds, Mix] = {}

    def seconds(self, count: int) -> float:
        """Reading time beside `count` set-ups; the first pose of each costs no more than its set-up."""
        return 60.0 * self.minutes - count * (SETUP_S - self.pace)

    @cached_property
    def all(self) -> list[Kinds]:
        """Every mix that leaves two poses a mounting beside the set-ups, as `plan` demands (`affordable`)."""
        most = min(self.most, int(60.0 * self.minutes // (SETUP_S + LEAST_POSES * self.pace)))
        return [kinds for c in range(1, most + 1) for kinds in itertools.combinations_with_replacement(self.of_kind, c)]

    def reached(self, kinds: Kinds) -> Mix:
        """The relaxed design of a mix in the set-ups found best for it."""
        if kinds not in self._reached:
            mix = self._reached[kinds] = self._designed(kinds)
            self.progress(f"{', '.join(kinds)}: criterion ψ = {mix.value:.5f}")
        return self._reached[kinds]

    def _designed(self, kinds: Kinds) -> Mix:
        shared, seconds = len(self.task.prior), self.seconds(len(kinds))
        part = seconds / len(kinds)
        weights = {id(m): np.full(len(m.rows), part / len(m.rows)) for kind in set(kinds) for m in self.of_kind[kind]}
        best: tuple[float, list[Mounting]] = (math.inf, [])
        for _ in range(3):
            gains = {
                kind: np.stack([m.added(weights[id(m)], shared) for m in self.of_kind[kind]]) for kind in set(kinds)
            }
            value, picked = self._exchanged(kinds, gains)
            if value >= best[0] - 1e-6:
                break
            chosen = [self.of_kind[kind][i] for kind, i in zip(kinds, picked, strict=True)]
            best = (value, chosen)
            known = self.task.prior + sum(gains[kind][i] for kind, i in zip(kinds, picked, strict=True))
            pull, own = self.task.pull(inverse(known)), np.eye(len(self.task.own_sigma))
            weights = dict(self._informative(kinds, pull, own, part))
        return self._relaxed(kinds, best[1])

    def _informative(self, kinds: Kinds, pull: Array, own: Array, part: float) -> Iterator[tuple[int, Array]]:
        for kind in set(kinds):
            of = self.of_kind[kind]
            found = marginal_sensitivity(pull, [m.rows for m in of], own, [part] * len(of), 8)
            yield from ((id(m), weights) for m, (*_, weights) in zip(of, found, strict=True))

    def _exchanged(self, kinds: Kinds, gains: Mapping[str, Array]) -> tuple[float, list[int]]:
        """Which mounting of each kind, by greedy choice and exchange."""

        def values(others: list[int], place: int) -> list[float]:
            beside = [gains[k][i] for k, i in zip(kinds[:place] + kinds[place + 1 :], others, strict=False)]
            known = self.task.prior + sum(beside, np.zeros_like(self.task.prior))
            return [self.task.value(known + gain) for gain in gains[kinds[place]]]

        return exchanged_options(len(kinds), values)

    def _relaxed(self, kinds: Kinds, chosen: Sequence[Mounting]) -> Mix:
        ny = max(m.rows.shape[2] for m in chosen)
        rows = np.concatenate([np.pad(m.rows, ((0, 0), (0, 0), (0, ny - m.rows.shape[2]))) for m in chosen])
        group = np.repeat(np.arange(len(chosen)), [len(m.rows) for m in chosen])
        none = np.zeros((len(rows), 1))
        found = relax(
            self.task, Candidates(none, none, group, rows), len(chosen), self.seconds(len(kinds)), tolerance=GAP
        )
        weights = np.split(found.weights, np.cumsum([len(m.rows) for m in chosen])[:-1])
        known = self.task.prior + sum(m.added(w, len(self.task.prior)) for m, w in zip(chosen, weights, strict=True))
        return Mix(kinds, self.task.value(known), tuple(chosen), tuple(weights))

    def enough(self, mix: Mix) -> float:
        """Share of its time of reading that comes within `GAP` of it: more poses only repeat what set-up errors hide."""
        low, high = 0.0, 1.0
        while high - low > GAP:
            share = 0.5 * (low + high)
            added = [m.added(share * w, len(self.task.prior)) for m, w in zip(mix.mountings, mix.weights, strict=True)]
            fits = self.task.value(self.task.prior + sum(added)) <= mix.value + GAP
            low, high = (low, share) if fits else (share, high)
        return high

    def single(self) -> dict[str, Mix]:
        """The best mix of each kind alone."""
        mixes = [self.reached(kinds) for kinds in self.all if len(set(kinds)) == 1]
        return {kind: min((m for m in mixes if m.kinds[0] == kind), key=lambda m: m.value) for kind in self.of_kind}

    def best(self) -> Mix:
        """The best mix found: from the best of one kind, one mounting exchanged, added or removed as long as that lowers ψ."""
        best = min(self.single().values(), key=lambda mix: mix.value)
        while True:
            near = {tuple(sorted(kinds)) for kinds in self._beside(best.kinds)} & set(self.all)
            found = min((self.reached(kinds) for kinds in sorted(near)), key=lambda mix: mix.value, default=best)
            if found.value > best.value - WORTH:
                return best
            best = found

    def _beside(self, kinds: Kinds) -> Iterator[Kinds]:
        for kind in self.of_kind:
            yield (*kinds, kind)
        for i in range(len(kinds)):
            less = kinds[:i] + kinds[i + 1 :]
            yield less
            for kind in self.of_kind:
                yield (*less, kind)

    def lowest(self) -> float:
        """The lowest ψ that any plan of these mixes can have, to `GAP` of what one of them reaches where whole mountings can."""
        mixes = self.all
        bounds = dict.fromkeys(mixes, -math.inf)
        alone = [kinds for kinds in mixes if len(set(kinds)) == 1] or mixes
        lowest = min(alone, key=lambda kinds: self.reached(kinds).value)
        masters: dict[Kinds, _Master] = {}
        for _ in range(ROUNDS):
            if lowest not in masters:
                masters[lowest] = _Master(self.task, self.reached(lowest), self.seconds(len(lowest)))
            master = masters[lowest]
            fresh = self._bounded(mixes, master, bounds)
            lowest = min(mixes, key=lambda kinds: bounds[kinds])
            if bounds[lowest] > min(m.value for m in masters.values()) - GAP:
                break
            master.extended(fresh)
        return bounds[lowest]

    def _bounded(self, mixes: Sequence[Kinds], at: _Master, bounds: dict[Kinds, float]) -> list[_Atom]:
        """Raises the bound of every mix by G at a design; returns the mountings that it misses most."""
        pull = self.task.pull(inverse(at.information))
        known = float(np.sum(pull * self.task.prior))
        most = {count: self.seconds(count) for count in {len(kinds) for kinds in mixes}}
        priced = {kind: self._priced(of, pull) for kind, of in self.of_kind.items()}
        prices = np.unique([0.0, *(top for of in priced.values() for p in of for top in p.top)])
        each = {
            (kind, count): np.max([p.least(prices, seconds) for p in of], axis=0)
            for kind, of in priced.items()
            for count, seconds in most.items()
        }
        for kinds in mixes:
            extra = prices * most[len(kinds)] + sum(n * each[kind, len(kinds)] for kind, n in Counter(kinds).items())
            bounds[kinds] = max(bounds[kinds], at.value - math.log(known + float(np.min(extra))))
        return [atom for kind in set(at.kinds) for atom in self._missed(kind, priced[kind])]

    def _missed(self, kind: str, priced: Sequence[_Priced]) -> Iterator[_Atom]:
        """The mountings of a kind that tell most in a short and in a long time."""
        shared = len(self.task.prior)
        total = np.array([p.total for p in priced])
        for j in range(len(SHARES)):
            for i in np.argsort(total[:, j])[::-1][:JOINING]:
                added = priced[i].mounting.added(priced[i].weights[j], shared)
                yield _Atom(kind, float(priced[i].seconds[j]), added)

    def _priced(self, mountings: Sequence[Mounting], pull: Array) -> list[_Priced]:
        own, seconds = np.eye(len(self.task.own_sigma)), self.seconds(1) * np.array(SHARES)
        rows = [mounting.rows for mounting in mountings for _ in seconds]
        found = iter(marginal_sensitivity(pull, rows, own, np.tile(seconds, len(mountings)).tolist()))
        each = [list(itertools.islice(found, len(seconds))) for _ in mountings]
        return [
            _Priced(
                mounting, seconds, np.array([top for top, *_ in some]), np.array([fixed for _, fixed, _ in some]),
                [weights for *_, weights in some],
            )
            for mounting, some in zip(mountings, each, strict=True)
        ]  # fmt: skip


@dataclass(frozen=True)
class _Priced:
    """A mounting for so many `seconds`: of matrices B the greatest gain a second `top` and the `fixed` part, and the `weights` of
    its readings."""

    mounting: Mounting
    seconds: Array
    top: Array
    fixed: Array
    weights: list[Array]

    @property
    def total(self) -> Array:
        """At most what it tells in these seconds."""
        return self.seconds * self.top + self.fixed

    def least(self, prices: Array, seconds: float) -> Array:
        """f(λ) at every price λ: top and fixed part are convex in B, so that any mean of two counts too."""
        top, fixed = self.top, self.fixed
        best = np.min(fixed[:, None] + seconds * np.maximum(0.0, top[:, None] - prices), axis=0)
        for a, b in itertools.permutations(range(len(top)), 2):
            if top[a] < top[b]:
                share = (prices - top[a]) / (top[b] - top[a])
                between = fixed[a] + share * (fixed[b] - fixed[a])
                best = np.where((share >= 0.0) & (share <= 1.0), np.minimum(best, between), best)
        return np.asarray(best)


@dataclass(frozen=True)
class _Atom:
    """A mounting of a kind read for so many seconds, and what it adds."""

    kind: str
    seconds: float
    added: Array


class _Master:
    """The best fractions of mountings of a mix: ψ least with as many of each kind and as many seconds as the mix has."""

    def __init__(self, task: Task, mix: Mix, seconds: float) -> None:
        shared = len(task.prior)
        self.task, self.kinds, self.total = task, mix.kinds, seconds
        self.atoms = [
            _Atom(m.kind, float(w.sum()), m.added(w, shared)) for m, w in zip(mix.mountings, mix.weights, strict=True)
        ]
        self.share = np.ones(len(self.atoms))
        self._weigh()

    def _weigh(self) -> None:
        added = np.tensordot(self.share, np.stack([atom.added for atom in self.atoms]), 1)
        self.information = self.task.prior + added
        self.value = self.task.value(self.information)

    def extended(self, fresh: Sequence[_Atom]) -> None:
        """The same with further mountings, weighed again (sequential quadratic programming, D. Kraft 1988)."""
        from scipy.optimize import minimize

        self.atoms += fresh
        added = np.stack([atom.added for atom in self.atoms])
        flat = added.reshape(len(added), -1)
        counts = Counter(self.kinds)
        limits = [np.array([float(a.kind == kind) for a in self.atoms]) / n for kind, n in counts.items()]
        limits.append(np.array([a.seconds for a in self.atoms]) / self.total)

        def value(share: Array) -> tuple[float, Array]:
            covariance = inverse(self.task.prior + np.tensordot(np.maximum(share, 0.0), added, 1))
            psi = self.task.criterion.value(self.task.of_interest(covariance))
            return psi, -(flat @ self.task.pull(covariance).ravel())

        table, old = np.stack(limits), len(self.share)
        part = FRESH / table[:, old:].sum(axis=1).max()
        start = np.concatenate([(1.0 - FRESH) * self.share, np.full(len(fresh), part)])
        room = {"type": "ineq", "fun": lambda x: 1.0 - table @ x, "jac": lambda x: -table}
        found = minimize(
            value, start, jac=True, method="SLSQP", bounds=[(0.0, None)] * len(start), constraints=[room],
            options={"maxiter": 200, "ftol": 1e-8},
        )  # fmt: skip
        share = np.maximum(found.x, 0.0)
        share /= max(1.0, float((table @ share).max()))
        kept = share > 1e-6
        self.atoms = [atom for atom, keep in zip(self.atoms, kept, strict=True) if keep]
        self.share = share[kept]
        self._weigh()
