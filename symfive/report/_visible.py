"""The part of an effect's readings that the fit without it could not take: what stands in the residual before."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from symfive.identify import Identification

__all__ = ["visible_parts"]

Array = NDArray[np.float64]


def visible_parts(before: Identification, contributions: Sequence[Mapping[str, Array]]) -> list[dict[str, Array]]:
    """Each contribution (run → (N, ny)) less what the parameters of `before` take of it.

    With its Jacobian J, declared noise W⁻¹ and priors P: c - J (JᵀWJ + P⁻¹)⁻¹ JᵀWc, the linearised residual if c is
    in the readings and not in the model.
    """
    if not contributions:
        return []
    model = before.model
    size, count = len(model.parameters), len(contributions)
    normal, right = np.diag(model.prior_sigma**-2.0), np.zeros((size, count))
    lines = {run.id: model.linearise(run, before.values) for run in model.campaign.runs}
    for run in model.campaign.runs:
        line = lines[run.id]
        weighted = line.jacobian / np.square(model.noise(run))[None, :, None]
        normal[np.ix_(line.columns, line.columns)] += np.einsum("rck,rcl->kl", weighted, line.jacobian, optimize=True)
        stacked = np.stack([c[run.id] for c in contributions], axis=2)
        right[line.columns] += np.einsum("rck,rcf->kf", weighted, stacked, optimize=True)
    taken = np.linalg.solve(normal, right)
    return [
        {run: c[run] - lines[run].jacobian @ taken[lines[run].columns, f] for run in lines}
        for f, c in enumerate(contributions)
    ]
