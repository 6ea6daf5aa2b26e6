"""Findings from verdicts, and fits amended by effects that the user names."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import chain

import numpy as np
from scipy.special import logsumexp

from symfive.arrays import Array
from symfive.diagnose._ask import asked, folder_of
from symfive.diagnose._finding import Finding, RivalName
from symfive.diagnose._intervals import direction_of, intervals_of, with_begin
from symfive.diagnose._locate import Location
from symfive.diagnose._result import mean_square
from symfive.diagnose._words import sentence_of
from symfive.effects import Effect, Quantity, form_words
from symfive.identify import Identification, identify, summarise
from symfive.model import Model
from symfive.posterior import (
    Expansion,
    Name,
    Posterior,
    Subset,
    Verdict,
    laws_apart,
    refitted,
    sigmas_from_nothing,
)
from symfive.threads import one_thread

LISTED = 1e-3
"""Rivals less probable than this are not listed."""
ACTS = 0.05
"""Of an effect's largest mean square in a run: runs with less are not said to show it."""
OPEN, REFITS = 0.01, 3
"""What is at least so probable beside the findings counts in the covariance, the most probable so many."""


@one_thread
def amend(fit: Identification, *effects: Effect) -> Identification:
    """The fit with effects added to its model, every parameter and the noise identified again: for effects that the user names.

    `moved(fit, amended)` says what it did to the geometry.
    """
    model = Model(fit.model.campaign, (*fit.model.added, *effects))
    start = fit.named
    start |= {n: v for e in effects for n, v in e.typical(fit.model.campaign).items() if n in model.index}
    # from declared noise: what was found had absorbed the effects
    return identify(model, start=start, noise="repeats")


def moved(before: Identification, after: Identification, most: int = 8) -> dict[str, tuple[float, float]]:
    """Errors of the machine that moved by more than their 1σ from one fit to another: name → (before, after) in file units,
    the most moved first."""
    ranked = []
    for p in after.parameters:
        if p.kind in ("location_error", "error_motion") and p.name in before.model.index:
            change = abs(after[p.name] - before[p.name]) / max(after.uncertainty(p.name), 1e-12)
            if change > 1.0:
                ranked.append((change, p.name))
    return {name: (before[name], after[name]) for _, name in sorted(ranked, reverse=True)[:most]}


def model_averaged(posterior: Posterior, here: Expansion, after: Identification) -> Identification:
    """The final fit, its covariance with what is not known of the names and shapes: Σ w Δ Δᵀ over the other subsets and shapes, Δ
    what each does to the other parameters of `here`, the fit of what the search saw, w its probability (J. A. Hoeting et al.
    1999, (2))."""
    held = frozenset(range(posterior.moments.held))
    others = {terms: weight for terms, weight in posterior.weights.items() if terms != held and weight > OPEN}
    likely = sorted(others, key=lambda terms: -others[terms])[:REFITS]
    fits = [(others[terms], refitted(posterior.moments, _most_probable(posterior, terms)).fit) for terms in likely]
    return _averaged(after, here.fit, (*fits, *here.others))


def _averaged(
    fit: Identification, here: Identification, others: Iterable[tuple[float, Identification]]
) -> Identification:
    """A fit whose covariance contains what others, with their weights, differ from `here` by. An amplitude that another shape of
    an effect lacks is where it does nothing."""
    campaign, mine = fit.model.campaign, here.named
    sizes = {effect.key: {p.name: p.mean for p in effect.amplitudes(campaign)} for effect in fit.model.added}
    covariance = fit.covariance.copy()
    for weight, other in others:
        there = {name: mean for e in other.model.added for name, mean in sizes.get(e.key, {}).items()} | other.named
        both = there.keys() & mine.keys()
        change = np.array([there[p.name] - mine[p.name] if p.name in both else 0.0 for p in fit.parameters])
        covariance += weight * np.outer(change, change)
    return replace(fit, covariance=covariance)


def _most_probable(posterior: Posterior, terms: frozenset[int]) -> Subset:
    """The best widths of a set of terms."""
    same = [subset for subset in posterior.mass if frozenset(t for t, _ in subset) == terms]
    return max(same, key=lambda subset: posterior.mass[subset])


