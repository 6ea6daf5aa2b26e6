"""Explore: subsets of terms by birth, death, swap and width, and the posterior that they make."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from heapq import nlargest

import numpy as np

from symfive.arrays import Array
from symfive.posterior._evidence import Blocks, Selected, discrepancies, equations, evidence_of, log_evidence
from symfive.posterior._moments import Moments
from symfive.posterior._noise import NEGLIGIBLE
from symfive.posterior._sweep import Sweep, widths_of
from symfive.posterior._terms import Name, complete
from symfive.posterior._widths import WIDTHS, log_width, nearest_width

__all__ = ["Posterior", "Subset", "explore", "held_by", "log_prior", "marginal_evidence"]

Subset = tuple[Selected, ...]
MOST = 5
"""Effects at once; how they vary does not count."""
BEAM = 6
"""Subsets that are expanded side by side; the search ends when the best so many have been."""
NOTHING = float(np.log(np.finfo(float).eps))
"""Log of a share that changes no sum."""
BIRTHS, SWAPS = 12, 4
"""Terms that are joined to a subset, and put in the place of one of its own, by the sweep's order."""


@dataclass(frozen=True)
class Posterior:
    """Subsets of terms with the log of their posterior mass, up to what they share: prior times evidence. `exact`: that of the
    subsets that were refitted."""

    moments: Moments
    mass: Mapping[Subset, float]
    exact: Mapping[Subset, float] = field(default_factory=dict)

    def corrected(self, exact: Mapping[Subset, float]) -> Posterior:
        """The same with what exact refits say of some subsets; of the same terms in other widths as much more or less."""
        gains = {frozenset(t for t, _ in s): mass - self.mass[s] for s, mass in exact.items() if s in self.mass}
        mass = {s: m + gains.get(frozenset(t for t, _ in s), 0.0) for s, m in self.mass.items()}
        return Posterior(self.moments, mass, exact)

    @cached_property
    def best(self) -> Subset:
        """The most probable subset."""
        return max(self.mass, key=lambda s: self.mass[s])

    @cached_property
    def weights(self) -> dict[frozenset[int], float]:
        """Probability of each set of terms, its widths together."""
        logs: dict[frozenset[int], list[float]] = {}
        for subset, mass in self.mass.items():
            logs.setdefault(frozenset(t for t, _ in subset), []).append(mass)
        total = np.logaddexp.reduce(list(self.mass.values()))
        return {terms: float(np.exp(np.logaddexp.reduce(each) - total)) for terms, each in logs.items()}

    @cached_property
    def sets(self) -> dict[frozenset[Name], float]:
        """Log mass of each set of names, all subsets that have just these together."""
        logs: dict[frozenset[Name], list[float]] = {}
        for subset, mass in self.mass.items():
            logs.setdefault(self.named(subset), []).append(mass)
        return {names: float(np.logaddexp.reduce(each)) for names, each in logs.items()}

    def named(self, subset: Subset) -> frozenset[Name]:
        """The names of a subset."""
        return frozenset(self.moments.terms[t].name for t, _ in subset)

    def worth(self, subset: Subset, mass: float | None = None) -> float:
        """Log mass of the names of a subset; where a refit says that its own is `mass`, what else has these names counts in its
        ratio to it, and at most as much: it was not refitted."""
        if mass is None:
            return self.sets[self.named(subset)]
        there, names = self.mass.get(subset, np.inf), self.named(subset)
        others = [min(m - there, 0.0) for s, m in self.mass.items() if s != subset and self.named(s) == names]
        return mass + float(np.logaddexp.reduce([0.0, *others]))

    def in_place_of(self, member: int) -> Iterator[tuple[Subset, int]]:
        """Subsets with another term, and its number, in the place of one that the fit holds (-1: beside all of those), the most
        probable first."""
        held = frozenset(range(self.moments.held))
        for subset in sorted(self.mass, key=lambda s: -self.mass[s]):
            numbers = {t for t, _ in subset}
            others = numbers - held
            if held - {member} == numbers - others and len(others) == 1:
                yield subset, others.pop()

    def names(self) -> dict[Name, float]:
        """Marginal probability of every name: the mass of the subsets that hold it."""
        found: dict[Name, float] = {}
        for terms, weight in self.weights.items():
            for name in {self.moments.terms[t].name for t in terms}:
                found[name] = found.get(name, 0.0) + weight
        return dict(sorted(found.items(), key=lambda item: -item[1]))


