"""Exact refits with one more effect: what each is worth, in which of its shapes, with how wide a prior."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from symfive.campaign import Campaign
from symfive.diagnose._evidence import Groups, evidence_of, evidence_without, marginal, weighed
from symfive.diagnose._places import axis_of
from symfive.diagnose._remainder import remainder
from symfive.diagnose._scores import Score
from symfive.diagnose._variants import carried, narrower, shapes, variants
from symfive.effects import Effect
from symfive.errors import EvaluationError, InputError
from symfive.identify import Identification, identify
from symfive.inference import Problem, gauss_newton
from symfive.model import Model

__all__ = [
    "DECISIVE", "Forms", "Together", "Trial", "amplitudes", "beforehand", "best_shape", "lacking", "newest", "refitted",
    "settled", "shaped", "start_of", "tried", "tried_together", "widened", "with_families",
]  # fmt: skip

Array = NDArray[np.float64]
Forms = Mapping[tuple[str, str | None], int]
"""How many forms (components) a name could take."""
DECISIVE = 5.0
"""Log evidence from which one says decisive (H. Jeffreys 1961, appendix B: a factor of more than 100)."""
TRIAL_STEPS = 12
"""A refit that has not settled by then is weighed as it stands."""
WIDENINGS = 3
START_SCALES = (0.3, 1.0, 3.0)
START_STEPS = 3


@dataclass(frozen=True)
class Trial:
    """An exact refit with one more effect: its log evidence against the fit without it, under the same noise, its `size`, the
    mean square of its readings about their mean over that of the declared noise, and the `misfit` that is left: χ² of the
    readings and of all priors but the effect's own. `prior` is the part of the evidence that stands before the readings."""

    effect: Effect
    evidence: float
    values: Mapping[str, float]
    size: float
    looks: int = 1
    misfit: float = np.inf
    prior: float = 0.0


def tried(
    result: Identification, base: float, score: Score, forms: Forms, near: Mapping[str, float] | None = None
) -> Trial | None:
    """An exact refit with the effect, under the noise of the present fit, whose log evidence is `base`; begun `near` values that
    are known, else at the present fit and the score's step.

    All names are equally probable beforehand; a name that could take several forms (components), or richer shapes than its plain
    one, shares that among them. The prior of an effect that is larger than usual is as wide as the effect: none is pulled back
    more than its rivals.
    """
    campaign = result.model.campaign
    effect = score.effect
    named = dict(near or result.named)
    try:
        for widening in range(1 + WIDENINGS):
            model = Model(campaign, (*result.model.added, effect))
            problem = result.problem(model)
            start = named if widening or near else named | start_of(model, score)
            values, _ = gauss_newton(problem, model.vector(start), 1e-2, TRIAL_STEPS)
            named = model.named(values)
            wider = _roomy(campaign, effect, named)
            if wider.spread == effect.spread:
                break
            effect = wider
        evidence, left = weighed(problem, values, amplitudes(campaign, effect))
        evidence -= base
        size = _size(result, problem.model, effect, values)
    except (EvaluationError, np.linalg.LinAlgError):
        return None
    if not np.isfinite(evidence):
        return None
    prior = beforehand(campaign, effect, score.looks, named, forms)
    return Trial(effect, evidence + prior, named, size, score.looks, left + _pull(problem, effect, values), prior)


@dataclass(frozen=True)
class Together:
    """An exact refit with several effects more: their `scores`, the log evidence of all, the values."""

    scores: tuple[Score, ...]
    evidence: float
    values: Mapping[str, float]

    @property
    def effects(self) -> tuple[Effect, ...]:
        return tuple(score.effect for score in self.scores)


def tried_together(result: Identification, base: float, scores: Mapping[str, Score], forms: Forms) -> Together | None:
    """An exact refit with one kind of effect on several axes, as `tried` makes it with one; None where there is but one axis."""
    campaign = result.model.campaign
    effects = tuple(score.effect for score in scores.values())
    if len(effects) < 2:
        return None
    try:
        model = Model(campaign, (*result.model.added, *effects))
        problem, start = result.problem(model), result.named
        for score in scores.values():
            start = start | start_of(model, score)
        values, _ = gauss_newton(problem, model.vector(start), 1e-2, TRIAL_STEPS)
        named = model.named(values)
        evidence = evidence_of(problem, values, [group for e in effects for group in amplitudes(campaign, e)]) - base
    except (EvaluationError, np.linalg.LinAlgError):
        return None
    evidence += sum(beforehand(campaign, s.effect, s.looks, named, forms) for s in scores.values())
    return Together(tuple(scores.values()), evidence, named) if np.isfinite(evidence) else None


