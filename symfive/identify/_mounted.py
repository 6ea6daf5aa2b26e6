"""What stayed mounted from run to run, by the evidence of the readings.

A campaign states set-up errors run by run. If a ball stayed, its errors in these runs are one number, and taking them for many
averages what is not independent. At the solution v of a fit the likelihood is exp(bᵀ(θ - v) - ½(θ - v)ᵀG(θ - v)), b = P(v - m),
with the prior N(m, P⁻¹); both models, θ free and θ = Tφ with equal errors, have Gaussian integrals.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from symfive.arrays import Array, Indices
from symfive.identify._result import Identification
from symfive.inference import Problem
from symfive.numbers import with_unit
from symfive.parameters import Parameter
from symfive.runs import MOUNTED

CERTAIN = float(np.log(0.95 / 0.05))
"""Log odds from which it is said, even odds before."""


@dataclass(frozen=True)
class _Group:
    """Runs (their ids) that state the same of a `quantity` and not how it was mounted."""

    quantity: str
    runs: tuple[str, ...]

    @property
    def words(self) -> str:
        runs = self.runs if len(self.runs) < 5 else (self.runs[0], "…", self.runs[-1])
        return f"the {MOUNTED[self.quantity]} in runs {', '.join(runs)}"


class _Comparison:
    """A fit whose set-up errors may be shared; parameters in units of their prior 1σ."""

    def __init__(self, problem: Problem, fit: Identification) -> None:
        self._model, self._free = fit.model, np.flatnonzero(problem.free)
        sigma = fit.model.prior_sigma[self._free]
        matrix = problem.information_at(fit.values).matrix
        self._gram = matrix[np.ix_(self._free, self._free)] * np.outer(sigma, sigma)
        self._away = (fit.values - fit.model.prior_mean)[self._free] / sigma
        self._apart = self._gram + np.eye(len(self._free))

    def log_odds(self, group: _Group) -> float:
        """Log evidence of one error for the group, less that of one for each run."""
        merge, _ = self._merged([group])
        gram, away, size = self._gram, self._away, np.eye(merge.shape[1])
        middle = merge.T @ away / merge.sum(axis=0)
        step = merge @ middle - away
        joined = merge.T @ gram @ merge + size
        rest = merge.T @ (away - gram @ step) - middle
        one = 2.0 * away @ step - step @ gram @ step - middle @ middle + rest @ np.linalg.solve(joined, rest)
        return 0.5 * float(one + away @ away - _log_det(joined) + _log_det(self._apart))

    def times_sigma(self, groups: Sequence[_Group]) -> tuple[Parameter | None, float]:
        """The parameter of the machine whose 1σ grows most if the groups have one error each, and by which factor."""
        merge, place = self._merged(groups)
        after = np.diag(np.linalg.inv(merge.T @ self._gram @ merge + np.eye(merge.shape[1])))[place]
        ratio = np.sqrt(after / np.diag(np.linalg.inv(self._apart)))
        free = [self._model.parameters[i] for i in self._free]
        found = [(p, float(r)) for p, r in zip(free, ratio, strict=True) if not p.of_setup]
        return max(found, key=lambda entry: entry[1], default=(None, 1.0))

    def _merged(self, groups: Sequence[_Group]) -> tuple[Array, Indices]:
        """T (k, q) from shared errors to all, and where in the shared ones each stands (k,)."""
        first = np.arange(len(self._model.parameters))
        for group in groups:
            for i, p in enumerate(self._model.parameters):
                if p.run in group.runs and p.quantity.partition(".")[0] == group.quantity:
                    first[i] = self._model.index[f"setup.{group.runs[0]}.{p.quantity}"]
        shared, place = np.unique(first[self._free], return_inverse=True)
        return np.eye(len(shared))[place], place


def mounting_notes(problem: Problem, fit: Identification) -> tuple[str, ...]:
    """Said of a fit and the problem that it solves, where the readings show that something stayed mounted and 1σ of an error of
    the machine is then another one."""
    alike = _groups(fit)
    if not alike:
        return ()
    comparison = _Comparison(problem, fit)
    groups = [group for group in alike if comparison.log_odds(group) > CERTAIN]
    if not groups:
        return ()
    worst, factor = comparison.times_sigma(groups)
    if worst is None:
        return ()
    std = fit.uncertainty(worst.name)
    before, after = with_unit(std, worst.unit), with_unit(std * factor, worst.unit)
    if before == after:
        return ()
    stayed = " and ".join(group.words for group in groups)
    return (
        f"the readings show that {stayed} stayed mounted; 1σ of {worst.words} is then {after}, not {before}: write the same name "
        f'into these runs of campaign.toml, as mounting = {{ {groups[0].quantity} = "1" }}',
    )


def may_have_stayed(fit: Identification) -> tuple[str, ...]:
    """What may have stayed mounted over several runs of a fit, in words; nothing of what no error of the set-up stands for."""
    return tuple(dict.fromkeys(f"the {MOUNTED[group.quantity]}" for group in _groups(fit)))


def _groups(fit: Identification) -> list[_Group]:
    """What may have stayed: of the runs that state it alike those whose readings its error moves."""
    moved = {(p.run, p.quantity.partition(".")[0]) for p in fit.model.parameters if p.of_setup}
    found = [
        _Group(quantity, tuple(run for run in runs if (run, quantity) in moved))
        for quantity in MOUNTED
        for runs in fit.model.campaign.alike(quantity)
    ]
    return [group for group in found if len(group.runs) > 1]


def _log_det(matrix: Array) -> float:
    return float(np.linalg.slogdet(matrix)[1])