@dataclass
class _Search:
    moments: Moments
    named: bool
    exact: bool
    mass: dict[Subset, float] = field(default_factory=dict)
    blocks: dict[Subset, Blocks] = field(default_factory=dict)
    swept: dict[Subset, tuple[list[int], list[float], Array]] = field(default_factory=dict)

    @cached_property
    def vectors(self) -> list[tuple[int, int]]:
        """Terms that are the two components of one vector."""
        number = {term.effect.key: k for k, term in enumerate(self.moments.terms) if not term.form.placed}
        partners = [(k, number.get(term.form.partner)) for k, term in enumerate(self.moments.terms)]
        return [(k, other) for k, other in partners if other is not None and k < other]

    @cached_property
    def unseen(self) -> set[int]:
        """Terms that move no reading, however large: with one of them a subset is the same as without."""
        own = [np.append(c.where, c.exact) if c.exact >= 0 else c.where for c in self.moments.columns]
        energy = [WIDTHS[-1] ** 2 * float(self.moments.raw[at, at].sum()) for at in own]
        return {k for k, each in enumerate(energy) if each < NEGLIGIBLE}

    @property
    def least(self) -> float:
        """Log mass below which a subset is not among the best that are expanded, nor has any weight beside them."""
        best = nlargest(BEAM, self.mass.values())
        return min(best[-1] if len(best) == BEAM else -np.inf, best[0] + NOTHING)

    def see(self, members: Iterable[Selected]) -> None:
        """Weigh a subset, unless it was."""
        subset = tuple(sorted(members))
        if subset not in self.mass:
            if self.exact:
                evidence, self.blocks[subset] = log_evidence(self.moments, subset).total, ()
            else:
                evidence, self.blocks[subset] = marginal_evidence(self.moments, subset)
            self.mass[subset] = evidence + log_prior(self.moments, subset)

    def sweep(self, subset: Subset) -> tuple[list[int], list[float], Array]:
        """Terms that may join a subset, the width of each that suits it, and the log mass with it, whether laws are exact or have
        the discrepancies of the subset."""
        if subset not in self.swept:
            terms = self.moments.terms
            held = [terms[t] for t, _ in subset]
            full = sum(not term.needs for term in held) >= MOST
            free = [
                k for k, term in enumerate(terms)
                if k >= self.moments.held and k not in self.unseen and (term.needs or not full)
                and complete([*held, term]) and not any(term.excludes(h) for h in held)
            ]  # fmt: skip
            general = {k for k in free if terms[k].effect.unidentified or terms[k].needs}
            parts = [[k for k in free if k not in general], *([] if self.named else [sorted(general)])]
            self.see(subset)
            each = [self._swept(subset, part, self.blocks[subset]) for part in parts]
            free, widths = [k for part in parts for k in part], [width for _, own in each for width in own]
            mass = np.concatenate([own for own, _ in each])
            prior = [log_prior(self.moments, (*subset, one)) for one in zip(free, widths, strict=True)]
            self.swept[subset] = free, widths, mass + np.array(prior)
        return self.swept[subset]

    def _swept(self, subset: Subset, free: Sequence[int], blocks: Blocks) -> tuple[Array, list[float]]:
        """Log evidence of a subset with each of the terms that are `free`, and the widths of these."""

        def best(blocks: Blocks) -> tuple[Array, list[float]]:
            asked = "sweep", subset, tuple(free), blocks
            return self.moments.once(asked, lambda: Sweep.of(self.moments, subset, blocks).best(free))

        mass, widths = best(())
        if blocks:
            other, its = best(blocks)
            widths = [b if other[k] > mass[k] else a for k, (a, b) in enumerate(zip(widths, its, strict=True))]
            mass = np.logaddexp(mass, other) - np.log(2.0)
        return mass, widths

    def join(self, subset: Subset, most: int) -> None:
        """The best so many subsets with one term more, each in the width that suits it, and those with both components of a
        vector: while noise stands for the other, one alone may explain nothing."""
        free, widths, mass = self.sweep(subset)
        for k in np.argsort(-mass)[:most]:
            if not mass[k] > self.least:  # as all that follow
                break
            self.see((*subset, (free[k], widths[k])))
        for pair in self.vectors:
            if set(pair) <= set(free) and len(subset) + 2 <= MOST:
                self.see((*subset, *((t, WIDTHS[0]) for t in pair)))
        held = [t for t in range(self.moments.held) if t not in {member for member, _ in subset}]
        for t in held:
            if not any(self.moments.terms[t].excludes(self.moments.terms[o]) for o, _ in subset):
                self.see((*subset, (t, nearest_width(self.moments.terms[t].effect.spread))))

    def expand(self, subset: Subset) -> None:
        """All neighbours of a subset that may matter."""
        self.join(subset, BIRTHS)
        for k, (t, width) in enumerate(subset):
            rest = (*subset[:k], *subset[k + 1 :])
            left = tuple(m for m in rest if not self.moments.terms[m[0]].varies(self.moments.terms[t]))
            self.see(left)
            self.join(left, SWAPS)
            at = WIDTHS.index(width)
            for other in widths_of(self.moments, t)[max(at - 1, 0) : at + 2]:
                self.see((*rest, (t, other)))