def beforehand(campaign: Campaign, effect: Effect, looks: int, values: Mapping[str, float], forms: Forms) -> float:
    """Log probability of an effect in its form and shape before the readings, up to what all names share."""
    if effect.id == "unknown":
        return -DECISIVE - float(np.log(looks))  # a name is given up only for decisive evidence
    ways = max(forms.get((effect.vocabulary, axis_of(effect)), 1), 1) * shapes(effect, campaign)
    likelier = [p.likelier(values[p.name]) for p in effect.parameters(campaign)]
    chance = 2.0 * effect.chance(campaign, values) / (ways * effect.places(campaign, looks))
    return float(np.log(chance) + np.sum(np.log(likelier)))


def _pull(problem: Problem, effect: Effect, values: Array) -> float:
    """χ² of all priors but the effect's own."""
    own = {p.name for p in effect.parameters(problem.model.campaign)}
    others = np.array([p.name not in own for p in problem.model.parameters])
    departure = np.where(others, values - problem.model.prior_mean, 0.0)
    return float(departure**2 @ problem.prior_precision)


def start_of(model: Model, score: Score) -> dict[str, float]:
    """Where the refit begins: the score's own step from the prior mean; where that leads beyond a bound, half way to it."""
    start = {}
    for name, step in score.step.items():
        if name not in model.index:  # the effect in a narrower shape
            continue
        p = model.parameters[model.index[name]]
        value = p.mean + step
        if p.start is not None and p.start != p.mean and step == 0.0:
            value = p.start
        bound = p.lower if value < p.lower else p.upper
        start[name] = float(value if p.lower <= value <= p.upper else 0.5 * (p.mean + bound))
    return start


def _size(result: Identification, model: Model, effect: Effect, values: Array) -> float:
    """Mean square of an effect's readings about their mean in each run, in units of the declared noise."""
    total = count = 0.0
    contribution = model.contribution(effect, values)
    for run in filter(effect.applies, model.campaign.runs):
        moved = (
            contribution[run.id] / np.array([n.declared for (r, _), n in result.noises.items() if r == run.id]).mean()
        )
        total += float(np.sum((moved - moved.mean(axis=0)) ** 2))
        count += moved.size
    return total / max(count, 1.0)


def amplitudes(campaign: Campaign, effect: Effect) -> Groups:
    """An effect's amplitudes, together; those of a term without a name by direction or column."""
    groups: dict[str, list[str]] = {}
    for p in effect.amplitudes(campaign):
        channel = p.name.removeprefix(effect.key + ".").split(".")[0] if effect.id == "unknown" else ""
        groups.setdefault(channel, []).append(p.name)
    return list(groups.values())


def best_shape(without: Identification, base: float, trial: Trial, forms: Forms) -> Trial:
    """A rival in the best of its shapes: the member that it rivals stands in its own."""
    campaign = without.model.campaign
    trials = [trial]
    for other in variants(trial.effect):
        try:
            prepared = other.prepare(campaign)
        except InputError:
            continue
        known = carried(trial.effect, prepared, campaign, trial.values)
        step = {p.name: known.get(p.name, p.mean) - p.mean for p in prepared.parameters(campaign)}
        found = tried(without, base, Score.unscored(prepared, step, trial.looks), forms)
        trials += [found] if found is not None else []
    return max(trials, key=lambda t: t.evidence)


def shaped(result: Identification, trial: Trial) -> Identification:
    """Full fit with the effect in the best of its own shapes, noise found anew.

    The plain shape keeps its place unless another one's evidence is better under the same noise.
    """
    campaign = result.model.campaign
    effect = _roomy(campaign, trial.effect, trial.values)
    plain = _narrowed(refitted(Model(campaign, (*result.model.added, effect)), trial.values, result))
    best = _reshaped(result, plain)
    if newest(best) != newest(plain):
        # from there the others may come to another end, and all its harmonics are open again
        best = _reshaped(result, best)
    return widened(best)


def _reshaped(result: Identification, plain: Identification) -> Identification:
    """The fit with its newest effect in the best of its other shapes, if that is decisively better."""
    campaign = result.model.campaign
    effect, named = newest(plain), plain.named
    best, best_evidence = plain, evidence_of(plain.problem(), plain.values)
    others = {n: named[n] for n in result.model.index}
    for other in variants(effect):
        try:
            prepared = other.prepare(campaign)
            model = Model(campaign, (*result.model.added, prepared))
            problem = plain.problem(model)
            start = _best_start(problem, prepared, others | carried(effect, prepared, campaign, named))
            values, _ = gauss_newton(problem, model.vector(start), 1e-2, TRIAL_STEPS)
            evidence = evidence_of(problem, values)
        except (InputError, np.linalg.LinAlgError):
            continue
        simpler = len(prepared.parameters(campaign)) < len(effect.parameters(campaign))
        if evidence > best_evidence + (0.0 if simpler else DECISIVE):
            best, best_evidence = refitted(model, model.named(values), plain), evidence
    return best


