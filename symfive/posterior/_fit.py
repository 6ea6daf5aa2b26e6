"""Exact fits of subsets: under the noise of a node, isolated outliers left out, from where the linear solution leads."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from symfive.arrays import Array
from symfive.campaign import Campaign
from symfive.effects import Effect, Form
from symfive.identify import Identification, summarise
from symfive.inference import Problem, gauss_newton
from symfive.model import Model
from symfive.posterior._evidence import LogEvidence, log_evidence, solution
from symfive.posterior._explore import Subset
from symfive.posterior._moments import Moments
from symfive.posterior._noise import Node
from symfive.threads import one_thread

__all__ = [
    "SEARCHED", "WHITE", "Expansion", "baseline", "expansion", "fitted", "linear_estimate", "over_all", "refitted", "settled",
]  # fmt: skip

TOLERANCE, SEARCHED = 1e-2, 0.1
"""Share of its posterior 1σ by which no parameter moves any more; of fits that are only compared, whose log evidence a tenth
changes by half its square."""
WHITE = Node(0.0, 0.0, 0.0)
"""The noise that is declared."""


@dataclass(frozen=True)
class Expansion:
    """A fit, the forms of the effects that it holds beyond the machine file's, in its order, and the noise it was made under;
    `discrepancies`: unidentified forms beside them, each what a law among them is off by over its own coordinate; `others`: its
    fits in which one effect has another shape, and how probable this is."""

    fit: Identification
    held: tuple[Form, ...]
    node: Node
    kappa2: float
    discrepancies: tuple[Form, ...] = ()
    others: tuple[tuple[float, Identification], ...] = ()
    noises: tuple[Node, ...] = ()

    def discrepancies_of(self, keys: Collection[str]) -> tuple[Form, ...]:
        """What the effects of these keys are off by."""
        laws = {form.effect.answers for form in self.held if form.effect.key in keys}
        return tuple(form for form in self.discrepancies if (form.channel, form.effect.coordinate) in laws)

    def without(self, keys: Collection[str]) -> Expansion:
        """The fit without the forms of these keys, noise and excluded outliers unchanged; with the last law that it belongs to, a
        discrepancy leaves too."""
        held = [form for form in self.held if form.effect.key not in keys]
        of_laws = self.discrepancies_of([form.effect.key for form in held])
        beside = [form for form in of_laws if form.effect.key not in keys]
        return _identified(self, self.fit.model.campaign, held, beside, self.fit)

    @property
    def keys(self) -> frozenset[tuple[str, str]]:
        """(key, coordinate) of each effect that it holds."""
        return frozenset((form.effect.key, form.effect.coordinate) for form in self.held)


def sigmas_from_nothing(fit: Identification, effect: Effect) -> float:
    """By how many σ all amplitudes of an effect together differ from those at which it does nothing: √(dᵀ C⁻¹ d), C their
    covariance in the fit (A. Wald 1943)."""
    own = [fit.model.index[p.name] for p in effect.amplitudes(fit.model.campaign)]
    sigma = fit.model.prior_sigma[own]
    away, spread = (fit.values - fit.model.prior_mean)[own] / sigma, fit.covariance[np.ix_(own, own)]
    return float(np.sqrt(away @ np.linalg.lstsq(spread / np.outer(sigma, sigma), away, rcond=None)[0]))


def baseline(campaign: Campaign) -> Identification:
    """The fit of the baseline model, with white noise of the declared size."""
    return fitted(Model(campaign), [{}], WHITE, 1.0)


@one_thread
def fitted(
    model: Model, starts: Sequence[Mapping[str, float]], node: Node, kappa2: float, like: Identification | None = None,
    tolerance: float = TOLERANCE,
) -> Identification:  # fmt: skip
    """The fit from the best of some starts. Isolated outliers are excluded; of a fit that is compared with another one `like`
    it, the same."""
    problem = like.problem(model) if like is not None else Problem.of(model)
    for key, noise in problem.noises.items():
        problem.noises[key] = replace(node.noise(noise.declared * kappa2**0.5), declared=noise.declared)
    vectors = [model.vector({n: v for n, v in start.items() if n in model.index}) for start in starts]
    with np.errstate(all="ignore"):  # a trial may make a drive unstable
        squares = [problem.information_at(v).square for v in vectors] if len(vectors) > 1 else [0.0]
        values = vectors[int(np.argmin(np.nan_to_num(squares, nan=np.inf)))]
        if like is None:
            problem.weigh(values)
        values, converged = gauss_newton(problem, values, tolerance)
        if like is None and problem.flag_outliers(problem.survey(values), values):
            values, converged = gauss_newton(problem, values, tolerance)
        fit = summarise(problem, values, converged)
    return fit if like is None else replace(fit, outliers=like.outliers)


def refitted(moments: Moments, subset: Subset) -> Expansion:
    """The exact fit of a subset under the noise that fits it best, its amplitudes' priors as wide as the subset says."""
    evidence = log_evidence(moments, subset)
    forms = [replace(moments.terms[t].form, effect=effect) for t, effect in _effects(moments, subset).items()]
    still = dict(moments.fit.named)
    effects, moved = linear_estimate(moments, subset, evidence)
    at = {name: value for t, _ in subset for name, value in moments.terms[t].form.at.items()}
    starts = [moved, still, {**moved, **at}] if any(moments.terms[t].frees for t, _ in subset) else [moved]
    model, node = Model(moments.fit.model.campaign, effects), moments.nodes[evidence.node]
    fit = fitted(model, starts, node, evidence.kappa2, moments.fit, SEARCHED)
    return expansion(fit, forms, node, evidence.kappa2)


