"""Polish: exact refits of the best few, relinearised about them, until nothing moves."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
from scipy.special import logsumexp

from symfive.effects import Form, Varying, form_words
from symfive.errors import InputError
from symfive.identify import Identification
from symfive.inference import Outlier
from symfive.model import Model
from symfive.posterior._about import moments_about
from symfive.posterior._evidence import SHARE, log_evidence
from symfive.posterior._explore import Posterior, Subset, explore, held_by, log_prior, marginal_evidence
from symfive.posterior._fit import SEARCHED, WHITE, Expansion, expansion, fitted, refitted, settled
from symfive.posterior._isolated import log_chance, odd_readings
from symfive.posterior._moments import Moments, moments_of, usual_noises
from symfive.posterior._noises import noises_of
from symfive.posterior._terms import Candidates, Name
from symfive.screen import plural

__all__ = ["Expansion", "expanded", "polish"]

ROUNDS = 6
"""Expansions at most, of each stage: each about the best subset of the one before, as Gauss-Newton steps they settle in two or
three; one more for each member that a rival replaces."""
TRIES = 3
"""Subsets that are refitted in one round, until one holds what the moments promise."""
DECISIVE = 3.0
"""Nats by which one shape has to be better than another with fewer parameters (H. Jeffreys 1961: strong evidence)."""
CLEAR = 10.0
"""Nats by which a new member has to stand out before the model is relinearised about it; others are asked again after that. By so
many a search from nothing has to promise more before it competes with the named effects that settled."""
Progress = Callable[[str], None]
Keys = frozenset[tuple[str, str]]
"""What a fit holds: `Expansion.keys`."""


def expanded(fit: Identification, held: Sequence[Form], candidates: Candidates) -> tuple[Expansion, float]:
    """The fit's best noise, and its log evidence with all that it holds, each form with its discrepancy."""
    covers = {form.effect.answers for form in held if not form.effect.unidentified}
    blocks = [f for f in candidates.forms if f.basis is not None and (f.channel, f.effect.coordinate) in covers]
    noises = noises_of(fit, held) if candidates.sharp else ()
    moments = moments_of(fit, held, blocks, noises)
    members = held_by(moments)
    evidence, blocks_used = marginal_evidence(moments, members)
    best = log_evidence(moments, members, blocks_used)
    return Expansion(fit, tuple(held), moments.nodes[best.node], best.kappa2, noises=noises), evidence


def polish(
    before: Identification, candidates: Candidates, progress: Progress = lambda message: None
) -> tuple[Posterior, Expansion]:
    """The posterior expanded at its own best subset, its nearest rivals weighed by exact refits, and the fit of that subset, with
    the discrepancies that its evidence counts.

    First the effects that have a name; then whether those that are held are the same everywhere, and whether something acts that
    none of them explains: a law of which the moments hold the slope alone is refitted before anything more general may stand in
    its place. Last the noise between the nodes: while something is missing, the noise that suits the fit best stands for that.
    """
    first = _first(before, candidates, progress)
    now = _sharpened(_opened(_settled(first), first))
    moments, held = now.posterior.moments, held_by(now.posterior.moments)
    _, blocks = marginal_evidence(moments, held)
    forms = [moments.terms[number].form for number, _ in blocks]
    beside = [replace(f, effect=replace(f.effect, spread=size)) for f, (_, size) in zip(forms, blocks, strict=True)]
    here = _with_others(now.here, now.mass - log_prior(moments, held), candidates)
    return now.posterior.corrected(now.exactly | {held: now.mass}), replace(settled(here, beside), others=here.others)


def _first(before: Identification, candidates: Candidates, progress: Progress) -> _Round:
    """The expansion about the baseline, without the readings that stand alone or, where something that the library has explains
    these better than chance, with them. Only named effects are searched, but the moments hold all."""

    def without(outliers: Sequence[Outlier]) -> _Round:
        fit = fitted(before.model, [before.named], WHITE, 1.0, replace(before, outliers=tuple(outliers)))
        return _Round.at(_at_ease(fit, candidates), candidates, progress)

    first = _Round.at(_at_ease(before, candidates), candidates, progress)
    if before.outliers:
        progress(f"including {plural(len(before.outliers), 'isolated reading')}")
        first = max((first, without(())), key=lambda each: each.opened.promise())
    odd = odd_readings(first.opened.posterior)
    if odd:
        progress(f"without {plural(len(odd), 'reading')} that no effect explains")
        first = max((first, without((*first.here.fit.outliers, *odd))), key=lambda each: each.opened.promise())
    return first


