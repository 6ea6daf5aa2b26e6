"""How large amplitudes may be, and by how much stated uncertainties may be too small: widths of priors."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cache

import numpy as np

__all__ = ["WIDTHS", "log_width", "nearest_width"]

WIDTHS = (1.0, 3.0, 10.0, 30.0, 100.0)
"""Prior widths of amplitudes in units of the usual one, half a decade apart: nothing is capped by what machine tools usually
have."""


@cache
def log_width(width: float, widths: tuple[float, ...]) -> float:
    """Log of the prior probability of one of these widths: a half-Cauchy distribution in steps of equal ratio (A. Gelman 2006; N.
    Polson & J. Scott 2012). Large sizes are rare, and none is excluded."""
    weights = [w / (1.0 + w * w) for w in widths]
    return float(np.log(width / (1.0 + width * width) / sum(weights)))


def nearest_width(size: float, widths: Sequence[float] = WIDTHS) -> float:
    """The prior width nearest to an amplitude in log scale."""
    return min(widths, key=lambda width: abs(np.log(width / max(size, 1e-300))))
