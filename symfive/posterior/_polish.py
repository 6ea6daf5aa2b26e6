"""Polish: exact refits of the best few, relinearised about them, until nothing moves."""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from symfive.effects import Effect, Form
from symfive.errors import InputError
from symfive.identify import Identification, identify
from symfive.model import Model
from symfive.posterior._evidence import WIDTHS, log_evidence, solution
from symfive.posterior._explore import Posterior, Subset, explore
from symfive.posterior._moments import Moments, moments_of
from symfive.posterior._noise import Node
from symfive.posterior._scan import placed
from symfive.posterior._terms import Candidates

__all__ = ["Expansion", "expanded", "polish"]

ROUNDS = 4
"""Expansions at most; in a trial on 62 campaigns the fourth changed no name."""
RIVALS = 3
"""Nearest subsets of other names that are refitted exactly."""
DECISIVE = 3.0
"""Nats by which another shape has to be better (H. Jeffreys 1961: strong evidence)."""
CLEAR = 10.0
"""Nats by which a new member has to stand out before the model is relinearised about it; others are asked again after that."""
Progress = Callable[[str], None]


@dataclass(frozen=True)
class Expansion:
    """A fit and the forms of the effects that it holds beyond the machine file's, in its order; the noise that it was made under."""

    fit: Identification
    held: tuple[Form, ...]
    node: Node
    kappa2: float


def expanded(fit: Identification, held: Sequence[Form] = ()) -> tuple[Expansion, float]:
    """The fit's best noise, and its log mass: evidence times prior of its terms."""
    moments = moments_of(fit, held, ())
    members = tuple((k, _width(term.effect)) for k, term in enumerate(moments.terms))
    weighed = log_evidence(moments, members)
    return Expansion(fit, tuple(held), moments.nodes[weighed.node], weighed.kappa2), weighed.total


def _width(effect: Effect) -> float:
    return min(WIDTHS, key=lambda w: abs(np.log(w / effect.spread)))


def polish(start: Expansion, candidates: Candidates, progress: Progress = lambda message: None) -> tuple[Posterior, Expansion]:
    """The posterior expanded at its own best subset, its nearest rivals weighed by exact refits, and the fit of the best."""
    here = start
    for number in range(ROUNDS):
        progress(f"expansion {number + 1}: {', '.join(f.effect.key for f in here.held) or 'the baseline'}")
        moments = moments_of(here.fit, here.held, _fresh(here, candidates))
        posterior = explore(moments, range(moments.held))
        if {t for t, _ in posterior.best} == set(range(moments.held)):
            break
        here = _shaped(refitted(moments, _clear(posterior)), progress, {f.effect.key for f in here.held})
    return _contested(posterior, here, progress), here


def _fresh(here: Expansion, candidates: Candidates) -> list[Form]:
    """What may join a fit: forms of other keys than it holds, that free no quantity which is free."""
    taken = {effect.key for effect in here.fit.model.effects}
    freed = {place for effect in here.fit.model.effects for place in effect.frees()}
    forms = [*candidates.forms, *placed(here.fit, candidates.scans, here.node)]
    return [f for f in forms if f.effect.key not in taken and not freed & set(f.effect.frees())]


def refitted(moments: Moments, subset: Subset) -> Expansion:
    """The exact fit of a subset under the noise that fits it best, its amplitudes' priors as wide as the subset says."""
    weighed = log_evidence(moments, subset)
    forms = [replace(f := moments.terms[t].form, effect=replace(f.effect, spread=width)) for t, width in subset]
    start = dict(moments.fit.named)
    for (t, width), part in zip(subset, solution(moments, subset, weighed.node), strict=True):
        if t >= moments.held and moments.terms[t].form.basis is None:
            start |= _stepped(moments, t, part)
    return _fitted(moments.fit, forms, start, moments.nodes[weighed.node], weighed.kappa2)


def _stepped(moments: Moments, term: int, step: np.ndarray) -> dict[str, float]:
    """Parameters of a fresh term where the linear solution puts them, within their bounds."""
    effect, columns = moments.terms[term].effect, moments.columns[term]
    parameters = replace(effect, spread=1.0).parameters(moments.fit.model.campaign)
    found = {}
    for p, x, size in zip(parameters, step, columns.amplitude, strict=True):
        value = p.mean + p.sigma * x if size else p.initial
        if p.start is not None and p.lower > -np.inf:
            value = max(value, p.start)  # at its bound it would have no slope
        found[p.name] = float(np.clip(value, p.lower, p.upper))
    return found


