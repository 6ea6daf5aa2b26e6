"""What was taken for noise: slow noise weighed against effects over time, large coloured noise against names."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from symfive.diagnose._evidence import evidence_of, evidence_with_noise, likelihood_ratio
from symfive.diagnose._places import coordinate_of
from symfive.diagnose._refit import (
    DECISIVE,
    Forms,
    amplitudes,
    beforehand,
    newest,
    refitted,
    shaped,
    start_of,
    tried,
    widened,
)
from symfive.diagnose._scores import Score, log_tail
from symfive.diagnose._variants import narrower, shapes, variants
from symfive.effects import Effect
from symfive.effects.unknown import Unknown
from symfive.identify import Identification
from symfive.model import Model

__all__ = [
    "changes_slowly", "drift", "large_noise", "log_share", "name_or_noise", "physics_or_noise", "slow_noise", "whitened",
]  # fmt: skip

SLOW = 0.1
"""Noise whose correlation lasts longer than this part of a run may be something that drifts."""
SLOWLY = ("thermal_drift", "spindle_growth", "bar_temperature", "setup_shift", "unknown")
"""What changes while nothing moves."""
LARGE = 0.5
"""Slow noise in units of the declared: few instruments have a larger one, any may have a smaller."""
DIRECTIONS = 4
"""All three, or a single one."""
WIDTHS = (0.1, 0.3, 1.0)
"""Of the prior of a cycle's amplitudes, in units of the usual one."""
SLOW_NOISE = 0.2
"""The share of instruments whose own noise is that slow and large."""


def changes_slowly(effect: Effect) -> bool:
    """Whether an effect acts over time alone."""
    return effect.id in SLOWLY and coordinate_of(effect) in ("time", "t")


def slow_noise(fit: Identification, level: float) -> float:
    """The largest part of the noise that changes as slowly as the runs last, in units of the declared noise; 0 where all of it is
    less than an effect that is significant at `level` would bring into the readings.

    No score under such noise would find what drifts: the noise's own parameters have swallowed it.
    """
    largest = hidden = 0.0
    problem = fit.problem()
    for run in fit.model.campaign.runs:
        for name, columns in problem.parts(run):
            noise = fit.noises[run.id, name]
            if noise.time_constant > SLOW * run.duration:
                share = noise.coloured / noise.declared
                hidden += share**2 * run.rows * (columns.stop - columns.start)
                largest = max(largest, share)
    return largest if hidden > -2.0 * np.log(level) else 0.0


def log_share(fit: Identification, level: float) -> float:
    """Log of the share of instruments whose own noise is as slow and large as the fit takes it for: of those with a `LARGE` one
    the same share has twice as much, and so on (with its mean given the exponential law takes the least for granted)."""
    return float(np.log(SLOW_NOISE)) * slow_noise(fit, level) / LARGE


def large_noise(fit: Identification) -> bool:
    """Whether the fit takes more than few instruments have for coloured noise: a name may be in it."""
    return any(n.coloured > LARGE * n.declared for n in fit.noises.values())


def whitened(fit: Identification) -> Identification:
    """The fit as if its noise were white."""
    return replace(fit, noises={k: replace(n, coloured=0.0) for k, n in fit.noises.items()})


def physics_or_noise(
    fit: Identification,
    candidates: Sequence[Score],
    names: int,
    level: float,
    progress: Callable[[str], None],
) -> tuple[Identification, float] | None:
    """The most probable of effects over time, with the noise found anew, where slow noise alone would hardly look like it; with
    the log of that chance. The candidates are the best of so many `names`, and all terms without one; the best of these is tried
    along single directions too: an instrument's noise prefers none. What the drives do is computed once: their parameters stay
    where they are but in the fit that comes out, and in the odds, which are those about any values near the best.
    """
    tests = _over_time(fit, candidates, names, level, progress)
    best = _best(tests, 0.0, level)
    return (_released(best[0], fit), best[1]) if best else None


def drift(
    fit: Identification, candidates: Sequence[Score], forms: Forms, level: float, progress: Callable[[str], None]
) -> Identification | None:
    """The term over time without a name that explains most where no noise may be slow, or a name that is more probable than any
    such, each with the noise found anew, and what it leaves as improbable as so slow and large a noise is. A name has to leave
    no more than a fifth of instruments have: a step does not explain what creeps."""
    white = whitened(fit)
    base = evidence_of(white.problem(), white.values)
    nameless, named = list[_Drift](), list[_Drift]()
    for score in candidates:
        progress(f"a drift as {score.effect.key}")
        trial = tried(white, base, score, forms)
        if trial is None:
            continue
        after = shaped(white, trial)
        share, effect = log_share(after, level), newest(after)
        prior = beforehand(fit.model.campaign, effect, trial.looks, after.named, forms)
        found = _Drift(after, trial.evidence, _odds(after, fit) + prior + share)
        if effect.id == "unknown":
            nameless.append(found)
        elif share > np.log(SLOW_NOISE):
            named.append(found)
    best = max(named, key=lambda d: d.odds, default=None)
    if best is not None and best.odds > max((d.odds for d in nameless), default=-np.inf):
        return best.after
    return max(nameless, key=lambda d: d.evidence).after if nameless else None


@dataclass(frozen=True)
class _Drift:
    """A fit with an effect over time: its log `evidence` where no noise may be slow, and log `odds` with the noise it leaves."""

    after: Identification
    evidence: float
    odds: float


