"""The part of an effect's readings that the fit without it could not take: what stands in the residual before."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from symfive.campaign import Run
from symfive.identify import Identification, Problem
from symfive.instruments import instruments_of
from symfive.machine import Machine

__all__ = ["visible_parts"]

Array = NDArray[np.float64]


def visible_parts(before: Identification, contributions: Sequence[Mapping[str, Array]]) -> list[dict[str, Array]]:
    """Each contribution (run → (N, ny)) less what the parameters of `before` take of it.

    With its Jacobian J and priors P, both whitened by the noise that the fit used: c - J (JᵀJ + P⁻¹)⁻¹ Jᵀc, the
    linearised residual if c is in the readings and not in the model.
    """
    if not contributions:
        return []
    model = before.model
    problem = Problem.of(model, noises=before.noises)
    for outlier in before.outliers:
        names = [column.name for column in model.columns(outlier.run)]
        problem.left_out[outlier.run][outlier.row, names.index(outlier.column)] = True
    blocks = problem.blocks(before.values, readings=False)
    found = []
    for contribution in contributions:
        read = {
            key: replace(
                block, residual=contribution[key[0]][:, _place(model.campaign.run(key[0]), key[1], model.machine)]
            )
            for key, block in blocks.items()
        }
        information = problem.information(read)
        taken = np.linalg.solve(information.matrix + np.diag(problem.prior_precision), information.gradient)
        left = {run: np.array(values) for run, values in contribution.items()}
        for (run, instrument), block in read.items():
            place = _place(model.campaign.run(run), instrument, model.machine)
            left[run][:, place] = block.residual - block.jacobian @ taken[block.columns]
        found.append(left)
    return found


def _place(run: Run, instrument: str, machine: Machine) -> slice:
    """Which columns of the run's readings are those of the instrument."""
    first = 0
    for other in instruments_of(run):
        count = len(other.columns(run, machine))
        if other.name == instrument:
            return slice(first, first + count)
        first += count
    raise KeyError(instrument)