def _opened(named: _Round, first: _Round) -> _Round:
    """The expansion at which nothing moves once unidentified effects may join: from the named ones that settled or, where that is
    clearly more probable, from nothing: named effects may have settled in the place of what none of them is."""
    start, now = first.opened, named.opened
    if start.promise() > now.promise() + CLEAR:
        other = _settled(start)
        if other.whole > now.promise():
            return other
    return _settled(now)


def _sharpened(now: _Round) -> _Round:
    """The expansion at which nothing moves once noise may lie between the nodes, if the readings know it better than these."""
    sharp = replace(now.candidates, sharp=True)
    here, _ = expanded(now.here.fit, now.here.held, sharp)
    if here.noises == usual_noises(here.fit):
        return now
    return _settled(_Round.at(settled(here), sharp, now.progress, named=now.named))


def _at_ease(before: Identification, candidates: Candidates) -> Expansion:
    """The baseline under the noise that it leaves itself: under the declared one, what is missing drives the set-up to where
    nothing is linear."""
    here, _ = expanded(before, (), candidates)
    fit = fitted(before.model, [{}], here.node, here.kappa2, before)
    return replace(here, fit=fit)


def _settled(now: _Round) -> _Round:
    """The expansion at which nothing moves any more, from `now` on."""
    been = dict[Keys, _Round]()
    for number in range(ROUNDS):
        been[now.here.keys] = now
        better = (max(map(now.exact, ways), key=lambda each: each[0]) for ways in _ahead(now.posterior))
        ahead = next((there for gain, there in better if gain > 0.0 and there.keys not in been), None)
        if ahead is None:
            others = dict.fromkeys([*_rivals(now.posterior), *_hidden(now.posterior)])
            rivals = [each for each in map(now.exact, others) if each[1].keys not in been]
            best, ahead = max(rivals, key=lambda each: each[0], default=(-np.inf, None))
            ahead = ahead if best > 0.0 else None
        if ahead is None or number == ROUNDS - 1:
            break
        now = _Round.at(settled(ahead), now.candidates, now.progress, named=now.named)
    return _best(now, been)


def _best(now: _Round, been: Mapping[Keys, _Round]) -> _Round:
    """The most probable of the expansions, each with the readings that it excludes itself; what it says of the others is what
    these say of themselves."""
    best = max((now, *been.values()), key=lambda each: each.whole)
    for keys, (_, subset) in best.leads.items():
        if keys in been:
            best.exactly[subset] = been[keys].whole - log_chance(best.here.fit, best.here.kappa2)
    return best


@dataclass(frozen=True)
class _Round:
    """One expansion: its fit, the posterior about it, of `named` effects alone or of all, the log `mass` of what it holds, the
    `refits` of other subsets and `exactly` their masses; `leads`: by what a refit holds, how much better it is than what the
    expansion holds, and its subset."""

    here: Expansion
    posterior: Posterior
    mass: float
    candidates: Candidates
    progress: Progress
    named: bool
    exactly: dict[Subset, float] = field(default_factory=dict)
    refits: dict[Subset, Expansion] = field(default_factory=dict)
    leads: dict[Keys, tuple[float, Subset]] = field(default_factory=dict)

    @classmethod
    def at(cls, here: Expansion, candidates: Candidates, progress: Progress, *, named: bool = True) -> _Round:
        """About a fit; the moments hold all that may join."""
        progress(f"linearised about {_words(here) or 'the baseline'}")
        here, evidence = expanded(here.fit, [_classified(form, here.fit) for form in here.held], candidates)
        moments = moments_about(here, candidates)
        posterior = explore(moments, range(moments.held), named=named)
        return cls(here, posterior, evidence + log_prior(moments, held_by(moments)), candidates, progress, named)

    @cached_property
    def opened(self) -> _Round:
        """The same expansion with all that may join."""
        moments = self.posterior.moments
        return replace(self, posterior=explore(moments, range(moments.held)), named=False)

    @cached_property
    def whole(self) -> float:
        """Log mass of what it holds and of the readings that the fit excludes."""
        return self.mass + log_chance(self.here.fit, self.here.kappa2)

    def promise(self) -> float:
        """Log mass of the most probable subset and of the readings that the fit excludes."""
        best = self.posterior.best
        return self.posterior.mass[best] + log_chance(self.here.fit, log_evidence(self.posterior.moments, best).kappa2)

    def exact(self, subset: Subset) -> tuple[float, Expansion]:
        """By how many nats an exact refit of a subset, in its best shapes, is better than what the expansion holds, and that
        fit: all subsets of its names together; of the same names, forms of them, that subset alone."""
        known, moments = {form.effect.key for form in self.here.held}, self.posterior.moments
        fresh = subset not in self.refits
        if fresh:
            there, evidence = _shaped(refitted(moments, subset), self.candidates, self.progress, known)
            self.refits[subset], self.exactly[subset] = there, evidence + log_prior(moments, subset)
        there, mass, held = self.refits[subset], self.exactly[subset], held_by(moments)
        gain = mass - self.mass
        if self.posterior.named(subset) != self.posterior.named(held):
            gain = self.posterior.worth(subset, mass) - self.posterior.worth(held, self.mass)
        self.leads[there.keys] = gain, subset
        if fresh:
            self.progress(f"refitted with {_words(there) or 'no effect'}: log evidence {gain:+.1f}")
        return gain, there