def _fitted(
    like: Identification, forms: Sequence[Form], start: Mapping[str, float], node: Node, kappa2: float
) -> Expansion:
    model = Model(like.model.campaign, [form.effect for form in forms])
    noises = {key: node.noise(noise.declared * kappa2**0.5) for key, noise in like.noises.items()}
    noises = {key: replace(noise, declared=like.noises[key].declared) for key, noise in noises.items()}
    known = {name: value for name, value in start.items() if name in model.index}
    with np.errstate(over="ignore", invalid="ignore"):  # a trial step may make a drive unstable
        fit = identify(model, start=known, start_noise=noises, noise="declared", refine=False)
    keys = {form.effect.key: form for form in forms}
    held = tuple(replace(keys[e.key], effect=e) for e in fit.model.added)
    return Expansion(fit, held, node, kappa2)


def _shaped(here: Expansion, progress: Progress, known: Collection[str] = ()) -> Expansion:
    """The fit with each of its effects, but for those `known` (keys), in the best of its shapes."""
    here, mass = expanded(here.fit, here.held)
    for number in (k for k, form in enumerate(here.held) if form.effect.key not in known):
        for shape in here.held[number].shapes:
            trial = _reshaped(here, number, shape)
            if trial is None:
                continue
            other, weighed = expanded(trial.fit, trial.held)
            progress(f"{shape.key} in another shape: {weighed - mass:+.1f} nats")
            if weighed > mass + DECISIVE:
                here, mass = other, weighed
    return here


def _reshaped(here: Expansion, number: int, shape: Effect) -> Expansion | None:
    """The fit with one of its effects in another shape; None where the shape cannot be."""
    form = here.held[number]
    try:
        effect = replace(shape, spread=form.effect.spread, tag=form.effect.tag).prepare(here.fit.model.campaign)
        forms = [*here.held[:number], replace(form, effect=effect), *here.held[number + 1 :]]
        return _fitted(here.fit, forms, here.fit.named, here.node, here.kappa2)
    except (InputError, np.linalg.LinAlgError):
        return None


def _contested(posterior: Posterior, here: Expansion, progress: Progress) -> Posterior:
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
        rival = _shaped(refitted(posterior.moments, subset), progress, {f.effect.key for f in here.held})
        _, evidence = expanded(rival.fit, rival.held)
        prior = sum(terms[t].log_prior - float(np.log(len(WIDTHS))) for t, _ in subset)
        progress(f"rival {[terms[t].effect.key for t, _ in subset]}: {evidence + prior - mass[best]:+.1f} nats")
        mass[subset] = max(mass[subset], evidence + prior)
    return replace(posterior, mass=mass)


def _clear(posterior: Posterior) -> Subset:
    """The members of the best subset that stand out; what the linear model needs beside them, relinearising may explain."""
    best = posterior.best
    mass = log_evidence(posterior.moments, best).total
    kept = []
    for k, member in enumerate(best):
        rest = (*best[:k], *best[k + 1 :])
        if member[0] < posterior.moments.held or mass - log_evidence(posterior.moments, rest).total > CLEAR:
            kept.append(member)
    return tuple(kept) or best


def _names(posterior: Posterior, subset: Subset) -> tuple[object, ...]:
    return tuple(sorted((posterior.moments.terms[t].name for t, _ in subset), key=str))


def _promising(posterior: Posterior, subset: Subset) -> bool:
    """Whether an exact refit may lift a subset above the best: it has a form of which the moments hold the slope alone, and explains
    by it at least half of what it does without."""
    moments = posterior.moments
    if all(t < moments.held or linear(moments.terms[t].form) for t, _ in subset):
        return False
    common = tuple(m for m in subset if m[0] in {t for t, _ in posterior.best})
    mine, theirs, both = (log_evidence(moments, s).total for s in (subset, posterior.best, common))
    return mine - both > max(DECISIVE, 0.5 * (theirs - both))


def linear(form: Form) -> bool:
    """Whether the moments hold all of a form: it has no parameter beside its amplitudes, and moves no drive and no play."""
    effect = form.effect
    return form.basis is not None or not (
        form.shapes or effect.frees() or any(signal.parameters for signal in effect.signals())
    )
