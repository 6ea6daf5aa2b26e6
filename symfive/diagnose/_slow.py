"""What drifts and was taken for noise: slow noise weighed against effects over time."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from symfive.diagnose._evidence import evidence_with_noise
from symfive.diagnose._places import coordinate_of
from symfive.diagnose._refit import DECISIVE, refitted, start_of, widened
from symfive.diagnose._scores import Score
from symfive.diagnose._variants import narrower
from symfive.effects import Effect
from symfive.identify import Identification
from symfive.model import Model

__all__ = ["changes_slowly", "physics_or_noise", "without_slow_noise"]

SLOW = 0.1
"""Noise whose correlation lasts longer than this part of a run may be something that drifts."""
SLOWLY = ("thermal_drift", "spindle_growth", "bar_temperature", "setup_shift", "unknown")
"""What changes while nothing moves."""
SLOW_NOISE = 0.2
"""The share of instruments whose own noise is that slow and larger than half of what is declared."""


def changes_slowly(effect: Effect) -> bool:
    """Whether an effect acts over time alone."""
    return effect.id in SLOWLY and coordinate_of(effect) in ("time", "t")


def without_slow_noise(fit: Identification) -> Identification | None:
    """The fit under white noise, where its noise is larger than declared and changes as slowly as the runs last; else None.

    No score under such noise would find what drifts: the noise's own parameters have swallowed it.
    """
    lasting = {run.id: float(run.time[-1] - run.time[0]) for run in fit.model.campaign.runs}
    slow = any(
        n.coloured > 0.5 * n.declared and n.time_constant > SLOW * lasting[run] for (run, _), n in fit.noises.items()
    )
    return replace(fit, noises={k: replace(n, coloured=0.0) for k, n in fit.noises.items()}) if slow else None


def physics_or_noise(
    fit: Identification,
    white: Identification,
    candidates: Sequence[Score],
    level: float,
    progress: Callable[[str], None],
) -> tuple[Identification, float] | None:
    """The best of effects over time, with the noise found anew, if its odds against slow noise are high enough; with their log.

    By Markov's inequality slow noise gives odds above K at a rate below 1/K, and few instruments have any. A term without a name
    is tried along single directions too: an instrument's noise prefers none.
    """
    campaign = fit.model.campaign
    names = max(1, sum(s.effect.id != "unknown" for s in candidates))
    trials = []
    for score in candidates:
        progress(f"slow noise or {score.effect.key}")
        shapes = [score.effect, *(e for e in narrower(score.effect) if len(e.directions) == 1)]
        for effect in shapes:
            model = Model(campaign, (*white.model.added, effect.prepare(campaign)))
            start = {p.name: float(v) for p, v in zip(white.parameters, white.values, strict=True)}
            found = widened(refitted(model, start | start_of(model, score), white))
            share = DECISIVE + float(np.log(len(shapes))) if effect.id == "unknown" else float(np.log(names))
            trials.append((evidence_with_noise(found, fit) - share, found))
    best = max(trials, key=lambda t: t[0], default=None)
    if best is None or best[0] < float(np.log(SLOW_NOISE / level)):
        return None
    return best[1], min(float(np.log(SLOW_NOISE)) - best[0], 0.0)
