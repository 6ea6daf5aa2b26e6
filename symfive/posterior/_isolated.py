"""Isolated readings: instrument outliers, or physics confined to a few positions."""

from __future__ import annotations

import numpy as np
from scipy.special import betaln

from symfive.identify import Identification

__all__ = ["log_chance"]

USUAL = 0.002
"""Mean share of outliers of instruments: 0 to 0.7 % of the readings in ten series of docs/recordings.md recorded at rest."""


def log_chance(fit: Identification) -> float:
    """Log probability density of the readings that a fit excluded, over that of as many readings in the noise's own unit.

    k of n readings are outliers with a rate of which the prior is Beta(1, 1/`USUAL`), and lie at s σ as a Cauchy distribution
    says; a reading that is kept has its Gauss factor in the evidence, but for 1/√2π.
    """
    k, n, rare = len(fit.outliers), fit.problem(fit.model).readings, 1.0 / USUAL
    which = betaln(1.0 + k, rare + n - k) - betaln(1.0, rare)
    where = sum(-np.log(np.pi * (1.0 + outlier.sigmas**2)) for outlier in fit.outliers)
    return float(which + where + 0.5 * k * np.log(2.0 * np.pi))