def findings_of(
    posterior: Posterior,
    here: Expansion,
    before: Identification,
    verdicts: Sequence[Verdict],
    location: Location,
    searched: Expansion | None = None,
) -> tuple[Finding, ...]:
    """What was decided, in the order of the evidence that each adds to all others. `here`: the final fit, `before` the baseline,
    `searched` the fit that the posterior is expanded at, where it is another one.

    Of an unidentified cause only its coordinates and its runs are known, and not of how many causes it is the sum: unidentified
    verdicts that share a run are one finding.
    """
    causes = _causes(posterior, here, verdicts)
    shares, apart = _shares(here, before, [cause.keys for cause in causes]), laws_apart(here)
    seen = searched or here
    stated = _averaged(apart, seen.fit, seen.others)
    found = [_finding(posterior, here, apart, stated, cause, location, *shares[cause.keys]) for cause in causes]
    return tuple(sorted(found, key=lambda finding: finding.log_p))


@dataclass(frozen=True)
class _Cause:
    """One cause: its `verdicts`, the largest first, their `effects`, what these are off by, `discrepancies`, and what all do to
    the readings (run → (N, ny))."""

    verdicts: tuple[Verdict, ...]
    effects: tuple[Effect, ...]
    discrepancies: tuple[Effect, ...]
    contribution: Mapping[str, Array]

    @property
    def keys(self) -> frozenset[str]:
        """Of its effects."""
        return frozenset(effect.key for effect in self.effects)

    @property
    def runs(self) -> tuple[str, ...]:
        """Where it acts."""
        square = {run: _size(each) for run, each in self.contribution.items()}
        return tuple(run for run, s in square.items() if s > ACTS * max(square.values()))

    def beside(self, other: _Cause) -> bool:
        """Whether both are unidentified and share a run."""
        both = self.verdicts[0].unidentified and other.verdicts[0].unidentified
        return both and bool(set(self.runs) & set(other.runs))

    @property
    def coordinates(self) -> tuple[str, ...]:
        """Over which its effects act."""
        return tuple(dict.fromkeys(chain.from_iterable(effect.coordinates for effect in self.effects)))


def _size(contribution: Array) -> float:
    """Mean square about its mean."""
    return float(np.mean((contribution - contribution.mean(axis=0)) ** 2))


def _causes(posterior: Posterior, here: Expansion, verdicts: Sequence[Verdict]) -> list[_Cause]:
    """The verdicts as causes, the unidentified ones that share a run together."""
    problem, groups, told = here.fit.problem(), list[list[_Cause]](), set[str]()
    for verdict in verdicts:
        effect = posterior.moments.terms[verdict.term].effect
        beside = [form.effect for form in here.discrepancies_of([effect.key]) if form.effect.key not in told]
        told |= {each.key for each in beside}  # of two laws over one coordinate it is said with the first
        parts = [problem.contribution(each, here.fit.values) for each in (effect, *beside)]
        cause = _Cause((verdict,), (effect,), tuple(beside), _sum(parts))
        joined, apart = [cause], list[list[_Cause]]()
        for group in groups:
            if any(map(cause.beside, group)):
                joined += group
            else:
                apart.append(group)
        groups = [*apart, joined]
    return [_together(group) for group in groups]


def _together(causes: Sequence[_Cause]) -> _Cause:
    """Several causes as one."""
    ranked = sorted(causes, key=lambda cause: -sum(map(_size, cause.contribution.values())))
    verdicts, effects = tuple(c.verdicts[0] for c in ranked), tuple(c.effects[0] for c in ranked)
    beside = tuple(chain.from_iterable(c.discrepancies for c in ranked))
    return _Cause(verdicts, effects, beside, _sum([c.contribution for c in ranked]))


def _sum(contributions: Sequence[Mapping[str, Array]]) -> dict[str, Array]:
    """Run → (N, ny) of several contributions together."""
    return {run: np.sum([each[run] for each in contributions], axis=0) for run in contributions[0]}


def _shares(
    here: Expansion, before: Identification, causes: Sequence[frozenset[str]]
) -> dict[frozenset[str], tuple[float, Identification]]:
    """Cause (keys of its effects) → share of the deviation's mean square that it explains, and the fit without it; all else
    refitted.

    The causes join one after the other, that which explains most by itself first: the shares add up to what all explain
    together. What geometry and set-up explain without any of them, under the noise of the final fit, is not theirs.
    """
    after, keys = here.fit, frozenset[str]().union(*causes)
    fits = {keys: after}

    def with_only(joined: frozenset[str]) -> Identification:
        if joined not in fits:
            fits[joined] = here.without(keys - joined).fit
        return fits[joined]

    def left(joined: frozenset[str]) -> float:
        return mean_square(with_only(joined), after.outliers)

    whole = mean_square(before, after.outliers)
    shares, joined, reached = dict.fromkeys(causes, 0.0), frozenset[str](), min(whole, left(frozenset()))
    for cause in sorted(causes, key=left):
        joined |= cause
        shares[cause] = max(reached - left(joined), 0.0) / max(whole, 1e-300)
        reached = min(reached, left(joined))
    return {cause: (shares[cause], with_only(keys - cause)) for cause in causes}