def _narrowed(result: Identification) -> Identification:
    """The fit with its newest effect, if that has no name, in those directions only that have the greatest evidence."""
    last = newest(result)
    shapes: list[Effect] = [last, *narrower(last)]
    if len(shapes) == 1:
        return result
    campaign = result.model.campaign
    own = [{p.name for p in shape.parameters(campaign)} for shape in shapes]
    evidence = evidence_without(result.problem(), result.values, [own[0] - names for names in own])
    best = shapes[int(np.argmax(evidence))]
    if best is last:
        return result
    start = result.named
    model = Model(campaign, [best if e.key == last.key else e for e in result.model.added])
    return refitted(model, {n: v for n, v in start.items() if n in model.index}, result)


def _best_start(problem: Problem, effect: Effect, start: Mapping[str, float]) -> Mapping[str, float]:
    """From which of several short times the fit goes down fastest: far from the right one a spike has no slope towards it."""
    model = problem.model
    times = [p for p in effect.parameters(model.campaign) if p.unit == "ms" and p.mean > 0.0 and p.name not in start]
    if not times:
        return start
    found = []
    for scale in START_SCALES:
        near = {**start, **{p.name: max(scale * p.mean, p.lower) for p in times}}
        values, _ = gauss_newton(problem, model.vector(near), 1e-2, START_STEPS)
        square = problem.information(problem.blocks(values)).square
        found.append((square, model.named(values)))
    return min(found, key=lambda f: f[0])[1]


def widened(result: Identification, held: Collection[str] = ()) -> Identification:
    """The fit with the newest effect's prior no narrower than what came out: an effect far larger than usual is not pulled
    back, and nothing else has to make up for it. `held` as in `refitted`."""
    for _ in range(WIDENINGS):
        last = newest(result)
        start = result.named
        wider = _roomy(result.model.campaign, last, start)
        if wider.spread == last.spread:
            return result
        model = Model(result.model.campaign, [wider if e.key == last.key else e for e in result.model.added])
        result = refitted(model, start, result, held)
    return result


def _roomy(campaign: Campaign, effect: Effect, values: Mapping[str, float]) -> Effect:
    """An effect whose prior is twice as wide as its values where they exceed it."""
    most = effect.in_sigmas(campaign, values)
    return effect if most <= 1.0 or effect.id == "unknown" else replace(effect, spread=2.0 * most * effect.spread)


def with_families(result: Identification) -> Identification:
    """The fit with the rest of each effect's family in the model, where the evidence for it is decisive.

    Family right, shape different: the rest is a part of the finding, not a second one. It comes last, when no effect
    with a name of its own explains more.
    """
    campaign = result.model.campaign
    for shape in remainder(result.model, result.values, result.model.added):
        wide = Model(campaign, (*result.model.added, shape))
        problem = result.problem()
        if marginal(problem, wide, result.values) > marginal(problem, problem.model, result.values) + DECISIVE:
            start = result.named
            result = refitted(wide, start, result)
    return result


def lacking(result: Identification, *effects: Effect) -> Identification:
    """The fit without some effects and the rest of their families, under the same noise and outliers."""
    campaign, dropped = result.model.campaign, {effect.key for effect in effects}
    kept = tuple(e for e in result.model.added if not dropped & {e.key, getattr(e, "of", "")})
    model = Model(campaign, kept)
    start = {n: v for n, v in result.named.items() if n in model.index}
    values, _ = gauss_newton(result.problem(model), model.vector(start), 1e-2)
    residuals = {run.id: model.readings(run) - model.predict_run(run, values) for run in campaign.runs}
    return replace(result, model=model, values=values, residuals=residuals)


def newest(result: Identification) -> Effect:
    return [e for e in result.model.effects if e.id != "family_shape"][-1]


def refitted(
    model: Model, start: Mapping[str, float], like: Identification, held: Collection[str] = ()
) -> Identification:
    """The full fit, noise found anew from where it was; some parameters `held` where they start. As it stands where it does not
    settle: with friction at a bound, IPOPT would take minutes for each."""
    fixed = {name: start[name] for name in held if name in start}
    return identify(model, start=start, fixed=fixed, start_noise=like.noises, noise="repeats", refine=False)


def settled(result: Identification) -> Identification:
    """The fit that the search ends with, brought to its end by whatever means where it has not settled."""
    if result.converged:
        return result
    return identify(result.model, start=result.named, start_noise=result.noises, noise="repeats")
