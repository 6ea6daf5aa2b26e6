"""Evidence of a fit with or without an effect, by which names are weighed against each other (D. J. C. MacKay 1992)."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from symfive.diagnose._remainder import remainder
from symfive.inference import Problem
from symfive.model import Model

__all__ = ["Groups", "evidence_of", "marginal"]

Array = NDArray[np.float64]
SCALINGS = 4
Groups = Sequence[Sequence[str]]


def evidence_of(problem: Problem, values: Array, sized: Groups = ()) -> float:
    """Log marginal likelihood, up to what does not depend on the model, of a fit that may or may not need the rest of
    its effects' own families: the mean of both.

    Where the library's form is right the plain fit decides; where it is a little off, what counts is whether the family
    explains the readings, and a form that needs less of the rest is better. Each group of `sized` amplitudes has a prior
    as wide as they turned out: how large an effect is says nothing for or against its name, and exact aliases get equal
    evidence.
    """
    plain = marginal(problem, problem.model, values, sized)
    shapes = remainder(problem.model, values, problem.model.effects)
    if not shapes:
        return plain - float(np.log(2.0))
    wide = Model(problem.model.campaign, [*problem.model.added, *shapes])
    return float(np.logaddexp(plain, marginal(problem, wide, values, sized)) - np.log(2.0))


def marginal(problem: Problem, wide: Model, values: Array, sized: Groups = ()) -> float:
    """-½ cost - ½ log det(1 + H σ²): Laplace's approximation, linear in what `wide` adds to the problem's model.

    Noise that was found while something lacked is too large. Its scale κ ≤ 1 is fitted too (not below what is declared):
    a model is judged by how far down it brings the residual, and not against the noise of a poorer one.
    """
    full = wide.vector({p.name: float(v) for p, v in zip(problem.model.parameters, values, strict=True)})
    inner = Problem.of(wide, noises=problem.noises)
    inner.left_out = problem.left_out
    information = inner.information(inner.blocks(full))
    sigma = wide.prior_sigma.copy()
    for group in sized:
        own = [wide.index[name] for name in group]
        sigma[own] *= max(float(np.sqrt(np.mean((full[own] / sigma[own]) ** 2))), 1e-3)
    departure = (full - wide.prior_mean) / sigma
    h, g = information.matrix * np.outer(sigma, sigma), information.gradient * sigma
    least = min(1.0, max((n.declared / n.white) ** 2 for n in problem.noises.values()))
    scale = 1.0
    for _ in range(SCALINGS):
        curvature = h / scale + np.eye(len(sigma))
        pull = g / scale - departure
        step = np.linalg.solve(curvature, pull)
        left = information.square - 2.0 * float(g @ step) + float(step @ h @ step)
        cost = information.square / scale + float(departure @ departure) - float(pull @ step)
        evidence = -0.5 * (cost + information.count * np.log(scale) + float(np.linalg.slogdet(curvature)[1]))
        scale = float(np.clip(left / max(information.count, 1), least, 1.0))
    return float(evidence)
