"""Polish: exact refits of the best few, relinearised about them, until nothing moves."""

from __future__ import annotations

from collections.abc import Callable, Collection
from dataclasses import replace

import numpy as np

from symfive.effects import Effect, Form
from symfive.errors import InputError
from symfive.identify import Identification
from symfive.model import Model
from symfive.posterior._evidence import WIDTHS, Member, log_evidence
from symfive.posterior._explore import Posterior, Subset, explore, log_prior, weighed
from symfive.posterior._fit import Expansion, expansion, fitted, refitted
from symfive.posterior._moments import moments_of
from symfive.posterior._scan import placed
from symfive.posterior._terms import Candidates

__all__ = ["Expansion", "expanded", "polish"]

ROUNDS = 4
"""Expansions at most; in a trial on 62 campaigns the fourth changed no name."""
TRIES = 3
"""Subsets that are refitted in one round, until one holds what the moments promise."""
RIVALS = 3
"""Nearest subsets of other names that are refitted exactly."""
DECISIVE = 3.0
"""Nats by which another shape has to be better (H. Jeffreys 1961: strong evidence)."""
CLEAR = 10.0
"""Nats by which a new member has to stand out before the model is relinearised about it; others are asked again after that."""
Progress = Callable[[str], None]


def expanded(fit: Identification, held: Sequence[Form], candidates: Candidates) -> tuple[Expansion, float]:
    """The fit's best noise, and its log evidence with all that it holds, each form with its discrepancy."""
    covers = {form.effect.answers for form in held if not form.effect.nameless}
    blocks = [f for f in candidates.forms if f.basis is not None and (f.channel, f.effect.coordinate) in covers]
    moments = moments_of(fit, held, blocks)
    members = tuple((k, _width(moments.terms[k].effect)) for k in range(moments.held))
    evidence, blocks_used = weighed(moments, members)
    best = log_evidence(moments, members, blocks_used)
    return Expansion(fit, tuple(held), moments.nodes[best.node], best.kappa2), evidence


def _width(effect: Effect) -> float:
    return min(WIDTHS, key=lambda w: abs(np.log(w / effect.spread)))


def polish(start: Expansion, candidates: Candidates, progress: Progress = lambda message: None) -> tuple[Posterior, Expansion]:
    """The posterior expanded at its own best subset, its nearest rivals weighed by exact refits, and the fit of the best."""
    here, evidence = expanded(start.fit, start.held, candidates)
    for number in range(ROUNDS):
        progress(f"expansion {number + 1}: {', '.join(f.effect.key for f in here.held) or 'the baseline'}")
        moments = moments_of(here.fit, here.held, _fresh(here, candidates))
        posterior = explore(moments, range(moments.held))
        ahead = _ahead(posterior, here, evidence, candidates, progress)
        if ahead is None:
            break
        here, evidence = ahead
    return _contested(posterior, here, candidates, progress), here


def _ahead(
    posterior: Posterior, here: Expansion, evidence: float, candidates: Candidates, progress: Progress
) -> tuple[Expansion, float] | None:
    """The exact fit of the best subset whose evidence with it is what the moments promised at least in part; None where the best
    is the one expanded at."""
    moments, tried = posterior.moments, set[frozenset[int]]()
    known = {form.effect.key for form in here.held}
    prior = log_prior(moments, [(t, 1.0) for t in range(moments.held)])
    for subset in sorted(posterior.mass, key=lambda s: -posterior.mass[s]):
        terms = frozenset(t for t, _ in subset)
        if terms == set(range(moments.held)) or len(tried) == TRIES:
            return None
        if terms in tried:
            continue
        tried.add(terms)
        chosen = _clear(posterior, subset)
        there, found = _shaped(refitted(moments, chosen), candidates, progress, known)
        gain = found + log_prior(moments, chosen) - evidence - prior
        progress(f"{', '.join(f.effect.key for f in there.held) or 'nothing'}: {gain:+.1f} nats")
        if gain > 0.0:
            return there, found
    return None


def _fresh(here: Expansion, candidates: Candidates) -> list[Form]:
    """What may join a fit: forms of other keys than it holds, that free no quantity which is free."""
    taken = {effect.key for effect in here.fit.model.effects}
    freed = {place for effect in here.fit.model.effects for place in effect.frees()}
    forms = [*candidates.forms, *placed(here.fit, candidates.scans, here.node)]
    return [f for f in forms if f.effect.key not in taken and not freed & set(f.effect.frees())]


