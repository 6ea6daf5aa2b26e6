"""Sensors of an R-test that are wired otherwise than the columns say: reversed in sign, or one in the place of another.

A fit is linear in small errors, so what it would leave of other readings follows from its normal equations. Whether a run, or all
of them, were read by exchanged or reversed sensors is decided by the odds of the two fits. No library of physics is complete:
the likelihood counts to the power 1/(1 + M/2), M what the better fit leaves beyond noise (J. W. Miller & D. B. Dunson 2019), so
that another wiring is believed only where it explains nearly all of the residual.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Mapping, Sequence

import numpy as np

from symfive.arrays import Array
from symfive.identify._result import Identification
from symfive.numbers import plain_number

COLUMNS = ("dx_um", "dy_um", "dz_um")
ODDS = 0.01
"""Prior odds that a sensor of a run is wired otherwise: one set-up in a hundred."""
SURE = 100.0
"""Odds at which it is said."""
MOST_ROWS = 20_000


def wiring_doubts(fit: Identification) -> tuple[str, ...]:
    """The wiring that explains what the fit of an R-test leaves, in words; nothing where the fit explains its readings, or no
    wiring does."""
    campaign = fit.model.campaign
    runs = [run.id for run in campaign.runs if "r_test" in run.instrument and set(COLUMNS) <= set(run.readings)]
    limit = np.log(SURE / ODDS * len(WIRINGS) * (len(runs) + 1))
    if not runs or campaign.rows > MOST_ROWS or fit.chi2_dof * fit.dof < fit.dof + 2.0 * limit:
        return ()
    sums = _Sums(fit, runs)
    now, dof = sums.left({}), fit.dof
    best: tuple[float, str, float] = (limit, "", 0.0)
    places = list(dict.fromkeys([*((run,) for run in runs), tuple(runs)]))
    for name, matrix in WIRINGS.items():
        for where in places:
            if len(where) == len(campaign.runs) and np.sum(matrix < 0.0) > 1:
                continue  # all signs turned, and those of the errors too, are the same readings
            left = sums.left(dict.fromkeys(where, matrix))
            gain = 0.5 * (now - left) / (1.0 + 0.5 * max(left - dof, 0.0))
            if gain > best[0]:
                said = f"run {where[0]}" if len(where) == 1 else "all runs"
                best = (gain, f"{said}: {name}", left)
    if not best[1]:
        return ()
    before, after = (plain_number(float(np.sqrt(max(square, 0.0) / dof))) for square in (now, best[2]))
    return (
        f"{best[1]} would explain the readings: the residual falls from {before} to {after} times the noise; check how the "
        "sensors are wired and which column is which, correct the file, and repeat",
    )


def _wirings() -> Iterator[tuple[str, Array]]:
    """Every other assignment of the sensors to the columns, and their signs: y = matrix · readings."""
    for order in itertools.permutations(range(3)):
        for signs in itertools.product((1.0, -1.0), repeat=3):
            matrix = np.zeros((3, 3))
            matrix[range(3), order] = signs
            if not np.array_equal(matrix, np.eye(3)):
                yield _words(order, signs), matrix


def _words(order: Sequence[int], signs: Sequence[float]) -> str:
    """Such a wiring in words."""
    names = [column.removesuffix("_um") for column in COLUMNS]
    moved = [i for i in range(3) if order[i] != i]
    said = []
    if len(moved) == 2:
        said.append(f"{names[moved[0]]} and {names[moved[1]]} exchanged")
    elif moved:
        said.append(f"{', '.join(names)} in the order {', '.join(names[i] for i in order)}")
    reversed_ = [names[i] for i in range(3) if signs[i] < 0.0]
    if reversed_:
        said.append(f"{' and '.join(reversed_)} reversed in sign")
    return ", ".join(said)


WIRINGS = dict(_wirings())


class _Sums:
    """The normal equations of a fit about its values, parameters by their prior 1σ, under the declared noise, and what the
    readings of its R-test `runs` do in them."""

    def __init__(self, fit: Identification, runs: Sequence[str]) -> None:
        model, problem = fit.model, fit.problem()
        sigma = model.prior_sigma
        pull = (np.array([p.mean for p in model.parameters]) - fit.values) / sigma
        self.normal, self.slope, self.square = np.eye(len(sigma)), pull, float(pull @ pull)
        self.read: dict[str, tuple[Array, Array, Array, Array]] = {}
        for (run, instrument), block in problem.blocks(fit.values).items():
            weight = ~block.left_out / problem.noises[run, instrument].declared
            slopes = np.zeros((*weight.shape, len(sigma)))
            slopes[:, :, block.columns] = block.jacobian * sigma[block.columns] * weight[:, :, None]
            residual = block.residual * weight
            self.normal += np.einsum("nck,ncl->kl", slopes, slopes, optimize=True)
            self.slope = self.slope + np.einsum("nck,nc->k", slopes, residual)
            self.square += float(np.sum(residual**2))
            if run in runs and instrument == "r_test":
                read = model.campaign.run(run).readings
                self.read[run] = np.stack([read[name] for name in COLUMNS], axis=1), weight, slopes, residual

    def left(self, wirings: Mapping[str, Array]) -> float:
        """χ², priors included, that the fit leaves where some runs were read by other wirings."""
        slope, square = self.slope.copy(), self.square
        for run, matrix in wirings.items():
            readings, weight, slopes, residual = self.read[run]
            change = readings @ (matrix - np.eye(3)).T * weight
            slope += np.einsum("nck,nc->k", slopes, change)
            square += float(np.sum(change * (change + 2.0 * residual)))
        return square - float(slope @ np.linalg.solve(self.normal, slope))
