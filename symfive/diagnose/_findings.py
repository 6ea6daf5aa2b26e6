"""Model: the named effects are in the symbolic model, all parameters are identified again, and each finding is put into
words: what, where, how large, how sure, what had hidden it, how the geometry moved."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from symfive.campaign import Campaign
from symfive.diagnose._alike import alike
from symfive.diagnose._determined import sigmas_from_nothing
from symfive.diagnose._evidence import evidence_of
from symfive.diagnose._places import axis_of, coordinate_of, direction_of, intervals_of, leaves
from symfive.diagnose._refit import amplitudes, lacking
from symfive.diagnose._result import Finding, RivalName, mean_square, named
from symfive.diagnose._search import Member, Naming
from symfive.diagnose._words import sentence_of
from symfive.effects import Effect
from symfive.identify import Identification, identify
from symfive.model import Model
from symfive.numbers import in_words, name_words
from symfive.threads import one_thread

__all__ = ["amend", "doubted", "findings_of", "moved", "withdrawn"]

Array = NDArray[np.float64]
ALIAS_EVIDENCE = 3.0
MIMICRY = 0.5
"""Probability that a name holds at all where another effect found has none: the library lacks something there, and what it
lacks is often mimicked by what it has. Six of seven such names were mimicry in the blind study's development cases; no more
than even odds are taken away, since two effects may well act at once."""
MINORITY = 1.0
"""What explains less by its own form than by the rest of its family (rms) is not called by its name."""


@one_thread
def amend(fit: Identification, *effects: Effect) -> Identification:
    """The fit with effects added to its model, every parameter and the noise identified again.

    The same as naming does; for effects that the user names. `moved(fit, amended)` says what it did to the geometry.
    """
    model = Model(fit.model.campaign, (*fit.model.added, *effects))
    start = fit.named
    start |= {n: v for e in effects for n, v in e.typical(fit.model.campaign).items() if n in model.index}
    return identify(
        model, start=start, noise="repeats"
    )  # from declared noise: what was found had swallowed the effects


def doubted(naming: Naming) -> Identification:
    """The final fit, its covariance with what is not known of the names: Σ w Δ Δᵀ over all that could stand in a member's
    place, Δ what it would do to the other parameters, w its probability (J. A. Hoeting et al. 1999, (2))."""
    after = naming.after
    covariance = after.covariance.copy()
    for member in naming.members:
        own = next((t for t in member.trials if t.effect.key == member.effect.key), None)
        if own is None:
            continue
        weights = np.exp([np.clip(t.evidence - own.evidence, -700.0, 30.0) for t in member.trials])
        for trial, weight in zip(member.trials, weights / weights.sum(), strict=True):
            here = [
                trial.values.get(p.name, v) - own.values.get(p.name, v)
                for p, v in zip(after.parameters, after.values, strict=True)
            ]
            covariance += weight * np.outer(here, here)
    return replace(after, covariance=covariance)


def findings_of(naming: Naming) -> tuple[Finding, ...]:
    """What was named, in words and numbers, in the order of the evidence that each adds to all others."""
    shares = _shares(naming)
    findings = [_finding(naming, member, *shares[member.effect.key]) for member in naming.members]
    added = {key: _added(naming.after, without, key) for key, (_, without) in shares.items()}
    return tuple(sorted(findings, key=lambda f: -added[f.effect.key]))


def withdrawn(naming: Naming) -> tuple[str, ...]:
    """What explained the readings but has no size in the final fit, each in a sentence."""
    said = []
    for effect, fit in naming.withdrawn:
        held = effect.describe(fit.model.campaign, fit.named, _pairs(fit, effect))
        numbers = [
            f"{name_words(name, q.unit)} {in_words(q.value, q.std, q.unit or '')}"
            for name, q in held.items()
            if isinstance(q.value, (int, float)) and isinstance(q.std, (int, float))
        ]
        name = named(effect.vocabulary, axis_of(effect))
        said.append(
            f"{name[:1].upper()}{name[1:]} would explain more, but the readings do not determine how large it is "
            f"({', '.join(numbers)}): no finding."
        )
    return tuple(said)


def _added(after: Identification, without: Identification, key: str) -> float:
    """Log evidence of the final fit over the one without an effect, under the same noise."""
    effect = next(e for e in after.model.effects if e.key == key)
    sized = () if effect.id == "unknown" else amplitudes(after.model.campaign, effect)
    return evidence_of(after.problem(), after.values, sized) - evidence_of(without.problem(), without.values)


def _shares(found: Naming) -> dict[str, tuple[float, Identification]]:
    """Effect → share of the deviation's mean square that it explains, and the fit without it; all else identified anew.

    The effects join one after the other, that which explains most by itself first: the shares add up to what all explain
    together. What geometry and set-up explain without any of them, under the noise of the final fit, is not theirs.
    """
    effects = {member.effect.key: member.effect for member in found.members}
    keys = frozenset(effects)
    fits = {keys: found.after}

    def with_only(joined: frozenset[str]) -> Identification:
        if joined not in fits:
            fits[joined] = lacking(found.after, *(effects[key] for key in keys - joined))
        return fits[joined]

    def left(joined: frozenset[str]) -> float:
        return mean_square(with_only(joined), found.after.outliers)

    before = mean_square(found.before, found.after.outliers)
    shares, joined, reached = dict.fromkeys(keys, 0.0), frozenset[str](), min(before, left(frozenset()))
    for key in sorted(keys, key=lambda k: left(frozenset({k}))):
        joined |= {key}
        shares[key] = max(reached - left(joined), 0.0) / max(before, 1e-300)
        reached = min(reached, left(joined))
    return {key: (shares[key], with_only(keys - {key})) for key in keys}


def _finding(found: Naming, member: Member, share: float, without: Identification) -> Finding:
    after = found.after
    campaign = after.model.campaign
    effect = next(e for e in after.model.effects if e.key == member.effect.key)
    values = after.named
    covariance = _pairs(after, effect)
    contribution = after.model.contribution(effect, after.values)
    shape = _shape_share(after, effect, contribution)
    nameless = any(m.effect.id == "unknown" and not leaves(m.effect, effect) for m in found.members)
    # a name holds by the share that its own form has in what it explains together with the rest of its family
    holds = (MIMICRY if nameless else 1.0) / (1.0 + shape**2) if effect.id != "unknown" else 1.0
    name, axis = effect.vocabulary, axis_of(effect)
    rivals, alias, nearest, confidence = _rivals(campaign, effect, member, holds)
    if effect.id != "unknown" and shape > MINORITY:
        nobody = next(r for r in rivals if r.effect == "unknown")
        own = RivalName(name, axis, confidence, getattr(effect, "component", None))
        rivals = tuple(sorted({*rivals, own} - {nobody}, key=lambda r: -r.confidence))
        name, confidence, alias, nearest = "unknown", nobody.confidence, (), None
    parameters = effect.describe(campaign, values, covariance)
    square = {run: float(np.mean(c**2)) for run, c in contribution.items()}
    strongest = max(square.values(), default=0.0)
    runs = tuple(run for run, s in square.items() if s > 0.05 * strongest)
    visible = next((o.visible for o in found.location.observability if o.form == effect.key), 1.0)
    shifted = moved(without, after)
    draft = Finding(
        effect=effect, name=name, axis=axis, confidence=confidence, parameters=parameters, rivals=rivals, runs=runs,
        coordinate=coordinate_of(effect), intervals=intervals_of(campaign, contribution),
        direction=direction_of(after.model.machine, effect, values), says="", log_p=member.log_p, visible=min(visible, 1.0),
        share=share, moved=shifted,
        contribution=contribution, alias=alias, shape_differs=shape, nearest=nearest,
        sigmas=sigmas_from_nothing(after, effect),
    )  # fmt: skip
    return replace(draft, says=sentence_of(draft, after))


def _pairs(result: Identification, effect: Effect) -> dict[tuple[str, str], float]:
    names = [p.name for p in effect.parameters(result.model.campaign)]
    place = [result.model.index[n] for n in names]
    return {
        (a, b): float(result.covariance[i, j])
        for a, i in zip(names, place, strict=True)
        for b, j in zip(names, place, strict=True)
    }


def _shape_share(result: Identification, effect: Effect, contribution: Mapping[str, Array]) -> float:
    """By how much its shape differs from the library's: what it explains together with the rest of its family, rms across its own
    form over rms along it."""
    rest = next((e for e in result.model.effects if getattr(e, "of", "") == effect.key), None)
    if rest is None:
        return 0.0
    parts = result.model.contribution(rest, result.values)
    own, other = (np.concatenate([(c - c.mean(axis=0)).ravel() for c in p.values()]) for p in (contribution, parts))
    square = max(float(own @ own), 1e-300)
    along = (1.0 + float(own @ other) / square) * own
    return float(np.linalg.norm(own + other - along) / max(float(np.linalg.norm(along)), 1e-150))


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


def _rivals(
    campaign: Campaign, effect: Effect, member: Member, holds: float
) -> tuple[tuple[RivalName, ...], tuple[str, ...], tuple[str, float] | None, float]:
    """Rivals with their probabilities, forms that read alike, the nearest of them with another name and by how many σ its
    fit is worse, and the probability of the name.

    Probabilities from the log evidence of exact refits under the final noise, every name weighed by all its forms. Forms that
    read alike are other forms of the same effect with nearly its evidence, and all that fit as well (`alike`). `holds`: the
    probability that it is a name of the library at all; the rest is `unknown`'s.
    """
    own = next((t for t in member.trials if t.effect.key == effect.key), None)
    if own is None:
        return (RivalName("unknown", None, 1.0 - holds),) if holds < 1.0 else (), (), None, 0.999 * holds
    best: dict[tuple[str, str | None], Effect] = {}
    weights: dict[tuple[str, str | None], float] = {}
    alias, others = [], list[tuple[float, str]]()
    ours = (effect.vocabulary, axis_of(effect))
    same = alike(campaign, member.trials, own)
    for trial in member.trials:  # the best of a name comes first
        gap = own.evidence - trial.evidence
        who = (trial.effect.vocabulary, axis_of(trial.effect))
        if trial.effect.id != "unknown" or who not in best:
            weights[who] = weights.get(who, 0.0) + float(np.exp(-np.clip(gap, -30.0, 700.0)))
        best.setdefault(who, trial.effect)
        if trial.effect.key == effect.key:
            continue
        fits = any(trial is t for t in same)
        if fits or (who == ours and effect.id != "unknown" and gap < ALIAS_EVIDENCE):
            alias.append(trial.effect.key)
        if fits and who != ours:
            others.append((float(np.sqrt(max(trial.misfit - own.misfit, 0.0))), trial.effect.key))
    total = sum(weights.values()) / holds
    shares = {who: weight / total for who, weight in weights.items()}
    confidence = shares.pop(ours)
    if holds < 1.0:
        shares["unknown", None] = shares.get(("unknown", None), 0.0) + 1.0 - holds
    names = [RivalName(*who, share, getattr(best.get(who), "component", None)) for who, share in shares.items()]
    nearest = min(((key, sigmas) for sigmas, key in others), key=lambda other: other[1], default=None)
    return tuple(sorted(names, key=lambda r: -r.confidence)), tuple(alias), nearest, min(confidence, 0.999)