def _ahead(posterior: Posterior) -> Iterator[list[Subset]]:
    """The most probable subsets of the most probable names that the fit should hold instead of what it holds, each cut to what
    is clear in two ways."""
    held, tried = set(range(posterior.moments.held)), set[frozenset[int]]()
    for subset in sorted(posterior.mass, key=lambda s: (-posterior.worth(s), -posterior.mass[s])):
        terms = frozenset(t for t, _ in subset)
        if terms == held or len(tried) == TRIES:
            return
        if terms not in tried:
            tried.add(terms)
            yield _clear(posterior, subset)


def _shaped(
    here: Expansion, candidates: Candidates, progress: Progress, known: Collection[str]
) -> tuple[Expansion, float]:
    """The fit, and its evidence, with each of its effects, but for those `known` (keys), in that of its shapes which has the
    fewest parameters and is not decisively worse than the best. Those that are clearly worse are left out of its form."""
    here, mass = expanded(here.fit, here.held, candidates)
    campaign = here.fit.model.campaign
    for number in (k for k, form in enumerate(here.held) if form.effect.key not in known):
        trials = [(here, mass)]
        for other, evidence in _reshaped(here, number, candidates):
            trials.append((other, evidence))
            words = form_words(other.held[number].effect.key, campaign.machine)
            progress(f"{words} in another form: log evidence {evidence - mass:+.1f}")
        best = max(evidence for _, evidence in trials)
        near = [trial for trial in trials if trial[1] >= best - DECISIVE]
        here, mass = min(near, key=lambda each: (len(each[0].held[number].effect.parameters(campaign)), -each[1]))
        form = here.held[number]
        left = tuple(
            other.held[number].effect for other, evidence in trials if other is not here and evidence > best - CLEAR
        )
        here = replace(here, held=(*here.held[:number], replace(form, shapes=left), *here.held[number + 1 :]))
    return here, mass


def _with_others(here: Expansion, evidence: float, candidates: Candidates) -> Expansion:
    """The same, whose log evidence this is, with its fits in which one effect has another of the shapes that were left."""
    found = list[tuple[float, Identification]]()
    for number in range(len(here.held)):
        trials = [(other.fit, its) for other, its in _reshaped(here, number, candidates)]
        whole = logsumexp([evidence, *(its for _, its in trials)])
        found += [(float(np.exp(its - whole)), fit) for fit, its in trials]
    return replace(here, others=tuple(found))


def _reshaped(here: Expansion, number: int, candidates: Candidates) -> Iterator[tuple[Expansion, float]]:
    """The fit with one of its effects in each of its other shapes that can be, from the best of the places where this is looked
    at, and the evidence of each."""
    form = here.held[number]
    for shape in form.shapes:
        try:
            tag = form.effect.tag if form.placed else shape.tag  # which of several places, or which shape
            effect = replace(shape, spread=form.effect.spread, tag=tag).prepare(here.fit.model.campaign)
            forms = [*here.held[:number], replace(form, effect=effect), *here.held[number + 1 :]]
            model = Model(here.fit.model.campaign, [f.effect for f in forms])
            places = [form.at for form in candidates.forms if form.at and form.effect == effect]
            starts = [here.fit.named, *({**here.fit.named, **at} for at in places)]
            trial = fitted(model, starts, here.node, here.kappa2, here.fit, SEARCHED)
            if _sane(trial):
                yield expanded(trial, expansion(trial, forms, here.node, here.kappa2).held, candidates)
        except (InputError, np.linalg.LinAlgError):
            continue


