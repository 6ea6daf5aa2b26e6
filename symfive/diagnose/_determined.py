"""Does a fit determine how large an effect is? By the covariance in which the search ends."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from symfive.diagnose._scores import log_tail
from symfive.effects import Effect
from symfive.identify import Identification

__all__ = ["log_chance_of_nothing", "sigmas_from_nothing"]

Array = NDArray[np.float64]


def sigmas_from_nothing(fit: Identification, effect: Effect) -> float:
    """By how many σ all amplitudes of an effect together differ from those at which it does nothing: √(dᵀ C⁻¹ d), C their
    covariance in the fit (A. Wald 1943). The rest of its family is a part of it."""
    return float(np.sqrt(_departure(fit, effect)[0]))


def log_chance_of_nothing(fit: Identification, effect: Effect) -> float:
    """Log of the chance that an effect of no size comes out as large, all else of the fit unknown, its shape too.

    dᵀ C⁻¹ d is χ² with as many degrees of freedom as the readings, not the priors, determine. Where an amplitude is known
    only together with a shape (of a drift that has hardly begun the rate, but neither its end nor its time constant), the
    size of what it does to the readings counts, with its own uncertainty.
    """
    square, dof = _departure(fit, effect)
    return min(log_tail(square, dof), log_tail(_acting(fit, effect), 1.0))


def _departure(fit: Identification, effect: Effect) -> tuple[float, float]:
    """dᵀ C⁻¹ d and its degrees of freedom: the share of each direction that the prior leaves to the readings, summed."""
    model = fit.model
    rest = [e for e in model.added if getattr(e, "of", "") == effect.key]
    own = [model.index[p.name] for e in (effect, *rest) for p in e.amplitudes(model.campaign)]
    sigma = model.prior_sigma[own]
    scaled = fit.covariance[np.ix_(own, own)] / np.outer(sigma, sigma)
    away = (fit.values - model.prior_mean)[own] / sigma
    square = float(away @ np.linalg.lstsq(scaled, away, rcond=None)[0])
    return square, max(float(len(own) - np.trace(scaled)), 0.5)


def _acting(fit: Identification, effect: Effect) -> float:
    """(s/σ)² of the size s of an effect's readings, σ from all its parameters."""
    model = fit.model
    own = [model.index[p.name] for p in effect.parameters(model.campaign)]
    contribution = model.contribution(effect, fit.values)
    square, slope = 0.0, np.zeros(len(own))
    for run in filter(effect.applies, model.campaign.runs):
        line = model.linearise(run, fit.values)
        place = {int(c): i for i, c in enumerate(line.columns)}
        moved = contribution[run.id]
        square += float(np.sum(moved**2))
        for k, c in enumerate(own):
            if c in place:
                slope[k] += float(np.sum(moved * line.jacobian[:, :, place[c]]))
    variance = float(slope @ fit.covariance[np.ix_(own, own)] @ slope)
    return square**2 / variance if variance > 0.0 else 0.0
