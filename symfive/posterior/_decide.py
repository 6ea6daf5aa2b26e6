"""Decision by expected loss for each member of the most probable subset: name, class, unknown or nothing.

The loss of a report is `WRONG` where the cause is another one, one for every further name in a class (each is one more thing to
look after), `UNKNOWN` where a cause is there and stays unidentified, and `MISSED` where it is there and nothing is said. What
is reported has the least expected loss.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cache

import numpy as np

from symfive.effects import Unknown
from symfive.posterior._coarse import coarsened
from symfive.posterior._evidence import added, log_evidence
from symfive.posterior._explore import Posterior, held_by, log_prior
from symfive.posterior._sweep import widths_of
from symfive.posterior._terms import Name

__all__ = ["Verdict", "decide", "verdicts_on"]

WRONG, UNKNOWN, MISSED = 10.0, 4.0, 5.0
"""In units of testing one more cause: a repair in vain; a fault that the diagnosis only places; one that it overlooks."""
SAME = 2.0
"""Nats: χ² of 4, 2 σ, by which a fit must be worse to be distinguished from another one."""


UNNAMED: Name = (Unknown.id, None)
Covered = Callable[[int, tuple[int, ...]], tuple[float, float]]


@dataclass(frozen=True)
class Verdict:
    """What is said of one member (number `term`): its `names`, one or a class, first what is fitted, then the most probable;
    none: unknown.

    `probability` of the first name (of unknown: that something acts there), `rivals` the probabilities of all others, `alias` the
    terms that cannot be distinguished from it in these readings, `components` those of its own name that explain what it does,
    `by_experience` whether only their priors put it first.
    """

    term: int
    names: tuple[Name, ...]
    probability: float
    rivals: Mapping[Name, float]
    alias: tuple[int, ...]
    components: tuple[int, ...]
    by_experience: bool

    @property
    def unidentified(self) -> bool:
        """Whether nothing is known of its cause: no name is stated, and none is as probable as that it has none."""
        rivals = self.rivals.values()
        return not self.names and self.probability - sum(rivals) > max(rivals, default=0.0)


def verdicts_on(posterior: Posterior) -> tuple[Verdict, ...]:
    """The verdicts on what the fit holds (`decide`) by the coarsened likelihood. A member that they leave unnamed is an
    unidentified effect, and what that may be wrong by counts against the names of all others, until no further name falls."""
    unnamed, terms = set[int](), posterior.moments.terms
    while True:
        verdicts = decide(posterior, coarsened(posterior, unnamed))
        fallen = {v.term for v in verdicts if not v.names and not terms[v.term].effect.unidentified} - unnamed
        if not fallen:
            return verdicts
        unnamed |= fallen


def decide(posterior: Posterior, coarse: Posterior) -> tuple[Verdict, ...]:
    """The verdicts on what the fit holds, the most probable first: that something acts, by the posterior; what it is, by the
    `coarse` one."""
    held = frozenset(range(posterior.moments.held))
    covered = _covered(posterior)
    found = [_verdict(posterior, coarse, held, term, covered) for term in sorted(held)]
    return tuple(sorted((v for v in found if v is not None), key=lambda v: -v.probability))


def _verdict(
    posterior: Posterior, coarse: Posterior, held: frozenset[int], term: int, covered: Covered
) -> Verdict | None:
    terms = posterior.moments.terms
    own, unidentified = terms[term].name, terms[term].effect.unidentified
    nothing = _shares(posterior, held, term, covered)[1]
    shares, empty = _shares(coarse, held, term, covered)
    acts = 1.0 - nothing
    if empty > nothing:  # what acts all the same, and no name explains alone
        shares[UNNAMED] = shares.get(UNNAMED, 0.0) + empty - nothing
    total = sum(shares.values())
    shares = {name: share * acts / total for name, share in shares.items()} if total > 0.0 else {own: acts}
    ranked = sorted(shares, key=lambda name: (-shares[name], name != own))
    named = [name for name in ranked if name[0] != UNNAMED[0]]
    losses, known = [(MISSED * acts, 0), (UNKNOWN * acts + WRONG * nothing, -1)], 0.0
    for count, name in enumerate(named):
        known += shares[name]
        losses.append((count + WRONG * (1.0 - known), count + 1))
    choice = min(losses)[1]
    if choice == 0:
        return None
    stated = tuple(named[: max(choice, 0)])
    # the statement is what is fitted; a more probable name is an alternative
    stated = (own, *(name for name in stated if name != own)) if own in stated else ()
    alias, alone = _alias(posterior, held, term)
    first = stated[0] if stated else (own if unidentified else UNNAMED)
    probability = shares[first] if stated else acts
    rivals = {name: share for name, share in shares.items() if name != first}
    others = (t for t, each in enumerate(terms) if each.name == own and terms[term].differs(each))
    components = tuple(t for t in others if covered(term, (t,))[1] < 2.0 * SAME)
    by_experience = alone and probability >= max(rivals.values(), default=0.0)
    return Verdict(term, stated, probability, rivals, alias, components, by_experience)


def _shares(posterior: Posterior, held: frozenset[int], term: int, covered: Covered) -> tuple[dict[Name, float], float]:
    """How probable each name is in a member's place, and that the place is empty. A subset that lacks several members has a new
    name in the place of that one of which it explains most, and of others as far as it explains them too."""
    terms = posterior.moments.terms
    own = terms[term].name
    shares: dict[Name, float] = {}
    nothing = 0.0
    for subset, weight in posterior.weights.items():
        if term in subset:
            shares[own] = shares.get(own, 0.0) + weight
            continue
        fresh: dict[Name, tuple[int, ...]] = {}
        for t in sorted(subset - held):
            fresh[terms[t].name] = (*fresh.get(terms[t].name, ()), t)
        lacking, places = held - subset, dict[Name, float]()
        for name, by in fresh.items():
            places[name] = _share(covered(term, by)) / max(_share(covered(t, by)) for t in lacking)
        total = sum(places.values())
        for name, place in places.items():
            shares[name] = shares.get(name, 0.0) + weight * place / max(1.0, total)
        nothing += weight * max(0.0, 1.0 - total)
    return shares, nothing


def _covered(posterior: Posterior) -> Covered:
    """How much energy, in units of the noise, of what a member adds to the readings some terms can explain, however large, and
    how much they cannot."""
    moments = posterior.moments
    members = held_by(moments)
    evidence = log_evidence(moments, members)
    gram = moments.about(()).gram[evidence.node] / evidence.kappa2
    parts = added(moments, members, evidence)

    @cache
    def covered(member: int, by: tuple[int, ...]) -> tuple[float, float]:
        where = [moments.columns[t].where[moments.columns[t].amplitude] for t in by]
        least = [np.full(len(own), widths_of(moments, t)[-1] ** -2.0) for t, own in zip(by, where, strict=True)]
        at = np.concatenate(where)
        seen = gram[at] @ parts[member]
        given = float(seen @ np.linalg.solve(gram[np.ix_(at, at)] + np.diag(np.concatenate(least)), seen))
        return given, float(parts[member] @ gram @ parts[member]) - given

    return covered


def _share(covered: tuple[float, float]) -> float:
    """The share of what a member explains that other terms can explain too."""
    tiny = float(np.finfo(np.float64).tiny)
    return max(covered[0] / max(sum(covered), tiny), tiny)


def _alias(posterior: Posterior, held: frozenset[int], term: int) -> tuple[tuple[int, ...], bool]:
    """Terms that take the place of a member without a worse fit, however large: those of other names, then other components
    under its own, each the most probable first; and whether there are any of other names."""
    terms, rest = posterior.moments.terms, held - {term}
    evidence: dict[frozenset[int], float] = {}
    for subset, mass in posterior.mass.items():
        members = frozenset(t for t, _ in subset)
        evidence[members] = max(mass - log_prior(posterior.moments, subset), evidence.get(members, -np.inf))
    found = []
    for members, each in evidence.items():
        extra = members - rest
        if rest <= members and len(extra) == 1 and term not in extra and evidence[held] - each < SAME:
            found += [t for t in extra if not terms[t].effect.unidentified and terms[term].differs(terms[t])]
    found.sort(key=lambda t: (terms[t].name == terms[term].name, -posterior.weights[rest | {t}]))
    return tuple(found), bool(found) and terms[found[0]].name != terms[term].name
