"""`diagnose` by one posterior: candidates, moments, explore, polish, decide; and its result as the public dataclasses."""

from __future__ import annotations

from collections.abc import Callable, Collection
from dataclasses import replace
from typing import Any, cast

import numpy as np

from symfive.campaign import Campaign
from symfive.diagnose import (
    Diagnosis,
    Finding,
    Location,
    Observability,
    RivalName,
    detect,
    direction_of,
    intervals_of,
    moved,
    prove,
    sentence_of,
)  # fmt: skip
from symfive.effects import Effect
from symfive.identify import Identification
from symfive.model import Model
from symfive.posterior._ask import asked
from symfive.posterior._coarse import coarsened
from symfive.posterior._decide import Verdict, decide
from symfive.posterior._evidence import log_evidence
from symfive.posterior._explore import Posterior
from symfive.posterior._fit import Expansion, baseline, fitted
from symfive.posterior._observe import Seen, alias_classes, seen
from symfive.posterior._polish import polish
from symfive.posterior._terms import candidates, name_of
from symfive.threads import one_thread

__all__ = ["diagnose"]

LISTED = 1e-3
"""Rivals less probable than this are not listed."""
ACTS = 0.05
"""Of an effect's largest mean square in a run: runs with less are not said to show it."""


@one_thread
def diagnose(
    campaign: Campaign, *, exclude: Collection[str] = (), progress: Callable[[str], None] = lambda message: None
) -> Diagnosis:
    """Find, name and model the physics that the baseline leaves out; `exclude` takes effects (by id) out of the library."""
    stated = candidates(campaign, exclude)
    before = baseline(campaign)
    posterior, here = polish(before, stated, progress)
    return _told(posterior, here, before, decide(posterior, coarsened(posterior)), progress)


def _told(
    posterior: Posterior, here: Expansion, before: Identification, verdicts: tuple[Verdict, ...],
    progress: Callable[[str], None],
) -> Diagnosis:  # fmt: skip
    moments, after = posterior.moments, here.fit
    node = log_evidence(moments, posterior.best).node
    classes, table = alias_classes(moments, node), seen(moments, node)
    observability = tuple(
        Observability(t.effect.vocabulary, t.effect.belongs_to, t.effect.key, s.visible, s.sigmas)
        for t, s in zip(moments.terms, table, strict=True) if not t.effect.nameless
    )  # fmt: skip
    progress("looking for the next test")
    findings = tuple(_finding(posterior, here, before, verdict, table[verdict.term]) for verdict in verdicts)
    nothing = posterior.weights.get(frozenset(), 0.0)
    detection = detect(before)
    location = Location(detection, observability, classes, (), {}, cast(Any, None))
    noise = float(np.sqrt(np.mean([n.white**2 for n in after.noises.values()])))
    progress("leaving out runs in turn")
    return Diagnosis(nothing, noise, findings, prove(before, after), detection, location, detect(after), before, after)


def _finding(posterior: Posterior, here: Expansion, before: Identification, verdict: Verdict, visible: Seen) -> Finding:
    moments, after, campaign = posterior.moments, here.fit, here.fit.model.campaign
    effect = moments.terms[verdict.term].effect
    contribution = after.model.contribution(effect, after.values)
    square = {run: float(np.mean((c - c.mean(axis=0)) ** 2)) for run, c in contribution.items()}
    runs = tuple(run for run, s in square.items() if s > ACTS * max(square.values()))
    total = sum(float(np.sum(r**2)) for r in before.residuals.values())
    without = fitted(_lacking(after, effect), [after.named], here.node, here.kappa2, after)
    left = sum(float(np.sum(r**2)) for r in without.residuals.values())
    gone = left - sum(float(np.sum(r**2)) for r in after.residuals.values())
    name, axis = verdict.names[0] if verdict.names else ("unknown", None)
    terms = moments.terms
    rivals = [
        RivalName(*who, share, _component(posterior, who)) for who, share in verdict.rivals.items() if share > LISTED
    ]
    alias = tuple(terms[t].effect.key for t in verdict.alias)
    nearest = next((terms[t].effect.key for t in verdict.alias if terms[t].name != terms[verdict.term].name), None)
    draft = Finding(
        effect=effect, name=name, axis=axis, confidence=min(verdict.probability, 0.999),
        parameters=effect.describe(campaign, after.named, _covariance(after, effect)),
        rivals=tuple(sorted(rivals, key=lambda r: -r.confidence)), runs=runs,
        coordinate=effect.coordinate.format(axis=effect.belongs_to), intervals=intervals_of(campaign, contribution),
        direction=direction_of(after.model.machine, effect, after.named), says="",
        log_p=float(np.log(max(1.0 - verdict.probability, 1e-300))), visible=visible.visible,
        share=float(np.clip(gone / max(total, 1e-300), 0.0, 1.0)), moved=moved(without, after), contribution=contribution,
        alias=alias, nearest=None if nearest is None else (nearest, 0.0),
    )  # fmt: skip
    test = asked(posterior, here, verdict)
    says = sentence_of(draft, after)
    if test is None:
        return replace(draft, says=says)
    others = [rival for rival, _ in test.each]
    folder = f"plans/separate-{effect.key}-from-{others[0]}" if test.useful else None
    return replace(
        draft, test=test, next_test=folder, says=f"{says} To tell it from {' and '.join(others)}: {test.says}."
    )


def _lacking(fit: Identification, effect: Effect) -> Model:
    return Model(fit.model.campaign, [e for e in fit.model.added if e.key != effect.key])


def _component(posterior: Posterior, name: tuple[str, str | None]) -> str | None:
    """The component of the most probable form of a name."""
    terms = posterior.moments.terms
    for subset in sorted(posterior.mass, key=lambda s: -posterior.mass[s]):
        for t, _ in subset:
            if name_of(terms[t].effect) == name:
                return getattr(terms[t].effect, "component", None)
    return None


def _covariance(fit: Identification, effect: Effect) -> dict[tuple[str, str], float]:
    names = [p.name for p in effect.parameters(fit.model.campaign)]
    place = [fit.model.index[name] for name in names]
    return {
        (a, b): float(fit.covariance[i, j])
        for a, i in zip(names, place, strict=True)
        for b, j in zip(names, place, strict=True)
    }
