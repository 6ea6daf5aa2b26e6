"""A number that a standard asks for, with its uncertainty and all that ISO 230-1 wants said beside it."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from symfive.numbers import rounded, unit_words

COVERAGE = 2.0
"""Coverage factor k of an expanded uncertainty U (ISO 14253-1 and ISO/TR 230-9)."""


@dataclass(frozen=True, kw_only=True)
class StandardValue:
    """`value` and expanded uncertainty `u` (k = 2), both in `unit`, of the quantity `name` (`G`, `E`, …) of a `standard`.

    `what` says which of its kind (`CCW`, `X up`, `dx`), `runs` the ids that it was evaluated from, `conditions` what the
    number holds for (feed, diameter, direction, place …), `limits` what keeps it from being a value of the standard or must
    be known to compare it. `u` is NaN where nothing is known of it.
    """

    standard: str
    name: str
    what: str
    value: float
    u: float
    unit: str
    runs: tuple[str, ...]
    conditions: Mapping[str, str] = field(default_factory=dict)
    limits: tuple[str, ...] = ()

    @property
    def words(self) -> str:
        """Name, value and U in one line."""
        spread = f", U = {rounded(self.u, self.u, self.unit)}" if math.isfinite(self.u) else ", U unknown"
        number = (
            rounded(self.value, self.u, self.unit) if math.isfinite(self.u) else rounded(self.value, 0.0, self.unit)
        )
        return f"{self.title} = {number} {unit_words(self.unit)}{spread}"

    @property
    def title(self) -> str:
        """The name, and which of its kind."""
        return f"{self.name} {self.what}".strip()

    def to_data(self) -> dict[str, Any]:
        """As JSON, `U` null where it is unknown."""
        return {
            "standard": self.standard, "name": self.name, "what": self.what, "value": self.value,
            "U": self.u if math.isfinite(self.u) else None, "unit": self.unit, "runs": list(self.runs),
            "conditions": dict(self.conditions), "limits": list(self.limits),
        }  # fmt: skip
