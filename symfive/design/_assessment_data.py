"""An assessment as nested mappings, for `assessment.json` and `plan.json`."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

from symfive.campaign import FIRST_LINE

if TYPE_CHECKING:
    from symfive.design._assess import Assessment


def assessment_data(assessment: Assessment) -> dict[str, Any]:
    """An assessment as nested mappings: expected 1σ, rank, what stays confounded, valuation, worth of rows and runs."""
    sigma, centre = assessment.sigma, assessment.tool_centre_um
    most, row = assessment.most()
    return {
        "expected": {
            p.name: {"std": six_digits(sigma[p.name]), "prior_std": six_digits(p.sigma), "unit": p.unit}
            for p in assessment.parameters
        },
        "joint_value": six_digits(assessment.value),
        "tool_centre_point_um": None
        if centre is None
        else {"mean": six_digits(centre[0]), "largest": six_digits(centre[1])},
        "rank": assessment.rank,
        "parameters": len(assessment.parameters),
        "confounded": [list(c.names) for c in assessment.confounded],
        "confounded_in_words": [c.words for c in assessment.confounded],
        "valuation": {axis: six_digits(v) for axis, v in assessment.valuation.items()},
        "tells_most": {"run": most, "row": row + FIRST_LINE},
        "tells_nothing": {run: len(rows) for run, rows in assessment.idle.items()},
        "run_worth": {run: six_digits(v) for run, v in assessment.run_worth.items()},
    }


def down(share: float) -> str:
    """A share with three digits, rounded down: what is certified is no less."""
    return f"{math.floor(share * 1e3) / 1e3:.3f}"


def six_digits(value: float) -> float:
    """Six digits: enough for a plan, and the same on every machine."""
    return float(f"{value:.6g}") if math.isfinite(value) else 0.0
