"""The next test for a finding that still has rivals."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

from symfive.design import APART, Discrimination
from symfive.diagnose._next_test import next_test
from symfive.diagnose._stretches import LONG
from symfive.effects import Effect
from symfive.model import Model
from symfive.posterior import Expansion, Name, Posterior, Subset, Verdict, linear_estimate, log_evidence

OPEN = 0.05
"""A test is asked for from this probability on that the first name is wrong (1 in 20, as tests are judged)."""
RIVALS = 3
"""Names that a test has to separate from the first, the most probable ones."""


def asked(posterior: Posterior, here: Expansion, verdict: Verdict) -> Discrimination | None:
    """The next test for a verdict; None without rivals, or if no further test separates them better."""
    terms = posterior.moments.terms
    own = terms[verdict.term].effect
    rivals = _rivals(posterior, verdict)
    if own.unidentified or not rivals:
        return None
    campaign = here.fit.model.campaign  # of long recordings the first rows: no further test has to be as long
    runs = (run.part(0, LONG) if run.dynamic and run.rows > LONG else run for run in campaign.runs)
    shared = {p.name for p in here.fit.parameters if not p.of_setup}
    values = {name: value for name, value in here.fit.named.items() if name in shared}
    held = tuple(effect for effect in here.fit.model.added if effect.key != own.key)
    return next_test(
        replace(campaign, runs=tuple(runs)), own, *(effect for effect, _, _ in rivals), held=held, values=values,
        rival_values=[there for _, there, _ in rivals], chances=[chance for _, _, chance in rivals],
    )  # fmt: skip


def folder_of(key: str, test: Discrimination) -> str:
    """Where the plan of a test is written that separates the effect of this key from its likeliest rival that it separates."""
    apart = next((rival for rival, sigmas in test.each if sigmas >= APART), test.each[0][0])
    return f"plans/separate-{key}-from-{apart}"


def _rivals(posterior: Posterior, verdict: Verdict) -> list[tuple[Effect, Mapping[str, float], float]]:
    """Effects of other names, with where they would be and how probable their names are: of each the best subset that has it in
    the member's place."""
    moments, term = posterior.moments, verdict.term
    best: dict[Name, tuple[Subset, int]] = {}
    for subset, number in posterior.in_place_of(term):
        other = moments.terms[number]
        if other.name != moments.terms[term].name and not other.effect.unidentified:
            best.setdefault(other.name, (subset, number))
    alike = {moments.terms[t].name for t in verdict.alias}
    open_ = [name for name in best if name in alike or verdict.rivals.get(name, 0.0) > OPEN]
    found = list[tuple[Effect, Mapping[str, float], float]]()
    for name in sorted(open_, key=lambda name: -verdict.rivals.get(name, 0.0))[:RIVALS]:
        subset, number = best[name]
        effects, values = linear_estimate(moments, subset, log_evidence(moments, subset))
        effect = next(e for e in effects if e.key == moments.terms[number].effect.key)
        model = Model(moments.fit.model.campaign, effects)
        there = {p.name: values.get(p.name, p.initial) for p in model.parameters if not p.of_setup}
        found.append((replace(effect, spread=1.0), there, verdict.rivals.get(name, 0.0)))
    return found