def held_by(moments: Moments) -> Subset:
    """The subset that the fit holds, each term in the width of its effect's prior."""
    return tuple((t, nearest_width(moments.terms[t].effect.spread)) for t in range(moments.held))


def log_prior(moments: Moments, subset: Iterable[Selected]) -> float:
    """Of a subset, with the widths of its terms. A name is as rare as it is once: a further form of it is not as rare again."""
    found, names = 0.0, set[Name]()
    for t, width in subset:
        term = moments.terms[t]
        found += (term.again if term.name in names else term.log_prior) + log_width(width, widths_of(moments, t))
        names.add(term.name)
    return found


def marginal_evidence(moments: Moments, subset: Subset) -> tuple[float, Blocks]:
    """Log evidence of a subset whose forms may or may not be a little off, the mean of both; the discrepancies, if they help."""
    return moments.once(("evidence", tuple(subset)), lambda: _marginal(moments, subset))


def _marginal(moments: Moments, subset: Subset) -> tuple[float, Blocks]:
    s = equations(moments, subset)
    plain = evidence_of(moments, s)
    blocks = discrepancies(moments, subset, s.at(plain.node, plain.kappa2)) if subset else ()
    if not blocks:
        return plain.total, ()
    other = log_evidence(moments, subset, blocks).total
    return float(np.logaddexp(plain.total, other) - np.log(2.0)), blocks if other > plain.total + NEGLIGIBLE else ()


def explore(moments: Moments, start: Sequence[int] = (), *, named: bool = False, exact: bool = False) -> Posterior:
    """Beam search from a set of terms (numbers) that are held by the fit, and from nothing; with `named` no unidentified term
    joins, nor one by which a law changes; `exact` if laws have no discrepancies."""
    search, done = _Search(moments, named, exact), set[Subset]()
    search.see(())
    search.see((t, nearest_width(moments.terms[t].effect.spread)) for t in start)
    while True:
        best = sorted(search.mass, key=lambda s: -search.mass[s])[:BEAM]
        fresh = [s for s in best if s not in done]
        if not fresh:
            return Posterior(moments, search.mass)
        for subset in fresh:
            search.expand(subset)
            done.add(subset)
