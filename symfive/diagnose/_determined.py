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
    away, spread = _departure(fit, effect)
    return float(np.sqrt(_square(away, spread)))


def log_chance_of_nothing(fit: Identification, effect: Effect) -> float:
    """Log of the chance that an effect of no size comes out as large, all else of the fit unknown, its shape too.

    dᵀ C⁻¹ d is χ² with as many degrees of freedom as the readings, not the priors, determine; or |d|² over the variance along
    d, of one, where that says more: several amplitudes may be uncertain by one common factor only.
    """
    away, spread = _departure(fit, effect)
    dof = max(float(len(away) - np.trace(spread)), 0.5)
    size = float(away @ away) ** 2 / max(float(away @ spread @ away), 1e-300)
    return min(log_tail(_square(away, spread), dof), log_tail(size, 1.0))


def _departure(fit: Identification, effect: Effect) -> tuple[Array, Array]:
    """The amplitudes less those at which the effect does nothing (n,), and their covariance (n, n); units: their priors' 1σ."""
    model = fit.model
    rest = [e for e in model.added if getattr(e, "of", "") == effect.key]
    own = [model.index[p.name] for e in (effect, *rest) for p in e.amplitudes(model.campaign)]
    sigma = model.prior_sigma[own]
    return (fit.values - model.prior_mean)[own] / sigma, fit.covariance[np.ix_(own, own)] / np.outer(sigma, sigma)


def _square(away: Array, spread: Array) -> float:
    return float(away @ np.linalg.lstsq(spread, away, rcond=None)[0])
