"""The numbers that standards ask for, from the readings as they are: one file a standard.

They stand beside identification and diagnosis and need neither: a G is the same with any model. `standard_values` collects
them; a new standard is one file and one line in `EVALUATIONS`. Limits of tolerance are decided by ISO 14253-1.
"""

from __future__ import annotations

from collections.abc import Callable

from symfive.campaign import Campaign
from symfive.identify import Identification
from symfive.standards._value import (
    COVERAGE,
    FAIL,
    PASS,
    UNDECIDED,
    StandardValue,
    decided,
    decision,
    standards_data,
    standards_text,
    with_uncertainties,
)
from symfive.standards.iso230_2 import positioning_values
from symfive.standards.iso230_4 import circular_values
from symfive.standards.iso10791_6 import kinematic_values
from symfive.standards.squareness import squareness_values

__all__ = [
    "COVERAGE", "EVALUATIONS", "FAIL", "PASS", "UNDECIDED", "StandardValue", "circular_values", "decided", "decision",
    "kinematic_values", "positioning_values", "squareness_values", "standard_values", "standards_data", "standards_text",
    "with_uncertainties",
]  # fmt: skip

EVALUATIONS: tuple[Callable[[Campaign], tuple[StandardValue, ...]], ...] = (
    circular_values,
    positioning_values,
    kinematic_values,
)
"""Functions of a measured campaign, one a standard."""


def standard_values(source: Campaign | Identification) -> tuple[StandardValue, ...]:
    """All values of the standards that follow from the readings; of an identification also its squarenesses."""
    if isinstance(source, Identification):
        return (*standard_values(source.model.campaign), *squareness_values(source))
    return tuple(value for evaluate in EVALUATIONS for value in evaluate(source))