def _rivals(posterior: Posterior) -> list[Subset]:
    """For each member of what the fit holds the nearest subsets that have another name in its place, one a name, where an exact
    refit may lift them; without members the nearest subset of all."""
    terms, found = posterior.moments.terms, list[Subset]()
    for member in range(posterior.moments.held) or [-1]:
        own, most = (terms[member].name, TRIES) if member >= 0 else (None, 1)
        nearest: dict[Name, Subset] = {}
        for subset, other in posterior.in_place_of(member):
            name = terms[other].name
            if name != own and name not in nearest and _promising(posterior, subset):
                nearest[name] = subset
                if len(nearest) == most:
                    break
        found += nearest.values()
    return found


def _hidden(posterior: Posterior) -> list[Subset]:
    """Where the evidence of the fit counts that its laws are not exact, the subsets of the most probable names if they are: what
    a lacking law does may pass for the discrepancy of others."""
    moments = posterior.moments
    held = held_by(moments)
    if not marginal_evidence(moments, held)[1]:
        return []
    laws = explore(moments, range(moments.held), named=True, exact=True)
    found = dict[frozenset[Name], Subset]()
    for subset in sorted(laws.mass, key=lambda s: -laws.mass[s]):
        found.setdefault(laws.named(subset), subset)
    return list(found.values())[:TRIES]


def _clear(posterior: Posterior, best: Subset) -> list[Subset]:
    """The members of a subset that stand out, and these with the clearest alone of several new ones over one coordinate; what the
    linear model needs beside it, relinearising or another shape may explain."""
    mass, _ = marginal_evidence(posterior.moments, best)
    gains = {m: mass - marginal_evidence(posterior.moments, tuple(o for o in best if o != m))[0] for m in best}
    held = {m for m in best if m[0] < posterior.moments.held}
    ranked = sorted(best, key=lambda m: (m not in held, -gains[m]))
    clear = [m for m in ranked if m in held or m == ranked[0] or gains[m] > CLEAR]
    covers = {m: posterior.moments.terms[m[0]].covers for m in clear}
    clearest = {covers[m]: m for m in reversed(clear) if m not in held}
    apart = [m for m in clear if m in held or covers[m] == ("", "") or clearest[covers[m]] == m]
    return [tuple(sorted(clear)), tuple(sorted(apart))]


def _promising(posterior: Posterior, subset: Subset) -> bool:
    """Whether an exact refit may lift a subset above the best: it has a form of which the moments hold the slope alone, and
    explains by it at least half of what it does without."""
    moments, best = posterior.moments, {t for t, _ in posterior.best}
    if all(t < moments.held or _linear(moments, t) for t, _ in subset):
        return False
    common = tuple(m for m in subset if m[0] in best)
    mine, theirs, both = (marginal_evidence(moments, s)[0] for s in (subset, posterior.best, common))
    return mine - both > max(DECISIVE, 0.5 * (theirs - both))


def _linear(moments: Moments, term: int) -> bool:
    """Whether the moments hold all of a form: no other shape, and nothing to be found beside its amplitudes."""
    form = moments.terms[term].form
    return moments.proportional[term] and not form.shapes and bool(moments.columns[term].amplitude.all())


def _classified(form: Form, fit: Identification) -> Form:
    """The form; a varying one under the name of its law if it varies by no more than the form error of laws."""
    effect = form.effect
    if not isinstance(effect, Varying):
        return form
    return replace(form, effect=replace(effect, minor=effect.variation(fit.model.campaign, fit.named) <= SHARE))


def _words(here: Expansion) -> str:
    """The effects of an expansion in words."""
    return ", ".join(form_words(form.effect.key, here.fit.model.machine) for form in here.held)


def _sane(fit: Identification) -> bool:
    return all(np.isfinite(residual).all() for residual in fit.residuals.values())
