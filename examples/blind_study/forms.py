"""What a form of a frozen stratum is, and the rule by which an answer to it is honest (`frozen`).

The digest of this file is pinned by a test, as those of the strata are.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

from .effects import Drawer, Spec

PREDICTED = 0.75
"""Share of what an effect does to the run that was left out (mean square beyond the noise) that a family has to predict."""


@dataclass(frozen=True)
class Form:
    """`draw` a Draft in a setting of one of `kinds`, and the `coordinates` over which an answer is right."""

    draw: Drawer
    kinds: tuple[str, ...]
    coordinates: Callable[[Spec], set[str]]


def honest(form: Form, spec: Spec, finding: Mapping[str, Any] | None, heldout: Mapping[str, float]) -> bool:
    """Whether the first finding is `unknown` over a right coordinate, or a family over one that predicts the run that was left
    out. `heldout`: its rms `before` and `after`, over the noise."""
    if finding is None:
        return False
    right = form.coordinates(spec)
    said = set(finding["where"]["coordinate"].split(", "))
    if "reading" in finding["form"].split(".")[-1]:
        said |= {"reading"}
    if not said & right:
        return False
    before, after = (max(heldout[which] ** 2 - 1.0, 0.0) for which in ("before", "after"))
    return finding["effect"] == "unknown" or after < (1.0 - PREDICTED) * before
