"""How the coefficients of series fall."""

from __future__ import annotations

import math
import re

_ORDER = re.compile(r"(?:P|T|cos|sin)(\d+)(?![\d.^])")


def share_of(name: str) -> float:
    """Prior 1σ of a coefficient, as `P3` or `P1(B)*cos2(C)`, over that of the first two of its series.

    Curves with a slope that is bounded in the mean have coefficients that fall like k^(-3/2), in every factor; 1 for what is
    in no series.
    """
    return math.prod(min(1.0, (2.0 / int(order)) ** 1.5) for order in _ORDER.findall(name))
