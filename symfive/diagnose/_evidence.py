"""Evidence of a fit with or without an effect, by which names are weighed against each other (D. J. C. MacKay 1992)."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache
from types import MappingProxyType

import numpy as np
from numpy.typing import NDArray
from scipy.stats import chi2

from symfive.diagnose._remainder import remainder
from symfive.effects import Effect
from symfive.identify import Identification
from symfive.inference import Information, Problem, whiten
from symfive.model import Model

__all__ = [
    "Groups", "evidence_of", "evidence_with_noise", "evidence_without", "likelihood_ratio", "marginal", "weighed",
]  # fmt: skip

Array = NDArray[np.float64]
SCALINGS = 4
UNLIKELY = 1e-3
"""Chance that the rest of an effect's family, all its coefficients together, lies beyond what its prior lets it."""
TIGHTENINGS = 30
Groups = Sequence[Sequence[str]]


def evidence_of(problem: Problem, values: Array, sized: Groups = ()) -> float:
    """The log evidence alone of `weighed`."""
    return weighed(problem, values, sized)[0]


def weighed(problem: Problem, values: Array, sized: Groups = ()) -> tuple[float, float]:
    """Log evidence of a fit and χ² of its readings.

    The evidence is the log marginal likelihood, up to what does not depend on the model, of a fit that may or may not need
    the rest of its effects' own families: the mean of both, and of the plain fit alone where its effects have no family.

    Where the library's form is right the plain fit decides; where it is a little off, what counts is whether the family
    explains the readings, and a form that needs less of the rest is better. Each group of `sized` amplitudes has a prior
    as wide as they turned out: how large an effect is says nothing for or against its name, and exact aliases get equal
    evidence.
    """
    shapes = remainder(problem.model, values, problem.model.effects)
    wide = Model(problem.model.campaign, [*problem.model.added, *shapes]) if shapes else problem.model
    both = _Linear.of(problem, wide, values)
    evidence = both.evidence(sized, [p.name for p in problem.model.parameters])
    if shapes:
        rests = [[p.name for p in shape.parameters(wide.campaign)] for shape in shapes]
        evidence = float(np.logaddexp(evidence, both.evidence(sized, bounded=rests)) - np.log(2.0))
    return evidence, both.information.square


def marginal(problem: Problem, wide: Model, values: Array) -> float:
    """Log evidence of the problem's model with what `wide` adds to it, linear in that."""
    return _Linear.of(problem, wide, values).evidence()


def evidence_without(problem: Problem, values: Array, dropped: Sequence[Collection[str]]) -> list[float]:
    """Log evidence of the problem's model without some of its linear parameters, one set of names after the other; each such
    parameter counts as its prior's mean."""
    names = [p.name for p in problem.model.parameters]
    whole = _Linear.of(problem, problem.model, values)
    return [whole.at_mean(gone).evidence(names=[n for n in names if n not in gone]) for gone in dropped]


def evidence_with_noise(
    result: Identification,
    without: Identification,
    sized: Groups = (),
    spreads: Sequence[Mapping[str, float]] = (MappingProxyType({}),),
) -> float:
    """Log marginal likelihood of a fit under its own noise over that of another fit under its own, both over the readings
    that neither takes for outliers: what the one calls an effect, the other may call slow noise.

    `sized` as in `weighed`. Each of `spreads` says of some parameters of the first fit how many times as wide their priors are;
    all of them are equally probable.
    """
    more, less = _under_their_noise(result, without)
    each = [more.evidence(sized, spread) for spread in spreads]
    return float(np.logaddexp.reduce(each) - np.log(len(each))) - less.evidence()


def likelihood_ratio(result: Identification, without: Identification, effect: Effect) -> tuple[float, int]:
    """2 log of the same ratio where the effect's own parameters are at their best, not weighed by their prior; and their number.

    All that the fits share is integrated out, as in a restricted likelihood (H. D. Patterson & R. Thompson 1971): else slow
    noise, which leaves a set-up less well known, would look worse than it is. Where noise is all there is, the ratio is χ²
    distributed (S. S. Wilks 1938).
    """
    own = frozenset(p.name for p in effect.parameters(result.model.campaign))
    more, less = _under_their_noise(result, without)
    return 2.0 * (more.evidence(best=own) - less.evidence()), len(own)


def _under_their_noise(first: Identification, second: Identification) -> tuple[_UnderNoise, _UnderNoise]:
    """Two fits, each under its own noise, over readings that neither takes for outliers."""
    problems = [first.problem(), second.problem()]
    left_out = {run: mask | problems[1].left_out[run] for run, mask in problems[0].left_out.items()}
    for problem in problems:
        problem.left_out = left_out
    return _UnderNoise.of(problems[0], first.values), _UnderNoise.of(problems[1], second.values)


