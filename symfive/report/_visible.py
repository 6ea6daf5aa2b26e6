"""The part of an effect's readings that a fit without it leaves in the residual."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from symfive.arrays import Array
from symfive.identify import Identification


def visible_parts(before: Identification, contributions: Sequence[Mapping[str, Array]]) -> list[dict[str, Array]]:
    """Each contribution (run → (N, ny)) less what the parameters of `before` take of it.

    With its Jacobian J and priors P, both whitened by the noise that the fit used: c - J (JᵀJ + P⁻¹)⁻¹ Jᵀc, the
    linearised residual if c is in the readings and not in the model.
    """
    if not contributions:
        return []
    problem, taken = before.problem(), list[Array]()
    for contribution in contributions:
        information = problem.information_at(before.values, of=contribution)
        matrix = information.matrix + np.diag(problem.prior_precision)
        taken.append(np.asarray(np.linalg.solve(matrix, information.gradient)))
    return problem.less(contributions, before.values, taken)