def _finding(
    posterior: Posterior,
    here: Expansion,
    apart: Identification,
    stated: Identification,
    cause: _Cause,
    location: Location,
    share: float,
    without: Identification,
) -> Finding:
    """`apart`: the fit `here` with each law apart from its discrepancy; `stated`: with what is not known of its shape, too."""
    moments, after, campaign = posterior.moments, here.fit, here.fit.model.campaign
    verdict, effect, terms = cause.verdicts[0], cause.effects[0], moments.terms
    first = verdict.names[0] if verdict.names else ("unknown", None)
    axes = {each.belongs_to if each.unidentified else first[1] for each in cause.effects}
    name, axis = first[0], axes.pop() if len(axes) == 1 else None
    rivals = [
        RivalName(*who, chance, _component(posterior, who))
        for who, chance in verdict.rivals.items()
        if chance > LISTED and who != first
    ]
    alias = dict.fromkeys(terms[t].effect.key for t in (*verdict.alias, *verdict.components))

    def sizes(one: Effect) -> Mapping[str, Quantity]:
        known = _left_open(stated, one)
        return with_begin(after, one).describe(campaign, known.named, _covariance(known))

    draft = Finding(
        effect=effect, name=name, axis=axis, confidence=min(max(v.probability for v in cause.verdicts), 0.999),
        parameters=sizes(effect),
        rivals=tuple(sorted(rivals, key=lambda r: -r.confidence)),
        runs=cause.runs,
        coordinate=", ".join(cause.coordinates), intervals=intervals_of(campaign, cause.contribution),
        direction=None if cause.effects[1:] else direction_of(after.model.machine, effect, stated.named), says="",
        log_p=min(_log_nothing(posterior, v.term) for v in cause.verdicts), share=share, moved=moved(without, after),
        contribution=cause.contribution,
        visible=next((o.visible for o in location.observability if o.form == effect.key), 1.0),
        alias=tuple(alias), by_experience=verdict.by_experience, sigmas=sigmas_from_nothing(apart, effect),
        further=tuple((e, sizes(e)) for e in cause.effects[1:]),
        discrepancies=tuple((e, sizes(e)) for e in cause.discrepancies),
    )  # fmt: skip
    test = asked(posterior, here, verdict)
    says = sentence_of(draft, after)
    if test is None:
        return replace(draft, says=says)
    others = " and ".join(form_words(rival, after.model.machine) for rival, _ in test.each)
    return replace(
        draft, test=test, next_test=folder_of(effect.key, test) if test.useful else None,
        says=f"{says} To separate it from {others}: {test.says}.",
    )  # fmt: skip


def _log_nothing(posterior: Posterior, term: int) -> float:
    """Log of the probability that nothing acts where a term does: of subsets without it and with no other name than the rest of
    the fit has."""
    terms = posterior.moments.terms
    names = {terms[t].name for t in range(posterior.moments.held) if t != term}
    nothing = [
        mass
        for subset, mass in posterior.mass.items()
        if term not in {t for t, _ in subset} and {terms[t].name for t, _ in subset} <= names
    ]
    every = list(posterior.mass.values())
    return float((logsumexp(nothing) if nothing else min(every)) - logsumexp(every))


def _component(posterior: Posterior, name: Name) -> str | None:
    """The component of the most probable form of a name that the fit does not hold."""
    terms, held = posterior.moments.terms, posterior.moments.held
    for subset in sorted(posterior.mass, key=lambda s: -posterior.mass[s]):
        for t, _ in subset:
            if t >= held and terms[t].name == name:
                return getattr(terms[t].effect, "component", None)
    return None


def _left_open(fit: Identification, effect: Effect) -> Identification:
    """The fit with what an effect's sizes are relative to beside it, at nothing, if it lacks that."""
    model, held = fit.model, {each.key for each in fit.model.effects}
    beside = [each for each in effect.beside(model.campaign) if each.key not in held]
    if not beside:
        return fit
    wider = Model(model.campaign, (*model.added, *beside))
    still = {p.name: p.mean for each in beside for p in each.parameters(model.campaign)}
    return summarise(fit.problem(wider), wider.vector({**fit.named, **still}), converged=True)


def _covariance(fit: Identification) -> dict[tuple[str, str], float]:
    """Of what effects have, by pairs of names."""
    names = [p.name for p in fit.model.parameters if p.kind == "effect"]
    place = [fit.model.index[name] for name in names]
    return {
        (a, b): float(fit.covariance[i, j])
        for a, i in zip(names, place, strict=True)
        for b, j in zip(names, place, strict=True)
    }