def _shaped(
    here: Expansion, candidates: Candidates, progress: Progress, known: Collection[str]
) -> tuple[Expansion, float]:
    """The fit, and its evidence, with each of its effects, but for those `known` (keys), in the best of its shapes."""
    here, mass = expanded(here.fit, here.held, candidates)
    for number in (k for k, form in enumerate(here.held) if form.effect.key not in known):
        for shape in here.held[number].shapes:
            trial = _reshaped(here, number, shape)
            if trial is None:
                continue
            other, evidence = expanded(trial.fit, trial.held, candidates)
            progress(f"{shape.key} in another shape: {evidence - mass:+.1f} nats")
            if evidence > mass + DECISIVE:
                here, mass = other, evidence
    return here, mass


def _reshaped(here: Expansion, number: int, shape: Effect) -> Expansion | None:
    """The fit with one of its effects in another shape; None where the shape cannot be."""
    form = here.held[number]
    try:
        effect = replace(shape, spread=form.effect.spread, tag=form.effect.tag).prepare(here.fit.model.campaign)
        forms = [*here.held[:number], replace(form, effect=effect), *here.held[number + 1 :]]
        model = Model(here.fit.model.campaign, [f.effect for f in forms])
        trial = fitted(model, [here.fit.named], here.node, here.kappa2)
        return expansion(trial, forms, here.node, here.kappa2) if _sane(trial) else None
    except (InputError, np.linalg.LinAlgError):
        return None


def _contested(posterior: Posterior, here: Expansion, candidates: Candidates, progress: Progress) -> Posterior:
    """The posterior with the nearest rivals of the best subset weighed by exact refits, each in its best shapes."""
    terms, mass, best = posterior.moments.terms, dict(posterior.mass), posterior.best
    seen = {_names(posterior, best)}
    for subset in sorted(mass, key=lambda s: -mass[s]):
        if len(seen) > RIVALS:
            break
        names = _names(posterior, subset)
        if any(set(other) <= set(names) for other in seen if other) or not _promising(posterior, subset):
            continue  # with one more name beside it only the search says more
        seen.add(names)
        known = {form.effect.key for form in here.held}
        _, evidence = _shaped(refitted(posterior.moments, subset), candidates, progress, known)
        prior = log_prior(posterior.moments, subset)
        progress(f"rival {[terms[t].effect.key for t, _ in subset]}: {evidence + prior - mass[best]:+.1f} nats")
        mass[subset] = max(mass[subset], evidence + prior)
    return replace(posterior, mass=mass)


def _clear(posterior: Posterior, best: Subset) -> Subset:
    """The members of a subset that stand out, of several over one coordinate the clearest; what the linear model needs beside them,
    relinearising or another shape may explain."""
    mass, _ = weighed(posterior.moments, best)
    gains = {m: mass - weighed(posterior.moments, tuple(o for o in best if o != m))[0] for m in best}
    terms, kept = posterior.moments.terms, list[Member]()
    for member in sorted(best, key=lambda m: (m[0] >= posterior.moments.held, -gains[m])):
        covered = {terms[t].covers for t, _ in kept} - {("", "")}
        if not kept or member[0] < posterior.moments.held or (gains[member] > CLEAR and terms[member[0]].covers not in covered):
            kept.append(member)
    return tuple(sorted(kept))


def _names(posterior: Posterior, subset: Subset) -> tuple[object, ...]:
    return tuple(sorted((posterior.moments.terms[t].name for t, _ in subset), key=str))


def _promising(posterior: Posterior, subset: Subset) -> bool:
    """Whether an exact refit may lift a subset above the best: it has a form of which the moments hold the slope alone, and explains
    by it at least half of what it does without."""
    moments, best = posterior.moments, {t for t, _ in posterior.best}
    if best <= {t for t, _ in subset} or all(t < moments.held or linear(moments.terms[t].form) for t, _ in subset):
        return False
    common = tuple(m for m in subset if m[0] in best)
    mine, theirs, both = (weighed(moments, s)[0] for s in (subset, posterior.best, common))
    return mine - both > max(DECISIVE, 0.5 * (theirs - both))


def _sane(fit: Identification) -> bool:
    return all(np.isfinite(residual).all() for residual in fit.residuals.values())


def linear(form: Form) -> bool:
    """Whether the moments hold all of a form: it has no parameter beside its amplitudes, and moves no drive and no play."""
    effect = form.effect
    return form.basis is not None or not (
        form.shapes or effect.frees() or any(signal.parameters for signal in effect.signals())
    )