def linear_estimate(moments: Moments, subset: Subset, evidence: LogEvidence) -> tuple[list[Effect], dict[str, float]]:
    """The effects of a subset, and all parameters by name where the moments put those that join."""
    values = dict(moments.fit.named)
    for (t, _), part in zip(subset, solution(moments, subset, evidence), strict=True):
        if moments.terms[t].needs:
            own = moments.terms[t].effect.parameters(moments.fit.model.campaign)[-len(part) :]
            values |= {p.name: float(x) for p, x in zip(own, part, strict=True)}
        elif t >= moments.held and moments.terms[t].form.basis is None:
            values |= _stepped(moments, t, part)
    return list(_effects(moments, subset).values()), values


def _effects(moments: Moments, subset: Subset) -> dict[int, Effect]:
    """The effects of a subset by the number of their term; one that varies stands for the one of which it is a variation."""
    width = {moments.terms[t].effect.key: w for t, w in subset if not moments.terms[t].needs}
    varied = {moments.terms[t].needs for t, _ in subset}
    found = {
        t: moments.terms[t] for t, _ in subset if moments.terms[t].needs or moments.terms[t].effect.key not in varied
    }
    return {t: replace(term.effect, spread=width[term.effect.key]) for t, term in found.items()}


def settled(here: Expansion, discrepancies: Sequence[Form] = ()) -> Expansion:
    """The same, `discrepancies` beside it, with the outliers that it leaves by itself."""
    if discrepancies:
        return _identified(here, here.fit.model.campaign, here.held, discrepancies)
    return replace(here, fit=fitted(here.fit.model, [here.fit.named], here.node, here.kappa2))


def over_all(here: Expansion, campaign: Campaign) -> Expansion:
    """The same effects identified from a campaign of which the fit's is some rows, under the same noise."""
    return _identified(here, campaign, here.held, here.discrepancies)


def _identified(
    here: Expansion,
    campaign: Campaign,
    held: Sequence[Form],
    discrepancies: Sequence[Form],
    like: Identification | None = None,
) -> Expansion:
    """Some forms identified from a campaign, from where another fit is, under its noise."""
    model = Model(campaign, [form.effect for form in (*held, *discrepancies)])
    fit = fitted(model, [here.fit.named], here.node, here.kappa2, like)
    return expansion(fit, held, here.node, here.kappa2, discrepancies)


def expansion(
    fit: Identification, held: Sequence[Form], node: Node, kappa2: float, discrepancies: Sequence[Form] = ()
) -> Expansion:
    """A fit with the forms of its effects, in its order."""

    def of_model(forms: Sequence[Form]) -> tuple[Form, ...]:
        by_key = {form.effect.key: form for form in forms}
        return tuple(replace(by_key[e.key], effect=e) for e in fit.model.added if e.key in by_key)

    return Expansion(fit, of_model(held), node, kappa2, of_model(discrepancies))


def _stepped(moments: Moments, term: int, step: Array) -> dict[str, float]:
    """Parameters of a fresh term where the linear solution puts them, within their bounds."""
    effect, columns = moments.terms[term].effect, moments.columns[term]
    parameters = replace(effect, spread=1.0).parameters(moments.fit.model.campaign)
    at, found, own = (
        moments.terms[term].form.at,
        {},
        len(parameters),
    )  # the states in which it begins stay where they are
    for p, x, size in zip(parameters, step[:own], columns.amplitude[:own], strict=True):
        value = p.mean + p.sigma * x if size else at.get(p.name, p.initial)
        if p.start is not None and p.lower > -np.inf:
            value = max(value, p.start)  # at its bound it would have no slope
        found[p.name] = float(np.clip(value, p.lower, p.upper))
    return found