def _over_time(
    fit: Identification,
    candidates: Sequence[Score],
    names: int,
    level: float,
    progress: Callable[[str], None],
) -> list[_Test]:
    """Each of the effects over time against slow noise, what the drives do held."""
    campaign, white = fit.model.campaign, whitened(fit)
    drives = _drives(fit)
    share = float(np.log(SLOW_NOISE)) if slow_noise(fit, level) > LARGE else 0.0
    tests: list[_Test] = []

    def test(score: Score, effect: Effect) -> _Test:
        model = Model(campaign, (*white.model.added, effect.prepare(campaign)))
        found = widened(refitted(model, white.named | start_of(model, score), white, drives), drives)
        looks = DIRECTIONS if effect.id == "unknown" else score.looks
        tests.append(_Test.of(found, fit, names, looks, DECISIVE, share))
        return tests[-1]

    nameless: list[tuple[float, Score]] = []
    for score in candidates:
        progress(f"slow noise or {score.effect.key}")
        if score.effect.id == "unknown":
            nameless.append((test(score, _simple(score.effect)).odds, score))
            continue
        for effect in (score.effect, *variants(score.effect)):
            test(score, effect)
    if nameless:
        _, score = max(nameless, key=lambda n: n[0])
        for effect in (e for e in narrower(_simple(score.effect)) if len(e.directions) == 1):
            test(score, effect)
    return tests


def _drives(fit: Identification) -> set[str]:
    """Parameters of what the effects of a fit do to the drives."""
    return {name for effect in fit.model.added for name in effect.frees().values()}


def _released(found: Identification, fit: Identification) -> Identification:
    """A fit with one more effect than another, those parameters free again."""
    return refitted(found.model, found.named, found) if _drives(fit) else found


def name_or_noise(
    fit: Identification,
    candidates: Sequence[Score],
    names: int,
    first: Identification | None,
    forms: Forms,
    level: float,
    progress: Callable[[str], None],
) -> tuple[Identification, float] | None:
    """The most probable name (or cycle, or burst) that large coloured noise had swallowed, each with the noise found anew, where
    that noise would hardly look like it and the `first` effect found under it is less probable; with the log of that chance.
    The candidates are the best of so many `names`, and all cycles and bursts."""
    white = whitened(fit)
    base = evidence_of(white.problem(), white.values)
    least, given_up = 0.0, DECISIVE
    if first is not None:
        least = max(least, _odds(first, fit))
        given_up = 0.0 if newest(first).id == "unknown" else DECISIVE
    tests = []
    for score in candidates:
        progress(f"coloured noise or {score.effect.key}")
        trial = tried(white, base, score, forms)
        if trial is None:
            continue
        looks = score.looks * (len(candidates) if score.effect.id == "unknown" else 1)
        tests.append(_Test.of(shaped(white, trial), fit, names, looks, given_up))
    return _best(tests, least, level)


@dataclass(frozen=True)
class _Test:
    """A fit with an effect against one with coloured noise in its place: its log `odds`, and the log `chance` that such noise
    gives as much."""

    found: Identification
    odds: float
    chance: float

    @classmethod
    def of(
        cls, found: Identification, fit: Identification, names: int, looks: int, given_up: float, share: float = 0.0
    ) -> _Test:
        """`looks` at places for an effect that is one of so many `names`, `share` the log probability of such noise beforehand.

        The chance of a name is that of its likelihood ratio. A term without one can follow any noise: there the odds have to do
        (by Markov's inequality noise gives odds above K at a rate below 1/K), and must pay for the name that is `given_up`.
        """
        effect = newest(found)
        odds = _odds(found, fit) - share
        if effect.id == "unknown":
            odds -= given_up + float(np.log(looks))
            return cls(found, odds, -odds)
        campaign = fit.model.campaign
        ratio, dof = likelihood_ratio(found, fit, effect)
        chance = log_tail(max(ratio, 0.0), dof) + float(np.log(names * looks * shapes(effect, campaign)))
        return cls(found, odds + beforehand(campaign, effect, looks, found.named, {}), chance)


def _simple(effect: Effect) -> Effect:
    """A cycle with its first harmonic alone, more than which slow noise hardly lets see; any other effect as it is."""
    return replace(effect, order=1) if isinstance(effect, Unknown) and effect.period else effect


def _odds(found: Identification, fit: Identification) -> float:
    """Log evidence of a fit with an effect over one without, each under its own noise. How large an effect is says nothing for
    or against a name; for a term without one the odds alone have to do, so it keeps a prior: a cycle, which leaves the noise
    less freedom than a drift, one of several widths."""
    effect = newest(found)
    campaign = found.model.campaign
    if effect.id != "unknown":
        return evidence_with_noise(found, fit, amplitudes(campaign, effect))
    own = [name for group in amplitudes(campaign, effect) for name in group]
    widths = WIDTHS if isinstance(effect, Unknown) and effect.period else (1.0,)
    return evidence_with_noise(found, fit, spreads=[dict.fromkeys(own, width) for width in widths])


def _best(tests: Sequence[_Test], least: float, level: float) -> tuple[Identification, float] | None:
    """The most probable of those that noise hardly gives, if its log odds exceed the `least`; with the log of that chance."""
    passed = [t for t in tests if t.odds > least and t.chance < np.log(level)]
    best = max(passed, key=lambda t: t.odds, default=None)
    return (best.found, best.chance) if best else None
