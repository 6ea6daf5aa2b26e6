"""What was taken for noise: slow noise weighed against effects over time, large coloured noise against names."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from symfive.diagnose._evidence import evidence_of, evidence_with_noise
from symfive.diagnose._places import coordinate_of
from symfive.diagnose._refit import DECISIVE, Forms, newest, refitted, shaped, start_of, tried, widened
from symfive.diagnose._scores import Score
from symfive.diagnose._variants import narrower, shapes, variants
from symfive.effects import Effect
from symfive.identify import Identification
from symfive.model import Model

__all__ = ["changes_slowly", "large_noise", "name_or_noise", "physics_or_noise", "slow_noise", "whitened"]

SLOW = 0.1
"""Noise whose correlation lasts longer than this part of a run may be something that drifts."""
SLOWLY = ("thermal_drift", "spindle_growth", "bar_temperature", "setup_shift", "unknown")
"""What changes while nothing moves."""
LARGE, SMALL = 0.5, 0.15
"""Slow noise in units of the declared: few instruments have a large one, any may have a small one; less does not matter."""
DIRECTIONS = 4
"""All three, or a single one."""
SLOW_NOISE = 0.2
"""The share of instruments whose own noise is that slow and large."""


def changes_slowly(effect: Effect) -> bool:
    """Whether an effect acts over time alone."""
    return effect.id in SLOWLY and coordinate_of(effect) in ("time", "t")


def slow_noise(fit: Identification) -> float:
    """The largest part of the noise that changes as slowly as the runs last, in units of the declared noise; 0 without any.

    No score under such noise would find what drifts: the noise's own parameters have swallowed it.
    """
    lasting = {run.id: float(run.time[-1] - run.time[0]) for run in fit.model.campaign.runs}
    parts = (n.coloured / n.declared for (run, _), n in fit.noises.items() if n.time_constant > SLOW * lasting[run])
    largest = max(parts, default=0.0)
    return largest if largest > SMALL else 0.0


def large_noise(fit: Identification) -> bool:
    """Whether the fit takes more than few instruments have for coloured noise: a name may be in it."""
    return any(n.coloured > LARGE * n.declared for n in fit.noises.values())


def whitened(fit: Identification) -> Identification:
    """The fit as if its noise were white."""
    return replace(fit, noises={k: replace(n, coloured=0.0) for k, n in fit.noises.items()})


def physics_or_noise(
    fit: Identification,
    candidates: Sequence[Score],
    level: float,
    progress: Callable[[str], None],
) -> tuple[Identification, float] | None:
    """The best of effects over time, with the noise found anew, if its odds against slow noise are high enough; with their log.

    By Markov's inequality slow noise gives odds above K at a rate below 1/K, and few instruments have a large one. The best term
    without a name is tried along single directions too: an instrument's noise prefers none.
    """
    campaign, white = fit.model.campaign, whitened(fit)
    share = SLOW_NOISE if slow_noise(fit) > LARGE else 1.0
    names = max(1, sum(s.effect.id != "unknown" for s in candidates))

    def weighed_with_noise(score: Score, effect: Effect, choices: int) -> tuple[float, Identification]:
        model = Model(campaign, (*white.model.added, effect.prepare(campaign)))
        found = widened(refitted(model, white.named | start_of(model, score), white))
        choice = DECISIVE if effect.id == "unknown" else 0.0
        return evidence_with_noise(found, fit) - choice - float(np.log(choices)), found

    trials = []
    nameless: tuple[float, Score] | None = None
    for score in candidates:
        progress(f"slow noise or {score.effect.key}")
        if score.effect.id == "unknown":
            trials.append(weighed_with_noise(score, score.effect, DIRECTIONS))
            if nameless is None or trials[-1][0] > nameless[0]:
                nameless = trials[-1][0], score
            continue
        for effect in (score.effect, *variants(score.effect)):
            trials.append(weighed_with_noise(score, effect, names * shapes(effect.prepare(campaign), campaign)))
    if nameless is not None:
        single = [e for e in narrower(nameless[1].effect) if len(e.directions) == 1]
        trials += [weighed_with_noise(nameless[1], effect, DIRECTIONS) for effect in single]
    best = max(trials, key=lambda t: t[0], default=None)
    if best is None or best[0] < float(np.log(share / level)):
        return None
    return best[1], min(float(np.log(share)) - best[0], 0.0)


def name_or_noise(
    fit: Identification,
    candidates: Sequence[Score],
    first: Identification | None,
    forms: Forms,
    level: float,
    progress: Callable[[str], None],
) -> tuple[Identification, float] | None:
    """The best name (or cycle, or burst) that large coloured noise had swallowed, each with the noise found anew, if its odds
    against that noise and against the `first` effect found under it are high enough; with their log."""
    white = whitened(fit)
    base = evidence_of(white.problem(), white.values)
    least = float(np.log(1.0 / level))
    given_up = DECISIVE
    if first is not None:
        least = max(least, evidence_with_noise(first, fit))
        given_up = 0.0 if newest(first).id == "unknown" else DECISIVE
    best: tuple[float, Identification] | None = None
    for score in candidates:
        progress(f"coloured noise or {score.effect.key}")
        trial = tried(white, base, score, forms)
        if trial is None:
            continue
        found = shaped(white, trial)
        evidence = evidence_with_noise(found, fit) - float(np.log(len(candidates) * score.looks))
        evidence -= given_up if score.effect.id == "unknown" else 0.0
        if evidence > max(least, best[0] if best else 0.0):
            best = evidence, found
    return (best[1], -best[0]) if best else None