@dataclass(frozen=True)
class _UnderNoise:
    """A fit under its own noise, linear about its values: its data's information, and the log of the noise's own scale."""

    model: Model
    information: Information
    values: Array
    log_scale: float

    @classmethod
    def of(cls, problem: Problem, values: Array) -> _UnderNoise:
        blocks = problem.blocks(values)
        log_scale = 0.0
        for key, block in blocks.items():
            _, one = whiten(np.zeros((len(block.residual), 1)), problem.noises[key], block.interval)
            log_scale += one * block.residual.shape[1]
        return cls(problem.model, problem.information(blocks), values, log_scale)

    def evidence(
        self,
        sized: Groups = (),
        spread: Mapping[str, float] = MappingProxyType({}),
        best: frozenset[str] = frozenset(),
    ) -> float:
        """Log marginal likelihood; parameters among the `best` are not integrated out. The priors of the groups in `sized` are as
        wide as these are in the fit, those of parameters in `spread` so many times as wide as else."""
        names = [p.name for p in self.model.parameters]
        rest = np.array([name not in best for name in names])
        spreads = np.array([spread.get(name, 1.0) for name in names])
        precision = (spreads * _widths(self.model, self.values, sized))[rest] ** -2.0
        departure = (self.values - self.model.prior_mean)[rest]
        pull = self.information.gradient[rest] - precision * departure
        curvature = self.information.matrix[np.ix_(rest, rest)] + np.diag(precision)
        square = self.information.square + float(departure**2 @ precision)
        cost = square - float(pull @ np.linalg.solve(curvature, pull))
        volume = float(np.linalg.slogdet(curvature)[1]) - float(np.sum(np.log(precision)))
        return -0.5 * (cost + volume + self.log_scale)


@dataclass(frozen=True)
class _Linear:
    """A problem about a fit, linear: its data's information and the values, in the parameters of `model`; `least` the
    square of the smallest scale of the noise."""

    model: Model
    information: Information
    values: Array
    least: float

    @classmethod
    def of(cls, problem: Problem, wide: Model, values: Array) -> _Linear:
        full = wide.vector(problem.model.named(values))
        inner = Problem.of(wide, noises=problem.noises)
        inner.left_out = problem.left_out
        least = min(1.0, max((n.declared / n.white) ** 2 for n in problem.noises.values()))
        return cls(wide, inner.information(inner.blocks(full)), full, least)

    def at_mean(self, names: Collection[str]) -> _Linear:
        """The same about the values with these parameters at the mean of their priors."""
        step = np.zeros(len(self.values))
        for i in (self.model.index[name] for name in names):
            step[i] = self.model.prior_mean[i] - self.values[i]
        given = self.information
        pull = given.matrix @ step
        moved = replace(
            given,
            gradient=given.gradient - pull,
            square=given.square - 2.0 * float(given.gradient @ step) + float(step @ pull),
        )
        return replace(self, information=moved, values=self.values + step)

    def evidence(self, sized: Groups = (), names: Sequence[str] = (), bounded: Groups = ()) -> float:
        """-½ cost - ½ log det(1 + H σ²): Laplace's approximation, of all parameters or of the model of those in `names` alone;
        each group in `bounded` as near to its prior as its prior makes likely.

        Noise that was found while something lacked is too large. Its scale κ ≤ 1 is fitted too (not below what is declared):
        a model is judged by how far down it brings the residual, and not against the noise of a poorer one.
        """
        model, information = self.model, self.information
        sigma = _widths(model, self.values, sized)
        kept = np.array([model.index[name] for name in names or model.index], dtype=np.int64)
        sigma = sigma[kept]
        departure = (self.values - model.prior_mean)[kept] / sigma
        h, g = information.matrix[np.ix_(kept, kept)] * np.outer(sigma, sigma), information.gradient[kept] * sigma
        groups = [[model.index[name] for name in group] for group in bounded]
        scale, tight = 1.0, np.ones(len(sigma))
        for _ in range(SCALINGS):
            step, tight = _step(h / scale, g / scale, departure, groups, tight)
            left = information.square - 2.0 * float(g @ step) + float(step @ h @ step)
            away = departure + step
            volume = float(np.linalg.slogdet(h / scale + np.diag(tight))[1])
            evidence = -0.5 * (left / scale + float(away @ away) + information.count * np.log(scale) + volume)
            scale = float(np.clip(left / max(information.count, 1), self.least, 1.0))
        return float(evidence)


def _step(h: Array, g: Array, departure: Array, groups: Sequence[Sequence[int]], tight: Array) -> tuple[Array, Array]:
    """The step to the least cost, in units of the priors' 1σ; and how many times as tight as its own the prior of each parameter
    must be for every group to end within what it makes likely."""
    tight = tight.copy()
    for _ in range(TIGHTENINGS):
        step = np.linalg.solve(h + np.diag(tight), g - tight * departure)
        settled = True
        for own in groups:
            tighter = np.maximum(tight[own] * float(np.sum((departure + step)[own] ** 2)) / _most(len(own)), 1.0)
            settled &= bool(np.all(np.abs(tighter - tight[own]) < 0.01 * tight[own]))
            tight[own] = tighter
        if settled:
            break
    return np.asarray(step, dtype=np.float64), tight


@cache
def _most(count: int) -> float:
    """χ² that so many coefficients together exceed with the chance `UNLIKELY`."""
    return float(chi2.isf(UNLIKELY, count))


def _widths(model: Model, values: Array, sized: Groups) -> Array:
    """The priors' 1σ, of each group in `sized` as wide as its values are."""
    sigma = model.prior_sigma.copy()
    for group in sized:
        own = [model.index[name] for name in group]
        away = (values - model.prior_mean)[own] / sigma[own]
        sigma[own] *= max(float(np.sqrt(np.mean(away**2))), 1e-3)
    return sigma
