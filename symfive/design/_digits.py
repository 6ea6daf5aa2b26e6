"""Numbers as files hold them."""

from __future__ import annotations

import math


def down(share: float) -> str:
    """A share with three digits, rounded down: what is certified is no less."""
    return f"{math.floor(share * 1e3) / 1e3:.3f}"


def six_digits(value: float) -> float:
    """Six digits: enough for a plan, and the same on every machine."""
    return float(f"{value:.6g}") if math.isfinite(value) else 0.0
